"""Assembly of the span guard (`terms.span_guard`): one evaluation per span, none per sample.

Where it is zero on all spans of a block, its derivatives are skipped.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import lane_sum, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine.arrays import GUARDED, SPAN_STRETCH
from dlo_sim.terms import contact, span_guard


@part
def guard_stiffness(cable, b):
    """h EA k and h EA k_c of every span of a block; 0 on lanes beyond the last and where
    the term is not active.
    """
    mesh = cable.mesh
    length = (1.0 - mesh.padding[b]) / (mesh.share[b] + mesh.padding[b])
    axial = length * mesh.axial[b]
    uneven = span_guard.STRENGTH if cable.terms & SPAN_STRETCH else 0.0
    short = span_guard.LENGTH_STRENGTH if cable.terms & GUARDED else 0.0
    return uneven * axial, short * axial


@part
def gaps_of(inner):
    """n, v0 - v and c - c0 at three places from the inner products, and the sum of the negative
    ones: 0 where there is no guard.
    """
    n, lengths = span_guard.unevenness(inner), span_guard.lengths(inner)
    room = span_guard.room(n)
    depth = contact.depth(room) + contact.depth(lengths[0])
    return n, room, lengths, depth + (contact.depth(lengths[1]) + contact.depth(lengths[2]))


@part
def guard_gradient(cable, b, inner):
    """Gradient of the guard in the form of `elastic.add_invariants`, from `elastic.products`."""
    n, room, lengths, depth = gaps_of(inner)
    if lane_sum(depth) < 0.0:
        uneven, short = guard_stiffness(cable, b)
        on_c = (
            short * contact.depth(lengths[0]),
            short * contact.depth(lengths[1]),
            short * contact.depth(lengths[2]),
        )
        return span_guard.products_gradient(-uneven * contact.depth(room), n, on_c)
    return zero(), zero(), zero(), zero(), zero(), zero()


@part
def discrete_guard_gradient(cable, b, before, after):
    """Discrete gradient of the guard between configurations with these inner products, in the form
    of `elastic.add_invariants`, to be multiplied with the mean A, B and C.
    """
    n0, room0, lengths0, depth0 = gaps_of(before)
    n1, room1, lengths1, depth1 = gaps_of(after)
    if lane_sum(depth0 + depth1) < 0.0:
        uneven, short = guard_stiffness(cable, b)
        on_v = -0.5 * contact.discrete_gradient(uneven, room0, room1)
        on_c = (
            contact.discrete_gradient(short, lengths0[0], lengths1[0]),
            contact.discrete_gradient(short, lengths0[1], lengths1[1]),
            contact.discrete_gradient(short, lengths0[2], lengths1[2]),
        )
        return span_guard.products_gradient(on_v, sums(n0, n1), on_c)
    return zero(), zero(), zero(), zero(), zero(), zero()


@part
def sums(n0, n1):
    """n0 + n1."""
    return n0[0] + n1[0], n0[1] + n1[1], n0[2] + n1[2], n0[3] + n1[3]


@part
def guard_jacobian(cable, b, before, after):
    """Derivatives of `discrete_guard_gradient` with respect to the new configuration.

    Returns:
        Factors of the products of the gradients of each of `span_guard.FORMS`, and two matrices, in
        the form of `elastic.add_invariants`, whose product is that of the gradients of v.
    """
    uneven, short = guard_stiffness(cable, b)
    n0, room0, lengths0, _ = gaps_of(before)
    n1, room1, lengths1, _ = gaps_of(after)
    on_v = -2.0 * contact.discrete_gradient(uneven, room0, room1)
    factors = (
        on_v * span_guard.WEIGHTS[0],
        on_v * span_guard.WEIGHTS[1],
        on_v * span_guard.WEIGHTS[2],
        on_v * span_guard.WEIGHTS[3],
        2.0 * contact.discrete_jacobian(short, lengths0[0], lengths1[0]),
        2.0 * contact.discrete_jacobian(short, lengths0[1], lengths1[1]),
        2.0 * contact.discrete_jacobian(short, lengths0[2], lengths1[2]),
    )
    curvature, none = contact.discrete_jacobian(uneven, room0, room1), (zero(), zero(), zero())
    middle = span_guard.products_gradient(curvature, sums(n0, n1), none)
    return factors, middle, span_guard.products_gradient(1.0, n1, none)


@part
def guard_energy(cable, b, inner):
    """Energy of the guard on every span of a block [J]."""
    uneven, short = guard_stiffness(cable, b)
    _, room, lengths, _ = gaps_of(inner)
    ends = contact.energy(short, lengths[0]) + contact.energy(short, lengths[2])
    return contact.energy(uneven, room) + (ends + contact.energy(short, lengths[1]))
