"""The twist row of an implicit step: linear, so one symmetric solve."""

from __future__ import annotations

from dlo_sim.kernels.banded import (
    difference_form,
    factorize_row,
    multiply,
    multiply_differences,
    solve_row,
)
from dlo_sim.kernels.forces import clear, load_force
from dlo_sim.kernels.friction import (
    add_friction_band,
    add_friction_row,
    friction_beta,
    friction_loss,
)
from dlo_sim.kernels.jit import kernel

REFINEMENTS = 3  # of the solution for a cable that is free to spin


@kernel
def load_midpoint(loads, axes, work, solver, n, row, t):
    """Replace the moments on the twist row by those of the midpoint at time t, whose method this
    row has.
    """
    if loads is not None:
        for d in range(row):
            for i in range(n):
                solver.middle[d, i] = solver.start[d, i] + 0.5 * work.before[d, i]
        clear(solver.damping_force)
        load_force(solver.middle, loads, axes, t, solver.damping_force)
        for i in range(n):
            moment = solver.damping_force[row, i]
            work.force[row, i] += moment - work.load[row, i]
            work.load[row, i] = moment


@kernel
def solve_twist(x, terms, twist, friction, work, solver, n, row, t0, tau):
    """Step of the twist row from t0, which is linear: one symmetric solve.

    Expects the forces of the new shape in work.force and completes row `row` of work.force,
    work.before, solver.middle and the damping. Returns the energy lost in that row beyond what the
    prescribed part already lost.
    """
    if twist is None:
        return 0.0
    load_midpoint(terms.loads, terms.axes, work, solver, n, row, t0 + 0.5 * tau)
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
    multiply_differences(twist.stiffness, n, solver.start[row], -1.0, force)
    for i in range(n):
        change[i] = force[i]
    multiply_differences(twist.stiffness, n, dx, -0.5 - beta, change)
    multiply(mass, n, dx, -a, change)
    multiply(mass, n, solver.start_w[row], 2.0 / tau, change)
    latest = solver.rhs[:n]  # part of the solution
    rest = solver.moved[row]  # residual of all parts but the latest
    for i in range(n):
        rest[i] = change[i]
    solve_row(solver.twist_lower, solver.twist_diagonal, n, change)
    for i in range(n):
        latest[i] = change[i]
    spins = terms.mass.free[row, 0] != 0.0 and terms.mass.free[row, n - 1] != 0.0
    # The inertia of a free spin is lost beside a large stiffness in the factors, but not in the
    # residual, whose differences do not see a spin: refinements bring it back.
    for _ in range(REFINEMENTS if spins else 0):
        multiply(mass, n, latest, -a, rest)
        multiply_differences(twist.stiffness, n, latest, -0.5 - beta, rest)
        add_friction_row(friction, latest, n, row, tau, rest)
        for i in range(n):
            latest[i] = rest[i]
        solve_row(solver.twist_lower, solver.twist_diagonal, n, latest)
        for i in range(n):
            change[i] += latest[i]
    lost = -friction_loss(friction, dx, n, row, tau)
    for i in range(n):
        x[row, i] += change[i]
        dx[i] += change[i]
    multiply_differences(twist.stiffness, n, dx, -0.5 - beta, force)
    add_friction_row(friction, change, n, row, tau, force)
    return (
        lost
        + friction_loss(friction, dx, n, row, tau)
        + beta * difference_form(twist.stiffness, n, dx)
    )
