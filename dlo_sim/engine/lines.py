"""Operations on lines of control points, and on band matrices that act on one line.

A band matrix has seven diagonals: entry (i, i + k - 3) is at [k, MARGIN + i].
"""

from __future__ import annotations

from numba import float64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane_sum, zero
from dlo_sim.engine.arrays import BETWEEN, CABLE, IMPLICIT, LINES, MARGIN, VECTOR


@kernel(void, LINES)
def clear(x):
    """x = 0."""
    for line in range(x.shape[0]):
        for c in range(0, x.shape[1], LANES):
            store(x, line, c, 0.0)


@kernel(void, LINES, LINES)
def copy(source, target):
    """target = source."""
    for line in range(source.shape[0]):
        for c in range(0, source.shape[1], LANES):
            store(target, line, c, load(source, line, c))


@inline
def add(scale, x, out):
    """out += scale x."""
    for line in range(x.shape[0]):
        for c in range(0, x.shape[1], LANES):
            store(out, line, c, load(out, line, c) + scale * load(x, line, c))


@kernel(void, LINES, LINES, LINES, family=IMPLICIT)
def difference(a, b, out):
    """out = a - b."""
    for line in range(a.shape[0]):
        for c in range(0, a.shape[1], LANES):
            store(out, line, c, load(a, line, c) - load(b, line, c))


@kernel(float64, LINES, LINES, family=IMPLICIT)
def inner(a, b):
    """a . b over all lines."""
    sum_ = zero()
    for line in range(a.shape[0]):
        for c in range(0, a.shape[1], LANES):
            sum_ += load(a, line, c) * load(b, line, c)
    return lane_sum(sum_)


@inline
def kind_of(cable, line):
    """0 for a spatial line, 1 for the line of the twist angle."""
    return 0 if line < cable.dim else 1


@inline
def mass_of(cable, line):
    """Mass matrix of a line."""
    return cable.linear.mass[kind_of(cable, line)]


@inline
def damping_of(cable, line):
    """Matrix of the linear damping of a line."""
    return cable.linear.damping[kind_of(cable, line)]


@kernel(void, LINES, float64, VECTOR, VECTOR, family=IMPLICIT | BETWEEN)
def add_product(matrix, scale, x, out):
    """out += scale A x on one line."""
    for c in range(MARGIN, len(x) - LANES, LANES):
        f = load(matrix, 3, c) * load(x, c)
        for k in range(1, 4):
            f += load(matrix, 3 - k, c) * load(x, c - k)
            f += load(matrix, 3 + k, c) * load(x, c + k)
        store(out, c, load(out, c) + scale * f)


@kernel(void, LINES, float64, VECTOR, VECTOR)
def add_differences(matrix, scale, x, out):
    """out += scale A x on one line, for A with zero row sums: (A x)_i = sum_j A_ij (x_j - x_i).

    Free of cancellation for any offset of x, such as the angle after a thousand turns.
    """
    for c in range(MARGIN, len(x) - LANES, LANES):
        here = load(x, c)
        f = zero()
        for k in range(1, 4):
            f += load(matrix, 3 - k, c) * (load(x, c - k) - here)
            f += load(matrix, 3 + k, c) * (load(x, c + k) - here)
        store(out, c, load(out, c) + scale * f)


@inline
def form_by_lanes(matrix, x):
    """x^T A x of one line for a symmetric A; the lanes are still to be summed."""
    sum_ = zero()
    for c in range(MARGIN, len(x) - LANES, LANES):
        f = load(matrix, 3, c) * load(x, c)
        for k in range(1, 4):
            f += 2.0 * load(matrix, 3 + k, c) * load(x, c + k)
        sum_ += f * load(x, c)
    return sum_


@kernel(float64, LINES, VECTOR)
def form(matrix, x):
    """x^T A x of one line for a symmetric A."""
    return lane_sum(form_by_lanes(matrix, x))


@kernel(float64, CABLE, LINES)
def kinetic(cable, v):
    """Kinetic energy v^T M v / 2 [J]."""
    sum_ = zero()
    for line in range(cable.lines):
        sum_ += form_by_lanes(mass_of(cable, line), v[line])
    return 0.5 * lane_sum(sum_)


@inline
def solve_mass(cable, x):
    """x <- M^-1 x by forward and back substitution; lines interleave, which hides latencies."""
    factors, lines, dim = cable.linear.factors, cable.lines, cable.dim
    for c in range(MARGIN, cable.n + MARGIN):
        for line in range(lines):
            f = factors[0 if line < dim else 1]
            x[line, c] -= (f[0, c] * x[line, c - 3] + f[1, c] * x[line, c - 2]) + (
                f[2, c] * x[line, c - 1]
            )
    for c in range(cable.n + MARGIN - 1, MARGIN - 1, -1):
        for line in range(lines):
            f = factors[0 if line < dim else 1]
            x[line, c] = (
                x[line, c] * f[3, c]
                - (f[6, c] * x[line, c + 3] + f[5, c] * x[line, c + 2])
                - f[4, c] * x[line, c + 1]
            )


@inline
def solve_line(factors, n, x):
    """x <- A^-1 x on one line, with the factors of A (`arrays.Linear`)."""
    for c in range(MARGIN, n + MARGIN):
        x[c] -= factors[0, c] * x[c - 3] + factors[1, c] * x[c - 2]
        x[c] -= factors[2, c] * x[c - 1]
    for c in range(n + MARGIN - 1, MARGIN - 1, -1):
        x[c] = x[c] * factors[3, c] - factors[6, c] * x[c + 3]
        x[c] -= factors[5, c] * x[c + 2] + factors[4, c] * x[c + 1]
