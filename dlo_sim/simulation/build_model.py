"""A scene turned into the constant arrays of its cables (`engine.arrays`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, quadrature
from dlo_sim.engine import arrays as bits
from dlo_sim.engine.arrays import CableArrays
from dlo_sim.engine.contact import EARTH
from dlo_sim.engine.span_guard import guard_stiffness
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, inextensible
from dlo_sim.scene.refusal import refusal
from dlo_sim.scene.terms import TERMS
from dlo_sim.simulation import obstacles, self_contact
from dlo_sim.simulation.arrays import sizes_of, to_blocks, without_margins
from dlo_sim.simulation.connector_shape import thickest
from dlo_sim.simulation.geometry import Geometries, stiffening
from dlo_sim.simulation.held_rows import fill_rows
from dlo_sim.simulation.holding import Holding, holding_of
from dlo_sim.simulation.join_strands import joined
from dlo_sim.simulation.meshes import Field
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.net import cuts_of, local_geometries
from dlo_sim.simulation.obstacles import fields_of, pieces_of
from dlo_sim.simulation.resolution import knot_grading

Array = NDArray[np.float64]


def build_model(
    scene: Scene, needs: Needs, geometries: Geometries, origin: Array | None = None
) -> Model:
    """Constants of a scene held where `geometries` says.

    Args:
        scene: `resolution.resolved`.
        origin: that of the geometries in the world [m], default zero.
    """
    origin, strands = np.zeros(3) if origin is None else origin, scene.strands
    counts = _counts([strand.scene for strand in strands], needs)
    counts = counts._replace(radius=max(counts.radius, thickest(scene.connectors)))
    knots = knots_of(scene)
    models = {
        strand.name: _model(
            strand.scene,
            needs,
            local_geometries(strand, geometries),
            origin,
            counts,
            knots[strand.name],
        )
        for strand in strands
    }
    if not scene.is_net:
        return next(iter(models.values()))
    return joined(scene, needs, geometries, models, counts.radius)


def with_obstacles(model: Model, scene: Scene, needs: Needs) -> Model:
    """Constants of a scene that differs from that of `model` in its obstacles.

    Of a single cable with the same terms only those of its contact are made; it shares all others
    with `model`, so that a tick waits less for what markers say.
    """
    geometries, origin = model.geometries, model.origin
    if scene.is_net or needs != model.needs:
        return build_model(scene, needs, geometries, origin)
    counts = _counts([scene], needs)
    terms = _terms(scene, needs, counts.curved, model.holding)
    if (terms ^ model.terms) & ~obstacles.SHAPES:
        return build_model(scene, needs, geometries, origin)
    fields = fields_of(scene, counts.radius) if "contact" in needs else ()
    sizes = _sizes(scene, needs, geometries, model.holding, model.rule, counts, terms, fields)
    kept = {name: getattr(model.arrays, name) for name in CableArrays.groups if name != "contact"}
    arrays = CableArrays(sizes, **kept)
    arrays.axes[:] = model.arrays.axes
    return _with_contact(replace(model, scene=scene, arrays=arrays, fields=fields), counts)


class _Counts(NamedTuple):
    """What the strands of a scene have in common.

    Attributes:
        curved: whether any has a natural shape, or yields. pieces: `obstacles.pieces_of`.
        segments: of a span, that touch each other. radius: of the thickest [m].
    """

    curved: bool
    pieces: tuple[int, int]
    segments: int
    radius: float


def knots_of(scene: Scene) -> dict[str, Array]:
    """Knots [m] of each strand of a scene that leaves nothing open."""
    cuts = cuts_of(scene)
    return {one.name: bspline.cut(_knots(one.scene), cuts[one.name]) for one in scene.strands}


def _knots(scene: Scene) -> Array:
    number = scene.discretization.control_points
    return bspline.clamped_knots(number, scene.cable.length, knot_grading(scene))


def _counts(scenes: Sequence[Scene], needs: Needs) -> _Counts:
    shaped = any(scene.cable.shaped for scene in scenes)
    pieces, segments = [(0, 0)], [0]
    if "contact" in needs:
        pieces = [pieces_of(scene) for scene in scenes]
    if "self_contact" in needs:
        segments = [self_contact.segments_of(scene, _knots(scene)) for scene in scenes]
    closest = max(one for one, _ in pieces), max(one for _, one in pieces)
    curved = "bend" in needs and ("plasticity" in needs or shaped)
    radius = 0.5 * max(scene.cable.diameter for scene in scenes)
    return _Counts(curved, closest, max(segments), radius)


def _model(
    scene: Scene,
    needs: Needs,
    geometries: Geometries,
    origin: Array,
    counts: _Counts,
    knots: Array,
) -> Model:
    """Constants of one strand, as a scene of its own."""
    n, axes, twist = len(knots) - bspline.ACTIVE, needs.axes, "twist" in needs
    rule = _quadrature(scene, knots)
    if "bishop" in needs and np.count_nonzero(rule.weights) < n - 1:
        what = "points of a single span leave twist that costs no energy"
        cure = "give 3, or 5 control points or more"
        raise refusal("discretization.samples", scene.discretization.samples, f"{what}; {cure}")
    holding = holding_of(scene, geometries, knots, axes, twist)
    fields = fields_of(scene, counts.radius) if "contact" in needs else ()
    terms = _terms(scene, needs, counts.curved, holding)
    sizes = _sizes(scene, needs, geometries, holding, rule, counts, terms, fields)
    arrays = CableArrays(sizes, inputs=None, state=None, work=None)
    arrays.axes[: len(axes)] = axes
    arrays.chain.segments = counts.segments
    rest = np.array(geometries["start"].attachment)
    rest[list(axes)] = 0.0
    bending = scene.cable.EI * stiffening(scene, geometries, bspline.breaks(knots))
    axial = scene.cable.EA
    if inextensible(scene):  # the penalty factor of `engine.tension`
        axial = max(axial, PENALTY * (_weight(scene) + scene.cable.EI / scene.cable.length**2))
    stiffness = axial, bending
    lines = axes, twist, holding
    of = scene, needs, geometries
    model = Model(*of, arrays, knots, rule, *lines, *stiffness, rest, origin, {}, fields)
    _Filling(model).fill()
    return _with_contact(model, counts)


def _sizes(
    scene: Scene,
    needs: Needs,
    geometries: Geometries,
    holding: Holding,
    rule: quadrature.Quadrature,
    counts: _Counts,
    terms: int,
    fields: Sequence[Field],
) -> dict[str, int]:
    """Sizes of the arrays of one strand."""
    return sizes_of(
        terms=terms,
        dim=len(needs.axes),
        twist="twist" in needs,
        n=len(rule.xi) + bspline.DEGREE,
        samples=rule.xi.shape[1],
        holding=holding,
        grasps=len(geometries),
        loads=len(scene.loads) if "loads" in needs else 0,
        obstacles=len(scene.bodies) * ("contact" in needs),
        pieces=sum(counts.pieces),
        segments=counts.segments,
        field_values=sum(field.values.size for field in fields),
    )


def _with_contact(model: Model, counts: _Counts) -> Model:
    """A model with the constants of its contact, and the places of its obstacles."""
    scene, contact = model.scene, model.arrays.contact
    contact.pieces, contact.guide_pieces = counts.pieces
    if "contact" in model.needs:
        obstacles.fill(model, counts.radius)
    places = dict(zip(scene.bodies, obstacles.at_rest(scene, model.origin), strict=True))
    return replace(model, obstacles=places)


# Share of the polar inertia that a cable with quasistatic twist keeps, because it could not be
# inverted without: too little to matter in the energy account; more where nothing holds the roll.
STATIC, FREE_STATIC = 1e-24, 1e-9
WATER_PARTS = 8, 32  # of a span where the water has a surface, fewest and most
PENALTY = 1e6  # on the strain of a cable of constant length, in its weight and EI / L^2


def _by_span(scene: Scene) -> bool:
    """Whether the strain counts by span, as that of a cable of constant length always does."""
    return scene.discretization.stretch_by_span or inextensible(scene)


def _weight(scene: Scene) -> float:
    """Weight on earth of the cable and the masses at its ends [N]."""
    cable = scene.cable
    return (cable.mu * cable.length + scene.start.mass + scene.end.mass) * EARTH


def _terms(scene: Scene, needs: Needs, curved: bool, holding: Holding) -> int:
    """Bits of the terms: those of their names, and those that several parameters decide."""
    by_span, stretches = _by_span(scene), "stretch" in needs or inextensible(scene)
    # Rolling takes the rotary inertia that quasistatic twist lacks.
    rolls = scene.may_roll and "quasistatic" not in needs
    thinning = scene.damping.thinning * scene.damping.internal[1] > 0.0
    present = {
        bits.STRETCH: stretches and not by_span,
        bits.SPAN_STRETCH: stretches and by_span,
        bits.GUARDED: stretches,
        bits.CURVED: curved,
        bits.MATERIAL: curved and "bishop" in needs,
        bits.ROLLING: rolls and {"contact", "bishop"} <= set(needs.active),
        bits.DRAG: scene.drag_across > 0.0 or any(scene.water_drag),
        bits.SURFACE: scene.water_surface is not None,
        bits.THINNED: "bend" in needs and thinning,
    }
    present |= {bit: name in needs for name, bit in bits.BITS.items()}
    active = sum(bit for bit, there in present.items() if there)
    return active | obstacles.terms_of(scene) * ("contact" in needs) | holding.terms


FEWEST_WITH_ENDS = 3  # Gauss points a span from which one may move to an end without harm


def _quadrature(scene: Scene, knots: Array) -> quadrature.Quadrature:
    """The scene's rule. Stretching by span has a sample at a clamp: without one nothing keeps r'
    there from turning over, as the length of the first span is free.
    """
    choice, breaks = scene.discretization, bspline.breaks(knots)
    if choice.quadrature == "uniform":
        return quadrature.uniform(breaks, choice.samples)
    rule = quadrature.gauss(breaks, choice.samples)
    if _by_span(scene) and choice.samples >= FEWEST_WITH_ENDS:
        return quadrature.with_ends(rule, (scene.start.clamped, scene.end.clamped))
    return rule


class _Filling:
    """Writes the arrays of a model."""

    def __init__(self, model: Model) -> None:
        self._scene, self._needs, self._model = model.scene, model.needs, model
        self._arrays, self._axes = model.arrays, list(model.axes)

    def fill(self) -> None:
        scene, model, linear = self._scene, self._model, self._arrays.linear
        self._mesh()
        gram = mass.gram(model.knots)
        if scene.discretization.mass == "lumped":
            gram = mass.lumped(gram)
        space = scene.cable.mu * gram
        space[0, 0] += scene.start.mass
        space[0, -1] += scene.end.mass
        inertia = scene.cable.polar_inertia
        if model.has(bits.STATIC_TWIST):
            free = not any(point.twist for point in model.holding.points)
            inertia *= FREE_STATIC if free else STATIC
        masses = [space] + [inertia * gram] * model.twist
        for kind, band in enumerate(masses):
            self._matrix(linear.mass[kind], band)
            self._factors(linear.factors[kind], band, np.zeros(model.n, dtype=bool))
        if "gravity" in self._needs:
            pull = np.asarray(scene.gravity)[self._axes]
            displaced = scene.displaced * (scene.water_surface is None)
            weight = mass.multiply(space - displaced * gram, np.ones(model.n))
            self._inside(linear.weight)[:] = np.outer(pull, weight)
        if model.twist:
            slopes = mass.gram(model.knots, 1, model.rule)
            self._matrix(linear.twist, scene.cable.GJ * slopes)
            if "bishop" in self._needs:
                self._factors(linear.frame_factors, slopes, np.arange(model.n) == 0)
                shares = bspline.greville(model.knots) / model.knots[-1]
                self._inside(linear.greville)[:] = shares
        if "damping" in self._needs:
            self._damping(masses, gram)
        fill_rows(model)
        self._slides()
        self._loads()
        self._numbers()
        if inextensible(scene):
            physics = self._arrays.physics
            physics.keeps_length = 1.0
            physics.axial_round_off = model.axial_stiffness * scene.cable.length
            physics.beta_stretch = 0.0  # what does not stretch dissipates nothing
        if "self_contact" in self._needs:
            self_contact.fill(model)

    def _inside(self, lines: Array) -> Array:
        return without_margins(lines, self._model.n)

    def _matrix(self, seven: Array, band: Array) -> None:
        """A symmetric band matrix as seven lines."""
        seven = self._inside(seven)
        seven[3] = band[0]
        for k in range(1, 4):
            seven[3 + k, :-k] = seven[3 - k, k:] = band[k, :-k]

    def _factors(self, seven: Array, band: Array, held: NDArray[np.bool_]) -> None:
        """L D L^T of a symmetric band matrix as seven lines."""
        lower, inverse = mass.factorize(band, held)
        seven = self._inside(seven)
        seven[3] = inverse
        for k in range(1, 4):
            seven[3 - k] = lower[k - 1]
            seven[3 + k, :-k] = lower[k - 1, k:]

    def _mesh(self) -> None:
        cable, model, mesh = self._scene.cable, self._model, self._arrays.mesh
        lengths = np.diff(bspline.breaks(model.knots))
        spans, void = len(lengths), lengths == 0.0
        lengths = np.where(void, lengths.max(), lengths)
        slope = 2.0 / lengths
        polynomials = bspline.span_polynomials(model.knots)
        derivative = polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0]) * slope[:, None, None]
        linear = np.zeros(spans)
        linear[[0, -1]] = 3.0
        mesh.slopes[:] = to_blocks(derivative.reshape(spans, 12))
        mesh.values[:] = to_blocks(polynomials[:, :, 0])
        mesh.padding[:] = to_blocks(1.0 * void, beyond=1.0)
        mesh.slope[:] = to_blocks(slope, beyond=slope[0])
        mesh.share[:] = to_blocks(np.where(void, 0.0, 1.0 / lengths))
        mesh.linear[:] = to_blocks(linear)
        mesh.axial[:] = model.axial_stiffness
        stiffness, scene = (model.axial_stiffness, model.bending_stiffness), self._scene
        guarding = guard_stiffness(*stiffness, lengths, _weight(scene), _by_span(scene))
        mesh.guard[:] = to_blocks(np.where(void[:, None], 0.0, guarding))
        mesh.bending[:] = to_blocks(model.bending_stiffness, beyond=cable.EI)
        mesh.torsional[:] = cable.GJ
        mesh.strand[0], mesh.length[0] = (0, model.n), model.knots[-1]
        mesh.radius[0] = 0.5 * cable.diameter
        mesh.number[:] = to_blocks(np.zeros(spans), beyond=-1.0)
        mesh.xi[:] = to_blocks(model.rule.xi)
        mesh.weight[:] = to_blocks(model.rule.weights)

    def _damping(self, masses: list[Array], gram: Array) -> None:
        """alpha M + c G, with the Gram matrix G that the mass of the cable is made of, without
        point masses, and c = 0 for the twist.

        The rates of every line are for the explicit methods, which take no drag beside a
        point mass: drag and mass have the same shape there.
        """
        scene, linear = self._scene, self._arrays.linear
        centerline, alpha = scene.decay_rates
        drag = (centerline - alpha) * scene.cable.mu * gram
        for kind, band in enumerate(masses):
            self._matrix(linear.damping[kind], alpha * band + (0.0 if kind else drag))
        linear.decay[: len(self._axes)] = centerline
        linear.decay[len(self._axes) :] = alpha

    def _slides(self) -> None:
        slides, held = self._arrays.slides, self._model.holding.slides
        slides.count = len(held)
        slides.breaks[: self._model.n - 2] = bspline.breaks(self._model.knots)
        for k, slide in enumerate(held):
            slides.grasp[k], slides.law[k] = slide.grasp, slide.law
            slides.stops[k] = slide.stops

    def _loads(self) -> None:
        loads, knots = self._arrays.loads, self._model.knots
        loads.count = len(loads.first)
        u = np.array([load.position for load in self._scene.loads[: loads.count]])
        u *= self._scene.cable.length
        loads.first[:], loads.values[:] = bspline.active_basis(knots, u)
        loads.slopes[:] = bspline.active_basis(knots, u, 1)[1]
        for k, first in enumerate(loads.first):
            self._inside(loads.basis)[k, first : first + 4] = loads.values[k]

    def _numbers(self) -> None:
        """What the terms give to the engine."""
        physics, axes = self._arrays.physics, self._axes
        spans = np.diff(bspline.breaks(self._model.knots))
        physics.shortest_span = float(spans[spans > 0.0].min())
        for term in (term for term in TERMS if term.name in self._needs):
            for name, value in term.numbers(self._scene).items():
                if isinstance(value, tuple):
                    getattr(physics, name)[: len(axes)] = np.array(value)[axes]
                else:
                    setattr(physics, name, value)
        if self._scene.water_surface is not None:
            self._surface(*self._scene.water_surface)

    def _surface(self, up: tuple[float, ...], level: float) -> None:
        """The surface of the water, in radii of the cable."""
        scene, model, physics = self._scene, self._model, self._arrays.physics
        radius, normal = 0.5 * scene.cable.diameter, np.array(up)
        physics.water_up[: len(self._axes)] = normal[self._axes] / radius
        physics.water_level = (level - (normal * (model.origin + model.rest)).sum()) / radius
        longest = float(np.diff(bspline.breaks(model.knots)).max())
        physics.water_parts = float(np.clip(np.ceil(longest / radius), *WATER_PARTS))
        if "gravity" in self._needs:
            pull = scene.displaced * math.hypot(*scene.gravity)
            physics.buoyancy = pull * radius
