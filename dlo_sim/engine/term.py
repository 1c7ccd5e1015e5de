"""Signatures of the functions of an optional term, which is a file of its own; `engine.assembly`
calls them for scenes with the term's bit:

    force(cable, x0, x1, out)              out -= discrete gradient of the energy between x0 and x1
    energy(cable, x, out)                  adds energies [J] to the entries of `arrays.ENERGIES`
    tangent(cable, x0, x1, scale, band)    band += scale times the Jacobian of the discrete gradient
    damping(cable, x, moved, scale, out)   out -= scale C(x) moved
    damping_tangent(cable, x, moved, scale, band)   band += scale C(x)
    flow(cable, t)                         update of internal variables at the end of a step
"""

from __future__ import annotations

from numba import float64, void

from dlo_sim.engine.arrays import CABLE, LINES, VECTOR

FORCE = void, CABLE, LINES, LINES, LINES
ENERGY = void, CABLE, LINES, VECTOR
TANGENT = void, CABLE, LINES, LINES, float64, LINES
DAMPING = void, CABLE, LINES, LINES, float64, LINES
DAMPING_TANGENT = void, CABLE, LINES, LINES, float64, LINES
FLOW = void, CABLE
