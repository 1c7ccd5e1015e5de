"""RATTLE: explicit steps of an inextensible cable with length constraints.

Stretching is replaced by n - 1 constraints: the mean of g = (|r'|^2 - 1) / 2 over every knot span
is 0, and so is g at u = 0 and u = L. That is one constraint per axial degree of freedom of a
straight cable, so that it is inextensible without locking in bending. A step is one of velocity
Verlet (`methods.splitting`, held rows included) with two corrections, of the positions after the
drift and of the velocities at the end,
    M u = - G(q0)^T mu - B0^T kappa,    g(q1 + u) = 0,    B1 u = 0;    q1 += u,  w += u / tau
    M u = - G(q1)^T nu - B1^T kappa,    G(q1) (v1 + u) = 0,    B1 u = 0;    w1 += u:
second order, symmetric and symplectic on the constraint manifold. `methods.length_constraints`
solves both.

Source: Andersen 1983, J. Comput. Phys. 52; Hairer, Lubich & Wanner 2006, VII.1.4.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, bare, load, shifted, zero
from dlo_sim.compiling.pieces import (
    COUNTS,
    NOTHING,
    REAL,
    REALS,
    TRUTH,
    WHOLE,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.account import add_to_ledger
from dlo_sim.engine.assembly import flow
from dlo_sim.engine.bundles import CABLE, RECORDS, bared, bared_records
from dlo_sim.engine.held import grasps_move
from dlo_sim.engine.held_motion import add_velocity_of_held
from dlo_sim.engine.lines import add, copy
from dlo_sim.engine.sampling import begin_sample
from dlo_sim.methods.explicit_layout import CORRECTION, HOLDING_FORCE, MEAN, MULTIPLIERS, STEP_MOVED
from dlo_sim.methods.length_constraints import (
    add_solution,
    along_gradient,
    clear_multipliers,
    factorize,
    factorize_held,
    first_point,
    gradient,
    keep_length,
    prepare,
    slot,
    solve,
)
from dlo_sim.methods.splitting import ENGINE, decay_flow, drift

MOST_PROJECTIONS = 20


@part
def factorize_present(shape, model, state, scratch):
    """Factorise all systems at the present configuration; return whether all pivots were usable."""
    good = factorize(shape, model, state, scratch, shifted(state, shape[layout.X]))
    factorize_held(shape, model, state, scratch)
    return good


@part
def project_velocity(shape, model, inputs, state, scratch, t, tau):
    """Project w onto G v = 0 with the matrix of the present configuration."""
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    v = shifted(scratch, shape[MEAN])
    copy(shape, w, v)
    if grasps_move(shape, inputs):
        add_velocity_of_held(shape, model, inputs, state, scratch, x, t, v)
        for at in range(shape[layout.HELD] * LANES):
            state[shape[layout.RATES_BEFORE] + at] = scratch[shape[layout.RATES] + at]
    clear_multipliers(shape, scratch)
    for j in range(shape[layout.N] - 1):
        value = along_gradient(shape, model, x, v, j)
        scratch[shape[MULTIPLIERS] + slot(shape, j)] = -value
    solve(shape, model, state, scratch, 1.0 / tau)
    add_solution(shape, scratch, 1.0, w)


@part
def save_moved(shape, state, scratch):
    """STEP_MOVED = MOVED: `evaluate` resets MOVED when it adds the work to the ledger."""
    for at in range(shape[layout.HELD] * LANES):
        scratch[shape[STEP_MOVED] + at] = state[shape[layout.MOVED] + at]


@part
def add_impulse_work(shape, state, scratch, tau):
    """Add to the ledger the work of the grasps against the constraint forces of one correction,
    HOLDING_FORCE over tau, and reset these.

    An impulse does work on the mean of the velocities before and after it: RATES_BEFORE and the
    mean rate over the step. This is exact also if the cable is set in motion by a velocity jump.
    """
    f = zero()
    for k in range(shape[layout.HELD]):
        at = k * LANES
        way = load(scratch, shape[STEP_MOVED] + at) + tau * load(
            state, shape[layout.RATES_BEFORE] + at
        )
        f -= 0.5 * scratch[shape[HOLDING_FORCE] + at] * way
    add_to_ledger(shape, state, layout.DRIVE_WORK, f)
    clear_holding_force(shape, scratch)


@part
def clear_holding_force(shape, scratch):
    """HOLDING_FORCE = 0."""
    for at in range(shape[layout.HELD] * LANES):
        scratch[shape[HOLDING_FORCE] + at] = 0.0


@part
def rattle_step(shape, model, inputs, state, scratch, forces, carry, evaluate, t0, tau):
    """One step from a configuration with known matrix and forces; return whether it was solved."""
    x, w, force = (
        shifted(state, shape[layout.X]),
        shifted(state, shape[layout.W]),
        shifted(scratch, shape[layout.FORCE]),
    )
    add(shape, 0.5 * tau, force, w)
    moves = grasps_move(shape, inputs)
    drift(shape, model, inputs, state, scratch, carry, t0 + tau, tau)
    save_moved(shape, state, scratch)
    clear_holding_force(shape, scratch)
    if moves:
        factorize_held(shape, model, state, scratch)
    if not keep_length(shape, model, state, scratch, x, 1.0 / (tau * tau)):
        return False
    if moves:
        add_impulse_work(shape, state, scratch, tau)
    add(shape, 1.0 / tau, shifted(scratch, shape[CORRECTION]), w)
    evaluate(shape, model, inputs, state, scratch, forces, t0 + tau)
    add(shape, 0.5 * tau, force, w)
    good = factorize_present(shape, model, state, scratch)
    project_velocity(shape, model, inputs, state, scratch, t0 + tau, tau)
    if moves:
        add_impulse_work(shape, state, scratch, tau)
    return good


@piece(COUNTS, CABLE, ENGINE, WHOLE, WHOLE, REAL, WHOLE, RECORDS)
def advance_rattle(cable, engine, first_step, steps, tau, guard, records):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations).

    A step whose constraints cannot be satisfied ends the run.
    """
    _, forces, look, flows, carry, evaluate, update, end_sample = engine.pieces
    shape, model, inputs, state, scratch = bared(cable)
    records = bared_records(records)
    evaluations = 0
    if steps > 0:
        evaluate(shape, model, inputs, state, scratch, forces, first_step * tau)
        prepare(shape, model, scratch)
        if not factorize_present(shape, model, state, scratch):
            return layout.NOT_CONVERGED, 0, 0
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(shape, model, inputs, state, scratch, records, t0, tau)
        decay_flow(shape, model, state, scratch, 0.5 * tau)
        if not rattle_step(shape, model, inputs, state, scratch, forces, carry, evaluate, t0, tau):
            return layout.NOT_CONVERGED, step - first_step, evaluations
        decay_flow(shape, model, state, scratch, 0.5 * tau)
        evaluations += 1
        if flow(flows, shape, model, inputs, state, scratch):
            evaluate(shape, model, inputs, state, scratch, forces, (step + 1) * tau)
        if (step + 1) % guard == 0 and not update(shape, model, state, scratch, look):
            return layout.DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return layout.OK, steps, evaluations


