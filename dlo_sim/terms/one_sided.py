"""Energy of what only pushes: k/2 min(g, 0)^2, with the gap g to an obstacle (`engine.contact`), or
what a strain has left to its bound (`engine.span_guard`).
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import fabs

TINY = 1e-300  # avoids 0/0 for two gaps of zero


@inline
def depth(g):
    """min(g, 0)."""
    return 0.5 * (g - fabs(g))


@inline
def energy(stiffness, g):
    """k/2 min(g, 0)^2."""
    d = depth(g)
    return 0.5 * stiffness * d * d


@inline
def share_inside(g0, g1):
    """Share of the interval from g0 to g1 that is negative."""
    return fabs(depth(g0) + depth(g1)) / (fabs(g0) + fabs(g1) + TINY)


@inline
def discrete_gradient(stiffness, g0, g1):
    """Divided difference of the energy: k times the mean depth times `share_inside`, without
    cancellation; for g0 = g1 the derivative.
    """
    return 0.5 * stiffness * (depth(g0) + depth(g1)) * share_inside(g0, g1)


@inline
def discrete_jacobian(stiffness, g0, g1):
    """d/dg1 of `discrete_gradient`."""
    share, sign = share_inside(g0, g1), g1 / (fabs(g1) + TINY)
    return 0.5 * stiffness * share * (1.0 - sign + share * sign)
