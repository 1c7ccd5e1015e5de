"""The time loop of all explicit Runge-Kutta methods (`core.methods`).

It integrates x' = w + Y (rates of the targets), w' = P M^-1 f + P' v - decay w (`engine.rows`). At
the end of a step the state is projected onto the constraints: x <- x + Y (targets - B x), w <- P w.
The work of the grasps is the quadrature of their power at the stages. The forces at the end serve
the first stage of the next step.
"""

from __future__ import annotations

from numba import float64, int64

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.lanes import LANES
from dlo_sim.compiling.pieces import ARRAY, ARRAY_2D, COUNTS, part, piece
from dlo_sim.engine.account import update_account
from dlo_sim.engine.arrays import DAMPED, DIVERGED, OK, cable_at, records_at
from dlo_sim.engine.assembly import all_forces, flow
from dlo_sim.engine.lines import add, copy, form, mass_of, solve_mass
from dlo_sim.engine.loads import load_force
from dlo_sim.engine.rows import (
    add_turning,
    add_velocity_of_held,
    carry,
    clear_moved,
    grasps_move,
    project,
    pulled,
    set_directions,
)
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.works import evaluate


@part
def add_decay(cable, out):
    """out += - decay w of the external damping."""
    if not cable.terms & DAMPED:
        return
    w, decay = cable.state.w, cable.linear.decay
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            store(out, line, c, load(out, line, c) - decay[line] * load(w, line, c))


@part
def add_damping_loss(cable, dt):
    """Add dt times the power of the external damping, decay w^T M w, to `balance.dissipated`."""
    if not cable.terms & DAMPED:
        return
    for line in range(cable.lines):
        power = form(mass_of(cable, line), cable.state.w[line])
        cable.state.balance.dissipated += dt * cable.linear.decay[line] * power


@part
def accelerate(cable, t):
    """`work.force` = P M^-1 f at the present configuration, without the energy balance
    (`works.evaluate`).
    """
    x, force = cable.state.x, cable.work.force
    all_forces(cable, x, force)
    if cable.loads.count:
        load_force(cable, x, t, force)
    solve_mass(cable, force)
    if cable.rows.count:
        project(cable, force, cable.state.pull)


@part
def store_rates(cable, t, stage):
    """Store the rates of (x, w) at the present state, with `work.force`, as those of a stage.

    Returns the power of the grasps [W].
    """
    state, work = cable.state, cable.work
    x_rate, w_rate = work.x_rate[stage], work.w_rate[stage]
    copy(state.w, x_rate)
    power = 0.0
    if grasps_move(cable):
        add_velocity_of_held(cable, state.x, t, x_rate)
        power -= pulled(cable, work.rates)
    copy(work.force, w_rate)
    power += add_turning(cable, state.w, t, w_rate)
    add_decay(cable, w_rate)
    return power


@part
def add_rates(rates, weights, scale, out):
    """out += scale sum_j weights[j] (rate of stage j)."""
    for j in range(len(weights)):
        weight = scale * weights[j]
        if weight != 0.0:
            add(weight, rates[j], out)


@part
def to_stage(cable, weights, t, tau):
    """Set the state to that of a stage at time t with weights a_ij, (s,), of the rates."""
    state, work = cable.state, cable.work
    copy(work.x_begin, state.x)
    copy(work.w_begin, state.w)
    add_rates(work.x_rate, weights, tau, state.x)
    add_rates(work.w_rate, weights, tau, state.w)
    set_directions(cable, t)
    move_anchors(cable, t)


@part
def to_end(cable, weights, t, tau):
    """Set the state to that at the end of the step, time t, projected onto the constraints."""
    to_stage(cable, weights, t, tau)
    carry(cable, cable.state.x, cable.state.w, t, 0.0)
    clear_moved(cable)  # the energy balance has this work from the stages
    if grasps_move(cable):
        project(cable, cable.state.w, cable.work.multipliers)


@piece(COUNTS, int64, ARRAY_2D, ARRAY, int64, int64, float64, int64, int64)
def advance_runge_kutta(address, table, nodes, first_step, steps, tau, guard, records_address):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations), as
    `advance_splitting` does.

    `table`: rows a_ij and, last, b_j, shape (s + 1, s); `nodes`: c_i, shape (s,).
    """
    cable, records = cable_at(address), records_at(records_address)
    a, nodes = grid(table), grid(nodes)
    state, work = cable.state, cable.work
    stages = len(nodes)
    b = a[stages]
    evaluations, power = 0, 0.0
    fresh = False  # the rates of stage 0 are those of the present state
    for step in range(first_step, first_step + steps):
        t0, t1 = step * tau, (step + 1) * tau
        sampling = begin_sample(cable, records, t0, tau)
        if not fresh:
            evaluate(cable, t0)
            power = store_rates(cable, t0, 0)
            evaluations += 1
        copy(state.x, work.x_begin)
        copy(state.w, work.w_begin)
        add_damping_loss(cable, tau * b[0])
        state.balance.drive_work += tau * b[0] * power
        for stage in range(1, stages):
            t = (step + nodes[stage]) * tau
            to_stage(cable, a[stage], t, tau)
            accelerate(cable, t)
            power = store_rates(cable, t, stage)
            add_damping_loss(cable, tau * b[stage])
            state.balance.drive_work += tau * b[stage] * power
        to_end(cable, b, t1, tau)
        evaluate(cable, t1)
        power = store_rates(cable, t1, 0)
        evaluations += stages
        fresh = not flow(cable)
        if (step + 1) % guard == 0 and not update_account(cable):
            return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(cable, records, t0, tau)
    return OK, steps, evaluations
