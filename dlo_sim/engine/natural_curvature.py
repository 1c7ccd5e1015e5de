"""Natural and plastic curvature, assembled: vectors per sample, fixed in the world or the material
frame.

Fixed in the world, the natural curvature in the state changes only if the caller rotates it, the
plastic one at the end of a step (`engine.plasticity`). In the material frame (bit MATERIAL) the
state holds the vectors at the end of the last step; within a step they rotate with the tangent and
with theta (`terms.material_frame`), which couples bending to twist.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, shifted, store, zero
from dlo_sim.compiling.pieces import NO, NOTHING, YES, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.elastic import (
    add_cubic,
    add_sample,
    basis_at,
    bending_at,
    block_of,
    curve,
    integrated,
    line_polynomial,
    sample_of,
    scatter_lines,
    scatter_values,
    store_three,
    tangent_at,
    three,
)
from dlo_sim.engine.slip import (
    CURVATURE,
    TANGENT,
    curvature,
    plastic_rows_of,
    slipping,
)
from dlo_sim.engine.term import ENERGY, FORCE, Term, add_energy
from dlo_sim.terms import material_frame, natural_curvature
from dlo_sim.terms.viscosity import combined, dot


@part
def rows_of(shape, b, j):
    """Offset of the rows of sample j of block b: weight EI kappa0 (3), rest twist [rad/m]."""
    return shape[layout.NATURAL] + (b * shape[layout.SAMPLES] + j) * layout.NATURAL_ROWS * LANES


@part
def moment_weight(shape, model, b, j):
    """Quadrature weight times EI of sample j of block b."""
    block = block_of(shape, b)
    weight = load(model, sample_of(block, j) + layout.QUADRATURE * LANES)
    return weight * load(model, block + layout.BENDING * LANES)


@part
def natural_with(shape, model, state, b, j, p):
    """Natural curvature plus p of sample j of block b, times quadrature weight and EI."""
    return combined(1.0, three(state, rows_of(shape, b, j)), moment_weight(shape, model, b, j), p)


@part
def natural_at(shape, model, state, b, j):
    """Natural plus plastic curvature of sample j of block b, times quadrature weight and EI."""
    if shape[layout.TERMS] & layout.PLASTICITY:
        p = three(state, plastic_rows_of(shape, b, j))
        return natural_with(shape, model, state, b, j, p)
    return three(state, rows_of(shape, b, j))


@part
def curvature_before(before, t, k, angle):
    """Curvature of t, k rotated back by `vector_now`."""
    kappa = curvature(t, k)
    u, now = material_frame.unit(before), material_frame.unit(t)
    return material_frame.turned(material_frame.transported(kappa, now, u), u, -angle)


@part
def rest_twist_at(shape, state, b, j):
    """Twist rate [rad/m] of the unloaded cable at sample j of block b."""
    if shape[layout.TERMS] & layout.MATERIAL:
        return load(state, rows_of(shape, b, j) + 3 * LANES)
    return zero()


@part
def turn_polynomial(shape, model, reference, x, b):
    """Change of theta since the last step on the spans of a block, as `elastic.line_polynomial`."""
    at = shape[layout.DIM] * shape[layout.LINE] + layout.MARGIN + LANES * b
    block = block_of(shape, b)
    p = line_polynomial(x, at, 1, model, block)
    q = line_polynomial(reference, at, 1, model, block)
    return p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3] - q[3]


@part
def natural_force(shape, model, state, x0, x1, turn, push, out):
    """out -= discrete gradient between x0 and x1, on theta (`turn`) and the centreline (`push`)."""
    follows = shape[layout.TERMS] & layout.MATERIAL != 0
    reference = x0
    if follows:
        reference = shifted(state, shape[layout.REFERENCE])
    at_twist = shape[layout.DIM] * shape[layout.LINE] + layout.MARGIN
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p, q = curve(shape, model, x0, b, 1.0), curve(shape, model, x1, b, 1.0)
        r = p
        angle0 = angle1 = (zero(), zero(), zero(), zero())
        if follows:
            r = curve(shape, model, reference, b, 1.0)
            angle0 = turn_polynomial(shape, model, reference, x0, b)
            angle1 = turn_polynomial(shape, model, reference, x1, b)
        g0 = g1 = g2 = (zero(), zero(), zero())
        twisted = (zero(), zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            xi = load(model, sample_of(block, j) + layout.XI * LANES)
            ta, ka = tangent_at(p, xi), bending_at(p, xi, s)
            tb, kb = tangent_at(q, xi), bending_at(q, xi, s)
            t, k = combined(0.5, ta, 0.5, tb), combined(0.5, ka, 0.5, kb)
            n0 = three(state, rows_of(shape, b, j))
            if shape[layout.TERMS] & layout.PLASTICITY:
                kappa = curvature(tb, kb)
                if follows:
                    turned = integrated(1.0 / s, angle1, xi)
                    kappa = curvature_before(tangent_at(r, xi), tb, kb, turned)
                plastic = slipping(shape, model, state, b, j, kappa)
                n0 = natural_with(shape, model, state, b, j, plastic)
            n1 = n0
            on_t = (zero(), zero(), zero())
            on_angle = zero()
            if follows:
                across0, across1 = natural_curvature.cross(ta, ka), natural_curvature.cross(tb, kb)
                n0, n1, on_t, on_angle = material_frame.discrete_gradient(
                    n0, material_frame.unit(tangent_at(r, xi)),
                    integrated(1.0 / s, angle0, xi), integrated(1.0 / s, angle1, xi),
                    ta, tb, combined(0.5, across0, 0.5, across1),
                )  # fmt: skip
            more_c, on_e = natural_curvature.mean_gradient(
                dot(ta, ta), dot(tb, tb),
                natural_curvature.triple(n0, ta, ka), natural_curvature.triple(n1, tb, kb),
            )  # fmt: skip
            if turn:
                twisted = add_cubic(twisted, on_e * on_angle, xi)
            if push:
                n = combined(0.5, n0, 0.5, n1)
                on_t = combined(on_e, on_t, 2.0 * more_c, t)
                on_t = combined(1.0, on_t, on_e, natural_curvature.cross(k, n))
                on_k = combined(on_e, natural_curvature.cross(n, t), 0.0, t)
                g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
                g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
                g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
        if push:
            scatter_lines(shape, model, b, g0, g1, g2, -1.0, out)
        if turn:
            scatter_values(twisted, at_twist + LANES * b, 1, model, block, -1.0, out)


@piece(*FORCE)
def force(shape, model, state, x0, x1, out):
    """`natural_force` on all coordinates."""
    follows = shape[layout.TERMS] & layout.MATERIAL != 0
    natural_force(shape, model, state, x0, x1, follows, YES, out)


@piece(*FORCE)
def gradient(shape, model, state, x0, x1, out):
    """`natural_force` if fixed in the world; else `methods.twist_step` adds it with theta."""
    if not shape[layout.TERMS] & layout.MATERIAL:
        natural_force(shape, model, state, x0, x1, NO, YES, out)


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the energy of the natural curvature [J] to the bending energy."""
    sum_ = zero()
    follows = shape[layout.TERMS] & layout.MATERIAL != 0
    reference = x
    if follows:
        reference = shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p = curve(shape, model, x, b, 1.0)
        r, angle = p, (zero(), zero(), zero(), zero())
        if follows:
            r = curve(shape, model, reference, b, 1.0)
            angle = turn_polynomial(shape, model, reference, x, b)
        for j in range(shape[layout.SAMPLES]):
            xi = load(model, sample_of(block, j) + layout.XI * LANES)
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            n = natural_at(shape, model, state, b, j)
            if follows:
                n = vector_now(n, tangent_at(r, xi), t, integrated(1.0 / s, angle, xi))
            sum_ += natural_curvature.energy(n, t, k, dot(t, t))
    add_energy(shape, sum_, layout.BENDING_ENERGY, out)


