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

from dlo_sim.kernels.banded import factorize_row, multiply, quadratic_form, solve_row
from dlo_sim.kernels.discrete_gradient import span_discrete_gradient
from dlo_sim.kernels.elastic import scatter_gradient, tangent_coefficients
from dlo_sim.kernels.ends import anchor_work, copy_anchors, restore_anchors
from dlo_sim.kernels.forces import clear, load_force
from dlo_sim.kernels.jit import entry, inlined, kernel
from dlo_sim.kernels.layout import (
    DISSIPATED,
    DRIVE_WORK,
    ENERGY_START,
    EXCHANGED,
    FLOOR,
    HISTORY,
    LOAD_WORK,
    MAX_CORRECTIONS,
    REACTION,
)
from dlo_sim.kernels.matrix import (
    add_load_stiffness,
    add_mass,
    add_springs,
    eliminate,
    hold_prescribed,
    scatter_matrices,
    span_matrices,
    substitute,
)
from dlo_sim.kernels.observe import (
    begin_sample,
    end_sample,
    kinetic_energy,
    potentials,
    prescribed_column,
    update_account,
    velocities,
)
from dlo_sim.kernels.splitting import DIVERGED, OK, drive_ends, drive_pull
from dlo_sim.kernels.tangent import span_jacobian

NOT_CONVERGED = 2
MAX_ITERATIONS = 40  # force evaluations before a step is halved
MAX_HALVINGS = 12
SLOW = 0.02  # ratio of successive correction energies above which the matrix is renewed
STALLED = 0.2  # ratio of correction energies from which small corrections are round-off
GROWTH = 1.0  # of the residual along a correction beyond which the correction is shortened
SMALLEST_SHARE = 1e-6  # of a correction; below, the step is halved
TRUSTED = 0.5  # largest share by which a correction may be repeated
SMALLEST = 1e-300  # square of a correction
NOISE = 1e-9  # largest share of the coordinates that such corrections may have
BUDGET = 3000  # iterations per step, with all its pieces
SAFETY = 10.0  # on the shrinking of the next correction
ROUND_OFF = 1e-14  # corrections below this share of the coordinates are round-off


@kernel
def friction_beta(friction, tau):
    """beta / tau of the Kelvin-Voigt damping."""
    if friction is not None:
        return friction.stiffness / tau
    return 0.0


@kernel
def friction_force(friction, dx, n, tau, out):
    """out -= C (q1 - q0) / tau of the linear damping, every row."""
    if friction is not None:
        for d in range(dx.shape[0]):
            multiply(friction.viscous[d], n, dx[d], -1.0 / tau, out[d])


@kernel
def friction_stiffness(friction, n, dim, tau, band):
    """Add C / tau to the band matrix."""
    if friction is not None:
        half = 4 * dim - 1
        for d in range(dim):
            for i in range(n):
                r = i * dim + d
                band[r, half] += friction.viscous[d, 0, i] / tau
                for k in range(1, 4):
                    if i + k < n:
                        value = friction.viscous[d, k, i] / tau
                        band[r, half + k * dim] += value
                        band[r + k * dim, half - k * dim] += value


@kernel
def gravity_and_springs(x, gravity, springs, before, theta, n, out):
    """out += weight and spring forces at configuration x (spatial rows).

    The springs' anchors are where they are on the way from `before`, at theta.
    """
    if gravity is not None:
        for d in range(gravity.shape[0]):
            for i in range(n):
                out[d, i] += gravity[d, i]
    if springs is not None:
        for e in range(2):
            i = 0 if e == 0 else n - 1
            for d in range(springs.stiffness.shape[1]):
                anchor = before[e, d] + theta * (springs.anchor[e, d] - before[e, d])
                out[d, i] -= springs.stiffness[e, d] * (x[d, i] - anchor)


@kernel
def span_configurations(solver, theta, discrete):
    """Turn p1 into the configuration whose force is wanted, dp into the change over the step."""
    for b in range(solver.p0.shape[0]):
        for row in range(solver.p0.shape[1]):
            for lane in range(solver.p0.shape[2]):
                change = solver.p1[b, row, lane] - solver.p0[b, row, lane]
                solver.dp[b, row, lane] = change
                if not discrete:
                    solver.p1[b, row, lane] = solver.p0[b, row, lane] + theta * change


