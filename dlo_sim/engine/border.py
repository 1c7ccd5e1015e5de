"""Constraints at points between control points: a bordered linear system for implicit steps.

Such a held row couples four control points, so it cannot be imposed by fixing single unknowns. Let
K be the band matrix with all other constraints imposed, and let F and C be the border rows with
their directions at the middle and at the end of the step, in the frames of the clamps
(`engine.band`). The constraint forces act along F^T, the constraints are C y = 0, and a Newton
correction y for the residual r is
    K y = r + F^T f,   C y = 0:   y = (1 - Z (C Z)^-1 C) K^-1 r,   Z = K^-1 F^T.
Adding multiples of F^T C to K does not change y. It is done because K is singular if only such rows
support a cable at rest; with it, negative pivots count the unstable modes within the constraints.

The part of r in the range of F^T is balanced by the forces of the grasps, the multipliers
f = - (F F^T)^-1 F r, and so does not belong to the residual. The border rows are the last BORDER
held rows.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, shifted, store
from dlo_sim.compiling.pieces import NO, YES, part
from dlo_sim.engine import layout
from dlo_sim.engine.band import PADDING, clear_held, substitute, turn_vector, width_of
from dlo_sim.engine.tables import first_of_point, line_of, point_of


@part
def begin_of(shape, k):
    """First of the 4 dim unknowns that border row k couples."""
    return shape[layout.DIM] * first_of_point(
        shape, point_of(shape, shape[layout.HELD] - shape[layout.BORDER] + k)
    )


@part
def along(shape, scratch, offset, k, y):
    """Product of border row k of the matrix at `offset` (F or C) with a vector of all unknowns."""
    count, begin = 4 * shape[layout.DIM], begin_of(shape, k)
    value = 0.0
    for r in range(count):
        value += scratch[shape[offset] + count * k + r] * y[begin + r]
    return value


@part
def write_rows(shape, model, scratch, directions, offset, free):
    """Write the border rows with the given directions, in the frames of the clamps. `free`: zero at
    the unknowns that other constraints fix.
    """
    dim = shape[layout.DIM]
    spare = shifted(scratch, shape[layout.BORDER_SPARE])
    for k in range(shape[layout.BORDER]):
        row, begin = shape[layout.HELD] - shape[layout.BORDER] + k, begin_of(shape, k)
        weights = shape[layout.HELD_WEIGHTS] + layout.POINT_ROWS * LANES * point_of(shape, row)
        line = line_of(shape, row)
        for r in range(shape[layout.N] * dim):
            spare[r] = 0.0
        for j in range(4):
            for d in range(dim):
                along_d = 1.0 if d == line else 0.0
                if line < 0:
                    along_d = directions[(layout.DIRECTION_ROWS * row + d) * LANES]
                spare[begin + j * dim + d] = along_d * model[weights + j * LANES]
        turn_vector(shape, directions, YES, spare)
        if free:
            clear_held(shape, spare)
        for r in range(4 * dim):
            scratch[shape[offset] + 4 * dim * k + r] = spare[begin + r]


@part
def set_border(shape, model, scratch, pushed, kept):
    """Set F, with directions `pushed`, and C, with directions `kept`, and (F F^T)^-1."""
    border, count = shape[layout.BORDER], 4 * shape[layout.DIM]
    if border == 0:
        return
    write_rows(shape, model, scratch, pushed, layout.BORDER_PUSHES, NO)
    write_rows(shape, model, scratch, pushed, layout.BORDER_FORCES, YES)
    write_rows(shape, model, scratch, kept, layout.BORDER_CONDITIONS, YES)
    spare = shifted(scratch, shape[layout.BORDER_SPARE])
    for r in range(shape[layout.N] * shape[layout.DIM]):
        spare[r] = 0.0
    for k in range(border):
        begin = begin_of(shape, k)
        for r in range(count):
            spare[begin + r] = scratch[shape[layout.BORDER_FORCES] + count * k + r]
        for j in range(border):
            product = along(shape, scratch, layout.BORDER_FORCES, j, spare)
            scratch[shape[layout.BORDER_GRAM] + border * j + k] = product
        for r in range(count):
            spare[begin + r] = 0.0
    invert_in_place(border, shifted(scratch, shape[layout.BORDER_GRAM]))


@part
def invert_in_place(size, a):
    """Gauss-Jordan inverse without pivoting, for nearly symmetric positive definite matrices."""
    for k in range(size):
        pivot = 1.0 / a[size * k + k]
        a[size * k + k] = 1.0
        for j in range(size):
            a[size * k + j] *= pivot
        for i in range(size):
            if i != k:
                factor = a[size * i + k]
                a[size * i + k] = 0.0
                for j in range(size):
                    a[size * i + j] -= factor * a[size * k + j]


@part
def stiffen_border(shape, scratch, band):
    """Add F^T C to the band matrix, each row scaled to the largest diagonal entry where it acts."""
    dim, count = shape[layout.DIM], 4 * shape[layout.DIM]
    half, width = 4 * dim - 1, width_of(dim)
    for k in range(shape[layout.BORDER]):
        begin = begin_of(shape, k)
        f = shifted(scratch, shape[layout.BORDER_FORCES] + count * k)
        c = shifted(scratch, shape[layout.BORDER_CONDITIONS] + count * k)
        stiffness, norm = 0.0, 0.0
        for r in range(count):
            stiffness = max(stiffness, abs(band[(begin + r) * width + half]))
            norm += f[r] * c[r]
        for r in range(count):
            for q in range(count):
                band[(begin + r) * width + q - r + half] += stiffness / norm * f[r] * c[q]


@part
def solve_border(shape, scratch, band):
    """Compute Z = K^-1 F^T and (C Z)^-1 with the LU factors of K."""
    dim, border = shape[layout.DIM], shape[layout.BORDER]
    size, count = shape[layout.N] * dim, 4 * dim
    for k in range(border):
        z, begin = shift_of(shape, scratch, k), begin_of(shape, k)
        for r in range(size):
            z[r] = 0.0
        for r in range(count):
            z[begin + r] = scratch[shape[layout.BORDER_FORCES] + count * k + r]
        substitute(band, size, dim, z)
        for j in range(border):
            product = along(shape, scratch, layout.BORDER_CONDITIONS, j, z)
            scratch[shape[layout.BORDER_SYSTEM] + border * j + k] = product
    invert_in_place(border, shifted(scratch, shape[layout.BORDER_SYSTEM]))


@part
def shift_of(shape, scratch, k):
    """Column k of Z, over all unknowns."""
    room = shape[layout.N] * shape[layout.DIM] + 2 * PADDING
    return shifted(scratch, shape[layout.BORDER_SHIFTS] + room * k + PADDING)


@part
def keep_border(shape, scratch, y):
    """Project a correction onto the constraints: y <- (1 - Z (C Z)^-1 C) y."""
    border = shape[layout.BORDER]
    spare = shifted(scratch, shape[layout.BORDER_SPARE])
    for k in range(border):
        spare[k] = along(shape, scratch, layout.BORDER_CONDITIONS, k, y)
    for k in range(border):
        share = 0.0
        for j in range(border):
            share += scratch[shape[layout.BORDER_SYSTEM] + border * k + j] * spare[j]
        z = shift_of(shape, scratch, k)
        for r in range(shape[layout.N] * shape[layout.DIM]):
            y[r] -= share * z[r]


@part
def balance_border(shape, scratch, residual, forces):
    """Remove from the residual the part that border rows balance; write their forces to `forces`.

    These forces also act on unknowns that other constraints fix, so this comes before the reactions
    there are read from the residual.
    """
    border, count = shape[layout.BORDER], 4 * shape[layout.DIM]
    spare = shifted(scratch, shape[layout.BORDER_SPARE])
    for k in range(border):
        spare[k] = along(shape, scratch, layout.BORDER_FORCES, k, residual)
    for k in range(border):
        force, begin = 0.0, begin_of(shape, k)
        for j in range(border):
            force -= scratch[shape[layout.BORDER_GRAM] + border * k + j] * spare[j]
        store(forces, (shape[layout.HELD] - border + k) * LANES, force)
        for r in range(count):
            residual[begin + r] += scratch[shape[layout.BORDER_PUSHES] + count * k + r] * force


def border_rooms(unknowns: int, seen: int, border: int) -> dict[int, int]:
    """Sizes of the scratch arrays by offset; `seen` unknowns are coupled by each border row."""
    return {
        layout.BORDER_FORCES: border * seen,
        layout.BORDER_PUSHES: border * seen,
        layout.BORDER_CONDITIONS: border * seen,
        layout.BORDER_GRAM: border * border,
        layout.BORDER_SHIFTS: border * (unknowns + 2 * PADDING),
        layout.BORDER_SYSTEM: border * border,
        layout.BORDER_SPARE: unknowns if border else 0,
    }
