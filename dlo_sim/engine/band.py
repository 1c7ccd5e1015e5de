"""The linear system of an implicit step: band matrix, rows at control points, LU factors.

Unknown (control point i, line d) has index i lines + d, with the twist as the last line, and entry
(r, c) of the matrix is at [r, c - r + 4 lines - 1]. At a control point that a clamp holds normal to
its tangent, the spatial unknowns are rotated into the frame of the clamp, tangent first: the
equations with the directions of the constraint forces, the unknowns with the directions at the end
of the step. Each constraint row then fixes a single unknown.

Rows that couple several control points border the matrix (`engine.border`).
"""

from __future__ import annotations

from numba import boolean, int64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane
from dlo_sim.engine.arrays import (
    BETWEEN,
    CABLE,
    IMPLICIT,
    IN_SKYLINE,
    LINES,
    MARGIN,
    PADDING,
    RIGID,
    VECTOR,
)
from dlo_sim.engine.skyline import substitute_skyline
from dlo_sim.terms.vectors import cross

# -- the matrix ----------------------------------------------------------------------------------


@inline
def clear_band(band):
    """band = 0."""
    for r in range(len(band)):
        for c in range(0, band.shape[1], LANES):
            store(band, r, c, 0.0)


@inline
def add_to_spans(cable, b, first, other, i, j, values, band):
    """Add `values`, one for each span of block b, to the matrix entries between line i of the
    span's control point `first` (0 to 3) and line j of its control point `other`.
    """
    lines = cable.lines
    column = (other - first) * lines + j - i + 4 * lines - 1
    for span in range(min(LANES, cable.n - 3 - LANES * b)):
        band[(LANES * b + span + first) * lines + i, column] += lane(values, span)


@inline
def add_line(cable, line, matrix, scale, band):
    """band += scale times a matrix of seven diagonals (7, columns) on one line."""
    lines, n = cable.lines, cable.n
    for k in range(7):
        for i in range(max(3 - k, 0), min(n, n + 3 - k)):
            band[i * lines + line, (k + 1) * lines - 1] += scale * matrix[k, MARGIN + i]


@inline
def add_lines(cable, matrices, scale, band):
    """band += scale times matrices of seven diagonals (2, 7, columns), the first one on all spatial
    lines, the second one on that of the twist.
    """
    dim, lines, n = cable.dim, cable.lines, cable.n
    for k in range(7):
        column = (k + 1) * lines - 1
        for i in range(max(3 - k, 0), min(n, n + 3 - k)):
            value = scale * matrices[0][k, MARGIN + i]
            for d in range(dim):
                band[i * lines + d, column] += value
            if lines > dim:
                band[i * lines + dim, column] += scale * matrices[1][k, MARGIN + i]


@inline
def add_springs(cable, scale, band):
    """band += scale times the stiffness of all springs except joints, and all of that of roll
    springs, which act with their moment at the end of a step.
    """
    lines, rows, points = cable.lines, cable.rows, cable.points
    for row in range(rows.count + rows.joints, rows.count + rows.springs):
        line, point = rows.line[row], rows.point[row]
        stiffness = rows.stiffness[row] * (1.0 if line == cable.dim else scale)
        for k in range(4):
            r = (points.first[point] + k) * lines + line
            for other in range(4):
                value = points.weights[point, k] * points.weights[point, other]
                band[r, (other - k) * lines + 4 * lines - 1] += stiffness * value


# -- vectors of all unknowns ---------------------------------------------------------------------


@inline
def to_unknowns(cable, x, out):
    """Write lines as a padded vector."""
    for d in range(cable.lines):
        for i in range(cable.n):
            out[PADDING + i * cable.lines + d] = x[d, MARGIN + i]


@inline
def to_lines(cable, numbers, begin, out):
    """Write a vector whose first unknown is numbers[begin] as lines."""
    for d in range(cable.lines):
        for i in range(cable.n):
            out[d, MARGIN + i] = numbers[begin + i * cable.lines + d]


# -- constraint rows at control points -----------------------------------------------------------


@inline
def own_point(cable, k):
    """Control point whose place row k fixes; -1 for the twist, or between control points."""
    point = cable.rows.point[k]
    return -1 if cable.points.twist[point] == 1 else cable.points.own[point]


