"""Stretching: EA/2 eps^2 with the strain eps = |r'| - 1."""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import sqrt


@inline
def strain(c):
    """|r'| - 1 from c = |r'|^2, without cancellation near 1."""
    return (c - 1.0) / (sqrt(c) + 1.0)


@inline
def energy(stiffness, c):
    """EA/2 eps^2."""
    e = strain(c)
    return 0.5 * stiffness * e * e


@inline
def gradient(stiffness, stretched, inverse):
    """EA eps d eps/dc from `stretched` = eps |r'| and `inverse` = 1/c.

    The local strain gives eps |r'| = c - |r'|; eps may also be a projected one (`engine.elastic`).
    """
    return 0.5 * stiffness * inverse * stretched


@inline
def discrete_gradient(stiffness, s0, s1, mean_strain):
    """Divided difference in c, with s = |r'| and the mean of the strains at both configurations."""
    return stiffness * mean_strain / (s0 + s1)


@inline
def discrete_jacobian(stiffness, s0, s1, mean_strain):
    """d/dc1 of `discrete_gradient` in two parts: at fixed `mean_strain`, and through the mean of
    the local strains, d mean_strain/dc1 = 1 / (4 s1).
    """
    inverse = 1.0 / (s0 + s1)
    return (
        -0.5 * stiffness * mean_strain * inverse * inverse / s1,
        0.25 * stiffness * inverse / s1,
    )