@part
def vector_now(n, before, t, angle):
    """Rotate n by `angle` about the tangent `before`, then by the smallest rotation to t."""
    u = material_frame.unit(before)
    return material_frame.transported(material_frame.turned(n, u, angle), u, material_frame.unit(t))


@part
def follow_natural(shape, model, state, x):
    """Rotate the vectors in the state to the material frame at the end of a step."""
    reference = shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        s = load(model, block_of(shape, b) + layout.SLOPE * LANES)
        p, r = curve(shape, model, x, b, 1.0), curve(shape, model, reference, b, 1.0)
        angle = turn_polynomial(shape, model, reference, x, b)
        for j in range(shape[layout.SAMPLES]):
            xi = load(model, sample_of(block_of(shape, b), j) + layout.XI * LANES)
            before, t = tangent_at(r, xi), tangent_at(p, xi)
            turned = integrated(1.0 / s, angle, xi)
            at = rows_of(shape, b, j)
            store_three(state, at, vector_now(three(state, at), before, t, turned))
            if shape[layout.TERMS] & layout.PLASTICITY:
                at = plastic_rows_of(shape, b, j)
                store_three(state, at, vector_now(three(state, at), before, t, turned))
                store_three(state, at + TANGENT, material_frame.unit(t))
                at += CURVATURE
                store_three(state, at, vector_now(three(state, at), before, t, turned))


@piece(NOTHING, CABLE)
def follow_to_present(cable):
    """`follow_natural` to the present shape, for callers from Python."""
    shape, model, _, state, _ = bared(cable)
    follow_natural(shape, model, state, shifted(state, shape[layout.X]))


@part
def add_natural_stiffness(shape, model, state, x0, x1, matrix):
    """matrix += derivative with respect to theta at x1 of the discrete gradient on theta, to first
    order in the step; four lower diagonals of n entries each. One cable only.
    """
    n = shape[layout.N]
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p, q = curve(shape, model, x0, b, 1.0), curve(shape, model, x1, b, 1.0)
        reference = shifted(state, shape[layout.REFERENCE])
        r = curve(shape, model, reference, b, 1.0)
        angle0 = turn_polynomial(shape, model, reference, x0, b)
        angle1 = turn_polynomial(shape, model, reference, x1, b)
        for j in range(shape[layout.SAMPLES]):
            xi = load(model, sample_of(block, j) + layout.XI * LANES)
            ta, tb = tangent_at(p, xi), tangent_at(q, xi)
            ka, kb = bending_at(p, xi, s), bending_at(q, xi, s)
            t, k = combined(0.5, ta, 0.5, tb), combined(0.5, ka, 0.5, kb)
            angle = 0.5 * (integrated(1.0 / s, angle0, xi) + integrated(1.0 / s, angle1, xi))
            m = vector_now(natural_at(shape, model, state, b, j), tangent_at(r, xi), t, angle)
            c = dot(t, t)
            f = -0.5 * natural_curvature.energy(m, t, k, c)
            for first in range(4):
                g = f * basis_at(model, block, first, 1.0 / s, xi)
                for other in range(first + 1):
                    to = (first - other) * n + LANES * b + other
                    entry = g * basis_at(model, block, other, 1.0 / s, xi)
                    store(matrix, to, load(matrix, to) + entry)


# Its Jacobian is assembled with that of bending, which uses the same vectors: `engine.tangent`.
TERM = Term(layout.CURVED, force=force, gradient=gradient, energy=energy)
