"""The time loop of Zhai's explicit two-step method (`core.zhai`).

One force evaluation per step. The acceleration of the previous step is part of the state; the first
step uses the present one instead. Constraint rows drift as in `engine.rows`; the accelerations are
projected with the directions at the end of the step.
"""

from __future__ import annotations

from numba import float64, int64

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.lanes import LANES
from dlo_sim.compiling.pieces import COUNTS, part, piece
from dlo_sim.engine.account import update_account
from dlo_sim.engine.arrays import DIVERGED, OK, cable_at, records_at
from dlo_sim.engine.assembly import flow
from dlo_sim.engine.lines import add
from dlo_sim.engine.rows import carry, grasps_move, project
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.runge_kutta import add_damping_loss, add_decay
from dlo_sim.methods.works import evaluate


@part
def accelerate(cable, t):
    """`work.force` = P M^-1 f - decay w; adds the work to the energy balance."""
    evaluate(cable, t)
    add_decay(cable, cable.work.force)


@part
def two_step(cable, psi, phi, t, tau):
    """Advance x and w to time t, the end of the step; the present acceleration becomes the previous
    one.
    """
    state, work = cable.state, cable.work
    w, before, mean = state.w, state.acceleration, work.mean_rate
    known = state.balance.known != 0.0
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            a, v = load(work.force, line, c), load(w, line, c)
            b = load(before, line, c) if known else a
            store(mean, line, c, v + tau * ((0.5 + psi) * a - psi * b))
            store(w, line, c, tau * ((0.5 + phi - psi) * a - (phi - psi) * b))
            store(before, line, c, a)
    state.balance.known = 1.0
    carry(cable, state.x, mean, t, tau)
    move_anchors(cable, t)
    if grasps_move(cable):
        project(cable, w, work.multipliers)
        project(cable, before, work.multipliers)
    add(1.0, mean, w)


@piece(COUNTS, int64, float64, float64, int64, int64, float64, int64, int64)
def advance_zhai(address, psi, phi, first_step, steps, tau, guard, records_address):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations), as
    `advance_splitting` does.
    """
    cable, records = cable_at(address), records_at(records_address)
    evaluations = 0
    fresh = False  # `work.force` holds w' of the present state
    for step in range(first_step, first_step + steps):
        t0, t1 = step * tau, (step + 1) * tau
        sampling = begin_sample(cable, records, t0, tau)
        if not fresh:
            accelerate(cable, t0)
            evaluations += 1
        add_damping_loss(cable, 0.5 * tau)
        two_step(cable, psi, phi, t1, tau)
        add_damping_loss(cable, 0.5 * tau)
        accelerate(cable, t1)
        evaluations += 1
        fresh = not flow(cable)
        if (step + 1) % guard == 0 and not update_account(cable):
            return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(cable, records, t0, tau)
    return OK, steps, evaluations
