"""A scene turned into the constant arrays of its compiled step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, mass, quadrature
from dlo_sim.kernels import layout, span_stretch
from dlo_sim.kernels.instant import STIFFNESS_TERMS
from dlo_sim.kernels.observe import ACCOUNT_TERMS
from dlo_sim.kernels.static import STATIC_TERMS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, inextensible
from dlo_sim.simulation import optional_terms
from dlo_sim.simulation.external_damping import row_matrices, row_rates
from dlo_sim.simulation.geometry import ENDS, EndGeometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Model:
    """Constant arrays of a scene.

    Attributes:
        knots: clamped knot vector, shape (n + 4,).
        terms: what the kernels read; its spring anchors and drive rows follow the ends.
        friction: linear damping, None where there is none; viscosity: beta [s] or None.
        mass_band: mass without prescribed rows taken out, per row.
        width: padded number of columns of position arrays.
        rest: where a straight point of the plane is, shape (3,): the constant coordinate of planar
            motion, zero elsewhere.
    """

    knots: Array
    terms: layout.Terms
    friction: layout.Friction | None
    viscosity: float | None
    width: int
    rest: Array

    @cached_property
    def account_terms(self) -> layout.Terms:
        """What `start_account` reads."""
        return self.terms.only(*ACCOUNT_TERMS)

    @cached_property
    def static_terms(self) -> layout.Terms:
        """What `static_force` reads."""
        return self.terms.only(*STATIC_TERMS)

    @cached_property
    def stiffness_terms(self) -> layout.Terms:
        """What `stiffness_band` reads."""
        return self.terms.only(*STIFFNESS_TERMS)

    @property
    def axes(self) -> tuple[int, ...]:
        """World axis of every spatial row."""
        return self.terms.axes

    @property
    def n(self) -> int:
        """Number of control points."""
        return self.terms.lattice.n

    @property
    def rows(self) -> int:
        """Rows of position arrays: the spatial axes, and twist where there is any."""
        return self.terms.mass.free.shape[0]

    @property
    def twist_row(self) -> int | None:
        """Row of the twist angle, None without twist."""
        return len(self.axes) if self.terms.twist is not None else None

    def to_columns(self, rows: Array, rest: bool = True) -> Array:
        """Rows (..., rows, >= n) as control points (..., n, 4): x, y, z, theta; absent ones
        constant.

        `rest` fills in the constant coordinate of planar motion (leave it out for velocities).
        """
        out = np.zeros((*rows.shape[:-2], self.n, 4))
        if rest:
            out[..., :3] = self.rest
        for row, column in enumerate(self.columns):
            out[..., column] = rows[..., row, : self.n]
        return out

    def to_rows(self, columns: Array) -> Array:
        """Control points (n, 4) as rows (rows, n)."""
        return np.ascontiguousarray(columns[:, list(self.columns)].T)

    def own_columns(self, what: str, value: ArrayLike, rest: bool = True) -> Array:
        """Control points (n, 4) that somebody gives, or with `rest` false their velocities.

        Raises:
            TypeError: not numbers. ValueError: another shape, not finite, or out of the coordinates
                of the scene's step.
        """
        columns = arguments.numbers(what, value, (self.n, 4))
        own = self.to_columns(self.to_rows(columns), rest)
        if not np.allclose(own, columns, rtol=0.0, atol=1e-12):
            raise ValueError(
                f"{what}: leave the coordinates of the step, {self.columns} of x, y, z, theta; "
                f"set terms.out_of_plane or terms.twist to on"
            )
        return columns

    @property
    def columns(self) -> tuple[int, ...]:
        """Column of x, y, z, theta that each row holds."""
        return self.axes if self.terms.twist is None else (*self.axes, 3)


def build_model(scene: Scene, needs: Needs, ends: Mapping[str, EndGeometry]) -> Model:
    """Constant arrays of a scene whose ends are where `ends` says."""
    n = scene.discretization.control_points
    knots = bspline.clamped_knots(n, scene.cable.length)
    rule = _quadrature(scene, n - bspline.DEGREE)
    lattice = _lattice(knots, rule)
    width = lattice.extraction.shape[0] * layout.LANES + bspline.DEGREE
    axes = needs.axes
    free = _free(scene, n, axes, needs.twist)
    gram = _mass_gram(scene, knots)
    bands = _mass_bands(scene, gram, len(axes), needs.twist)
    mass_terms = _mass(bands, free)
    by_span = scene.discretization.stretch == "span"
    terms = layout.Terms(
        lattice=lattice,
        mass=mass_terms,
        stretch=layout.Stretch(scene.cable.EA) if needs.stretch and not by_span else None,
        span_stretch=_span_stretch(scene, lattice) if needs.stretch and by_span else None,
        bend=layout.Bend(scene.cable.EI) if needs.bend else None,
        rest=_rest_curvature(scene, lattice, axes) if needs.bend else None,
        twist=_twist(scene, knots, rule) if needs.twist else None,
        frenet=optional_terms.frenet_term(scene, lattice) if needs.frenet else None,
        plastic=optional_terms.plastic_term(scene, lattice) if needs.plasticity else None,
        gravity=_gravity(scene, bands[0], n, axes) if needs.gravity else None,
        springs=_springs(scene, ends, needs) if needs.springs else None,
        loads=_loads(scene, knots, axes) if needs.loads else None,
        drive=_drive(bands, free, width) if needs.drive else None,
        decay=row_rates(scene, len(axes), len(bands)) if needs.damping else None,
        axes=axes,
    )
    friction, viscosity = _friction(scene, gram, bands, needs)
    rest = np.array(ends["start"].attachment)
    rest[list(axes)] = 0.0
    return Model(knots, terms, friction, viscosity, width, rest)


def _span_stretch(scene: Scene, lattice: layout.Lattice) -> layout.SpanStretch:
    linear = np.zeros((lattice.n - bspline.DEGREE, 1))
    linear[[0, -1]] = 3.0
    return layout.SpanStretch(
        stiffness=scene.cable.EA,
        share=0.5 * lattice.slope,
        linear=np.ascontiguousarray(_by_lanes(linear, lattice.xi.shape[0])[:, 0]),
        sums=np.zeros(span_stretch.ROWS * layout.LANES),
    )


def _quadrature(scene: Scene, n_spans: int) -> quadrature.Quadrature:
    choice = scene.discretization
    if choice.quadrature == "uniform":
        return quadrature.uniform(n_spans, scene.cable.length, choice.samples)
    return quadrature.gauss(n_spans, scene.cable.length, choice.samples)


def _lattice(knots: Array, rule: quadrature.Quadrature) -> layout.Lattice:
    polynomials = bspline.span_polynomials(knots)
    n_spans = len(polynomials)
    slope = 2.0 * n_spans / knots[-1]
    blocks = -(-n_spans // layout.LANES)
    derivative = polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0]) * slope
    extraction = _by_lanes(derivative.reshape(n_spans, -1), blocks)
    return layout.Lattice(
        xi=_by_lanes(rule.xi, blocks),
        weights=_by_lanes(rule.weights, blocks),
        extraction=extraction,
        padding=1.0 - _by_lanes(np.ones((n_spans, 1)), blocks)[:, 0],
        slope=float(slope),
        n=n_spans + bspline.DEGREE,
    )


def _by_lanes(per_span: Array, blocks: int) -> Array:
    """(n_spans, rows) -> (blocks, rows, LANES), padded with zeros."""
    padded = np.zeros((blocks * layout.LANES, per_span.shape[1]))
    padded[: len(per_span)] = per_span
    return np.ascontiguousarray(
        padded.reshape(blocks, layout.LANES, per_span.shape[1]).transpose(0, 2, 1)
    )


def _free(scene: Scene, n: int, axes: tuple[int, ...], twist: bool) -> Array:
    """1 where a DOF is solved for. A clamp holds the end's tangent and twist as well."""
    free = np.ones((len(axes) + twist, n))
    for name, outer, inner in (("start", 0, 1), ("end", n - 1, n - 2)):
        end = scene.ends[name]
        for row, axis in enumerate(axes):
            if end.fixed[axis]:
                free[row, outer] = 0.0
            if end.clamped:
                free[row, inner] = 0.0
        if twist and end.clamped:
            free[len(axes), outer] = 0.0
    return free