@piece(TRUTH, CABLE)
def to_rest_length(cable):
    """Project the configuration onto g = 0, in the metric of the mass matrix; return success."""
    shape, model, _, state, scratch = bared(cable)
    prepare(shape, model, scratch)
    x = shifted(state, shape[layout.X])
    for _ in range(MOST_PROJECTIONS):
        if not factorize_present(shape, model, state, scratch):
            return False
        if keep_length(shape, model, state, scratch, x, 0.0):
            return True
    return False


@piece(NOTHING, CABLE, REALS, REALS, REALS)
def add_constraint_force(cable, v, acceleration, force):
    """force += - G^T lambda, the constraint forces of the present motion; arguments are lines.

    `acceleration`: that without length constraints. lambda follows from the second time derivative
    of the constraints, G a = - |dr'/dt|^2 (averaged like g).
    """
    shape, model, _, state, scratch = bared(cable)
    v, acceleration, force = bare(v), bare(acceleration), bare(force)
    x = shifted(state, shape[layout.X])
    prepare(shape, model, scratch)
    factorize_present(shape, model, state, scratch)
    clear_multipliers(shape, scratch)
    for j in range(shape[layout.N] - 1):
        value = along_gradient(shape, model, v, v, j)
        value += along_gradient(shape, model, x, acceleration, j)
        scratch[shape[MULTIPLIERS] + slot(shape, j)] = -value
    solve(shape, model, state, scratch, 0.0)
    for j in range(shape[layout.N] - 1):
        multiplier = scratch[shape[MULTIPLIERS] + slot(shape, j)]
        at = layout.MARGIN + first_point(shape, j)
        for d in range(shape[layout.DIM]):
            g = gradient(shape, model, x, j, d)
            to = d * shape[layout.LINE] + at
            force[to] -= g[0] * multiplier
            force[to + 1] -= g[1] * multiplier
            force[to + 2] -= g[2] * multiplier
            force[to + 3] -= g[3] * multiplier