@kernel
def rate_increments(viscosity, moved, lattice, axes, scale, dp):
    """Span coefficients of scale times `moved`."""
    if viscosity is not None:
        tangent_coefficients(moved, lattice, axes, dp)
        for b in range(dp.shape[0]):
            for lane in range(dp.shape[2]):
                dp[b, 0, lane] -= lattice.padding[b, lane]
            for row in range(dp.shape[1]):
                for lane in range(dp.shape[2]):
                    dp[b, row, lane] *= scale


@inlined
def elastic_discrete_force(
    x, terms, work, solver, viscosity, theta, rate, tau, discrete, linearize, out
):
    """out -= discrete gradient between solver.start and x; returns the energy lost to viscosity.

    Leaves the span Jacobian, divided by 2 theta, in solver.jacobian if `linearize`.
    """
    lattice, axes = terms.lattice, terms.axes
    tangent_coefficients(x, lattice, axes, solver.p1)
    span_configurations(solver, theta, discrete)
    if theta != 0.5:
        # d moved / d q1 is `rate`: scaled so that force and Jacobian come out right together
        rate_increments(viscosity, solver.moved, lattice, axes, 2.0 * theta / rate, solver.dp)
    start = solver.p0 if discrete else solver.p1
    seen = 2.0 * theta * tau / rate
    lost = span_discrete_gradient(
        start,
        solver.p1,
        solver.dp,
        lattice,
        terms.stretch,
        terms.bend,
        terms.rest,
        viscosity,
        seen,
        axes,
        solver.loss,
        work.gradient,
    )
    if linearize:
        span_jacobian(
            start,
            solver.p1,
            lattice,
            terms.stretch,
            terms.bend,
            terms.rest,
            viscosity,
            seen,
            axes,
            solver.scratch,
            solver.jacobian,
        )
    scatter_gradient(work.gradient, lattice, axes, -1.0, out)
    return lost


@inlined
def step_force(
    x,
    acceleration,
    terms,
    friction,
    viscosity,
    work,
    solver,
    t,
    tau,
    theta,
    rate,
    g,
    discrete,
    linearize,
):
    """All forces of the step between solver.start and x into work.force; energy lost to damping.

    Damping sees the velocity at theta; tau times it is kept in solver.moved. By Newmark's formulas
    it is rate (q1 - q0) + (1 - rate) tau v0 + g tau^2 a0, which is q1 - q0 for the midpoint family.
    """
    n = terms.lattice.n
    clear(work.force)
    clear(work.load)
    clear(solver.damping_force)
    for d in range(x.shape[0]):
        for i in range(n):
            change = x[d, i] - solver.start[d, i]
            solver.middle[d, i] = solver.start[d, i] + theta * change
            work.before[d, i] = change
            solver.moved[d, i] = (
                rate * change
                + (1.0 - rate) * solver.coast[d, i]
                + g * tau * tau * acceleration[d, i]
            )
    lost = elastic_discrete_force(
        x, terms, work, solver, viscosity, theta, rate, tau, discrete, linearize, work.force
    )
    gravity_and_springs(
        solver.middle, terms.gravity, terms.springs, work.anchors, theta, n, work.force
    )
    load_force(solver.middle, terms.loads, terms.axes, t + theta * tau, work.load)
    friction_force(friction, solver.moved, n, tau, solver.damping_force)
    for d in range(x.shape[0]):
        for i in range(n):
            lost -= solver.damping_force[d, i] * work.before[d, i]
            work.force[d, i] += work.load[d, i] + solver.damping_force[d, i]
    return lost


@kernel
def momentum_residual(terms, acceleration, work, solver, n, dim, a, b, c):
    """Residual of the momentum balance on the spatial rows, interleaved by control point.

    Returns the size of the work against inertia in the step.
    """
    inertia = 0.0
    for d in range(dim):
        row = solver.moved[d]  # free again: what it holds is in the forces by now
        push = solver.damping_force[d]
        for i in range(n):
            row[i] = a * work.before[d, i] - b * solver.start_w[d, i] - c * acceleration[d, i]
            push[i] = 0.0
        multiply(terms.mass.band[d], n, row, 1.0, push)
        for i in range(n):
            inertia += abs(push[i] * work.before[d, i])
            solver.residual[i * dim + d] = (work.force[d, i] - push[i]) * terms.mass.free[d, i]
    return inertia