def _mass_gram(scene: Scene, knots: Array) -> Array:
    """The Gram matrix of which mass and drag are multiples, shape (4, n)."""
    gram = mass.gram(knots)
    return mass.lumped(gram) if scene.discretization.mass == "lumped" else gram


def _mass_bands(scene: Scene, gram: Array, dim: int, twist: bool) -> Array:
    """Mass of every row, shape (rows, 4, n): mu times the Gram matrix, plus the end masses."""
    line = scene.cable.mu * gram
    line[0, 0] += scene.start.mass
    line[0, -1] += scene.end.mass
    bands = [line] * dim
    if twist:
        bands.append(scene.cable.polar_inertia * gram)
    return np.ascontiguousarray(np.stack(bands))


def _mass(bands: Array, free: Array) -> layout.Mass:
    factors = [mass.factorize(band, row == 0.0) for band, row in zip(bands, free, strict=True)]
    return layout.Mass(
        band=bands,
        lower=np.ascontiguousarray(np.stack([lower for lower, _ in factors])),
        inverse_diagonal=np.ascontiguousarray(np.stack([inverse for _, inverse in factors])),
        free=free,
    )


def _rest_curvature(
    scene: Scene, lattice: layout.Lattice, axes: tuple[int, ...]
) -> layout.RestCurvature | None:
    values = np.asarray(scene.cable.rest_curvature, dtype=float)
    if not values.any():
        return None
    n_spans = lattice.n - bspline.DEGREE
    blocks = lattice.xi.shape[0]
    span = np.arange(blocks * layout.LANES).reshape(blocks, 1, layout.LANES)
    share = np.clip((span + 0.5 * (lattice.xi + 1.0)) / n_spans, 0.0, 1.0)
    curvature = np.interp(share, np.linspace(0.0, 1.0, len(values)), values)
    axis = np.array(scene.cable.rest_curvature_axis, dtype=float)
    moment = scene.cable.EI * curvature * lattice.weights
    axis = local_axis(axis / np.linalg.norm(axis), axes)
    return layout.RestCurvature(np.ascontiguousarray(moment), axis)


