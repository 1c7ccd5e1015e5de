"""Stretching: EA/2 eps^2 with the strain eps = |r'| - 1."""

from __future__ import annotations

from dlo_sim.compiling.lanes import root
from dlo_sim.compiling.pieces import part


@part
def strain(c):
    """|r'| - 1 without cancellation for nearly unstretched cables."""
    return (c - 1.0) / (root(c) + 1.0)


@part
def energy(stiffness, c):
    """EA/2 eps^2."""
    e = strain(c)
    return 0.5 * stiffness * e * e


@part
def gradient(stiffness, c, counted):
    """d/dc of EA/2 eps^2 where the strain that counts is `counted`."""
    return 0.5 * stiffness * counted / root(c)


@part
def mean_gradient(stiffness, s0, s1, counted):
    """Divided difference in c, with the mean of the strains that count and the lengths s = |r'|."""
    return stiffness * counted / (s0 + s1)


@part
def mean_hessian(stiffness, s0, s1, counted):
    """d/dc1 of `mean_gradient` at a fixed strain that counts, and by that strain alone.

    The strain of a sample changes by 1 / (2 s1) per c1, and its mean of both by half of that.
    """
    inverse = 1.0 / (s0 + s1)
    return (
        -0.5 * stiffness * counted * inverse * inverse / s1,
        0.25 * stiffness * inverse / s1,
    )
