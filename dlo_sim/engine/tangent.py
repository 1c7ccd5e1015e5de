"""Exact Jacobian of the discrete gradient with respect to the new configuration, as a band matrix.

For equal configurations it is half the Hessian of the elastic energy. The dependence of the viscous
forces on the geometry is left out. One cable only.

Entry (r, c) of the matrix over all spatial unknowns, control point i and line d at i dim + d, is
stored at r width + c - r + 4 dim - 1, width 16 in a plane and 32 in space, so that a row operation
runs over whole vectors.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, size, store, total, zero
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.discrete import mean
from dlo_sim.engine.elastic import (
    bending_at,
    block_of,
    curve,
    dot,
    matrix_times,
    products,
    sample_of,
    span_strains,
    store_three,
    tangent_at,
)
from dlo_sim.engine.natural_curvature import natural_at
from dlo_sim.engine.span_guard import discrete_guard_gradient, guard_jacobian
from dlo_sim.terms import bend, natural_curvature, span_guard, stretch, viscosity
from dlo_sim.terms.viscosity import combined

# Rows of `scratch` per sample: midpoint vectors and the factors of the Jacobian's dyads.
T, K, X1, Y1, X2, Y2, X3, DIAGONAL = 0, 3, 6, 9, 12, 15, 18, 21
KN, NT, XE, SKEW = 24, 27, 30, 33  # natural curvature
NORMAL, VISCOUS, ALONG, RATIO, INVERSE_C = 36, 39, 40, 41, 42  # viscosity
THINNED_T, THINNED_K = 43, 46  # rate-thinning viscosity (`viscosity.thinned`)
SAMPLE_ROWS = 49
# After the samples: moments with 1, xi, xi^2, xi^3 of the directions of force, strain and strain
# rate, for the strain projected on a span.
FORCE_MOMENTS, STRAIN_MOMENTS, FLOW_MOMENTS, MOMENT_ROWS = 0, 12, 24, 36


@part
def add_moments(array, at, f, t, xi):
    """Add f t (1, xi, xi^2, xi^3) to twelve rows of moments."""
    for p in range(4):
        for i in range(3):
            to = at + (3 * p + i) * LANES
            store(array, to, load(array, to) + f * t[i])
        f = f * xi


@part
def factor_samples(shape, model, state, b, p, q, viscous, scratch):
    """Compute the factors of the Jacobian's dyads at all samples of a block, and its moments."""
    terms = shape[layout.TERMS]
    block = block_of(shape, b)
    axial, bending = (
        load(model, block + layout.AXIAL * LANES),
        load(model, block + layout.BENDING * LANES),
    )
    s = load(model, block + layout.SLOPE * LANES)
    moments = shape[layout.SAMPLES] * SAMPLE_ROWS * LANES
    thinning = viscous * viscous * load(model, shape[layout.SCALES] + layout.THINNING * LANES)
    strain, linear = zero(), zero()
    if terms & layout.SPAN_STRETCH:
        m0, l0 = span_strains(shape, model, block, p)
        m1, l1 = span_strains(shape, model, block, q)
        strain = 0.5 * (m0 + m1)
        linear = 0.5 * load(model, block + layout.LINEAR * LANES) * (l0 + l1)
        for row in range(MOMENT_ROWS):
            store(scratch, moments + row * LANES, 0.0)
    for j in range(shape[layout.SAMPLES]):
        at, z = sample_of(block, j), j * SAMPLE_ROWS * LANES
        xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
        ta, ka, tb, kb = (
            tangent_at(p, xi),
            bending_at(p, xi, s),
            tangent_at(q, xi),
            bending_at(q, xi, s),
        )
        c0, c1 = dot(ta, ta), dot(tb, tb)
        s0, s1 = root(c0), root(c1)
        on_c, on_d, on_h = zero(), zero(), zero()
        cc, cd, ch, dc, dd, hc = zero(), zero(), zero(), zero(), zero(), zero()
        t, k = mean(ta, tb), mean(ka, kb)
        if terms & layout.STRETCH:
            counted = 0.5 * (stretch.strain(c0) + stretch.strain(c1))
            on_c += stretch.mean_gradient(axial, s0, s1, counted)
            fixed, changed = stretch.mean_hessian(axial, s0, s1, counted)
            cc += fixed + changed
        if terms & layout.SPAN_STRETCH:
            counted = strain + xi * linear
            on_c += stretch.mean_gradient(axial, s0, s1, counted)
            cc += stretch.mean_hessian(axial, s0, s1, counted)[0]
            both = combined(1.0, ta, 1.0, tb)
            add_moments(scratch, moments + FORCE_MOMENTS * LANES, w / (s0 + s1), both, xi)
            add_moments(scratch, moments + STRAIN_MOMENTS * LANES, w / s1, tb, xi)
            f = w / root(dot(both, both))
            add_moments(scratch, moments + FLOW_MOMENTS * LANES, f, both, xi)
        if terms & layout.BEND:
            d0, h0, d1, h1 = dot(ta, ka), dot(ka, ka), dot(tb, kb), dot(kb, kb)
            more = bend.mean_gradient(bending, c0, d0, h0, c1, d1, h1)
            on_c += more[0]
            on_d += more[1]
            on_h += more[2]
            slopes = bend.mean_hessian(bending, c0, d0, h0, c1, d1, h1)
            cc += slopes[0]
            cd, ch, dc, dd, hc = slopes[1], slopes[2], slopes[3], slopes[4], slopes[5]
        # Chain rule with dc1 = 2 t.dt, dd1 = k.dt + t.dk, dh1 = 2 k.dk at configuration 1.
        store_three(scratch, z + T * LANES, t)
        store_three(scratch, z + K * LANES, k)
        store_three(scratch, z + X1 * LANES, combined(4.0 * w * cc, tb, 2.0 * w * cd, kb))
        store_three(scratch, z + Y1 * LANES, combined(2.0 * w * cd, tb, 4.0 * w * ch, kb))
        store_three(scratch, z + X2 * LANES, combined(2.0 * w * dc, tb, w * dd, kb))
        store_three(scratch, z + Y2 * LANES, combined(w * dd, tb, 0.0, kb))
        store_three(scratch, z + X3 * LANES, combined(4.0 * w * hc, tb, 0.0, kb))
        store_three(scratch, z + DIAGONAL * LANES, (w * on_c, 0.5 * w * on_d, w * on_h))
        if terms & layout.CURVED:
            factor_natural(shape, model, state, b, j, ta, ka, tb, kb, t, k, z, scratch)
        if viscous != 0.0:
            ratio, n, inverse = viscosity.curvature_of(t, k)
            g = zero()
            if terms & layout.BEND:
                g = viscous * w * bending * load(model, shape[layout.BETA] + LANES)
                if terms & layout.THINNED:
                    moved = combined(1.0, tb, -1.0, ta), combined(1.0, kb, -1.0, ka)
                    g, thinned_t, thinned_k = viscosity.thinned(
                        g, thinning, ratio, n, inverse, t, *moved
                    )
                    store_three(scratch, z + THINNED_T * LANES, thinned_t)
                    store_three(scratch, z + THINNED_K * LANES, thinned_k)
                g = g * inverse * inverse
            along = 4.0 * g * dot(n, n)
            if terms & layout.STRETCH:
                along += viscous * w * axial * load(model, shape[layout.BETA]) * inverse
            store_three(scratch, z + NORMAL * LANES, n)
            store_three(scratch, z + VISCOUS * LANES, (g, along, ratio))
            store(scratch, z + INVERSE_C * LANES, inverse)