def local_axis(axis: Array, axes: tuple[int, ...]) -> Array:
    """An axis of rotation in the coordinates of the rows.

    In planar motion the third component is the one about the normal e_a x e_b of the two rows.
    """
    if len(axes) == 3:
        return axis
    normal = np.cross(np.eye(3)[axes[0]], np.eye(3)[axes[1]])
    return np.array([0.0, 0.0, axis @ normal])


def _twist(scene: Scene, knots: Array, rule: quadrature.Quadrature) -> layout.Twist:
    return layout.Twist(scene.cable.GJ * mass.gram(knots, 1, rule))


def _gravity(scene: Scene, band: Array, n: int, axes: tuple[int, ...]) -> Array:
    """Generalised weight of cable and end masses: M applied to a uniform field."""
    return np.outer(np.asarray(scene.gravity)[list(axes)], mass.multiply(band, np.ones(n)))


def _springs(scene: Scene, ends: Mapping[str, EndGeometry], needs: Needs) -> layout.Springs:
    stiffness = np.array([scene.ends[name].spring for name in ENDS], dtype=float)
    anchor = np.array([ends[name].attachment for name in ENDS], dtype=float)
    if inextensible(scene) and scene.cable.EA > 0.0:
        # An inextensible cable hands its own compliance along the line to its two end springs.
        line = anchor[1] - anchor[0]
        share = (line / max(float(np.linalg.norm(line)), 1e-300)) ** 2
        compliance = 0.5 * share * scene.cable.length / scene.cable.EA
        stiffness = stiffness / (1.0 + stiffness * compliance)
    rows = list(needs.axes)
    return layout.Springs(stiffness[:, rows].copy(), anchor[:, rows].copy())


def _loads(scene: Scene, knots: Array, axes: tuple[int, ...]) -> layout.Loads:
    u = np.array([load.position for load in scene.loads]) * scene.cable.length
    first, basis = bspline.active_basis(knots, u)
    _, slope = bspline.active_basis(knots, u, 1)
    signal = np.array([load.signal != "none" for load in scene.loads], dtype=float)
    force = np.array([load.force for load in scene.loads], dtype=float)
    torque = np.array([load.torque for load in scene.loads], dtype=float)
    sine = np.array([load.signal == "sine" for load in scene.loads])
    frequency = np.array([load.frequency for load in scene.loads], dtype=float)
    return layout.Loads(
        first=first,
        basis=basis,
        slope=slope,
        force=(force * signal[:, None])[:, list(axes)].copy(),
        torque=torque * signal[:, None],
        frequency=np.where(sine, frequency, 0.0),
    )


def _drive(bands: Array, free: Array, width: int) -> layout.Drive:
    rows, n = free.shape
    shift = np.zeros((rows, 4, width))
    for d in range(rows):
        matrix = mass.dense(bands[d])
        unknown = free[d] != 0.0
        for j, column in enumerate((0, 1, n - 2, n - 1)):
            if not unknown[column]:
                shift[d, j, :n][unknown] = np.linalg.solve(
                    matrix[np.ix_(unknown, unknown)], matrix[unknown, column]
                )
    return layout.Drive(np.zeros((2, 39)), shift)


def _friction(
    scene: Scene, gram: Array, bands: Array, needs: Needs
) -> tuple[layout.Friction | None, float | None]:
    if not needs.damping:
        return None, None
    beta = scene.damping.stiffness
    matrices = row_matrices(scene, bands, gram, len(needs.axes))
    return layout.Friction(matrices, beta), beta or None
