"""Plastic bending: a plastic curvature vector per quadrature point, with its flow rule.

With the curvature vector kappa = C / |t|^3 (C = t x k, t = r', k = r'') and the plastic curvature
p the stored energy per rest length is EI/2 |kappa - p|^2 + H/2 |p|^2. Of this, EI/2 |kappa|^2 is
the bending term, - EI kappa.p is in `engine.natural_curvature`, and (EI + H)/2 |p|^2 is here. The
flow rule (rate independent, linear kinematic hardening, return mapping) is applied at the end of
each step. The forces of an energy-momentum step contain half of its flow (`engine.slip`): it only
removes energy, and the error is of second order but for the instants at which flow begins or ends.
With explicit methods p is constant within a step: first order.

With h = H / (EI + H) this is an elastic stiffness h EI beside strands of stiffness (1 - h) EI that
rub: they slip where the curvature is more than the yield curvature from p / (1 - h) (Masing, 1926).
A natural curvature kappa0 is that of the elastic part, and p = (1 - h) kappa0 before any slip.

Objectivity: p is stored in world coordinates, normal to the tangent. In the material frame (bit
MATERIAL) it follows that frame. Else it rotates by the smallest rotation from the old tangent to
the new one; only in a spin of the cable about its own axis does p then keep its direction in the
world. This rotation changes the energy by second order in the rotation per step; the account counts
the change as dissipated. Three dimensions only.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, shifted, store, zero
from dlo_sim.compiling.pieces import NOTHING, piece
from dlo_sim.engine import layout
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.elastic import (
    bending_at,
    block_of,
    curve,
    dot,
    sample_of,
    store_three,
    tangent_at,
    three,
)
from dlo_sim.engine.lines import gathered
from dlo_sim.engine.slip import (
    CURVATURE,
    TANGENT,
    TINY,
    curvature,
    plastic_rows_of,
    returned,
    slipping,
    stiffness_and_hardening,
)
from dlo_sim.engine.term import ENERGY, FLOW, Term, add_energy
from dlo_sim.terms.material_frame import unit
from dlo_sim.terms.viscosity import combined


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the integral of (EI + H)/2 |p|^2 [J]."""
    sum_ = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        half = 0.5 * stiffness_and_hardening(shape, model, b)
        for j in range(shape[layout.SAMPLES]):
            p = three(state, plastic_rows_of(shape, b, j))
            w = load(model, sample_of(block, j) + layout.QUADRATURE * LANES)
            sum_ += w * half * dot(p, p)
    add_energy(shape, sum_, layout.PLASTIC_ENERGY, out)


@piece(*FLOW)
def plastic_flow(shape, model, inputs, state, scratch):
    """Rotate p to the present tangents, then apply the return mapping. What is lost is the work of
    the forces of the step, EI/2 (|kappa1|^2 - |kappa0|^2) - EI p.(kappa1 - kappa0) with the p that
    they contain, less the change of the stored energy.
    """
    x = shifted(state, shape[layout.X])
    lost = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        stiffness = load(model, block + layout.BENDING * LANES)
        whole = stiffness_and_hardening(shape, model, b)
        s = load(model, block + layout.SLOPE * LANES)
        curve_ = curve(shape, model, x, b, 1.0)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            t, k = tangent_at(curve_, xi), bending_at(curve_, xi, s)
            kappa, t = curvature(t, k), unit(t)
            at = plastic_rows_of(shape, b, j)
            p, kappa_before = three(state, at), three(state, at + CURVATURE)
            moved = combined(1.0, kappa, -1.0, kappa_before)
            work = -dot(slipping(shape, model, state, b, j, kappa), moved) - dot(p, kappa_before)
            # smallest rotation from the old tangent to t, applied to p normal to the old one; both
            # are t already in the material frame
            h = combined(1.0, three(state, at + TANGENT), 1.0, t)
            after = combined(1.0, p, -2.0 * dot(t, p) / (dot(h, h) + TINY), h)
            after = returned(shape, model, b, kappa, after)
            stored = 0.5 * whole * (dot(after, after) - dot(p, p))
            lost += w * (stiffness * (work + dot(after, kappa)) - stored)
            store_three(state, at, after)
            store_three(state, at + TANGENT, t)
            store_three(state, at + CURVATURE, kappa)
    lost = gathered(shape, lost)
    for row in (layout.DISSIPATED, layout.PLASTIC_WORK):
        at = shape[layout.LEDGER] + row * LANES
        store(state, at, load(state, at) + lost)


@piece(NOTHING, CABLE, plastic_flow)
def flow_to_present(cable, plastic_flow):
    """`plastic_flow` at the present shape, for callers from Python."""
    shape, model, inputs, state, scratch = bared(cable)
    plastic_flow(shape, model, inputs, state, scratch)


TERM = Term(layout.PLASTICITY, energy=energy, flow=plastic_flow)