@inlined
def newton_matrix(terms, friction, solver, n, dim, t, tau, a, theta, rate):
    """Tangent of the momentum balance into solver.band."""
    add_mass(terms.mass.band, n, dim, a, solver.band)
    friction_stiffness(friction, n, dim, tau / rate, solver.band)
    span_matrices(solver.jacobian, terms.lattice, dim, solver.matrices)
    scatter_matrices(solver.matrices, n, dim, 2.0 * theta, solver.band)
    add_springs(terms.springs, n, dim, theta, solver.band)
    add_load_stiffness(solver.middle, terms.loads, terms.axes, t + theta * tau, theta, solver.band)


@kernel
def solve_twist(x, terms, twist, friction, work, solver, n, row, tau):
    """Step of the twist row, which is linear: one symmetric solve.

    Expects the forces of the new shape in work.force and completes row `row` of work.force,
    work.before, solver.middle and the damping. Returns the energy lost in that row beyond what the
    prescribed part already lost.
    """
    if twist is None:
        return 0.0
    a = 2.0 / (tau * tau)
    beta = friction_beta(friction, tau)
    mass = terms.mass.band[row]
    for k in range(4):
        for i in range(n):
            solver.twist_band[k, i] = a * mass[k, i] + (0.5 + beta) * twist.stiffness[k, i]
    add_friction_band(friction, row, n, tau, solver.twist_band)
    factorize_row(
        solver.twist_band, terms.mass.free[row], n, solver.twist_lower, solver.twist_diagonal
    )
    dx = work.before[row]
    force = work.force[row]
    change = solver.residual[:n]
    # dx holds the prescribed part; force holds the loads and the friction of that part.
    multiply(twist.stiffness, n, solver.start[row], -1.0, force)
    for i in range(n):
        change[i] = force[i]
    multiply(twist.stiffness, n, dx, -0.5 - beta, change)
    multiply(mass, n, dx, -a, change)
    multiply(mass, n, solver.start_w[row], 2.0 / tau, change)
    solve_row(solver.twist_lower, solver.twist_diagonal, n, change)
    lost = -friction_loss(friction, dx, n, row, tau)
    for i in range(n):
        x[row, i] += change[i]
        dx[i] += change[i]
    multiply(twist.stiffness, n, dx, -0.5 - beta, force)
    add_friction_row(friction, change, n, row, tau, force)
    return (
        lost
        + friction_loss(friction, dx, n, row, tau)
        + beta * quadratic_form(twist.stiffness, n, dx)
    )


@kernel
def friction_loss(friction, dx, n, row, tau):
    """Energy that the linear damping of one row takes over a step."""
    if friction is not None:
        return quadratic_form(friction.viscous[row], n, dx) / tau
    return 0.0


@kernel
def add_friction_row(friction, dx, n, row, tau, out):
    """out -= C dx / tau of one row."""
    if friction is not None:
        multiply(friction.viscous[row], n, dx, -1.0 / tau, out)


@kernel
def add_friction_band(friction, row, n, tau, band):
    """Add C / tau of one row to its symmetric band."""
    if friction is not None:
        for k in range(4):
            for i in range(n):
                band[k, i] += friction.viscous[row, k, i] / tau


@kernel
def book_step(terms, drive, loads, work, solver, state, lost, n):
    """Add the step's works and losses to the ledger; work.force holds the step's total force."""
    state.ledger[DISSIPATED] += lost
    if loads is not None:
        for d in range(work.load.shape[0]):
            for i in range(n):
                state.ledger[LOAD_WORK] += work.load[d, i] * work.before[d, i]
    if drive is not None:
        state.ledger[DRIVE_WORK] += anchor_work(
            terms.springs, work.anchors, solver.start, state.position, n
        )
        drive_pull(work.force, drive, terms.mass, n, work.pull)
        for d in range(work.force.shape[0]):
            for j in range(4):
                moved = work.before[d, prescribed_column(j, n)]
                state.ledger[DRIVE_WORK] -= work.pull[0, d, j] * moved


