"""RATTLE: an inextensible cable stepped explicitly, its length kept by constraints.

Stretching is left out and replaced by n - 1 constraints: the mean of g = (|r'|^2 - 1) / 2 over
every knot span is 0, and so is g at u = 0 and u = L. That is one constraint per axial degree of
freedom of a straight cable, so nothing stretches and bending does not lock. With G = dg/dq a step
is
    M (q1 - q0 - tau w0) = tau^2/2 f(q0) - G(q0)^T mu,         g(q1) = 0,
    M (w1 - w_half)      = tau/2 f(q1) - G(q1)^T nu,           G(q1) v1 = 0,
with w_half = (q1 - q0) / tau: second order, symmetric and symplectic on the constraint manifold.
Both lines are one banded saddle-point system in (q, mu), factorised once a step.

`kernels.constraints` holds g, G and that system.

Source: Andersen 1983, J. Comput. Phys. 52; Hairer, Lubich & Wanner 2006, VII.1.4.
"""

from __future__ import annotations

from dlo_sim.kernels.banded import multiply, solve_row
from dlo_sim.kernels.constraints import (
    add_multipliers,
    along_gradient,
    assemble,
    clear_prescribed,
    clear_row,
    prepare,
    slot,
    steepness,
    violation,
)
from dlo_sim.kernels.ends import end_velocities
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import DRIVE_WORK
from dlo_sim.kernels.matrix import eliminate, substitute
from dlo_sim.kernels.newton import largest
from dlo_sim.kernels.observe import (
    begin_sample,
    end_sample,
    prescribed_column,
    update_account,
)
from dlo_sim.kernels.splitting import DIVERGED, OK, decay_flow, drive_ends, evaluate

NOT_CONVERGED = 2
MAX_ITERATIONS = 40
TOLERANCE = 1e-13  # on (|r'|^2 - 1) / 2
ROUND_OFF = 1e-15  # times coordinates over control point distance: what r' is not known better than


@kernel
def mass_times(mass, d, n, x, out, stride, scale):
    """out at the DOF places of row d += scale M_ff x."""
    band = mass.band[d]
    for i in range(n):
        if mass.free[d, i] == 0.0:
            continue
        value = band[0, i] * x[i]
        for k in range(1, 4):
            if i >= k and mass.free[d, i - k] != 0.0:
                value += band[k, i - k] * x[i - k]
            if i + k < n and mass.free[d, i + k] != 0.0:
                value += band[k, i] * x[i + k]
        out[i * stride + d] += scale * value


@kernel
def keep_length(x, guess, start, mass, force, scale, chain, n, dim):
    """Solve M (x - guess) = scale force - G(start)^T mu, g(x) = 0 for x, from the x given.

    Chord iteration with the factors in chain.band (those of `start`). Returns success. The balance
    of momentum is linear: the first correction meets it, and later ones only have lengths to mend.
    The sum of all is left in chain.change: the difference of the coordinates may have no digits.
    """
    stride = dim + 1
    rhs = chain.rhs
    clear_row(rhs)
    clear_row(chain.multipliers)
    for d in range(dim):
        for i in range(n):
            chain.change[d, i] = guess[d, i] - x[d, i]
            rhs[i * stride + d] = scale * force[d, i]
        mass_times(mass, d, n, chain.change[d], rhs, stride, 1.0)
    clear_prescribed(mass, n, dim, rhs)
    for d in range(dim):
        for i in range(n):
            chain.change[d, i] = 0.0
    violation(x, chain, n, dim)
    allowed = TOLERANCE + ROUND_OFF * largest(x, n, dim) * steepness(chain)
    for _ in range(MAX_ITERATIONS):
        substitute(chain.band, rhs.shape[0], 4 * stride, rhs)
        for i in range(n):
            for d in range(dim):
                change = rhs[i * stride + d] * mass.free[d, i]
                x[d, i] += change
                chain.change[d, i] += change
        for j in range(n - 1):
            chain.multipliers[j] += rhs[slot(j, n, dim)]
        clear_row(rhs)
        worst = violation(x, chain, n, dim)
        if worst <= allowed:
            return True
        if not worst < 0.5:
            return False
    return False


