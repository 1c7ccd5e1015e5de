"""Forces on LANES cables at once, and the solve with their mass matrices.

The formulas and their order are those of `kernels.elastic`, `forces` and `banded`.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.batch_layout import add_scaled, clear, clear_row, put
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import LANES


@kernel
def start_force(gravity, out):
    """out = weight, or zero."""
    if gravity is not None:
        put(gravity, out)
    else:
        clear(out)


@kernel
def row_coefficients(q0, q1, q2, q3, a, slope, p0, p1, p2):
    """A, B, C of r' = A + B xi + C xi^2 from four control points."""
    a00, a01, a02, a10, a11, a12 = a[0], a[1], a[2], a[3], a[4], a[5]
    a20, a21, a22, a30, a31, a32 = a[6], a[7], a[8], a[9], a[10], a[11]
    for e in range(q0.shape[0]):
        s = slope[e]
        p0[e] = s * (a00 * q0[e] + a10 * q1[e] + a20 * q2[e] + a30 * q3[e])
        p1[e] = s * (a01 * q0[e] + a11 * q1[e] + a21 * q2[e] + a31 * q3[e])
        p2[e] = s * (a02 * q0[e] + a12 * q1[e] + a22 * q2[e] + a32 * q3[e])


@kernel
def span_coefficients(x, extraction, slope, span, p):
    """Coefficients of r' = A + B xi + C xi^2 on one span of every lane: rows (A, B, C) x dim."""
    width = x.shape[1]
    row_coefficients(
        x[span],
        x[span + 1],
        x[span + 2],
        x[span + 3],
        extraction[span],
        slope,
        p[:width],
        p[width : 2 * width],
        p[2 * width :],
    )


@kernel
def row_scatter(g0, g1, g2, e0, e1, e2, slope, out):
    """out -= slope (e0 g0 + e1 g1 + e2 g2)."""
    for e in range(out.shape[0]):
        out[e] -= slope[e] * (e0 * g0[e] + e1 * g1[e] + e2 * g2[e])


@kernel
def scatter_span(g, extraction, slope, span, out):
    """out -= transpose of `span_coefficients` applied to g."""
    width = out.shape[1]
    g0, g1, g2 = g[:width], g[width : 2 * width], g[2 * width :]
    a = extraction[span]
    for k in range(4):
        row_scatter(g0, g1, g2, a[3 * k], a[3 * k + 1], a[3 * k + 2], slope, out[span + k])


@kernel
def mean_strain(p, xi, weights, slope, dim, sums):
    """Add one sample's strain to m and l of every lane; see `kernels.span_stretch`."""
    for lane in range(weights.shape[0]):
        t0 = p[lane] + xi * (p[dim * LANES + lane] + xi * p[2 * dim * LANES + lane])
        b1, c1 = p[(dim + 1) * LANES + lane], p[(2 * dim + 1) * LANES + lane]
        t1 = p[LANES + lane] + xi * (b1 + xi * c1)
        t2 = 0.0
        if dim == 3:
            t2 = p[2 * LANES + lane] + xi * (p[5 * LANES + lane] + xi * p[8 * LANES + lane])
        c = t0 * t0 + t1 * t1 + t2 * t2
        part = 0.5 * slope[lane] * weights[lane] * (c - 1.0) / (np.sqrt(c) + 1.0)
        sums[lane] += part
        sums[LANES + lane] += xi * part


@kernel
def mean_strains(p, xi, weights, slope, spans, dim):
    """m and l of one span of every lane; see `kernels.span_stretch`."""
    if spans is not None:
        clear_row(spans.sums)
        for j in range(xi.shape[0]):
            mean_strain(p, xi[j], weights[j], slope, dim, spans.sums)


