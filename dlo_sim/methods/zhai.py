"""The time loop of Zhai's explicit two-step method (`core.zhai`).

One force evaluation per step. The acceleration of the previous step is part of the state; the first
step uses the present one instead. Held rows drift as in `engine.held`; the accelerations are
projected with the directions at the end of the step.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, shifted, store
from dlo_sim.compiling.pieces import COUNTS, REAL, WHOLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.account import set_ledger
from dlo_sim.engine.assembly import flow
from dlo_sim.engine.bundles import CABLE, RECORDS, bared, bared_records
from dlo_sim.engine.held import grasps_move, project
from dlo_sim.engine.lines import add
from dlo_sim.engine.sampling import begin_sample
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.explicit_layout import MEAN
from dlo_sim.methods.runge_kutta import add_damping_loss, add_decay
from dlo_sim.methods.splitting import ENGINE


@part
def accelerate(shape, model, inputs, state, scratch, evaluate, forces, t):
    """FORCE = P M^-1 f - decay w; adds the work to the ledger."""
    evaluate(shape, model, inputs, state, scratch, forces, t)
    add_decay(shape, model, state, shifted(scratch, shape[layout.FORCE]))


@part
def two_step(shape, model, inputs, state, scratch, carry, psi, phi, t, tau):
    """Advance x and w to time t, the end of the step; the present acceleration becomes the previous
    one.
    """
    x, w, mean = (
        shifted(state, shape[layout.X]),
        shifted(state, shape[layout.W]),
        shifted(scratch, shape[MEAN]),
    )
    force, before = (
        shifted(scratch, shape[layout.FORCE]),
        shifted(state, shape[layout.HISTORY] + 2 * shape[layout.SIZE]),
    )
    known = state[shape[layout.LEDGER] + layout.KNOWN * LANES] != 0.0
    for at in range(0, shape[layout.SIZE], LANES):
        a, v = load(force, at), load(w, at)
        b = load(before, at) if known else a
        store(mean, at, v + tau * ((0.5 + psi) * a - psi * b))
        store(w, at, tau * ((0.5 + phi - psi) * a - (phi - psi) * b))
        store(before, at, a)
    set_ledger(shape, state, layout.KNOWN, 1.0)
    carry(shape, model, inputs, state, scratch, x, mean, t, tau)
    move_anchors(shape, model, inputs, state, t)
    if grasps_move(shape, inputs):
        project(shape, model, state, scratch, w, scratch, shape[layout.SYSTEM])
        project(shape, model, state, scratch, before, scratch, shape[layout.SYSTEM])
    add(shape, 1.0, mean, w)


@piece(COUNTS, CABLE, ENGINE, REAL, REAL, WHOLE, WHOLE, REAL, WHOLE, RECORDS)
def advance_zhai(cable, engine, psi, phi, first_step, steps, tau, guard, records):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations), as
    `advance_splitting` does.
    """
    _, forces, look, flows, carry, evaluate, update, end_sample = engine.pieces
    shape, model, inputs, state, scratch = bared(cable)
    records = bared_records(records)
    evaluations = 0
    fresh = False  # FORCE holds w' of the present state
    for step in range(first_step, first_step + steps):
        t0, t1 = step * tau, (step + 1) * tau
        sampling = begin_sample(shape, model, inputs, state, scratch, records, t0, tau)
        if not fresh:
            accelerate(shape, model, inputs, state, scratch, evaluate, forces, t0)
            evaluations += 1
        add_damping_loss(shape, model, state, 0.5 * tau)
        two_step(shape, model, inputs, state, scratch, carry, psi, phi, t1, tau)
        add_damping_loss(shape, model, state, 0.5 * tau)
        accelerate(shape, model, inputs, state, scratch, evaluate, forces, t1)
        evaluations += 1
        fresh = not flow(flows, shape, model, inputs, state, scratch)
        if (step + 1) % guard == 0 and not update(shape, model, state, scratch, look):
            return layout.DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return layout.OK, steps, evaluations
