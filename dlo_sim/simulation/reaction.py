"""Reactions: what the end effectors do to the cable at one instant."""

from __future__ import annotations

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
    inextensible: tuple[Array, layout.Chain] | None = None,
) -> tuple[Array, Array]:
    """Force [N] and moment about the attachment [N m] on the cable by an end effector, world frame.

    With all other forces f known, the free DOFs accelerate by M_ff^-1 (f_f - M_fp a_p); what is
    missing in M a = f + R on the prescribed rows is the reaction R. A spring's force counts too,
    and so do the constraint forces of an inextensible cable (its constraint slopes and scratch).
    """
    if end not in ENDS:
        raise KeyError(f"no end '{end}': use start or end")
    n, terms = model.n, model.terms
    missing = np.empty_like(state.w)
    slopes, chain = inextensible or (None, None)
    missing_force(
        state, terms, model.friction, model.viscosity, work, solver, slopes, chain, t, missing
    )
    row = ENDS.index(end)
    outer, inner = (0, 1) if row == 0 else (n - 1, n - 2)
    points = model.to_columns(state.position)
    pulls = model.to_columns(missing, rest=False)
    arm = points[inner, :3] - points[outer, :3]
    total = pulls[outer, :3] + pulls[inner, :3]
    moment = _cross(arm, pulls[inner, :3])
    if model.twist_row is not None:
        sign = 1.0 if row == 0 else -1.0
        moment += pulls[outer, 3] * sign * arm / np.linalg.norm(arm)
    if terms.springs is not None:
        dim = len(model.axes)
        total[list(model.axes)] -= terms.springs.stiffness[row] * (
            state.position[:dim, outer] - terms.springs.anchor[row]
        )
    return total, moment


def _cross(a: Array, b: Array) -> Array:
    """a x b of two single vectors; numpy's own takes twenty times as long."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
