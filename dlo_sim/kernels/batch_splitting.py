"""Drift/kick steps of LANES scenes at once: a scene to a lane, for many cables of one structure.

`kernels.splitting` puts the knot spans of one cable on the vector lanes; the solve with the mass
matrix stays scalar there, and spans rarely fill the lanes. Here every row is dim x LANES numbers, a
scene to each lane, so that everything is vectors. Each lane has its own parameters, and nothing is
summed over lanes: a lane that diverges harms no other. A step may contain less (`Stack`); formulas
and their order are those of `kernels.elastic`, `forces`, `observe` and `splitting`.
"""

from __future__ import annotations

from dlo_sim.kernels.batch_forces import add_elastic, add_loads, add_springs, solve, start_force
from dlo_sim.kernels.batch_layout import add_rows, add_scaled, clear_row, put
from dlo_sim.kernels.batch_observe import kinetic, look, sampled, store_samples
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import DISSIPATED, LANES, LOAD_WORK, PENDING


@kernel
def work_row(x, before, load, load_before, out):
    """out += work of the mean load on the way from `before` to x."""
    for e in range(out.shape[0]):
        out[e] += 0.5 * (load[e] + load_before[e]) * (x[e] - before[e])


@kernel
def book_loads(x, loads, booked, load, load_before, before, scratch, ledger):
    """Work of the loads since the last evaluation, by the trapezoidal rule."""
    if loads is not None:
        if booked[0] != 0:
            clear_row(scratch)
            for i in range(x.shape[0]):
                work_row(x[i], before[i], load[i], load_before[i], scratch)
            add_rows(scratch, ledger[LOAD_WORK])
        put(x, before)
        booked[0] = 1
        clear_row(ledger[PENDING])


@kernel
def foresee_work(x, loads, load, before, scratch, ledger):
    """Work since the last evaluation with the loads of that: for a step that ends with a drift."""
    if loads is not None:
        clear_row(scratch)
        for i in range(x.shape[0]):
            work_row(x[i], before[i], load[i], load[i], scratch)
        clear_row(ledger[PENDING])
        add_rows(scratch, ledger[PENDING])


@kernel
def evaluate(state, stack, work, t):
    """Accelerations at the present configurations into work.force; the loads' work is booked."""
    x = state.position
    start_force(stack.gravity, work.force)
    add_elastic(
        x,
        stack.xi,
        stack.weights,
        stack.extraction,
        stack.slope,
        stack.stretch,
        stack.span_stretch,
        stack.bend,
        stack.axes,
        work.coefficients,
        work.gradient,
        work.force,
    )
    add_springs(x, stack.springs, work.force)
    scratch = work.sums[0]
    add_loads(stack.loads, t, scratch, work.load, work.load_before, work.force)
    book_loads(
        x,
        stack.loads,
        state.booked,
        work.load,
        work.load_before,
        work.before,
        scratch,
        state.ledger,
    )
    one = work.sums[1]
    for e in range(one.shape[0]):
        one[e] = 1.0
    solve(stack.lower, stack.upper, stack.inverse_diagonal, one, work.chain, work.force)


@kernel
def settle_work(state, stack, loads, work, t):
    """See `kernels.splitting.settle_work`."""
    if loads is not None:
        evaluate(state, stack, work, t)


@kernel
def shrink_row(keep, w):
    """w *= keep."""
    for e in range(w.shape[0]):
        w[e] *= keep[e]


@kernel
def decay(w, keep, band, sums, scratch, ledger):
    """Exact flow of the external damping over half a step."""
    if keep is not None:
        kinetic(w, band, sums, scratch)
        for lane in range(LANES):
            ledger[DISSIPATED, lane] += scratch[lane] * (1.0 - keep[lane] * keep[lane])
        for i in range(w.shape[0]):
            shrink_row(keep, w[i])


@kernel
def stack_step(state, stack, work, drift_weights, kick_weights, step, tau, fresh):
    """One step of every lane; see `kernels.splitting.splitting_step`."""
    elapsed = 0.0
    sums, parts = work.sums[0], work.parts[0]
    decay(state.w, stack.keep, stack.band, sums, parts, state.ledger)
    for stage in range(len(drift_weights)):
        c = drift_weights[stage]
        if c != 0.0:
            elapsed += c
            add_scaled(c * tau, state.w, state.position)
            fresh = False
        if kick_weights[stage] != 0.0:
            if not fresh:
                evaluate(state, stack, work, (step + elapsed) * tau)
                fresh = True
            add_scaled(kick_weights[stage] * tau, work.force, state.w)
    if not fresh:
        foresee_work(state.position, stack.loads, work.load, work.before, sums, state.ledger)
    decay(state.w, stack.keep, stack.band, sums, parts, state.ledger)
    return fresh


@entry
def advance_stack(
    state, stack, work, drift_weights, kick_weights, first_step, steps, tau, guard, recorder
):
    """Advance every lane by whole steps from time first_step * tau.

    Every `guard` steps (counted from time zero), at samples and at the end each lane's energy is
    judged. A lane that fails computes on without meaning; `StackState` says when it failed and
    keeps its last good state.
    """
    fresh = False
    if steps > 0 and drift_weights[0] != 0.0 and state.booked[0] == 0:
        settle_work(state, stack, stack.loads, work, first_step * tau)
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = sampled(recorder, t0, tau)
        if sampling:
            put(state.position, recorder.before)
            put(state.w, recorder.before_w)
        fresh = stack_step(state, stack, work, drift_weights, kick_weights, step, tau, fresh)
        if (step + 1) % guard == 0 and not fresh:
            settle_work(state, stack, stack.loads, work, (step + 1) * tau)
        if sampling or (step + 1) % guard == 0 or step + 1 == first_step + steps:
            look(state, stack, work, step + 1)
            if sampling:
                store_samples(state, recorder, work.parts, t0, tau)
