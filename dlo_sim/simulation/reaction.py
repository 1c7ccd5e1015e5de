"""Reactions: what the end effectors do to the cable at one instant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass
from dlo_sim.kernels import layout
from dlo_sim.kernels.banded import solve_rows
from dlo_sim.kernels.ends import end_velocities
from dlo_sim.kernels.instant import instant_force
from dlo_sim.kernels.observe import velocities
from dlo_sim.simulation.geometry import ENDS
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
RATE_STEP = 1e-6  # [s] for the acceleration of a driven end; exact for quadratic motion


def reaction(
    model: Model,
    state: layout.State,
    work: layout.Work,
    solver: layout.Solver,
    t: float,
    end: str,
) -> tuple[Array, Array]:
    """Force [N] and moment about the attachment [N m] on the cable by an end effector, world frame.

    With all other forces f known, the free DOFs accelerate by M_ff^-1 (f_f - M_fp a_p); what is
    missing in M a = f + R on the prescribed rows is the reaction R. A spring's force counts too.
    """
    if end not in ENDS:
        raise KeyError(f"no end '{end}': use start or end")
    n, terms = model.n, model.terms
    v = np.zeros_like(state.w)
    velocities(state.w, terms, t, v)
    force = np.zeros_like(state.w)
    instant_force(
        state.position, v, terms, model.friction, model.viscosity, work, solver, t, force
    )
    acceleration = _prescribed_acceleration(model, t, v.shape)
    inertia = np.stack([mass.multiply(terms.mass.band[d], acceleration[d, :n]) for d in range(model.rows)])
    free_part = np.zeros_like(force)
    free_part[:, :n] = (force[:, :n] - inertia) * terms.mass.free
    solve_rows(terms.mass.lower, terms.mass.inverse_diagonal, n, free_part)
    acceleration += free_part
    missing = np.stack(
        [mass.multiply(terms.mass.band[d], acceleration[d, :n]) for d in range(model.rows)]
    )
    missing = (missing - force[:, :n]) * (1.0 - terms.mass.free)
    row = ENDS.index(end)
    outer, inner = (0, 1) if row == 0 else (n - 1, n - 2)
    points = model.to_columns(state.position)
    pulls = model.to_columns(missing, rest=False)
    arm = points[inner, :3] - points[outer, :3]
    total = pulls[outer, :3] + pulls[inner, :3]
    moment = np.cross(arm, pulls[inner, :3])
    if model.twist_row is not None:
        sign = 1.0 if row == 0 else -1.0
        moment += pulls[outer, 3] * sign * arm / np.linalg.norm(arm)
    if terms.springs is not None:
        dim = len(model.axes)
        total[list(model.axes)] -= terms.springs.stiffness[row] * (
            state.position[:dim, outer] - terms.springs.anchor[row]
        )
    return total, moment


def _prescribed_acceleration(model: Model, t: float, shape: tuple[int, ...]) -> Array:
    """Accelerations of driven control points, zero elsewhere."""
    result = np.zeros(shape)
    terms = model.terms
    if terms.drive is None:
        return result
    for row in range(len(ENDS)):
        motion = terms.drive.motion
        start, stop = motion[row, 1], motion[row, 1] + motion[row, 2]
        # Both samples inside the motion: a jump of velocity at its border is no acceleration.
        before, after = max(t - RATE_STEP, start), min(t + RATE_STEP, stop)
        if motion[row, 0] == 0.0 or after - before < 0.5 * RATE_STEP:
            continue
        alone = motion.copy()
        alone[1 - row, 0] = 0.0
        rates = np.zeros((2, *shape))
        for instant, out in zip((before, after), rates, strict=True):
            end_velocities(alone, instant, model.n, terms.axes, terms.mass.free, out)
        result += (rates[1] - rates[0]) / (after - before)
    return result