@part
def factor_natural(shape, model, state, b, j, ta, ka, tb, kb, t, k, z, scratch):
    """Add the natural and plastic curvature to the factors of sample j."""
    n = natural_at(shape, model, state, b, j)
    c0, c1 = dot(ta, ta), dot(tb, tb)
    e0, e1 = natural_curvature.triple(n, ta, ka), natural_curvature.triple(n, tb, kb)
    on_c, on_e = natural_curvature.mean_gradient(c0, c1, e0, e1)
    cc, ce, ec = natural_curvature.mean_hessian(c0, c1, e0, e1)
    kn, nt = natural_curvature.cross(kb, n), natural_curvature.cross(n, tb)
    more = combined(4.0 * cc, tb, 2.0 * ce, kn)
    for i in range(3):
        to = z + (X1 + i) * LANES
        store(scratch, to, load(scratch, to) + more[i])
        to = z + (Y1 + i) * LANES
        store(scratch, to, load(scratch, to) + 2.0 * ce * nt[i])
    store(scratch, z + DIAGONAL * LANES, load(scratch, z + DIAGONAL * LANES) + on_c)
    store_three(scratch, z + KN * LANES, natural_curvature.cross(k, n))
    store_three(scratch, z + NT * LANES, natural_curvature.cross(n, t))
    store_three(scratch, z + XE * LANES, combined(2.0 * ec, tb, 0.0, tb))
    store_three(scratch, z + SKEW * LANES, combined(0.5 * on_e, n, 0.0, n))


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, REAL, REAL),
    *(NUMBERS, NUMBERS),
)
def add_tangent(shape, model, state, x0, x1, viscous, scale, scratch, band):
    """band += scale times the Jacobian, with respect to x1, of the discrete gradient between x0 and
    x1. The viscous part is `viscous` [1/s] times the damping matrix; 0 leaves it out.
    """
    dim = shape[layout.DIM]
    for b in range(shape[layout.BLOCKS]):
        p, q = curve(shape, model, x0, b, 1.0), curve(shape, model, x1, b, 1.0)
        factor_samples(shape, model, state, b, p, q, viscous, scratch)
        for i in range(dim):
            for j in range(dim):
                add_entry(shape, model, b, i, j, viscous, scale, scratch, band)
        add_guard(shape, model, b, p, q, scale, scratch, band)


