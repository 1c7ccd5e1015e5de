"""Discrete gradient of the elastic energy between two configurations.

For two configurations 0 and 1 the discrete gradient g(0, 1) satisfies
    g(0, 1) . (q1 - q0) = U(q1) - U(q0)      and      g(q, q) = grad U(q)
exactly, so a step that uses it as its force keeps the energy to the solver's tolerance. The energy
depends on q only through c = r'.r', h = r''.r'', d = r'.r'' and e = n.(r' x r''), and the increment
of a bilinear invariant is exact at the midpoint, c1 - c0 = 2 r'_m.(r'_1 - r'_0). So with divided
differences psi of the energy in (c, h, d, e),
    g on r'  = 2 psi_c r'_m + psi_d r''_m + psi_e r''_m x n
    g on r'' = 2 psi_h r''_m + psi_d r'_m + psi_e n x r'_m,
which also conserves momentum and angular momentum (Simo & Tarnow 1992; Gonzalez 1996, applied per
quadrature point). The divided differences are written without cancellation. Called with 0 = 1 it
gives the plain gradient.

Viscosity is Kelvin-Voigt: the stress of each strain is k (eps + beta eps'), with the corotational
rate of the curvature vector, evaluated at the midpoint. It does exactly no work in a rigid motion
and always dissipates.

The loops over lanes hold no sum over lanes: the compiler may not reorder sums, and would fall back
to one lane at a time.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.span_stretch import NOW, OLD, RATE, counted, mean_rates, mean_strains


@kernel
def sample_vectors(p, dim, x, s, lane):
    """r' and r'' of one lane at local coordinate x."""
    t0 = p[0, lane] + x * (p[dim, lane] + x * p[2 * dim, lane])
    t1 = p[1, lane] + x * (p[dim + 1, lane] + x * p[2 * dim + 1, lane])
    k0 = s * (p[dim, lane] + 2.0 * x * p[2 * dim, lane])
    k1 = s * (p[dim + 1, lane] + 2.0 * x * p[2 * dim + 1, lane])
    t2 = 0.0
    k2 = 0.0
    if dim == 3:
        t2 = p[2, lane] + x * (p[dim + 2, lane] + x * p[2 * dim + 2, lane])
        k2 = s * (p[dim + 2, lane] + 2.0 * x * p[2 * dim + 2, lane])
    return t0, t1, t2, k0, k1, k2


@kernel
def stretch_terms(stretch, spans, w, x, b, lane, s0, s1):
    """psi_c and its derivative with respect to c1 for EA/2 (sqrt(c) - 1)^2.

    By span psi_c = EA w eps / (|r'_0| + |r'_1|) with the mean of the strains that count; the
    derivative is at that strain.
    """
    if spans is not None:
        strain = 0.5 * (counted(spans, OLD, x, b, lane) + counted(spans, NOW, x, b, lane))
        inverse = 1.0 / (s0 + s1)
        f = spans.stiffness * w * strain * inverse
        return f, -0.5 * f * inverse / s1
    if stretch is not None:
        half = 0.5 * stretch.stiffness * w
        inverse = 1.0 / (s0 + s1)
        return half * (1.0 - 2.0 * inverse), half * inverse * inverse / s1
    return 0.0, 0.0


@kernel
def bend_terms(bend, w, c0, c1, h0, h1, d0, d1):
    """Divided differences of EI/2 (h / c^2 - d^2 / c^3) and their derivatives.

    Returns psi_c, psi_h, psi_d, then d psi_c / d (c1, h1, d1), d psi_h / d c1, d psi_d / d (c1,
    d1).
    """
    if bend is not None:
        half = 0.5 * bend.stiffness * w
        i0 = 1.0 / c0
        i1 = 1.0 / c1
        g0 = i0 * i0
        g1 = i1 * i1
        j0 = g0 * i0
        j1 = g1 * i1
        total = c0 + c1
        squares = c0 * c0 + c0 * c1 + c1 * c1
        gd = -total * g0 * g1
        jd = -squares * j0 * j1
        hm = 0.5 * (h0 + h1)
        dm = 0.5 * (d0 + d1)
        dd = 0.5 * (d0 * d0 + d1 * d1)
        jm = 0.5 * (j0 + j1)
        gd_c = g0 * (2.0 * total * j1 - g1)
        jd_c = j0 * (3.0 * squares * g1 * g1 - (c0 + 2.0 * c1) * j1)
        return (
            half * (hm * gd - dd * jd),
            0.5 * half * (g0 + g1),
            -2.0 * half * jm * dm,
            half * (hm * gd_c - dd * jd_c),
            0.5 * half * gd,
            -half * d1 * jd,
            -half * j1,
            3.0 * half * dm * g1 * g1,
            -half * jm,
        )
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@kernel
def rest_terms(m, c0, c1, s0, s1, e0, e1):
    """Divided differences of -m e c^(-3/2): psi_c, psi_e, d psi_c / d (c1, e1), d psi_e / d c1."""
    f0 = 1.0 / (c0 * s0)
    f1 = 1.0 / (c1 * s1)
    numerator = c0 + s0 * s1 + c1
    denominator = c0 * s0 * c1 * s1 * (s0 + s1)
    fd = -numerator / denominator
    fd_s = -(s0 + 2.0 * s1) / denominator + numerator * c0 * s0 * c1 * (3.0 * s0 + 4.0 * s1) / (
        denominator * denominator
    )
    em = 0.5 * (e0 + e1)
    return (
        -m * em * fd,
        -0.5 * m * (f0 + f1),
        -m * em * fd_s / (2.0 * s1),
        -0.5 * m * fd,
        0.75 * m * f1 / c1,
    )


