"""Constraints of an inextensible cable, and the linear systems of their projections.

Constraint j is g = (sum_d x_d^T A x_d - 1) / 2 = (|r'|^2 - 1) / 2, at an end or as a mean over a
knot span, quadratic in its four control points with a constant A (CONSTRAINTS in model) whose rows
sum to zero, so g depends on differences of control points only. With G = dg/dq and the held rows B
(`engine.held`) a correction u solves the saddle-point system
    M u + G^T mu + B^T kappa = 0,    G u = - g,    B u = 0.
Without B the matrix is banded (`engine.band`) if each multiplier is ordered after the last control
point of its constraint. The few, dense rows B are eliminated by the Schur complement, HELD_SYSTEM,
from the solutions for unit forces on them, RESPONSE.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, load, shifted, store
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.band import eliminate, substitute, substitute_eight, width_of
from dlo_sim.engine.lines import clear
from dlo_sim.engine.tables import first_of_point, line_of, own_of, point_of
from dlo_sim.methods.explicit_layout import (
    BLANK,
    CONSTRAINT_ENTRIES,
    CONSTRAINTS,
    CORRECTION,
    EIGHT_SIDES,
    HELD_SYSTEM,
    HOLDING_FORCE,
    MULTIPLIERS,
    RESPONSE,
    SADDLE,
)

MAX_ITERATIONS = 40
TOLERANCE = 1e-13  # on (|r'|^2 - 1) / 2
ROUND_OFF = 1e-15  # relative round-off of coordinates, for that of r'
HOPELESS = 0.5  # violation at which the iteration counts as diverged


@part
def unknowns(shape):
    """Number of coordinates and multipliers."""
    return shape[layout.N] * (shape[layout.DIM] + 1) + 1


@part
def slot(shape, j):
    """Index of the multiplier of constraint j, after the last control point of the constraint."""
    dim, n = shape[layout.DIM], shape[layout.N]
    if j == 0:
        return 2 * dim + 1
    if j == n - 2:
        return n * (dim + 1)
    return (j + 2) * (dim + 1) + dim


@part
def first_point(shape, j):
    """First of the four control points of constraint j."""
    return min(max(j - 1, 0), shape[layout.N] - 4)


@part
def gradient(shape, model, x, j, d):
    """dg_j / dq of line d at the four control points of constraint j."""
    at = d * shape[layout.LINE] + layout.MARGIN + first_point(shape, j)
    m = shape[CONSTRAINTS] + CONSTRAINT_ENTRIES * j
    e1, e2, e3 = x[at + 1] - x[at], x[at + 2] - x[at], x[at + 3] - x[at]
    return (
        model[m + 1] * e1 + model[m + 2] * e2 + model[m + 3] * e3,
        model[m + 5] * e1 + model[m + 6] * e2 + model[m + 7] * e3,
        model[m + 9] * e1 + model[m + 10] * e2 + model[m + 11] * e3,
        model[m + 13] * e1 + model[m + 14] * e2 + model[m + 15] * e3,
    )


@part
def along_gradient(shape, model, x, moved, j):
    """G_j moved."""
    total = 0.0
    for d in range(shape[layout.DIM]):
        g = gradient(shape, model, x, j, d)
        at = d * shape[layout.LINE] + layout.MARGIN + first_point(shape, j)
        total += g[1] * (moved[at + 1] - moved[at])
        total += g[2] * (moved[at + 2] - moved[at])
        total += g[3] * (moved[at + 3] - moved[at])
    return total


@part
def prepare(shape, model, scratch):
    """Write the constant entries of the matrix to BLANK: masses, and ones for unused unknowns."""
    dim, n = shape[layout.DIM], shape[layout.N]
    apart, half, width = dim + 1, 4 * dim + 3, width_of(dim + 1)
    blank = shifted(scratch, shape[BLANK])
    for at in range(unknowns(shape) * width):
        blank[at] = 0.0
    for i in range(n):
        for d in range(dim):
            for k in range(max(-3, -i), min(4, n - i)):
                value = model[shape[layout.MASS] + (3 + k) * shape[layout.LINE] + layout.MARGIN + i]
                blank[(i * apart + d) * width + k * apart + half] = value
    for i in (0, 2):
        blank[(i * apart + dim) * width + half] = 1.0


@part
def factorize(shape, model, state, scratch, x):
    """Assemble and factorise the matrix at configuration x, and compute RESPONSE with the present
    directions. Return whether all pivots were usable.
    """
    dim, n = shape[layout.DIM], shape[layout.N]
    apart, half, width = dim + 1, 4 * dim + 3, width_of(dim + 1)
    band, blank = shifted(scratch, shape[SADDLE]), shifted(scratch, shape[BLANK])
    for at in range(0, unknowns(shape) * width, LANES):
        store(band, at, load(blank, at))
    for j in range(n - 1):
        place, first = slot(shape, j), first_point(shape, j)
        for d in range(dim):
            g = gradient(shape, model, x, j, d)
            for k in range(2 if j == n - 2 else 0, 2 if j == 0 else 4):
                r = (first + k) * apart + d
                value = g[0] if k == 0 else (g[1] if k == 1 else (g[2] if k == 2 else g[3]))
                band[r * width + place - r + half] = value
                band[place * width + r - place + half] = value
    good = eliminate(band, unknowns(shape), apart)
    solve_unit_forces(shape, model, state, scratch)
    return good


@part
def coefficient(shape, model, k, directions, at, q, d):
    """Coefficient in B of held row k and coordinate d of its q-th control point."""
    line = line_of(shape, k)
    point = point_of(shape, k)
    weight = model[shape[layout.HELD_WEIGHTS] + (layout.POINT_ROWS * point + q) * LANES]
    if line >= 0:
        return weight if line == d else 0.0
    return weight * directions[at + (layout.DIRECTION_ROWS * k + d) * LANES]


@part
def first_held(shape, k):
    """First of the four control points of held row k."""
    return first_of_point(shape, point_of(shape, k))


@part
def held_value(shape, model, state, k, u):
    """B_k u."""
    dim, line = shape[layout.DIM], line_of(shape, k)
    point = point_of(shape, k)
    own = own_of(shape, point)
    f = 0.0
    if line == dim:
        pass  # the twist has no constraint
    elif own >= 0 and line >= 0:
        f = u[own * (dim + 1) + line]
    elif own >= 0:
        at = shape[layout.DIRECTION] + layout.DIRECTION_ROWS * k * LANES
        for d in range(dim):
            f += state[at + d * LANES] * u[own * (dim + 1) + d]
    else:
        for q in range(4):
            at = (first_held(shape, k) + q) * (dim + 1)
            for d in range(dim):
                f += coefficient(shape, model, k, state, shape[layout.DIRECTION], q, d) * u[at + d]
    return f


@part
def column(shape, k):
    """Offset of the solution for a unit force on held row k."""
    return shape[RESPONSE] + k * (-(-unknowns(shape) // LANES) * LANES)


@part
def solve_unit_forces(shape, model, state, scratch):
    """Write the solutions for a unit force on each held row to RESPONSE, eight at a time."""
    dim, count, directions = shape[layout.DIM], unknowns(shape), shape[layout.DIRECTION]
    x = shifted(scratch, shape[EIGHT_SIDES])
    for start in range(0, shape[layout.HELD], LANES):
        end = min(start + LANES, shape[layout.HELD])
        for at in range(0, count * LANES, LANES):
            store(x, at, 0.0)
        for k in range(start, end):
            for q in range(4):
                for d in range(dim):
                    r = (first_held(shape, k) + q) * (dim + 1) + d
                    value = coefficient(shape, model, k, state, directions, q, d)
                    x[r * LANES + k - start] += value
        substitute_eight(shifted(scratch, shape[SADDLE]), count, dim + 1, x)
        for k in range(start, end):
            to = column(shape, k)
            for r in range(count):
                scratch[to + r] = x[r * LANES + k - start]


@part
def factorize_held(shape, model, state, scratch):
    """Schur complement of the held rows with the present directions, factorised, in HELD_SYSTEM.

    LU without pivoting: it is close to symmetric positive definite.
    """
    held, matrix = shape[layout.HELD], shifted(scratch, shape[HELD_SYSTEM])
    for k in range(held):
        for j in range(held):
            u = shifted(scratch, column(shape, j))
            matrix[held * k + j] = held_value(shape, model, state, k, u)
        if line_of(shape, k) == shape[layout.DIM]:
            matrix[(held + 1) * k] = 1.0
    for r in range(held):
        inverse = 1.0 / matrix[(held + 1) * r]
        for below in range(r + 1, held):
            factor = matrix[held * below + r] * inverse
            matrix[held * below + r] = factor
            for c in range(r + 1, held):
                matrix[held * below + c] -= factor * matrix[held * r + c]


@part
def solve_held_system(shape, scratch, x):
    """Forward and back substitution with the factors of `factorize_held`, in place."""
    held, matrix = shape[layout.HELD], shifted(scratch, shape[HELD_SYSTEM])
    for r in range(held):
        for c in range(r):
            x[r] -= matrix[held * r + c] * x[c]
    for r in range(held - 1, -1, -1):
        for c in range(r + 1, held):
            x[r] -= matrix[held * r + c] * x[c]
        x[r] /= matrix[(held + 1) * r]


@part
def solve(shape, model, state, scratch, force_scale):
    """Solve for the right-hand side in MULTIPLIERS, in place, with B u = 0.

    HOLDING_FORCE += force_scale times the multipliers of the held rows.
    """
    dim, held, count = shape[layout.DIM], shape[layout.HELD], unknowns(shape)
    u, forces = shifted(scratch, shape[MULTIPLIERS]), shifted(scratch, shape[layout.RATES])
    substitute(shifted(scratch, shape[SADDLE]), count, dim + 1, u)
    for k in range(held):
        forces[k] = held_value(shape, model, state, k, u)
    solve_held_system(shape, scratch, forces)
    for k in range(held):
        x = shifted(scratch, column(shape, k))
        for at in range(0, count, LANES):
            store(u, at, load(u, at) - forces[k] * load(x, at))
        scratch[shape[HOLDING_FORCE] + k * LANES] += force_scale * forces[k]
    for k in range(held):
        line = line_of(shape, k)
        own = own_of(shape, point_of(shape, k))
        if 0 <= line < dim and own >= 0:
            u[own * (dim + 1) + line] = 0.0


@part
def clear_multipliers(shape, scratch):
    """MULTIPLIERS = 0."""
    for r in range(unknowns(shape)):
        scratch[shape[MULTIPLIERS] + r] = 0.0


@part
def add_solution(shape, scratch, scale, out):
    """out += scale times the coordinates of the solution."""
    dim = shape[layout.DIM]
    for i in range(shape[layout.N]):
        for d in range(dim):
            u = scratch[shape[MULTIPLIERS] + i * (dim + 1) + d]
            out[d * shape[layout.LINE] + layout.MARGIN + i] += scale * u


@part
def violation(shape, model, scratch, x):
    """Write -g to the right-hand side of the multipliers; return the largest |g|."""
    worst = 0.0
    clear_multipliers(shape, scratch)
    for j in range(shape[layout.N] - 1):
        value = 0.5 * (along_gradient(shape, model, x, x, j) - 1.0)
        scratch[shape[MULTIPLIERS] + slot(shape, j)] = -value
        worst = max(worst, abs(value))
    return worst


@part
def tolerance(shape, model, x):
    """Tolerance on |g|: TOLERANCE plus the round-off of g at these coordinates."""
    reach = 0.0
    for d in range(shape[layout.DIM]):
        for i in range(shape[layout.N]):
            reach = max(reach, abs(x[d * shape[layout.LINE] + layout.MARGIN + i]))
    return TOLERANCE + ROUND_OFF * reach * np.sqrt(model[shape[CONSTRAINTS]])


@part
def keep_length(shape, model, state, scratch, x, force_scale):
    """Project x onto g = 0 by chord iteration with the last factors; return whether it converged.

    CORRECTION gets the sum of all corrections, which the difference of x would lose to round-off.
    """
    correction = shifted(scratch, shape[CORRECTION])
    clear(shape, correction)
    allowed = tolerance(shape, model, x)
    worst = violation(shape, model, scratch, x)
    for _ in range(MAX_ITERATIONS):
        if worst <= allowed:
            return True
        solve(shape, model, state, scratch, force_scale)
        add_solution(shape, scratch, 1.0, x)
        add_solution(shape, scratch, 1.0, correction)
        worst = violation(shape, model, scratch, x)
        if not worst < HOPELESS:
            return False
    return worst <= allowed
