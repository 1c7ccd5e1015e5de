"""Plastic curvature at the samples: its rows in the state, and the return mapping.

The forces of an energy-momentum step contain the mean of the plastic curvature before and after it
(`layout.SLIP` is 1/2). With m = EI (kappa - p) - H p, the step then dissipates (m0 + m1)/2 .
(p1 - p0) per rest length, which is not negative since |m0| <= M_y and p changes along m1 with
|m1| = M_y. The other implicit methods contain the flow up to the configuration at which they
evaluate forces (1). Elsewhere the plastic curvature is constant (0).
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, size
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import block_of, dot, three
from dlo_sim.terms.natural_curvature import cross
from dlo_sim.terms.viscosity import combined

TINY = 1e-300
TANGENT, CURVATURE = 3 * LANES, 6 * LANES  # offsets of rows


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
def stiffness_and_hardening(shape, model, b):
    """EI + H of a block."""
    ratio = load(model, shape[layout.SCALES] + layout.HARDENING * LANES)
    return load(model, block_of(shape, b) + layout.BENDING * LANES) * (1.0 + ratio)


@part
def returned(shape, model, b, kappa, p):
    """Plastic curvature after bending to kappa."""
    stiffness = load(model, block_of(shape, b) + layout.BENDING * LANES)
    whole = stiffness_and_hardening(shape, model, b)
    m = combined(stiffness, kappa, -whole, p)
    moment = root(dot(m, m))
    over = moment - load(model, shape[layout.SCALES] + layout.YIELD_MOMENT * LANES)
    flow = 0.5 * (over + size(over)) / (whole + TINY)  # TINY: lanes beyond the last span
    return combined(1.0, p, flow / (moment + TINY), m)


@part
def slipping(shape, model, state, b, j, kappa):
    """Plastic curvature in the forces of a step that ends with kappa."""
    share = state[shape[layout.LEDGER] + layout.SLIP * LANES]
    p = three(state, plastic_rows_of(shape, b, j))
    return combined(1.0 - share, p, share, returned(shape, model, b, kappa, p))
