"""Plastic curvature at the samples: its rows in the state, and the return mapping.

Within an implicit step the forces contain the mean of the plastic curvature before and after the
step (`layout.SLIP` is 1/2). With m = EI (kappa - p) - H p, the step then dissipates (m0 + m1)/2 .
(p1 - p0) per rest length, which is not negative since |m0| <= M_y and p changes along m1 with
|m1| = M_y. Elsewhere the plastic curvature is constant: `layout.SLIP` is 0.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, size, store
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import block_of, dot, sample_of
from dlo_sim.terms.natural_curvature import cross
from dlo_sim.terms.viscosity import combined

TINY = 1e-300
TANGENT, CURVATURE = 3 * LANES, 6 * LANES  # offsets of rows


@part
def three(array, at):
    """Load three rows as a vector."""
    return load(array, at), load(array, at + LANES), load(array, at + 2 * LANES)


@part
def store_three(array, at, v):
    """Store a vector as three rows."""
    store(array, at, v[0])
    store(array, at + LANES, v[1])
    store(array, at + 2 * LANES, v[2])


@part
def plastic_rows_of(shape, b, j):
    """Offset of the rows of sample j of block b: plastic curvature (3), and at the end of the last
    step unit tangent (3) and curvature (3).
    """
    return shape[layout.PLASTIC] + (b * shape[layout.SAMPLES] + j) * layout.PLASTIC_ROWS * LANES


@part
def curvature(t, k):
    """kappa = t x k / |t|^3 of t = r', k = r''."""
    c = dot(t, t)
    return combined(1.0 / (c * root(c)), cross(t, k), 0.0, t)


@part
def returned(shape, model, b, kappa, p):
    """Plastic curvature after bending to kappa, the direction of m, and the amount of flow."""
    stiffness = load(model, block_of(shape, b) + layout.BENDING * LANES)
    whole = stiffness + load(model, shape[layout.SCALES] + layout.HARDENING * LANES)
    m = combined(stiffness, kappa, -whole, p)
    moment = root(dot(m, m))
    over = moment - load(model, shape[layout.SCALES] + layout.YIELD_MOMENT * LANES)
    flow = 0.5 * (over + size(over)) / (whole + TINY)  # TINY: lanes beyond the last span
    way = combined(1.0 / (moment + TINY), m, 0.0, m)
    return combined(1.0, p, flow, way), way, flow


@part
def share_of_slip(shape, state):
    """Share of the plastic flow of the present step that its forces contain."""
    return state[shape[layout.LEDGER] + layout.SLIP * LANES]


@part
def slipping(shape, model, state, b, j, kappa):
    """Plastic curvature in the forces of a step that ends with kappa."""
    p = three(state, plastic_rows_of(shape, b, j))
    share = share_of_slip(shape, state)
    if share > 0.0:
        after, _, _ = returned(shape, model, b, kappa, p)
        p = combined(1.0 - share, p, share, after)
    return p


@part
def softening(shape, model, state, b, j, t, k):
    """Vectors on r' and r'' whose dyad the flow takes off the Jacobian of a step that ends with
    t, k: share * weight * EI^2 / (EI + H) d(m.kappa)/d(t, k), squared, along the direction of m.
    """
    kappa = curvature(t, k)
    p = three(state, plastic_rows_of(shape, b, j))
    _, way, flow = returned(shape, model, b, kappa, p)
    block = block_of(shape, b)
    stiffness = load(model, block + layout.BENDING * LANES)
    whole = stiffness + load(model, shape[layout.SCALES] + layout.HARDENING * LANES)
    weight = load(model, sample_of(block, j) + layout.QUADRATURE * LANES)
    weight = weight * stiffness * stiffness / (whole + TINY) * share_of_slip(shape, state)
    f = root(weight * flow / (flow + TINY))
    c = dot(t, t)
    g = f / (c * root(c))
    on_t = combined(g, cross(k, way), -3.0 * f * dot(way, kappa) / c, t)
    return on_t, combined(g, cross(way, t), 0.0, t)
