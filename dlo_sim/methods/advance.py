"""The time loop of all methods: dense output, steps, internal variables, and the energy balance.

A method is a step (`splitting`, `runge_kutta`, `zhai`, `implicit`). A scene loads
only its own. Steps are counted from time zero, so that splitting a run into calls changes nothing:
step number k leads from the time k tau to (k + 1) tau.
"""

from __future__ import annotations

from numba import float64, int64

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, ARRAY_3D, COUNTS, inline, kernel
from dlo_sim.engine.account import update_account
from dlo_sim.engine.arrays import (
    CABLE,
    DIVERGED,
    IMPLICIT,
    METHOD,
    NOT_CONVERGED,
    OK,
    RUNGE_KUTTA,
    SPLITTING,
    ZHAI,
    cable_at,
    method_at,
    records_at,
)
from dlo_sim.engine.assembly import flow
from dlo_sim.engine.border import UNKNOWN
from dlo_sim.engine.rows import grasps_move, set_targets
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.methods.implicit import implicit_step
from dlo_sim.methods.runge_kutta import runge_kutta_step
from dlo_sim.methods.splitting import splitting_step
from dlo_sim.methods.works import NATURAL, evaluate, has_work, turn_natural_shape
from dlo_sim.methods.zhai import zhai_step


@kernel(int64, METHOD, CABLE, int64, float64, terms=SPLITTING | RUNGE_KUTTA | ZHAI)
def explicit_step(method, cable, step, tau):
    """Step number `step` of a method that is not implicit, as `take_step`."""
    if method.family == SPLITTING:
        done = splitting_step(method, cable, step, tau)
    elif method.family == RUNGE_KUTTA:
        done = runge_kutta_step(method, cable, step, tau)
    else:
        done = zhai_step(method, cable, step, tau)
    if grasps_move(cable):
        set_targets(cable, (step + 1) * tau)
    if flow(cable, (step + 1) * tau):
        cable.work.results.forces_known = 0.0
    return OK if done else NOT_CONVERGED


@inline
def take_step(method, cable, step, tau):
    """Step number `step` of the scene's method; returns its outcome."""
    if method.family == IMPLICIT:
        return OK if implicit_step(method, cable, step, tau) else NOT_CONVERGED
    return explicit_step(method, cable, step, tau)


@kernel(
    *(COUNTS, int64, int64, int64, int64, float64, int64),
    *(ARRAY_3D, NATURAL, ARRAY_2D),
)
def advance(address, method_address, first, steps, tau, records_address, motions, natural, turns):
    """Advance by whole steps from time first * tau.

    Args:
        motions: numbers of all grasps in each step, shape (steps, grasps, MOTION_SIZE), as
            `Inputs.motion`; with no entries these stay. natural: `State.natural` in the frame of an
            end effector, shape (blocks, samples, 4, LANES), with no blocks if it does not turn.
            turns: its rotation matrix in each step, shape (steps, 9) (`works.turn_natural_shape`).

    Returns:
        (status, steps done, force evaluations or Newton iterations).
    """
    cable, method = cable_at(address), method_at(method_address)
    records, results = records_at(records_address), cable.work.results
    ahead, shape, rotations = grid(motions), grid(natural), grid(turns)
    results.evaluations = results.forces_known = 0.0
    results.border_known = UNKNOWN
    status, done = OK, 0
    while status == OK and done < steps:
        step, t0, t1 = first + done, (first + done) * tau, (first + done + 1) * tau
        if len(ahead):
            for g in range(cable.grasps):
                for k in range(ahead.shape[2]):
                    cable.inputs.motion[g, k] = ahead[done, g, k]
        if len(shape):
            turn_natural_shape(cable, shape, rotations[done])
        sampling = begin_sample(cable, records, t0, tau)
        status = take_step(method, cable, step, tau)
        if status == OK and (step + 1) % method.check_every == 0:
            if method.family != IMPLICIT and has_work(cable) and results.forces_known == 0.0:
                evaluate(cable, t1)
            if not update_account(cable):
                status = DIVERGED
        if status == OK:
            if sampling:
                end_sample(cable, records, t0, tau)
            done += 1
    results.border_known = 0.0  # a search for a shape changes what it finds
    return status, done, int64(results.evaluations)
