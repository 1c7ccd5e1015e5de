"""The models of the strands of a net joined to one (`net`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass
from dlo_sim.core.quadrature import Quadrature
from dlo_sim.engine import arrays as bits
from dlo_sim.engine.arrays import CableArrays
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs
from dlo_sim.simulation import obstacles, self_contact
from dlo_sim.simulation.arrays import from_blocks, sizes_of, to_blocks, without_margins
from dlo_sim.simulation.connector_shape import beside, groups_of
from dlo_sim.simulation.geometry import Geometries
from dlo_sim.simulation.held_rows import fill_rows
from dlo_sim.simulation.holding import Holding, Point, Row
from dlo_sim.simulation.model import Layout, Model
from dlo_sim.simulation.net import joining, layout_of, rolls_of

Array = NDArray[np.float64]
Place = tuple[str, float]
LIGHT = 1e-3  # mass of the body of a joint, as a share of that of a third of a knot span
RIGID = 100.0  # stiffness K of a body over EA times the length of its directors, or its `load`
# Values in the lanes of void spans that the compiled code divides by.
VOID = {"padding": 1.0, "slope": 1.0, "axial": 1.0, "bending": 1.0, "torsional": 1.0}


def joined(
    scene: Scene,
    needs: Needs,
    geometries: Geometries,
    models: Mapping[str, Model],
    radius: float,
) -> Model:
    """One model of all strands.

    Args:
        geometries: what holds them, by the names of all. models: of each alone, by its name.
        radius: of the thickest strand or connector [m].
    """
    layout, first = layout_of(scene, geometries, models), next(iter(models.values()))
    parts = list(layout.parts.values())
    holding = held_by_all(layout, len(first.axes), first.twist)
    rolls = rolls_of(layout) if first.twist else []
    rigid = sum(math.isinf(one.stiffness) for one in rolls)
    terms = sum_of_terms(models) & ~(bits.BORDERED | bits.SPRUNG) | holding.terms
    sizes = sizes_of(
        terms=terms
        | bits.RIGID * bool(layout.bodies)
        | (bits.BORDERED | bits.ROLLED) * bool(rolls),
        dim=len(first.axes),
        twist=first.twist,
        n=layout.n,
        samples=first.arrays.sizes["samples"],
        holding=holding,
        grasps=len(scene.holders),
        loads=len(scene.loads) if "loads" in needs else 0,
        obstacles=first.arrays.sizes["obstacles"],
        pieces=first.arrays.contact.pieces + first.arrays.contact.guide_pieces,
        segments=first.arrays.sizes["segments"],
        field_values=first.arrays.sizes["field_values"],
        bodies=len(layout.bodies),
        strands=len(parts),
        rolls=(rigid, len(rolls) - rigid),
        chain_joints=len(meeting_places(layout)),
        extras=groups_of(scene.connectors) * ("contact" in needs),
    )
    arrays = CableArrays(sizes, inputs=None, state=None, work=None)
    model = replace(
        first,
        scene=scene,
        needs=needs,
        geometries=geometries,
        arrays=arrays,
        rule=Quadrature(
            layout.by_span([part.model.rule.xi for part in parts]),
            layout.by_span([part.model.rule.weights for part in parts]),
        ),
        holding=holding,
        bending_stiffness=layout.by_span([part.model.bending_stiffness for part in parts]),
        layout=layout,
    )
    arrays.axes[:] = first.arrays.axes
    arrays.physics = first.arrays.physics
    _Joining(model, layout, radius).fill()
    return model


def meeting_places(layout: Layout) -> list[tuple[Place, Place]]:
    """Both places (strand, material coordinate [m]) of every joint, and of every two strands that
    begin at the same place.
    """
    joints = [((one.strand, one.u), (one.other, one.at)) for one in layout.joins]
    siblings = [
        (here, there)
        for k, (here, at) in enumerate(joints)
        for there, other_at in joints[:k]
        if other_at == at
    ]
    return joints + siblings


def sum_of_terms(models: Mapping[str, Model]) -> int:
    """The bits of the terms that any of these models has."""
    terms = 0
    for model in models.values():
        terms |= model.terms
    return terms


class _Joining:
    """Writes the arrays of a net from those of its strands."""

    def __init__(self, model: Model, layout: Layout, radius: float) -> None:
        self._radius = radius
        self._model, self._arrays, self._layout = model, model.arrays, layout
        self._parts = list(layout.parts.values())
        self._each = [part.model.arrays for part in self._parts]

    def fill(self) -> None:
        model, layout = self._model, self._layout
        self._mesh()
        self._contact()
        self_contact.fill(model, self._joints())
        self._masses()
        self._loads()
        self._numbers()
        fill_rows(model)
        alone = only_of_bodies(layout)
        for number, body in enumerate(layout.bodies):
            given, cable = self._arrays.bodies, layout.parts[body.strand].model.scene.cable
            given.point[number] = body.points
            given.idle[number] = alone[body.points]
            given.length[number] = [sign * body.length for sign in body.signs]
            given.stiffness[number] = RIGID * max(cable.EA * body.length, body.load)
        rolls = self._arrays.rolls
        for number, roll in enumerate(rolls_of(layout) if model.twist else []):
            rolls.body[number], rolls.first[number] = roll.body, roll.place.first
            rolls.weights[number], rolls.stiffness[number] = roll.place.weights, roll.stiffness
            rolls.along[number], rolls.side[number] = roll.along, roll.side

    def _mesh(self) -> None:
        mesh = self._arrays.mesh
        for name in mesh.fields:
            if name in ("branch", "strand", "length", "radius"):
                continue
            void = VOID.get(name, 0.0)
            lanes = [
                from_blocks(getattr(one.mesh, name), one.n - bspline.DEGREE) for one in self._each
            ]
            getattr(mesh, name)[:] = to_blocks(self._layout.by_span(lanes, void), beyond=void)
        numbers = [np.full(one.n - bspline.DEGREE, float(k)) for k, one in enumerate(self._each)]
        mesh.number[:] = to_blocks(self._layout.by_span(numbers, -1.0), beyond=-1.0)
        for number, part in enumerate(self._parts):
            mesh.branch[part.here] = number
            mesh.strand[number] = part.here.start, part.here.stop
            mesh.length[number] = part.length
            mesh.radius[number] = 0.5 * part.model.scene.cable.diameter
        names = [part.name for part in self._parts]
        for body in self._layout.bodies:
            mesh.branch[body.first : body.first + bspline.ACTIVE] = names.index(body.strand)

    def _contact(self) -> None:
        """The obstacles, which are those of every strand, and the samples of all."""
        contact, model = self._arrays.contact, self._model
        contact.pieces = self._each[0].contact.pieces
        contact.guide_pieces = self._each[0].contact.guide_pieces
        if "contact" in model.needs:
            density = self._parts[0].model.scene.cable.mu
            samples = beside(model.bodies, density, self._radius)
            obstacles.fill(model, self._radius, samples)

    def _joints(self) -> list[self_contact.Joined]:
        """Where strands that are joined do not touch each other: until they are apart by their
        diameter, also those that begin at the same place.
        """
        numbers = {part.name: number for number, part in enumerate(self._parts)}
        parts, joined = self._layout.parts, []
        for (one, u), (other, v) in meeting_places(self._layout):
            ways = parts[one].drawn[:, 0], parts[other].drawn[:, 0]
            apart = math.sqrt(max(0.5 - 0.5 * abs(float(ways[0] @ ways[1])), 1e-4))
            thick = max(parts[name].model.scene.cable.diameter for name in (one, other))
            beside = max(self_contact.APART, 0.5 / apart) * thick
            joined.append(self_contact.Joined((numbers[one], u), (numbers[other], v), beside))
        return joined

    def _masses(self) -> None:
        """Matrices and vectors by control point, with the bodies'."""
        linear, layout, model = self._arrays.linear, self._layout, self._model
        linear.decay[:] = self._each[0].linear.decay
        for name in ("mass", "damping", "twist", "weight", "greville", "frame_factors"):
            own = [
                without_margins(getattr(one.linear, name), one.n)
                for one in self._each
                if getattr(one.linear, name).size
            ]
            if own:
                without_margins(getattr(linear, name), model.n)[:] = layout.by_point(own)
        bodies, scene = mass_of_bodies(layout), model.scene
        alone = only_of_bodies(layout)
        alpha = scene.decay_rates[1] * bool(linear.damping.any())
        self._add_band(linear.mass[0], bodies)
        self._add_band(linear.damping[0], alpha * bodies)
        kinds = [model.mass(0)]
        if model.twist:
            idle = np.zeros_like(bodies)
            idle[0, alone] = model.mass(len(model.axes))[0].max()
            self._add_band(linear.mass[1], idle)
            kinds.append(model.mass(len(model.axes)))
        for kind, band in enumerate(kinds):
            lower, inverse = mass.factorize(band, np.zeros(model.n, dtype=bool))
            seven = without_margins(linear.factors[kind], model.n)
            seven[3] = inverse
            for k in range(1, 4):
                seven[3 - k] = lower[k - 1]
                seven[3 + k, :-k] = lower[k - 1, k:]
        if "gravity" in model.needs:
            pull = np.asarray(scene.gravity)[list(model.axes)]
            weight = mass.multiply(bodies, np.ones(model.n))
            heavy = [one.connector is not None for one in layout.bodies]
            for body, counts in zip(layout.bodies, heavy, strict=True):
                if not counts:  # of a joint, as light as the cable can bear
                    weight[body.first : body.first + 4] = 0.0
            without_margins(linear.weight, model.n)[:] += np.outer(pull, weight)

    def _add_band(self, seven: Array, band: Array) -> None:
        """Add a symmetric band matrix to one of seven lines."""
        seven = without_margins(seven, self._model.n)
        seven[3] += band[0]
        for k in range(1, 4):
            seven[3 + k, :-k] += band[k, :-k]
            seven[3 - k, k:] += band[k, :-k]

    def _loads(self) -> None:
        """The loads in the order of the scene."""
        loads, model = self._arrays.loads, self._model
        loads.count = len(loads.first)
        names = [load.name for load in model.scene.loads]
        for part, one in zip(self._parts, self._each, strict=True):
            for own, load in enumerate(part.model.scene.loads[: loads.count]):
                k = names.index(load.name)
                loads.first[k] = one.loads.first[own] + part.first
                loads.values[k], loads.slopes[k] = one.loads.values[own], one.loads.slopes[own]
                basis = without_margins(loads.basis, model.n)
                basis[k, part.here] = without_margins(one.loads.basis, one.n)[own]

    def _numbers(self) -> None:
        physics, each = self._arrays.physics, [one.physics for one in self._each]
        physics.shortest_span = min(one.shortest_span for one in each)
        physics.axial_round_off = sum(one.axial_round_off for one in each)
        physics.bending_round_off = sum(one.bending_round_off for one in each)


