"""Stretching and bending of the cable, with the span guard and viscosity: energy, force, discrete
gradient; and the Jacobian of all that is integrated at the quadrature points, with twist
(`engine.bishop`) and natural shape: loops over the spans, eight at a time.

Energy and force. The energy densities (`terms`) depend on c = t . t, d = t . k and h = k . k only.
On a span t = A + B xi + C xi^2, so these are polynomials in xi whose coefficients are the inner
products of A, B and C; the gradient with respect to A, B, C is a symmetric 3 x 3 matrix times
(A, B, C), the same for every line. Forces therefore need no loop over the lines at a sample.

Stretching by span (bit SPAN_STRETCH) avoids membrane locking: a bent span cannot have |r'| = 1 at
all of its samples, so with EA/EI of a thin cable the sampled stretching energy would suppress
bending. The axial strain is therefore projected onto constants, and onto linear functions in the
first and the last span: n - 1 numbers, as many as r' has degrees of freedom along a straight cable.
With m = 1/h integral eps du, l = 1/h integral eps xi du, f = 3 where linear, else 0, the energy is
EA h/2 (m^2 + f l^2), and the projected strain at a sample is m + f xi l. What this leaves free is
bounded by the span guard (`engine.span_guard`), a part of any stretching energy.

Discrete gradient. For configurations 0 and 1 it satisfies
    g(0, 1) . (q1 - q0) = U(q1) - U(q0)      and      g(q, q) = grad U(q)
exactly, so a step that uses it as its force keeps the energy to the solver's tolerance. The energy
depends on q only through invariants that are bilinear in r' and r'', whose increments are exact at
the midpoint, c1 - c0 = 2 r'_m.(r'_1 - r'_0); the terms give divided differences in these, so
momentum and angular momentum are conserved too (Simo & Tarnow 1992; Gonzalez 1996, applied per
quadrature point). Viscosity is evaluated at the midpoint.

The Jacobian is exact, with respect to the new configuration, except that the dependence of the
viscous forces on the geometry is left out, that its tension is the one that `engine.tension`
predicted, and that twist and natural shape are those in the middle of a short step. For equal
configurations it is half the Hessian of the energy. It is a band matrix over all unknowns
(`engine.arrays`).

Source of the projection: assumed natural strains, Bucalem & Bathe 1993, Int. J. Numer. Meth. Eng.
36, 3729-3754; for splines the B-bar projection of Elguedj et al. 2008, Comput. Methods Appl. Mech.
Eng. 197, 2732-2762.
"""

from __future__ import annotations

from numba import float64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane_sum, sqrt, zero
from dlo_sim.engine.arrays import (
    ANY_STRETCH,
    BEND,
    BETWEEN,
    BISHOP,
    CABLE,
    CURVED,
    IMPLICIT,
    LINES,
    MARGIN,
    MATERIAL,
    PLASTICITY,
    SPAN_STRETCH,
    STRETCH,
    THINNED,
)
from dlo_sim.engine.band import add_line
from dlo_sim.engine.natural_curvature import (
    density_gradient,
    density_jacobian,
    natural_with,
    triple,
    turn_polynomial,
    vector_now,
)
from dlo_sim.engine.plasticity import curvature, slip_derivative, slipping
from dlo_sim.engine.span_guard import (
    FORMS,
    discrete_guard_gradient,
    guard_energy,
    guard_gradient,
    guard_jacobian,
    may_act,
)
from dlo_sim.engine.spans import (
    add_sample,
    basis_at,
    bending_at,
    curve,
    integrated,
    matrix_times,
    products,
    scatter,
    scatter_lines,
    span_strains,
    store_three,
    tangent_at,
    three,
)
from dlo_sim.engine.tension import strain_rates
from dlo_sim.terms import bend, stretch, viscosity
from dlo_sim.terms.vectors import combined, cross, dot

# -- energy and force ------------------------------------------------------------------------------


@inline
def elastic_energy(cable, x):
    """Stretching and bending energy [J]."""
    mesh, terms = cable.mesh, cable.terms
    stretching, bent = zero(), zero()
    if not terms & (ANY_STRETCH | BEND):
        return 0.0, 0.0
    for b in range(cable.blocks):
        axial, bending, s = mesh.axial[b], mesh.bending[b], mesh.slope[b]
        p = curve(cable, x, b, 1.0)
        inner = products(p)
        if may_act(inner):
            stretching += guard_energy(cable, b, inner)
        if terms & SPAN_STRETCH:
            mean, slope = span_strains(mesh, b, p)
            length = 1.0 / (mesh.share[b] + mesh.padding[b])  # no 1/0 beyond the last span
            stretching += 0.5 * axial * length * (mean * mean + mesh.linear[b] * slope * slope)
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.weight[b, j]
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            c = dot(t, t)
            if terms & STRETCH:
                stretching += w * stretch.energy(axial, c)
            if terms & BEND:
                bent += w * bend.energy(bending, t, k, c)
    return lane_sum(stretching), lane_sum(bent)


