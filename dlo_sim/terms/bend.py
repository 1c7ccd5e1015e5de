"""Bending: EI/2 kappa^2 = EI/2 (h / c^2 - d^2 / c^3), kappa the curvature of the centreline."""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline


@inline
def energy(stiffness, t, k, c):
    """EI/2 |t x k|^2 / c^3; in terms of h and d it would cancel for a straight cable."""
    b0 = t[1] * k[2] - t[2] * k[1]
    b1 = t[2] * k[0] - t[0] * k[2]
    b2 = t[0] * k[1] - t[1] * k[0]
    return 0.5 * stiffness * (b0 * b0 + b1 * b1 + b2 * b2) / (c * c * c)


@inline
def gradient(stiffness, d, h, inverse):
    """d/dc, half of d/dd, d/dh; `inverse` is 1/c."""
    f = 0.5 * stiffness * inverse * inverse
    q = d * inverse
    return f * inverse * (3.0 * d * q - 2.0 * h), -f * q, f


@inline
def discrete_gradient(stiffness, c0, d0, h0, c1, d1, h1):
    """Divided differences in c, d, h: the product rule with symmetric means."""
    half = 0.5 * stiffness
    i0, i1 = 1.0 / c0, 1.0 / c1
    g0, g1 = i0 * i0, i1 * i1
    j0, j1 = g0 * i0, g1 * i1
    squares = c0 * c0 + c0 * c1 + c1 * c1
    hm, dm = 0.5 * (h0 + h1), 0.5 * (d0 + d1)
    dd = 0.5 * (d0 * d0 + d1 * d1)
    return (
        half * (dd * squares * j0 * j1 - hm * (c0 + c1) * g0 * g1),
        -half * (j0 + j1) * dm,
        0.5 * half * (g0 + g1),
    )


@inline
def discrete_jacobian(stiffness, c0, d0, h0, c1, d1, h1):
    """Derivatives of the divided differences (c, d, h) by (c1, d1, h1): cc, cd, ch, dc, dd, hc.

    Not symmetric; hd, hh and dh are zero.
    """
    half = 0.5 * stiffness
    i0, i1 = 1.0 / c0, 1.0 / c1
    g0, g1 = i0 * i0, i1 * i1
    j0, j1 = g0 * i0, g1 * i1
    both = c0 + c1
    squares = c0 * c0 + c0 * c1 + c1 * c1
    gd, jd = -both * g0 * g1, -squares * j0 * j1
    hm, dm = 0.5 * (h0 + h1), 0.5 * (d0 + d1)
    dd = 0.5 * (d0 * d0 + d1 * d1)
    gd_c = g0 * (2.0 * both * j1 - g1)
    jd_c = j0 * (3.0 * squares * g1 * g1 - (c0 + 2.0 * c1) * j1)
    return (
        half * (hm * gd_c - dd * jd_c),
        -half * d1 * jd,
        0.5 * half * gd,
        3.0 * half * dm * g1 * g1,
        -0.5 * half * (j0 + j1),
        -half * j1,
    )
