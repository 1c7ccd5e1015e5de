"""Plastic bending: a plastic curvature vector per quadrature point, with its return mapping.

With the curvature vector kappa = C / |t|^3 (C = t x k, t = r', k = r'') and the plastic curvature
p the stored energy per rest length is EI/2 |kappa - p|^2 + H/2 |p|^2. Of this, EI/2 |kappa|^2 is
the bending term, - EI kappa.p is in `engine.natural_curvature`, and (EI + H)/2 |p|^2 is here. The
return mapping (rate independent, linear kinematic hardening) is applied at the end of each step.

How much of the plastic flow of a step its forces contain is `balance.slip`. In an energy-momentum
step it is 1/2, the mean of the plastic curvature before and after: with m = EI (kappa - p) - H p,
the step then dissipates (m0 + m1)/2 . (p1 - p0) per rest length, which is not negative since
|m0| <= M_y and p changes along m1 with |m1| = M_y; the error is of second order but for the
instants at which flow begins or ends. The other implicit methods contain the flow up to the
configuration at which they evaluate forces (1). With explicit methods p is constant within a step
(0): first order.

With h = H / (EI + H) this is an elastic stiffness h EI beside strands of stiffness (1 - h) EI that
rub: they slip where the curvature is more than the yield curvature from p / (1 - h) (Masing, 1926).
A natural curvature kappa0 is that of the elastic part, and p = (1 - h) kappa0 before any slip.

Objectivity: p is stored in world coordinates, normal to the tangent. In the material frame (bit
MATERIAL) it follows that frame. Else it rotates by the smallest rotation from the old tangent to
the new one; only in a spin of the cable about its own axis does p then keep its direction in the
world. This rotation changes the energy by second order in the rotation per step; the energy balance
counts the change as dissipated. Three dimensions only.
"""

from __future__ import annotations

from numba import int64, void

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import fabs, lane_sum, sqrt, where, zero
from dlo_sim.engine.arrays import PLASTIC, PLASTICITY, cable_at
from dlo_sim.engine.spans import bending_at, curve, store_three, tangent_at, three
from dlo_sim.engine.term import ENERGY, FLOW
from dlo_sim.terms.material_frame import unit
from dlo_sim.terms.vectors import combined, cross, dot

TINY = 1e-300
# Excess over the yield moment, in it, up to which the Jacobian is elastic: at rest flow may turn
# back, and with a matrix that is too soft a single correction of a step overshoots.
YIELDED = 1e-7
# Entries of `state.plastic` at a quadrature point: plastic curvature p from 0, and from here the
# unit tangent and the curvature at the end of the last step.
TANGENT, CURVATURE = 3, 6


@inline
def curvature(t, k):
    """kappa = t x k / |t|^3 of t = r', k = r''."""
    c = dot(t, t)
    return combined(1.0 / (c * sqrt(c)), cross(t, k), 0.0, t)


@inline
def stiffness_and_hardening(cable, b):
    """EI + H of block b [N m^2]."""
    return cable.mesh.bending[b] * (1.0 + cable.physics.hardening)


@inline
def returned(cable, b, kappa, p):
    """Return mapping: the plastic curvature p [1/m] after bending to the curvature kappa."""
    stiffness, whole = cable.mesh.bending[b], stiffness_and_hardening(cable, b)
    m = combined(stiffness, kappa, -whole, p)
    moment = sqrt(dot(m, m))
    over = moment - cable.physics.yield_moment
    flow = 0.5 * (over + fabs(over)) / (whole + TINY)  # TINY: lanes beyond the last span
    return combined(1.0, p, flow / (moment + TINY), m)


@inline
def slipping(cable, b, kappa, p):
    """Plastic curvature in the forces of a step that begins with p and ends with kappa."""
    share = cable.state.balance.slip
    return combined(1.0 - share, p, share, returned(cable, b, kappa, p))


@inline
def slip_derivative(cable, b, kappa, p):
    """Half the derivative of the return mapping by kappa, where forces contain flow: along the
    moment, and across it; and the unit vector of the moment.
    """
    stiffness, whole = cable.mesh.bending[b], stiffness_and_hardening(cable, b)
    m = combined(stiffness, kappa, -whole, p)
    moment = sqrt(dot(m, m)) + TINY
    held = cable.physics.yield_moment / moment
    flows = 0.5 if cable.state.balance.slip > 0.0 else 0.0
    change = where(1.0 - YIELDED - held, flows * stiffness / (whole + TINY), 0.0)
    return change, change * (1.0 - held), combined(1.0 / moment, m, 0.0, m)


@kernel(*ENERGY, terms=PLASTICITY)
def energy(cable, x, out):
    """Add the integral of (EI + H)/2 |p|^2 [J]."""
    mesh, sum_ = cable.mesh, zero()
    for b in range(cable.blocks):
        half = 0.5 * stiffness_and_hardening(cable, b)
        for j in range(cable.samples):
            p = three(cable.state.plastic[b, j], 0)
            sum_ += mesh.weight[b, j] * half * dot(p, p)
    out[PLASTIC] += lane_sum(sum_)


@kernel(*FLOW, terms=PLASTICITY)
def plastic_flow(cable):
    """Rotate p to the present tangents, then apply the return mapping. What is dissipated is the
    work of the forces of the step, EI/2 (|kappa1|^2 - |kappa0|^2) - EI p.(kappa1 - kappa0) with the
    p that they contain, less the change of the stored energy.
    """
    mesh, state, lost = cable.mesh, cable.state, zero()
    for b in range(cable.blocks):
        s, stiffness, whole = mesh.slope[b], mesh.bending[b], stiffness_and_hardening(cable, b)
        centreline = curve(cable, state.x, b, 1.0)
        for j in range(cable.samples):
            xi, row = mesh.xi[b, j], state.plastic[b, j]
            t, k = tangent_at(centreline, xi), bending_at(centreline, xi, s)
            kappa, t = curvature(t, k), unit(t)
            p, kappa_before = three(row, 0), three(row, CURVATURE)
            moved = combined(1.0, kappa, -1.0, kappa_before)
            work = -dot(slipping(cable, b, kappa, p), moved) - dot(p, kappa_before)
            # Smallest rotation from the old tangent to t, applied to p normal to the old one; both
            # are t already in the material frame.
            h = combined(1.0, three(row, TANGENT), 1.0, t)
            after = combined(1.0, p, -2.0 * dot(t, p) / (dot(h, h) + TINY), h)
            after = returned(cable, b, kappa, after)
            stored = 0.5 * whole * (dot(after, after) - dot(p, p))
            lost += mesh.weight[b, j] * (stiffness * (work + dot(after, kappa)) - stored)
            store_three(row, 0, after)
            store_three(row, TANGENT, t)
            store_three(row, CURVATURE, kappa)
    dissipated = lane_sum(lost)
    state.balance.dissipated += dissipated
    state.balance.plastic_work += dissipated


@kernel(void, int64, terms=PLASTICITY)
def flow_to_present(address):
    """`plastic_flow` at the present shape, for callers from Python."""
    plastic_flow(cable_at(address))
