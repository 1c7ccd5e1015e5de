"""A scene turned into the constant arrays of its cable (`engine.layout`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline, mass, quadrature
from dlo_sim.core.constant_length import constraint_gram
from dlo_sim.engine import layout
from dlo_sim.methods.explicit_layout import CONSTRAINTS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, inextensible
from dlo_sim.simulation.arrays import (
    Counts,
    aligned_zeros,
    line_view,
    new_shape,
    rooms,
    to_blocks,
)
from dlo_sim.simulation.external_damping import external_rates
from dlo_sim.simulation.geometry import Geometries, stiffening
from dlo_sim.simulation.holding import Holding, holding_of
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.resolution import knot_grading

Array = NDArray[np.float64]


def build_model(
    scene: Scene,
    needs: Needs,
    geometries: Geometries,
    origin: NDArray[np.float64] | None = None,
) -> Model:
    """Constant arrays of a scene held where `geometries` says.

    Args:
        scene: `resolution.resolved`.
        origin: that of the geometries in the world [m], default zero.
    """
    n, axes, twist = scene.discretization.control_points, needs.axes, needs.twist
    knots = bspline.clamped_knots(n, scene.cable.length, knot_grading(scene))
    rule = _quadrature(scene, knots)
    holding = holding_of(scene, geometries, knots, axes, twist)
    curved = needs.bend and (needs.plasticity or scene.cable.shaped)
    counts = Counts(
        terms=_terms(scene, needs, curved),
        dim=len(axes),
        lines=len(axes) + twist,
        n=n,
        samples=rule.xi.shape[1],
        points=len(holding.points),
        held=len(holding.rows),
        springs=len(holding.springs),
        grasps=len(geometries),
        loads=len(scene.loads) if needs.loads else 0,
        planes=len(scene.obstacles) * needs.contact,
        border=holding.border,
        constraints=n - 1 if inextensible(scene) else 0,
    )
    shape, sizes = new_shape(counts, axes, _tables(scene, holding, knots, counts.loads))
    rest = np.array(geometries["start"].attachment)
    rest[list(axes)] = 0.0
    bending = scene.cable.EI * stiffening(scene, geometries, bspline.breaks(knots))
    arrays = shape, aligned_zeros(sizes["model"]), sizes, counts
    origin = np.zeros(3) if origin is None else origin
    model = Model(*arrays, knots, rule, axes, twist, holding, scene.cable.EA, bending, rest, origin)
    _Filling(scene, needs, model).fill()
    return model


# Share of the polar inertia that a cable with quasistatic twist keeps, because it could not be
# inverted without: too little to matter in the energy account; more where nothing holds the roll.
STATIC, FREE_STATIC = 1e-24, 1e-9
SELECTIVE = 3e-3  # of mu h^6 integral b''' b'''


def _terms(scene: Scene, needs: Needs, curved: bool) -> int:
    by_span = scene.discretization.stretch_by_span
    present = {
        layout.STRETCH: needs.stretch and not by_span,
        layout.SPAN_STRETCH: needs.stretch and by_span,
        layout.GUARDED: needs.stretch,
        layout.BEND: needs.bend,
        layout.CURVED: curved,
        layout.TWISTED: needs.twist,
        layout.TORSION: needs.frenet,
        layout.PLASTICITY: needs.plasticity,
        layout.GRAVITY: needs.gravity,
        layout.DAMPED: needs.damping,
        layout.BISHOP: needs.bishop,
        layout.CONTACT: needs.contact,
        layout.STATIC_TWIST: needs.quasistatic,
        layout.DRAG: scene.drag_across > 0.0,
        layout.THINNED: needs.bend and scene.damping.thinning * scene.damping.internal[1] > 0.0,
        layout.MATERIAL: curved and needs.bishop,
    }
    return sum(bit for bit, there in present.items() if there)


FEWEST_WITH_ENDS = 3  # Gauss points a span from which one may move to an end without harm


def _quadrature(scene: Scene, knots: Array) -> quadrature.Quadrature:
    """The scene's rule. Stretching by span has a sample at a clamp: without one nothing keeps r'
    there from turning over, as the length of the first span is free.
    """
    choice, breaks = scene.discretization, bspline.breaks(knots)
    if choice.quadrature == "uniform":
        return quadrature.uniform(breaks, choice.samples)
    rule = quadrature.gauss(breaks, choice.samples)
    if choice.stretch_by_span and choice.samples >= FEWEST_WITH_ENDS:
        return quadrature.with_ends(rule, (scene.start.clamped, scene.end.clamped))
    return rule


def _tables(
    scene: Scene, holding: Holding, knots: Array, loads: int
) -> dict[int, list[tuple[int, ...]]]:
    u = np.array([load.position for load in scene.loads[:loads]]) * scene.cable.length
    return {
        layout.POINT_TABLE: [(p.first, int(p.twist), p.own) for p in holding.points],
        layout.ROW_TABLE: [(row.point, row.grasp, row.line) for row in holding.rows],
        layout.SPRING_TABLE: [(s.point.first, s.grasp, s.line) for s in holding.springs],
        layout.LOAD_TABLE: [(int(first),) for first in bspline.locate(knots, u)[0]],
    }


class _Filling:
    """Writes the values of a model. Matrices of kind 0 are those of a spatial line, of kind 1 those
    of the line of the twist.
    """

    def __init__(self, scene: Scene, needs: Needs, model: Model) -> None:
        self._scene, self._needs, self._model = scene, needs, model
        self._axes = list(model.axes)
        self._sizes = rooms(model.counts)["model"]

    def fill(self) -> None:
        scene, model = self._scene, self._model
        self._mesh()
        gram = mass.gram(model.knots)
        if scene.discretization.mass == "lumped":
            gram = mass.lumped(gram)
        if scene.discretization.mass == "selective":
            # Selective mass scaling: the third derivative is what a span knows least of.
            lengths = np.diff(bspline.breaks(model.knots))
            gram = gram + SELECTIVE * mass.gram(model.knots, 3, scale=lengths**6)
        space = scene.cable.mu * gram
        space[0, 0] += scene.start.mass
        space[0, -1] += scene.end.mass
        inertia = scene.cable.polar_inertia
        if model.has(layout.STATIC_TWIST):
            free = not any(point.twist for point in model.holding.points)
            sprung = any(spring.point.twist for spring in model.holding.springs)
            inertia *= FREE_STATIC if free and not sprung else STATIC
        masses = [space] + [inertia * gram] * model.twist
        for kind, band in enumerate(masses):
            self._matrix(layout.MASS, kind, band)
            self._factors(layout.FACTORS, kind, band, np.zeros(model.n, dtype=bool))
        if self._needs.gravity:
            pull = np.asarray(scene.gravity)[self._axes]
            weight = mass.multiply(space, np.ones(model.n))
            self._lines(layout.WEIGHT)[:] = np.outer(pull, weight)
        if model.twist:
            slopes = mass.gram(model.knots, 1, model.rule)
            self._matrix(layout.TWIST, 0, scene.cable.GJ * slopes)
            if self._needs.bishop:
                self._factors(layout.FRAME_FACTORS, 0, slopes, np.arange(model.n) == 0)
                shares = bspline.greville(model.knots) / model.knots[-1]
                self._lines(layout.FRAME_FACTORS)[7] = shares
        if self._needs.damping:
            self._damping(masses, gram)
        self._held(masses)
        self._springs()
        if inextensible(scene):
            self._room(CONSTRAINTS)[:] = constraint_gram(model.knots).ravel()
        self._loads()
        self._scales()
        if self._needs.contact:
            self._planes()

    def _room(self, offset: int) -> Array:
        at = int(self._model.shape[offset])
        return self._model.values[at : at + self._sizes[offset]]

    def _lines(self, offset: int) -> Array:
        """Lines without margins, shape (lines, n)."""
        count = self._sizes[offset] // self._model.counts.line
        return line_view(self._model.shape, self._room(offset), 0, count)

    def _rows(self, offset: int, height: int) -> Array:
        """Rows of everything there, shape (things, height, LANES)."""
        return self._room(offset).reshape(-1, height, LANES)

    def _matrix(self, offset: int, kind: int, band: Array) -> None:
        """A symmetric band matrix as seven lines."""
        seven = self._lines(offset)[7 * kind :]
        seven[3] = band[0]
        for k in range(1, 4):
            seven[3 + k, :-k] = seven[3 - k, k:] = band[k, :-k]

    def _factors(self, offset: int, kind: int, band: Array, held: NDArray[np.bool_]) -> None:
        """L D L^T of a symmetric band matrix as seven lines."""
        lower, inverse = mass.factorize(band, held)
        seven = self._lines(offset)[7 * kind :]
        seven[3] = inverse
        for k in range(1, 4):
            seven[3 - k] = lower[k - 1]
            seven[3 + k, :-k] = lower[k - 1, k:]

    def _mesh(self) -> None:
        scene, model, counts = self._scene, self._model, self._model.counts
        breaks = bspline.breaks(model.knots)
        lengths = np.diff(breaks)
        table = np.zeros((counts.blocks * LANES, layout.HEAD + layout.SAMPLE * counts.samples))
        here, beyond = table[: len(lengths)], table[len(lengths) :]
        polynomials = bspline.span_polynomials(model.knots)
        slope = 2.0 / lengths
        derivative = polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0]) * slope[:, None, None]
        here[:, :12] = derivative.reshape(-1, 12)
        beyond[:, layout.PADDING] = 1.0
        here[:, layout.VALUES : layout.VALUES + 4] = polynomials[:, :, 0]
        here[:, layout.SLOPE], beyond[:, layout.SLOPE] = slope, slope[0]
        here[:, layout.SHARE] = 1.0 / lengths
        here[[0, -1], layout.LINEAR] = 3.0
        table[:, layout.AXIAL] = scene.cable.EA
        table[:, layout.BENDING] = scene.cable.EI
        here[:, layout.BENDING] = model.bending_stiffness
        here[:, layout.HEAD + layout.XI :: layout.SAMPLE] = model.rule.xi
        here[:, layout.HEAD + layout.QUADRATURE :: layout.SAMPLE] = model.rule.weights
        self._room(layout.MESH)[:] = to_blocks(table)

    def _planes(self) -> None:
        """The cable keeps its radius away from every plane."""
        rows = self._rows(layout.PLANE, layout.PLANE_ROWS)
        for row, plane in zip(rows, self._scene.obstacles, strict=True):
            normal = np.array(plane.normal)
            row[: len(self._axes)] = normal[self._axes, None]
            way = plane.position - self._model.origin - self._model.rest
            row[3] = normal @ way + 0.5 * self._scene.cable.diameter

    def _damping(self, masses: list[Array], gram: Array) -> None:
        """alpha M + c G, with the Gram matrix G that the mass of the cable is made of, without
        point masses, and c = 0 for the twist.

        The rates of every line are for the explicit methods and rattle, which take no drag beside a
        point mass: drag and mass have the same shape there.
        """
        scene = self._scene
        centerline, alpha = external_rates(scene)
        drag = (centerline - alpha) * scene.cable.mu * gram
        for kind, band in enumerate(masses):
            self._matrix(layout.VISCOUS, kind, alpha * band + (0.0 if kind else drag))
        self._rows(layout.BETA, 3)[0] = np.array(scene.damping.internal)[:, None]
        decay = self._rows(layout.DECAY, 1)
        decay[: len(self._axes)] = centerline
        decay[len(self._axes) :] = alpha

    def _held(self, masses: list[Array]) -> None:
        points, n = self._model.holding.points, self._model.n
        weights = self._rows(layout.HELD_WEIGHTS, layout.POINT_ROWS)
        vectors, shifts = np.zeros((len(points), n)), self._lines(layout.HELD_SHIFT)
        for p, point in enumerate(points):
            vectors[p, point.first : point.first + 4] = point.weights
            weights[p, :4] = np.array(point.weights)[:, None]
            weights[p, 4] = sum(point.weights)
            shifts[p] = np.linalg.solve(mass.dense(masses[point.twist]), vectors[p])
        self._rows(layout.HELD_PRODUCT, 1)[:, 0] = (vectors @ shifts.T).reshape(-1, 1)
        bodies = self._rows(layout.HELD_BODY, layout.DIRECTION_ROWS)
        for body, row in zip(bodies, self._model.holding.rows, strict=True):
            body[:3] = np.array(row.body)[:, None]

    def _springs(self) -> None:
        rows = self._rows(layout.SPRING, layout.SPRING_ROWS)
        for row, spring in zip(rows, self._model.holding.springs, strict=True):
            row[:4] = np.array(spring.point.weights)[:, None]
            row[4], row[5] = spring.stiffness, not spring.tangent
            row[6] = bspline.locate(self._model.knots, spring.u)[1]

    def _loads(self) -> None:
        lines = self._lines(layout.LOAD_BASIS)
        points = self._rows(layout.LOAD_POINT, layout.LOAD_POINT_ROWS)
        u = np.array([load.position for load in self._scene.loads[: len(lines)]])
        u *= self._scene.cable.length
        first, basis = bspline.active_basis(self._model.knots, u)
        _, slope = bspline.active_basis(self._model.knots, u, 1)
        points[:, :4], points[:, 4:] = basis[:, :, None], slope[:, :, None]
        for line, at, values in zip(lines, first, basis, strict=True):
            line[at : at + 4] = values

    def _scales(self) -> None:
        scene, needs = self._scene, self._needs
        cable, share = scene.cable, scene.plasticity.hardening
        values = {
            layout.STIFFNESS_GJ: cable.GJ,
            layout.TORSION_FLOOR: scene.curvature_floor**2,
            layout.YIELD_MOMENT: cable.EI * scene.plasticity.yield_curvature,
            # H = EI h / (1 - h) gives the tangent stiffness h EI
            layout.HARDENING: share / (1.0 - share),
            layout.SPAN_LENGTH: float(np.diff(bspline.breaks(self._model.knots)).min()),
            layout.ROUND_OFF_AXIAL: cable.EA * cable.length * needs.stretch,
            layout.ROUND_OFF_BENDING: cable.EI * cable.length * needs.bend,
            layout.CONTACT_STIFFNESS: scene.contact_stiffness,
            layout.DRAG_ACROSS: scene.drag_across,
            layout.THINNING: scene.damping.thinning**2,
        }
        rows = self._rows(layout.SCALES, 1)
        for row, value in values.items():
            rows[row] = value