@kernel
def free_travel(drive, mass, work, n, out):
    """out = dq_f + shift dq_p of the step on free DOFs, 0 on prescribed ones."""
    for d in range(out.shape[0]):
        for i in range(n):
            out[d, i] = work.before[d, i] * mass.free[d, i]
    if drive is not None:
        for d in range(out.shape[0]):
            for j in range(4):
                column = prescribed_column(j, n)
                moved = work.before[d, column]
                if mass.free[d, column] == 0.0 and moved != 0.0:
                    for i in range(n):
                        out[d, i] += drive.shift[d, j, i] * moved


@kernel
def finish_momentum(w, acceleration, travel, mass, solver, alpha, newmark, n, dim, tau):
    """w1 = 2 travel / tau - w0, or the generalised-alpha update of w and the acceleration."""
    for d in range(w.shape[0]):
        for i in range(n):
            w0 = solver.start_w[d, i]
            a0 = acceleration[d, i]
            if newmark and d < dim:
                a1 = (travel[d, i] / tau - w0 - tau * (0.5 - alpha.beta) * a0) / (tau * alpha.beta)
                w[d, i] = w0 + tau * ((1.0 - alpha.gamma) * a0 + alpha.gamma * a1)
                acceleration[d, i] = a1
            else:
                w[d, i] = (2.0 / tau * travel[d, i] - w0) * mass.free[d, i]
                if alpha.theta != 0.5 and d < dim:
                    acceleration[d, i] = (w[d, i] - w0) / tau


@kernel
def mean_reaction(state, terms, work, solver, n, t0, tau):
    """Forces of the ends over the step, M (v1 - v0) / tau - f on the prescribed rows.

    Undamped waves that the step does not resolve change sign from step to step, and with them the
    reaction at an instant; its mean over a step does not.
    """
    velocities(solver.start_w, terms, t0, solver.coast)
    velocities(state.w, terms, t0 + tau, solver.moved)
    clear(state.reaction)
    for d in range(state.reaction.shape[0]):
        for i in range(n):
            solver.moved[d, i] -= solver.coast[d, i]
        multiply(terms.mass.band[d], n, solver.moved[d], 1.0 / tau, state.reaction[d])
        for i in range(n):
            free = terms.mass.free[d, i]
            state.reaction[d, i] = (state.reaction[d, i] - work.force[d, i]) * (1.0 - free)
    state.ledger[REACTION] = 1.0


@kernel
def absorb_loss(state, terms, work):
    """Book what the method itself dissipated; energy it adds stays an error."""
    ledger = state.ledger
    total = kinetic_energy(state.w, terms.mass, terms.lattice.n)
    for part in potentials(state.position, terms, work):
        total += part
    missing = (
        ledger[ENERGY_START] + ledger[LOAD_WORK] + ledger[DRIVE_WORK] - ledger[DISSIPATED] - total
    )
    if missing > 0.0:
        ledger[DISSIPATED] += missing


@kernel
def correct(x, moved, solver, known, n, dim):
    """Solve for the correction, sharpen it by the `known` ones since the matrix was made, apply it.

    Broyden's method: each correction tells what the matrix misses along it. With z the solution for
    the present residual and s_j the corrections, z += s_(j+1) (s_j.z) / |s_j|^2 for all but the
    last, then s = z / (1 - s_last.z / |s_last|^2) (Kelley 1995, section 7.3).

    Returns |residual . correction| entry by entry and as a whole, the energy defect
    |residual . moved| that the residual would leave in a step of displacement `moved`, and the
    largest entry of the correction.
    """
    size = n * dim
    z = solver.residual
    for r in range(size):
        solver.rhs[r] = z[r]
    substitute(solver.band, size, 4 * dim - 1, z)
    for j in range(known):
        s = solver.corrections[j]
        along = dot(s, z, size) * s[size]
        if j + 1 < known:
            following = solver.corrections[j + 1]
            for r in range(size):
                z[r] += along * following[r]
        elif abs(along) < TRUSTED:
            for r in range(size):
                z[r] /= 1.0 - along
    energy = 0.0
    slope = 0.0
    defect = 0.0
    change = 0.0
    for i in range(n):
        for d in range(dim):
            correction = z[i * dim + d]
            residual = solver.rhs[i * dim + d]
            x[d, i] += correction
            energy += abs(correction * residual)
            slope += correction * residual
            defect += abs((moved[d, i] + correction) * residual)
            change = max(change, abs(correction))
    for r in range(size):
        solver.corrections[known, r] = z[r]
    solver.corrections[known, size] = 1.0 / max(dot(z, z, size), SMALLEST)
    return energy, abs(slope), defect, change


