"""Parts of a step, each repeated by a compiled loop so that calls from Python cost nothing.

A compiler may do once what a loop repeats. So every pass lets a number of its result, made so small
that it changes nothing, into what the next one reads.
"""

from __future__ import annotations

from dlo_sim.kernels.forces import clear, elastic_force
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.matrix import eliminate, hold_prescribed, substitute
from dlo_sim.kernels.step_forces import elastic_discrete_force, newton_matrix
from dlo_sim.kernels.tangent import span_jacobian

NOTHING = 1e-200
STEP = 2e-3  # [s]


@kernel
def explicit_gradient(x, terms, work):
    """Elastic force of an explicit step at x into work.force."""
    clear(work.force)
    elastic_force(
        x,
        terms.lattice,
        terms.stretch,
        terms.span_stretch,
        terms.bend,
        terms.rest,
        terms.axes,
        work.coefficients,
        work.gradient,
        work.force,
    )


@kernel
def implicit_gradient(x, terms, viscosity, work, solver):
    """Elastic force of an implicit step between solver.p0 and x into work.force."""
    clear(work.force)
    elastic_discrete_force(
        x, terms, work, solver, viscosity, 0.5, 1.0, STEP, True, False, work.force
    )


@kernel
def implicit_jacobian(terms, viscosity, solver):
    """Jacobian of that force per span into solver.jacobian."""
    span_jacobian(
        solver.p0,
        solver.p1,
        terms.lattice,
        terms.stretch,
        terms.span_stretch,
        terms.bend,
        terms.rest,
        viscosity,
        STEP,
        terms.axes,
        solver.scratch,
        solver.jacobian,
    )


@kernel
def assembled_matrix(terms, friction, solver):
    """Newton matrix of a midpoint step from solver.jacobian into solver.band."""
    n, dim = terms.lattice.n, len(terms.axes)
    newton_matrix(terms, friction, solver, n, dim, 0.0, STEP, 2.0 / STEP**2, 0.5, 1.0)
    hold_prescribed(terms.mass.free, n, dim, solver.band)


@kernel
def factors(terms, matrix, solver):
    """LU factors of `matrix` into solver.band; the matrix is copied first."""
    n, dim = terms.lattice.n, len(terms.axes)
    for r in range(n * dim):
        for c in range(matrix.shape[1]):
            solver.band[r, c] = matrix[r, c]
    return eliminate(solver.band, n * dim, 4 * dim - 1)


@kernel
def solution(terms, solver):
    """Solution for solver.rhs with the factors in solver.band into solver.residual."""
    n, dim = terms.lattice.n, len(terms.axes)
    for r in range(n * dim):
        solver.residual[r] = solver.rhs[r]
    substitute(solver.band, n * dim, 4 * dim - 1, solver.residual)


@entry
def repeat_explicit_gradient(x, terms, work, times):
    """`explicit_gradient`, so many times."""
    for _ in range(times):
        explicit_gradient(x, terms, work)
        x[0, 1] += NOTHING * work.force[0, 1]


@entry
def repeat_implicit_gradient(x, terms, viscosity, work, solver, times):
    """`implicit_gradient`, so many times."""
    for _ in range(times):
        implicit_gradient(x, terms, viscosity, work, solver)
        x[0, 1] += NOTHING * work.force[0, 1]


@entry
def repeat_implicit_jacobian(terms, viscosity, solver, times):
    """`implicit_jacobian`, so many times."""
    for _ in range(times):
        implicit_jacobian(terms, viscosity, solver)
        solver.p1[0, 0, 0] += NOTHING * solver.jacobian[0, 0]


@entry
def repeat_assembled_matrix(terms, friction, solver, times):
    """`assembled_matrix`, so many times."""
    for _ in range(times):
        assembled_matrix(terms, friction, solver)
        solver.jacobian[0, 0] += NOTHING * solver.band[2, 0]


@entry
def repeat_factors(terms, matrix, solver, times):
    """`factors`, so many times."""
    for _ in range(times):
        factors(terms, matrix, solver)
        matrix[0, 0] += NOTHING * solver.band[2, 0]


@entry
def repeat_solution(terms, solver, times):
    """`solution`, so many times."""
    for _ in range(times):
        solution(terms, solver)
        solver.rhs[0] += NOTHING * solver.residual[0]
