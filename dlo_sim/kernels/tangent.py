"""Exact Jacobian of the discrete gradient with respect to the new configuration.

See `kernels.discrete_gradient` for the formulas. Called with 0 = 1 it gives half the Hessian of the
elastic energy. The Jacobian of the viscosity leaves out the change of geometry within the step.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.discrete_gradient import (
    bend_stiffness,
    bend_terms,
    invariants,
    middle,
    rest_terms,
    sample_vectors,
    stretch_stiffness,
    stretch_terms,
    triple,
)
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import LANES
from dlo_sim.kernels.span_stretch import (
    NOW,
    OLD,
    add_dyads,
    add_moments,
    clear_moments,
    mean_strains,
)

# Rows of the per-sample scratch: midpoint vectors and the factors of the Jacobian's dyads. Row r of
# lane l is at r LANES + l: with constant distances the compiler sees that lanes do not interfere.
TM, KM, X1, Y1, X2, Y2, X3, XE, KN, NT = 0, 3, 6, 9, 12, 15, 18, 21, 24, 27
A1, A2, A3, PE = 30, 31, 32, 33
VISCOUS_TT, VISCOUS_TK, VISCOUS_KK, VISCOUS_CROSS, CURVATURE = 34, 35, 36, 37, 38
SCRATCH_ROWS = 41


@kernel
def factor_rest(rest, b, j, lane, z, v0, v1, m, c0, c1, s0, s1):
    """Add the natural curvature to the factors of one sample (after the other terms)."""
    if rest is not None:
        n = (rest.axis[0], rest.axis[1], rest.axis[2])
        kn = (v1[4] * n[2] - v1[5] * n[1], v1[5] * n[0] - v1[3] * n[2], v1[3] * n[1] - v1[4] * n[0])
        nt = (n[1] * v1[2] - n[2] * v1[1], n[2] * v1[0] - n[0] * v1[2], n[0] * v1[1] - n[1] * v1[0])
        moment = rest.moment[b, j, lane]
        pc, pe, pc_c, pc_e, pe_c = rest_terms(moment, c0, c1, s0, s1, triple(n, v0), triple(n, v1))
        z[A1 * LANES + lane] += 2.0 * pc
        z[PE * LANES + lane] = pe
        for i in range(3):
            z[(X1 + i) * LANES + lane] += 4.0 * pc_c * v1[i] + 2.0 * pc_e * kn[i]
            z[(Y1 + i) * LANES + lane] += 2.0 * pc_e * nt[i]
            z[(XE + i) * LANES + lane] = 2.0 * pe_c * v1[i]
        z[KN * LANES + lane] = m[4] * n[2] - m[5] * n[1]
        z[(KN + 1) * LANES + lane] = m[5] * n[0] - m[3] * n[2]
        z[(KN + 2) * LANES + lane] = m[3] * n[1] - m[4] * n[0]
        z[NT * LANES + lane] = n[1] * m[2] - n[2] * m[1]
        z[(NT + 1) * LANES + lane] = n[2] * m[0] - n[0] * m[2]
        z[(NT + 2) * LANES + lane] = n[0] * m[1] - n[1] * m[0]


@kernel
def factor_viscosity(viscosity, tau, stretch, bend, w, lane, z, m):
    """Factors of the viscosity: with n the curvature vector and P the projector, the blocks are
    tt: u P + cross (n t' + t n') + v t t',  tk: -q gii P - 2 gii t n',  kk: gii P.
    """
    if viscosity is not None:
        ic = 1.0 / (m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
        f = viscosity / tau * w * stretch_stiffness(stretch) * ic
        g = viscosity / tau * w * bend_stiffness(bend)
        q = (m[0] * m[3] + m[1] * m[4] + m[2] * m[5]) * ic
        n0 = (m[3] - q * m[0]) * ic
        n1 = (m[4] - q * m[1]) * ic
        n2 = (m[5] - q * m[2]) * ic
        gii = g * ic * ic
        z[VISCOUS_KK * LANES + lane] = gii
        z[VISCOUS_TK * LANES + lane] = -gii * q
        z[VISCOUS_CROSS * LANES + lane] = 2.0 * gii * q
        z[VISCOUS_TT * LANES + lane] = f + 4.0 * gii * (n0 * n0 + n1 * n1 + n2 * n2)
        z[CURVATURE * LANES + lane] = n0
        z[(CURVATURE + 1) * LANES + lane] = n1
        z[(CURVATURE + 2) * LANES + lane] = n2


@kernel
def factor_sample(p0, p1, lattice, stretch, spans, bend, rest, viscosity, tau, dim, b, j, z):
    """Factors of the Jacobian's dyads at sample j of every lane of a block."""
    s = lattice.slope
    for lane in range(LANES):
        x = lattice.xi[b, j, lane]
        w = lattice.weights[b, j, lane]
        v0 = sample_vectors(p0, dim, x, s, lane)
        v1 = sample_vectors(p1, dim, x, s, lane)
        c0, h0, d0 = invariants(v0)
        c1, h1, d1 = invariants(v1)
        s0 = np.sqrt(c0)
        s1 = np.sqrt(c1)
        ps, ps_c = stretch_terms(stretch, spans, w, x, b, lane, s0, s1)
        pc, ph, pd, pc_c, pc_h, pc_d, ph_c, pd_c, pd_d = bend_terms(bend, w, c0, c1, h0, h1, d0, d1)
        pc_c += ps_c
        m = middle(v0, v1)
        z[A1 * LANES + lane] = 2.0 * (pc + ps)
        z[A2 * LANES + lane] = pd
        z[A3 * LANES + lane] = 2.0 * ph
        for i in range(3):
            z[(TM + i) * LANES + lane] = m[i]
            z[(KM + i) * LANES + lane] = m[3 + i]
            z[(X1 + i) * LANES + lane] = 4.0 * pc_c * v1[i] + 2.0 * pc_d * v1[3 + i]
            z[(Y1 + i) * LANES + lane] = 4.0 * pc_h * v1[3 + i] + 2.0 * pc_d * v1[i]
            z[(X2 + i) * LANES + lane] = 2.0 * pd_c * v1[i] + pd_d * v1[3 + i]
            z[(Y2 + i) * LANES + lane] = pd_d * v1[i]
            z[(X3 + i) * LANES + lane] = 4.0 * ph_c * v1[i]
        factor_rest(rest, b, j, lane, z, v0, v1, m, c0, c1, s0, s1)
        factor_viscosity(viscosity, tau, stretch, bend, w, lane, z, m)