@kernel
def invariants(v):
    """c, h, d of one sample's r' and r''."""
    c = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    h = v[3] * v[3] + v[4] * v[4] + v[5] * v[5]
    d = v[0] * v[3] + v[1] * v[4] + v[2] * v[5]
    return c, h, d


@kernel
def triple(n, v):
    """e = n . (r' x r'') of one sample."""
    return (
        n[0] * (v[1] * v[5] - v[2] * v[4])
        + n[1] * (v[2] * v[3] - v[0] * v[5])
        + n[2] * (v[0] * v[4] - v[1] * v[3])
    )


@kernel
def rest_stress(rest, b, j, lane, v0, v1, m, c0, c1, s0, s1, stress):
    """Stress of one sample with that of the natural curvature added; m: midpoint vectors."""
    if rest is not None:
        n = (rest.axis[0], rest.axis[1], rest.axis[2])
        moment = rest.moment[b, j, lane]
        pc, pe, _, _, _ = rest_terms(moment, c0, c1, s0, s1, triple(n, v0), triple(n, v1))
        return (
            stress[0] + 2.0 * pc * m[0] + pe * (m[4] * n[2] - m[5] * n[1]),
            stress[1] + 2.0 * pc * m[1] + pe * (m[5] * n[0] - m[3] * n[2]),
            stress[2] + 2.0 * pc * m[2] + pe * (m[3] * n[1] - m[4] * n[0]),
            stress[3] + pe * (n[1] * m[2] - n[2] * m[1]),
            stress[4] + pe * (n[2] * m[0] - n[0] * m[2]),
            stress[5] + pe * (n[0] * m[1] - n[1] * m[0]),
        )
    return stress


