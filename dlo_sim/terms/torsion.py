"""Twist relative to the Frenet torsion gamma: the part of its energy that depends on gamma.

With t = r', k = r'', c = r''' and C = t x k the torsion of the centreline is gamma = C.c / |C|^2,
which is 0/0 on a straight cable and at an inflection. It is regularised as
    gamma = C.c / (|C|^2 + delta^2)
with the curvature floor delta [1/m]: the true torsion times |C|^2 / (|C|^2 + delta^2). This is
smooth, zero on a straight cable, and bounded by |c| / (2 delta). The limits: where |C| is below
delta, torsion is reduced by more than half; those samples are counted. The jump of the Frenet frame
by half a turn at an inflection does not appear at all.

GJ/2 (theta' - gamma)^2 is GJ/2 theta'^2, the plain twist term, plus
GJ (gamma^2 / 2 - theta' gamma), which is here. Three dimensions only.
"""

from __future__ import annotations

from dlo_sim.compiling.pieces import part
from dlo_sim.terms.vectors import cross


@part
def torsion(floor, t, k, third):
    """gamma, C, 1 / (|C|^2 + delta^2), |C|^2; `floor` is delta^2."""
    b = cross(t, k)
    square = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    inverse = 1.0 / (square + floor)
    return (b[0] * third[0] + b[1] * third[1] + b[2] * third[2]) * inverse, b, inverse, square


@part
def energy(stiffness, floor, t, k, third, rate):
    """GJ (gamma^2 / 2 - theta' gamma)."""
    gamma, _, _, _ = torsion(floor, t, k, third)
    return stiffness * gamma * (0.5 * gamma - rate)


@part
def gradient(stiffness, floor, t, k, third, rate):
    """Gradients with respect to r', r'', r''' and theta'."""
    gamma, b, inverse, _ = torsion(floor, t, k, third)
    f = stiffness * (gamma - rate) * inverse  # dU = f (C.dc + e.dC), e = c - 2 gamma C
    e = (
        f * (third[0] - 2.0 * gamma * b[0]),
        f * (third[1] - 2.0 * gamma * b[1]),
        f * (third[2] - 2.0 * gamma * b[2]),
    )
    return cross(k, e), cross(e, t), (f * b[0], f * b[1], f * b[2]), -stiffness * gamma


@part
def excess(floor, t, k):
    """|C|^2 - delta^2: negative where torsion is reduced by more than half."""
    b = cross(t, k)
    return b[0] * b[0] + b[1] * b[1] + b[2] * b[2] - floor
