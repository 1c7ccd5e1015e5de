"""The time loop of all explicit Runge-Kutta methods (`core.methods`).

It integrates x' = w + Y (rates of the targets), w' = P M^-1 f + P' v - decay w (`engine.held`,
`methods.turning`). At the end of a step the state is projected onto the constraints:
x <- x + Y (targets - B x), w <- P w. The work of the grasps is the quadrature of their power at the
stages. The forces at the end serve the first stage of the next step.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, bare, load, shifted, store, zero
from dlo_sim.compiling.pieces import COUNTS, REAL, REALS, WHOLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.account import add_to_ledger
from dlo_sim.engine.assembly import all_forces, flow
from dlo_sim.engine.bundles import CABLE, RECORDS, bared, bared_records
from dlo_sim.engine.held import grasps_move, project
from dlo_sim.engine.held_motion import add_velocity_of_held, clear_moved, pulled
from dlo_sim.engine.lines import add, copy, form, gathered, mass_of, solve_mass
from dlo_sim.engine.loads import load_force
from dlo_sim.engine.sampling import begin_sample
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.explicit_layout import W_BEGIN, W_RATES, X_BEGIN, X_RATES
from dlo_sim.methods.splitting import ENGINE
from dlo_sim.methods.turning import add_turning, set_directions


@part
def add_decay(shape, model, state, out):
    """out += - decay w of the external damping."""
    if not shape[layout.TERMS] & layout.DAMPED:
        return
    for line in range(shape[layout.LINES]):
        rate = load(model, shape[layout.DECAY] + line * LANES)
        for at in range(line * shape[layout.LINE], (line + 1) * shape[layout.LINE], LANES):
            store(out, at, load(out, at) - rate * load(state, shape[layout.W] + at))


@part
def add_damping_loss(shape, model, state, dt):
    """DISSIPATED += dt times the power of the external damping, decay w^T M w summed over lines."""
    if not shape[layout.TERMS] & layout.DAMPED:
        return
    w = shifted(state, shape[layout.W])
    for line in range(shape[layout.LINES]):
        power = gathered(shape, form(shape, model, mass_of(shape, line), line, w))
        add_to_ledger(
            shape,
            state,
            layout.DISSIPATED,
            dt * load(model, shape[layout.DECAY] + line * LANES) * power,
        )


@part
def accelerate(shape, model, inputs, state, scratch, forces, t):
    """FORCE = P M^-1 f at the present configuration, without the ledger (`works.evaluate`)."""
    x, force = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.FORCE])
    all_forces(forces, shape, model, state, x, force)
    if shape[layout.LOADS]:
        load_force(shape, model, inputs, scratch, x, t, force)
    solve_mass(shape, model, force)
    if shape[layout.HELD]:
        project(shape, model, state, scratch, force, state, shape[layout.PULL])


@part
def store_rates(shape, model, inputs, state, scratch, t, stage):
    """Store the rates of (x, w) at the present state, with FORCE, as those of a stage.

    Returns the power of the grasps [W], a row.
    """
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    x_rate = shifted(scratch, shape[X_RATES] + stage * shape[layout.SIZE])
    w_rate = shifted(scratch, shape[W_RATES] + stage * shape[layout.SIZE])
    copy(shape, w, x_rate)
    power = zero()
    if grasps_move(shape, inputs):
        add_velocity_of_held(shape, model, inputs, state, scratch, x, t, x_rate)
        power -= pulled(shape, state, scratch, shape[layout.RATES])
    copy(shape, shifted(scratch, shape[layout.FORCE]), w_rate)
    power += add_turning(shape, model, inputs, state, scratch, w, t, w_rate)
    add_decay(shape, model, state, w_rate)
    return power


@part
def add_rates(shape, scratch, rates, stages, table, row, scale, out):
    """out += scale sum_j table[row, j] (rate of stage j)."""
    for j in range(stages):
        weight = scale * table[row * stages + j]
        if weight != 0.0:
            add(shape, weight, shifted(scratch, shape[rates] + j * shape[layout.SIZE]), out)


@part
def to_stage(shape, model, inputs, state, scratch, stages, table, stage, t, tau):
    """Set the state to that of a stage at time t."""
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    copy(shape, shifted(scratch, shape[X_BEGIN]), x)
    copy(shape, shifted(scratch, shape[W_BEGIN]), w)
    add_rates(shape, scratch, X_RATES, stages, table, stage, tau, x)
    add_rates(shape, scratch, W_RATES, stages, table, stage, tau, w)
    set_directions(shape, model, inputs, state, scratch, t)
    move_anchors(shape, model, inputs, state, t)


@part
def to_end(shape, model, inputs, state, scratch, carry, stages, table, t, tau):
    """Set the state to that at the end of the step, time t, projected onto the constraints."""
    to_stage(shape, model, inputs, state, scratch, stages, table, stages, t, tau)
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    carry(shape, model, inputs, state, scratch, x, w, t, 0.0)
    clear_moved(shape, state)  # the ledger has this work from the stages
    if grasps_move(shape, inputs):
        project(shape, model, state, scratch, w, scratch, shape[layout.SYSTEM])


@piece(COUNTS, CABLE, ENGINE, REALS, REALS, WHOLE, WHOLE, REAL, WHOLE, RECORDS)
def advance_runge_kutta(cable, engine, table, nodes, first_step, steps, tau, guard, records):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations), as
    `advance_splitting` does.

    `table`: rows a_ij and, last, b_j, shape (s + 1, s) flattened; `nodes`: c_i, shape (s,).
    """
    _, forces, look, flows, carry, evaluate, update, end_sample = engine.pieces
    stages = len(nodes)
    shape, model, inputs, state, scratch = bared(cable)
    records = bared_records(records)
    table = bare(table)
    evaluations, power = 0, zero()
    fresh = False  # the rates of stage 0 are those of the present state
    for step in range(first_step, first_step + steps):
        t0, t1 = step * tau, (step + 1) * tau
        sampling = begin_sample(shape, model, inputs, state, scratch, records, t0, tau)
        if not fresh:
            evaluate(shape, model, inputs, state, scratch, forces, t0)
            power = store_rates(shape, model, inputs, state, scratch, t0, 0)
            evaluations += 1
        copy(shape, shifted(state, shape[layout.X]), shifted(scratch, shape[X_BEGIN]))
        copy(shape, shifted(state, shape[layout.W]), shifted(scratch, shape[W_BEGIN]))
        weight = tau * table[stages * stages]
        add_damping_loss(shape, model, state, weight)
        add_to_ledger(shape, state, layout.DRIVE_WORK, weight * power)
        for stage in range(1, stages):
            t = (step + nodes[stage]) * tau
            to_stage(shape, model, inputs, state, scratch, stages, table, stage, t, tau)
            accelerate(shape, model, inputs, state, scratch, forces, t)
            power = store_rates(shape, model, inputs, state, scratch, t, stage)
            weight = tau * table[stages * stages + stage]
            add_damping_loss(shape, model, state, weight)
            add_to_ledger(shape, state, layout.DRIVE_WORK, weight * power)
        to_end(shape, model, inputs, state, scratch, carry, stages, table, t1, tau)
        evaluate(shape, model, inputs, state, scratch, forces, t1)
        power = store_rates(shape, model, inputs, state, scratch, t1, 0)
        evaluations += stages
        fresh = not flow(flows, shape, model, inputs, state, scratch)
        if (step + 1) % guard == 0 and not update(shape, model, state, scratch, look):
            return layout.DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return layout.OK, steps, evaluations