@kernel
def sample_gradient(p, xi, weights, slope, stretch, spans, linear, bend, axes, g):
    """Add one sample's gradient with respect to A, B, C; see `kernels.elastic.span_gradient`."""
    dim = len(axes)
    for lane in range(LANES):
        s = slope[lane]
        w = weights[lane]
        a0, b0, c0 = p[lane], p[dim * LANES + lane], p[2 * dim * LANES + lane]
        a1, b1 = p[LANES + lane], p[(dim + 1) * LANES + lane]
        c1 = p[(2 * dim + 1) * LANES + lane]
        t0 = a0 + xi * (b0 + xi * c0)
        t1 = a1 + xi * (b1 + xi * c1)
        k0 = s * (b0 + 2.0 * xi * c0)
        k1 = s * (b1 + 2.0 * xi * c1)
        c = t0 * t0 + t1 * t1
        h = k0 * k0 + k1 * k1
        e = t0 * k0 + t1 * k1
        t2 = 0.0
        k2 = 0.0
        if dim == 3:
            a2, b2 = p[2 * LANES + lane], p[5 * LANES + lane]
            c2 = p[8 * LANES + lane]
            t2 = a2 + xi * (b2 + xi * c2)
            k2 = s * (b2 + 2.0 * xi * c2)
            c += t2 * t2
            h += k2 * k2
            e += t2 * k2
        ic = 1.0 / c
        along_t = 0.0  # dU/dt = along_t t + cross k, dU/dk = along_k k + cross t
        cross = 0.0
        along_k = 0.0
        if stretch is not None:
            along_t += stretch[lane] * w * (1.0 - np.sqrt(c) * ic)
        if spans is not None:
            strain = spans.sums[lane] + linear * xi * spans.sums[LANES + lane]
            along_t += spans.stiffness[lane] * w * np.sqrt(ic) * strain
        if bend is not None:
            f = bend[lane] * w * ic * ic
            along_k = f
            cross = -f * e * ic
            along_t += f * ic * (3.0 * e * e * ic - 2.0 * h)
        gt0 = along_t * t0 + cross * k0
        gt1 = along_t * t1 + cross * k1
        gk0 = s * (along_k * k0 + cross * t0)
        gk1 = s * (along_k * k1 + cross * t1)
        g[lane] += gt0
        g[LANES + lane] += gt1
        g[dim * LANES + lane] += xi * gt0 + gk0
        g[(dim + 1) * LANES + lane] += xi * gt1 + gk1
        g[2 * dim * LANES + lane] += xi * (xi * gt0 + 2.0 * gk0)
        g[(2 * dim + 1) * LANES + lane] += xi * (xi * gt1 + 2.0 * gk1)
        if dim == 3:
            gt2 = along_t * t2 + cross * k2
            gk2 = s * (along_k * k2 + cross * t2)
            g[2 * LANES + lane] += gt2
            g[5 * LANES + lane] += xi * gt2 + gk2
            g[8 * LANES + lane] += xi * (xi * gt2 + 2.0 * gk2)


@kernel
def linear_share(spans, span):
    """3 where a span's strain is linear, 0 where it is its mean."""
    if spans is not None:
        return spans.linear[span]
    return 0.0


@kernel
def add_elastic(x, xi, weights, extraction, slope, stretch, spans, bend, axes, p, g, out):
    """out += force of stretching and bending."""
    if stretch is not None or spans is not None or bend is not None:
        for span in range(xi.shape[0]):
            span_coefficients(x, extraction, slope, span, p)
            clear_row(g)
            mean_strains(p, xi[span], weights[span], slope, spans, len(axes))
            linear = linear_share(spans, span)
            for j in range(xi.shape[1]):
                w = weights[span, j]
                sample_gradient(p, xi[span, j], w, slope, stretch, spans, linear, bend, axes, g)
            scatter_span(g, extraction, slope, span, out)


@kernel
def pull_row(stiffness, anchor, x, out):
    """out -= stiffness (x - anchor)."""
    for e in range(out.shape[0]):
        out[e] -= stiffness[e] * (x[e] - anchor[e])


@kernel
def add_springs(x, springs, out):
    """out += force of the end springs."""
    if springs is not None:
        for end in range(2):
            i = end * (x.shape[0] - 1)
            pull_row(springs.stiffness[end], springs.anchor[end], x[i], out[i])


@kernel
def amplitudes(frequency, t, out):
    """1 for a constant load, sin(2 pi f t) otherwise, per lane and the same for each row."""
    for e in range(out.shape[0]):
        out[e] = 1.0
    for lane in range(LANES):
        if frequency[lane] != 0.0:
            value = np.sin(2.0 * np.pi * frequency[lane] * t)
            for e in range(lane, out.shape[0], LANES):
                out[e] = value


@kernel
def add_product(a, b, out):
    """out += a b, rows."""
    for e in range(out.shape[0]):
        out[e] += a[e] * b[e]


@kernel
def add_loads(loads, t, scratch, load, load_before, out):
    """out += loads at time t; they are remembered in `load`, the ones before in `load_before`."""
    if loads is not None:
        put(load, load_before)
        clear(load)
        for k in range(loads.frequency.shape[0]):
            amplitudes(loads.frequency[k], t, scratch)
            for i in range(load.shape[0]):
                add_product(scratch, loads.force[k, i], load[i])
        add_scaled(1.0, load, out)


@kernel
def eliminate(l0, l1, l2, scale, z0, z1, z2, x):
    """One row of a triangular solve; z0, z1, z2 are the three results before it.

    As arrays of their own they let the compiler see that nothing interferes.
    """
    for e in range(x.shape[0]):
        value = scale[e] * x[e] - l2[e] * z2[e] - l1[e] * z1[e] - l0[e] * z0[e]
        z2[e] = z1[e]
        z1[e] = z0[e]
        z0[e] = value
        x[e] = value


@kernel
def solve(lower, upper, inverse_diagonal, one, chain, x):
    """x <- (L D L^T)^-1 x in place, all rows and lanes; prescribed entries become 0."""
    n = x.shape[0]
    z0, z1, z2 = chain[0], chain[1], chain[2]
    clear(chain)
    for i in range(n):
        eliminate(lower[i, 0], lower[i, 1], lower[i, 2], one, z0, z1, z2, x[i])
    clear(chain)
    for back in range(n):
        i = n - 1 - back
        scale = inverse_diagonal[i]
        eliminate(upper[i, 0], upper[i, 1], upper[i, 2], scale, z0, z1, z2, x[i])
