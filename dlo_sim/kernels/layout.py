"""Array layouts that the kernels share.

Knot spans are the vector lanes: spans are grouped in blocks of LANES, and every quantity of a block
is a row of LANES numbers. Lanes beyond the last span are padding with weight zero and a unit
tangent, so that they cost nothing but arithmetic and never divide by zero.

A configuration is an array of rows (lines) x control points: one row per spatial axis, and the
twist angle as a further row where the scene has twist. A planar scene has two spatial rows.

A term that a scene does not have is passed as None. numba compiles one version per combination of
types and prunes `if term is not None` when `term` is an argument of the function, so an absent term
does not exist in the machine code. That is why every optional term is an argument of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LANES = 8
MAX_CORRECTIONS = 14  # of one implicit step with one matrix
Array = NDArray[np.float64]


class Lattice(NamedTuple):
    """Spline and quadrature of one cable, grouped in blocks of spans.

    Attributes:
        xi, weights: samples, shape (blocks, m, LANES); weights [m].
        extraction: maps four control points to the coefficients of r' = A + B xi + C xi^2 [1/m],
            rows 3 k + (0, 1, 2) for active control point k; shape (blocks, 12, LANES).
        padding: 1 on lanes without a span, else 0; shape (blocks, LANES).
        slope: d xi / d u = 2 / h [1/m].
        n: number of control points. Position arrays have shape (dim, blocks * LANES + 3).
    """

    xi: Array
    weights: Array
    extraction: Array
    padding: Array
    slope: float
    n: int


class Stretch(NamedTuple):
    """Axial stiffness EA [N]."""

    stiffness: float


class SpanStretch(NamedTuple):
    """Stretching by means over the spans (`kernels.span_stretch`): EA [N], 1 / h [1/m] of the span
    h, 3 in the first and last span and 0 elsewhere, (blocks, LANES), and scratch."""

    stiffness: float
    share: float
    linear: Array
    sums: Array


class Bend(NamedTuple):
    """Bending stiffness EI [N m^2]."""

    stiffness: float


class RestCurvature(NamedTuple):
    """Natural curvature about a fixed axis: weighted moment EI kappa0 per sample, shape like
    Lattice.xi, and the axis, shape (3,) (rotates with the start)."""

    moment: Array
    axis: Array


class Twist(NamedTuple):
    """Plain twist rate theta': the matrix GJ integral b_i' b_j' du as lower diagonals, (4, n)."""

    stiffness: Array


class Frenet(NamedTuple):
    """Twist against the Frenet torsion: GJ [N m^2], squared curvature floor [1/m^2], and scratch
    for theta', each of shape (blocks, 3, LANES)."""

    stiffness: float
    floor: float
    angle: Array
    angle_gradient: Array


class Plastic(NamedTuple):
    """Plastic bending: EI and H [N m^2], yield moment [N m], and the state of every sample.

    curvature: plastic curvature vector [1/m], world axes; tangent: unit tangent that it was last
    made normal to; both of shape (blocks, m, 3, LANES).
    """

    stiffness: float
    hardening: float
    yield_moment: float
    curvature: Array
    tangent: Array


class Springs(NamedTuple):
    """Springs of the two ends to their anchors: stiffness [N/m] and anchor [m], shape (2, dim)."""

    stiffness: Array
    anchor: Array


class Loads(NamedTuple):
    """Point wrenches at fixed material coordinates.

    Attributes:
        first: first active control point, shape (k,).
        basis, slope: the four active basis values [-] and derivatives [1/m], shape (k, 4).
        force, torque: amplitudes in the world frame, shape (k, dim) [N] and (k, 3) [N m].
        frequency: 0 for a constant load, else the load is amplitude * sin(2 pi f t); shape (k,).
    """

    first: NDArray[np.int64]
    basis: Array
    slope: Array
    force: Array
    torque: Array
    frequency: Array


class Drive(NamedTuple):
    """Motion of the two ends; see `kernels.ends` for the columns of `motion`, shape (2, 39).

    shift: response of the free DOFs to prescribed ones, M_ff^-1 M_fp, shape (rows, 4, width), for
        control points 0, 1, n - 2, n - 1; zero where such a DOF is free.
    """

    motion: Array
    shift: Array


class Mass(NamedTuple):
    """Mass of every row with the prescribed DOFs taken out.

    Attributes:
        band: lower diagonals, shape (rows, 4, n) [kg], [kg m^2] for twist.
        lower, inverse_diagonal: LDL^T factors, shapes (rows, 3, n) and (rows, n).
        free: 1 where a DOF is solved for, 0 where it is prescribed, shape (rows, n).
    """

    band: Array
    lower: Array
    inverse_diagonal: Array
    free: Array


class Terms(NamedTuple):
    """Everything a step needs of a scene.

    Stretching is either that of every sample or that of the spans.

    axes: world axis of each spatial row. gravity: generalised weight, shape (dim, n) [N].
    decay: rate of the external damping of every row [1/s], shape (rows,), for methods that let it
    act on momenta.
    """

    lattice: Lattice
    mass: Mass
    stretch: Stretch | None
    span_stretch: SpanStretch | None
    bend: Bend | None
    rest: RestCurvature | None
    twist: Twist | None
    frenet: Frenet | None
    plastic: Plastic | None
    gravity: Array | None
    springs: Springs | None
    loads: Loads | None
    drive: Drive | None
    decay: Array | None
    axes: tuple[int, ...]

    def only(self, *names: str) -> Terms:
        """These terms alone, the others None, for a kernel that reads no others: one compiled
        version of it then serves every scene that has these."""
        kept: dict[str, Any] = dict.fromkeys(self._fields)
        kept.update((name, getattr(self, name)) for name in names)
        return Terms(**kept)


