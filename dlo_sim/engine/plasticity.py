"""Plastic bending: a plastic curvature vector per quadrature point, with its flow rule.

With the curvature vector kappa = C / |t|^3 (C = t x k, t = r', k = r'') and the plastic curvature
p the stored energy per rest length is EI/2 |kappa - p|^2 + H/2 |p|^2. Of this, EI/2 |kappa|^2 is
the bending term, - EI kappa.p is in `engine.natural_curvature`, and (EI + H)/2 |p|^2 is here. The
flow rule (rate independent, linear kinematic hardening, return mapping) is applied once per step at
its end configuration: operator splitting, first order. Flow only removes energy.

With h = H / (EI + H) this is an elastic stiffness h EI beside strands of stiffness (1 - h) EI that
rub: they slip where the curvature is more than the yield curvature from p / (1 - h) (Masing, 1926).
A natural curvature kappa0 is that of the elastic part, and p = (1 - h) kappa0 before any slip.

Objectivity: p is stored in world coordinates, normal to the tangent. In the material frame (bit
MATERIAL) it follows that frame. Else it rotates by the smallest rotation from the old tangent to
the new one; only in a spin of the cable about its own axis does p then keep its direction in the
world. This rotation changes the energy by second order in the rotation per step; the ledger counts
the change as dissipated. Three dimensions only.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, root, shifted, size, store, zero
from dlo_sim.compiling.pieces import NOTHING, piece
from dlo_sim.engine import layout
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.elastic import bending_at, block_of, curve, dot, sample_of, tangent_at
from dlo_sim.engine.lines import gathered
from dlo_sim.engine.natural_curvature import plastic_rows_of, store_three, three
from dlo_sim.engine.term import ENERGY, FLOW, Term, add_energy
from dlo_sim.terms.natural_curvature import cross
from dlo_sim.terms.viscosity import combined

TINY = 1e-300


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the integral of (EI + H)/2 |p|^2 [J]."""
    sum_ = zero()
    hardening = load(model, shape[layout.SCALES] + layout.HARDENING * LANES)
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        half = 0.5 * (load(model, block + layout.BENDING * LANES) + hardening)
        for j in range(shape[layout.SAMPLES]):
            p = three(state, plastic_rows_of(shape, b, j))
            w = load(model, sample_of(block, j) + layout.QUADRATURE * LANES)
            sum_ += w * half * dot(p, p)
    add_energy(shape, sum_, layout.PLASTIC_ENERGY, out)


@piece(*FLOW)
def plastic_flow(shape, model, inputs, state, scratch):
    """Rotate p to the present tangents, then apply the return mapping."""
    x = shifted(state, shape[layout.X])
    hardening = load(model, shape[layout.SCALES] + layout.HARDENING * LANES)
    yield_moment = load(model, shape[layout.SCALES] + layout.YIELD_MOMENT * LANES)
    carried, flowed = zero(), zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        stiffness = load(model, block + layout.BENDING * LANES)
        s = load(model, block + layout.SLOPE * LANES)
        whole = stiffness + hardening
        curve_ = curve(shape, model, x, b, 1.0)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            t, k = tangent_at(curve_, xi), bending_at(curve_, xi, s)
            inverse = 1.0 / dot(t, t)
            f = inverse * root(inverse)
            kappa = combined(f, cross(t, k), 0.0, t)
            t = combined(root(inverse), t, 0.0, k)
            to = plastic_rows_of(shape, b, j)
            p, before = three(state, to), three(state, to + 3 * LANES)
            # smallest rotation from the old tangent to t, applied to p normal to the old one
            h = combined(1.0, before, 1.0, t)
            f = 2.0 * dot(t, p) / (dot(h, h) + TINY)
            carried -= w * stiffness * f * dot(h, kappa)
            p = combined(1.0, p, -f, h)
            # relative moment EI (kappa - p) - H p against the yield moment
            m = combined(stiffness, kappa, -whole, p)
            moment = root(dot(m, m))
            over = moment - yield_moment
            flow = 0.5 * (over + size(over)) / (whole + TINY)  # TINY: lanes beyond the last span
            p = combined(1.0, p, flow / (moment + TINY), m)
            store_three(state, to, p)
            store_three(state, to + 3 * LANES, t)
            flowed += w * flow * (yield_moment + 0.5 * whole * flow)
    lost, ledger = gathered(shape, flowed), shape[layout.LEDGER]
    at = ledger + layout.DISSIPATED * LANES
    store(state, at, load(state, at) + lost + gathered(shape, carried))
    at = ledger + layout.PLASTIC_WORK * LANES
    store(state, at, load(state, at) + lost)


@piece(NOTHING, CABLE, plastic_flow)
def flow_to_present(cable, plastic_flow):
    """`plastic_flow` at the present shape, for callers from Python."""
    shape, model, inputs, state, scratch = bared(cable)
    plastic_flow(shape, model, inputs, state, scratch)


TERM = Term(layout.PLASTICITY, energy=energy, flow=plastic_flow)