@kernel
def fix_velocity(x, w, mass, drive, force, scale, t, axes, chain, n, dim):
    """w += the solution of M dw = scale force - G^T nu with G v = 0, for the factors of x."""
    stride = dim + 1
    rhs = chain.rhs
    clear_row(rhs)
    for d in range(dim):
        for i in range(n):
            rhs[i * stride + d] = scale * force[d, i] * mass.free[d, i]
            chain.change[d, i] = w[d, i]
    driven_velocity(drive, mass, t, n, axes, chain.change)
    for j in range(n - 1):
        rhs[slot(j, n, dim)] = -along_gradient(x, chain.change, chain.gram, j, n, dim)
    substitute(chain.band, rhs.shape[0], 4 * stride, rhs)
    for j in range(n - 1):
        chain.multipliers[j] = rhs[slot(j, n, dim)]
    for i in range(n):
        for d in range(dim):
            w[d, i] += rhs[i * stride + d] * mass.free[d, i]


@kernel
def book_constraints(x, ends, drive, mass, pull, ledger, n, dim):
    """Work that driven ends do against the constraint forces: - (c_p - shift^T c_f) . dq_p."""
    if drive is not None:
        stride = dim + 1
        for d in range(dim):
            for j in range(4):
                column = prescribed_column(j, n)
                moved = x[d, column] - ends[d, j]
                if mass.free[d, column] == 0.0 and moved != 0.0:
                    value = pull[column * stride + d]
                    for i in range(n):
                        value -= drive.shift[d, j, i] * pull[i * stride + d]
                    ledger[DRIVE_WORK] -= value * moved


@kernel
def driven_velocity(drive, mass, t, n, axes, v):
    """Turn w into velocities where ends are driven."""
    if drive is not None:
        end_velocities(drive.motion, t, n, axes, mass.free, v)
        for j in range(4):
            column = prescribed_column(j, n)
            for d in range(len(axes)):
                rate = v[d, column]
                if mass.free[d, column] == 0.0 and rate != 0.0:
                    for i in range(n):
                        v[d, i] -= drive.shift[d, j, i] * rate


@kernel
def accelerate_twist(force, twist, mass, n, row):
    """Turn the twist row of `force` into an acceleration; it has no constraint."""
    if twist is not None:
        solve_row(mass.lower[row], mass.inverse_diagonal[row], n, force[row])


@kernel
def kick_twist(state, force, twist, n, row, dt):
    """w += dt a of the twist row."""
    if twist is not None:
        for i in range(n):
            state.w[row, i] += dt * force[row, i]


@kernel
def rattle_step(state, terms, work, chain, step, tau):
    """One step from a configuration whose matrix is factorised in chain.band; true if solved."""
    n = terms.lattice.n
    dim = len(terms.axes)
    x = state.position
    mass = terms.mass
    for d in range(dim):
        for i in range(n):
            chain.start[d, i] = x[d, i]
    for d in range(dim, x.shape[0]):
        for i in range(n):
            x[d, i] += tau * (state.w[d, i])
    drive_ends(x, terms.drive, terms.springs, mass, terms.axes, n, (step + 1) * tau, work.ends)
    for d in range(dim):
        for i in range(n):
            x[d, i] += tau * state.w[d, i] * mass.free[d, i]
            chain.guess[d, i] = x[d, i]
    good = keep_length(
        x, chain.guess, chain.start, mass, work.force, 0.5 * tau * tau, chain, n, dim
    )
    if good:
        for r in range(chain.pull.shape[0]):
            chain.pull[r] = 0.0
        add_multipliers(chain.start, chain, n, dim, -1.0 / (tau * tau), chain.pull)
        for d in range(dim):
            for i in range(n):
                state.w[d, i] = (state.w[d, i] + chain.change[d, i] / tau) * mass.free[d, i]
        evaluate(state, terms, work, (step + 1) * tau)
        accelerate_twist(work.force, terms.twist, mass, n, dim)
        assemble(x, mass, chain, n, dim)
        good = eliminate(chain.band, chain.band.shape[0], 4 * (dim + 1))
        fix_velocity(
            x,
            state.w,
            mass,
            terms.drive,
            work.force,
            0.5 * tau,
            (step + 1) * tau,
            terms.axes,
            chain,
            n,
            dim,
        )
        add_multipliers(x, chain, n, dim, -1.0 / tau, chain.pull)
        book_constraints(x, work.ends, terms.drive, mass, chain.pull, state.ledger, n, dim)
    return good


