"""The step of all explicit Runge-Kutta methods (`core.methods`).

It integrates x' = w + Y (rates of the targets), w' = P M^-1 f + P' v - decay w (`engine.rows`). At
the end of a step the state is projected onto the constraints: x <- x + Y (targets - B x), w <- P w.
The work of the grasps is the quadrature of their power at the stages. The forces at the end serve
the first stage of the next step.
"""

from __future__ import annotations

from numba import boolean, float64, int64

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.arrays import CABLE, DAMPED, METHOD, RUNGE_KUTTA
from dlo_sim.engine.assembly import all_forces
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
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.works import evaluate


@inline
def add_decay(cable, out):
    """out += - decay w of the external damping."""
    if not cable.terms & DAMPED:
        return
    w, decay = cable.state.w, cable.linear.decay
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            store(out, line, c, load(out, line, c) - decay[line] * load(w, line, c))


@inline
def add_damping_loss(cable, dt):
    """Add dt times the power of the external damping, decay w^T M w, to `balance.dissipated`."""
    if not cable.terms & DAMPED:
        return
    for line in range(cable.lines):
        power = form(mass_of(cable, line), cable.state.w[line])
        cable.state.balance.dissipated += dt * cable.linear.decay[line] * power


@inline
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


@inline
def add_rates(rates, weights, scale, out):
    """out += scale sum_j weights[j] (rate of stage j)."""
    for j in range(len(weights)):
        weight = scale * weights[j]
        if weight != 0.0:
            add(weight, rates[j], out)


@inline
def to_stage(cable, weights, t, tau):
    """Set the state to that of a stage at time t with weights a_ij, (s,), of the rates."""
    state, work = cable.state, cable.work
    copy(work.x_begin, state.x)
    copy(work.w_begin, state.w)
    add_rates(work.x_rate, weights, tau, state.x)
    add_rates(work.w_rate, weights, tau, state.w)
    set_directions(cable, t)
    move_anchors(cable)


@kernel(boolean, METHOD, CABLE, int64, float64, terms=RUNGE_KUTTA)
def runge_kutta_step(method, cable, step, tau):
    """Step number `step`, of length tau."""
    state, work = cable.state, cable.work
    balance, results, b = state.balance, work.results, method.weights
    if results.forces_known == 0.0:
        evaluate(cable, step * tau)
        results.power = store_rates(cable, step * tau, 0)
        results.evaluations += 1.0
    copy(state.x, work.x_begin)
    copy(state.w, work.w_begin)
    power = results.power
    for stage in range(method.stages):
        if stage > 0:
            t = (step + method.nodes[stage]) * tau
            to_stage(cable, method.matrix[stage], t, tau)
            all_forces(cable, state.x, work.force)  # `evaluate` without the energy balance
            if cable.loads.count:
                load_force(cable, state.x, t, work.force)
            solve_mass(cable, work.force)
            if cable.rows.count:
                project(cable, work.force, state.pull)
            power = store_rates(cable, t, stage)
        add_damping_loss(cable, tau * b[stage])
        balance.drive_work += tau * b[stage] * power
    t = (step + 1) * tau
    to_stage(cable, b, t, tau)
    carry(cable, state.x, state.w, t, 0.0)  # onto the constraints
    clear_moved(cable)  # the energy balance has this work from the stages
    if grasps_move(cable):
        project(cable, state.w, work.multipliers)
    evaluate(cable, t)
    results.power = store_rates(cable, t, 0)
    results.evaluations += method.stages
    results.forces_known = 1.0
    return True
