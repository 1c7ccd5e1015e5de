"""Reactions: what the end effectors do to the cable at one instant."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels import layout
from dlo_sim.kernels.ends import end_wrench
from dlo_sim.kernels.instant import missing_force
from dlo_sim.simulation.geometry import ENDS, known_end
from dlo_sim.simulation.model import Model

Wrench = tuple[float, float, float, float, float, float]


def reaction(
    model: Model,
    state: layout.State,
    work: layout.Work,
    solver: layout.Solver,
    t: float,
    end: str,
    chain: layout.Chain | None = None,
) -> Wrench:
    """Force [N] and moment about the attachment [N m] on the cable by an end effector, world frame,
    six numbers.

    After a step of an implicit method it is the mean over that step, otherwise that of the instant.
    With all other forces f known, the free DOFs accelerate by M_ff^-1 (f_f - M_fp a_p); what is
    missing in M a = f + R on the prescribed rows is the reaction R. A spring's force counts too,
    and so do the constraint forces of an inextensible cable (`chain`).
    """
    row = ENDS.index(known_end(end))
    n, terms = model.n, model.terms
    missing = state.reaction
    if not state.ledger[layout.REACTION]:
        missing = np.empty_like(state.w)
        missing_force(
            state, terms, model.friction, model.viscosity, work, solver, chain, t, missing
        )
    twist = -1 if model.twist_row is None else model.twist_row
    wrench: Wrench = end_wrench(missing, state.position, terms.springs, model.axes, n, row, twist)
    return wrench