@part
def add_guard(shape, model, b, p, q, scale, scratch, band):
    """Add the Jacobian of the span guard on a block: a sum of products of gradients of the
    functions in `span_guard.FORMS`, at the midpoint and at the new configuration.
    """
    block, before, after = block_of(shape, b), products(p), products(q)
    gradient = discrete_guard_gradient(shape, model, block, before, after)
    active = zero()
    for one in gradient:
        active += size(one)
    if total(active) == 0.0:
        return
    factors, middle, new = guard_jacobian(shape, model, block, before, after)
    g0, g1, g2, g3, g4, g5 = gradient
    for i in range(shape[layout.DIM]):
        m = combined(1.0, p[i], 1.0, q[i])
        for j in range(shape[layout.DIM]):
            unit = 1.0 if i == j else 0.0
            h = (
                (unit * g0, unit * g1, unit * g2),
                (unit * g1, unit * g3, unit * g4),
                (unit * g2, unit * g4, unit * g5),
            )
            h = add_dyad(h, 1.0, matrix_times(middle, m), matrix_times(new, q[j]))
            for k in range(len(span_guard.FORMS)):
                form = span_guard.FORMS[k]
                h = add_dyad(h, factors[k], matrix_times(form, m), matrix_times(form, q[j]))
            scatter_entry(shape, model, b, i, j, h[0], h[1], h[2], scale, scratch, band)


@part
def add_dyad(h, factor, left, right):
    """h + factor left right^T, 3 x 3."""
    return (
        combined(1.0, h[0], factor * left[0], right),
        combined(1.0, h[1], factor * left[1], right),
        combined(1.0, h[2], factor * left[2], right),
    )


@part
def four_rows(array, at):
    """Load four rows with a distance of three."""
    step = 3 * LANES
    return (
        load(array, at),
        load(array, at + step),
        load(array, at + 2 * step),
        load(array, at + 3 * step),
    )


@part
def add_products(h, one, next_, r):
    """h_q + one r_q + next_ r_(q + 1)."""
    return (
        h[0] + one * r[0] + next_ * r[1],
        h[1] + one * r[1] + next_ * r[2],
        h[2] + one * r[2] + next_ * r[3],
    )


@part
def blocks_of(shape, z, i, j, viscous, scratch):
    """Entry (i, j) of a sample's Jacobian blocks tt, tk, kt, kk: gradient on t or k by t or k."""
    unit = 1.0 if i == j else 0.0
    t, k = load(scratch, z + (T + i) * LANES), load(scratch, z + (K + i) * LANES)
    x2, y2 = load(scratch, z + (X2 + j) * LANES), load(scratch, z + (Y2 + j) * LANES)
    mixed = unit * load(scratch, z + (DIAGONAL + 1) * LANES)
    tt = t * load(scratch, z + (X1 + j) * LANES) + k * x2
    tt += unit * load(scratch, z + DIAGONAL * LANES)
    tk = t * load(scratch, z + (Y1 + j) * LANES) + k * y2 + mixed
    kt = k * load(scratch, z + (X3 + j) * LANES) + t * x2 + mixed
    kk = t * y2 + unit * load(scratch, z + (DIAGONAL + 2) * LANES)
    if shape[layout.TERMS] & layout.CURVED:
        e = load(scratch, z + (XE + j) * LANES)
        tt += load(scratch, z + (KN + i) * LANES) * e
        kt += load(scratch, z + (NT + i) * LANES) * e
        if i != j:
            # ([n]_x)_ij = - eps_ijk n_k
            skew = load(scratch, z + (SKEW + 3 - i - j) * LANES)
            if (j - i) % 3 != 1:
                skew = -skew
            tk += skew
            kt -= skew
    if viscous != 0.0:
        t_j = load(scratch, z + (T + j) * LANES)
        n_i = load(scratch, z + (NORMAL + i) * LANES)
        n_j = load(scratch, z + (NORMAL + j) * LANES)
        g, q = load(scratch, z + VISCOUS * LANES), load(scratch, z + RATIO * LANES)
        inverse = load(scratch, z + INVERSE_C * LANES)
        more = viscosity.tangent_blocks(g, q, n_i, n_j, t, t_j, unit, inverse)
        tt += more[0] + load(scratch, z + ALONG * LANES) * t * t_j
        tk += more[1]
        kt += more[2]
        kk += more[3]
        if shape[layout.TERMS] & layout.THINNED:
            t_i, k_i = (
                load(scratch, z + (THINNED_T + i) * LANES),
                load(scratch, z + (THINNED_K + i) * LANES),
            )
            t_j, k_j = (
                load(scratch, z + (THINNED_T + j) * LANES),
                load(scratch, z + (THINNED_K + j) * LANES),
            )
            tt -= t_i * t_j
            tk -= t_i * k_j
            kt -= k_i * t_j
            kk -= k_i * k_j
    return tt, tk, kt, kk