@entry
def advance_rattle(state, terms, work, chain, first_step, steps, tau, guard, recorder):
    """Advance by whole steps from time first_step * tau.

    Returns (status, steps done, force evaluations). A step whose constraints cannot be met ends the
    run.
    """
    n = terms.lattice.n
    dim = len(terms.axes)
    evaluations = 0
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        if step == first_step:
            evaluate(state, terms, work, t0)
            accelerate_twist(work.force, terms.twist, terms.mass, n, dim)
            prepare(terms.mass, chain, n, dim)
            assemble(state.position, terms.mass, chain, n, dim)
            if not eliminate(chain.band, chain.band.shape[0], 4 * (dim + 1)):
                return NOT_CONVERGED, 0, 0
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        decay_flow(state, terms.mass, terms.decay, n, 0.5 * tau)
        kick_twist(state, work.force, terms.twist, n, dim, 0.5 * tau)
        if not rattle_step(state, terms, work, chain, step, tau):
            return NOT_CONVERGED, step - first_step, evaluations
        kick_twist(state, work.force, terms.twist, n, dim, 0.5 * tau)
        decay_flow(state, terms.mass, terms.decay, n, 0.5 * tau)
        evaluations += 1
        if (step + 1) % guard == 0:
            _, sane = update_account(state, terms, work)
            if not sane:
                return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(state, terms, work, recorder, t0, tau)
    return OK, steps, evaluations


@kernel
def add_constraint_force(x, v, acceleration, mass, chain, n, dim, force):
    """force += - G^T lambda of the present motion; `acceleration` holds that of prescribed DOFs.

    lambda follows from G a = - |dr'/dt|^2, the second derivative of the constraints.
    """
    if chain is not None:
        stride = dim + 1
        rhs = chain.rhs
        prepare(mass, chain, n, dim)
        assemble(x, mass, chain, n, dim)
        eliminate(chain.band, chain.band.shape[0], 4 * (dim + 1))
        clear_row(rhs)
        for d in range(dim):
            for i in range(n):
                chain.change[d, i] = 0.0
            multiply(mass.band[d], n, acceleration[d], -1.0, chain.change[d])
            for i in range(n):
                rhs[i * stride + d] = (force[d, i] + chain.change[d, i]) * mass.free[d, i]
        for j in range(n - 1):
            value = along_gradient(v, v, chain.gram, j, n, dim)
            value += along_gradient(x, acceleration, chain.gram, j, n, dim)
            rhs[slot(j, n, dim)] = -value
        substitute(chain.band, rhs.shape[0], 4 * (dim + 1), rhs)
        for j in range(n - 1):
            chain.multipliers[j] = rhs[slot(j, n, dim)]
        clear_row(rhs)
        add_multipliers(x, chain, n, dim, -1.0, rhs)
        for d in range(dim):
            for i in range(n):
                force[d, i] += rhs[i * stride + d]


@entry
def project(x, mass, chain, n, dim):
    """Move a configuration to rest length by the least kinetic distance; true if done."""
    prepare(mass, chain, n, dim)
    for _ in range(20):
        for d in range(dim):
            for i in range(n):
                chain.start[d, i] = x[d, i]
                chain.guess[d, i] = x[d, i]
        assemble(x, mass, chain, n, dim)
        if not eliminate(chain.band, chain.band.shape[0], 4 * (dim + 1)):
            return False
        if keep_length(x, chain.guess, chain.start, mass, chain.start, 0.0, chain, n, dim):
            return True
    return False