@kernel
def add_viscous_blocks(viscosity, z, i, j, lane, tt, tk, kt, kk):
    """Add the viscous part to entry (i, j) of the four Jacobian blocks."""
    if viscosity is not None:
        t_i, t_j = z[(TM + i) * LANES + lane], z[(TM + j) * LANES + lane]
        n_i, n_j = z[(CURVATURE + i) * LANES + lane], z[(CURVATURE + j) * LANES + lane]
        c = (
            z[TM * LANES + lane] ** 2
            + z[(TM + 1) * LANES + lane] ** 2
            + z[(TM + 2) * LANES + lane] ** 2
        )
        project = -t_i * t_j / c
        if i == j:
            project += 1.0
        gii = z[VISCOUS_KK * LANES + lane]
        mixed = z[VISCOUS_TK * LANES + lane]
        q = -mixed / gii if gii != 0.0 else 0.0
        tt += gii * q * q * project
        tt += (
            z[VISCOUS_CROSS * LANES + lane] * (n_i * t_j + t_i * n_j)
            + z[VISCOUS_TT * LANES + lane] * t_i * t_j
        )
        tk += mixed * project - 2.0 * gii * t_i * n_j
        kt += mixed * project - 2.0 * gii * n_i * t_j
        kk += gii * project
    return tt, tk, kt, kk


@kernel
def add_rest_blocks(rest, z, i, j, lane, tt, tk, kt):
    """Add the natural curvature to entry (i, j) of the Jacobian blocks."""
    if rest is not None:
        tt += z[(KN + i) * LANES + lane] * z[(XE + j) * LANES + lane]
        kt += z[(NT + i) * LANES + lane] * z[(XE + j) * LANES + lane]
        if i != j:
            # ([n]_x)_ij = -eps_ijk n_k
            third = 3 - i - j
            sign = 1.0 if (j - i) % 3 == 1 else -1.0
            half = 0.5 * z[PE * LANES + lane] * sign * rest.axis[third]
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
            for lane in range(LANES):
                tm, km = z[(TM + i) * LANES + lane], z[(KM + i) * LANES + lane]
                tt = tm * z[(X1 + j) * LANES + lane] + km * z[(X2 + j) * LANES + lane]
                tk = tm * z[(Y1 + j) * LANES + lane] + km * z[(Y2 + j) * LANES + lane]
                kt = km * z[(X3 + j) * LANES + lane] + tm * z[(X2 + j) * LANES + lane]
                kk = tm * z[(Y2 + j) * LANES + lane]
                if i == j:
                    tt += 0.5 * z[A1 * LANES + lane]
                    tk += 0.5 * z[A2 * LANES + lane]
                    kt += 0.5 * z[A2 * LANES + lane]
                    kk += 0.5 * z[A3 * LANES + lane]
                tt, tk, kt = add_rest_blocks(rest, z, i, j, lane, tt, tk, kt)
                tt, tk, kt, kk = add_viscous_blocks(viscosity, z, i, j, lane, tt, tk, kt, kk)
                tk *= s
                kt *= s
                kk *= s * s
                y = x[lane]
                h[row * LANES + lane] += tt
                h[(square + row) * LANES + lane] += y * tt + tk
                h[(2 * square + row) * LANES + lane] += y * (y * tt + 2.0 * tk)
                h[(3 * square + row) * LANES + lane] += y * tt + kt
                h[(4 * square + row) * LANES + lane] += y * (y * tt + tk + kt) + kk
                h[(5 * square + row) * LANES + lane] += y * (
                    y * (y * tt + 2.0 * tk + kt) + 2.0 * kk
                )
                h[(6 * square + row) * LANES + lane] += y * (y * tt + 2.0 * kt)
                h[(7 * square + row) * LANES + lane] += y * (
                    y * (y * tt + 2.0 * kt + tk) + 2.0 * kk
                )
                h[(8 * square + row) * LANES + lane] += (
                    y * y * (y * (y * tt + 2.0 * (tk + kt)) + 4.0 * kk)
                )


@kernel
def span_jacobian(
    p0, p1, lattice, stretch, spans, bend, rest, viscosity, tau, axes, scratch, jacobian
):
    """Jacobian of `span_discrete_gradient` with respect to p1, per span."""
    dim = len(axes)
    for b in range(p0.shape[0]):
        h = jacobian[b]
        for entry in range(h.shape[0]):
            h[entry] = 0.0
        mean_strains(p0[b], lattice, spans, dim, b, OLD)
        mean_strains(p1[b], lattice, spans, dim, b, NOW)
        clear_moments(spans)
        for j in range(lattice.xi.shape[1]):
            factor_sample(
                p0[b],
                p1[b],
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
                scratch,
            )
            add_moments(p0[b], p1[b], lattice, spans, viscosity, dim, b, j)
            x = lattice.xi[b, j]
            accumulate_jacobian(rest, viscosity, scratch, x, lattice.slope, dim, h)
        add_dyads(spans, viscosity, tau, dim, b, h)
