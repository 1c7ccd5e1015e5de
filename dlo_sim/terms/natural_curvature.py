"""Natural curvature: - e / c^(3/2) with e = n . (r' x r'') and the vector n = EI kappa0 [N m].

This is the mixed term of EI/2 |kappa - kappa0|^2, with the curvature kappa0 of the unloaded cable
or the plastic curvature. The constant EI/2 |kappa0|^2 is left out.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import sqrt
from dlo_sim.compiling.pieces import part
from dlo_sim.terms.vectors import cross


@part
def triple(n, t, k):
    """e = n . (t x k)."""
    b = cross(t, k)
    return n[0] * b[0] + n[1] * b[1] + n[2] * b[2]


@part
def energy(n, t, k, c):
    """- e / c^(3/2)."""
    return -triple(n, t, k) / (c * sqrt(c))


@part
def discrete_gradient(c0, c1, e0, e1):
    """Divided differences in c and e."""
    s0, s1 = sqrt(c0), sqrt(c1)
    both = 1.0 / (s0 * s1)
    cube = both * both * both
    return (
        0.5 * (e0 + e1) * (c0 + s0 * s1 + c1) * cube * (1.0 / (s0 + s1)),
        -0.5 * (c0 * s0 + c1 * s1) * cube,
    )


@part
def discrete_jacobian(c0, c1, e0, e1):
    """Derivatives of the divided differences (c, e) by (c1, e1): cc, ce, ec; ee is zero."""
    s0, s1 = sqrt(c0), sqrt(c1)
    numerator = c0 + s0 * s1 + c1
    denominator = c0 * s0 * c1 * s1 * (s0 + s1)
    slope = numerator * c0 * s0 * c1 * (3.0 * s0 + 4.0 * s1) / (denominator * denominator)
    slope -= (s0 + 2.0 * s1) / denominator
    return (
        -0.25 * (e0 + e1) * slope / s1,
        0.5 * numerator / denominator,
        0.75 / (c1 * c1 * s1),
    )
