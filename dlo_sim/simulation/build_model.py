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
from dlo_sim.simulation.arrays import Counts, line_view, new_shape, to_blocks
from dlo_sim.simulation.external_damping import row_matrices, row_rates
from dlo_sim.simulation.geometry import Geometries, stiffening
from dlo_sim.simulation.holding import Holding, holding_of
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def build_model(
    scene: Scene,
    needs: Needs,
    geometries: Geometries,
    graded: tuple[float, float] | None = None,
) -> Model:
    """Constant arrays of a scene held where `geometries` says, with knots graded as the scene
    says, or as `bspline.clamped_knots` takes it.
    """
    n, axes, twist = scene.discretization.control_points, needs.axes, needs.twist
    graded = grading(scene) if graded is None else graded
    knots = bspline.clamped_knots(n, scene.cable.length, graded)
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
    values = np.zeros(sizes["model"])
    model = Model(shape, values, sizes, counts, knots, rule, axes, twist, holding, rest)
    _Filling(scene, needs, model, geometries).fill()
    return model


STATIC = 1e-9  # of the polar inertia of a cable whose twist is quasistatic
GRADING = 0.4  # of spans at clamped ends; 0.6 helps at 9 control points and hurts at 17
SELECTIVE = 3e-3  # of mu h^6 integral b''' b'''


def grading(scene: Scene) -> tuple[float, float]:
    """Grading of the knots towards the clamped ends (`bspline.clamped_knots`).

    A cable under tension T bends at a clamp within sqrt(EI / T). Where that is shorter than a
    uniform span, for T of half the weight, shorter spans there resolve it better.
    """
    choice, cable = scene.discretization, scene.cable
    if choice.knots == "uniform":
        return 0.0, 0.0
    tension = 0.5 * cable.mu * cable.length * float(np.linalg.norm(scene.gravity))
    span = cable.length / (choice.control_points - bspline.DEGREE)
    if cable.EI >= tension * span**2:
        return 0.0, 0.0
    start, end = (GRADING * end.clamped for end in scene.ends.values())
    return start, end


