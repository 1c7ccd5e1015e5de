"""The linear system of one cable: band matrix over all spatial unknowns, constraints, LU factors.

Unknown (control point i, line d) has index i dim + d; storage as in `engine.tangent`. At a control
point that a clamp holds normal to its tangent, the unknowns are rotated into the frame of the
clamp, tangent first: the equations with the directions of the constraint forces, the unknowns with
the directions at the end of the step. Each constraint then fixes a single unknown.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, store
from dlo_sim.compiling.pieces import YES, part
from dlo_sim.engine import layout
from dlo_sim.engine.tables import is_twist, line_of, own_of, point_of, spring_first, spring_line

PADDING = 16  # zeros before and behind a vector of all unknowns


@part
def width_of(dim):
    """Stored entries per matrix row: 8 dim - 1, padded with zeros to whole vectors."""
    return 16 if dim == 2 else 32


@part
def add_to_spans(shape, b, first, other, i, j, factor, numbers, at, band):
    """Add factor times one number per span of a block (`numbers` at `at`) to the matrix entries
    between line i of the span's control point `first` and line j of `other`.
    """
    dim = shape[layout.DIM]
    half, width = 4 * dim - 1, width_of(dim)
    to = ((LANES * b + first) * dim + i) * width + (other - first) * dim + j - i + half
    for span in range(min(LANES, shape[layout.N] - 3 - LANES * b)):
        band[to + dim * width * span] += factor * numbers[at + span]


@part
def clear_band(shape, band):
    """band = 0."""
    for at in range(shape[layout.N] * shape[layout.DIM] * width_of(shape[layout.DIM])):
        band[at] = 0.0


@part
def add_lines(shape, model, matrix, scale, band):
    """band += scale times a matrix given by seven diagonals, the same for every spatial line."""
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    half, row = 4 * dim - 1, width_of(dim)
    for k in range(7):
        for i in range(max(3 - k, 0), min(n, n + 3 - k)):
            value = scale * model[matrix + k * width + layout.MARGIN + i]
            for d in range(dim):
                band[(i * dim + d) * row + (k - 3) * dim + half] += value


@part
def add_springs(shape, model, scale, band):
    """band += scale times the stiffness of all springs except roll springs."""
    dim = shape[layout.DIM]
    half = 4 * dim - 1
    for s in range(shape[layout.SPRINGS]):
        at = shape[layout.SPRING] + layout.SPRING_ROWS * LANES * s
        first = spring_first(shape, s)
        line = spring_line(shape, s)
        if line == dim:
            continue
        for k in range(4):
            for other in range(4):
                value = model[at + k * LANES] * model[at + other * LANES]
                to = ((first + k) * dim + line) * width_of(dim) + (other - k) * dim + half
                band[to] += scale * model[at + 4 * LANES] * value


@part
def own_point(shape, k):
    """Control point that row k fixes in space; -1 for the twist or between control points."""
    point = point_of(shape, k)
    if is_twist(shape, point) == 1:
        return -1
    return own_of(shape, point)


@part
def frame_of(shape, k, directions):
    """Tangent and two normals of the clamp whose rows begin at k."""
    at = layout.DIRECTION_ROWS * LANES * k
    if shape[layout.DIM] == 2:
        c0, c1 = directions[at], directions[at + LANES]
        return (c1, -c0, 0.0), (c0, c1, 0.0), (0.0, 0.0, 1.0)
    a = directions[at], directions[at + LANES], directions[at + 2 * LANES]
    at += layout.DIRECTION_ROWS * LANES
    b = directions[at], directions[at + LANES], directions[at + 2 * LANES]
    t = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return t, a, b


@part
def clamps_here(shape, k):
    """Whether k is the first row of a clamp at a control point."""
    if line_of(shape, k) >= 0 or own_point(shape, k) < 0:
        return False
    if k == 0 or shape[layout.DIM] == 2:
        return True
    same = point_of(shape, k - 1) == point_of(shape, k)
    return not same


@part
def into_frame(f, v0, v1, v2):
    """Components in the frame f of a vector v."""
    return (
        f[0][0] * v0 + f[0][1] * v1 + f[0][2] * v2,
        f[1][0] * v0 + f[1][1] * v1 + f[1][2] * v2,
        f[2][0] * v0 + f[2][1] * v1 + f[2][2] * v2,
    )


@part
def out_of_frame(f, v0, v1, v2):
    """Vector from its components v in the frame f."""
    return (
        f[0][0] * v0 + f[1][0] * v1 + f[2][0] * v2,
        f[0][1] * v0 + f[1][1] * v1 + f[2][1] * v2,
        f[0][2] * v0 + f[1][2] * v1 + f[2][2] * v2,
    )


@part
def turn_entries(dim, f, inward, numbers, at, apart):
    """Rotate a vector of dim numbers with distance `apart` into the frame f, or back."""
    v0, v1 = numbers[at], numbers[at + apart]
    v2 = numbers[at + 2 * apart] if dim == 3 else 0.0
    u = into_frame(f, v0, v1, v2) if inward else out_of_frame(f, v0, v1, v2)
    numbers[at] = u[0]
    numbers[at + apart] = u[1]
    if dim == 3:
        numbers[at + 2 * apart] = u[2]


@part
def turn_vector(shape, directions, inward, numbers):
    """Rotate a vector of all unknowns into the frames of the clamps, or back."""
    dim = shape[layout.DIM]
    for k in range(shape[layout.HELD]):
        if clamps_here(shape, k):
            f = frame_of(shape, k, directions)
            turn_entries(dim, f, inward, numbers, own_point(shape, k) * dim, 1)


@part
def hold(shape, rows, columns, band):
    """Rotate the matrix into the frames of the clamps, with directions `rows` for the equations and
    `columns` for the unknowns, and set the corrections of fixed unknowns to 0 (`clear_held`).
    """
    dim, n = shape[layout.DIM], shape[layout.N]
    half, width = 4 * dim - 1, width_of(dim)
    for k in range(shape[layout.HELD]):
        if clamps_here(shape, k):
            i = own_point(shape, k)
            low, high = max(i - 3, 0) * dim, min(i + 4, n) * dim
            f, g = frame_of(shape, k, rows), frame_of(shape, k, columns)
            for c in range(low, high):
                turn_entries(dim, f, YES, band, i * dim * width + c - i * dim + half, width - 1)
            for r in range(low, high):
                turn_entries(dim, g, YES, band, r * width + i * dim - r + half, 1)
            for d in range(1, dim):
                hold_unknown(dim, i * dim + d, band)
    for k in range(shape[layout.HELD]):
        line = line_of(shape, k)
        if 0 <= line < dim and own_point(shape, k) >= 0:
            hold_unknown(dim, own_point(shape, k) * dim + line, band)


@part
def hold_unknown(dim, r, band):
    """Make row r of the matrix a row of the identity."""
    row = r * width_of(dim)
    for c in range(8 * dim):
        band[row + c] = 0.0
    band[row + 4 * dim - 1] = 1.0


@part
def clear_held(shape, numbers):
    """Set the entries of fixed unknowns to zero; the vector is in the frames of the clamps."""
    dim = shape[layout.DIM]
    for k in range(shape[layout.HELD]):
        i = own_point(shape, k)
        line = line_of(shape, k)
        if i < 0 or line == dim:
            continue
        if line >= 0:
            numbers[i * dim + line] = 0.0
        elif clamps_here(shape, k):
            for d in range(1, dim):
                numbers[i * dim + d] = 0.0


@part
def eliminate(band, size, dim):
    """LU factorisation in place without pivoting; false if a pivot is zero or not finite.

    The matrix is inertia plus stiffness. If it is far from positive definite, the step is too long
    and is retried with a shorter one. Rows are processed in whole vectors, which the padding zeros
    allow.
    """
    half, width = 4 * dim - 1, width_of(dim)
    for r in range(size):
        at = r * width + half
        pivot = band[at]
        if not abs(pivot) > 0.0 or pivot - pivot != 0.0:
            return False
        inverse = 1.0 / pivot
        band[at] = inverse
        near, far = load(band, at + 1), load(band, at + 1)
        if dim > 2:
            far = load(band, at + 1 + LANES)
        for below in range(1, min(half, size - 1 - r) + 1):
            to = (r + below) * width + half - below
            factor = band[to] * inverse
            band[to] = factor
            store(band, to + 1, load(band, to + 1) - factor * near)
            if dim > 2:
                store(band, to + 1 + LANES, load(band, to + 1 + LANES) - factor * far)
    return True


@part
def substitute(band, size, dim, x):
    """Forward and back substitution with the factors of `eliminate`, in place.

    x needs PADDING zeros before and after it, so that all sums have a length known to the compiler.
    """
    if dim == 2:
        substitute_rows(band, size, 7, 16, x)
    elif dim == 3:
        substitute_rows(band, size, 11, 32, x)
    else:
        substitute_rows(band, size, 15, 32, x)


@part
def substitute_rows(band, size, half, width, x):
    """`substitute` for one half bandwidth and row width.

    Every sum ends with the most recent unknown, to shorten the dependency chain.
    """
    for r in range(size):
        at, value = r * width, x[r]
        for k in range(half):
            value -= band[at + k] * x[r - half + k]
        x[r] = value
    for r in range(size - 1, -1, -1):
        at, value = r * width + half, x[r]
        for k in range(half, 0, -1):
            value -= band[at + k] * x[r + k]
        x[r] = value * band[at]


@part
def substitute_eight(band, size, dim, x):
    """`substitute` for eight right-hand sides side by side; no padding needed."""
    half, width = 4 * dim - 1, width_of(dim)
    for r in range(size):
        value = load(x, r * LANES)
        for k in range(max(half - r, 0), half):
            value -= band[r * width + k] * load(x, (r - half + k) * LANES)
        store(x, r * LANES, value)
    for r in range(size - 1, -1, -1):
        value = load(x, r * LANES)
        for k in range(min(half, size - 1 - r), 0, -1):
            value -= band[r * width + half + k] * load(x, (r + k) * LANES)
        store(x, r * LANES, value * band[r * width + half])
