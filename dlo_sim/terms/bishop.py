"""Twist against a rotation-minimising (Bishop) frame: what couples it to the centerline.

A frame along the cable that follows the tangent T in time by the smallest rotations twists about
it at a rate tau(u) [rad/m], which changes between two shapes by
    (t1 x t0) . (k0 / s0 + k1 / s1) / (s0 s1 + t0 . t1),   s = |r'|,
exactly where T turns by less than half a turn. The twist is theta' + tau with the angle theta of
the material frame in that one, and GJ/2 (theta' + tau)^2 its energy. With the divided difference
(t1 - t0) . G of that change a motion of the cable works against the twisting moment M as M G; for
equal shapes G is the binormal curvature t x k / s^3.

theta is a coordinate of the frames that the motion itself carries, so tau has no derivative by r'':
the coupling does no work but what the moments at the ends do (Bergou et al. 2008, ACM Trans. Graph.
27 (3), 63; Langer & Singer 1996, SIAM Review 38, 605-618).
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import root
from dlo_sim.compiling.pieces import part
from dlo_sim.terms.natural_curvature import cross
from dlo_sim.terms.viscosity import combined, dot


@part
def sum_of_curvatures(t0, k0, t1, k1):
    """k0 / s0 + k1 / s1, and s0 s1 + t0 . t1."""
    c0, c1 = dot(t0, t0), dot(t1, t1)
    v = combined(1.0 / root(c0), k0, 1.0 / root(c1), k1)
    return v, root(c0 * c1) + dot(t0, t1)


@part
def change(t0, k0, t1, k1):
    """Change of tau from one shape to another."""
    v, scale = sum_of_curvatures(t0, k0, t1, k1)
    return dot(cross(t1, t0), v) / scale


@part
def mean_gradient(t0, k0, t1, k1):
    """G."""
    v, scale = sum_of_curvatures(t0, k0, t1, k1)
    g = cross(combined(0.5, t0, 0.5, t1), v)
    return g[0] / scale, g[1] / scale, g[2] / scale
