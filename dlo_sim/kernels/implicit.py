"""Implicit steps: one Newton loop for the energy-momentum method, the implicit midpoint rule and
the generalised-alpha method.

All three are a momentum balance of the free DOFs in the unknown q1,
    M (a (q1 - q0) - b w0 - c a0) = f(q0, q1),
where f is minus the discrete gradient (`energy_momentum`) or the force at q0 + theta (q1 - q0),
plus loads and damping there. The midpoint rule and the energy-momentum method have theta = 1/2,
a = 2 / tau^2, b = 2 / tau, c = 0; `layout.Alpha` holds the generalised-alpha constants. Newton's
method uses the exact tangent of everything but the geometry inside the viscosity. A step whose
iteration does not converge is taken back and done in halves, quarters, ... of its length.
The twist row is linear and always integrated by the midpoint rule.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.elastic import tangent_coefficients
from dlo_sim.kernels.ends import copy_anchors, restore_anchors
from dlo_sim.kernels.forces import clear
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import EXCHANGED, FLOOR, HISTORY, MAX_CORRECTIONS
from dlo_sim.kernels.matrix import eliminate, hold_prescribed
from dlo_sim.kernels.newton import (
    correct,
    damping_velocity_offset,
    largest,
    predict,
    residual_along,
    restore_prescribed,
    retreat,
    shortened,
    turned_over,
)
from dlo_sim.kernels.observe import (
    RESOLUTION,
    add_drive_velocity,
    begin_sample,
    end_sample,
    update_account,
)
from dlo_sim.kernels.splitting import DIVERGED, OK, drive_ends
from dlo_sim.kernels.step_account import (
    absorb_loss,
    add_reaction,
    book_step,
    ends_moved,
    finish_momentum,
    free_travel,
)
from dlo_sim.kernels.step_forces import momentum_residual, newton_matrix, step_force
from dlo_sim.kernels.twist_step import solve_twist

NOT_CONVERGED = 2
MAX_ITERATIONS = 40  # force evaluations before a step is halved
MAX_HALVINGS = 12
CAREFUL_HALVINGS = 4  # of a step that turns a part of the cable over; then that is its motion
SLOW = 0.02  # ratio of successive correction energies above which the matrix is renewed
STALLED = 0.2  # ratio of correction energies from which small corrections are round-off
GROWTH = 1.0  # of the residual along a correction beyond which the correction is shortened
SMALLEST_SHARE = 1e-6  # of a correction; below, the step is halved
NOISE = 1e-9  # largest share of the coordinates that such corrections may have
BUDGET = 300_000  # unknowns times iterations per step, with all its pieces: some 30 ms
LEAST_BUDGET = 500  # iterations per step
SAFETY = 10.0  # on the shrinking of the next correction
ROUND_OFF = 1e-14  # corrections below this share of the coordinates are round-off


@kernel
def implicit_step(
    state,
    terms,
    friction,
    viscosity,
    work,
    solver,
    t0,
    tau,
    whole,
    discrete,
    alpha,
    tolerance,
    careful,
):
    """One step in place; returns (converged, iterations). On failure the state is unchanged.

    It is a part of a step of length `whole`, over which reactions are averaged. `careful`: one that
    turns an edge of the control polygon over does not count as converged.

    The matrix is factorised at the first guess and kept while corrections shrink fast.
    """
    acceleration = state.history[2]
    # The generalised-alpha method needs an acceleration; its first step is one by the midpoint
    # rule.
    newmark = alpha.theta != 0.5 and state.ledger[HISTORY] > 0.0
    theta = alpha.theta if newmark else 0.5
    a = alpha.inertia / (tau * tau) if newmark else 2.0 / (tau * tau)
    b = a * tau
    c = alpha.inertia * (0.5 - alpha.beta) - alpha.mass_weight if newmark else 0.0
    rate = theta * alpha.gamma / alpha.beta if newmark else 1.0
    g = theta * (1.0 - alpha.gamma) - rate * (0.5 - alpha.beta) if newmark else 0.0
    n = terms.lattice.n
    dim = len(terms.axes)
    x = state.position
    copy_rows(x, n, solver.start)
    copy_rows(state.w, n, solver.start_w)
    tangent_coefficients(x, terms.lattice, terms.axes, solver.p0)
    predict(x, state.w, state.history, state.ledger, n, dim, tau)
    restore_prescribed(x, solver.start, terms.mass.free, n, dim)
    copy_rows(x, n, solver.coast)
    copy_anchors(terms.springs, work.anchors)
    drive_ends(x, terms.drive, terms.springs, terms.mass, terms.axes, n, t0 + tau, work.ends)
    if newmark:
        driven = solver.moved
        clear(driven)
        time = t0 + theta * tau
        add_drive_velocity(terms.drive, terms.mass.free, time, n, terms.axes, driven)
        damping_velocity_offset(
            x, solver.start_w, acceleration, driven, n, dim, tau, rate, g, solver.coast
        )
    else:
        clear(solver.coast)
    # The change over the step is kept apart from here on: a short step of a long cable moves it by
    # less than the coordinates can tell, and the momentum would be off by that over tau.
    difference(x, solver.start, n, work.before)
    scale = max(state.ledger[EXCHANGED], state.ledger[FLOOR])
    reach = largest(x, n, dim)  # size of the configuration, for the iteration's round-off floor
    converged = False
    iterations = 0
    previous = np.inf
    # Of the types that they keep: a literal would have numba compile what it is passed to twice.
    linearize = iterations == 0
    slope = 0.0  # |residual . correction| before the last correction
    share = 1.0  # of the last correction that is in x
    stalls = 0  # corrections in a row that did not get smaller
    known = np.int64(0)  # corrections since the matrix was made
    lost = 0.0
    while True:
        lost = step_force(
            x,
            terms,
            friction,
            viscosity,
            work,
            solver,
            t0,
            tau,
            theta,
            rate,
            discrete,
            linearize,
        )
        if converged or iterations == MAX_ITERATIONS:
            break
        iterations += 1
        inertia = momentum_residual(terms, acceleration, work, solver, n, dim, a, b, c)
        if known > 0:
            along = residual_along(solver, known - 1, n * dim)
            if not abs(along) <= GROWTH * slope and share > SMALLEST_SHARE:
                # Too far: back on the way that the last correction went, and on with a new matrix.
                less = share * shortened(slope, along)
                retreat(x, work.before, solver, known - 1, share - less, n, dim)
                share = less
                linearize = True
                continue
        if linearize or known == MAX_CORRECTIONS:
            newton_matrix(terms, friction, solver, n, dim, t0, tau, a, theta, rate)
            hold_prescribed(terms.mass.free, n, dim, solver.band)
            if not eliminate(solver.band, n * dim, 4 * dim - 1):
                break
            known = np.int64(0)
        energy, slope, defect, change = correct(x, work.before, solver, known, n, dim)
        known += 1
        if not energy < 1e300:
            break
        stalls = stalls + 1 if energy > STALLED * previous else 0
        # The correction just made leaves about `shrinking` of the defect.
        shrinking = np.sqrt(energy / previous) if share == 1.0 and iterations > 1 else 1.0
        share = 1.0
        exhausted = change <= ROUND_OFF * reach or (stalls > 1 and change <= NOISE * reach)
        converged = exhausted or (
            min(SAFETY * shrinking, 1.0) * defect <= tolerance * max(scale, 0.1 * inertia)
        )
        if exhausted:
            # The coordinates have no digits left: the account cannot be better than this.
            state.ledger[FLOOR] = max(state.ledger[FLOOR], RESOLUTION * defect)
        # What driven ends do is booked with the forces after the last correction.
        if converged and not ends_moved(terms.drive, terms.mass, work, n):
            break
        linearize = energy > SLOW * previous and not converged
        previous = energy
    # Newton's method may find a cable folded through itself, at no cost in energy.
    if converged and careful:
        converged = not turned_over(x, solver.start, terms.mass.free, work, n, dim)
    if converged:
        lost += solve_twist(x, terms, terms.twist, friction, work, solver, n, dim, t0, tau)
        free_travel(terms.drive, terms.mass, work, n, solver.moved)
        finish_momentum(
            state.w, acceleration, solver.moved, terms.mass, solver, alpha, newmark, n, dim, tau
        )
        if alpha.theta != 0.5:
            lost = 0.0  # booked by `absorb_loss` with what the method itself dissipates
        book_step(terms, terms.drive, terms.loads, work, solver, state, lost, n)
        add_reaction(state, terms, work, solver, n, t0, tau, whole)
        state.ledger[HISTORY] += 1.0
    else:
        copy_rows(solver.start, n, x)
        restore_anchors(terms.drive, terms.springs, work.anchors)
        state.ledger[HISTORY] = 0.0
    return converged, iterations


@kernel
def copy_rows(source, n, target):
    """target = source."""
    for d in range(source.shape[0]):
        for i in range(n):
            target[d, i] = source[d, i]


@kernel
def difference(a, b, n, out):
    """out = a - b."""
    for d in range(a.shape[0]):
        for i in range(n):
            out[d, i] = a[d, i] - b[d, i]


@kernel
def implicit_step_halving(
    state,
    terms,
    friction,
    viscosity,
    work,
    solver,
    t0,
    tau,
    step,
    discrete,
    alpha,
    tolerance,
    halvings,
    allowed,
):
    """One sub-step tau of a step, done in smaller pieces where Newton does not converge: (status,
    iterations). It is given up after so many as are `allowed`.
    """
    total = 0
    level = 0
    done = 0  # in units of tau 2^-MAX_HALVINGS
    whole = 1 << MAX_HALVINGS
    while done < whole:
        piece = whole >> level
        converged, used = implicit_step(
            state,
            terms,
            friction,
            viscosity,
            work,
            solver,
            t0 + tau * done / whole,
            tau * piece / whole,
            step,
            discrete,
            alpha,
            tolerance,
            level < CAREFUL_HALVINGS,
        )
        total += used
        if converged:
            done += piece
            # Grow again only where the larger piece is aligned, so that pieces nest.
            if level > 0 and done % (2 * piece) == 0:
                level -= 1
        elif level == halvings or total > allowed:
            return NOT_CONVERGED, total
        else:
            level += 1
    return OK, total


@entry
def advance_implicit(
    state,
    terms,
    work,
    solver,
    friction,
    viscosity,
    substeps,
    discrete,
    alpha,
    tolerance,
    halvings,
    first_step,
    steps,
    tau,
    recorder,
):
    """Advance by whole steps; returns (status, steps done, Newton iterations).

    `viscosity` is None without stiffness damping, else beta. `substeps` are the lengths of the
    parts that a step is composed of, in units of the step. `halvings` (at most MAX_HALVINGS) is
    how often a step may be halved. The energy account is updated every step.
    """
    iterations = 0
    budget = max(BUDGET // (terms.lattice.n * len(terms.axes)), LEAST_BUDGET)
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        before = iterations
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        clear(state.reaction)
        at = 0.0
        for k in range(substeps.shape[0]):
            status, used = implicit_step_halving(
                state,
                terms,
                friction,
                viscosity,
                work,
                solver,
                t0 + at * tau,
                substeps[k] * tau,
                tau,
                discrete,
                alpha,
                tolerance,
                halvings,
                budget - (iterations - before),
            )
            iterations += used
            at += substeps[k]
            if status != OK:
                return status, step - first_step, iterations
        if alpha.theta != 0.5:
            absorb_loss(state, terms, work)
        _, sane = update_account(state, terms, work)
        if not sane:
            return DIVERGED, step - first_step, iterations
        if sampling:
            end_sample(state, terms, work, recorder, t0, tau)
    return OK, steps, iterations
