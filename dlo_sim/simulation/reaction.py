"""Reactions: what the end effectors do to the cable at one instant."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dlo_sim.kernels import layout
from dlo_sim.kernels.instant import missing_force
from dlo_sim.simulation.geometry import ENDS
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def reaction(
    model: Model,
    state: layout.State,
    work: layout.Work,
    solver: layout.Solver,
    t: float,
    end: str,
    chain: layout.Chain | None = None,
) -> tuple[Array, Array]:
    """Force [N] and moment about the attachment [N m] on the cable by an end effector, world frame.

    After a step of an implicit method it is the mean over that step, otherwise that of the instant.
    With all other forces f known, the free DOFs accelerate by M_ff^-1 (f_f - M_fp a_p); what is
    missing in M a = f + R on the prescribed rows is the reaction R. A spring's force counts too,
    and so do the constraint forces of an inextensible cable (`chain`).
    """
    if end not in ENDS:
        raise KeyError(f"no end '{end}': use start or end")
    n, terms = model.n, model.terms
    missing = state.reaction
    if not state.ledger[layout.REACTION]:
        missing = np.empty_like(state.w)
        missing_force(
            state, terms, model.friction, model.viscosity, work, solver, chain, t, missing
        )
    row = ENDS.index(end)
    outer, inner = (0, 1) if row == 0 else (n - 1, n - 2)
    position, springs = state.position, terms.springs
    arm, total, near = [0.0] * 3, [0.0] * 3, [0.0] * 3
    for d, axis in enumerate(model.axes):
        arm[axis] = position.item(d, inner) - position.item(d, outer)
        near[axis] = missing.item(d, inner)
        total[axis] = missing.item(d, outer) + near[axis]
        if springs is not None:
            stretched = position.item(d, outer) - springs.anchor.item(row, d)
            total[axis] -= springs.stiffness.item(row, d) * stretched
    moment = [
        arm[1] * near[2] - arm[2] * near[1],
        arm[2] * near[0] - arm[0] * near[2],
        arm[0] * near[1] - arm[1] * near[0],
    ]
    if model.twist_row is not None:
        sign = 1.0 if row == 0 else -1.0
        about = sign * missing.item(model.twist_row, outer) / math.hypot(*arm)
        moment = [moment[k] + about * arm[k] for k in range(3)]
    return np.array(total), np.array(moment)
