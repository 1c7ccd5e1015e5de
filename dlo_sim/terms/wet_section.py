"""How much of a round section is in water at the depth t of its centre below the surface, in radii,
and the potential of its buoyancy.

From t = -1 to 1 the share is 1/2 + t p(t^2), with a polynomial p that follows the segment of the
circle, 1/2 + (asin t + t (1 - t^2)^(1/2)) / pi, to 0.0014 and ends with its value and slope; its
integral is a polynomial, too, so that the energy of a step is exact.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import fabs, where

P0, P1, P2, P3, P4 = 0.62422, 0.06107, -0.62527, 0.82045, -0.38047
BEGIN = 0.5 - (P0 / 2.0 + P1 / 4.0 + P2 / 6.0 + P3 / 8.0 + P4 / 10.0)  # makes the potential 0 at -1
SMALL = 1e-4  # change of t below which divided differences are derivatives, to 1e-9


@inline
def within(t):
    """t from -1 to 1, beyond it the nearer bound."""
    return 0.5 * (fabs(t + 1.0) - fabs(t - 1.0))


@inline
def share(t):
    """Share of the section in water, from 0 to 1."""
    s = within(t)
    q = s * s
    return 0.5 + s * (P0 + q * (P1 + q * (P2 + q * (P3 + q * P4))))


@inline
def slope(t):
    """Derivative of the share."""
    q = within(t)
    q = q * q
    return P0 + q * (3.0 * P1 + q * (5.0 * P2 + q * (7.0 * P3 + q * (9.0 * P4))))


@inline
def potential(t):
    """Integral of the share from -1 to t."""
    s = within(t)
    q = s * s
    even = P0 / 2.0 + q * (P1 / 4.0 + q * (P2 / 6.0 + q * (P3 / 8.0 + q * (P4 / 10.0))))
    return BEGIN + 0.5 * s + q * even + 0.5 * (t - s + fabs(t - s))


@inline
def discrete_gradient(t0, t1):
    """Divided difference of the potential; for t0 = t1 the share."""
    change = t1 - t0
    far = fabs(change) - SMALL
    difference = (potential(t1) - potential(t0)) / where(far, change, 1.0)
    return where(far, difference, share(0.5 * (t0 + t1)))


@inline
def discrete_jacobian(t0, t1):
    """d/dt1 of `discrete_gradient`."""
    change = t1 - t0
    far = fabs(change) - SMALL
    difference = (share(t1) - discrete_gradient(t0, t1)) / where(far, change, 1.0)
    return where(far, difference, 0.5 * slope(0.5 * (t0 + t1)))
