"""Discrete gradient of the elastic energy between two configurations, and viscous stresses.

For configurations 0 and 1 the discrete gradient g(0, 1) satisfies
    g(0, 1) . (q1 - q0) = U(q1) - U(q0)      and      g(q, q) = grad U(q)
exactly, so a step that uses it as its force keeps the energy to the solver's tolerance. The energy
depends on q only through invariants that are bilinear in r' and r'', whose increments are exact at
the midpoint, c1 - c0 = 2 r'_m.(r'_1 - r'_0); the terms give divided differences in these, so
momentum and angular momentum are conserved too (Simo & Tarnow 1992; Gonzalez 1996, applied per
quadrature point). Viscosity is evaluated at the midpoint.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, total, zero
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import (
    add_sample,
    bending_at,
    block_of,
    curve,
    dot,
    matrix_times,
    products,
    sample_of,
    scatter_lines,
    span_strains,
    tangent_at,
)
from dlo_sim.engine.span_guard import discrete_guard_gradient
from dlo_sim.terms import bend, stretch, viscosity
from dlo_sim.terms.viscosity import combined


@part
def mean(a, b):
    """Mean of two vectors."""
    return combined(0.5, a, 0.5, b)


@part
def span_rates(shape, model, block, p, q, moved):
    """m and l (`engine.elastic`) of the strain increment in a motion `moved`, at the midpoint."""
    average, slope = zero(), zero()
    share = load(model, block + layout.SHARE * LANES)
    for j in range(shape[layout.SAMPLES]):
        at = sample_of(block, j)
        xi = load(model, at + layout.XI * LANES)
        t = mean(tangent_at(p, xi), tangent_at(q, xi))
        f = share * load(model, at + layout.QUADRATURE * LANES)
        f = f * dot(t, tangent_at(moved, xi)) / root(dot(t, t))
        average += f
        slope += xi * f
    return average, slope


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, REAL),
    *(NUMBERS, NUMBERS),
)
def discrete_force(shape, model, state, x0, x1, moved, viscous, out, lost):
    """out -= discrete gradient between x0 and x1, and viscous forces for the strain rates
    `viscous` times the strain increments of `moved`; `viscous` is 1 / tau [1/s], 0 leaves them out.

    lost[0] gets the energy dissipated by viscosity [J].
    """
    terms = shape[layout.TERMS]
    thinning = viscous * viscous * load(model, shape[layout.SCALES] + layout.THINNING * LANES)
    taken = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        axial, bending = (
            load(model, block + layout.AXIAL * LANES),
            load(model, block + layout.BENDING * LANES),
        )
        s = load(model, block + layout.SLOPE * LANES)
        p, q = curve(shape, model, x0, b, 1.0), curve(shape, model, x1, b, 1.0)
        r = p
        if viscous != 0.0:
            r = curve(shape, model, moved, b, 0.0)
        strain, linear, rate, rate_linear = zero(), zero(), zero(), zero()
        if terms & layout.SPAN_STRETCH:
            m0, l0 = span_strains(shape, model, block, p)
            m1, l1 = span_strains(shape, model, block, q)
            f = load(model, block + layout.LINEAR * LANES)
            strain, linear = 0.5 * (m0 + m1), 0.5 * f * (l0 + l1)
            if viscous != 0.0:
                rate, rate_linear = span_rates(shape, model, block, p, q, r)
                rate_linear = f * rate_linear
        guard = discrete_guard_gradient(shape, model, block, products(p), products(q))
        g0 = matrix_times(guard, combined(1.0, p[0], 1.0, q[0]))
        g1 = matrix_times(guard, combined(1.0, p[1], 1.0, q[1]))
        g2 = matrix_times(guard, combined(1.0, p[2], 1.0, q[2]))
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            ta, ka = tangent_at(p, xi), bending_at(p, xi, s)
            tb, kb = tangent_at(q, xi), bending_at(q, xi, s)
            c0, c1 = dot(ta, ta), dot(tb, tb)
            on_c, on_d, on_h = zero(), zero(), zero()
            if terms & layout.STRETCH:
                counted = 0.5 * (stretch.strain(c0) + stretch.strain(c1))
                on_c += stretch.mean_gradient(axial, root(c0), root(c1), counted)
            if terms & layout.SPAN_STRETCH:
                counted = strain + xi * linear
                on_c += stretch.mean_gradient(axial, root(c0), root(c1), counted)
            if terms & layout.BEND:
                more = bend.mean_gradient(
                    bending, c0, dot(ta, ka), dot(ka, ka), c1, dot(tb, kb), dot(kb, kb)
                )
                on_c += more[0]
                on_d += more[1]
                on_h += more[2]
            on_c, on_d, on_h = 2.0 * w * on_c, w * on_d, 2.0 * w * on_h
            t, k = mean(ta, tb), mean(ka, kb)
            on_t, on_k = combined(on_c, t, on_d, k), combined(on_h, k, on_d, t)
            if viscous != 0.0:
                dt, dk = tangent_at(r, xi), bending_at(r, xi, s)
                f = viscous * w * axial * load(model, shape[layout.BETA])
                along, inverse = dot(t, dt), 1.0 / dot(t, t)
                pull = zero()
                if terms & layout.STRETCH:
                    pull += f * along * inverse
                if terms & layout.SPAN_STRETCH:
                    pull += f * (rate + xi * rate_linear) * root(inverse)
                on_t = combined(1.0, on_t, pull, t)
                taken += pull * along
                if terms & layout.BEND:
                    f = viscous * w * bending * load(model, shape[layout.BETA] + LANES)
                    more_t, g, rho, energy = viscosity.bending(f, thinning, t, k, dt, dk)
                    on_t = combined(1.0, on_t, 1.0, more_t)
                    on_k = combined(1.0, on_k, g, rho)
                    taken += energy
            g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
            g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
            g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
        scatter_lines(shape, model, b, g0, g1, g2, -1.0, out)
    lost[0] = total(taken)
