"""Forces at one configuration, and energies, of the basic terms: stretching, bending, twisting
theta'^2, weight, springs. `engine.assembly` adds the optional ones.
"""

from __future__ import annotations

from numba import void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.lanes import LANES
from dlo_sim.compiling.pieces import NO, YES, part, piece
from dlo_sim.engine.arrays import (
    BENDING,
    CABLE,
    ENERGIES,
    GRAVITY,
    LINES,
    SPRING,
    STRETCHING,
    TWISTED,
    TWISTING,
    VECTOR,
    WEIGHT,
)
from dlo_sim.engine.elastic import elastic_energy, elastic_force
from dlo_sim.engine.lines import add_differences, difference_form, weight_energy
from dlo_sim.engine.springs import spring_energy, spring_force


@piece(void, CABLE, LINES, LINES)
def forces(cable, x, out):
    """out = - dU/dq of these terms."""
    start_with_weight(cable, out)
    elastic_force(cable, x, out)
    if cable.terms & TWISTED:
        add_differences(cable.linear.twist, -1.0, x[cable.dim], out[cable.dim])
    spring_force(cable, x, 1.0, NO, out)
    if cable.terms & TWISTED:
        spring_force(cable, x, 1.0, YES, out)


@part
def start_with_weight(cable, out):
    """out = generalised weight, which is zero without gravity."""
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            if line < cable.dim:
                store(out, line, c, load(cable.linear.weight, line, c))
            else:
                store(out, line, c, 0.0)


@piece(void, CABLE, LINES, VECTOR)
def energies(cable, x, out):
    """Potential energies [J] by term (`arrays.ENERGIES`), and at last the sum of the absolute
    values of the summands of the gravitational energy, a measure of its round-off.
    """
    for k in range(len(out)):
        out[k] = 0.0
    out[STRETCHING], out[BENDING] = elastic_energy(cable, x)
    if cable.terms & TWISTED:
        out[TWISTING] = 0.5 * difference_form(cable.linear.twist, x[cable.dim])
    if cable.terms & GRAVITY:
        out[WEIGHT], out[len(ENERGIES)] = weight_energy(cable, x)
    out[SPRING] = spring_energy(cable, x)
