"""What the arrays of a stack of LANES scenes mean, and plain work on their rows.

A configuration has a row of dim x LANES numbers for each control point: a scene to each lane.

Loops over a row take its length from the array: short loops of constant length are unrolled before
they could be vectorised (eight scenes of 13 control points, Forest-Ruth: 2.3 times as fast as one
by one with those, 3.6 times without).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import LANES, Array

STRETCH, BEND, GRAVITY, SPRING, KINETIC = 0, 1, 2, 3, 4  # rows of StackWork.parts
PARTS = 5


class LaneSprings(NamedTuple):
    """Springs of the two ends: stiffness [N/m] and anchor [m], shape (2, dim LANES)."""

    stiffness: Array
    anchor: Array


class LaneLoads(NamedTuple):
    """Point forces spread on the control points: amplitude [N], shape (k, n, dim LANES), and
    frequency [Hz], 0 for a constant load, shape (k, LANES)."""

    force: Array
    frequency: Array


class LaneSpanStretch(NamedTuple):
    """`kernels.span_stretch`: EA [N], shape (LANES,); 3 in the first and last span, 0 elsewhere,
    shape (spans,); scratch for m and l, shape (2 LANES,)."""

    stiffness: Array
    linear: Array
    sums: Array


class Stack(NamedTuple):
    """Everything that a step of LANES scenes needs.

    Attributes:
        xi: samples of every span, shape (spans, m); weights [m], shape (spans, m, LANES).
        extraction: maps four control points to the coefficients of r' = A + B xi + C xi^2 of a
            cable with slope 1, entries 3 k + (0, 1, 2), shape (spans, 12).
        slope: d xi / d u [1/m], the same for each row, shape (dim LANES,).
        band: lower diagonals of the mass, shape (n, 4, dim LANES) [kg].
        lower, upper: LDL^T factors L[i, i - k] and L[i + k, i], zero beyond the ends, shape
            (n, 3, dim LANES); inverse_diagonal: (n, dim LANES), zero on prescribed entries.
        stretch, bend: EA [N] and EI [N m^2], shape (LANES,); gravity: weight [N], (n, dim LANES).
        keep: exp(-decay tau / 2), the share of w left by half a step of damping, the same for
            each row, (dim LANES,).
        axes: world axis of each row of `Terms`.
    """

    xi: Array
    weights: Array
    extraction: Array
    slope: Array
    band: Array
    lower: Array
    upper: Array
    inverse_diagonal: Array
    stretch: Array | None
    span_stretch: LaneSpanStretch | None
    bend: Array | None
    gravity: Array | None
    springs: LaneSprings | None
    loads: LaneLoads | None
    keep: Array | None
    axes: tuple[int, ...]


class StackState(NamedTuple):
    """Configurations and velocities, shape (n, dim LANES), and where every lane stands.

    good_position, good_w: at the last look at the energy that found it sane, after good_step
    steps; failed_step: the look that did not, or -1; both of shape (LANES,).
    ledger: the accounts, shape (LEDGER_SIZE, LANES), see `kernels.layout`; what a failed lane
    books after its failure means nothing, its energy error is no longer touched.
    booked: 1 once StackWork holds the loads of an earlier evaluation, shape (1,).
    """

    position: Array
    w: Array
    good_position: Array
    good_w: Array
    good_step: NDArray[np.int64]
    failed_step: NDArray[np.int64]
    ledger: Array
    booked: NDArray[np.int64]


class StackWork(NamedTuple):
    """Scratch: force, load, load_before, before of shape (n, dim LANES); coefficients and gradient
    of one span, shape (3 dim LANES,); chain of the solve, shape (3, dim LANES); sums of rows, shape
    (2, dim LANES); parts of the energy, shape (PARTS, LANES)."""

    force: Array
    load: Array
    load_before: Array
    before: Array
    coefficients: Array
    gradient: Array
    chain: Array
    sums: Array
    parts: Array


class StackRecorder(NamedTuple):
    """Samples: times [s], shape (T,), positions (T, n, dim LANES), energies (T, LANES) [J], index
    of the next one, shape (1,), and positions and velocities before a step (n, dim LANES)."""

    times: Array
    positions: Array
    energies: Array
    next: NDArray[np.int64]
    before: Array
    before_w: Array


@kernel
def put_row(source, out):
    """out = source, rows."""
    for e in range(out.shape[0]):
        out[e] = source[e]


@kernel
def clear_row(out):
    """out = 0."""
    for e in range(out.shape[0]):
        out[e] = 0.0


@kernel
def add_row(scale, source, out):
    """out += scale source, rows."""
    for e in range(out.shape[0]):
        out[e] += scale * source[e]


@kernel
def put(source, out):
    """out = source, configurations."""
    for i in range(out.shape[0]):
        put_row(source[i], out[i])


@kernel
def clear(out):
    """out = 0, configurations."""
    for i in range(out.shape[0]):
        clear_row(out[i])


@kernel
def add_scaled(scale, source, out):
    """out += scale source, configurations."""
    for i in range(out.shape[0]):
        add_row(scale, source[i], out[i])


@kernel
def add_rows(source, out):
    """out += the sum over the rows of `Terms` of `source`, per lane."""
    for e in range(source.shape[0]):
        out[e % LANES] += source[e]
