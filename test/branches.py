"""Several cables, the branches of one, in one set of arrays.

The control points of the branches follow each other. The three knot spans between the last control
points of a branch and the first of the next are void: without length, samples or stiffness, as the
lanes beyond the last span. So no loop of the compiled code needs to know of branches; only
constraint rows join them (`engine.rows`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.quadrature import Quadrature
from dlo_sim.engine import arrays as bits
from dlo_sim.engine.arrays import CableArrays, Mesh
from dlo_sim.simulation import obstacles, self_contact
from dlo_sim.simulation.arrays import from_blocks, sizes_of, to_blocks, without_margins
from dlo_sim.simulation.build_model import fill_rows, held_values, terms_of_holding
from dlo_sim.simulation.holding import Holding, Point, Row, Weights
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
VOID = bspline.DEGREE  # knot spans between two branches
HELD = bits.BORDERED | bits.SPRUNG  # terms of what holds a branch
# Terms that follow the cable from one end to the other, or slide along it.
ALONG = bits.TORSION | bits.SLIDING


@dataclass(frozen=True)
class Joint:
    """Two branches stay together at material coordinates.

    Attributes:
        branches: indices of the two. places: material coordinate on each [m].
        orders: derivatives of r(u) that agree: 0 alone is a hinge; 0 and 1 carry the direction on.
        stiffness: of springs that hold them together [N/m], [N m/rad] of r'; infinite: rigid.
    """

    branches: tuple[int, int]
    places: tuple[float, float]
    orders: tuple[int, ...] = (0,)
    stiffness: float = np.inf


def joined(
    models: Sequence[Model],
    joints: Sequence[Joint],
    beside: obstacles.Beside = obstacles.NONE_BESIDE,
    touching: Sequence[self_contact.Joined] = (),
) -> Model:
    """One model of several branches.

    The grasps of the branches follow each other, and so do springs and loads. Obstacles and all
    numbers in `physics` are those of the first branch. `beside`: samples that touch obstacles, too.
    `touching`: joints near which branches do not touch each other.

    Raises:
        ValueError: branches of different lines, terms or samples, with terms that follow a cable
            from one end to the other (Frenet torsion) or slide along it, or inextensible ones.
    """
    first = models[0]
    for model in models:
        alike = ("dim", "lines", "samples")
        unlike = any(model.arrays.sizes[size] != first.arrays.sizes[size] for size in alike)
        if unlike or (model.terms ^ first.terms) & ~HELD:
            raise ValueError("branches: need the same lines, terms, and samples in a span")
    if first.has(ALONG) or first.arrays.physics.keeps_length:
        raise ValueError(
            "branches: Frenet torsion, grasps that slide, and inextensible cables are not available"
        )
    counts = [(one.arrays.contact.pieces, one.arrays.contact.guide_pieces) for one in models]
    pieces = np.max(counts, axis=0).tolist()
    radius = obstacles.thickest(models)
    fields = obstacles.fields_of(first.scene, radius) if first.has(bits.CONTACT) else ()
    starts = np.cumsum([0, *(model.n for model in models)]).tolist()
    holding = _all_held(models, joints, starts)
    sizes = sizes_of(
        terms=first.terms & ~HELD | terms_of_holding(holding),
        dim=len(first.axes),
        twist=first.twist,
        n=starts[-1],
        samples=first.arrays.sizes["samples"],
        holding=holding,
        grasps=sum(model.arrays.sizes["grasps"] for model in models),
        loads=sum(model.arrays.sizes["loads"] for model in models),
        obstacles=first.arrays.sizes["obstacles"],
        pieces=sum(pieces),
        segments=max(model.arrays.sizes["segments"] for model in models),
        chain_joints=len(touching),
        field_values=sum(field.values.size for field in fields),
        extras=len(beside.first),
        strands=len(models),
    )
    arrays = CableArrays(sizes, inputs=None, state=None, work=None)
    model = Model(
        first.scene,
        first.needs,
        first.geometries,
        arrays,
        np.concatenate([model.knots for model in models]),
        Quadrature(
            _with_voids([model.rule.xi for model in models]),
            _with_voids([model.rule.weights for model in models]),
        ),
        first.axes,
        first.twist,
        holding,
        first.axial_stiffness,
        _with_voids([model.bending_stiffness for model in models]),
        first.rest,
        first.origin,
        first.obstacles,
        fields,
    )
    arrays.axes[:] = first.arrays.axes
    arrays.physics = first.arrays.physics
    _fill_mesh(arrays.mesh, [model.arrays for model in models], starts)
    if first.has(bits.CONTACT):
        arrays.contact.pieces, arrays.contact.guide_pieces = pieces
        obstacles.fill(model, models, beside)
    arrays.chain.segments = arrays.sizes["segments"]
    self_contact.fill_strands(model, models, touching)
    _fill_lines(arrays, [model.arrays for model in models], starts)
    values = held_values(model)
    fill_rows(model, values, _mass_solutions(models, model, values, starts))
    return model


def _with_voids(by_span: Sequence[Array], void: float = 0.0) -> Array:
    """Values of the spans of each branch, shape (spans, ...), with void spans between them."""
    gap = np.full((VOID, *by_span[0].shape[1:]), void)
    parts = [by_span[0]]
    for values in by_span[1:]:
        parts += [gap, values]
    return np.concatenate(parts)


def _fill_mesh(mesh: Mesh, parts: Sequence[CableArrays], starts: Sequence[int]) -> None:
    for name in mesh.fields:
        if name == "branch":
            for k, (begin, end) in enumerate(zip(starts[:-1], starts[1:], strict=True)):
                mesh.branch[begin:end] = k
                mesh.strand[k], mesh.length[k] = (begin, end), parts[k].mesh.length[0]
                mesh.radius[k] = parts[k].mesh.radius[0]
            continue
        if name in ("strand", "length", "radius"):
            continue
        lanes = [from_blocks(getattr(p.mesh, name), p.n - bspline.DEGREE) for p in parts]
        # `slope` and the stiffnesses have no meaning on void spans, but are divided by.
        stiff = {"axial": 1.0, "bending": 1.0, "torsional": 1.0}
        void = ({"padding": 1.0, "slope": 1.0, "number": -1.0} | stiff).get(name, 0.0)
        if name == "number":
            lanes = [one + k for k, one in enumerate(lanes)]
        getattr(mesh, name)[:] = to_blocks(_with_voids(lanes, void), beyond=void)


_BY_POINT = "mass", "factors", "damping", "twist", "weight", "frame_factors", "greville"


def _fill_lines(arrays: CableArrays, parts: Sequence[CableArrays], starts: Sequence[int]) -> None:
    """Matrices and vectors by control point: those of the branches, block by block."""
    linear = arrays.linear
    linear.decay[:] = parts[0].linear.decay
    for part, begin in zip(parts, starts, strict=False):
        here = slice(begin, begin + part.n)
        for name in _BY_POINT:
            into, of = getattr(linear, name), getattr(part.linear, name)
            if of.size:
                without_margins(into, arrays.n)[..., here] = without_margins(of, part.n)
    loads, at = arrays.loads, 0
    loads.count = len(loads.first)
    for part, begin in zip(parts, starts, strict=False):
        here = slice(at, at + part.loads.count)
        at += part.loads.count
        loads.first[here] = part.loads.first + begin
        loads.values[here], loads.slopes[here] = part.loads.values, part.loads.slopes
        basis = without_margins(loads.basis, arrays.n)
        basis[here, begin : begin + part.n] = without_margins(part.loads.basis, part.n)


def _all_held(models: Sequence[Model], joints: Sequence[Joint], starts: Sequence[int]) -> Holding:
    """What the grasps of all branches hold, and what joins the branches."""
    out = Holding()
    at_points: list[Row] = []
    between: list[Row] = []
    springs: list[Row] = []
    grasps = 0
    for model, begin in zip(models, starts, strict=False):
        held = model.holding
        known = len(out.points)
        for point in held.points:
            own = point.own + begin if point.own >= 0 else -1
            out.hold(replace(point, first=point.first + begin, own=own))
        for row in held.rows:
            moved = replace(row, point=row.point + known, grasp=row.grasp + grasps)
            (between if held.points[row.point].own < 0 else at_points).append(moved)
        for row in held.springs:
            springs.append(replace(row, point=row.point + known, grasp=row.grasp + grasps))
        grasps += model.arrays.sizes["grasps"]
    for joint in joints:
        for order in joint.orders:
            place = out.hold(_difference(models, joint, order, starts))
            for line in range(len(models[0].axes)):
                row = Row(place, -1, line, stiffness=joint.stiffness)
                if np.isfinite(joint.stiffness):
                    springs.insert(0, row)
                else:
                    between.append(row)
    out.rows, out.springs = at_points + between, springs
    return out


def _difference(models: Sequence[Model], joint: Joint, order: int, starts: Sequence[int]) -> Point:
    """The derivative of this order on the first branch minus that on the second."""
    firsts, weights = [], []
    for branch, u in zip(joint.branches, joint.places, strict=True):
        column, values = bspline.active_basis(models[branch].knots, [u], order)
        firsts.append(int(column[0]) + starts[branch])
        weights.append(values[0])
    here: Weights = tuple(weights[0].tolist())
    there: Weights = tuple((-weights[1]).tolist())
    return Point(firsts[0], here, other=firsts[1], other_weights=there)


def _mass_solutions(
    models: Sequence[Model], joined: Model, values: Array, starts: Sequence[int]
) -> Array:
    """M^-1 b of all held points, shape (points, n); the mass matrix consists of the branches'."""
    out = np.empty_like(values)
    twisting = np.array([point.twist for point in joined.holding.points], dtype=bool)
    for model, begin in zip(models, starts, strict=False):
        here = slice(begin, begin + model.n)
        for twist in range(1 + joined.twist):
            rows = twisting == twist
            out[rows, here] = model.mass_solutions(values[rows, here], twist)
    return out