def held_by_all(layout: Layout, dim: int, twist: bool) -> Holding:
    """What the holders of all strands hold, and what joins the strands."""
    out = Holding()
    at_points: list[Row] = []
    between: list[Row] = []
    joints: list[Row] = []
    springs: list[Row] = []
    for part in layout.parts.values():
        held, known = part.model.holding, len(out.points)
        for point in held.points:
            own = point.own + part.first if point.own >= 0 else -1
            out.hold(replace(point, first=point.first + part.first, own=own))
        for row in held.rows:
            moved = replace(row, point=row.point + known, grasp=row.grasp + part.grasp)
            (between if held.points[row.point].own < 0 else at_points).append(moved)
        springs += [
            replace(row, point=row.point + known, grasp=row.grasp + part.grasp)
            for row in held.springs
        ]
    for one in joining(layout, dim, twist):
        if isinstance(one, Point):
            number = out.hold(one)
        else:
            rigid = math.isinf(one.stiffness)
            (between if rigid else joints).append(replace(one, point=number))
    out.rows, out.springs = at_points + between, joints + springs
    return out


def mass_of_bodies(layout: Layout) -> Array:
    """Mass matrix of the bodies on one line, lower diagonals, shape (4, n)."""
    out = np.zeros((bspline.ACTIVE, layout.n))
    for body in layout.bodies:
        part = layout.parts[body.strand]
        inertia = body.inertia(LIGHT * part.model.scene.cable.mu * body.length)
        for k in range(bspline.ACTIVE):
            for i in range(bspline.ACTIVE - k):
                out[k, body.first + i] += inertia[i + k, i]
    return out


def only_of_bodies(layout: Layout) -> NDArray[np.bool_]:
    """Mask of the control points that are of no strand, shape (n,)."""
    mask = np.ones(layout.n, dtype=bool)
    for part in layout.parts.values():
        mask[part.here] = False
    return mask
