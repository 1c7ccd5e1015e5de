"""Kelvin-Voigt damping: stress k (eps + beta d eps/dt) for each strain. The viscous moment of
bending may thin with the rate w of the curvature, beta EI w / sqrt(1 + (lambda w)^2), a model of
friction between strands (Carreau's law with exponent 0).

The rate of the curvature vector is corotational, so that a rigid motion does not dissipate. With
the projector P normal to t = r', the curvature vector n = P k / c and q = t.k / c, a motion
(dt, dk) of (r', r'') has the corotational increment
rho = (P (dk - q dt) - 2 n (t.dt)) / c.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import sqrt
from dlo_sim.terms.vectors import combined, dot


@inline
def curvature_of(t, k):
    """q, the curvature vector n, and 1 / c."""
    inverse = 1.0 / dot(t, t)
    q = dot(t, k) * inverse
    return q, combined(inverse, k, -q * inverse, t), inverse


@inline
def corotational(q, n, inverse, t, moved_t, moved_k):
    """rho of the motion (moved_t, moved_k)."""
    a = combined(1.0, moved_k, -q, moved_t)
    rho = combined(1.0, a, -dot(t, a) * inverse, t)
    return combined(inverse, rho, -2.0 * dot(t, moved_t) * inverse, n)


@inline
def bending(stiffness, thinning, t, k, moved_t, moved_k):
    """Viscous stress for a motion: that on r'; g and rho, of which g rho is that on r''; and the
    energy dissipated. `stiffness`: beta EI / tau; `thinning`: (lambda / tau)^2.
    """
    q, n, inverse = curvature_of(t, k)
    rho = corotational(q, n, inverse, t, moved_t, moved_k)
    square = dot(rho, rho)
    stiffness = stiffness / sqrt(thinning * square + 1.0)
    g = stiffness * inverse
    return combined(-2.0 * g * dot(n, rho), t, -g * q, rho), g, rho, stiffness * square


@inline
def thinned(stiffness, thinning, q, n, inverse, t, moved_t, moved_k):
    """Thinned beta EI / tau at the rate of a motion, and vectors on r' and r''. The derivative of
    the stress by the motion is `tangent_blocks` at this stiffness minus the dyad of these vectors.
    """
    rho = corotational(q, n, inverse, t, moved_t, moved_k)
    share = 1.0 / sqrt(thinning * dot(rho, rho) + 1.0)
    stiffness = stiffness * share
    f = sqrt(stiffness * thinning) * share * inverse
    return stiffness, combined(-2.0 * f * dot(n, rho), t, -f * q, rho), combined(f, rho, 0.0, rho)


@inline
def tangent_blocks(g, q, n_i, n_j, t_i, t_j, unit, inverse):
    """Entry (i, j) of the derivatives of the viscous stress by the motion: tt, tk, kt, kk.

    g is beta EI / tau / c^2. The dependence on the geometry (t, k) is left out.
    """
    project = unit - t_i * t_j * inverse
    normal = n_i * t_j + t_i * n_j
    return (
        g * (q * q * project + 2.0 * q * normal),
        -g * (q * project + 2.0 * t_i * n_j),
        -g * (q * project + 2.0 * n_i * t_j),
        g * project,
    )
