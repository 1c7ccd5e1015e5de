"""Forces of an implicit step between two configurations, their residual and their matrix."""

from __future__ import annotations

from dlo_sim.kernels.banded import multiply
from dlo_sim.kernels.discrete_gradient import span_discrete_gradient
from dlo_sim.kernels.elastic import scatter_gradient, tangent_coefficients
from dlo_sim.kernels.forces import clear, load_force
from dlo_sim.kernels.friction import friction_force, friction_stiffness
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.matrix import (
    add_load_stiffness,
    add_mass,
    add_springs,
    scatter_matrices,
    span_matrices,
)
from dlo_sim.kernels.tangent import span_jacobian


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


@kernel
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
        terms.span_stretch,
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
            terms.span_stretch,
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


@kernel
def step_force(
    x,
    terms,
    friction,
    viscosity,
    work,
    solver,
    t,
    tau,
    theta,
    rate,
    discrete,
    linearize,
):
    """All forces of the step between solver.start and x into work.force; energy lost to damping.

    The change between the two is in work.before. Damping sees the velocity at theta; tau times it
    is kept in solver.moved. It is rate (q1 - q0) + solver.coast
    (`newton.damping_velocity_offset`), which is q1 - q0 for the midpoint family.
    """
    n = terms.lattice.n
    clear(work.force)
    clear(work.load)
    clear(solver.damping_force)
    for d in range(x.shape[0]):
        for i in range(n):
            change = work.before[d, i]
            solver.middle[d, i] = solver.start[d, i] + theta * change
            solver.moved[d, i] = rate * change + solver.coast[d, i]
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


@kernel
def newton_matrix(terms, friction, solver, n, dim, t, tau, a, theta, rate):
    """Tangent of the momentum balance into solver.band."""
    add_mass(terms.mass.band, n, dim, a, solver.band)
    friction_stiffness(friction, n, dim, tau / rate, solver.band)
    span_matrices(solver.jacobian, terms.lattice, dim, solver.matrices)
    scatter_matrices(solver.matrices, n, dim, 2.0 * theta, solver.band)
    add_springs(terms.springs, n, dim, theta, solver.band)
    add_load_stiffness(solver.middle, terms.loads, terms.axes, t + theta * tau, theta, solver.band)
