"""Rotation, within a step, of a vector fixed in the material frame and normal to the tangent.

The vector n at the unit tangent T becomes, for the tangent T' and the angle phi by which theta has
changed,
    P a = a - (T'.a) / (1 + T.T') (T + T'),   a = R(phi) n:
the rotation R by phi about T, then the smallest rotation P from T to T'.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import sqrt
from dlo_sim.terms.vectors import combined, cross, dot


@inline
def sine_share(z):
    """sin(phi) / phi by its series in z = phi^2: error 1e-12 up to phi = 1, 1e-4 up to 3; not valid
    for larger rotations in one step.
    """
    f = 1.0 - z * (1.0 / 156.0)
    f = 1.0 - z * (1.0 / 110.0) * f
    f = 1.0 - z * (1.0 / 72.0) * f
    f = 1.0 - z * (1.0 / 42.0) * f
    f = 1.0 - z * (1.0 / 20.0) * f
    return 1.0 - z * (1.0 / 6.0) * f


@inline
def cosine(z):
    """cos(phi) by its series in z = phi^2, likewise."""
    f = 1.0 - z * (1.0 / 182.0)
    f = 1.0 - z * (1.0 / 132.0) * f
    f = 1.0 - z * (1.0 / 90.0) * f
    f = 1.0 - z * (1.0 / 56.0) * f
    f = 1.0 - z * (1.0 / 30.0) * f
    f = 1.0 - z * (1.0 / 12.0) * f
    return 1.0 - z * 0.5 * f


@inline
def unit(t):
    """t / |t|."""
    return combined(1.0 / sqrt(dot(t, t)), t, 0.0, t)


@inline
def turned(n, t, angle):
    """R(angle) n, the rotation about the unit vector t; n is normal to t."""
    z = angle * angle
    return combined(cosine(z), n, angle * sine_share(z), cross(t, n))


@inline
def transported(a, before, t):
    """P a, by the smallest rotation from the unit tangent `before` to t."""
    return combined(1.0, a, -dot(t, a) / (1.0 + dot(before, t)), combined(1.0, before, 1.0, t))


@inline
def discrete_gradient(n, before, angle0, angle1, t0, t1, b):
    """The vector at two shapes, n0 and n1, and the divided differences G and g of
        b.(n1 - n0) = G.(t1 - t0) + g (angle1 - angle0),   b = mean of t x k,
    exact, by the product rule with symmetric means. Returns n0, n1, G, g.
    """
    s0, s1 = sqrt(dot(t0, t0)), sqrt(dot(t1, t1))
    both = 1.0 / (s0 * s1)  # divisions take most of the time
    r0, r1 = both * s1, both * s0
    u0, u1 = combined(r0, t0, 0.0, t0), combined(r1, t1, 0.0, t1)
    half = 0.5 * (angle1 - angle0)
    z = half * half
    middle = turned(n, before, 0.5 * (angle0 + angle1))
    aside, share = cross(before, middle), sine_share(z)
    a = combined(cosine(z), middle, 0.0, middle)
    a0 = combined(1.0, a, -half * share, aside)
    a1 = combined(1.0, a, half * share, aside)
    d0, d1 = 1.0 + dot(before, u0), 1.0 + dot(before, u1)
    inverse = 1.0 / (d0 * d1)
    i0, i1 = inverse * d1, inverse * d0
    h0 = combined(i0, before, i0, u0)
    h1 = combined(i1, before, i1, u1)
    along0, along1 = dot(u0, a0), dot(u1, a1)
    along, mean = 0.5 * (along0 + along1), 0.5 * (dot(h0, b) + dot(h1, b))
    u = combined(0.5, u0, 0.5, u1)
    # with respect to T1 - T0, T = t / |t|
    f = along * (dot(before, b) + dot(u, b)) * inverse
    g = combined(-mean, a, f, before)
    g = combined(1.0, g, -0.5 * along * (i0 + i1), b)
    # with respect to t1 - t0
    t = combined(0.5, t0, 0.5, t1)
    f = -2.0 * both * dot(t, g) * (1.0 / (s0 + s1))
    return (
        combined(1.0, a0, -along0, h0),
        combined(1.0, a1, -along1, h1),
        combined(0.5 * (r0 + r1), g, f, t),
        share * (dot(aside, b) - mean * dot(u, aside)),
    )