@inline
def frame_of(cable, k, directions):
    """Tangent and two normals of the clamp whose rows begin at k; `directions`: (rows, 3)."""
    if cable.dim == 2:
        c0, c1 = directions[k, 0], directions[k, 1]
        return (c1, -c0, 0.0), (c0, c1, 0.0), (0.0, 0.0, 1.0)
    a = directions[k, 0], directions[k, 1], directions[k, 2]
    b = directions[k + 1, 0], directions[k + 1, 1], directions[k + 1, 2]
    return cross(a, b), a, b


@inline
def clamps_here(cable, k):
    """Whether k is the first row of a clamp at a control point."""
    rows = cable.rows
    if rows.line[k] >= 0 or own_point(cable, k) < 0:
        return False
    return k == 0 or cable.dim == 2 or rows.point[k - 1] != rows.point[k]


@inline
def into_frame(f, v0, v1, v2):
    """Components in the frame f of a vector v."""
    return (
        f[0][0] * v0 + f[0][1] * v1 + f[0][2] * v2,
        f[1][0] * v0 + f[1][1] * v1 + f[1][2] * v2,
        f[2][0] * v0 + f[2][1] * v1 + f[2][2] * v2,
    )


@inline
def out_of_frame(f, v0, v1, v2):
    """Vector from its components v in the frame f."""
    return (
        f[0][0] * v0 + f[1][0] * v1 + f[2][0] * v2,
        f[0][1] * v0 + f[1][1] * v1 + f[2][1] * v2,
        f[0][2] * v0 + f[1][2] * v1 + f[2][2] * v2,
    )


@kernel(void, CABLE, LINES, boolean, VECTOR, int64, family=IMPLICIT | BETWEEN)
def turn_vector(cable, directions, inward, numbers, begin):
    """Rotate a vector of all unknowns, whose first is numbers[begin], into the frames of the
    clamps, or back.
    """
    dim = cable.dim
    for k in range(cable.rows.count):
        if not clamps_here(cable, k):
            continue
        f = frame_of(cable, k, directions)
        at = begin + own_point(cable, k) * cable.lines
        v0, v1, v2 = numbers[at], numbers[at + 1], numbers[at + 2] if dim == 3 else 0.0
        u = into_frame(f, v0, v1, v2) if inward else out_of_frame(f, v0, v1, v2)
        numbers[at], numbers[at + 1] = u[0], u[1]
        if dim == 3:
            numbers[at + 2] = u[2]


@inline
def turn_entries(dim, f, band, r, c, down, right):
    """Rotate `dim` entries of the matrix into the frame f; the first is at [r, c], the next at
    [r + down, c + right].
    """
    v0, v1 = band[r, c], band[r + down, c + right]
    v2 = band[r + 2 * down, c + 2 * right] if dim == 3 else 0.0
    u = into_frame(f, v0, v1, v2)
    band[r, c] = u[0]
    band[r + down, c + right] = u[1]
    if dim == 3:
        band[r + 2 * down, c + 2 * right] = u[2]


@kernel(void, CABLE, LINES, LINES, LINES, family=IMPLICIT | BETWEEN)
def hold(cable, rows, columns, band):
    """Rotate the matrix into the frames of the clamps, with directions `rows` (rows, 3) for the
    equations and `columns` for the unknowns, and make the equations of fixed unknowns those of the
    identity, so that a right-hand side of zero (`clear_held`) leaves them unchanged.
    """
    dim, lines, n = cable.dim, cable.lines, cable.n
    half = 4 * lines - 1
    for k in range(cable.rows.count):
        if clamps_here(cable, k):
            i = own_point(cable, k)
            begin = i * lines
            low, high = max(i - 3, 0) * lines, min(i + 4, n) * lines
            f, g = frame_of(cable, k, rows), frame_of(cable, k, columns)
            for c in range(low, high):
                turn_entries(dim, f, band, begin, c - begin + half, 1, -1)
            for r in range(low, high):
                turn_entries(dim, g, band, r, begin - r + half, 0, 1)
            for d in range(1, dim):
                hold_unknown(lines, begin + d, band)
    for k in range(cable.rows.count):
        line, own = cable.rows.line[k], cable.points.own[cable.rows.point[k]]
        if line >= 0 and own >= 0:
            hold_unknown(lines, own * lines + line, band)
    if cable.terms & RIGID and lines > dim:
        for body in range(len(cable.bodies.idle)):
            for k in range(4):
                if cable.bodies.idle[body, k] == 1:
                    hold_unknown(lines, cable.bodies.point[body, k] * lines + dim, band)


