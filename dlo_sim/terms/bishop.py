"""Twist relative to a rotation-minimising (Bishop) frame: its coupling to the centreline.

Frames along the cable that follow the unit tangent T in time by the smallest rotations have a twist
rate tau(u) [rad/m] along it, which changes between two shapes by
    (t1 x t0) . (k0 / s0 + k1 / s1) / (s0 s1 + t0 . t1),   s = |r'|,
exactly if T turns by less than half a turn. With the angle theta from that frame to the material
frame, the twist is theta' + tau and its energy GJ/2 (theta' + tau)^2. The change of tau equals
(t1 - t0) . G, so the twisting moment M acts on r' as M G; for equal shapes G is the binormal
curvature t x k / s^3.

theta is an angle in frames that move with the cable, so tau has no derivative by r'': the coupling
does no work except that of the moments at the ends (Bergou et al. 2008, ACM Trans. Graph. 27 (3),
63; Langer & Singer 1996, SIAM Review 38, 605-618).
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import sqrt
from dlo_sim.compiling.pieces import part
from dlo_sim.terms.vectors import combined, cross, dot


@part
def sum_of_curvatures(t0, k0, t1, k1):
    """s0 s1 (k0 / s0 + k1 / s1), and 1 / (s0 s1 (s0 s1 + t0 . t1)): two square roots and one
    division, which take most of the time.
    """
    s0, s1 = sqrt(dot(t0, t0)), sqrt(dot(t1, t1))
    both = s0 * s1
    return combined(s1, k0, s0, k1), 1.0 / (both * (both + dot(t0, t1)))


@part
def change(t0, k0, t1, k1):
    """Change of tau [rad/m] from shape 0 to shape 1."""
    v, share = sum_of_curvatures(t0, k0, t1, k1)
    return share * dot(cross(t1, t0), v)


@part
def discrete_gradient(t0, k0, t1, k1):
    """G, such that the twisting moment M acts on r' as M G."""
    v, share = sum_of_curvatures(t0, k0, t1, k1)
    half = 0.5 * share
    return cross(combined(half, t0, half, t1), v)
