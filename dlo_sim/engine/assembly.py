"""Forces and energies of a scene, as the methods call them: stretching, bending, weight and
springs, then the optional terms, whose functions do nothing for a cable without the
term. A new term is added here; `engine.term` has the signatures of its functions.
"""

from __future__ import annotations

from numba import void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import NO, YES, inline, kernel
from dlo_sim.compiling.lanes import LANES, fabs, lane_sum, zero
from dlo_sim.engine import (
    bishop,
    buoyancy,
    contact,
    drag,
    natural_curvature,
    plasticity,
    pressure,
    rigid_body,
    roll,
    self_contact,
    sliding,
    torsion,
)
from dlo_sim.engine.arrays import (
    BENDING,
    BISHOP,
    CABLE,
    ENERGIES,
    GRAVITY,
    LINES,
    MARGIN,
    PLASTICITY,
    SPRING,
    STRETCHING,
    VECTOR,
    WEIGHT,
)
from dlo_sim.engine.elastic import add_tangent, discrete_force, elastic_energy, elastic_force
from dlo_sim.engine.natural_curvature import natural_force
from dlo_sim.engine.rows import keep_frames
from dlo_sim.engine.springs import spring_energy, spring_force


@inline
def start_with_weight(cable, out):
    """out = generalised weight, which is zero without gravity."""
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            if line < cable.dim:
                store(out, line, c, load(cable.linear.weight, line, c))
            else:
                store(out, line, c, 0.0)


@kernel(void, CABLE, LINES, LINES)
def all_forces(cable, x, out):
    """out = - dU/dq of all terms."""
    start_with_weight(cable, out)
    elastic_force(cable, x, out)
    spring_force(cable, x, 1.0, NO, out)
    spring_force(cable, x, 1.0, YES, out)
    natural_force(cable, x, x, out)
    torsion.force(cable, x, x, out)
    pressure.force(cable, x, x, out)
    rigid_body.force(cable, x, x, out)
    roll.force(cable, x, x, out)
    buoyancy.force(cable, x, x, out)
    bishop.force(cable, x, x, out)
    contact.add_force(cable, NO, x, out)
    sliding.slide_force(cable, x, out)
    self_contact.add_force(cable, 0.0, x, out)


@kernel(void, CABLE, LINES, VECTOR)
def all_energies(cable, x, out):
    """Potential energies [J] by term (`arrays.ENERGIES`), and at last the sum of the absolute
    values of the summands of the gravitational energy, a measure of its round-off.

    The gravitational energy is zero at the world's origin.
    """
    for k in range(len(out)):
        out[k] = 0.0
    out[STRETCHING], out[BENDING] = elastic_energy(cable, x)
    if cable.terms & GRAVITY:
        energy, large = zero(), zero()
        for line in range(cable.dim):
            for c in range(MARGIN, cable.columns - LANES, LANES):
                e = load(cable.linear.weight, line, c) * load(x, line, c)
                energy -= e
                large += fabs(e)
        out[WEIGHT], out[len(ENERGIES)] = lane_sum(energy), lane_sum(large)
    out[SPRING] = spring_energy(cable, x)
    natural_curvature.energy(cable, x, out)
    torsion.energy(cable, x, out)
    pressure.energy(cable, x, out)
    rigid_body.energy(cable, x, out)
    roll.energy(cable, x, out)
    buoyancy.energy(cable, x, out)
    bishop.energy(cable, x, out)
    plasticity.energy(cable, x, out)
    contact.energy(cable, x, out)
    sliding.slide_energy(cable, x, out)
    self_contact.energy(cable, x, out)


@inline
def discrete_gradient(cable, x0, x1, moved, viscous, out):
    """out -= discrete gradient between x0 and x1, and viscous forces; returns the energy [J] that
    these dissipate (`elastic.discrete_force`). Implicit steps add twist and contact themselves.
    """
    lost = discrete_force(cable, x0, x1, moved, viscous, out)
    natural_force(cable, x0, x1, out)
    pressure.force(cable, x0, x1, out)
    rigid_body.force(cable, x0, x1, out)
    buoyancy.force(cable, x0, x1, out)
    return lost


@inline
def discrete_jacobian(cable, x0, x1, viscous, twist, scale, band):
    """band += scale times the Jacobian of `discrete_gradient`, and of the twisting forces, with
    respect to x1 (`elastic.add_tangent`).
    """
    add_tangent(cable, x0, x1, viscous, twist, scale, band)
    pressure.tangent(cable, x0, x1, scale, band)
    rigid_body.tangent(cable, x0, x1, scale, band)
    buoyancy.tangent(cable, x0, x1, scale, band)


@inline
def add_damping(cable, x, moved, scale, out):
    """out -= scale C(x) moved of the terms whose damping depends on the shape."""
    drag.drag_force(cable, x, moved, scale, out)


@inline
def add_damping_tangent(cable, x, moved, scale, band):
    """band += scale C(x) of the terms whose damping depends on the shape."""
    drag.drag_tangent(cable, x, moved, scale, band)


@inline
def flow(cable, t):
    """Update the internal variables of the terms at the end of a step, at time t. Return whether
    that may change the forces, so that the next step must evaluate them again.
    """
    keep_frames(cable, t)
    bishop.follow_shape(cable, t)
    plasticity.plastic_flow(cable)
    return cable.terms & (BISHOP | PLASTICITY) != 0
