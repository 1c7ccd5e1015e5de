"""The twist line of an implicit step, by the midpoint rule.

Its equations are linear, one symmetric solve, unless there is natural curvature in the material
frame, for which Newton's method is used. In the Bishop frame twist and shape are coupled:
`step_twist` solves for the twist at every iterate of the shape and so eliminates it.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, shifted, store
from dlo_sim.compiling.pieces import NO, NUMBERS, REAL, TABLE, TRUTH, YES, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.bishop import push_by_twist, turn_by_shape
from dlo_sim.engine.held import row_value
from dlo_sim.engine.lines import (
    add_differences,
    add_product,
    clear,
    difference_form,
    form,
    gathered,
    mass_of,
)
from dlo_sim.engine.loads import load_force
from dlo_sim.engine.natural_curvature import add_natural_stiffness, natural_force
from dlo_sim.engine.springs import add_roll_change, add_roll_stiffness, roll_loss, spring_force
from dlo_sim.engine.tables import line_of, own_of, point_of
from dlo_sim.methods.implicit_layout import (
    CHANGE,
    DAMPING_FORCE,
    FORCE_OF_HELD,
    INERTIA,
    MIDDLE,
    OLD_DIRECTION,
    SEEN,
    START,
    START_V,
    TWIST_HELD,
    TWIST_LATEST,
    TWIST_MATRIX,
    TWIST_OWN,
    TWIST_REST,
    TWIST_SUM,
)

REFINEMENTS = 3  # iterative refinements for a cable that is free to spin
MOST_CORRECTIONS = 8  # Newton corrections with natural curvature in the material frame
WITHIN = REAL, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, REAL, REAL, TRUTH, TRUTH
END = REAL, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, REAL, REAL
# Corrections end below TURNED, relative to 1 rad plus the angle, or below SHRUNK times the first
# correction for an iterate of the shape: while the shape changes the twist need not be exact.
TURNED, SHRUNK = 1e-8, 0.1


@part
def damping_share(shape, model, tau):
    """Internal damping of the twist, beta / tau. Without inertia, additional damping of half a step
    turns the midpoint moment into that at the end of the step, where the twist is in equilibrium.
    """
    share = 0.5 if shape[layout.TERMS] & layout.STATIC_TWIST else 0.0
    if shape[layout.TERMS] & layout.DAMPED:
        share += model[shape[layout.BETA] + 2 * LANES] / tau
    return share


@part
def mark_held(shape, held):
    """held = 1 at control points with prescribed twist, else 0."""
    n = shape[layout.N]
    for i in range(n):
        held[i] = 0.0
    for k in range(shape[layout.HELD]):
        if line_of(shape, k) == shape[layout.DIM]:
            point = point_of(shape, k)
            held[own_of(shape, point)] = 1.0


@part
def factorize(shape, is_held, matrix):
    """LDL^T factorisation in place of a matrix given by 4 lower diagonals of n entries each: 1 / D
    replaces the diagonal, three diagonals of L follow. The inverse pivots of held unknowns are 0,
    so that `solve` returns 0 for them.
    """
    n = shape[layout.N]
    inverse1 = inverse2 = inverse3 = 0.0  # 1 / D of the rows before
    last1 = last2 = before1 = 0.0  # L of the row before, and of the one before that
    for i in range(n):
        free = 1.0 - is_held[i]
        w3 = free * matrix[3 * n + i - 3] if i > 2 else 0.0  # L D
        w2 = free * matrix[2 * n + i - 2] - w3 * before1 if i > 1 else 0.0
        w1 = free * matrix[n + i - 1] - w3 * last2 - w2 * last1 if i > 0 else 0.0
        l3, l2, l1 = w3 * inverse3, w2 * inverse2, w1 * inverse1
        inverse3, inverse2 = inverse2, inverse1
        inverse1 = free / (matrix[i] - w3 * l3 - w2 * l2 - w1 * l1)
        matrix[i], matrix[4 * n + i] = inverse1, l1
        matrix[5 * n + i], matrix[6 * n + i] = l2, l3
        before1, last1, last2 = last1, l1, l2


@part
def solve(shape, matrix, x):
    """Forward and back substitution in place; held unknowns become 0."""
    n = shape[layout.N]
    a = b = c = 0.0
    for i in range(n):
        d = x[i] - (matrix[6 * n + i] * a + matrix[5 * n + i] * b) - matrix[4 * n + i] * c
        x[i] = d
        a, b, c = b, c, d
    a = b = c = 0.0
    for i in range(n - 1, -1, -1):
        d = matrix[i] * x[i] - c
        x[i] = d
        c, b, a = b + matrix[4 * n + i] * d, a + matrix[5 * n + i] * d, matrix[6 * n + i] * d


@part
def system(shape, model, tau, beta, matrix):
    """2 / tau^2 M + (1/2 + beta) K + C / tau + roll springs, as lower diagonals."""
    n, width = shape[layout.N], shape[layout.LINE]
    damped = 1.0 / tau if shape[layout.TERMS] & layout.DAMPED else 0.0
    for k in range(4):
        for i in range(n - k):
            at = (3 + k) * width + layout.MARGIN + i
            value = 2.0 / (tau * tau) * model[shape[layout.MASS] + 7 * width + at]
            value += (0.5 + beta) * model[shape[layout.TWIST] + at]
            matrix[k * n + i] = value + damped * model[shape[layout.VISCOUS] + 7 * width + at]
    add_roll_stiffness(shape, model, matrix)


@part
def midpoint_moments(shape, model, inputs, scratch, t0, tau):
    """Replace the applied moments on the twist in FORCE and NEW_LOAD by those at the midpoint."""
    at, width = shape[layout.DIM] * shape[layout.LINE], shape[layout.LINE]
    force, load = shifted(scratch, shape[layout.FORCE]), shifted(scratch, shape[layout.NEW_LOAD])
    start, change = shifted(scratch, shape[START]), shifted(scratch, shape[CHANGE])
    middle, moment = shifted(scratch, shape[MIDDLE]), shifted(scratch, shape[DAMPING_FORCE])
    for k in range(at):
        middle[k] = start[k] + 0.5 * change[k]
    clear(shape, moment)
    load_force(shape, model, inputs, scratch, middle, t0 + 0.5 * tau, moment)
    for k in range(at, at + width):
        force[k] += moment[k] - load[k]
        load[k] = moment[k]


@part
def correct_twist(shape, model, state, scratch, begin, end, x, tau, beta, spins, anew):
    """One Newton correction of the twist line of x and CHANGE for the residual
        f - K (theta0 + (1/2 + beta) d) - M (2 / tau^2 d - 2 / tau v0),   d = CHANGE,
    where f is FORCE: loads, twist of the frame, and damping and springs for the previous d. Adds
    the remaining moments to FORCE, and the change of damping and springs to TWIST_OWN. Returns the
    largest entry of the correction relative to 1 rad plus the angle.
    """
    own = shifted(scratch, shape[TWIST_OWN])
    line, width = shape[layout.DIM], shape[layout.LINE]
    at, natural = line * width, shape[layout.TERMS] & layout.MATERIAL != 0
    force, start = shifted(scratch, shape[layout.FORCE]), shifted(scratch, shape[START])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    mass, viscous, a = (
        shape[layout.MASS] + 7 * width,
        shape[layout.VISCOUS] + 7 * width,
        2.0 / (tau * tau),
    )
    matrix = shifted(scratch, shape[TWIST_MATRIX])
    if anew or natural:
        system(shape, model, tau, beta, matrix)
        if natural:
            natural_force(shape, model, state, begin, end, YES, NO, force)
            add_natural_stiffness(shape, model, state, begin, end, matrix)
        factorize(shape, shifted(scratch, shape[TWIST_HELD]), matrix)
    latest, rest = shifted(scratch, shape[TWIST_LATEST]), shifted(scratch, shape[TWIST_REST])
    sum_ = shifted(scratch, shape[TWIST_SUM])
    add_differences(shape, model, shape[layout.TWIST], line, -1.0, start, force)
    for k in range(at, at + width):
        rest[k] = force[k]
        sum_[k] = 0.0
    add_differences(shape, model, shape[layout.TWIST], line, -0.5 - beta, change, rest)
    add_product(shape, model, mass, line, -a, change, rest)
    add_product(shape, model, mass, line, 2.0 / tau, speed, rest)
    # In the factors the inertia of a rigid spin is lost to round-off beside a large stiffness. The
    # residual is exact, as its differences vanish for a spin: iterative refinement corrects it.
    for _ in range(1 + REFINEMENTS if spins else 1):
        for k in range(at, at + width):
            latest[k] = rest[k]
        solve(shape, matrix, shifted(latest, at + layout.MARGIN))
        for k in range(at, at + width):
            sum_[k] += latest[k]
        add_product(shape, model, mass, line, -a, latest, rest)
        add_differences(shape, model, shape[layout.TWIST], line, -0.5 - beta, latest, rest)
        add_roll_change(shape, model, latest, rest)
        if shape[layout.TERMS] & layout.DAMPED:
            add_product(shape, model, viscous, line, -1.0 / tau, latest, rest)
    moved = 0.0
    for k in range(at, at + width):
        x[k] += sum_[k]
        change[k] += sum_[k]
        moved = max(moved, abs(sum_[k]) / (1.0 + abs(x[k])))
    add_differences(shape, model, shape[layout.TWIST], line, -0.5 - beta, change, force)
    add_roll_change(shape, model, sum_, force)
    add_roll_change(shape, model, sum_, own)
    if shape[layout.TERMS] & layout.DAMPED:
        add_product(shape, model, viscous, line, -1.0 / tau, sum_, force)
        add_product(shape, model, viscous, line, -1.0 / tau, sum_, own)
    return moved


@part
def solve_twist(shape, model, inputs, state, scratch, begin, end, x, t0, tau, anew):
    """Solve for the twist line at the end of the step from t0. Returns the energy [J] dissipated in
    it, less that of the external damping in the initial CHANGE, which `step_force` counted.

    On entry CHANGE has the prescribed part and FORCE the forces at the new shape; the twist lines
    of x, CHANGE, FORCE and NEW_LOAD are completed. `begin`, `end`: configurations of the discrete
    gradient of the natural curvature. `anew`: for the first time in this step; without natural
    curvature the matrix stays that of the first time.
    """
    line, width = shape[layout.DIM], shape[layout.LINE]
    at, natural = line * width, shape[layout.TERMS] & layout.MATERIAL != 0
    damped = shape[layout.TERMS] & layout.DAMPED != 0
    force, change = shifted(scratch, shape[layout.FORCE]), shifted(scratch, shape[CHANGE])
    own, middle = shifted(scratch, shape[TWIST_OWN]), shifted(scratch, shape[MIDDLE])
    if shape[layout.LOADS]:
        midpoint_moments(shape, model, inputs, scratch, t0, tau)
    beta = damping_share(shape, model, tau)
    held = shifted(scratch, shape[TWIST_HELD])
    if anew:
        mark_held(shape, held)
    spins = held[0] + held[shape[layout.N] - 1] == 0.0
    viscous, lost = shape[layout.VISCOUS] + 7 * width, 0.0
    if damped:
        lost = -first(gathered(shape, form(shape, model, viscous, line, change))) / tau
    spring_force(shape, model, state, x, 1.0, YES, force)
    for k in range(at, at + width):
        own[k] = force[k]
    tolerance = TURNED
    for correction in range(MOST_CORRECTIONS if natural else 1):
        for k in range(at, at + width):
            force[k] = own[k]
        moved = correct_twist(shape, model, state, scratch, begin, end, x, tau, beta, spins, anew)
        for k in range(at, at + width):
            middle[k] = scratch[shape[START] + k] + 0.5 * change[k]
        if moved < tolerance:
            break
        if correction == 0:
            tolerance = max(TURNED, SHRUNK * moved)
    lost += roll_loss(shape, model, state, change)[0]
    if damped:
        lost += first(gathered(shape, form(shape, model, viscous, line, change))) / tau
    if beta > 0.0:
        twisted = difference_form(shape, model, shape[layout.TWIST], line, change)
        lost += beta * first(gathered(shape, twisted))
    return lost


@piece(*WITHIN)
def step_twist(shape, model, inputs, state, scratch, t0, tau, discrete, anew):
    """`solve_twist` in the Bishop frame of the present iterate of the shape, then add the forces of
    the twist on the centreline to FORCE. Returns the energy dissipated [J].
    """
    x, force = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.FORCE])
    begin, end = shifted(scratch, shape[START]), x
    if not discrete:
        begin = end = shifted(scratch, shape[MIDDLE])
    viscous = damping_share(shape, model, tau)
    rows = shifted(scratch, shape[layout.FRAME_SPARE] + shape[layout.LINE])
    turn_by_shape(shape, model, state, begin, end, viscous, discrete, rows, force)
    lost = solve_twist(shape, model, inputs, state, scratch, begin, end, x, t0, tau, anew)
    taken = push_by_twist(shape, model, begin, end, viscous, rows, force)
    if shape[layout.TERMS] & layout.MATERIAL:
        natural_force(shape, model, state, begin, end, NO, YES, force)
    return lost + first(gathered(shape, taken))


@part
def twist_reactions(shape, model, scratch, tau):
    """FORCE_OF_HELD of the twist rows: the reactions, from their momentum balance."""
    line, dim = shape[layout.DIM], shape[layout.DIM]
    at = line * shape[layout.LINE]
    row, push = shifted(scratch, shape[SEEN]), shifted(scratch, shape[INERTIA])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    force = shifted(scratch, shape[layout.FORCE])
    for k in range(at, at + shape[layout.LINE]):
        row[k] = 2.0 / tau * (change[k] / tau - speed[k])
        push[k] = -force[k]
    add_product(shape, model, mass_of(shape, line), line, 1.0, row, push)
    for k in range(shape[layout.HELD]):
        if line_of(shape, k) == dim:
            f = row_value(shape, model, k, scratch, shape[OLD_DIRECTION], push)
            store(scratch, shape[FORCE_OF_HELD] + k * LANES, f)


@piece(*END)
def end_twist(shape, model, inputs, state, scratch, t0, tau):
    """The twist, unless `step_twist` solved for it, and its reactions. Returns the energy lost."""
    lost = 0.0
    if not shape[layout.TERMS] & layout.BISHOP:
        x = shifted(state, shape[layout.X])
        lost = solve_twist(shape, model, inputs, state, scratch, x, x, x, t0, tau, YES)
    twist_reactions(shape, model, scratch, tau)
    return lost


@piece(*WITHIN)
def no_step_twist(shape, model, inputs, state, scratch, t0, tau, discrete, anew):
    """Nothing."""
    return 0.0


@piece(*END)
def no_end_twist(shape, model, inputs, state, scratch, t0, tau):
    """Nothing."""
    return 0.0


NO_TWIST = no_step_twist, no_end_twist
TWIST = no_step_twist, end_twist
TWIST_IN_FRAME = step_twist, end_twist
"""Functions for the iteration and the end of a step: without theta, with it, in a Bishop frame."""