@inline
def invariants_at(inner, xi):
    """c, d / s and h / s^2 at a local coordinate, from the inner products; s = d xi/du."""
    aa, ab, ac, bb, bc, cc = inner
    middle = bb + 2.0 * ac
    return (
        (aa + xi * (2.0 * ab)) + xi * xi * ((middle + xi * (2.0 * bc)) + xi * xi * cc),
        ab + xi * (middle + xi * (3.0 * bc + xi * (2.0 * cc))),
        bb + xi * (4.0 * bc + xi * (4.0 * cc)),
    )


@inline
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


@inline
def elastic_force(cable, x, out):
    """out -= dU/dq of stretching and bending."""
    mesh, terms = cable.mesh, cable.terms
    if not terms & (ANY_STRETCH | BEND):
        return
    # Terms that the scene lacks are factors of zero, without branches in the loop over the samples;
    # c > 0, as r' vanishes nowhere.
    stretches = 1.0 if terms & ANY_STRETCH else 0.0
    sampled = 1.0 if terms & STRETCH else 0.0
    bends = 1.0 if terms & BEND else 0.0
    tension, kept = cable.state.tension, cable.physics.keeps_length
    for b in range(cable.blocks):
        s = mesh.slope[b]
        axial, bending = stretches * mesh.axial[b], bends * s * s * mesh.bending[b]
        p = curve(cable, x, b, 1.0)
        mean, linear = zero(), zero()
        if terms & SPAN_STRETCH:
            mean, linear = span_strains(mesh, b, p)
            linear = linear * mesh.linear[b]
        mean -= sampled  # so that sampled c + mean |r'| is c - |r'|
        inner = products(p)
        g = guard_gradient(cable, b, inner)
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.weight[b, j]
            c, d, h = invariants_at(inner, xi)
            inverse = 1.0 / c
            strain = mean + xi * linear + kept * tension[b, j]
            stretched = sampled * c + strain * sqrt(c)
            on_c, on_d, on_h = bend.gradient(w * bending, d, h, inverse)
            on_c += stretch.gradient(w * axial, stretched, inverse)
            g = add_invariants(g, on_c, on_d, on_h, xi)
        # Each line by itself, inlined: with `scatter_lines` a step takes 4 to 7 % more.
        scatter(mesh, b, matrix_times(g, p[0]), -2.0, out[0])
        scatter(mesh, b, matrix_times(g, p[1]), -2.0, out[1])
        if cable.dim == 3:
            scatter(mesh, b, matrix_times(g, p[2]), -2.0, out[2])


# -- discrete gradient -----------------------------------------------------------------------------


@inline
def mean(a, b):
    """Mean of two vectors."""
    return combined(0.5, a, 0.5, b)


