"""Forces and energies of a scene, as the methods call them: the basic terms, then the optional
ones, whose functions do nothing for a cable without the term. A new term is added here;
`engine.term` has the signatures of its functions.
"""

from __future__ import annotations

from dlo_sim.compiling.pieces import part
from dlo_sim.engine import (
    bishop,
    contact,
    drag,
    natural_curvature,
    plasticity,
    pressure,
    self_contact,
    sliding,
    torsion,
)
from dlo_sim.engine.arrays import BISHOP, PLASTICITY
from dlo_sim.engine.elastic import add_tangent, discrete_force
from dlo_sim.engine.forces import energies, forces


@part
def all_forces(cable, x, out):
    """out = - dU/dq of all terms."""
    forces(cable, x, out)
    natural_curvature.force(cable, x, x, out)
    torsion.force(cable, x, x, out)
    pressure.force(cable, x, x, out)
    bishop.force(cable, x, x, out)
    contact.add_elastic_force(cable, x, out)
    sliding.slide_force(cable, x, out)
    self_contact.add_elastic_force(cable, x, out)


@part
def all_energies(cable, x, out):
    """Potential energies [J] of all terms into `out`, as `forces.energies`."""
    energies(cable, x, out)
    natural_curvature.energy(cable, x, out)
    torsion.energy(cable, x, out)
    pressure.energy(cable, x, out)
    bishop.energy(cable, x, out)
    plasticity.energy(cable, x, out)
    contact.energy(cable, x, out)
    sliding.slide_energy(cable, x, out)
    self_contact.energy(cable, x, out)


@part
def discrete_gradient(cable, x0, x1, moved, viscous, out):
    """out -= discrete gradient between x0 and x1, and viscous forces; returns the energy [J] that
    these dissipate (`elastic.discrete_force`). Implicit steps treat twist and contact apart.
    """
    lost = discrete_force(cable, x0, x1, moved, viscous, out)
    natural_curvature.gradient(cable, x0, x1, out)
    pressure.force(cable, x0, x1, out)
    return lost


@part
def discrete_jacobian(cable, x0, x1, viscous, scale, band):
    """band += scale times the Jacobian of `discrete_gradient` with respect to x1."""
    add_tangent(cable, x0, x1, viscous, scale, band)
    pressure.tangent(cable, x0, x1, scale, band)


@part
def add_damping(cable, x, moved, scale, out):
    """out -= scale C(x) moved of the terms whose damping depends on the shape."""
    drag.drag_force(cable, x, moved, scale, out)


@part
def add_damping_tangent(cable, x, moved, scale, band):
    """band += scale C(x) of the terms whose damping depends on the shape."""
    drag.drag_tangent(cable, x, moved, scale, band)


@part
def flow(cable):
    """Update the internal variables of the terms at the end of a step. Return whether that may
    change the forces, so that the next step must evaluate them again.
    """
    bishop.follow_shape(cable)
    plasticity.plastic_flow(cable)
    return cable.terms & (BISHOP | PLASTICITY) != 0