@part
def add_entry(shape, model, b, i, j, viscous, scale, scratch, band):
    """Add entry (i, j), between two lines, of the Jacobian of a block's spans to `band`."""
    terms, block = shape[layout.TERMS], block_of(shape, b)
    s = load(model, block + layout.SLOPE * LANES)
    h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = zero()
    for sample in range(shape[layout.SAMPLES]):
        y = load(model, sample_of(block, sample) + layout.XI * LANES)
        tt, tk, kt, kk = blocks_of(shape, sample * SAMPLE_ROWS * LANES, i, j, viscous, scratch)
        tk, kt, kk = s * tk, s * kt, s * s * kk
        a, c = y * tt, tk + tk
        h00 += tt
        h01 += a + tk
        h02 += y * (a + c)
        h10 += a + kt
        m = y * (a + tk + kt) + kk
        h11 += m
        h12 += y * (m + y * tk + kk)
        h20 += y * (a + kt + kt)
        h21 += y * (m + y * kt + kk)
        h22 += y * y * (y * (a + c + kt + kt) + 4.0 * kk)
    h0, h1, h2 = (h00, h01, h02), (h10, h11, h12), (h20, h21, h22)
    if terms & layout.SPAN_STRETCH:
        f = (
            0.5
            * load(model, block + layout.AXIAL * LANES)
            * load(model, block + layout.SHARE * LANES)
        )
        linear = load(model, block + layout.LINEAR * LANES)
        moments = shape[layout.SAMPLES] * SAMPLE_ROWS * LANES
        left, right = moments + FORCE_MOMENTS * LANES, moments + STRAIN_MOMENTS * LANES
        for flow in range(2 if viscous != 0.0 else 1):
            if flow == 1:
                left = right = moments + FLOW_MOMENTS * LANES
                f = 2.0 * viscous * load(model, shape[layout.BETA]) * f
            m, r = four_rows(scratch, left + i * LANES), four_rows(scratch, right + j * LANES)
            h0 = add_products(h0, f * m[0], f * linear * m[1], r)
            h1 = add_products(h1, f * m[1], f * linear * m[2], r)
            h2 = add_products(h2, f * m[2], f * linear * m[3], r)
    scatter_entry(shape, model, b, i, j, h0, h1, h2, scale, scratch, band)


@part
def scatter_entry(shape, model, b, i, j, h0, h1, h2, scale, scratch, band):
    """band += scale times the Jacobian (h0, h1, h2) in A, B, C of two lines, by control points."""
    dim, block = shape[layout.DIM], block_of(shape, b)
    half, width = 4 * dim - 1, 16 * (dim - 1)
    spans = min(LANES, shape[layout.N] - 3 - LANES * b)
    to = shape[layout.SAMPLES] * SAMPLE_ROWS * LANES + MOMENT_ROWS * LANES
    for k in range(4):
        row = block + 3 * k * LANES
        e0, e1, e2 = load(model, row), load(model, row + LANES), load(model, row + 2 * LANES)
        r0 = scale * (e0 * h0[0] + e1 * h1[0] + e2 * h2[0])
        r1 = scale * (e0 * h0[1] + e1 * h1[1] + e2 * h2[1])
        r2 = scale * (e0 * h0[2] + e1 * h1[2] + e2 * h2[2])
        for other in range(4):
            row = block + 3 * other * LANES
            f = r0 * load(model, row) + r1 * load(model, row + LANES)
            store(scratch, to, f + r2 * load(model, row + 2 * LANES))
            at = ((LANES * b + k) * dim + i) * width + (other - k) * dim + j - i + half
            for span in range(spans):
                band[at + dim * width * span] += scratch[to + span]
