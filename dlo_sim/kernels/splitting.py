"""The one loop that executes every drift/kick method (see `dlo_sim.core.methods`).

A step is: for each stage, drift q by c_i tau w, then kick w by d_i tau M^-1 f(q). Driven ends are
placed at the stage's own time and the free DOFs are carried along exactly (see `layout.State`).
External damping is an exactly solved flow of its own, half before and half after the drift/kick
step, and only offered for methods without negative weights.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.banded import quadratic_form, solve_rows
from dlo_sim.kernels.ends import anchor_work, keep_anchors, move_anchors, place_ends
from dlo_sim.kernels.forces import clear, conservative_force, load_force
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import BOOKED, DISSIPATED, DRIVE_WORK, LOAD_WORK, PENDING
from dlo_sim.kernels.observe import (
    begin_sample,
    end_sample,
    potentials,
    prescribed_column,
    update_account,
)
from dlo_sim.kernels.plastic import plastic_flow

OK = 0
DIVERGED = 1


@kernel
def drive_ends(x, drive, springs, mass, axes, n, t, ends):
    """Put driven ends where they are at time t and carry the free DOFs along."""
    if drive is not None:
        rows = x.shape[0]
        for d in range(rows):
            for j in range(4):
                ends[d, j] = x[d, prescribed_column(j, n)]
        place_ends(drive.motion, t, n, axes, x)
        move_anchors(drive.motion, springs, t, axes)
        for j in range(4):
            column = prescribed_column(j, n)
            for d in range(rows):
                moved = x[d, column] - ends[d, j]
                if mass.free[d, column] == 0.0 and moved != 0.0:
                    for i in range(n):
                        x[d, i] -= drive.shift[d, j, i] * moved


@kernel
def drift(state, terms, work, t, dt):
    """Move every DOF over dt to time t: free ones at rate w, driven ends to their place."""
    n = terms.lattice.n
    x = state.position
    drive_ends(x, terms.drive, terms.springs, terms.mass, terms.axes, n, t, work.ends)
    for d in range(x.shape[0]):
        for i in range(n):
            x[d, i] += dt * state.w[d, i]


@kernel
def drive_pull(force, drive, mass, n, pull):
    """Force on each driven DOF, reduced to the free motion: pull[0] = f_p - shift^T f_f."""
    if drive is not None:
        for d in range(force.shape[0]):
            for j in range(4):
                pull[1, d, j] = pull[0, d, j]
                column = prescribed_column(j, n)
                value = 0.0
                if mass.free[d, column] == 0.0:
                    value = force[d, column]
                    for i in range(n):
                        value -= drive.shift[d, j, i] * force[d, i]
                pull[0, d, j] = value


@kernel
def add_loads(x, loads, axes, t, work):
    """Add the loads at time t to work.force and remember them in work.load."""
    if loads is not None:
        for d in range(work.load.shape[0]):
            for i in range(work.load.shape[1]):
                work.load_before[d, i] = work.load[d, i]
        clear(work.load)
        load_force(x, loads, axes, t, work.load)
        for d in range(work.load.shape[0]):
            for i in range(work.load.shape[1]):
                work.force[d, i] += work.load[d, i]


@kernel
def book_loads(state, loads, n, work):
    """Work of the loads since the last evaluation, by the trapezoidal rule."""
    if loads is not None:
        done = 0.0
        for d in range(state.position.shape[0]):
            for i in range(n):
                moved = state.position[d, i] - work.before[d, i]
                done += 0.5 * (work.load[d, i] + work.load_before[d, i]) * moved
        state.ledger[LOAD_WORK] += done


@kernel
def book_drive(state, drive, springs, n, work):
    """Work of the driven ends since the last evaluation, by the trapezoidal rule."""
    if drive is not None:
        done = anchor_work(springs, work.anchors, work.before, state.position, n)
        for d in range(state.position.shape[0]):
            for j in range(4):
                column = prescribed_column(j, n)
                moved = state.position[d, column] - work.before[d, column]
                done -= 0.5 * (work.pull[0, d, j] + work.pull[1, d, j]) * moved
        state.ledger[DRIVE_WORK] += done


@kernel
def remember(state, loads, drive, springs, n, work):
    """Keep the positions that the booked work counts from."""
    if loads is not None or drive is not None:
        for d in range(state.position.shape[0]):
            for i in range(n):
                work.before[d, i] = state.position[d, i]
        keep_anchors(drive, springs, work.anchors)
        state.ledger[BOOKED] = 1.0
        state.ledger[PENDING] = 0.0


@kernel
def foresee_work(state, loads, drive, springs, n, work):
    """Work since the last evaluation with the forces of that: for a step that ends with a drift."""
    if loads is not None or drive is not None:
        done = 0.0
        for d in range(state.position.shape[0]):
            if loads is not None:
                for i in range(n):
                    done += work.load[d, i] * (state.position[d, i] - work.before[d, i])
            if drive is not None:
                for j in range(4):
                    column = prescribed_column(j, n)
                    moved = state.position[d, column] - work.before[d, column]
                    done -= work.pull[0, d, j] * moved
        if drive is not None:
            done += anchor_work(springs, work.anchors, work.before, state.position, n)
        state.ledger[PENDING] = done


@kernel
def evaluate(state, terms, work, t):
    """All forces at the present configuration into work.force; their work into the ledger."""
    n = terms.lattice.n
    conservative_force(state.position, terms, work, work.force)
    add_loads(state.position, terms.loads, terms.axes, t, work)
    drive_pull(work.force, terms.drive, terms.mass, n, work.pull)
    if state.ledger[BOOKED] != 0.0:
        book_loads(state, terms.loads, n, work)
        book_drive(state, terms.drive, terms.springs, n, work)
    remember(state, terms.loads, terms.drive, terms.springs, n, work)


@kernel
def settle_work(state, terms, loads, drive, work, t):
    """Book the work up to a time t between steps whose method begins and ends them with a drift."""
    if loads is not None or drive is not None:
        evaluate(state, terms, work, t)


@entry
def jump_ends(state, terms, work, t):
    """Put driven ends in no time where they are at t. What does that does the change of the
    potential energy: the trapezoidal rule knows nothing of so long a way.
    """
    if state.ledger[BOOKED] != 0.0:
        settle_work(state, terms, terms.loads, terms.drive, work, t)
    for part in potentials(state.position, terms, work):
        state.ledger[DRIVE_WORK] -= part
    n = terms.lattice.n
    drive_ends(state.position, terms.drive, terms.springs, terms.mass, terms.axes, n, t, work.ends)
    for part in potentials(state.position, terms, work):
        state.ledger[DRIVE_WORK] += part
    state.ledger[BOOKED] = 0.0


@kernel
def decay_flow(state, mass, decay, n, dt):
    """Exact flow of the external damping over dt."""
    if decay is not None:
        rate, factor = 0.0, 1.0
        for d in range(state.w.shape[0]):
            if decay[d] != rate:  # an exponential takes as long as the rest of a row
                rate = decay[d]
                factor = np.exp(-rate * dt)
            lost = 0.5 * quadratic_form(mass.band[d], n, state.w[d]) * (1.0 - factor * factor)
            for i in range(n):
                state.w[d, i] *= factor
            state.ledger[DISSIPATED] += lost


@kernel
def splitting_step(state, terms, work, drift_weights, kick_weights, step, tau, fresh):
    """One step; `fresh` says that work.force holds the accelerations of the present state.

    Times are (step + c) tau, so that the end of a step is the start of the next one to the last
    bit. Returns (fresh after the step, force evaluations).
    """
    n = terms.lattice.n
    evaluations = 0
    elapsed = 0.0
    decay_flow(state, terms.mass, terms.decay, n, 0.5 * tau)
    for stage in range(len(drift_weights)):
        c = drift_weights[stage]
        if c != 0.0:
            elapsed += c
            drift(state, terms, work, (step + elapsed) * tau, c * tau)
            fresh = False
        if kick_weights[stage] != 0.0:
            if not fresh:
                evaluate(state, terms, work, (step + elapsed) * tau)
                solve_rows(terms.mass.lower, terms.mass.inverse_diagonal, n, work.force)
                evaluations += 1
                fresh = True
            dt = kick_weights[stage] * tau
            for d in range(state.w.shape[0]):
                for i in range(n):
                    state.w[d, i] += dt * work.force[d, i]
    if not fresh:
        foresee_work(state, terms.loads, terms.drive, terms.springs, n, work)
    decay_flow(state, terms.mass, terms.decay, n, 0.5 * tau)
    return fresh, evaluations


@entry
def advance_splitting(
    state, terms, work, drift_weights, kick_weights, first_step, steps, tau, guard, recorder
):
    """Advance by whole steps from time first_step * tau.

    Returns (OK or DIVERGED, steps done, force evaluations). Every `guard` steps (counted from time
    zero, so that splitting a run into calls changes nothing) the energy account is checked.
    """
    evaluations = 0
    fresh = False
    if steps > 0 and drift_weights[0] != 0.0 and state.ledger[BOOKED] == 0.0:
        settle_work(state, terms, terms.loads, terms.drive, work, first_step * tau)
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        fresh, used = splitting_step(
            state, terms, work, drift_weights, kick_weights, step, tau, fresh
        )
        evaluations += used
        if plastic_flow(state, terms.lattice, terms.plastic, terms.axes, work.coefficients):
            fresh = False
        if (step + 1) % guard == 0:
            if not fresh:
                settle_work(state, terms, terms.loads, terms.drive, work, (step + 1) * tau)
            _, sane = update_account(state, terms, work)
            if not sane:
                return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(state, terms, work, recorder, t0, tau)
    return OK, steps, evaluations
