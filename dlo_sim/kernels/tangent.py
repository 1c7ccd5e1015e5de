"""Discrete gradient of the elastic energy between two configurations, and its exact Jacobian.

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
gives the plain gradient, and half the Hessian as its Jacobian with respect to configuration 1.

Viscosity is Kelvin-Voigt: the stress of each strain is k (eps + beta eps'), with the corotational
rate of the curvature vector, evaluated at the midpoint. It does exactly no work in a rigid motion
and always dissipates. Its Jacobian leaves out the change of geometry within the step.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel

# Rows of the per-sample scratch: midpoint vectors and the factors of the Jacobian's dyads.
TM, KM, X1, Y1, X2, Y2, X3, XE, KN, NT = 0, 3, 6, 9, 12, 15, 18, 21, 24, 27
A1, A2, A3, PE = 30, 31, 32, 33
VISCOUS_TT, VISCOUS_TK, VISCOUS_KK, VISCOUS_CROSS, CURVATURE = 34, 35, 36, 37, 38
GT, GK = 41, 44
SCRATCH_ROWS = 47


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
def stretch_terms(stretch, w, s0, s1):
    """psi_c and its derivative with respect to c1 for EA/2 (sqrt(c) - 1)^2."""
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
def sample_rest(rest, b, j, lane, z, t0, k0, t1, k1, c0, c1, s0, s1):
    """Add the natural curvature to the scratch of one sample (after the other terms)."""
    if rest is not None:
        n0, n1, n2 = rest.axis[0], rest.axis[1], rest.axis[2]
        e0 = (
            n0 * (t0[1] * k0[2] - t0[2] * k0[1])
            + n1 * (t0[2] * k0[0] - t0[0] * k0[2])
            + n2 * (t0[0] * k0[1] - t0[1] * k0[0])
        )
        kn0 = k1[1] * n2 - k1[2] * n1  # k1 x n
        kn1 = k1[2] * n0 - k1[0] * n2
        kn2 = k1[0] * n1 - k1[1] * n0
        nt0 = n1 * t1[2] - n2 * t1[1]  # n x t1
        nt1 = n2 * t1[0] - n0 * t1[2]
        nt2 = n0 * t1[1] - n1 * t1[0]
        e1 = t1[0] * kn0 + t1[1] * kn1 + t1[2] * kn2
        m = rest.moment[b, j, lane]
        pc, pe, pc_c, pc_e, pe_c = rest_terms(m, c0, c1, s0, s1, e0, e1)
        z[A1, lane] += 2.0 * pc
        z[PE, lane] = pe
        z[X1, lane] += 4.0 * pc_c * t1[0] + 2.0 * pc_e * kn0
        z[X1 + 1, lane] += 4.0 * pc_c * t1[1] + 2.0 * pc_e * kn1
        z[X1 + 2, lane] += 4.0 * pc_c * t1[2] + 2.0 * pc_e * kn2
        z[Y1, lane] += 2.0 * pc_e * nt0
        z[Y1 + 1, lane] += 2.0 * pc_e * nt1
        z[Y1 + 2, lane] += 2.0 * pc_e * nt2
        for i in range(3):
            z[XE + i, lane] = 2.0 * pe_c * t1[i]
        a0, a1, a2 = z[KM, lane], z[KM + 1, lane], z[KM + 2, lane]
        z[KN, lane] = a1 * n2 - a2 * n1
        z[KN + 1, lane] = a2 * n0 - a0 * n2
        z[KN + 2, lane] = a0 * n1 - a1 * n0
        a0, a1, a2 = z[TM, lane], z[TM + 1, lane], z[TM + 2, lane]
        z[NT, lane] = n1 * a2 - n2 * a1
        z[NT + 1, lane] = n2 * a0 - n0 * a2
        z[NT + 2, lane] = n0 * a1 - n1 * a0
        for i in range(3):
            z[GT + i, lane] += 2.0 * pc * z[TM + i, lane] + pe * z[KN + i, lane]
            z[GK + i, lane] += pe * z[NT + i, lane]


@kernel
def sample_viscosity(viscosity, tau, stretch, bend, w, lane, z, dt, dk):
    """Add Kelvin-Voigt stresses for the increments dt, dk of one sample; returns the energy lost.

    `viscosity` is beta. With P the projector normal to t and curvature vector k_n = P k / c,
    the corotational increment is rho = (P dk - (t.k / c) P dt - 2 k_n (t.dt)) / c.
    """
    if viscosity is not None:
        t0, t1, t2 = z[TM, lane], z[TM + 1, lane], z[TM + 2, lane]
        k0, k1, k2 = z[KM, lane], z[KM + 1, lane], z[KM + 2, lane]
        ic = 1.0 / (t0 * t0 + t1 * t1 + t2 * t2)
        tdt = t0 * dt[0] + t1 * dt[1] + t2 * dt[2]
        f = viscosity / tau * w * stretch_stiffness(stretch) * ic
        lost = f * tdt * tdt
        along = f * tdt
        g = viscosity / tau * w * bend_stiffness(bend)
        q = (t0 * k0 + t1 * k1 + t2 * k2) * ic
        n0 = (k0 - q * t0) * ic
        n1 = (k1 - q * t1) * ic
        n2 = (k2 - q * t2) * ic
        # a = dk - q dt, projected
        a0 = dk[0] - q * dt[0]
        a1 = dk[1] - q * dt[1]
        a2 = dk[2] - q * dt[2]
        ta = (t0 * a0 + t1 * a1 + t2 * a2) * ic
        r0 = (a0 - ta * t0 - 2.0 * tdt * n0) * ic
        r1 = (a1 - ta * t1 - 2.0 * tdt * n1) * ic
        r2 = (a2 - ta * t2 - 2.0 * tdt * n2) * ic
        lost += g * (r0 * r0 + r1 * r1 + r2 * r2)
        gi = g * ic
        pull = along - 2.0 * gi * (n0 * r0 + n1 * r1 + n2 * r2)
        z[GT, lane] += pull * t0 - gi * q * r0
        z[GT + 1, lane] += pull * t1 - gi * q * r1
        z[GT + 2, lane] += pull * t2 - gi * q * r2
        z[GK, lane] += gi * r0
        z[GK + 1, lane] += gi * r1
        z[GK + 2, lane] += gi * r2
        gii = gi * ic
        nn = n0 * n0 + n1 * n1 + n2 * n2
        # Jacobian blocks  tt: u P + cross (n t' + t n') + v t t',  tk: -q gii P - 2 gii t n',  kk:
        # gii P
        z[VISCOUS_KK, lane] = gii
        z[VISCOUS_TK, lane] = -gii * q
        z[VISCOUS_CROSS, lane] = 2.0 * gii * q
        z[VISCOUS_TT, lane] = f + 4.0 * gii * nn
        z[CURVATURE, lane] = n0
        z[CURVATURE + 1, lane] = n1
        z[CURVATURE + 2, lane] = n2
        return lost
    return 0.0


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
def sample_scratch(p0, p1, dp, lattice, stretch, bend, rest, viscosity, tau, dim, b, j, z):
    """Stresses and Jacobian factors of sample j of every lane; returns the energy lost."""
    s = lattice.slope
    lost = 0.0
    for lane in range(p0.shape[1]):
        x = lattice.xi[b, j, lane]
        w = lattice.weights[b, j, lane]
        t0 = sample_vectors(p0, dim, x, s, lane)
        t1 = sample_vectors(p1, dim, x, s, lane)
        c0 = t0[0] * t0[0] + t0[1] * t0[1] + t0[2] * t0[2]
        h0 = t0[3] * t0[3] + t0[4] * t0[4] + t0[5] * t0[5]
        d0 = t0[0] * t0[3] + t0[1] * t0[4] + t0[2] * t0[5]
        c1 = t1[0] * t1[0] + t1[1] * t1[1] + t1[2] * t1[2]
        h1 = t1[3] * t1[3] + t1[4] * t1[4] + t1[5] * t1[5]
        d1 = t1[0] * t1[3] + t1[1] * t1[4] + t1[2] * t1[5]
        s0 = np.sqrt(c0)
        s1 = np.sqrt(c1)
        ps, ps_c = stretch_terms(stretch, w, s0, s1)
        pc, ph, pd, pc_c, pc_h, pc_d, ph_c, pd_c, pd_d = bend_terms(bend, w, c0, c1, h0, h1, d0, d1)
        pc += ps
        pc_c += ps_c
        z[A1, lane] = 2.0 * pc
        z[A2, lane] = pd
        z[A3, lane] = 2.0 * ph
        for i in range(3):
            tm = 0.5 * (t0[i] + t1[i])
            km = 0.5 * (t0[3 + i] + t1[3 + i])
            z[TM + i, lane] = tm
            z[KM + i, lane] = km
            z[X1 + i, lane] = 4.0 * pc_c * t1[i] + 2.0 * pc_d * t1[3 + i]
            z[Y1 + i, lane] = 4.0 * pc_h * t1[3 + i] + 2.0 * pc_d * t1[i]
            z[X2 + i, lane] = 2.0 * pd_c * t1[i] + pd_d * t1[3 + i]
            z[Y2 + i, lane] = pd_d * t1[i]
            z[X3 + i, lane] = 4.0 * ph_c * t1[i]
            z[GT + i, lane] = 2.0 * pc * tm + pd * km
            z[GK + i, lane] = 2.0 * ph * km + pd * tm
        sample_rest(rest, b, j, lane, z, t0[:3], t0[3:], t1[:3], t1[3:], c0, c1, s0, s1)
        if viscosity is not None:
            move = sample_vectors(dp, dim, x, s, lane)
            lost += sample_viscosity(viscosity, tau, stretch, bend, w, lane, z, move[:3], move[3:])
    return lost


@kernel
def add_viscous_blocks(viscosity, z, i, j, lane, tt, tk, kt, kk):
    """Add the viscous part to entry (i, j) of the four Jacobian blocks."""
    if viscosity is not None:
        t_i, t_j = z[TM + i, lane], z[TM + j, lane]
        n_i, n_j = z[CURVATURE + i, lane], z[CURVATURE + j, lane]
        c = z[TM, lane] ** 2 + z[TM + 1, lane] ** 2 + z[TM + 2, lane] ** 2
        project = -t_i * t_j / c
        if i == j:
            project += 1.0
        gii = z[VISCOUS_KK, lane]
        mixed = z[VISCOUS_TK, lane]
        q = -mixed / gii if gii != 0.0 else 0.0
        tt += gii * q * q * project
        tt += z[VISCOUS_CROSS, lane] * (n_i * t_j + t_i * n_j) + z[VISCOUS_TT, lane] * t_i * t_j
        tk += mixed * project - 2.0 * gii * t_i * n_j
        kt += mixed * project - 2.0 * gii * n_i * t_j
        kk += gii * project
    return tt, tk, kt, kk


@kernel
def add_rest_blocks(rest, z, i, j, lane, tt, tk, kt):
    """Add the natural curvature to entry (i, j) of the Jacobian blocks."""
    if rest is not None:
        tt += z[KN + i, lane] * z[XE + j, lane]
        kt += z[NT + i, lane] * z[XE + j, lane]
        if i != j:
            # ([n]_x)_ij = -eps_ijk n_k
            third = 3 - i - j
            sign = 1.0 if (j - i) % 3 == 1 else -1.0
            half = 0.5 * z[PE, lane] * sign * rest.axis[third]
            tk += half
            kt -= half
    return tt, tk, kt


@kernel
def accumulate_jacobian(rest, viscosity, z, x, s, dim, h):
    """Add one sample's Jacobian to the blocks over (A, B, C): rows (3 p + q) dim^2 + dim i + j."""
    square = dim * dim
    for i in range(dim):
        for j in range(dim):
            row = dim * i + j
            for lane in range(h.shape[1]):
                tm, km = z[TM + i, lane], z[KM + i, lane]
                tt = tm * z[X1 + j, lane] + km * z[X2 + j, lane]
                tk = tm * z[Y1 + j, lane] + km * z[Y2 + j, lane]
                kt = km * z[X3 + j, lane] + tm * z[X2 + j, lane]
                kk = tm * z[Y2 + j, lane]
                if i == j:
                    tt += 0.5 * z[A1, lane]
                    tk += 0.5 * z[A2, lane]
                    kt += 0.5 * z[A2, lane]
                    kk += 0.5 * z[A3, lane]
                tt, tk, kt = add_rest_blocks(rest, z, i, j, lane, tt, tk, kt)
                tt, tk, kt, kk = add_viscous_blocks(viscosity, z, i, j, lane, tt, tk, kt, kk)
                tk *= s
                kt *= s
                kk *= s * s
                y = x[lane]
                h[row, lane] += tt
                h[square + row, lane] += y * tt + tk
                h[2 * square + row, lane] += y * (y * tt + 2.0 * tk)
                h[3 * square + row, lane] += y * tt + kt
                h[4 * square + row, lane] += y * (y * tt + tk + kt) + kk
                h[5 * square + row, lane] += y * (y * (y * tt + 2.0 * tk + kt) + 2.0 * kk)
                h[6 * square + row, lane] += y * (y * tt + 2.0 * kt)
                h[7 * square + row, lane] += y * (y * (y * tt + 2.0 * kt + tk) + 2.0 * kk)
                h[8 * square + row, lane] += y * y * (y * (y * tt + 2.0 * (tk + kt)) + 4.0 * kk)