def _terms(scene: Scene, needs: Needs, curved: bool) -> int:
    by_span = scene.discretization.stretch_by_span
    present = {
        layout.STRETCH: needs.stretch and not by_span,
        layout.SPAN_STRETCH: needs.stretch and by_span,
        layout.BEND: needs.bend,
        layout.CURVED: curved,
        layout.TWISTED: needs.twist,
        layout.TORSION: needs.frenet,
        layout.PLASTICITY: needs.plasticity,
        layout.GRAVITY: needs.gravity,
        layout.DAMPED: needs.damping,
        layout.BISHOP: needs.bishop,
        layout.CONTACT: needs.contact,
        layout.STATIC_TWIST: scene.terms.twist == "quasistatic",
        layout.DRAG: scene.drag_across > 0.0,
        layout.THINNED: needs.bend and scene.damping.thinning * scene.damping.internal[1] > 0.0,
        layout.MATERIAL: curved and needs.bishop and not needs.plasticity,
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
    """Writes the values of a model."""

    def __init__(self, scene: Scene, needs: Needs, model: Model, geometries: Geometries) -> None:
        self._scene, self._needs, self._model = scene, needs, model
        self._geometries = geometries
        self._dim = len(model.axes)

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
            inertia *= STATIC  # not 0, which could not be inverted
        bands = [space] * self._dim + [inertia * gram] * model.twist
        self._masses(bands)
        if self._needs.gravity:
            pull = np.asarray(scene.gravity)[list(model.axes)]
            self._lines(layout.WEIGHT, self._dim)[:] = np.outer(
                pull, mass.multiply(space, np.ones(model.n))
            )
        if model.twist:
            slopes = mass.gram(model.knots, 1, model.rule)
            self._matrix(layout.TWIST, 0, scene.cable.GJ * slopes)
            if self._needs.bishop:
                self._factors(layout.FRAME_FACTORS, 0, slopes, np.arange(model.n) == 0)
                shares = bspline.greville(model.knots) / model.knots[-1]
                self._lines(layout.FRAME_FACTORS, 1, 7)[:] = shares
        if self._needs.damping:
            self._damping(np.stack(bands), gram)
        self._held(bands)
        if inextensible(scene):
            gram = constraint_gram(model.knots)
            at = int(model.shape[CONSTRAINTS])
            model.values[at : at + gram.size] = gram.ravel()
        self._loads()
        self._scales()
        if self._needs.contact:
            self._planes()

    def _lines(self, offset: int, count: int, skip: int = 0) -> Array:
        shape = self._model.shape
        at = int(shape[offset] + skip * shape[layout.LINE])
        return line_view(shape, self._model.values, at, count)

    def _rows(self, offset: int, count: int) -> Array:
        return self._model.rows(self._model.values, offset, count)

    def _matrix(self, offset: int, kind: int, band: Array) -> None:
        """A symmetric band matrix as seven lines."""
        seven = self._lines(offset, 7, 7 * kind)
        seven[3] = band[0]
        for k in range(1, 4):
            seven[3 + k, : -k or None] = band[k, : -k or None]
            seven[3 - k, k:] = band[k, : -k or None]

    def _mesh(self) -> None:
        scene, model, shape = self._scene, self._model, self._model.shape
        breaks = bspline.breaks(model.knots)
        lengths = np.diff(breaks)
        spans, samples = len(lengths), int(shape[layout.SAMPLES])
        height = layout.HEAD + layout.SAMPLE * samples
        table = np.zeros((int(shape[layout.BLOCKS]) * LANES, height))
        table[:, layout.PADDING] = 1.0
        polynomials = bspline.span_polynomials(model.knots)
        slope = (2.0 / lengths)[:, None, None]
        derivative = polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0]) * slope
        here = table[:spans]
        here[:, :12] = derivative.reshape(spans, 12)
        here[:, layout.PADDING] = 0.0
        here[:, layout.VALUES : layout.VALUES + 4] = polynomials[:, :, 0]
        table[:, layout.SLOPE] = 2.0 / lengths[0]
        here[:, layout.SLOPE] = 2.0 / lengths
        here[:, layout.SHARE] = 1.0 / lengths
        here[[0, -1], layout.LINEAR] = 3.0
        table[:, layout.AXIAL] = scene.cable.EA
        table[:, layout.BENDING] = scene.cable.EI
        here[:, layout.BENDING] *= stiffening(scene, self._geometries, breaks)
        here[:, layout.HEAD + layout.XI :: layout.SAMPLE] = model.rule.xi
        here[:, layout.HEAD + layout.QUADRATURE :: layout.SAMPLE] = model.rule.weights
        at = int(shape[layout.MESH])
        model.values[at : at + table.size] = to_blocks(table)

    def _planes(self) -> None:
        """The cable keeps its radius away from every plane."""
        scene, model = self._scene, self._model
        rows = self._rows(layout.PLANE, len(scene.obstacles) * layout.PLANE_ROWS)
        for k, plane in enumerate(scene.obstacles):
            row = rows[k * layout.PLANE_ROWS :]
            normal = np.array(plane.normal)
            row[: self._dim] = normal[list(model.axes), None]
            row[3] = normal @ (plane.position - model.rest) + 0.5 * scene.cable.diameter

    def _masses(self, bands: list[Array]) -> None:
        for line in {0, len(bands) - 1} if self._model.twist else {0}:
            kind, band = int(line >= self._dim), bands[line]
            self._matrix(layout.MASS, kind, band)
            self._factors(layout.FACTORS, kind, band, np.zeros(self._model.n, dtype=bool))

    def _factors(self, offset: int, kind: int, band: Array, held: NDArray[np.bool_]) -> None:
        """L D L^T of a symmetric band matrix as seven lines."""
        lower, inverse = mass.factorize(band, held)
        seven = self._lines(offset, 7, 7 * kind)
        seven[3] = inverse
        for k in range(1, 4):
            seven[3 - k] = lower[k - 1]
            seven[3 + k, :-k] = lower[k - 1, k:]

    def _damping(self, bands: Array, gram: Array) -> None:
        scene, model = self._scene, self._model
        matrices = row_matrices(scene, bands, gram, self._dim)
        self._matrix(layout.VISCOUS, 0, matrices[0])
        if model.twist:
            self._matrix(layout.VISCOUS, 1, matrices[-1])
        self._rows(layout.BETA, 3)[:] = np.array(scene.damping.internal)[:, None]
        rates = row_rates(scene, self._dim, len(bands))
        self._rows(layout.DECAY, len(bands))[:] = rates[:, None]

    def _held(self, bands: list[Array]) -> None:
        holding, n = self._model.holding, self._model.n
        count = len(holding.points)
        weights = self._rows(layout.HELD_WEIGHTS, count * layout.POINT_ROWS)
        shifts = self._lines(layout.HELD_SHIFT, count)
        vectors = np.zeros((count, n))
        for p, point in enumerate(holding.points):
            vectors[p, point.first : point.first + 4] = point.weights
            rows = weights[p * layout.POINT_ROWS :]
            rows[:4] = np.array(point.weights)[:, None]
            rows[4] = sum(point.weights)
            shifts[p] = np.linalg.solve(
                mass.dense(bands[-1] if point.twist else bands[0]), vectors[p]
            )
        products = vectors @ shifts.T
        self._rows(layout.HELD_PRODUCT, count * count)[:] = products.reshape(-1, 1)
        bodies = self._rows(layout.HELD_BODY, len(holding.rows) * layout.DIRECTION_ROWS)
        for k, row in enumerate(holding.rows):
            bodies[k * layout.DIRECTION_ROWS :][:3] = np.array(row.body)[:, None]
        springs = self._rows(layout.SPRING, len(holding.springs) * layout.SPRING_ROWS)
        for k, spring in enumerate(holding.springs):
            rows = springs[k * layout.SPRING_ROWS :]
            rows[:4] = np.array(spring.point.weights)[:, None]
            rows[4], rows[5] = spring.stiffness, not spring.tangent
            _, xi, _ = bspline.locate(self._model.knots, np.array([spring.u]))
            rows[6] = xi

    def _loads(self) -> None:
        model = self._model
        count = int(model.shape[layout.LOADS])
        u = np.array([load.position for load in self._scene.loads[:count]])
        first, basis = bspline.active_basis(model.knots, u * self._scene.cable.length)
        _, slope = bspline.active_basis(model.knots, u * self._scene.cable.length, 1)
        lines = self._lines(layout.LOAD_BASIS, count)
        points = self._rows(layout.LOAD_POINT, count * layout.LOAD_POINT_ROWS)
        for k in range(count):
            lines[k, first[k] : first[k] + 4] = basis[k]
            rows = points[k * layout.LOAD_POINT_ROWS :]
            rows[:4], rows[4:8] = basis[k][:, None], slope[k][:, None]

    def _scales(self) -> None:
        scene, needs = self._scene, self._needs
        cable, share = scene.cable, scene.plasticity.hardening
        values = {
            layout.STIFFNESS_GJ: cable.GJ,
            layout.TORSION_FLOOR: scene.curvature_floor**2,
            layout.YIELD_MOMENT: cable.EI * scene.plasticity.yield_curvature,
            # H = EI h / (1 - h) gives the tangent stiffness h EI
            layout.HARDENING: cable.EI * share / (1.0 - share),
            layout.SPAN_LENGTH: float(np.diff(bspline.breaks(self._model.knots)).min()),
            layout.ROUND_OFF_AXIAL: cable.EA * cable.length * needs.stretch,
            layout.ROUND_OFF_BENDING: cable.EI * cable.length * needs.bend,
            layout.CONTACT_STIFFNESS: self._scene.contact_stiffness,
            layout.DRAG_ACROSS: scene.drag_across,
            layout.THINNING: scene.damping.thinning**2,
        }
        rows = self._rows(layout.SCALES, layout.SCALE_ROWS)
        for row, value in values.items():
            rows[row] = value
