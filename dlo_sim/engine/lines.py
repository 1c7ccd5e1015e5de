"""Vector and band-matrix operations on lines of control points; the half bandwidth is 3.

'Partial sums' are one per lane; `gathered` adds them.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, store, total, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine.layout import DIM, FACTORS, LINE, LINES, MARGIN, MASS, PARTS, SIZE, STRIDE, N


@part
def clear(shape, x):
    """x = 0."""
    for at in range(0, shape[SIZE], LANES):
        store(x, at, 0.0)


@part
def copy(shape, source, target):
    """target = source."""
    for at in range(0, shape[SIZE], LANES):
        store(target, at, load(source, at))


@part
def add(shape, scale, x, out):
    """out += scale x; `scale` is a number or a row."""
    for at in range(0, shape[SIZE], LANES):
        store(out, at, load(out, at) + scale * load(x, at))


@part
def difference(shape, a, b, out):
    """out = a - b."""
    for at in range(0, shape[SIZE], LANES):
        store(out, at, load(a, at) - load(b, at))


@part
def kind_of(shape, line):
    """0 for a spatial line, 1 for the line of the twist angle."""
    return 0 if line < shape[DIM] else 1


@part
def add_product(shape, model, matrix, line, scale, x, out):
    """out += scale A x on one line; `matrix` is the offset of the seven diagonals of A."""
    width, stride = shape[LINE], shape[STRIDE]
    start = line * width + MARGIN * stride
    for b in range(shape[PARTS]):
        at = start + LANES * b
        to = matrix + MARGIN * stride + LANES * b
        f = load(model, to + 3 * width) * load(x, at)
        for k in range(1, 4):
            f += load(model, to + (3 - k) * width) * load(x, at - k * stride)
            f += load(model, to + (3 + k) * width) * load(x, at + k * stride)
        store(out, at, load(out, at) + scale * f)


@part
def add_differences(shape, model, matrix, line, scale, x, out):
    """out += scale A x on one line, for A with zero row sums: (A x)_i = sum_j A_ij (x_j - x_i).

    Free of cancellation for any offset of x, such as the angle after a thousand turns.
    """
    width, stride = shape[LINE], shape[STRIDE]
    start = line * width + MARGIN * stride
    for b in range(shape[PARTS]):
        at = start + LANES * b
        to = matrix + MARGIN * stride + LANES * b
        here = load(x, at)
        f = zero()
        for k in range(1, 4):
            f += load(model, to + (3 - k) * width) * (load(x, at - k * stride) - here)
            f += load(model, to + (3 + k) * width) * (load(x, at + k * stride) - here)
        store(out, at, load(out, at) + scale * f)


@part
def gathered(shape, f):
    """Add partial sums: for one cable their total, in all lanes; for eight, one sum per lane."""
    if shape[STRIDE] == 1:
        return zero() + total(f)
    return f


@part
def form(shape, model, matrix, line, x):
    """x^T A x of one line, as partial sums."""
    width, stride = shape[LINE], shape[STRIDE]
    start = line * width + MARGIN * stride
    sum_ = zero()
    for b in range(shape[PARTS]):
        at = start + LANES * b
        to = matrix + MARGIN * stride + LANES * b
        f = load(model, to + 3 * width) * load(x, at)
        for k in range(1, 4):
            f += 2.0 * load(model, to + (3 + k) * width) * load(x, at + k * stride)
        sum_ += f * load(x, at)
    return sum_


@part
def difference_form(shape, model, matrix, line, x):
    """x^T A x for A with zero row sums: - sum_(i<j) A_ij (x_j - x_i)^2, as partial sums."""
    width, stride = shape[LINE], shape[STRIDE]
    start = line * width + MARGIN * stride
    sum_ = zero()
    for b in range(shape[PARTS]):
        at = start + LANES * b
        to = matrix + MARGIN * stride + LANES * b
        here = load(x, at)
        for k in range(1, 4):
            apart = load(x, at + k * stride) - here
            sum_ -= load(model, to + (3 + k) * width) * apart * apart
    return sum_


@part
def mass_of(shape, line):
    """Offset of the mass matrix of a line."""
    return shape[MASS] + 7 * shape[LINE] * kind_of(shape, line)


@part
def kinetic(shape, model, v):
    """Kinetic energy v^T M v / 2 [J], a row."""
    sum_ = zero()
    for line in range(shape[LINES]):
        sum_ += form(shape, model, mass_of(shape, line), line, v)
    return 0.5 * gathered(shape, sum_)


@part
def solve_mass(shape, model, x):
    """x <- M^-1 x in place, by forward and back substitution with FACTORS."""
    if shape[STRIDE] == 1:
        solve_one(shape, model, x)
    else:
        solve_eight(shape, model, x)


@part
def solve_one(shape, model, x):
    """`solve_mass` of one cable. Lines are interleaved, so that their dependency chains overlap."""
    width, n, lines, dim = shape[LINE], shape[N], shape[LINES], shape[DIM]
    first = shape[FACTORS]
    for k in range(MARGIN, n + MARGIN):
        for line in range(lines):
            f = first + k + (7 * width if line >= dim else 0)
            at = line * width + k
            x[at] -= (model[f] * x[at - 3] + model[f + width] * x[at - 2]) + (
                model[f + 2 * width] * x[at - 1]
            )
    for k in range(n + MARGIN - 1, MARGIN - 1, -1):
        for line in range(lines):
            f = first + k + (7 * width if line >= dim else 0)
            at = line * width + k
            x[at] = (
                x[at] * model[f + 3 * width]
                - (model[f + 6 * width] * x[at + 3] + model[f + 5 * width] * x[at + 2])
                - model[f + 4 * width] * x[at + 1]
            )


@part
def solve_eight(shape, model, x):
    """`solve_mass` of eight cables."""
    width, n, lines = shape[LINE], shape[N], shape[LINES]
    for line in range(lines):
        first = shape[FACTORS] + 7 * width * kind_of(shape, line)
        a = b = c = zero()
        for k in range(MARGIN, n + MARGIN):
            f, at = first + LANES * k, line * width + LANES * k
            d = load(x, at) - (load(model, f) * a + load(model, f + width) * b)
            d -= load(model, f + 2 * width) * c
            store(x, at, d)
            a, b, c = b, c, d
        a = b = c = zero()
        for k in range(n + MARGIN - 1, MARGIN - 1, -1):
            f, at = first + LANES * k, line * width + LANES * k
            d = load(x, at) * load(model, f + 3 * width)
            d -= load(model, f + 6 * width) * a + load(model, f + 5 * width) * b
            d -= load(model, f + 4 * width) * c
            store(x, at, d)
            a, b, c = b, c, d


@part
def row_product(shape, a, b):
    """a . b over all lines, a row."""
    sum_ = zero()
    for at in range(0, shape[SIZE], LANES):
        sum_ += load(a, at) * load(b, at)
    return gathered(shape, sum_)