@kernel(float64, CABLE, LINES, LINES, LINES, float64, LINES, family=IMPLICIT | BETWEEN)
def discrete_force(cable, x0, x1, moved, viscous, out):
    """out -= discrete gradient between x0 and x1, and viscous forces for the strain rates
    `viscous` times the strain increments of `moved`; `viscous` is 1 / tau [1/s], 0 leaves them out.

    Returns the energy dissipated by viscosity [J].
    """
    mesh, terms = cable.mesh, cable.terms
    thinning = viscous * viscous * cable.physics.thinning
    beta_stretch, beta_bend = cable.physics.beta_stretch, cable.physics.beta_bend
    tension, kept = cable.state.tension, cable.physics.keeps_length
    taken = zero()
    for b in range(cable.blocks):
        axial, bending, s = mesh.axial[b], mesh.bending[b], mesh.slope[b]
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        r = p
        if viscous != 0.0:
            r = curve(cable, moved, b, 0.0)
        strain, linear, rate, rate_linear = zero(), zero(), zero(), zero()
        if terms & SPAN_STRETCH:
            m0, l0 = span_strains(mesh, b, p)
            m1, l1 = span_strains(mesh, b, q)
            f = mesh.linear[b]
            strain = 0.5 * ((1.0 - kept) * m0 + m1)
            linear = 0.5 * f * ((1.0 - kept) * l0 + l1)
            if viscous != 0.0:
                rate, rate_linear = strain_rates(mesh, b, p, q, r)
                rate_linear = f * rate_linear
        g0 = g1 = g2 = (zero(), zero(), zero())
        before, after = products(p), products(q)
        if may_act(before) or may_act(after):
            guard = discrete_guard_gradient(cable, b, before, after)
            g0 = matrix_times(guard, combined(1.0, p[0], 1.0, q[0]))
            g1 = matrix_times(guard, combined(1.0, p[1], 1.0, q[1]))
            g2 = matrix_times(guard, combined(1.0, p[2], 1.0, q[2]))
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.weight[b, j]
            ta, ka = tangent_at(p, xi), bending_at(p, xi, s)
            tb, kb = tangent_at(q, xi), bending_at(q, xi, s)
            c0, c1 = dot(ta, ta), dot(tb, tb)
            on_c, on_d, on_h = zero(), zero(), zero()
            if terms & STRETCH:
                projected = 0.5 * (stretch.strain(c0) + stretch.strain(c1))
                on_c += stretch.discrete_gradient(axial, sqrt(c0), sqrt(c1), projected)
            if terms & SPAN_STRETCH:
                projected = strain + xi * linear + kept * tension[b, j]
                on_c += stretch.discrete_gradient(axial, sqrt(c0), sqrt(c1), projected)
            if terms & BEND:
                more = bend.discrete_gradient(
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
                f = viscous * w * axial * beta_stretch
                along, inverse = dot(t, dt), 1.0 / dot(t, t)
                pull = zero()
                if terms & STRETCH:
                    pull += f * along * inverse
                if terms & SPAN_STRETCH:
                    pull += f * (rate + xi * rate_linear) * sqrt(inverse)
                on_t = combined(1.0, on_t, pull, t)
                taken += pull * along
                if terms & BEND:
                    f = viscous * w * bending * beta_bend
                    more_t, g, rho, energy = viscosity.bending(f, thinning, t, k, dt, dk)
                    on_t = combined(1.0, on_t, 1.0, more_t)
                    on_k = combined(1.0, on_k, g, rho)
                    taken += energy
            g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
            g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
            g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
        scatter_lines(cable, b, g0, g1, g2, -1.0, out)
    return lane_sum(taken)


# -- its Jacobian ----------------------------------------------------------------------------------


# Entries of `work.factors` by sample: t and k at the midpoint; right factors of their dyads; those
# of the unit matrix in tt, in tk and kt, in kk; those of the natural curvature and of viscosity.
T, K, X1, Y1, X2, Y2, X3, UNIT = 0, 3, 6, 9, 12, 15, 18, 21
KN, NT, XE, SKEW = 24, 27, 30, 33
NORMAL, VISCOUS, ALONG, RATIO, INVERSE_C, THINNED_T, THINNED_K = 36, 39, 40, 41, 42, 43, 46
# Of the twist: stiffness; G of `engine.bishop`, right factor of its dyad; moment times t and k; and
# of the natural curvature in the material frame: derivatives by theta, factors of its dyads.
KAPPA, G, XG, MT, MK = 49, 50, 53, 56, 59
NATURAL, T_THETA, K_THETA, THETA, LEAN, BINORMAL = 62, 65, 68, 71, 72, 75
SLIPPED, FLOW_T, FLOW_K = 78, 81, 87  # of plastic flow: p, and two dyads


@kernel(void, CABLE, LINES, LINES, float64, float64, float64, LINES)
def add_tangent(cable, x0, x1, viscous, twist, scale, band):
    """band += scale times the Jacobian, with respect to x1, of the discrete gradient between x0 and
    x1. The viscous part is `viscous` [1/s] times the damping matrix; 0 leaves it out. That of the
    twist, to first order in the step, has the moment of the last forces and this share `twist` of
    the torsional stiffness: 1/2 and its damping, or 0 for the shape at a given twist.
    """
    for b in range(cable.blocks):
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        if cable.terms & CURVED:
            turn_natural(cable, b, x0, x1, p, q)
        factor_samples(cable, b, p, q, viscous)
        if cable.terms & BISHOP:
            factor_twist(cable, b, twist)
        before, after = products(p), products(q)
        guarded = may_act(before) or may_act(after)
        if guarded:
            factor_guard(cable, b, before, after)
        for i in range(cable.dim):
            for j in range(cable.dim):
                h = entry_of(cable, b, i, j, viscous)
                if guarded:
                    h = add_guard(cable.work.guard, p, q, i, j, h)
                write_pairs(cable, b, i, j, h)
        if cable.terms & BISHOP:
            write_twist(cable, b)
    add_pairs(cable, scale, band)
    if cable.terms & BISHOP:
        add_line(cable, cable.dim, cable.linear.twist, scale * twist, band)


@inline
def factor_samples(cable, b, p, q, viscous):
    """Compute the factors of the Jacobian's dyads at all samples of a block, and its moments.

    With the midpoint's t and k, and the chain rule dc1 = 2 t.dt, dd1 = k.dt + t.dk, dh1 = 2 k.dk at
    configuration 1, the derivatives of the gradient on t and on k by t and k are
        tt = t x1^T + k x2^T + unit,  tk = t y1^T + k y2^T + unit,  kt = k x3^T + t x2^T + unit,
        kk = t y2^T + unit.
    """
    mesh, terms, work = cable.mesh, cable.terms, cable.work
    f = work.factors
    axial, bending, s = mesh.axial[b], mesh.bending[b], mesh.slope[b]
    tension = cable.state.tension
    thinning = viscous * viscous * cable.physics.thinning
    beta_stretch, beta_bend = cable.physics.beta_stretch, cable.physics.beta_bend
    if terms & SPAN_STRETCH:
        for power in range(4):
            for i in range(3):
                work.force_moments[power, i] = 0.0
                work.strain_moments[power, i] = 0.0
                work.flow_moments[power, i] = 0.0
    for j in range(cable.samples):
        xi, w = mesh.xi[b, j], mesh.weight[b, j]
        ta, ka = tangent_at(p, xi), bending_at(p, xi, s)
        tb, kb = tangent_at(q, xi), bending_at(q, xi, s)
        c0, c1 = dot(ta, ta), dot(tb, tb)
        s0, s1 = sqrt(c0), sqrt(c1)
        on_c, on_d, on_h = zero(), zero(), zero()
        cc, cd, ch, dc, dd, hc = zero(), zero(), zero(), zero(), zero(), zero()
        t, k = mean(ta, tb), mean(ka, kb)
        if terms & ANY_STRETCH:
            on_c += stretch.discrete_gradient(axial, s0, s1, tension[b, j])
            fixed, changed = stretch.discrete_jacobian(axial, s0, s1, tension[b, j])
            cc += fixed
            if terms & STRETCH:
                cc += changed
        if terms & SPAN_STRETCH:
            both = combined(1.0, ta, 1.0, tb)
            add_moments(work.force_moments, w / (s0 + s1), both, xi)
            add_moments(work.strain_moments, w / s1, tb, xi)
            add_moments(work.flow_moments, w / sqrt(dot(both, both)), both, xi)
        if terms & BEND:
            d0, h0, d1, h1 = dot(ta, ka), dot(ka, ka), dot(tb, kb), dot(kb, kb)
            more = bend.discrete_gradient(bending, c0, d0, h0, c1, d1, h1)
            on_c += more[0]
            on_d += more[1]
            on_h += more[2]
            slopes = bend.discrete_jacobian(bending, c0, d0, h0, c1, d1, h1)
            cc += slopes[0]
            cd, ch, dc, dd, hc = slopes[1], slopes[2], slopes[3], slopes[4], slopes[5]
        store_three(f[j], T, t)
        store_three(f[j], K, k)
        store_three(f[j], X1, combined(4.0 * w * cc, tb, 2.0 * w * cd, kb))
        store_three(f[j], Y1, combined(2.0 * w * cd, tb, 4.0 * w * ch, kb))
        store_three(f[j], X2, combined(2.0 * w * dc, tb, w * dd, kb))
        store_three(f[j], Y2, combined(w * dd, tb, 0.0, kb))
        store_three(f[j], X3, combined(4.0 * w * hc, tb, 0.0, kb))
        store_three(f[j], UNIT, (w * on_c, 0.5 * w * on_d, w * on_h))
        if terms & CURVED:
            factor_natural(cable, j, ta, ka, tb, kb, t, k)
            if terms & PLASTICITY:
                factor_flow(cable, b, j, t, k, w * bending)
        if viscous != 0.0:
            ratio, n, inverse = viscosity.curvature_of(t, k)
            g = zero()
            if terms & BEND:
                g = viscous * w * bending * beta_bend
                if terms & THINNED:
                    moved = combined(1.0, tb, -1.0, ta), combined(1.0, kb, -1.0, ka)
                    g, thinned_t, thinned_k = viscosity.thinned(
                        g, thinning, ratio, n, inverse, t, *moved
                    )
                    store_three(f[j], THINNED_T, thinned_t)
                    store_three(f[j], THINNED_K, thinned_k)
                g = g * inverse * inverse
            along = 4.0 * g * dot(n, n)
            if terms & STRETCH:
                along += viscous * w * axial * beta_stretch * inverse
            store_three(f[j], NORMAL, n)
            f[j, VISCOUS] = g
            f[j, ALONG] = along
            f[j, RATIO] = ratio
            f[j, INVERSE_C] = inverse


@inline
def add_moments(moments, f, t, xi):
    """Add f t (1, xi, xi^2, xi^3) to moments [power, component]."""
    for power in range(4):
        for i in range(3):
            moments[power, i] = moments[power, i] + f * t[i]
        f = f * xi


@inline
def turn_natural(cable, b, x0, x1, p, q):
    """Write the natural and plastic curvature in the middle of a step to `work.factors`."""
    follows, r = cable.terms & MATERIAL != 0, p
    angle0 = angle1 = (zero(), zero(), zero(), zero())
    if follows:
        r = curve(cable, cable.state.reference, b, 1.0)
        angle0, angle1 = turn_polynomial(cable, b, x0), turn_polynomial(cable, b, x1)
    for j in range(cable.samples):
        xi, n = cable.mesh.xi[b, j], three(cable.state.natural[b, j], 0)
        slipped = zero(), zero(), zero()
        if cable.terms & PLASTICITY:
            slipped = three(cable.state.plastic[b, j], 0)
        if follows:
            inverse = 1.0 / cable.mesh.slope[b]
            angle = 0.5 * (integrated(inverse, angle0, xi) + integrated(inverse, angle1, xi))
            begun, t = tangent_at(r, xi), mean(tangent_at(p, xi), tangent_at(q, xi))
            n = vector_now(n, begun, t, angle)
            if cable.terms & PLASTICITY:
                slipped = vector_now(slipped, begun, t, angle)
        if cable.terms & PLASTICITY:
            kappa = curvature(tangent_at(q, xi), bending_at(q, xi, cable.mesh.slope[b]))
            n = natural_with(cable, b, j, n, slipping(cable, b, kappa, slipped))
        store_three(cable.work.factors[j], NATURAL, n)
        store_three(cable.work.factors[j], SLIPPED, slipped)


@inline
def factor_natural(cable, j, ta, ka, tb, kb, t, k):
    """Add the natural and plastic curvature to the factors of sample j.

    In the material frame they turn with theta and with the tangent: n.(t x k) changes by
    dtheta (T x n).(t x k), and in second order of a change d of the unit tangent T by
    (d.n) (d.(t x k)) / 2.
    """
    f = cable.work.factors
    n = three(f[j], NATURAL)
    c0, c1 = dot(ta, ta), dot(tb, tb)
    e0, e1 = triple(n, ta, ka), triple(n, tb, kb)
    on_c, on_e = density_gradient(c0, c1, e0, e1)
    cc, ce, ec = density_jacobian(c0, c1, e0, e1)
    kn, nt = cross(kb, n), cross(n, tb)
    more = combined(4.0 * cc, tb, 2.0 * ce, kn)
    for i in range(3):
        f[j, X1 + i] = f[j, X1 + i] + more[i]
        f[j, Y1 + i] = f[j, Y1 + i] + 2.0 * ce * nt[i]
    f[j, UNIT] = f[j, UNIT] + on_c
    store_three(f[j], KN, cross(k, n))
    store_three(f[j], NT, cross(n, t))
    store_three(f[j], XE, combined(2.0 * ec, tb, 0.0, tb))
    store_three(f[j], SKEW, combined(0.5 * on_e, n, 0.0, n))
    if cable.terms & MATERIAL:
        square, bent = 1.0 / dot(t, t), cross(t, k)
        cube = square * sqrt(square)
        q = combined(sqrt(square), cross(t, n), 0.0, n)
        store_three(
            f[j], T_THETA, combined(-0.5 * cube, cross(k, q), 1.5 * dot(q, bent) * cube * square, t)
        )
        store_three(f[j], K_THETA, combined(-0.5 * cube, cross(q, t), 0.0, t))
        f[j, THETA] = 0.5 * cube * dot(n, bent)
        store_three(f[j], LEAN, combined(-0.25 * cube * square, n, 0.0, n))
        store_three(f[j], BINORMAL, bent)


@inline
def factor_flow(cable, b, j, t, k, stiffness):
    """Add the plastic flow to the factors of sample j: minus the stiffness times
    d kappa^T (d p / d kappa) d kappa, with the changes of the curvature normal to the tangent, and
    in the material frame without its rotation by theta.
    """
    f, square = cable.work.factors, 1.0 / dot(t, t)
    root = sqrt(square)
    kappa, unit = combined(square * root, cross(t, k), 0.0, t), combined(root, t, 0.0, t)
    along, across, e = slip_derivative(cable, b, kappa, three(f[j], SLIPPED))
    add_flow(cable, j, 0, sqrt(stiffness * along), e, t, k, kappa)
    add_flow(cable, j, 3, sqrt(stiffness * across), cross(unit, e), t, k, kappa)


@inline
def add_flow(cable, j, at, g, a, t, k, kappa):
    """Add the dyad of g times the change of the curvature along a, normal to the tangent."""
    f, square = cable.work.factors, 1.0 / dot(t, t)
    root = sqrt(square)
    cube = g * square * root
    on_t = combined(cube, cross(k, a), -3.0 * g * square * dot(kappa, a), t)
    on_k = combined(cube, cross(a, t), 0.0, t)
    store_three(f[j], FLOW_T + at, on_t)
    store_three(f[j], FLOW_K + at, on_k)
    if cable.terms & MATERIAL:
        turn = -g * root * dot(cross(t, kappa), a)
        store_three(f[j], T_THETA, combined(1.0, three(f[j], T_THETA), -turn, on_t))
        store_three(f[j], K_THETA, combined(1.0, three(f[j], K_THETA), -turn, on_k))
        f[j, THETA] = f[j, THETA] - turn * turn


@inline
def factor_twist(cable, b, twist):
    """Compute the factors of the twist at all samples of a block, to first order in the step.

    The twisting moment M acts on r' as M G, with a change of M of `twist` GJ (G.dt + dtheta'), and
    half the changes of G = t x k / |t|^3.
    """
    mesh, f = cable.mesh, cable.work.factors
    for j in range(cable.samples):
        t, k = three(f[j], T), three(f[j], K)
        square, moment, bent = 1.0 / dot(t, t), cable.work.moment[b, j], cross(t, k)
        cube = square * sqrt(square)
        stiff, g = twist * mesh.torsional[b] * mesh.weight[b, j], combined(cube, bent, 0.0, bent)
        f[j, KAPPA] = stiff
        store_three(f[j], G, g)
        store_three(f[j], XG, combined(stiff, g, -1.5 * moment * square, t))
        store_three(f[j], MT, combined(0.5 * moment * cube, t, 0.0, t))
        store_three(f[j], MK, combined(0.5 * moment * cube, k, 0.0, k))


@inline
def entry_of(cable, b, i, j, viscous):
    """Jacobian in A, B, C of lines i and j on the spans of a block, 3 x 3: the sum over the samples
    of their entries of tt, tk, kt and kk (`factor_samples`), and the projected strain.
    """
    mesh, work, unit = cable.mesh, cable.work, 1.0 if i == j else 0.0
    s, f = mesh.slope[b], cable.work.factors
    h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = zero()
    for z in range(cable.samples):
        y = mesh.xi[b, z]
        t, k = f[z, T + i], f[z, K + i]
        x2, y2 = f[z, X2 + j], f[z, Y2 + j]
        mixed = unit * f[z, UNIT + 1]
        tt = t * f[z, X1 + j] + k * x2
        tt += unit * f[z, UNIT]
        tk = t * f[z, Y1 + j] + k * y2 + mixed
        kt = k * f[z, X3 + j] + t * x2 + mixed
        kk = t * y2 + unit * f[z, UNIT + 2]
        if cable.terms & CURVED:
            e = f[z, XE + j]
            tt += f[z, KN + i] * e
            kt += f[z, NT + i] * e
            if i != j:
                skew = f[z, SKEW + 3 - i - j]  # ([n]_x)_ij = - eps_ijk n_k
                if (j - i) % 3 != 1:
                    skew = -skew
                tk += skew
                kt -= skew
        if cable.terms & BISHOP:
            tt += f[z, G + i] * f[z, XG + j]
            if i != j:
                turn, bend_ = f[z, MK + 3 - i - j], f[z, MT + 3 - i - j]
                sign = 1.0 if (j - i) % 3 == 1 else -1.0
                tt += sign * turn
                tk -= sign * bend_
            if cable.terms & MATERIAL:
                tt += f[z, LEAN + i] * f[z, BINORMAL + j] + f[z, BINORMAL + i] * f[z, LEAN + j]
        if cable.terms & PLASTICITY:
            for at in range(0, 6, 3):
                t_i, k_i = f[z, FLOW_T + at + i], f[z, FLOW_K + at + i]
                t_j, k_j = f[z, FLOW_T + at + j], f[z, FLOW_K + at + j]
                tt -= t_i * t_j
                tk -= t_i * k_j
                kt -= k_i * t_j
                kk -= k_i * k_j
        if viscous != 0.0:
            t_j, n_i, n_j = f[z, T + j], f[z, NORMAL + i], f[z, NORMAL + j]
            g, q, inverse = f[z, VISCOUS], f[z, RATIO], f[z, INVERSE_C]
            more = viscosity.tangent_blocks(g, q, n_i, n_j, t, t_j, unit, inverse)
            tt += more[0] + f[z, ALONG] * t * t_j
            tk += more[1]
            kt += more[2]
            kk += more[3]
            if cable.terms & THINNED:
                t_i, k_i = f[z, THINNED_T + i], f[z, THINNED_K + i]
                t_j, k_j = f[z, THINNED_T + j], f[z, THINNED_K + j]
                tt -= t_i * t_j
                tk -= t_i * k_j
                kt -= k_i * t_j
                kk -= k_i * k_j
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
    if cable.terms & SPAN_STRETCH:
        g, linear = 0.5 * mesh.axial[b] * mesh.share[b], mesh.linear[b]
        left, right = column(work.force_moments, i), column(work.strain_moments, j)
        h0, h1, h2 = add_projected(h0, h1, h2, g, linear, left, right)
        if viscous != 0.0:
            g = 2.0 * viscous * cable.physics.beta_stretch * g
            left, right = column(work.flow_moments, i), column(work.flow_moments, j)
            h0, h1, h2 = add_projected(h0, h1, h2, g, linear, left, right)
    return h0, h1, h2


@inline
def column(moments, i):
    """Moments of component i: with 1, xi, xi^2, xi^3."""
    return moments[0, i], moments[1, i], moments[2, i], moments[3, i]


@inline
def add_projected(h0, h1, h2, f, linear, m, r):
    """Add the dyads of the projected strain: of its mean, and of its linear part."""
    return (
        add_products(h0, f * m[0], f * linear * m[1], r),
        add_products(h1, f * m[1], f * linear * m[2], r),
        add_products(h2, f * m[2], f * linear * m[3], r),
    )


@inline
def add_products(h, one, next_, r):
    """h_q + one r_q + next_ r_(q + 1)."""
    return (
        h[0] + one * r[0] + next_ * r[1],
        h[1] + one * r[1] + next_ * r[2],
        h[2] + one * r[2] + next_ * r[3],
    )


@inline
def write_pairs(cable, b, i, j, h):
    """Write the Jacobian h in A, B, C of lines i and j, by control points, to `work.pairs`."""
    m, pairs = cable.mesh.slopes, cable.work.pairs[cable.lines * i + j]
    h0, h1, h2 = h
    for k in range(4):
        e0, e1, e2 = m[b, 3 * k], m[b, 3 * k + 1], m[b, 3 * k + 2]
        r0 = e0 * h0[0] + e1 * h1[0] + e2 * h2[0]
        r1 = e0 * h0[1] + e1 * h1[1] + e2 * h2[1]
        r2 = e0 * h0[2] + e1 * h1[2] + e2 * h2[2]
        for other in range(4):
            f = r0 * m[b, 3 * other] + r1 * m[b, 3 * other + 1]
            store(pairs, 4 * k + other, MARGIN + LANES * b + k, f + r2 * m[b, 3 * other + 2])


@inline
def write_twist(cable, b):
    """Write the Jacobian between the twist line and all lines, as `write_pairs`, without the
    torsional stiffness itself.
    """
    f, twist, mesh, zeros = cable.work.factors, cable.dim, cable.mesh, (zero(), zero(), zero())
    for i in range(cable.dim):
        h0 = h1 = h2 = h3 = h4 = zero()
        for z in range(cable.samples):
            y, v = mesh.xi[b, z], f[z, KAPPA] * f[z, G + i]
            h0 += v
            h1 += y * v
            h2 += y * y * v
            h3 += y * y * y * v
            h4 += y * y * y * y * v
        h = (h0, h1, h2), (h1, h2, h3), (h2, h3, h4)
        write_pairs(cable, b, i, twist, h)
        write_pairs(cable, b, twist, i, h)
    write_pairs(cable, b, twist, twist, (zeros, zeros, zeros))
    if not cable.terms & MATERIAL:
        return
    s, m, at = mesh.slope[b], mesh.slopes, MARGIN + LANES * b
    for other in range(4):
        for i in range(cable.dim):
            g = zeros
            for z in range(cable.samples):
                y = mesh.xi[b, z]
                e = basis_at(mesh, b, other, 1.0 / s, y)
                g = add_sample(g, e * f[z, T_THETA + i], s * e * f[z, K_THETA + i], y)
            for k in range(4):
                value = m[b, 3 * k] * g[0] + m[b, 3 * k + 1] * g[1] + m[b, 3 * k + 2] * g[2]
                add_to_pair(cable, i, twist, 4 * k + other, at + k, value)
                add_to_pair(cable, twist, i, 4 * other + k, at + other, value)
        for k in range(4):
            value = zero()
            for z in range(cable.samples):
                y = mesh.xi[b, z]
                e = basis_at(mesh, b, other, 1.0 / s, y) * basis_at(mesh, b, k, 1.0 / s, y)
                value += f[z, THETA] * e
            add_to_pair(cable, twist, twist, 4 * k + other, at + k, value)


@inline
def add_to_pair(cable, i, j, pair, at, value):
    """Add to the entries between lines i and j of the spans of a block."""
    pairs = cable.work.pairs[cable.lines * i + j]
    store(pairs, pair, at, load(pairs, pair, at) + value)


@inline
def add_pairs(cable, scale, band):
    """band += scale times `work.pairs`, added up for each two control points."""
    lines, sums = cable.lines, cable.work.pair_sums
    for i in range(lines):
        for j in range(lines):
            pairs = cable.work.pairs[lines * i + j]
            for first in range(0, cable.n, LANES):
                for apart in range(7):  # the other control point is number apart - 3 from it
                    entry = zero()
                    for k in range(max(3 - apart, 0), min(7 - apart, 4)):
                        entry += load(pairs, 5 * k + apart - 3, MARGIN + first)
                    store(sums, apart, 0, scale * entry)
                for point in range(min(LANES, cable.n - first)):
                    row = band[(first + point) * lines + i]
                    for apart in range(7):
                        row[(apart + 1) * lines + j - i - 1] += sums[apart, point]


@inline
def factor_guard(cable, b, before, after):
    """Write the gradient of the span guard on a block, and the factors of its Jacobian
    (`span_guard.guard_jacobian`), to `work.guard`.
    """
    factors, middle, new = guard_jacobian(cable, b, before, after)
    parts = *discrete_guard_gradient(cable, b, before, after), *middle, *new, *factors
    for k in range(len(parts)):
        cable.work.guard[k] = parts[k]


@inline
def add_guard(guard, p, q, i, j, h):
    """h + the Jacobian of the span guard between lines i and j: a sum of products of gradients of
    the functions in `FORMS`, at the midpoint and at the new configuration.
    """
    m, r = combined(1.0, p[i], 1.0, q[i]), q[j]
    if i == j:
        h = (
            combined(1.0, h[0], 1.0, (guard[0], guard[1], guard[2])),
            combined(1.0, h[1], 1.0, (guard[1], guard[3], guard[4])),
            combined(1.0, h[2], 1.0, (guard[2], guard[4], guard[5])),
        )
    h = add_dyad(h, 1.0, matrix_times(six(guard, 6), m), matrix_times(six(guard, 12), r))
    for k in range(len(FORMS)):
        h = add_dyad(h, guard[18 + k], matrix_times(FORMS[k], m), matrix_times(FORMS[k], r))
    return h


@inline
def six(row, k):
    """Six successive entries."""
    return row[k], row[k + 1], row[k + 2], row[k + 3], row[k + 4], row[k + 5]


@inline
def add_dyad(h, factor, left, right):
    """h + factor left right^T, 3 x 3."""
    return (
        combined(1.0, h[0], factor * left[0], right),
        combined(1.0, h[1], factor * left[1], right),
        combined(1.0, h[2], factor * left[2], right),
    )
