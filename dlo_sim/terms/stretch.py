"""Stretching: EA/2 eps^2 with the strain eps = |r'| - 1."""

from __future__ import annotations

from dlo_sim.compiling.lanes import root
from dlo_sim.compiling.pieces import part


@part
def strain(c):
    """|r'| - 1 from c = |r'|^2, without cancellation near 1."""
    return (c - 1.0) / (root(c) + 1.0)


@part
def energy(stiffness, c):
    """EA/2 eps^2."""
    e = strain(c)
    return 0.5 * stiffness * e * e


@part
def gradient(stiffness, stretched, inverse):
    """EA eps d eps/dc from `stretched` = eps |r'| and `inverse` = 1/c.

    The local strain gives eps |r'| = c - |r'|; eps may also be a projected one (`engine.elastic`).
    """
    return 0.5 * stiffness * inverse * stretched


@part
def mean_gradient(stiffness, s0, s1, counted):
    """Divided difference in c; `counted` is the mean strain, s = |r'|."""
    return stiffness * counted / (s0 + s1)


@part
def mean_hessian(stiffness, s0, s1, counted):
    """d/dc1 of `mean_gradient` in two parts: at fixed `counted`, and through the mean of the local
    strains, d counted/dc1 = 1 / (4 s1).
    """
    inverse = 1.0 / (s0 + s1)
    return (
        -0.5 * stiffness * counted * inverse * inverse / s1,
        0.25 * stiffness * inverse / s1,
    )