@kernel
def span_discrete_gradient(
    p0,
    p1,
    dp,
    lattice,
    stretch,
    bend,
    rest,
    viscosity,
    tau,
    axes,
    scratch,
    gradient,
    jacobian,
    linearize,
):
    """Discrete gradient per span (rows A, B, C x dim) and, if asked, its Jacobian; energy lost."""
    dim = len(axes)
    lost = 0.0
    for b in range(p0.shape[0]):
        g = gradient[b]
        for row in range(3 * dim):
            for lane in range(g.shape[1]):
                g[row, lane] = 0.0
        if linearize:
            h = jacobian[b]
            for row in range(h.shape[0]):
                for lane in range(h.shape[1]):
                    h[row, lane] = 0.0
        for j in range(lattice.xi.shape[1]):
            lost += sample_scratch(
                p0[b],
                p1[b],
                dp[b],
                lattice,
                stretch,
                bend,
                rest,
                viscosity,
                tau,
                dim,
                b,
                j,
                scratch,
            )
            x = lattice.xi[b, j]
            add_sample_gradient(scratch, x, lattice.slope, dim, g)
            if linearize:
                accumulate_jacobian(rest, viscosity, scratch, x, lattice.slope, dim, jacobian[b])
    return lost


@kernel
def add_sample_gradient(z, x, s, dim, g):
    """Add one sample's stresses to the span gradient."""
    for i in range(dim):
        for lane in range(g.shape[1]):
            gt = z[GT + i, lane]
            gk = s * z[GK + i, lane]
            y = x[lane]
            g[i, lane] += gt
            g[dim + i, lane] += y * gt + gk
            g[2 * dim + i, lane] += y * (y * gt + 2.0 * gk)
