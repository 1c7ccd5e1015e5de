"""Energy per length of what no knot span should do: stretch unevenly, or let its tangent vanish.

Stretching by span (`engine.elastic`) sees means of the axial strain, so that strain which varies
within a span costs nothing: a strongly bent cable can buy a small radius with a cusp, where |r'|
falls to almost nothing beside places where it is a multiple of 1. And under violent compression,
with any stretching energy, the tangent can pass through zero and a span turn over, at a clamp for
ever. The guard, of fourth order in the strain,

    U = EA_g/2 (k max(v - v0, 0)^2 + k_c sum max(c0 - c, 0)^2),

bounds v, the variance of the local strain over the span (by span only), and c = |r'|^2 at both ends
and in the middle of the span. It is exactly zero for v < v0 and |r'| > 0.5: for an even extension
of any size, and for all that a span resolves.

With r' = A + B xi + C xi^2 and |r'|^2 = A.A + u1 xi + u2 xi^2 + u3 xi^3 + u4 xi^4, v is a fourth of
the variance of |r'|^2 (for |r'| near 1 that is the variance of |r'|), a weighted sum of squares of

    n1 = u1 + 3/5 u3,   n2 = u2 + 6/7 u4,   n3 = u3,   n4 = u4

(Legendre polynomials). As v is a quadratic form in the inner products of A, B and C, and c is
linear in them, divided differences have closed forms without cancellation.

k and v0 were chosen with 60 scenes of two grippers at rest with 13 control points, of lengths 0.3
to 3 m, 2 to 98 % of the length apart, with ends turned by up to 0.5 rad. Without the guard the
local strain deviates by up to 0.4 from that of the tension, and from poor first guesses |r'| falls
to 0.003. With it |r'| is at least 0.8, and no scene whose error is below 2 % of the length errs by
more than 1.05 times what it did. A smaller v0 makes more cables too stiff in bending (v0 = 0.0025:
1.5 times), a larger k makes the wall stiff: just beyond v0 the cable is 4 k v0 = 4 times as stiff
along itself. The second part holds off a span the more the shorter it gets: turning it over takes
k_c c0^2 = 6 times the energy of compressing it to nothing.

EA_g is EA, but at most so much that no bending and no motion under gravity comes near the bounds
(`guard_stiffness`): the wall of an all but inextensible cable would be so stiff that Newton's
method takes many iterations wherever a span runs into it.

It is evaluated once per span, and only where `may_act` does not exclude it on all spans of a block.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import any_above, fabs, zero
from dlo_sim.engine.arrays import GUARDED
from dlo_sim.terms import one_sided

STRENGTH = 100.0  # k
EVEN = 0.01  # v0: a standard deviation of the strain of 10 %
NARROW = 0.2  # 2 sqrt(v0)
LENGTH_STRENGTH = 100.0  # k_c
LEAST = 0.25  # c0
# Most of EA_g, in EI / h^2 of a span h and in the weight of the cable.
MOST_BENT, MOST_PULLED = 1e6, 1e4
WEIGHTS = 1.0 / 12.0, 1.0 / 45.0, 1.0 / 175.0, 16.0 / 11025.0  # of n1^2 .. n4^2 in v
CUBIC, QUARTIC = 0.6, 6.0 / 7.0
# Half the second derivatives of n1 .. n4 and of c at the start, middle and end of a span, with
# respect to A, B and C: AA, AB, AC, BB, BC, CC.
FORMS = (
    (0.0, 1.0, 0.0, 0.0, CUBIC, 0.0),
    (0.0, 0.0, 1.0, 1.0, 0.0, QUARTIC),
    (0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
    (1.0, -1.0, 1.0, 1.0, -1.0, 1.0),
    (1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
)


def guard_stiffness(axial, bending, lengths, weight, by_span):
    """h EA_g k and h EA_g k_c [N m] of spans of these lengths h [m], shape (spans, 2).

    Args:
        axial, bending: EA [N] and EI [N m^2]. weight: of the cable on earth [N]. by_span: whether
            stretching counts by span.
    """
    most = MOST_BENT * bending / lengths**2 + MOST_PULLED * weight
    guarding = lengths * np.minimum(axial, most)
    return np.stack([STRENGTH * by_span * guarding, LENGTH_STRENGTH * guarding], axis=1)


@inline
def stiffness_on(cable, b):
    """`guard_stiffness` of a block; the second is 0 without the term GUARDED, as with explicit
    methods (`simulation.stepper`).
    """
    short = 1.0 if cable.terms & GUARDED else 0.0
    return cable.mesh.guard[b, 0], short * cable.mesh.guard[b, 1]


@inline
def products_gradient(on_v, n, on_c):
    """Half the gradient with respect to A, B and C as a matrix AA, AB, AC, BB, BC, CC that
    multiplies them, from dU/dv, n, and dU/dc at the three places. For the discrete gradient: from
    divided differences and the means of n.
    """
    f1, f2 = 2.0 * on_v * WEIGHTS[0] * n[0], 2.0 * on_v * WEIGHTS[1] * n[1]
    f3, f4 = 2.0 * on_v * WEIGHTS[2] * n[2], 2.0 * on_v * WEIGHTS[3] * n[3]
    even, odd = on_c[0] + on_c[2], on_c[2] - on_c[0]
    return (
        even + on_c[1],
        odd + f1,
        even + f2,
        even + f2,
        odd + (CUBIC * f1 + f3),
        even + (QUARTIC * f2 + f4),
    )


@inline
def may_act(inner):
    """Whether the guard may act on a span of a block with these inner products. It does not where
    the largest |c - A.A| on a span is below 2 sqrt(v0), as that limits v to v0, and below A.A - c0.
    """
    aa, ab, ac, bb, bc, cc = inner
    spread = fabs(ab + ab) + fabs(bb + (ac + ac)) + (fabs(bc + bc) + cc)
    return any_above(spread - NARROW) or any_above(spread - (aa - LEAST))


@inline
def gaps_of(inner):
    """n, v0 - v, and c - c0 at the start, the middle and the end, from the inner products AA, AB,
    AC, BB, BC, CC.
    """
    aa, ab, ac, bb, bc, cc = inner
    u3 = 2.0 * bc
    n = 2.0 * ab + CUBIC * u3, bb + 2.0 * ac + QUARTIC * cc, u3, cc
    v = WEIGHTS[0] * n[0] * n[0] + WEIGHTS[1] * n[1] * n[1]
    room = EVEN - (v + (WEIGHTS[2] * n[2] * n[2] + WEIGHTS[3] * n[3] * n[3]))
    even, odd = aa + (bb + 2.0 * ac) + cc - LEAST, 2.0 * (ab + bc)
    return n, room, (even - odd, aa - LEAST, even + odd)


@inline
def guard_gradient(cable, b, inner):
    """Gradient of the guard in the form of `elastic.add_invariants`, from `elastic.products`."""
    if may_act(inner):
        n, room, lengths = gaps_of(inner)
        uneven, short = stiffness_on(cable, b)
        on_c = (
            short * one_sided.depth(lengths[0]),
            short * one_sided.depth(lengths[1]),
            short * one_sided.depth(lengths[2]),
        )
        return products_gradient(-uneven * one_sided.depth(room), n, on_c)
    return zero(), zero(), zero(), zero(), zero(), zero()


@inline
def discrete_guard_gradient(cable, b, before, after):
    """Discrete gradient of the guard between configurations with these inner products, in the form
    of `elastic.add_invariants`, to be multiplied with the mean A, B and C.
    """
    n0, room0, lengths0 = gaps_of(before)
    n1, room1, lengths1 = gaps_of(after)
    uneven, short = stiffness_on(cable, b)
    on_v = -0.5 * one_sided.discrete_gradient(uneven, room0, room1)
    on_c = (
        one_sided.discrete_gradient(short, lengths0[0], lengths1[0]),
        one_sided.discrete_gradient(short, lengths0[1], lengths1[1]),
        one_sided.discrete_gradient(short, lengths0[2], lengths1[2]),
    )
    return products_gradient(on_v, sums(n0, n1), on_c)


@inline
def sums(n0, n1):
    """n0 + n1."""
    return n0[0] + n1[0], n0[1] + n1[1], n0[2] + n1[2], n0[3] + n1[3]


@inline
def guard_jacobian(cable, b, before, after):
    """Derivatives of `discrete_guard_gradient` with respect to the new configuration.

    Returns:
        Factors of the products of the gradients of each of `FORMS`, and two matrices, in
        the form of `elastic.add_invariants`, whose product is that of the gradients of v.
    """
    uneven, short = stiffness_on(cable, b)
    n0, room0, lengths0 = gaps_of(before)
    n1, room1, lengths1 = gaps_of(after)
    on_v = -2.0 * one_sided.discrete_gradient(uneven, room0, room1)
    factors = (
        on_v * WEIGHTS[0],
        on_v * WEIGHTS[1],
        on_v * WEIGHTS[2],
        on_v * WEIGHTS[3],
        2.0 * one_sided.discrete_jacobian(short, lengths0[0], lengths1[0]),
        2.0 * one_sided.discrete_jacobian(short, lengths0[1], lengths1[1]),
        2.0 * one_sided.discrete_jacobian(short, lengths0[2], lengths1[2]),
    )
    curvature, none = one_sided.discrete_jacobian(uneven, room0, room1), (zero(), zero(), zero())
    middle = products_gradient(curvature, sums(n0, n1), none)
    return factors, middle, products_gradient(1.0, n1, none)


@inline
def guard_energy(cable, b, inner):
    """Energy of the guard on every span of a block [J]."""
    uneven, short = stiffness_on(cable, b)
    _, room, lengths = gaps_of(inner)
    ends = one_sided.energy(short, lengths[0]) + one_sided.energy(short, lengths[2])
    return one_sided.energy(uneven, room) + (ends + one_sided.energy(short, lengths[1]))