@kernel
def residual_along(solver, last, size):
    """Residual . correction, with the residual after that correction."""
    return dot(solver.residual, solver.corrections[last], size)


@kernel
def shortened(before, after):
    """Share of a correction at which the residual along it would vanish, by the secant."""
    share = before / (before - after)
    return min(max(share, 0.1), 0.5) if share > 0.0 and share < np.inf else 0.1


@kernel
def retreat(x, solver, last, share, n, dim):
    """Take back a share of a correction."""
    step = solver.corrections[last]
    for i in range(n):
        for d in range(dim):
            x[d, i] -= share * step[i * dim + d]


@kernel
def dot(a, b, size):
    """a . b, in four sums that do not wait for each other."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = size - size % 4
    for r in range(0, whole, 4):
        s0 += a[r] * b[r]
        s1 += a[r + 1] * b[r + 1]
        s2 += a[r + 2] * b[r + 2]
        s3 += a[r + 3] * b[r + 3]
    for r in range(whole, size):
        s0 += a[r] * b[r]
    return (s0 + s1) + (s2 + s3)


@kernel
def alternates(x, history, n, dim):
    """Whether the present configuration is nearer to the last but one than to the last.

    Undamped motion that the step is far too long for turns its sign from step to step.
    """
    once, twice = 0.0, 0.0
    for d in range(dim):
        for i in range(n):
            once += (x[d, i] - history[0, d, i]) ** 2
            twice += (x[d, i] - history[1, d, i]) ** 2
    return twice < once


@kernel
def predict(x, w, history, steps_known, n, dim, tau):
    """First guess of the free DOFs: the parabola through the last three configurations, the last
    configuration where the motion alternates, or constant w.

    Shifts the history: history[0] becomes the present configuration, history[1] the one before.
    """
    back = steps_known >= 2 and alternates(x, history, n, dim)
    for d in range(dim):
        for i in range(n):
            now = x[d, i]
            before = history[0, d, i]
            if back:
                x[d, i] = before
            elif steps_known >= 2:
                x[d, i] = 3.0 * (now - before) + history[1, d, i]
            else:
                x[d, i] += tau * w[d, i]
            history[1, d, i] = before
            history[0, d, i] = now


@inlined
def implicit_step(
    state, terms, friction, viscosity, work, solver, t0, tau, discrete, alpha, tolerance
):
    """One step in place; returns (converged, iterations). On failure the state is unchanged.

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
    predict(x, state.w, state.history, state.ledger[HISTORY], n, dim, tau)
    restore_prescribed(x, solver.start, terms.mass.free, n, dim)
    copy_rows(x, n, solver.coast)
    copy_anchors(terms.springs, work.anchors)
    drive_ends(x, terms.drive, terms.springs, terms.mass, terms.axes, n, t0 + tau, work.ends)
    coasting(x, solver.start_w, n, tau, solver.coast)
    scale = max(state.ledger[EXCHANGED], state.ledger[FLOOR])
    reach = largest(x, n, dim)  # size of the configuration, for the iteration's round-off floor
    converged = False
    iterations = 0
    previous = np.inf
    linearize = True
    slope = 0.0  # |residual . correction| before the last correction
    share = 1.0  # of the last correction that is in x
    stalls = 0  # corrections in a row that did not get smaller
    known = 0  # corrections since the matrix was made
    lost = 0.0
    while True:
        lost = step_force(
            x,
            acceleration,
            terms,
            friction,
            viscosity,
            work,
            solver,
            t0,
            tau,
            theta,
            rate,
            g,
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
                retreat(x, solver, known - 1, share - less, n, dim)
                share = less
                linearize = True
                continue
        if linearize or known == MAX_CORRECTIONS:
            newton_matrix(terms, friction, solver, n, dim, t0, tau, a, theta, rate)
            hold_prescribed(terms.mass.free, n, dim, solver.band)
            if not eliminate(solver.band, n * dim, 4 * dim - 1):
                break
            known = 0
        energy, slope, defect, change = correct(x, work.before, solver, known, n, dim)
        known += 1
        if not energy < 1e300:
            break
        stalls = stalls + 1 if energy > STALLED * previous else 0
        # The correction just made leaves about `shrinking` of the defect.
        shrinking = np.sqrt(energy / previous) if share == 1.0 and iterations > 1 else 1.0
        share = 1.0
        converged = (
            min(SAFETY * shrinking, 1.0) * defect <= tolerance * max(scale, inertia)
            or change <= ROUND_OFF * reach
            or (stalls > 1 and change <= NOISE * reach)
        )
        # What driven ends do is booked with the forces after the last correction.
        if converged and not ends_moved(terms.drive, terms.mass, work, n):
            break
        linearize = energy > SLOW * previous and not converged
        previous = energy
    if converged:
        difference(x, solver.start, n, work.before)
        lost += solve_twist(x, terms, terms.twist, friction, work, solver, n, dim, tau)
        free_travel(terms.drive, terms.mass, work, n, solver.moved)
        finish_momentum(
            state.w, acceleration, solver.moved, terms.mass, solver, alpha, newmark, n, dim, tau
        )
        if alpha.theta != 0.5:
            lost = 0.0  # booked by `absorb_loss` with what the method itself dissipates
        book_step(terms, terms.drive, terms.loads, work, solver, state, lost, n)
        mean_reaction(state, terms, work, solver, n, t0, tau)
        state.ledger[HISTORY] += 1.0
    else:
        copy_rows(solver.start, n, x)
        restore_anchors(terms.drive, terms.springs, work.anchors)
        state.ledger[HISTORY] = 0.0
    return converged, iterations


@kernel
def ends_moved(drive, mass, work, n):
    """Whether a prescribed DOF moves in this step."""
    if drive is not None:
        for j in range(4):
            column = prescribed_column(j, n)
            for d in range(work.before.shape[0]):
                if mass.free[d, column] == 0.0 and work.before[d, column] != 0.0:
                    return True
    return False


@kernel
def coasting(x, w, n, tau, coast):
    """Change over the step at constant w: what driven ends did to x since `coast`, + tau w."""
    for d in range(x.shape[0]):
        for i in range(n):
            coast[d, i] = x[d, i] - coast[d, i] + tau * w[d, i]


@kernel
def restore_prescribed(x, start, free, n, dim):
    """Undo a prediction where nothing is free."""
    for d in range(dim):
        for i in range(n):
            if free[d, i] == 0.0:
                x[d, i] = start[d, i]


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
def largest(x, n, dim):
    """Largest coordinate."""
    value = 0.0
    for d in range(dim):
        for i in range(n):
            value = max(value, abs(x[d, i]))
    return value


@inlined
def implicit_step_halving(
    state, terms, friction, viscosity, work, solver, t0, tau, discrete, alpha, tolerance, halvings
):
    """One step, done in smaller pieces where Newton does not converge: (status, iterations)."""
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
            discrete,
            alpha,
            tolerance,
        )
        total += used
        if converged:
            done += piece
            # Grow again only where the larger piece is aligned, so that pieces nest.
            if level > 0 and done % (2 * piece) == 0:
                level -= 1
                state.ledger[HISTORY] = 0.0
        elif level == halvings or total > BUDGET:
            return NOT_CONVERGED, total
        else:
            level += 1
    return OK, total


@entry
def advance_implicit(
    state,
    terms,
    friction,
    viscosity,
    work,
    solver,
    first_step,
    steps,
    tau,
    discrete,
    alpha,
    tolerance,
    halvings,
    recorder,
):
    """Advance by whole steps; returns (status, steps done, Newton iterations).

    `viscosity` is None without stiffness damping, else beta. `halvings` (at most MAX_HALVINGS) is
    how often a step may be halved. The energy account is updated every step.
    """
    iterations = 0
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        status, used = implicit_step_halving(
            state,
            terms,
            friction,
            viscosity,
            work,
            solver,
            t0,
            tau,
            discrete,
            alpha,
            tolerance,
            halvings,
        )
        iterations += used
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