@inline
def hold_unknown(lines, r, band):
    """Make row r of the matrix a row of the identity."""
    for c in range(8 * lines):
        band[r, c] = 0.0
    band[r, 4 * lines - 1] = 1.0


@inline
def clear_held(cable, numbers, begin):
    """Set the entries of fixed unknowns to zero, in a vector in the frames of the clamps whose
    first unknown is numbers[begin].
    """
    for k in range(cable.rows.count):
        line, own = cable.rows.line[k], cable.points.own[cable.rows.point[k]]
        if line >= 0 and own >= 0:
            numbers[begin + own * cable.lines + line] = 0.0
        elif clamps_here(cable, k):
            for d in range(1, cable.dim):
                numbers[begin + own * cable.lines + d] = 0.0
    if cable.terms & RIGID and cable.lines > cable.dim:
        for body in range(len(cable.bodies.idle)):
            for k in range(4):
                if cable.bodies.idle[body, k] == 1:
                    at = begin + cable.bodies.point[body, k] * cable.lines + cable.dim
                    numbers[at] = 0.0


# -- LU factors ----------------------------------------------------------------------------------


@kernel(boolean, LINES, int64, int64, family=IMPLICIT | BETWEEN)
def eliminate(band, size, lines):
    """LU factorisation in place without pivoting; false if a pivot is zero or not finite.

    The matrix is inertia plus stiffness. If it is far from positive definite, the step is too long
    and is retried with a shorter one. Rows are processed in whole vectors, which the padding zeros
    allow.
    """
    half = 4 * lines - 1
    for r in range(size):
        pivot = band[r, half]
        if not abs(pivot) > 0.0 or pivot - pivot != 0.0:
            return False
        inverse = 1.0 / pivot
        band[r, half] = inverse
        near, far = load(band, r, half + 1), load(band, r, half + 1)
        if lines > 2:
            far = load(band, r, half + 1 + LANES)
        for below in range(1, min(half, size - 1 - r) + 1):
            to, c = r + below, half - below
            factor = band[to, c] * inverse
            band[to, c] = factor
            store(band, to, c + 1, load(band, to, c + 1) - factor * near)
            if lines > 2:
                store(band, to, c + 1 + LANES, load(band, to, c + 1 + LANES) - factor * far)
    return True


@kernel(void, LINES, int64, int64, VECTOR, family=IMPLICIT | BETWEEN)
def substitute(band, size, lines, x):
    """Forward and back substitution with the factors of `eliminate`, in place.

    Unknown r is x[PADDING + r]; the zeros around them give all sums a length that the compiler
    knows.
    """
    if lines == 2:
        substitute_rows(band, size, 7, x)
    elif lines == 3:
        substitute_rows(band, size, 11, x)
    else:
        substitute_rows(band, size, 15, x)


@inline
def substitute_rows(band, size, half, x):
    """`substitute` for one half bandwidth.

    Every sum ends with the most recent unknown, to shorten the dependency chain.
    """
    for r in range(size):
        row, at = band[r], PADDING + r
        value = x[at]
        for k in range(half):
            value -= row[k] * x[at - half + k]
        x[at] = value
    for r in range(size - 1, -1, -1):
        row, at = band[r], PADDING + r
        value = x[at]
        for k in range(half, 0, -1):
            value -= row[half + k] * x[at + k]
        x[at] = value * row[half]


@kernel(void, LINES, int64, int64, VECTOR, family=BETWEEN)
def substitute_transposed(band, size, lines, x):
    """Solution with the transposed matrix, as `substitute`: K^T = U^T L^T."""
    half = 4 * lines - 1
    for r in range(size):
        row, at = band[r], PADDING + r
        x[at] *= row[half]
        for k in range(1, half + 1):
            x[at + k] -= row[half + k] * x[at]
    for r in range(size - 1, -1, -1):
        row, at = band[r], PADDING + r
        for k in range(half):
            x[at - half + k] -= row[k] * x[at]


@inline
def solve(cable, band, x):
    """`substitute` with the factors of the last Newton matrix of a step, in `band` or, where the
    cable presses on itself, in the skyline.
    """
    if cable.work.results.coupled == IN_SKYLINE:
        substitute_skyline(cable, cable.n * cable.lines, x)
    else:
        substitute(band, cable.n * cable.lines, cable.lines, x)
