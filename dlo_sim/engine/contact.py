"""Contact with planes, assembled from the gap g = n . r(u) - d at the samples of every span.

n is the plane's normal, and d includes the cable's radius. The gap is linear in the control points,
hence a cubic polynomial on each span. The mesh stores the derivatives of the basis as polynomials
of the local coordinate xi; with their values at xi = 0 these determine the basis.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, size, store, total, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.elastic import (
    add_cubic,
    basis_at,
    block_of,
    integrated,
    line_polynomial,
    sample_of,
    scatter_values,
)
from dlo_sim.engine.term import ENERGY, FORCE, TANGENT, Term, add_energy
from dlo_sim.terms import contact


@part
def plane_of(shape, k):
    """Offset of the rows of plane k: components of its normal n on the lines, then d [m]."""
    return shape[layout.PLANE] + layout.PLANE_ROWS * LANES * k


@part
def gap_polynomial(shape, model, x, b, plane):
    """The gap on the spans of a block, in the form of `elastic.line_polynomial`."""
    at, width, stride = (
        layout.MARGIN * shape[layout.STRIDE] + LANES * b,
        shape[layout.LINE],
        shape[layout.STRIDE],
    )
    block = block_of(shape, b)
    g = zero() - load(model, plane + 3 * LANES), zero(), zero(), zero()
    for d in range(shape[layout.DIM]):
        normal = load(model, plane + d * LANES)
        one = line_polynomial(x, at + d * width, stride, model, block)
        g = (
            g[0] + normal * one[0],
            g[1] + normal * one[1],
            g[2] + normal * one[2],
            g[3] + normal * one[3],
        )
    return g


@piece(*FORCE)
def force(shape, model, state, x0, x1, out):
    """out -= discrete gradient of the contact energy between x0 and x1."""
    stiffness = load(model, shape[layout.SCALES] + layout.CONTACT_STIFFNESS * LANES)
    stride = shape[layout.STRIDE]
    for k in range(shape[layout.PLANES]):
        plane = plane_of(shape, k)
        for b in range(shape[layout.BLOCKS]):
            block = block_of(shape, b)
            inverse = 1.0 / load(model, block + layout.SLOPE * LANES)
            p = gap_polynomial(shape, model, x0, b, plane)
            q = gap_polynomial(shape, model, x1, b, plane)
            f = (zero(), zero(), zero(), zero())
            for j in range(shape[layout.SAMPLES]):
                at = sample_of(block, j)
                xi = load(model, at + layout.XI * LANES)
                g0, g1 = integrated(inverse, p, xi), integrated(inverse, q, xi)
                w = load(model, at + layout.QUADRATURE * LANES)
                f = add_cubic(f, w * contact.mean_gradient(stiffness, g0, g1), xi)
            for d in range(shape[layout.DIM]):
                normal = load(model, plane + d * LANES)
                at = d * shape[layout.LINE] + layout.MARGIN * stride + LANES * b
                scatter_values(f, at, stride, model, block, -normal, out)


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the contact energy [J]."""
    stiffness = load(model, shape[layout.SCALES] + layout.CONTACT_STIFFNESS * LANES)
    sum_ = zero()
    for k in range(shape[layout.PLANES]):
        for b in range(shape[layout.BLOCKS]):
            block = block_of(shape, b)
            inverse = 1.0 / load(model, block + layout.SLOPE * LANES)
            p = gap_polynomial(shape, model, x, b, plane_of(shape, k))
            for j in range(shape[layout.SAMPLES]):
                at = sample_of(block, j)
                g = integrated(inverse, p, load(model, at + layout.XI * LANES))
                w = load(model, at + layout.QUADRATURE * LANES)
                sum_ += w * contact.energy(stiffness, g)
    add_energy(shape, sum_, layout.CONTACT_ENERGY, out)


@piece(*TANGENT)
def tangent(shape, model, state, x0, x1, scale, scratch, band):
    """band += scale times the Jacobian of the discrete gradient with respect to x1; one cable only.

    `scratch`: SAMPLES + 1 rows.
    """
    stiffness = load(model, shape[layout.SCALES] + layout.CONTACT_STIFFNESS * LANES)
    spare = shape[layout.SAMPLES] * LANES
    for k in range(shape[layout.PLANES]):
        plane = plane_of(shape, k)
        for b in range(shape[layout.BLOCKS]):
            block = block_of(shape, b)
            inverse = 1.0 / load(model, block + layout.SLOPE * LANES)
            p = gap_polynomial(shape, model, x0, b, plane)
            q = gap_polynomial(shape, model, x1, b, plane)
            touched = zero()
            for j in range(shape[layout.SAMPLES]):
                at = sample_of(block, j)
                xi = load(model, at + layout.XI * LANES)
                g0, g1 = integrated(inverse, p, xi), integrated(inverse, q, xi)
                w = scale * load(model, at + layout.QUADRATURE * LANES)
                h = w * contact.mean_hessian(stiffness, g0, g1)
                store(scratch, j * LANES, h)
                touched += size(h)
            if total(touched) > 0.0:
                for first in range(4):
                    for other in range(4):
                        f = zero()
                        for j in range(shape[layout.SAMPLES]):
                            xi = load(model, sample_of(block, j) + layout.XI * LANES)
                            both = basis_at(model, block, first, inverse, xi)
                            both = both * basis_at(model, block, other, inverse, xi)
                            f += both * load(scratch, j * LANES)
                        store(scratch, spare, f)
                        add_block(shape, model, b, plane, first, other, scratch, spare, band)


@part
def add_block(shape, model, b, plane, first, other, numbers, at, band):
    """Add n n^T, times one number per span, between two control points of every span of a block."""
    for i in range(shape[layout.DIM]):
        for j in range(shape[layout.DIM]):
            product = model[plane + i * LANES] * model[plane + j * LANES]
            add_to_spans(shape, b, first, other, i, j, product, numbers, at, band)


TERM = Term(layout.CONTACT, force=force, gradient=force, energy=energy, tangent=tangent)
