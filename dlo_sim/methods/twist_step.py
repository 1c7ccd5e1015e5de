"""The twist line of an implicit step, by the midpoint rule.

With the twist angle theta0 and its rate v0 at the start of a step of length tau, the moments f of
loads and of the rotation of the frame, the mass matrix M, the torsional stiffness matrix K and the
damping matrix C, the change d of theta in the step solves
    M (2 / tau^2 d - 2 / tau v0) = f - K (theta0 + (1/2 + beta / tau) d) - C d / tau,
where beta is the internal damping of the twist. Roll springs act with their moment at the end of
the step. The equations are linear and take one symmetric solve, unless there is natural curvature
in the material frame, for which Newton's method is used. In the Bishop frame twist and shape are
coupled: `step_twist` solves for the twist at every iterate of the shape and so eliminates it.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, void

from dlo_sim.compiling.kernels import NO, YES, inline, kernel
from dlo_sim.engine.arrays import (
    BISHOP,
    CABLE,
    DAMPED,
    IMPLICIT,
    LINES,
    MARGIN,
    MATERIAL,
    ROLLING,
    STATIC_TWIST,
)
from dlo_sim.engine.bishop import push_by_twist, turn_by_shape
from dlo_sim.engine.lines import add_differences, add_product, difference_form, form, mass_of
from dlo_sim.engine.natural_curvature import add_natural_stiffness, natural_force
from dlo_sim.engine.rolling import add_moments as add_rolling_moments
from dlo_sim.engine.rolling import add_stiffness as add_rolling_stiffness
from dlo_sim.engine.rolling import push_rolling
from dlo_sim.engine.rows import row_value
from dlo_sim.engine.springs import add_roll_change, add_roll_stiffness, roll_loss, spring_force

REFINEMENTS = 3  # iterative refinements for a cable that is free to spin
MOST_NEWTON = 8  # Newton corrections with natural curvature in the material frame
# Corrections, which converge quadratically, end below SETTLED relative to 1 rad plus the angle, or
# below SHRUNK times the first one: while the shape changes the twist need not be exact.
SETTLED, SHRUNK = 1e-4, 0.1
# With friction that rolls the cable, which sticks or slides, Newton's corrections may overshoot.
MOST_ROLLING, ROLLED, OVERSHOT, LEAST_SHARE = 40, 1e-9, 0.5, 0.4


@inline
def damping_share(cable, tau):
    """Internal damping of the twist, beta / tau [-]. Without inertia, additional damping of half a
    step turns the midpoint moment into that at the end of the step, where the twist is in
    equilibrium.
    """
    share = 0.5 if cable.terms & STATIC_TWIST else 0.0
    if cable.terms & DAMPED:
        share += cable.physics.beta_twist / tau
    return share


@inline
def make_matrix(cable, begin, end, tau, beta):
    """`work.twist_matrix` = the matrix 2 / tau^2 M + (1/2 + beta) K + C / tau with the stiffness of
    roll springs, natural curvature and rolling, `beta` per step; entry (i + k, i) is at [k, i].
    """
    mass, damping, twist = cable.linear.mass[1], cable.linear.damping[1], cable.linear.twist
    matrix = cable.work.twist_matrix
    damped = 1.0 / tau if cable.terms & DAMPED else 0.0
    for k in range(4):
        for i in range(cable.n - k):
            c = MARGIN + i
            value = 2.0 / (tau * tau) * mass[3 + k, c] + (0.5 + beta) * twist[3 + k, c]
            matrix[k, i] = value + damped * damping[3 + k, c]
    add_roll_stiffness(cable, matrix)
    if cable.terms & MATERIAL:
        add_natural_stiffness(cable, begin, end, matrix)
    add_rolling_stiffness(cable, cable.work.change, matrix)


@inline
def factorize(cable):
    """LDL^T factors of `work.twist_matrix` in place: 1 / D replaces diagonal 0, and rows 4, 5, 6
    get the three diagonals of L below the main one. The inverse pivots of prescribed unknowns are
    0, so that `solve` returns 0 for them.
    """
    matrix, prescribed = cable.work.twist_matrix, cable.work.twist_held
    inverse1 = inverse2 = inverse3 = 0.0  # 1 / D of the rows before
    last1 = last2 = before1 = 0.0  # L of the row before, and of the one before that
    for i in range(cable.n):
        free = 1.0 - prescribed[i]
        w3 = free * matrix[3, i - 3] if i > 2 else 0.0  # L D
        w2 = free * matrix[2, i - 2] - w3 * before1 if i > 1 else 0.0
        w1 = free * matrix[1, i - 1] - w3 * last2 - w2 * last1 if i > 0 else 0.0
        l3, l2, l1 = w3 * inverse3, w2 * inverse2, w1 * inverse1
        inverse3, inverse2 = inverse2, inverse1
        inverse1 = free / (matrix[0, i] - w3 * l3 - w2 * l2 - w1 * l1)
        matrix[0, i], matrix[4, i], matrix[5, i], matrix[6, i] = inverse1, l1, l2, l3
        before1, last1, last2 = last1, l1, l2


@inline
def solve(cable, matrix, x):
    """Forward and back substitution in place on a line, with the factors of `factorize`;
    prescribed unknowns become 0.
    """
    a = b = c = 0.0
    for i in range(cable.n):
        d = x[MARGIN + i] - (matrix[6, i] * a + matrix[5, i] * b) - matrix[4, i] * c
        x[MARGIN + i] = d
        a, b, c = b, c, d
    a = b = c = 0.0
    for i in range(cable.n - 1, -1, -1):
        d = matrix[0, i] * x[MARGIN + i] - c
        x[MARGIN + i] = d
        c, b, a = b + matrix[4, i] * d, a + matrix[5, i] * d, matrix[6, i] * d


@inline
def shorten(cable, x, tau, share):
    """Leave this share of the last correction in the twist line of x and `change`."""
    work, line = cable.work, cable.dim
    latest, sum_ = work.twist_latest[line], work.twist_sum[line]
    for c in range(cable.columns):
        latest[c] = (share - 1.0) * sum_[c]
        sum_[c] *= share
        x[line, c] += latest[c]
        work.change[line, c] += latest[c]
    add_roll_change(cable, work.twist_latest, work.twist_own)
    if cable.terms & DAMPED:
        add_product(cable.linear.damping[1], -1.0 / tau, latest, work.twist_own[line])


@inline
def correct_twist(cable, begin, end, x, tau, beta, spins, make, before):
    """One Newton correction of the twist line of x and `change`, d, for the residual
        f - K (theta0 + (1/2 + beta) d) - M (2 / tau^2 d - 2 / tau v0),
    where f is `force`: loads, rotation of the frame, and damping and springs for the previous d.
    Adds the remaining moments to `force`, and the change of damping and springs to `twist_own`.

    Args:
        begin, end: configurations of the discrete gradient of the natural curvature. beta: internal
            damping per step [-]. spins: whether neither end is prescribed. make: whether to make
            the matrix anew. before: product of the residual before the last correction and that
            correction. If that of the present residual is below -OVERSHOT times this, the last
            correction overshot, and is shortened instead of a new one made; 0: never.

    Returns:
        The largest entry of the correction relative to 1 rad plus the angle, infinite if the last
        one was shortened; and the residual times the correction.
    """
    work, line = cable.work, cable.dim
    natural, damped = cable.terms & MATERIAL != 0, cable.terms & DAMPED != 0
    mass, damping, twist = mass_of(cable, line), cable.linear.damping[1], cable.linear.twist
    matrix, a = work.twist_matrix, 2.0 / (tau * tau)
    if natural:
        natural_force(cable, begin, end, YES, NO, work.force)
    add_rolling_moments(cable, work.change, work.force)
    theta, change, force = x[line], work.change[line], work.force[line]
    latest, rest, sum_ = work.twist_latest[line], work.twist_rest[line], work.twist_sum[line]
    add_differences(twist, -1.0, work.start[line], force)
    for c in range(cable.columns):
        rest[c] = force[c]
    add_differences(twist, -0.5 - beta, change, rest)
    add_product(mass, -a, change, rest)
    add_product(mass, 2.0 / tau, work.start_v[line], rest)
    if before > 0.0:
        along = 0.0
        for c in range(cable.columns):
            along += rest[c] * sum_[c]
        if not along > -OVERSHOT * before:
            # By the secant rule, but not more: where samples stick again the residual has a kink.
            share = max(before / (before - along), LEAST_SHARE)
            shorten(cable, x, tau, share)
            return np.inf, share * before
    if make:
        make_matrix(cable, begin, end, tau, beta)
        factorize(cable)
    slope = 0.0
    for c in range(cable.columns):
        sum_[c] = 0.0
    # In the factors the inertia of a rigid spin is lost to round-off beside a large stiffness. The
    # residual is exact, as its differences vanish for a spin: iterative refinement corrects it.
    for _ in range(1 + REFINEMENTS if spins else 1):
        for c in range(cable.columns):
            latest[c] = rest[c]
        solve(cable, matrix, latest)
        for c in range(cable.columns):
            sum_[c] += latest[c]
            slope += rest[c] * latest[c]
        add_product(mass, -a, latest, rest)
        add_differences(twist, -0.5 - beta, latest, rest)
        add_roll_change(cable, work.twist_latest, work.twist_rest)
        if damped:
            add_product(damping, -1.0 / tau, latest, rest)
    moved = 0.0
    for c in range(cable.columns):
        theta[c] += sum_[c]
        change[c] += sum_[c]
        moved = max(moved, abs(sum_[c]) / (1.0 + abs(theta[c])))
    add_differences(twist, -0.5 - beta, change, force)
    add_roll_change(cable, work.twist_sum, work.force)
    add_roll_change(cable, work.twist_sum, work.twist_own)
    if damped:
        add_product(damping, -1.0 / tau, sum_, force)
        add_product(damping, -1.0 / tau, sum_, work.twist_own[line])
    return moved, slope


@kernel(float64, CABLE, LINES, LINES, float64, boolean, terms=BISHOP, family=IMPLICIT)
def solve_twist(cable, begin, end, tau, anew):
    """Solve for the twist line at the end of the step from t0.

    On entry `change` has the prescribed part and `force` the forces at the new shape; the twist
    lines of x, `change`, `force` and `load` are completed.

    Args:
        begin, end: configurations of the discrete gradient of the natural curvature. anew: whether
            this is the first time in this step. The matrix is constant, except with natural
            curvature, whose first one of a step stays unless it needs a second correction, and with
            friction that rolls the cable.

    Returns:
        The energy [J] dissipated in the twist, less that of the external damping in the initial
        `change`, which `implicit.step_force` counted.
    """
    work, line, x = cable.work, cable.dim, cable.state.x
    rolling, damped = cable.terms & ROLLING != 0, cable.terms & DAMPED != 0
    natural = cable.terms & MATERIAL != 0
    force, change, own = work.force[line], work.change[line], work.twist_own[line]
    damping = cable.linear.damping[1]
    beta = damping_share(cable, tau)
    if work.results.twist_step != tau:
        for i in range(cable.n):
            work.twist_held[i] = 0.0
        for k in range(cable.rows.count):
            if cable.rows.line[k] == line:
                work.twist_held[cable.points.own[cable.rows.point[k]]] = 1.0
    spins = work.twist_held[0] + work.twist_held[cable.n - 1] == 0.0
    spins = spins and not rolling  # whose stiffness the residual does not know
    lost = 0.0
    if damped:
        lost = -form(damping, change) / tau
    spring_force(cable, x, 1.0, YES, work.force)
    for c in range(cable.columns):
        own[c] = force[c]
    most = MOST_NEWTON if natural else 1
    settled = SETTLED
    if rolling:
        most, settled = MOST_ROLLING, ROLLED
    tolerance, slope, moved = settled, 0.0, np.inf
    for correction in range(most):
        for c in range(cable.columns):
            force[c] = own[c]
        make = correction > 0 or rolling or (natural and anew) or work.results.twist_step != tau
        before = slope if rolling else 0.0
        moved, slope = correct_twist(cable, begin, end, x, tau, beta, spins, make, before)
        for c in range(cable.columns):
            work.middle[line, c] = work.start[line, c] + 0.5 * change[c]
        if moved < tolerance:
            break
        if correction == 0 and not rolling:
            tolerance = max(SETTLED, SHRUNK * moved)
    work.results.twist_step = tau
    work.results.twist_open = 1.0 if rolling and not moved < tolerance else 0.0
    lost += roll_loss(cable, work.change)[0]
    if damped:
        lost += form(damping, change) / tau
    if beta > 0.0:
        lost += beta * difference_form(cable.linear.twist, change)
    return lost


@kernel(float64, CABLE, float64, boolean, boolean, terms=BISHOP, family=IMPLICIT)
def step_twist(cable, tau, discrete, anew):
    """`solve_twist` in the Bishop frame of the present iterate of the shape, then add the forces of
    the twist on the centreline to `force`. Returns the energy dissipated [J].
    """
    x, force = cable.state.x, cable.work.force
    begin, end = (cable.work.start, x) if discrete else (cable.work.middle, cable.work.middle)
    viscous = damping_share(cable, tau)
    turn_by_shape(cable, end, viscous, discrete, force)
    lost = solve_twist(cable, begin, end, tau, anew)
    lost += push_by_twist(cable, begin, end, viscous, force)
    if cable.terms & MATERIAL:
        natural_force(cable, begin, end, NO, YES, force)
    push_rolling(cable, cable.work.change, force)
    return lost


@kernel(void, CABLE, float64, boolean, terms=ROLLING)
def twist_matrix(cable, tau, discrete):
    """`make_matrix` at the present iterate of the shape, without factors."""
    x, middle = cable.state.x, cable.work.middle
    begin, end = (cable.work.start, x) if discrete else (middle, middle)
    make_matrix(cable, begin, end, tau, damping_share(cable, tau))


@kernel(void, CABLE, float64, terms=BISHOP, family=IMPLICIT)
def end_twist(cable, tau):
    """Set `row_force` of the rows that prescribe the twist to their reactions, from the momentum
    balance.
    """
    work, line = cable.work, cable.dim
    rate, push = work.rate[line], work.inertia[line]
    for c in range(cable.columns):
        rate[c] = 2.0 / tau * (work.change[line, c] / tau - work.start_v[line, c])
        push[c] = -work.force[line, c]
    add_product(mass_of(cable, line), 1.0, rate, push)
    for k in range(cable.rows.count):
        if cable.rows.line[k] == line:
            work.row_force[k] = row_value(cable, k, work.old_direction, work.inertia)
