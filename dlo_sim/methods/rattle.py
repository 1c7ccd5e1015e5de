"""RATTLE: explicit steps of an inextensible cable with length constraints.

Stretching is replaced by n - 1 length constraints: the mean of g = (|r'|^2 - 1) / 2 over every knot
span is 0, and so is g at u = 0 and u = L. That is one constraint per axial degree of freedom of a
straight cable, so that it is inextensible without locking in bending. A step is one of velocity
Verlet (`methods.splitting`, constraint rows of grasps included) with two corrections, of the
positions after the drift and of the velocities at the end,
    M u = - G(q0)^T mu - B0^T kappa,    g(q1 + u) = 0,    B1 u = 0;    q1 += u,  w += u / tau
    M u = - G(q1)^T nu - B1^T kappa,    G(q1) (v1 + u) = 0,    B1 u = 0;    w1 += u
with G = dg/dq and the constraint rows B of the grasps (`engine.rows`): second order, symmetric and
symplectic on the constraint manifold.

Both corrections solve the saddle-point system
    M u + G^T mu + B^T kappa = 0,    G u = - g,    B u = 0.
Length constraint j is g = (sum_d x_d^T A x_d - 1) / 2, quadratic in its four control points with a
constant A (`length_gram`) whose rows sum to zero, so g depends on differences of control points
only. Without B the matrix is banded (`engine.band`) if each multiplier is ordered after the last
control point of its constraint: coordinate d of control point i is unknown i (dim + 1) + d, and the
multipliers are at `slot`. The few, dense rows B are eliminated by the Schur complement,
`work.row_system`, from the solutions for unit forces on them, `work.response`.

Source: Andersen 1983, J. Comput. Phys. 52; Hairer, Lubich & Wanner 2006, VII.1.4.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid, load
from dlo_sim.compiling.lanes import LANES, lane
from dlo_sim.compiling.pieces import ARRAY_2D, part, piece
from dlo_sim.engine.arrays import CABLE, CONSTRAINED, MARGIN, METHOD, PADDING, cable_at
from dlo_sim.engine.band import eliminate, substitute, substitute_eight
from dlo_sim.engine.lines import add, clear, copy, mass_of
from dlo_sim.engine.rows import add_velocity_of_held, grasps_move
from dlo_sim.methods.splitting import decay_flow, drift
from dlo_sim.methods.works import evaluate

MAX_ITERATIONS = 40
MOST_PROJECTIONS = 20
TOLERANCE = 1e-13  # on (|r'|^2 - 1) / 2
ROUND_OFF = 1e-15  # relative round-off of coordinates, for that of r'
HOPELESS = 0.5  # violation at which the iteration counts as diverged


# -- length constraints ---------------------------------------------------------------------------


@part
def first_point(cable, j):
    """First of the four control points of length constraint j."""
    return min(max(j - 1, 0), cable.n - 4)


@part
def length_gradient(cable, x, j, d):
    """dg_j / dq of line d at the four control points of length constraint j."""
    at, m = MARGIN + first_point(cable, j), cable.length_gram[j]
    e1 = x[d, at + 1] - x[d, at]
    e2 = x[d, at + 2] - x[d, at]
    e3 = x[d, at + 3] - x[d, at]
    return (
        m[1] * e1 + m[2] * e2 + m[3] * e3,
        m[5] * e1 + m[6] * e2 + m[7] * e3,
        m[9] * e1 + m[10] * e2 + m[11] * e3,
        m[13] * e1 + m[14] * e2 + m[15] * e3,
    )


@part
def along_gradient(cable, x, moved, j):
    """G_j moved, with G_j at x."""
    sum_, at = 0.0, MARGIN + first_point(cable, j)
    for d in range(cable.dim):
        g = length_gradient(cable, x, j, d)
        sum_ += g[1] * (moved[d, at + 1] - moved[d, at])
        sum_ += g[2] * (moved[d, at + 2] - moved[d, at])
        sum_ += g[3] * (moved[d, at + 3] - moved[d, at])
    return sum_


@part
def violation(cable, x):
    """Write -g to the right-hand side (0 without multiplier), and return the largest |g|."""
    worst = 0.0
    clear_side(cable)
    for j in range(cable.n - 1):
        g = 0.5 * (along_gradient(cable, x, x, j) - 1.0)
        cable.work.saddle_side[PADDING + slot(cable, j)] = -g
        worst = max(worst, abs(g))
    return worst


@part
def tolerance(cable, x):
    """Tolerance on |g|: TOLERANCE plus the round-off of g at these coordinates."""
    reach = 0.0
    for d in range(cable.dim):
        for i in range(cable.n):
            reach = max(reach, abs(x[d, MARGIN + i]))
    return TOLERANCE + ROUND_OFF * reach * np.sqrt(cable.length_gram[0, 0])


# -- saddle-point system --------------------------------------------------------------------------


@part
def unknowns(cable):
    """Number of coordinates and multipliers."""
    return cable.n * (cable.dim + 1) + 1


@part
def slot(cable, j):
    """Index of the multiplier of length constraint j, after the last control point of it."""
    dim, n = cable.dim, cable.n
    if j == 0:
        return 2 * dim + 1
    if j == n - 2:
        return n * (dim + 1)
    return (j + 2) * (dim + 1) + dim


@part
def prepare(cable):
    """Write the constant entries of the matrix: masses, and ones for unused unknowns."""
    blank, mass, n, apart = cable.work.blank, mass_of(cable, 0), cable.n, cable.dim + 1
    half = 4 * apart - 1
    clear(blank)
    for i in range(n):
        for d in range(cable.dim):
            for k in range(max(-3, -i), min(4, n - i)):
                blank[i * apart + d, k * apart + half] = mass[3 + k, MARGIN + i]
    for i in (0, 2):
        blank[i * apart + cable.dim, half] = 1.0


@part
def factorize(cable, x):
    """Assemble the band matrix at configuration x and factorise it, and solve for unit forces on
    the constraint rows with their present directions. Return whether all pivots were usable.
    """
    n, apart, band = cable.n, cable.dim + 1, cable.work.saddle
    half = 4 * apart - 1
    copy(cable.work.blank, band)
    for j in range(n - 1):
        place, first = slot(cable, j), first_point(cable, j)
        for d in range(cable.dim):
            g = length_gradient(cable, x, j, d)
            for k in range(2 if j == n - 2 else 0, 2 if j == 0 else 4):
                r = (first + k) * apart + d
                value = g[0] if k == 0 else (g[1] if k == 1 else (g[2] if k == 2 else g[3]))
                band[r, place - r + half] = value
                band[place, r - place + half] = value
    good = eliminate(band, unknowns(cable), apart)
    solve_unit_forces(cable)
    return good


@part
def row_coefficient(cable, k, q, d):
    """Coefficient in B of constraint row k and coordinate d of its q-th control point."""
    line, weight = cable.rows.line[k], cable.points.weights[cable.rows.point[k], q]
    if line >= 0:
        return weight if line == d else 0.0
    return weight * cable.state.direction[k, d]


@part
def row_first(cable, k):
    """First of the four control points of constraint row k."""
    return cable.points.first[cable.rows.point[k]]


@part
def along_row(cable, k, u, begin):
    """B_k u, for a vector u of all unknowns that starts at index `begin`."""
    dim, line, own = cable.dim, cable.rows.line[k], cable.points.own[cable.rows.point[k]]
    f = 0.0
    if line == dim:
        pass  # the length constraints do not act on the twist
    elif own >= 0 and line >= 0:
        f = u[begin + own * (dim + 1) + line]
    elif own >= 0:
        for d in range(dim):
            f += cable.state.direction[k, d] * u[begin + own * (dim + 1) + d]
    else:
        for q in range(4):
            at = begin + (row_first(cable, k) + q) * (dim + 1)
            for d in range(dim):
                f += row_coefficient(cable, k, q, d) * u[at + d]
    return f


@part
def solve_unit_forces(cable):
    """Write the solutions for a unit force on each constraint row to `work.response`, eight at a
    time.
    """
    dim, work, count, rows = cable.dim, cable.work, unknowns(cable), cable.rows.count
    response, side = work.response, work.saddle_side
    clear_side(cable)
    for start in range(0, rows, LANES):
        end = min(start + LANES, rows)
        for k in range(start, end):
            for r in range(count):
                response[k, r] = 0.0
            for q in range(4):
                for d in range(dim):
                    r = (row_first(cable, k) + q) * (dim + 1) + d
                    response[k, r] += row_coefficient(cable, k, q, d)
        for r in range(count):
            for k in range(start, end):
                side[PADDING + k - start] = response[k, r]
            work.sides[r] = load(side, PADDING)
        substitute_eight(work.saddle, count, dim + 1, work.sides)
        for r in range(count):
            for k in range(start, end):
                response[k, r] = lane(work.sides[r], k - start)


@part
def factorize_rows(cable):
    """LU factors, in `work.row_system`, of the Schur complement of the constraint rows with their
    present directions. Without pivoting: it is close to symmetric positive definite.
    """
    rows, matrix = cable.rows.count, cable.work.row_system
    for k in range(rows):
        for j in range(rows):
            matrix[k, j] = along_row(cable, k, cable.work.response[j], 0)
        if cable.rows.line[k] == cable.dim:
            matrix[k, k] = 1.0
    for r in range(rows):
        inverse = 1.0 / matrix[r, r]
        for below in range(r + 1, rows):
            factor = matrix[below, r] * inverse
            matrix[below, r] = factor
            for c in range(r + 1, rows):
                matrix[below, c] -= factor * matrix[r, c]


@part
def solve_rows(cable, x):
    """Forward and back substitution with the factors of `factorize_rows`, in place."""
    rows, matrix = cable.rows.count, cable.work.row_system
    for r in range(rows):
        for c in range(r):
            x[r] -= matrix[r, c] * x[c]
    for r in range(rows - 1, -1, -1):
        for c in range(r + 1, rows):
            x[r] -= matrix[r, c] * x[c]
        x[r] /= matrix[r, r]


@part
def solve(cable, force_scale):
    """Solve for the right-hand side `work.saddle_side`, in place, with B u = 0.

    `work.holding_force` += force_scale times the multipliers of the constraint rows.
    """
    work, dim, count, rows = cable.work, cable.dim, unknowns(cable), cable.rows.count
    u, forces = work.saddle_side, work.row_factor
    substitute(work.saddle, count, dim + 1, u)
    for k in range(rows):
        forces[k] = along_row(cable, k, u, PADDING)
    solve_rows(cable, forces)
    for k in range(rows):
        for r in range(count):
            u[PADDING + r] -= forces[k] * work.response[k, r]
        work.holding_force[k] += force_scale * forces[k]
    for k in range(rows):
        line, own = cable.rows.line[k], cable.points.own[cable.rows.point[k]]
        if 0 <= line < dim and own >= 0:
            u[PADDING + own * (dim + 1) + line] = 0.0


@part
def clear_side(cable):
    """`work.saddle_side` = 0."""
    for r in range(len(cable.work.saddle_side)):
        cable.work.saddle_side[r] = 0.0


@part
def add_solution(cable, scale, out):
    """out += scale times the coordinates of the solution."""
    for i in range(cable.n):
        for d in range(cable.dim):
            u = cable.work.saddle_side[PADDING + i * (cable.dim + 1) + d]
            out[d, MARGIN + i] += scale * u


@part
def factorize_present(cable):
    """Factorise all systems at the present configuration; return whether all pivots were usable."""
    good = factorize(cable, cable.state.x)
    factorize_rows(cable)
    return good


# -- corrections ----------------------------------------------------------------------------------


@part
def keep_length(cable, x, force_scale):
    """Project x onto g = 0 by chord iteration with the last factors; return whether it converged.

    `work.correction` gets the sum of all corrections, which the difference of x would lose to
    round-off.
    """
    correction, allowed = cable.work.correction, tolerance(cable, x)
    clear(correction)
    worst = violation(cable, x)
    for _ in range(MAX_ITERATIONS):
        if worst <= allowed:
            return True
        solve(cable, force_scale)
        add_solution(cable, 1.0, x)
        add_solution(cable, 1.0, correction)
        worst = violation(cable, x)
        if not worst < HOPELESS:
            return False
    return worst <= allowed


@part
def project_velocity(cable, t, tau):
    """Project w onto G v = 0 with the matrix of the present configuration."""
    state, work, v = cable.state, cable.work, cable.work.mean_rate
    copy(state.w, v)
    if grasps_move(cable):
        add_velocity_of_held(cable, state.x, t, v)
        for k in range(cable.rows.count):
            state.rates_before[k] = work.rates[k]
    clear_side(cable)
    for j in range(cable.n - 1):
        work.saddle_side[PADDING + slot(cable, j)] = -along_gradient(cable, state.x, v, j)
    solve(cable, 1.0 / tau)
    add_solution(cable, 1.0, state.w)


@part
def add_impulse_work(cable, tau):
    """Add the work of the grasps against the constraint forces of one correction,
    `work.holding_force` over tau, to the energy balance, and reset these.

    An impulse does work on the mean of the velocities before and after it: `rates_before` and the
    mean rate over the step. This is exact also if the cable is set in motion by a velocity jump.
    """
    state, work, done = cable.state, cable.work, 0.0
    for k in range(cable.rows.count):
        way = work.step_moved[k] + tau * state.rates_before[k]
        done -= 0.5 * work.holding_force[k] * way
    state.balance.drive_work += done
    clear_holding_force(cable)


@part
def clear_holding_force(cable):
    """`work.holding_force` = 0."""
    for k in range(cable.rows.count):
        cable.work.holding_force[k] = 0.0


# -- steps ----------------------------------------------------------------------------------------


@part
def verlet_step(cable, t0, tau):
    """One step from a configuration with known matrix and forces; return whether it was solved."""
    state, work = cable.state, cable.work
    add(0.5 * tau, work.force, state.w)
    moves = grasps_move(cable)
    drift(cable, t0 + tau, tau)
    for k in range(cable.rows.count):
        work.step_moved[k] = state.moved[k]  # `evaluate` resets it when it counts the work
    clear_holding_force(cable)
    if moves:
        factorize_rows(cable)
    if not keep_length(cable, state.x, 1.0 / (tau * tau)):
        return False
    if moves:
        add_impulse_work(cable, tau)
    add(1.0 / tau, work.correction, state.w)
    evaluate(cable, t0 + tau)
    add(0.5 * tau, work.force, state.w)
    good = factorize_present(cable)
    project_velocity(cable, t0 + tau, tau)
    if moves:
        add_impulse_work(cable, tau)
    return good


@piece(boolean, METHOD, CABLE, int64, float64, terms=CONSTRAINED)
def rattle_step(_, cable, step, tau):
    """Step number `step`, of length tau; returns whether its constraints could be satisfied."""
    t0, results = step * tau, cable.work.results
    if results.forces_known == 0.0:
        evaluate(cable, t0)
    if results.matrix_known == 0.0:
        prepare(cable)
        if not factorize_present(cable):
            return False
    decay_flow(cable, 0.5 * tau)
    if not verlet_step(cable, t0, tau):
        return False
    decay_flow(cable, 0.5 * tau)
    results.evaluations += 1.0
    results.forces_known = results.matrix_known = 1.0
    return True


@piece(boolean, int64)
def to_rest_length(address):
    """Project the configuration onto g = 0, in the metric of the mass matrix; return success."""
    cable = cable_at(address)
    prepare(cable)
    for _ in range(MOST_PROJECTIONS):
        if not factorize_present(cable):
            return False
        if keep_length(cable, cable.state.x, 0.0):
            return True
    return False


@piece(void, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D)
def add_constraint_force(address, v, acceleration, force):
    """force += - G^T lambda, the constraint forces of the present motion; arguments are lines.

    `acceleration`: that without length constraints. lambda follows from the second time derivative
    of the constraints, G a = - |dr'/dt|^2 (averaged like g).
    """
    cable, v, acceleration, force = cable_at(address), grid(v), grid(acceleration), grid(force)
    x, side = cable.state.x, cable.work.saddle_side
    prepare(cable)
    factorize_present(cable)
    clear_side(cable)
    for j in range(cable.n - 1):
        value = along_gradient(cable, v, v, j) + along_gradient(cable, x, acceleration, j)
        side[PADDING + slot(cable, j)] = -value
    solve(cable, 0.0)
    for j in range(cable.n - 1):
        multiplier, at = side[PADDING + slot(cable, j)], MARGIN + first_point(cable, j)
        for d in range(cable.dim):
            g = length_gradient(cable, x, j, d)
            force[d, at] -= g[0] * multiplier
            force[d, at + 1] -= g[1] * multiplier
            force[d, at + 2] -= g[2] * multiplier
            force[d, at + 3] -= g[3] * multiplier
