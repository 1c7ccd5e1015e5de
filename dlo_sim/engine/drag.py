"""Anisotropic air drag, assembled: the excess of the normal over the tangential drag.

The force per length is - c_t v - (c_n - c_t) (v - t (t . v)) with the unit tangent t. The first
part is isotropic and belongs to the linear damping (`simulation.external_damping`); the second part
is here, with the tangents of a given shape. Both dissipate.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, store, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.elastic import (
    add_cubic,
    basis_at,
    block_of,
    curve,
    dot,
    integrated,
    line_polynomial,
    sample_of,
    scatter_values,
    store_three,
    tangent_at,
)
from dlo_sim.engine.term import DAMPING, DAMPING_TANGENT, Term
from dlo_sim.terms.viscosity import combined


@part
def drag_across(shape, model):
    """c_n - c_t [N s/m^2]."""
    return model[shape[layout.SCALES] + layout.DRAG_ACROSS * LANES]


@piece(*DAMPING)
def drag_force(shape, model, x, moved, scale, out):
    """out -= scale (c_n - c_t) integral b (v - t (t . v)) du, for v = `moved` at shape x."""
    width, scale = shape[layout.LINE], scale * drag_across(shape, model)
    for b in range(shape[layout.BLOCKS]):
        block, at = block_of(shape, b), layout.MARGIN * shape[layout.STRIDE] + LANES * b
        inverse, stride = 1.0 / load(model, block + layout.SLOPE * LANES), shape[layout.STRIDE]
        p = curve(shape, model, x, b, 1.0)
        r0 = line_polynomial(moved, at, stride, model, block)
        r1 = line_polynomial(moved, at + width, stride, model, block)
        f0 = f1 = f2 = r2 = (zero(), zero(), zero(), zero())
        if shape[layout.DIM] == 3:
            r2 = line_polynomial(moved, at + 2 * width, stride, model, block)
        for j in range(shape[layout.SAMPLES]):
            sample = sample_of(block, j)
            xi = load(model, sample + layout.XI * LANES)
            w = scale * load(model, sample + layout.QUADRATURE * LANES)
            t = tangent_at(p, xi)
            v = (
                integrated(inverse, r0, xi),
                integrated(inverse, r1, xi),
                integrated(inverse, r2, xi),
            )
            along = dot(t, v) / dot(t, t)
            f0 = add_cubic(f0, w * (v[0] - along * t[0]), xi)
            f1 = add_cubic(f1, w * (v[1] - along * t[1]), xi)
            f2 = add_cubic(f2, w * (v[2] - along * t[2]), xi)
        scatter_values(f0, at, stride, model, block, -1.0, out)
        scatter_values(f1, at + width, stride, model, block, -1.0, out)
        if shape[layout.DIM] == 3:
            scatter_values(f2, at + 2 * width, stride, model, block, -1.0, out)


@piece(*DAMPING_TANGENT)
def drag_tangent(shape, model, x, scale, scratch, band):
    """band += scale times the damping matrix of `drag_force`, minus its derivative with respect to
    v. The derivative with respect to the shape is left out. One cable only.

    `scratch`: 4 SAMPLES + 1 rows.
    """
    samples, scale = shape[layout.SAMPLES], scale * drag_across(shape, model)
    shares = 3 * samples * LANES
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        inverse = 1.0 / load(model, block + layout.SLOPE * LANES)
        p = curve(shape, model, x, b, 1.0)
        for j in range(samples):
            t = tangent_at(p, load(model, sample_of(block, j) + layout.XI * LANES))
            store_three(scratch, 3 * j * LANES, combined(1.0 / root(dot(t, t)), t, 0.0, t))
        for first in range(4):
            for other in range(4):
                for j in range(samples):
                    sample = sample_of(block, j)
                    xi = load(model, sample + layout.XI * LANES)
                    both = basis_at(model, block, first, inverse, xi)
                    both = both * basis_at(model, block, other, inverse, xi)
                    w = scale * load(model, sample + layout.QUADRATURE * LANES)
                    store(scratch, shares + j * LANES, w * both)
                add_pair(shape, b, first, other, scratch, band)


@part
def add_pair(shape, b, first, other, scratch, band):
    """Add sum_k w_k (1 - t_k t_k^T) between two control points of every span of a block."""
    dim, samples = shape[layout.DIM], shape[layout.SAMPLES]
    spare = 4 * samples * LANES
    for i in range(dim):
        for j in range(dim):
            f, unit = zero(), 1.0 if i == j else 0.0
            for k in range(samples):
                t_i = load(scratch, (3 * k + i) * LANES)
                t_j = load(scratch, (3 * k + j) * LANES)
                f += load(scratch, (3 * samples + k) * LANES) * (unit - t_i * t_j)
            store(scratch, spare, f)
            add_to_spans(shape, b, first, other, i, j, 1.0, scratch, spare, band)


TERM = Term(layout.DRAG, damping=drag_force, damping_tangent=drag_tangent)
