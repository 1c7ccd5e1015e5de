"""The one loop that executes every explicit Runge-Kutta method (see `dlo_sim.core.methods`).

It integrates d/dt (q, w) = (w, M^-1 f(q, t) - decay w). Driven ends are placed at each stage's own
time and the free DOFs are carried along (see `layout.State`), so that the slope of the positions is
w itself. The forces at the end of a step are the first stage of the next.
"""

from __future__ import annotations

from dlo_sim.kernels.banded import quadratic_form, solve_rows
from dlo_sim.kernels.forces import conservative_force, load_force
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import BOOKED, DISSIPATED
from dlo_sim.kernels.observe import begin_sample, end_sample, update_account
from dlo_sim.kernels.plastic import plastic_flow
from dlo_sim.kernels.splitting import (
    DIVERGED,
    OK,
    add_loads,
    book_drive,
    book_loads,
    drive_ends,
    drive_pull,
    remember,
)


@kernel
def keep_start(state, start):
    """Copy the state at the start of a step."""
    for d in range(state.w.shape[0]):
        for i in range(state.w.shape[1]):
            start[0, d, i] = state.position[d, i]
            start[1, d, i] = state.w[d, i]


@kernel
def go_back(state, start):
    """Put the configuration of the step's start in place, prescribed control points included."""
    for d in range(state.w.shape[0]):
        for i in range(state.w.shape[1]):
            state.position[d, i] = start[0, d, i]
            state.w[d, i] = start[1, d, i]


@kernel
def add_slopes(state, n, weights, slopes, tau):
    """(q, w) += tau sum_j weights_j slope_j."""
    for j in range(weights.shape[0]):
        dt = tau * weights[j]
        if dt != 0.0:
            for d in range(state.w.shape[0]):
                for i in range(n):
                    state.position[d, i] += dt * slopes[j, 0, d, i]
                    state.w[d, i] += dt * slopes[j, 1, d, i]


@kernel
def keep_slope(state, force, decay, n, slope):
    """Slope of (q, w) at the present state, with the accelerations in `force`."""
    for d in range(state.w.shape[0]):
        rate = 0.0
        if decay is not None:
            rate = decay[d]
        for i in range(n):
            slope[0, d, i] = state.w[d, i]
            slope[1, d, i] = force[d, i] - rate * state.w[d, i]


@kernel
def lose_energy(state, mass, decay, n, dt):
    """Add dt times the power of the external damping, decay w^T M w of every row, to the ledger."""
    if decay is not None:
        for d in range(state.w.shape[0]):
            power = decay[d] * quadratic_form(mass.band[d], n, state.w[d])
            state.ledger[DISSIPATED] += dt * power


@kernel
def book_work(state, terms, work):
    """Work of loads and driven ends since the last call into the ledger; needs their forces."""
    n = terms.lattice.n
    drive_pull(work.force, terms.drive, terms.mass, n, work.pull)
    if state.ledger[BOOKED] != 0.0:
        book_loads(state, terms.loads, n, work)
        book_drive(state, terms.drive, terms.springs, n, work)
    remember(state, terms.loads, terms.drive, terms.springs, n, work)


@kernel
def runge_kutta_step(state, terms, work, table, nodes, slopes, step, tau, fresh):
    """One step; `fresh` says that slopes[0] belongs to the present state.

    Row i of `table` leads to stage i, its last row (the weights b_j) to the end of the step. slopes
    holds one slope per stage and, last, the state at the step's start. Returns force evaluations.
    """
    n = terms.lattice.n
    last = table.shape[0] - 1
    keep_start(state, slopes[last])
    evaluations = 0
    for stage in range(1 if fresh else 0, last + 1):
        t = (step + nodes[stage]) * tau
        if stage > 0:
            lose_energy(state, terms.mass, terms.decay, n, tau * table[last, stage - 1])
            go_back(state, slopes[last])
            drive_ends(
                state.position, terms.drive, terms.springs, terms.mass, terms.axes, n, t, work.ends
            )
            add_slopes(state, n, table[stage], slopes, tau)
        conservative_force(state.position, terms, work, work.force)
        if stage == last or stage == 0:
            add_loads(state.position, terms.loads, terms.axes, t, work)
            book_work(state, terms, work)
        else:
            load_force(state.position, terms.loads, terms.axes, t, work.force)
        solve_rows(terms.mass.lower, terms.mass.inverse_diagonal, n, work.force)
        keep_slope(state, work.force, terms.decay, n, slopes[0 if stage == last else stage])
        evaluations += 1
    return evaluations


@entry
def advance_runge_kutta(
    state, terms, work, table, nodes, slopes, first_step, steps, tau, guard, recorder
):
    """Advance by whole steps from time first_step * tau.

    Args:
        table: rows a_ij and, last, b_j, shape (s + 1, s). nodes: c_i and 1, shape (s + 1,).
        slopes: scratch, shape (s + 1, 2, rows, width).

    Returns (OK or DIVERGED, steps done, force evaluations), as `advance_splitting` does.
    """
    evaluations = 0
    fresh = False
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        evaluations += runge_kutta_step(state, terms, work, table, nodes, slopes, step, tau, fresh)
        fresh = not plastic_flow(state, terms.lattice, terms.plastic, terms.axes, work.coefficients)
        if (step + 1) % guard == 0:
            _, sane = update_account(state, terms, work)
            if not sane:
                return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(state, terms, work, recorder, t0, tau)
    return OK, steps, evaluations