@kernel
def viscous_stress(viscosity, tau, stretch, spans, bend, w, x, b, m, move, stress, loss, lane):
    """Stress of one sample with the Kelvin-Voigt stress of the increment `move` added.

    `viscosity` is beta; the energy lost goes to loss[lane]. With P the projector normal to r', the
    curvature vector k_n = P r'' / c and q = r'.r'' / c, the corotational increment is
    rho = (P (dk - q dt) - 2 k_n (r'.dt)) / c.
    """
    if viscosity is not None:
        ic = 1.0 / (m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
        tdt = m[0] * move[0] + m[1] * move[1] + m[2] * move[2]
        along = viscosity / tau * w * stretch_stiffness(stretch) * ic * tdt
        if spans is not None:
            rate = counted(spans, RATE, x, b, lane) * np.sqrt(ic)
            along += viscosity / tau * w * spans.stiffness * rate
        g = viscosity / tau * w * bend_stiffness(bend)
        q = (m[0] * m[3] + m[1] * m[4] + m[2] * m[5]) * ic
        n0 = (m[3] - q * m[0]) * ic
        n1 = (m[4] - q * m[1]) * ic
        n2 = (m[5] - q * m[2]) * ic
        a0 = move[3] - q * move[0]
        a1 = move[4] - q * move[1]
        a2 = move[5] - q * move[2]
        ta = (m[0] * a0 + m[1] * a1 + m[2] * a2) * ic
        r0 = (a0 - ta * m[0] - 2.0 * tdt * n0) * ic
        r1 = (a1 - ta * m[1] - 2.0 * tdt * n1) * ic
        r2 = (a2 - ta * m[2] - 2.0 * tdt * n2) * ic
        loss[lane] += along * tdt + g * (r0 * r0 + r1 * r1 + r2 * r2)
        gi = g * ic
        pull = along - 2.0 * gi * (n0 * r0 + n1 * r1 + n2 * r2)
        return (
            stress[0] + pull * m[0] - gi * q * r0,
            stress[1] + pull * m[1] - gi * q * r1,
            stress[2] + pull * m[2] - gi * q * r2,
            stress[3] + gi * r0,
            stress[4] + gi * r1,
            stress[5] + gi * r2,
        )
    return stress


@kernel
def stretch_stiffness(stretch):
    """EA, or 0 without stretching."""
    if stretch is not None:
        return stretch.stiffness
    return 0.0


@kernel
def bend_stiffness(bend):
    """EI, or 0 without bending."""
    if bend is not None:
        return bend.stiffness
    return 0.0


@kernel
def add_stress(stress, x, s, dim, g, lane):
    """Add the stress of one sample to the span gradient; x is its local coordinate."""
    for i in range(dim):
        bent = s * stress[3 + i]
        g[i, lane] += stress[i]
        g[dim + i, lane] += x * stress[i] + bent
        g[2 * dim + i, lane] += x * (x * stress[i] + 2.0 * bent)


@kernel
def add_sample_gradient(
    p0, p1, dp, lattice, stretch, spans, bend, rest, viscosity, tau, dim, b, j, loss, g
):
    """Add sample j of every lane of a block to the span gradient."""
    s = lattice.slope
    for lane in range(p0.shape[1]):
        x = lattice.xi[b, j, lane]
        w = lattice.weights[b, j, lane]
        v0 = sample_vectors(p0, dim, x, s, lane)
        v1 = sample_vectors(p1, dim, x, s, lane)
        c0, h0, d0 = invariants(v0)
        c1, h1, d1 = invariants(v1)
        s0 = np.sqrt(c0)
        s1 = np.sqrt(c1)
        ps, _ = stretch_terms(stretch, spans, w, x, b, lane, s0, s1)
        pc, ph, pd, _, _, _, _, _, _ = bend_terms(bend, w, c0, c1, h0, h1, d0, d1)
        pc = 2.0 * (pc + ps)
        ph = 2.0 * ph
        m = middle(v0, v1)
        stress = (
            pc * m[0] + pd * m[3],
            pc * m[1] + pd * m[4],
            pc * m[2] + pd * m[5],
            ph * m[3] + pd * m[0],
            ph * m[4] + pd * m[1],
            ph * m[5] + pd * m[2],
        )
        stress = rest_stress(rest, b, j, lane, v0, v1, m, c0, c1, s0, s1, stress)
        if viscosity is not None:
            move = sample_vectors(dp, dim, x, s, lane)
            stress = viscous_stress(
                viscosity, tau, stretch, spans, bend, w, x, b, m, move, stress, loss, lane
            )
        add_stress(stress, x, s, dim, g, lane)


@kernel
def middle(v0, v1):
    """Mean of two samples' vectors."""
    return (
        0.5 * (v0[0] + v1[0]),
        0.5 * (v0[1] + v1[1]),
        0.5 * (v0[2] + v1[2]),
        0.5 * (v0[3] + v1[3]),
        0.5 * (v0[4] + v1[4]),
        0.5 * (v0[5] + v1[5]),
    )


@kernel
def span_discrete_gradient(
    p0, p1, dp, lattice, stretch, spans, bend, rest, viscosity, tau, axes, loss, gradient
):
    """Discrete gradient per span (rows A, B, C x dim); returns the energy lost to viscosity.

    `dp` is the motion that viscosity sees, over the time tau. `loss` is scratch, one entry a lane.
    """
    dim = len(axes)
    for lane in range(loss.shape[0]):
        loss[lane] = 0.0
    for b in range(p0.shape[0]):
        clear_rows(gradient[b])
        mean_strains(p0[b], lattice, spans, dim, b, OLD)
        mean_strains(p1[b], lattice, spans, dim, b, NOW)
        mean_rates(p0[b], p1[b], dp[b], lattice, spans, viscosity, dim, b)
        for j in range(lattice.xi.shape[1]):
            add_sample_gradient(
                p0[b],
                p1[b],
                dp[b],
                lattice,
                stretch,
                spans,
                bend,
                rest,
                viscosity,
                tau,
                dim,
                b,
                j,
                loss,
                gradient[b],
            )
    lost = 0.0
    for lane in range(loss.shape[0]):
        lost += loss[lane]
    return lost


@kernel
def span_viscous_gradient(p, rate, lattice, stretch, spans, bend, viscosity, axes, loss, gradient):
    """Gradient per span of the viscous stresses alone, of the rates `rate` at configuration p."""
    dim = len(axes)
    s = lattice.slope
    nothing = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for b in range(p.shape[0]):
        g = gradient[b]
        clear_rows(g)
        mean_rates(p[b], p[b], rate[b], lattice, spans, viscosity, dim, b)
        for j in range(lattice.xi.shape[1]):
            for lane in range(g.shape[1]):
                x = lattice.xi[b, j, lane]
                w = lattice.weights[b, j, lane]
                v = sample_vectors(p[b], dim, x, s, lane)
                move = sample_vectors(rate[b], dim, x, s, lane)
                stress = viscous_stress(
                    viscosity, 1.0, stretch, spans, bend, w, x, b, v, move, nothing, loss, lane
                )
                add_stress(stress, x, s, dim, g, lane)


@kernel
def clear_rows(rows):
    """rows = 0."""
    for row in range(rows.shape[0]):
        for lane in range(rows.shape[1]):
            rows[row, lane] = 0.0
