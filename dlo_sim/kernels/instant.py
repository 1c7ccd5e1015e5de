"""Forces and stiffness at one instant: for reactions at the ends, frequencies and statics."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.banded import multiply, multiply_differences, solve_rows
from dlo_sim.kernels.discrete_gradient import span_viscous_gradient
from dlo_sim.kernels.elastic import scatter_gradient, tangent_coefficients
from dlo_sim.kernels.ends import one_end_velocity
from dlo_sim.kernels.forces import clear, conservative_force, load_force
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.matrix import add_springs, scatter_matrices, span_matrices
from dlo_sim.kernels.observe import velocities
from dlo_sim.kernels.rattle import add_constraint_force
from dlo_sim.kernels.tangent import span_jacobian

# The terms that `stiffness_band` reads.
STIFFNESS_TERMS = ("lattice", "axes", "stretch", "span_stretch", "bend", "rest", "springs")
RATE_STEP = 1e-6  # [s] of the difference that gives the acceleration of a driven end


@kernel
def add_friction(v, terms, friction, viscosity, work, solver, out):
    """out += damping forces at velocities v; expects solver.p1 for the present configuration."""
    if friction is not None:
        n = terms.lattice.n
        for d in range(v.shape[0]):
            multiply(friction.viscous[d], n, v[d], -1.0, out[d])
        add_viscosity(v, terms, friction, viscosity, work, solver, out)


@kernel
def add_viscosity(v, terms, friction, viscosity, work, solver, out):
    """out += Kelvin-Voigt forces at velocities v."""
    if viscosity is not None:
        n = terms.lattice.n
        tangent_coefficients(v, terms.lattice, terms.axes, solver.dp)
        for b in range(solver.dp.shape[0]):
            for lane in range(solver.dp.shape[2]):
                solver.dp[b, 0, lane] -= terms.lattice.padding[b, lane]
        span_viscous_gradient(
            solver.p1,
            solver.dp,
            terms.lattice,
            terms.stretch,
            terms.span_stretch,
            terms.bend,
            viscosity,
            terms.axes,
            solver.loss,
            work.gradient,
        )
        scatter_gradient(work.gradient, terms.lattice, terms.axes, -1.0, out)
        add_twist_viscosity(v, terms.twist, viscosity, n, len(terms.axes), out)


@kernel
def add_twist_viscosity(v, twist, viscosity, n, row, out):
    """out += Kelvin-Voigt moment of the twist row."""
    if twist is not None:
        multiply_differences(twist.stiffness, n, v[row], -viscosity, out[row])


@kernel
def instant_force(x, v, terms, friction, viscosity, work, solver, t, out):
    """All forces on the control points at one instant, without the ends' reactions."""
    conservative_force(x, terms, work, out)
    load_force(x, terms.loads, terms.axes, t, out)
    tangent_coefficients(x, terms.lattice, terms.axes, solver.p1)
    add_friction(v, terms, friction, viscosity, work, solver, out)


@entry
def stiffness_band(x, terms, viscosity, work, solver):
    """Hessian of the potential energy of the spatial rows into solver.band."""
    n = terms.lattice.n
    dim = len(terms.axes)
    clear(solver.band)
    tangent_coefficients(x, terms.lattice, terms.axes, solver.p1)
    span_jacobian(
        solver.p1,
        solver.p1,
        terms.lattice,
        terms.stretch,
        terms.span_stretch,
        terms.bend,
        terms.rest,
        viscosity,  # without effect at an infinite step; given so that one compiled version serves
        np.inf,
        terms.axes,
        solver.scratch,
        solver.jacobian,
    )
    span_matrices(solver.jacobian, terms.lattice, dim, solver.matrices)
    scatter_matrices(solver.matrices, n, dim, 2.0, solver.band)
    add_springs(terms.springs, n, dim, 1.0, solver.band)


@kernel
def driven_acceleration(drive, free, t, n, axes, out, spare):
    """Accelerations of driven control points into out (both arrays hold zeros before and matter
    after).

    Central differences of the velocities inside the present motion, one-sided at its borders: a
    jump of velocity from one motion to the next is an impulse, not an acceleration to report.
    """
    if drive is not None:
        for e in range(2):
            start, duration = drive.motion[e, 1], drive.motion[e, 2]
            inside = t >= start - RATE_STEP and t <= start + duration + RATE_STEP
            if drive.motion[e, 0] == 0.0 or duration <= 4.0 * RATE_STEP or not inside:
                continue
            low = min(max(t - RATE_STEP, start), start + duration - 2.0 * RATE_STEP)
            high = low + 2.0 * RATE_STEP
            one_end_velocity(drive.motion, e, low, n, axes, free, spare)
            one_end_velocity(drive.motion, e, high, n, axes, free, out)
            outer = 0 if e == 0 else n - 1
            inner = 1 if e == 0 else n - 2
            for d in range(out.shape[0]):
                out[d, outer] = (out[d, outer] - spare[d, outer]) / (high - low)
                out[d, inner] = (out[d, inner] - spare[d, inner]) / (high - low)


@entry
def missing_force(state, terms, friction, viscosity, work, solver, chain, t, out):
    """What M a = f lacks on the prescribed rows: the forces of the ends, shape (rows, width).

    `chain` is that of an inextensible cable, else None. With all other forces known,
    the free DOFs accelerate by M_ff^-1 (f_f - M_fp a_p).
    """
    n = terms.lattice.n
    mass = terms.mass
    velocities(state.w, terms, t, work.v0)
    instant_force(state.position, work.v0, terms, friction, viscosity, work, solver, t, work.force)
    clear(work.v1)
    clear(out)
    driven_acceleration(terms.drive, mass.free, t, n, terms.axes, work.v1, out)
    dim = len(terms.axes)
    add_constraint_force(state.position, work.v0, work.v1, mass, chain, n, dim, work.force)
    for d in range(out.shape[0]):
        for i in range(n):
            out[d, i] = 0.0
        multiply(mass.band[d], n, work.v1[d], -1.0, out[d])
        for i in range(n):
            out[d, i] = (out[d, i] + work.force[d, i]) * mass.free[d, i]
    solve_rows(mass.lower, mass.inverse_diagonal, n, out)
    for d in range(out.shape[0]):
        for i in range(n):
            work.v1[d, i] += out[d, i]
            out[d, i] = 0.0
        multiply(mass.band[d], n, work.v1[d], 1.0, out[d])
        for i in range(n):
            out[d, i] = (out[d, i] - work.force[d, i]) * (1.0 - mass.free[d, i])
