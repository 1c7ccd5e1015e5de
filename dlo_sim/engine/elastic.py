"""Assembly of stretching and bending: a loop over the samples of every span, eight spans at a time.

It evaluates the energy densities (`terms`) or their derivatives at each sample and adds them up on
the control points. The same code serves planar and spatial cables, and one cable or eight side by
side.

The densities depend on c = t . t, d = t . k and h = k . k only. On a span t = A + B xi + C xi^2, so
these are polynomials in xi whose coefficients are the inner products of A, B and C; the gradient
with respect to A, B, C is a symmetric 3 x 3 matrix times (A, B, C), the same for every line. Forces
therefore need no loop over the lines at a sample.

Stretching by span (bit SPAN_STRETCH) avoids membrane locking: a bent span cannot have |r'| = 1 at
all of its samples, so with EA/EI of a thin cable the sampled stretching energy would suppress
bending. The axial strain is therefore projected onto constants, and onto linear functions in the
first and the last span: n - 1 numbers, as many as r' has degrees of freedom along a straight cable.
With m = 1/h integral eps du, l = 1/h integral eps xi du, f = 3 where linear, else 0, the energy is
EA h/2 (m^2 + f l^2), and the projected strain at a sample is m + f xi l. What this leaves free is
bounded by the span guard (`terms.span_guard`), a part of any stretching energy.

Source: assumed natural strains, Bucalem & Bathe 1993, Int. J. Numer. Meth. Eng. 36, 3729-3754; for
splines the B-bar projection of Elguedj et al. 2008, Comput. Methods Appl. Mech. Eng. 197,
2732-2762.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, store, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.span_guard import guard_energy, guard_gradient
from dlo_sim.terms import bend, stretch


@part
def block_of(shape, b):
    """Offset of block b of the mesh."""
    return shape[layout.MESH] + b * (layout.HEAD + layout.SAMPLE * shape[layout.SAMPLES]) * LANES


@part
def sample_of(block, j):
    """Offset of sample j of a block."""
    return block + (layout.HEAD + layout.SAMPLE * j) * LANES


@part
def coefficients(x, at, stride, model, block):
    """Coefficients A, B, C of the derivative A + B xi + C xi^2 of one line on a block's spans."""
    q0, q1 = load(x, at), load(x, at + stride)
    q2, q3 = load(x, at + 2 * stride), load(x, at + 3 * stride)
    row = block
    a = load(model, row) * q0 + load(model, row + 3 * LANES) * q1
    a += load(model, row + 6 * LANES) * q2 + load(model, row + 9 * LANES) * q3
    row += LANES
    b = load(model, row) * q0 + load(model, row + 3 * LANES) * q1
    b += load(model, row + 6 * LANES) * q2 + load(model, row + 9 * LANES) * q3
    row += LANES
    c = load(model, row) * q0 + load(model, row + 3 * LANES) * q1
    c += load(model, row + 6 * LANES) * q2 + load(model, row + 9 * LANES) * q3
    return a, b, c


@part
def curve(shape, model, x, b, straight):
    """A, B, C of all spatial lines; `straight` times a unit tangent on lanes beyond the last."""
    at, width, stride = (
        layout.MARGIN * shape[layout.STRIDE] + LANES * b,
        shape[layout.LINE],
        shape[layout.STRIDE],
    )
    block = block_of(shape, b)
    p0 = coefficients(x, at, stride, model, block)
    p0 = p0[0] + straight * load(model, block + layout.PADDING * LANES), p0[1], p0[2]
    p1 = coefficients(x, at + width, stride, model, block)
    p2 = zero(), zero(), zero()
    if shape[layout.DIM] == 3:
        p2 = coefficients(x, at + 2 * width, stride, model, block)
    return p0, p1, p2


@part
def tangent_at(p, xi):
    """t = r' at a local coordinate."""
    return (
        p[0][0] + xi * (p[0][1] + xi * p[0][2]),
        p[1][0] + xi * (p[1][1] + xi * p[1][2]),
        p[2][0] + xi * (p[2][1] + xi * p[2][2]),
    )


@part
def bending_at(p, xi, slope):
    """k = r'' at a local coordinate."""
    two = 2.0 * xi
    return (
        slope * (p[0][1] + two * p[0][2]),
        slope * (p[1][1] + two * p[1][2]),
        slope * (p[2][1] + two * p[2][2]),
    )


@part
def three(array, at):
    """Load three rows as a vector."""
    return load(array, at), load(array, at + LANES), load(array, at + 2 * LANES)


@part
def store_three(array, at, v):
    """Store a vector as three rows."""
    store(array, at, v[0])
    store(array, at + LANES, v[1])
    store(array, at + 2 * LANES, v[2])


