"""Interface of the optional terms, each in a file of its own; `engine.assembly` lists them.

All functions of one kind have the same signature, so the assembly need not know the term. An empty
function stands in for one that a term does not have, or whose term the scene lacks: code that a
scene does not need is never compiled.
"""

from __future__ import annotations

from typing import NamedTuple

from dlo_sim.compiling.lanes import LANES, load, store
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, Piece, part, piece
from dlo_sim.engine.lines import gathered

FORCE = NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS
ENERGY = NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS
TANGENT = NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, REAL, NUMBERS, NUMBERS
DAMPING = NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, REAL, NUMBERS
DAMPING_TANGENT = NOTHING, TABLE, NUMBERS, NUMBERS, REAL, NUMBERS, NUMBERS
FLOW = NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS


@part
def add_energy(shape, energy, row, out):
    """Add an energy [J], given as partial sums, to a row of `layout.ENERGIES`."""
    store(out, row * LANES, load(out, row * LANES) + gathered(shape, energy))


@piece(*FORCE)
def no_force(shape, model, state, x0, x1, out):
    """Nothing."""


@piece(*ENERGY)
def no_energy(shape, model, state, x, out):
    """Nothing."""


@piece(*TANGENT)
def no_tangent(shape, model, state, x0, x1, scale, scratch, band):
    """Nothing."""


@piece(*DAMPING)
def no_damping(shape, model, x, moved, scale, out):
    """Nothing."""


@piece(*DAMPING_TANGENT)
def no_damping_tangent(shape, model, x, scale, scratch, band):
    """Nothing."""


@piece(*FLOW)
def no_flow(shape, model, inputs, state, scratch):
    """Nothing."""


class Term(NamedTuple):
    """The functions of a term.

    Attributes:
        bit: of `engine.layout`, set if a scene has the term.
        force: out -= gradient of the energy, called with x0 = x1.
        gradient: out -= discrete gradient between x0 and x1, for implicit steps.
        energy: adds energies [J] to the rows of `layout.ENERGIES` in out.
        tangent: band += scale times the Jacobian of the discrete gradient with respect to x1.
        damping: out -= scale C(x) moved; damping_tangent: band += scale C(x).
        flow: update of the term's internal variables at the end of a step.
    """

    bit: int
    force: Piece = no_force
    gradient: Piece = no_force
    energy: Piece = no_energy
    tangent: Piece = no_tangent
    damping: Piece = no_damping
    damping_tangent: Piece = no_damping_tangent
    flow: Piece = no_flow