class Work(NamedTuple):
    """Scratch arrays of one simulator, so that no step allocates.

    coefficients, gradient: (blocks, 3 dim, LANES); force, load, load_before, before, v0, v1:
    (rows, width); ends: (rows, 4); pull: (2, rows, 4); anchors of the springs before: (2, dim).
    """

    coefficients: Array
    gradient: Array
    force: Array
    load: Array
    load_before: Array
    before: Array
    ends: Array
    pull: Array
    anchors: Array
    v0: Array
    v1: Array


class State(NamedTuple):
    """Configuration and momentum, each of shape (rows, width), and the energy account.

    history, shape (3, rows, width): two configurations before, for the implicit predictor, and the
    acceleration of w (generalised-alpha). reaction: mean force of the ends over the last implicit
    step, on prescribed rows. The Zhai method keeps its acceleration in history[0].

    The velocity-like variable is w = M_ff^-1 p_f, where p_f = (M v)_f is the momentum conjugate to
    the free DOFs: v_f = w - M_ff^-1 M_fp v_p. For ends at rest w is the velocity; for driven ends
    it makes the drift exact (q_f + M_ff^-1 M_fp q_p moves at constant rate w).
    """

    position: Array
    w: Array
    history: Array
    reaction: Array
    ledger: Array


class Friction(NamedTuple):
    """Linear damping: alpha M + c G of every row (`simulation.external_damping`), shape
    (rows, 4, n), and beta [s]."""

    viscous: Array
    stiffness: float


class Alpha(NamedTuple):
    """Constants of an implicit method; theta = 1/2 means the midpoint family and nothing else
    counts.

    theta = 1 - alpha_f, mass_weight = alpha_m, beta and gamma of Newmark's formulas, and
    inertia = (1 - alpha_m) / beta.
    """

    theta: float
    mass_weight: float
    beta: float
    gamma: float
    inertia: float


class Solver(NamedTuple):
    """Scratch of the implicit step (see `kernels.matrix` for the band storage).

    start, coefficients of the two configurations and of their difference; per-sample scratch; span
    and band matrices; residual, its copy and the corrections so far, each with 1 / its square,
    shape (MAX_CORRECTIONS, n dim + 1); energy lost, per lane; LDL^T factors of the twist row.
    """

    start: Array
    start_w: Array
    middle: Array
    p0: Array
    p1: Array
    dp: Array
    scratch: Array
    jacobian: Array
    matrices: Array
    band: Array
    moved: Array
    coast: Array
    residual: Array
    rhs: Array
    corrections: Array
    loss: Array
    damping_force: Array
    twist_band: Array
    twist_lower: Array
    twist_diagonal: Array


class Chain(NamedTuple):
    """Scratch of the inextensible step (`kernels.rattle`).

    gram: A of every constraint, shape (n - 1, 4, 4); band: saddle-point matrix, unknowns ordered by
    control point, shape (n (dim + 1) + 1, band); blank: what of it never changes;
    rhs; multipliers, shape (n - 1,); start, guess, change: shape (dim, width).
    """

    gram: Array
    band: Array
    blank: Array
    rhs: Array
    pull: Array
    multipliers: Array
    start: Array
    guess: Array
    change: Array


class Recorder(NamedTuple):
    """Samples taken while stepping: times [s], positions (T, rows, n), energies (T,) [J].

    `next` holds the index of the next sample, shape (1,); `before` the positions before a step.
    """

    times: Array
    positions: Array
    energies: Array
    next: NDArray[np.int64]
    before: Array


# Entries of State.ledger [J]: the energy account of a run.
LOAD_WORK = 0  # work done by loads on the cable
DRIVE_WORK = 1  # work done by moved ends, without the kinetic energy of the ends' own motion
DISSIPATED = 2
ENERGY_START = 3  # of the free motion: kinetic energy of w plus potential
ENERGY_ERROR = 4  # largest |energy - start - work + dissipated| so far
EXCHANGED = 5  # largest kinetic energy, work or change of one potential so far
FLOOR = 6  # energy below which differences mean nothing
BOOKED = 7  # 1 once Work holds the forces of an earlier evaluation
POTENTIAL_START = 8  # stretch, bend, twist, gravity, spring
HISTORY = 13  # entries of State.history that are known
PENDING = 14  # work since the last evaluation of forces, until that is booked properly
PLASTIC_WORK = 15  # the part of DISSIPATED that plastic flow took
TORSION_LOOKS = 16  # how often samples without torsion were counted, their sum, largest, last count
TORSION_SUM = 17
TORSION_WORST = 18
TORSION_LAST = 19
REACTION = 20  # 1 once State.reaction holds the mean of a step
LENGTH = 21  # [s] of the last implicit step, with its sign, and of the one before
LENGTH_BEFORE = 22
LEDGER_SIZE = 23