@part
def dot(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def add_sample(g, on_t, on_k, xi):
    """g + gradient on A, B, C of one line from one sample's, on r' and (times d xi/du) on r''."""
    return g[0] + on_t, g[1] + (xi * on_t + on_k), g[2] + xi * (xi * on_t + 2.0 * on_k)


@part
def scatter(g, at, stride, model, block, scale, out):
    """out += scale times the gradient with respect to one line; g: with respect to A, B, C."""
    for k in range(4):
        row = block + 3 * k * LANES
        f = load(model, row) * g[0] + load(model, row + LANES) * g[1]
        f += load(model, row + 2 * LANES) * g[2]
        to = at + k * stride
        store(out, to, load(out, to) + scale * f)


@part
def integrated(inverse_slope, p, xi):
    """Value at xi of p0 + integral over u of p1 + p2 xi + p3 xi^2 from the middle of the span."""
    return p[0] + xi * inverse_slope * (p[1] + xi * (0.5 * p[2] + xi * p[3] * (1.0 / 3.0)))


@part
def line_polynomial(x, at, stride, model, block):
    """One line on the spans of a block: value at xi = 0, then A, B, C of its derivative."""
    value = load(model, block + layout.VALUES * LANES) * load(x, at)
    for k in range(1, 4):
        value += load(model, block + (layout.VALUES + k) * LANES) * load(x, at + k * stride)
    a, b, c = coefficients(x, at, stride, model, block)
    return value, a, b, c


@part
def basis_at(model, block, k, inverse_slope, xi):
    """Value of basis function k of a span."""
    row = block + 3 * k * LANES
    value = load(model, block + (layout.VALUES + k) * LANES)
    a, b, c = load(model, row), load(model, row + LANES), load(model, row + 2 * LANES)
    return integrated(inverse_slope, (value, a, b, c), xi)


@part
def add_cubic(a, f, xi):
    """a + f (1, xi, xi^2, xi^3), with f a sample's gradient on a line's value: `scatter_values`."""
    g = xi * f
    return a[0] + f, a[1] + g, a[2] + xi * g, a[3] + xi * xi * g


@part
def scatter_values(f, at, stride, model, block, scale, out):
    """out += scale times the gradient with respect to one line; f: from `add_cubic`."""
    inverse = 1.0 / load(model, block + layout.SLOPE * LANES)
    on_slopes = inverse * f[1], 0.5 * inverse * f[2], (1.0 / 3.0) * inverse * f[3]
    scatter(on_slopes, at, stride, model, block, scale, out)
    for k in range(4):
        to = at + k * stride
        value = load(model, block + (layout.VALUES + k) * LANES)
        store(out, to, load(out, to) + scale * value * f[0])


@part
def scatter_lines(shape, model, b, g0, g1, g2, scale, out):
    """`scatter` of all spatial lines."""
    at, width, stride = (
        layout.MARGIN * shape[layout.STRIDE] + LANES * b,
        shape[layout.LINE],
        shape[layout.STRIDE],
    )
    block = block_of(shape, b)
    scatter(g0, at, stride, model, block, scale, out)
    scatter(g1, at + width, stride, model, block, scale, out)
    if shape[layout.DIM] == 3:
        scatter(g2, at + 2 * width, stride, model, block, scale, out)


@part
def span_strains(shape, model, block, p):
    """m and l of the spans of a block (module docstring)."""
    mean, slope = zero(), zero()
    share = load(model, block + layout.SHARE * LANES)
    for j in range(shape[layout.SAMPLES]):
        at = sample_of(block, j)
        xi = load(model, at + layout.XI * LANES)
        t = tangent_at(p, xi)
        # `stretch.strain` without its division, which costs 5 % of a step; c is no more exact.
        f = share * load(model, at + layout.QUADRATURE * LANES) * (root(dot(t, t)) - 1.0)
        mean += f
        slope += xi * f
    return mean, slope


@part
def products(p):
    """Inner products A.A, A.B, A.C, B.B, B.C, C.C of the coefficients of r'."""
    a, b, c = (
        (p[0][0], p[1][0], p[2][0]),
        (p[0][1], p[1][1], p[2][1]),
        (p[0][2], p[1][2], p[2][2]),
    )
    return dot(a, a), dot(a, b), dot(a, c), dot(b, b), dot(b, c), dot(c, c)


@part
def invariants_at(inner, xi):
    """c, d / s and h / s^2 at a local coordinate, from the inner products; s = d xi/du."""
    aa, ab, ac, bb, bc, cc = inner
    middle = bb + 2.0 * ac
    return (
        (aa + xi * (2.0 * ab)) + xi * xi * ((middle + xi * (2.0 * bc)) + xi * xi * cc),
        ab + xi * (middle + xi * (3.0 * bc + xi * (2.0 * cc))),
        bb + xi * (4.0 * bc + xi * (4.0 * cc)),
    )


@part
def add_invariants(g, on_c, on_d, on_h, xi):
    """g plus half the matrix (AA, AB, AC, BB, BC, CC) of one sample. on_c, on_d, on_h: its weight
    times dU/dc, s/2 dU/dd and s^2 dU/dh, s = d xi/du.

    on_c is known last, so each entry is one multiply-add away from it.
    """
    square, along = xi * xi, xi * on_d
    more = along + 2.0 * on_h
    ac, bc = along + along, 2.0 * along + more
    ab, ac = on_d + xi * on_c, ac + square * on_c
    cc, bc = (bc + more) + square * on_c, bc + square * on_c
    return g[0] + on_c, g[1] + ab, g[2] + ac, g[3] + (ac + on_h), g[4] + xi * bc, g[5] + square * cc


@part
def matrix_times(g, p):
    """Half the gradient with respect to A, B, C of one line: the matrix of `add_invariants` times
    them.
    """
    return (
        g[0] * p[0] + g[1] * p[1] + g[2] * p[2],
        g[1] * p[0] + g[3] * p[1] + g[4] * p[2],
        g[2] * p[0] + g[4] * p[1] + g[5] * p[2],
    )


@part
def elastic_force(shape, model, x, out):
    """out -= dU/dq of stretching and bending."""
    terms = shape[layout.TERMS]
    if not terms & (layout.ANY_STRETCH | layout.BEND):
        return
    width, stride = shape[layout.LINE], shape[layout.STRIDE]
    # Terms that the scene lacks are factors of zero, without branches in the loop over the samples;
    # c > 0, as r' vanishes nowhere.
    stretches = 1.0 if terms & layout.ANY_STRETCH else 0.0
    sampled = 1.0 if terms & layout.STRETCH else 0.0
    bends = 1.0 if terms & layout.BEND else 0.0
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        axial = stretches * load(model, block + layout.AXIAL * LANES)
        bending = bends * s * s * load(model, block + layout.BENDING * LANES)
        p = curve(shape, model, x, b, 1.0)
        mean, linear = zero(), zero()
        if terms & layout.SPAN_STRETCH:
            mean, linear = span_strains(shape, model, block, p)
            linear = linear * load(model, block + layout.LINEAR * LANES)
        mean -= sampled  # so that sampled c + mean |r'| is c - |r'|
        inner = products(p)
        g = guard_gradient(shape, model, block, inner)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            c, d, h = invariants_at(inner, xi)
            inverse = 1.0 / c
            stretched = sampled * c + (mean + xi * linear) * root(c)
            on_c, on_d, on_h = bend.gradient(w * bending, d, h, inverse)
            on_c += stretch.gradient(w * axial, stretched, inverse)
            g = add_invariants(g, on_c, on_d, on_h, xi)
        # Each line by itself, inlined: with `scatter_lines` a step takes 4 to 7 % more.
        at = layout.MARGIN * stride + LANES * b
        scatter(matrix_times(g, p[0]), at, stride, model, block, -2.0, out)
        scatter(matrix_times(g, p[1]), at + width, stride, model, block, -2.0, out)
        if shape[layout.DIM] == 3:
            scatter(matrix_times(g, p[2]), at + 2 * width, stride, model, block, -2.0, out)


@part
def elastic_energy(shape, model, x):
    """Stretching and bending energy [J], as partial sums."""
    terms = shape[layout.TERMS]
    stretching, bent = zero(), zero()
    if not terms & (layout.ANY_STRETCH | layout.BEND):
        return stretching, bent
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        axial, bending = (
            load(model, block + layout.AXIAL * LANES),
            load(model, block + layout.BENDING * LANES),
        )
        s = load(model, block + layout.SLOPE * LANES)
        p = curve(shape, model, x, b, 1.0)
        stretching += guard_energy(shape, model, block, products(p))
        if terms & layout.SPAN_STRETCH:
            mean, slope = span_strains(shape, model, block, p)
            f = mean * mean + load(model, block + layout.LINEAR * LANES) * slope * slope
            # avoids 1/0 on lanes beyond the last span
            length = 1.0 / (
                load(model, block + layout.SHARE * LANES)
                + load(model, block + layout.PADDING * LANES)
            )
            stretching += 0.5 * axial * length * f
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            c = dot(t, t)
            if terms & layout.STRETCH:
                stretching += w * stretch.energy(axial, c)
            if terms & layout.BEND:
                bent += w * bend.energy(bending, t, k, c)
    return stretching, bent
