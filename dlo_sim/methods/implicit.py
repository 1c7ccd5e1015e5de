"""Implicit steps: the energy-momentum method and the implicit midpoint rule.

**The equations.** A step of length tau leads from the configuration q0 with velocity v0 to q1. With
v1 = 2 (q1 - q0) / tau - v0, the momentum balance M (v1 - v0) / tau = f is
    M (a (q1 - q0) - b v0) = f(q0, q1) + E^T lambda,   B q1 = targets at the end of the step,
    a = 2 / tau^2,   b = 2 / tau,
with the mass matrix M and the reactions lambda of the grasps along their constraint rows, E at the
middle of the step and B at its end: symmetric, and exact in the energy balance. f contains loads
and damping at the middle of the step, and the elastic forces: those at (q0 + q1) / 2
(`implicit_midpoint`), or minus the discrete gradient (`energy_momentum`). The product of the
balance with q1 - q0 = tau (v0 + v1) / 2 is the change of the kinetic energy, so with the discrete
gradient the energy is exact.

Twist and shape are found together. Quasistatic twist, without inertia, and roll springs act with
their moments at the end of the step: the midpoint rule with internal damping of half a step, so
that what is stiff does not ring.

**The solution.** `begin_step` predicts q1 and moves the constraint rows to their targets. Then the
forces (`step_force`), the residual of the momentum balance (`set_residual`) and a correction
(`correct`) alternate until the energy error of the step is small (`iterate`). Corrections are
Newton's with the Jacobian of `engine.elastic`, whose tension, an unknown of its own, is the one
that the last correction predicted (`engine.tension`); between two factorisations they are
Broyden's. What was found may still fold the cable over or pass through something (`is_valid`).
`finish_step` updates velocities, reactions and the energy balance. `try_step` is all of this. A
step that does not converge is rejected and repeated in halves, quarters, ... of its length
(`implicit_step`).
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import NO, YES, inline, kernel
from dlo_sim.compiling.lanes import LANES, fabs, lane_sum, where, zero
from dlo_sim.engine import bishop, contact, roll, self_contact
from dlo_sim.engine.account import RESOLUTION
from dlo_sim.engine.arrays import (
    BISHOP,
    CABLE,
    CONTACT,
    DAMPED,
    IMPLICIT,
    IN_SKYLINE,
    IN_STATE,
    MARGIN,
    METHOD,
    MOST_CORRECTIONS,
    PADDING,
    SELF,
    SLIDING,
    STATIC_TWIST,
)
from dlo_sim.engine.assembly import (
    add_damping,
    add_damping_tangent,
    discrete_gradient,
    discrete_jacobian,
    flow,
    start_with_weight,
)
from dlo_sim.engine.band import (
    add_lines,
    add_springs,
    clamps_here,
    clear_band,
    clear_held,
    eliminate,
    hold,
    own_point,
    solve,
    to_lines,
    to_unknowns,
    turn_vector,
)
from dlo_sim.engine.border import (
    balance_border,
    keep_border,
    set_border,
    set_roll_force,
    set_roll_rows,
    solve_border,
    solve_constrained,
    stiffen_border,
)
from dlo_sim.engine.lines import (
    add,
    add_product,
    clear,
    copy,
    damping_of,
    difference,
    inner,
    kinetic,
    mass_of,
)
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.rows import (
    add_shifts,
    add_velocity_of_held,
    grasps_move,
    pin,
    project,
    row_value,
    set_directions,
    target_rates,
    target_residuals,
    through_inverse,
    turn_rows,
    values_along,
)
from dlo_sim.engine.skyline import eliminate_skyline
from dlo_sim.engine.sliding import (
    END,
    START,
    accept_slides,
    move_slides,
    settle_slides,
    slide_tangent,
    step_slides,
)
from dlo_sim.engine.springs import (
    accept_anchors,
    anchor_work,
    move_anchors,
    restore_anchors,
    roll_loss,
    spring_force,
)
from dlo_sim.engine.tension import (
    copy_tension,
    may_stretch,
    predict_tension,
    shorten_tension,
    take_tension,
    unpredicted,
)

PREDICTED, PRESENT, LAST = 0, 1, 2  # tensions of `linearize`
MAX_ITERATIONS = 40  # force evaluations before a step is halved
MAX_BOLD = 20  # the same before corrections that overshoot are shortened
HOPELESS = 8  # iterations after which corrections there must be smaller than the first
MAX_HALVINGS = 12
# Iterations up to which corrections that change what touches are whole, and halved.
WHOLE, HALVED = 5, 15
TRUSTING = 3  # iterations up to which the expected contraction counts where something touches
CAREFUL_HALVINGS = 4  # of a step that folds the cable over; after these the fold is accepted
SLOW = 0.02  # ratio of successive correction energies above which the matrix is renewed
STALLED = 0.2  # the same above which a correction counts as stalled
GROWTH = 1.0  # of the residual along a correction, above which the correction is shortened
SMALLEST_SHARE = 1e-6  # of a correction that shortening may leave
TRUSTED = 0.5  # largest s_last.z / |s_last|^2 in Broyden's denominator
TINY = 1e-200  # positions [m] and velocities [m/s] that are zero
SMALLEST = 1e-300  # lower bound on the square of a correction
NOISE = 1e-9  # stalled corrections below this share of the coordinates are round-off
ROUND_OFF = 1e-14  # corrections below this share of the coordinates are round-off
BUDGET = 300_000  # unknowns times iterations per step with all its parts: some 30 ms
LEAST_BUDGET = 500  # iterations per step
ROOM = 10.0  # error of the energy balance in the long run, in tolerances
SPARE = 0.7  # of that with contact, of which many steps use all: TIGHT adds up beyond it
TIGHT = 1e-10  # tolerance of a step once that is reached
SAFETY = 10.0  # factor on the expected contraction
MOST_WITH_KEPT = 3  # iterations with a matrix of an earlier step; with a new one two are usual
MOST_SETBACKS = 5.0  # log2 of the longest wait [steps]
SMALLEST_SHRINKING = 1e-3  # lower bound on the measured contraction
MOST_STOPS = 8  # attempts to find which samples friction holds as they land
SOFT = 1e-12  # share of the stiffness of joints in an impulse
STOPPED = 1e-5  # energy of velocities after contact, in that of its pressure, left alone
FORGETTING = 1.5  # growth of the remembered contraction per step that does not measure it


# -- the start of a step: predictor and prescribed motion ---------------------------------------


@inline
def copy_entries(source, target):
    """target = source, for matrices that are not padded to whole vectors."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@inline
def without_tiny(value):
    """The value, or 0 on lanes where it is tiny: what decays from step to step would end in numbers
    that processors multiply a hundred times more slowly.
    """
    return where(fabs(value) - TINY, value, zero())


@inline
def predict(cable, tau):
    """Predictor: quadratic extrapolation of the last three configurations, or constant w if they
    are not known. If the motion alternates from step to step, as undamped stiff modes do in steps
    far too long for them, the configuration before the present one. With contact, where stick and
    slip may change in every step, the second difference counts with the share of it that was right
    in the step before (`learn_extrapolated_share`): 1 is the quadratic, 0 the linear extrapolation.

    Shifts the history by one configuration.
    """
    balance, x, w = cable.state.balance, cable.state.x, cable.state.w
    near, far = cable.state.history[0], cable.state.history[1]
    last, before_last = balance.length, balance.length_before
    known = balance.known >= 2.0
    alternates = False
    a = b = c = 0.0
    if known:
        once, twice = zero(), zero()
        for d in range(cable.dim):
            for i in range(0, cable.columns, LANES):
                one, two = load(x, d, i) - load(near, d, i), load(x, d, i) - load(far, d, i)
                once += one * one
                twice += two * two
        alternates = tau == last == before_last and lane_sum(twice) < lane_sum(once)
        both = last + before_last  # Lagrange weights of the configurations at 0, -last and -both
        a = (tau + last) * (tau + both) / (last * both)
        b = -tau * (tau + both) / (last * before_last)
        c = tau * (tau + last) / (both * before_last)
    even = known and not alternates and tau == last == before_last
    if cable.terms & CONTACT:
        seconds = cable.work.second_difference
        for d in range(cable.lines):
            for i in range(0, cable.columns, LANES):
                second = load(x, d, i) - 2.0 * load(near, d, i) + load(far, d, i)
                store(seconds, d, i, second if even else zero())
        if even:
            share = balance.extrapolated_share
            a, b, c = 2.0 + share, -1.0 - 2.0 * share, share
    for d in range(cable.lines):
        for i in range(0, cable.columns, LANES):
            now, before = load(x, d, i), load(near, d, i)
            if alternates:
                store(x, d, i, before)
            elif known:
                store(x, d, i, without_tiny(a * now + b * before + c * load(far, d, i)))
            else:
                store(x, d, i, without_tiny(now + tau * load(w, d, i)))
            store(far, d, i, before)
            store(near, d, i, now)
    balance.length_before = last
    balance.length = tau


@inline
def learn_extrapolated_share(cable):
    """Fit the share with which the second difference before the step predicts that of the step, by
    least squares, within 0 to 1.
    """
    before, change, start = cable.work.second_difference, cable.work.change, cable.work.start
    both, square = zero(), zero()
    for d in range(cable.dim):
        for i in range(0, cable.columns, LANES):
            second = load(change, d, i) - load(start, d, i) + load(cable.state.history[1], d, i)
            both += second * load(before, d, i)
            square += load(before, d, i) * load(before, d, i)
    share = lane_sum(both) / max(lane_sum(square), SMALLEST)
    cable.state.balance.extrapolated_share = min(max(share, 0.0), 1.0)


@inline
def keep_constraints(cable):
    """Restore the prescribed coordinates after extrapolation, whose round-off would grow from step
    to step. For grasps at rest.
    """
    x, start, change = cable.state.x, cable.work.start, cable.work.change
    for k in range(cable.rows.count):
        own, line = cable.points.own[cable.rows.point[k]], cable.rows.line[k]
        e, c = cable.state.direction[k], MARGIN + own
        if own >= 0 and line >= 0:  # a coordinate, or the twist angle
            x[line, c] = start[line, c]
        elif own >= 0:
            away = 0.0
            for d in range(cable.dim):
                away += e[d] * (x[d, c] - start[d, c])
            for d in range(cable.dim):
                x[d, c] -= away * e[d]
    if cable.rows.border:
        difference(start, x, change)
        values_along(cable, change)
        add_shifts(cable, 1.0, x)


@kernel(void, CABLE, float64, float64, family=IMPLICIT)
def begin_step(cable, t0, tau):
    """Predict the configuration at the end of the step and move it onto the constraints there.

    Sets `start` and `start_v`, configuration and velocity at the start; the directions of the
    constraint rows at the start (with their inverse), at the middle, and, in the state, at the end;
    the anchors of springs; and `change`.
    """
    state, work = cable.state, cable.work
    moves = grasps_move(cable)
    copy(state.x, work.start)
    copy(state.w, work.start_v)
    copy_entries(state.direction, work.old_direction)
    copy_entries(state.direction, work.middle_direction)
    copy_entries(state.inverse, work.old_inverse)
    if cable.physics.keeps_length != 0.0:
        copy_tension(state.tension, work.tension_start)
    if moves:
        add_velocity_of_held(cable, state.x, t0, work.start_v)
    predict(cable, tau)
    if moves:
        turn_rows(cable, t0 + 0.5 * tau, work.middle_direction)
        set_directions(cable, t0 + tau)
        target_residuals(cable, state.direction, state.x)
        add_shifts(cable, 1.0, state.x)
        for k in range(cable.rows.count):
            pin(cable, k, work.targets[k], state.x)
        move_anchors(cable)
        move_slides(cable)
    else:
        keep_constraints(cable)
    difference(state.x, work.start, work.change)
    if cable.terms & CONTACT:
        contact.begin(cable, t0, tau, contact.largest_way(cable, work.change), work.start)
    self_contact.begin(cable, tau, work.start, state.x, work.change)


@inline
def undo_step(cable):
    """Restore the state at the start of the step; discard the history and the matrix."""
    state, work = cable.state, cable.work
    copy(work.start, state.x)
    copy_entries(work.old_direction, state.direction)
    copy_entries(work.old_inverse, state.inverse)
    if cable.physics.keeps_length != 0.0:
        copy_tension(work.tension_start, state.tension)
    restore_anchors(cable)
    settle_slides(cable, START, END)
    if cable.terms & CONTACT:
        contact.reset(cable)
    state.balance.known = 0.0
    state.balance.matrix_weight = 0.0


# -- the equations: forces, residual of the momentum balance, Jacobian --------------------------


@inline
def twist_damping(cable, tau):
    """Internal damping of the twist, beta / tau [-], with that of half a step without inertia."""
    share = 0.5 if cable.terms & STATIC_TWIST else 0.0
    if cable.terms & DAMPED:
        share += cable.physics.beta_twist / tau
    return share


@inline
def is_viscous(cable):
    """Whether stretching or bending has internal damping."""
    physics = cable.physics
    return cable.terms & DAMPED != 0 and physics.beta_stretch + physics.beta_bend > 0.0


@inline
def between(cable, discrete):
    """Both configurations between which elastic forces are evaluated: those at the start and the
    end of the step, or twice the one at its middle.
    """
    start, middle = cable.work.start, cable.work.middle
    return (start, cable.state.x) if discrete else (middle, middle)


@kernel(float64, CABLE, float64, float64, boolean, family=IMPLICIT)
def step_force(cable, t0, tau, discrete):
    """force = all forces of the step from `start` to the present configuration, start + change.

    Returns the energy dissipated by damping [J].
    """
    work = cable.work
    force, change, middle = work.force, work.change, work.middle
    start_with_weight(cable, force)
    clear(work.load)
    clear(work.damping)
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            store(middle, line, c, load(work.start, line, c) + 0.5 * load(change, line, c))
    viscous = 1.0 / tau if is_viscous(cable) else 0.0
    begin, end = between(cable, discrete)
    lost = discrete_gradient(cable, begin, end, change, viscous, force)
    lost += bishop.step_force(cable, work.start, end, twist_damping(cable, tau), discrete, force)
    if cable.terms & CONTACT:
        contact.add_force(cable, YES, cable.state.x, force)
    if cable.terms & SELF:
        self_contact.add_force(cable, 1.0 / tau, cable.state.x, force)
    spring_force(cable, middle, 0.5, NO, force)
    spring_force(cable, cable.state.x, 1.0, YES, force)
    roll.force(cable, work.start, cable.state.x, force)
    lost += step_slides(cable, work.start, cable.state.x, force)
    if cable.loads.count:
        load_force(cable, middle, t0 + 0.5 * tau, work.load)
        add(1.0, work.load, force)
    if cable.terms & DAMPED:
        for line in range(cable.lines):
            add_product(damping_of(cable, line), -1.0 / tau, change[line], work.damping[line])
        add_damping(cable, middle, change, 1.0 / tau, work.damping)
        add(1.0, work.damping, force)
        lost -= inner(work.damping, change)
    return lost


@inline
def take_reactions(cable, directions, out):
    """Write the forces of the grasps that balance `residual` to `out` (rows,), in a residual that
    becomes one in the frames of the clamps, with directions (rows, 3).
    """
    residual = cable.work.residual
    turn_vector(cable, directions, YES, residual, PADDING)
    balance_border(cable, residual, out)
    for k in range(cable.rows.count):
        own, entry = cable.points.own[cable.rows.point[k]], cable.rows.line[k]
        if own >= 0:
            if entry < 0:  # of the control point that the row fixes
                entry = 1 if clamps_here(cable, k) else 2
            out[k] = -residual[PADDING + own * cable.lines + entry]


@kernel(float64, CABLE, float64, float64, family=IMPLICIT)
def set_residual(cable, a, b):
    """Set `residual` to that of the momentum balance, in the frames of the clamps, and `row_force`
    to the reactions of the constraint rows. Returns the sum |inertia_i change_i| [J].
    """
    work, lines = cable.work, cable.lines
    change, rate, inertia, residual = work.change, work.rate, work.inertia, work.residual
    energy = 0.0
    for d in range(lines):
        for i in range(0, cable.columns, LANES):
            store(rate, d, i, a * load(change, d, i) - b * load(work.start_v, d, i))
            store(inertia, d, i, 0.0)
        add_product(mass_of(cable, d), 1.0, rate[d], inertia[d])
        for i in range(cable.n):
            push = inertia[d, MARGIN + i]
            energy += abs(push * change[d, MARGIN + i])
            residual[PADDING + i * lines + d] = work.force[d, MARGIN + i] - push
    set_roll_force(cable, work.middle_direction)
    take_reactions(cable, work.middle_direction, work.row_force)
    clear_held(cable, residual, PADDING)
    return energy


@inline
def factorize(cable, matrix):
    """LU factors of the band matrix, with the couplings where the cable presses on itself; returns
    whether they exist.
    """
    results, pushed, kept = cable.work.results, cable.work.middle_direction, cable.state.direction
    results.coupled = IN_STATE
    self_contact.couple(cable, pushed, kept, matrix)
    if results.coupled == IN_SKYLINE:
        return eliminate_skyline(cable)
    return eliminate(matrix, cable.n * cable.lines, cable.lines)


@kernel(boolean, CABLE, float64, float64, float64, boolean, family=IMPLICIT)
def newton_matrix(cable, t0, tau, a, discrete):
    """state.matrix = LU factors of the Jacobian of the momentum balance; return whether they exist.

    A force at the middle depends on half the change; the tangents of the discrete gradient contain
    this 1/2.
    """
    state, work = cable.state, cable.work
    matrix, middle = state.matrix, work.middle
    clear_band(matrix)
    add_lines(cable, cable.linear.mass, a, matrix)
    viscous = 0.0
    if cable.terms & DAMPED:
        add_lines(cable, cable.linear.damping, 1.0 / tau, matrix)
        add_damping_tangent(cable, middle, work.change, 1.0 / tau, matrix)
        if is_viscous(cable):
            viscous = 1.0 / tau
    begin, end = between(cable, discrete)
    discrete_jacobian(cable, begin, end, viscous, 0.5 + twist_damping(cable, tau), 1.0, matrix)
    if cable.terms & CONTACT:
        contact.add_tangent(cable, YES, 1.0, matrix)
    add_springs(cable, 0.5, matrix)
    slide_tangent(cable, YES, work.start, state.x, 1.0, matrix)
    add_load_stiffness(cable, middle, t0 + 0.5 * tau, 0.5, matrix)
    hold(cable, work.middle_direction, state.direction, matrix)
    set_roll_rows(cable, work.middle_direction, state.direction)
    stiffen_border(cable, matrix)
    state.balance.matrix_weight = 0.0
    if not factorize(cable, matrix):
        return False
    solve_border(cable, matrix, 0.5)
    # Other factors are in working memory, and so lost after the step.
    state.balance.matrix_weight = a if work.results.coupled == IN_STATE else 0.0
    return True


# -- one correction -----------------------------------------------------------------------------


@inline
def dot(padded, s):
    """y . s of a padded vector y of all unknowns, as four independent sums."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = len(s) - len(s) % 4
    for r in range(0, whole, 4):
        s0 += padded[PADDING + r] * s[r]
        s1 += padded[PADDING + r + 1] * s[r + 1]
        s2 += padded[PADDING + r + 2] * s[r + 2]
        s3 += padded[PADDING + r + 3] * s[r + 3]
    for r in range(whole, len(s)):
        s0 += padded[PADDING + r] * s[r]
    return (s0 + s1) + (s2 + s3)


@inline
def take_nudge(cable, number):
    """`nudge` = correction `number`, in world coordinates."""
    step, correction = cable.work.step, cable.work.corrections[number]
    for r in range(len(step)):
        step[r] = correction[r]
    turn_vector(cable, cable.state.direction, NO, step, 0)
    to_lines(cable, step, 0, cable.work.nudge)


@inline
def move(cable, share):
    """x and `change` += this share of `nudge`."""
    add(share, cable.work.nudge, cable.state.x)
    add(share, cable.work.nudge, cable.work.change)


@inline
def shorten(cable, number, before, share):
    """Leave this share of correction `number`, of which x and the tension contain `before`."""
    take_nudge(cable, number)
    move(cable, share - before)
    shorten_tension(cable, share / before)


@inline
def overlap(cable, padded, s):
    """`dot` of two corrections, an angle of the twist counted as the way of a span that it turns:
    Broyden's method depends on the units.
    """
    sum_, lines = dot(padded, s), cable.lines
    if cable.terms & BISHOP:
        arm = cable.physics.shortest_span
        for r in range(cable.dim, cable.n * lines, lines):
            sum_ += (arm * arm - 1.0) * padded[PADDING + r] * s[r]
    return sum_


@inline
def correct(cable, known, discrete, allowed, reach):
    """Solve for the next correction by Broyden's method, predict the tension that it causes, unless
    it cannot matter (`tension.may_stretch`), and add it to x and `change`.

    With z = K^-1 r of the present residual r and the `known` corrections s_j since K was
    factorised, z += s_(j+1) (s_j.z) / |s_j|^2 for all but the last, then
    s = z / (1 - s_last.z / |s_last|^2) (Kelley 1995, section 7.3).

    Returns sum |r_i s_i|, r.s, the energy error sum |r_i change_i| [J] before this correction,
    the largest entry of s, as a share of the largest coordinate `reach` or of 1 rad plus the
    largest angle, and whether the tension was predicted.
    """
    state, work, lines = cable.state, cable.work, cable.lines
    size = cable.n * lines
    z, unbalanced, corrections = work.residual, work.unbalanced, work.corrections
    for r in range(size):
        unbalanced[r] = z[PADDING + r]
    solve(cable, state.matrix, z)
    keep_border(cable, YES, z)
    for j in range(known):
        along = overlap(cable, z, corrections[j]) * work.correction_scale[j]
        if j + 1 < known:
            for r in range(size):
                z[PADDING + r] += along * corrections[j + 1, r]
        elif abs(along) < TRUSTED:
            for r in range(size):
                z[PADDING + r] /= 1.0 - along
    energy, slope = 0.0, 0.0
    for r in range(size):
        s = z[PADDING + r]
        corrections[known, r] = s
        energy += abs(s * unbalanced[r])
        slope += s * unbalanced[r]
    work.correction_scale[known] = 1.0 / max(overlap(cable, z, corrections[known]), SMALLEST)
    take_nudge(cable, known)
    moved = largest(work.nudge, 0, cable.dim)
    stretched = may_stretch(cable, moved, allowed) or cable.physics.keeps_length != 0.0
    moved /= reach
    if cable.terms & BISHOP:
        turned = largest(work.nudge, cable.dim, lines)
        moved = max(moved, turned / (1.0 + largest(state.x, cable.dim, lines)))
    if stretched:
        begin, end = between(cable, discrete)
        elastic = 1.0 - cable.physics.keeps_length
        predict_tension(cable, begin, end, work.nudge, elastic)
    move(cable, 1.0)
    step, defect = work.step, roll.defect(cable)
    for d in range(lines):
        for i in range(cable.n):
            step[i * lines + d] = work.change[d, MARGIN + i]
    turn_vector(cable, state.direction, YES, step, 0)
    for r in range(size):
        defect += abs(step[r] * unbalanced[r])
    return energy, slope, defect, moved, stretched


@inline
def shortened(before, after):
    """Share of a correction at which the residual along it vanishes by the secant rule, limited."""
    share = before / (before - after)
    return min(max(share, 0.1), 0.5) if share > 0.0 and share < np.inf else 0.1


@inline
def largest(x, begin, end):
    """Largest absolute value in the lines from `begin` on, before `end`."""
    value = 0.0
    for line in range(begin, end):
        for c in range(x.shape[1]):
            value = max(value, abs(x[line, c]))
    return value


@kernel(boolean, CABLE, family=IMPLICIT)
def turned_over(cable):
    """Whether an edge of the control polygon turned by more than a right angle in the step.

    False if a grasp jumped by more than half an edge: shorter steps would not help.
    """
    x, start, change = cable.state.x, cable.work.start, cable.work.change
    jump, shortest = 0.0, np.inf
    found = False
    for c in range(MARGIN, MARGIN + cable.n - 1):
        if cable.mesh.branch[c - MARGIN] != cable.mesh.branch[c - MARGIN + 1]:
            continue
        along, length = 0.0, 0.0
        for d in range(cable.dim):
            edge = start[d, c + 1] - start[d, c]
            along += edge * (x[d, c + 1] - x[d, c])
            length += edge * edge
        shortest = min(shortest, length)
        found = found or along <= 0.0
    for k in range(cable.rows.count):
        own = own_point(cable, k)
        if own >= 0:
            for d in range(cable.dim):
                jump = max(jump, abs(change[d, MARGIN + own]))
    return found and not 4.0 * jump * jump > shortest


# -- the end of a step: projected velocity, reactions, energy balance ---------------------------


@inline
def prescribed_energy(cable, directions, inverse, v):
    """Kinetic energy [J] of the prescribed motion, (B v)^T S^-1 (B v) / 2, of the constraint rows
    with these directions and this inverse, S^-1.
    """
    work = cable.work
    for k in range(cable.rows.count):
        work.rates[k] = row_value(cable, k, directions, v)
    through_inverse(inverse, work.rates, 0.5, work.multipliers)
    energy = 0.0
    for k in range(cable.rows.count):
        energy += work.multipliers[k] * work.rates[k]
    return energy


@kernel(float64, CABLE, boolean, float64, terms=DAMPED, family=IMPLICIT)
def settle_overdamped(cable, moves, tau):
    """Remove the part of the velocity that alternates from step to step, where it exceeds the mean
    velocity; returns its energy [J].

    With z = tau c / 2 + (tau omega)^2 / 4 of a mode of frequency omega and damping c = beta omega^2
    per mass, steps of the midpoint family multiply the velocity of an overdamped mode, z >> 1, by
    -(1 - 2 / z). After a jump of a gripper it alternates for thousands of steps, while the mode
    itself is at rest, and so do its kinetic energy and the reactions.

    The velocity at the end of the step is the mean one, v = (q1 - q0) / tau, plus half the
    difference d = (w1 - w0) / 2. In a smooth motion d is half the difference of the last two mean
    velocities, to second order in tau (it has the centripetal acceleration, too, which acts along
    stiff directions). What d has beyond that alternates. Where its square sum exceeds that of v,
    the share (z / (1 + z))^3 of it is removed, all of an overdamped mode, nothing of a slow one,
    unless that would add energy.
    z / (1 + z) comes from the Newton matrix of the step, 2 / tau^2 M (1 + z).
    """
    state, work, dim, lines = cable.state, cable.work, cable.dim, cable.lines
    w, change, mass = state.w, work.change, cable.linear.mass[0]
    before = state.history[1]
    apart, push, solved = work.rate, work.inertia, work.residual
    clear(apart)
    alternating, mean = zero(), zero()
    for d in range(dim):
        for c in range(0, cable.columns, LANES):
            moved = load(change, d, c)
            smooth = 0.5 * (moved - (load(work.start, d, c) - load(before, d, c)))
            rate = (moved - smooth) * (1.0 / tau) - load(work.start_v, d, c)
            store(apart, d, c, rate)
            alternating += rate * rate
            mean += moved * moved
    if lane_sum(alternating) * tau * tau <= lane_sum(mean):
        return 0.0
    if moves:
        project(cable, apart, work.multipliers)
    for _ in range(3):
        clear(push)
        for d in range(dim):
            add_product(mass, 2.0 / (tau * tau), apart[d], push[d])
        to_unknowns(cable, push, solved)
        pushed, ahead = work.middle_direction, state.direction
        solve_constrained(cable, state.matrix, pushed, ahead, NO, solved)
        for d in range(dim):
            for i in range(cable.n):
                apart[d, MARGIN + i] -= solved[PADDING + i * lines + d]
    if moves:
        project(cable, apart, work.multipliers)
    clear(push)
    loss = 0.0
    for d in range(dim):
        add_product(mass, 1.0, apart[d], push[d])
        for c in range(cable.columns):
            loss += push[d, c] * (w[d, c] - 0.5 * apart[d, c])
    if loss <= 0.0:
        return 0.0
    for d in range(dim):
        for c in range(cable.columns):
            w[d, c] -= apart[d, c]
    return loss


@kernel(float64, CABLE, float64, float64, terms=CONTACT, family=IMPLICIT)
def stop_contacts(cable, t, tau):
    """Give what is pressed at the end t of a step the velocity after contact (`engine.contact`);
    returns the energy lost [J]. Its impulses add to the work of obstacles and grasps, and to the
    mean reactions of the step in `row_force`.

    With M and the velocities v, the change s solves (M + penalty) s = impulses at v, within the
    constraints of the grasps. Which samples friction holds is found by trying.
    """
    state, work, lines = cable.state, cable.work, cable.lines
    before, v, push, solved = work.v0, work.v1, work.inertia, work.residual
    copy(state.w, before)
    add_velocity_of_held(cable, state.x, t, before)
    found = contact.begin_impulses(cable, tau, before)
    if found[0] <= STOPPED * found[1]:
        return 0.0
    band, directions = work.band, state.direction
    worked = 0.0
    for attempt in range(MOST_STOPS):
        clear(push)
        clear_band(band)
        contact.add_impulses(cable, before, push, band)
        add_lines(cable, cable.linear.mass, 1.0, band)
        hold(cable, directions, directions, band)
        set_border(cable, directions, directions)
        stiffen_border(cable, band)
        work.results.coupled = IN_STATE
        if not eliminate(band, cable.n * lines, lines):  # not for positive masses
            contact.clear_stopped(cable)
            return 0.0
        solve_border(cable, band, SOFT)
        to_unknowns(cable, push, solved)
        solve_constrained(cable, band, directions, directions, NO, solved)
        copy(before, v)
        for d in range(lines):
            for i in range(cable.n):
                v[d, MARGIN + i] += solved[PADDING + i * lines + d]
        last = attempt + 1 == MOST_STOPS
        settled, worked = contact.validate_impulses(cable, tau, v, last)
        if settled:
            break
    lost = kinetic(cable, before) - kinetic(cable, v) + worked
    add(1.0, v, state.w)
    add(-1.0, before, state.w)
    # Impulses of the grasps, from the momentum that those of contact do not explain.
    clear(push)
    contact.add_impulses(cable, v, push, band)
    difference(v, before, before)
    for d in range(lines):
        add_product(mass_of(cable, d), -1.0, before[d], push[d])
    to_unknowns(cable, push, solved)
    for k in range(cable.rows.count):
        work.multipliers[k] = 0.0
    take_reactions(cable, directions, work.multipliers)
    driven = 0.0
    target_rates(cable, state.x, t)
    for k in range(cable.rows.count):
        driven += work.multipliers[k] * work.rates[k]
        work.row_force[k] += work.multipliers[k] / tau
    state.balance.drive_work += worked + driven
    return lost + driven


@kernel(void, CABLE, float64, float64, float64, float64, family=IMPLICIT)
def finish_step(cable, t0, tau, whole, lost):
    """Update w, the mean reactions, and the energy balance.

    The work of the grasps is that of the reactions, and the loss of kinetic energy of the
    prescribed motion, which the energy balance does not contain.

    Args:
        whole: length of the step [s] over which reactions are averaged. lost: energy [J] dissipated
            by damping.
    """
    state, work, balance = cable.state, cable.work, cable.state.balance
    change, ahead = work.change, work.rate
    moves = grasps_move(cable)
    if cable.terms & CONTACT:
        learn_extrapolated_share(cable)
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            speed = load(work.start_v, line, c)
            store(ahead, line, c, without_tiny(2.0 / tau * load(change, line, c) - speed))
    driven = 0.0
    if moves:
        for k in range(cable.rows.count):
            driven += row_value(cable, k, work.middle_direction, change) * work.row_force[k]
        driven += prescribed_energy(cable, work.old_direction, work.old_inverse, work.start_v)
        driven -= prescribed_energy(cable, state.direction, state.inverse, ahead)
    copy(ahead, state.w)
    if cable.terms & STATIC_TWIST:  # `ahead` would alternate, undamped without inertia
        for c in range(cable.columns):
            state.w[cable.dim, c] = change[cable.dim, c] / tau
    if moves:
        project(cable, state.w, work.multipliers)
    if balance.known > 0.0 and balance.length_before == tau and is_viscous(cable):
        lost += settle_overdamped(cable, moves, tau)
    if cable.terms & CONTACT:
        lost += stop_contacts(cable, t0 + tau, tau)
    balance.dissipated += lost
    if cable.loads.count:
        balance.load_work += inner(work.load, change)
    driven += anchor_work(cable, work.start, state.x)
    rolled = roll_loss(cable, change)
    balance.dissipated += rolled[0]
    balance.drive_work += driven + rolled[1]
    accept_anchors(cable)
    accept_slides(cable, work.start, state.x)
    for k in range(cable.rows.count):
        state.reaction[k] += tau / whole * work.row_force[k]
    balance.known += 1.0


# -- the iteration ------------------------------------------------------------------------------


@inline
def allowed_error(balance, tolerance, inertia, room):
    """Energy error [J] allowed in this step: `tolerance` times the energy exchanged so far, reduced
    to TIGHT times an energy scale as the error of the balance approaches `room` tolerances.

    The scale includes `floor` and the work against inertia, so that a run can start at rest.
    """
    loose = tolerance * balance.exchanged - balance.error / room
    scale = max(balance.exchanged, max(balance.floor, 0.1 * inertia))
    return max(loose, min(tolerance, TIGHT) * scale)


@inline
def may_keep(cable, a):
    """Whether a step may start with the matrix of an earlier one: it has the same factor a of the
    mass, and no wait is due (`judge_matrix`).
    """
    balance = cable.state.balance
    return balance.matrix_weight == a and balance.matrix_wait == 0.0


@inline
def judge_matrix(balance, iterations, made):
    """Decide whether the next steps reuse their matrix; `made` is the iteration in which the last
    matrix of this step was factorised, 0 if in an earlier step.

    If reuse cost more iterations than a new matrix would have, the next steps factorise their own:
    one step after the first such setback in a row, two after the second, then four, ...
    """
    if made > 0:
        balance.matrix_shrinking = 1.0
    if made == 1:
        balance.matrix_wait = max(balance.matrix_wait - 1.0, 0.0)
    elif made > 1 or iterations > MOST_WITH_KEPT:
        balance.matrix_wait = 2.0**balance.matrix_setbacks
        balance.matrix_setbacks = min(balance.matrix_setbacks + 1.0, MOST_SETBACKS)
    else:
        balance.matrix_setbacks = 0.0
        if iterations == 1:
            balance.matrix_shrinking = min(FORGETTING * balance.matrix_shrinking, 1.0)


@inline
def linearize(cable, t0, tau, discrete, tension):
    """Factorise the Jacobian with this tension: PREDICTED by the last correction, that of the
    PRESENT shape, or that of the LAST step. Returns whether the factors exist.
    """
    if tension == LAST:
        before = cable.state.history[1] if cable.state.balance.known > 0.0 else cable.work.start
        take_tension(cable, before, cable.work.start)
    elif tension == PRESENT:
        begin, end = between(cable, discrete)
        take_tension(cable, begin, end)
    return newton_matrix(cable, t0, tau, 2.0 / (tau * tau), discrete)


@inline
def beyond_prediction(cable, number, discrete):
    """What correction `number` stretched beyond the predicted tension (`tension.unpredicted`)."""
    take_nudge(cable, number)
    begin, end = between(cable, discrete)
    return unpredicted(cable, begin, end, cable.work.nudge)


@inline
def expected_contraction(cable, iteration, ratio, comparable, made):
    """Factor by which a correction is expected to reduce the energy error: from the `ratio` of its
    energy to that of the last one, where both are `comparable`; in the first iteration with the
    matrix of an earlier step (`made` is 0), as the one remembered.
    """
    balance = cable.state.balance
    shrinking = 1.0
    if comparable and iteration > 1:
        shrinking = max(np.sqrt(ratio), SMALLEST_SHRINKING)
        if iteration == 2:
            balance.matrix_shrinking = shrinking
    elif made == 0 and iteration == 1:
        shrinking = balance.matrix_shrinking
    # What contracts only now may do so by touching something else.
    return 1.0 if cable.terms & CONTACT and iteration > TRUSTING else shrinking


@inline
def needs_forces(cable, reach, error, allowed):
    """Whether a converged step needs the forces after the last correction.

    The work of moving or sliding grasps does, unless all is at rest. So does the loss by damping,
    which that correction changes by about its `error` [J]; without contact and twist, motions are
    too smooth for that to matter.
    """
    terms = cable.terms
    lossy = terms & (CONTACT | BISHOP) != 0 and terms & (DAMPED | STATIC_TWIST) != 0
    driven = grasps_move(cable) or terms & SLIDING != 0
    moved = driven and largest(cable.work.change, 0, cable.lines) > ROUND_OFF * reach
    return moved or (lossy and error > allowed)


@inline
def iterate(cable, method, t0, tau, careful, predicts):
    """Alternate forces and corrections until the energy error of the step is small.

    Returns whether that converged, the number of iterations, that in which the matrix was
    factorised, 0 if in an earlier step, the energy [J] dissipated by damping, and the round-off of
    the energy balance [J] where corrections end in it.
    """
    work, balance = cable.work, cable.state.balance
    discrete, tolerance = method.conserves_energy != 0, method.tolerance
    a = 2.0 / (tau * tau)
    reach = largest(cable.state.x, 0, cable.dim)  # scale of the round-off of corrections
    room = SPARE * ROOM if cable.terms & CONTACT else ROOM
    mixed = predicts or cable.physics.keeps_length != 0.0
    most = MAX_ITERATIONS if careful else MAX_BOLD
    converged = False
    iterations, made = 0, 0
    previous = np.inf
    renew = not may_keep(cable, a)  # whether the next iteration needs a new matrix
    stretched = False  # whether the last correction may have stretched the cable
    stiff = False  # whether a correction stretched the cable more than Broyden's may
    slope = 0.0  # residual . correction before the last correction
    share = 1.0  # of the last correction that x contains
    stalls = 0  # successive stalled corrections
    known = np.int64(0)  # corrections since the matrix was factorised
    lost, floor, allowed, first = 0.0, 0.0, 0.0, 0.0
    touched = np.int64(0)  # what touched at the last forces
    work.results.coupled = IN_STATE
    # Share of the flow at the configuration at which the forces of the step are evaluated.
    balance.slip = 0.5 if discrete else 1.0
    while True:
        lost = step_force(cable, t0, tau, discrete)
        if iterations == 0:  # the forces set the rows of rolls
            set_border(cable, work.middle_direction, cable.state.direction)
            if not renew:  # Z is in working memory, and so lost after a step
                solve_border(cable, cable.state.matrix, 0.5)
        inertia = set_residual(cable, a, a * tau)
        if converged or iterations == most:
            break
        iterations += 1
        # Where a correction changes what touches or slides, the residual along it says nothing: a
        # wall that it runs into pushes back at once. Such corrections are taken whole, as in a
        # method of active sets, and halved where they go round in circles.
        changed = known > 0 and work.touched[0] != touched and iterations <= HALVED
        if changed and iterations > WHOLE and share == 1.0:
            share = 0.5
            shorten(cable, known - 1, 1.0, share)
            renew = True
            continue
        renew = renew or changed
        if known > 0:
            along = dot(work.residual, work.corrections[known - 1])
            if stretched:
                energy, extra = beyond_prediction(cable, known - 1, discrete)
                # A matrix that was made before the cable turned stretches it.
                stiff = stiff or energy > allowed
                renew = renew or stiff
                along += extra
            overshot = careful and not changed and not abs(along) <= GROWTH * abs(slope)
            if overshot and share > SMALLEST_SHARE:
                # Shorten the last correction and continue with a new matrix. Where what sticks to
                # an obstacle slips, one of Broyden's may point the wrong way: it is undone. (Not
                # where strands touch: undoing let a thin knot come undone.)
                touches = cable.terms & (CONTACT | SELF) == CONTACT
                wrong = touches and known > 1 and slope < 0.0
                less = 0.0 if wrong else share * shortened(abs(slope), along)
                shorten(cable, known - 1, share, less)
                share = less
                renew = True
                continue
        if renew or known == MOST_CORRECTIONS:
            tension = PREDICTED if stretched else PRESENT
            tension = LAST if iterations == 1 and mixed else tension
            if not linearize(cable, t0, tau, discrete, tension):
                break
            known, made = np.int64(0), iterations
        allowed = allowed_error(balance, tolerance, inertia, room)
        energy, slope, defect, moved, stretched = correct(cable, known, discrete, allowed, reach)
        stretched = stretched and mixed
        known += 1
        first = moved if iterations == 1 else first
        hopeless = not careful and iterations >= HOPELESS and moved > first
        if not energy < 1e300 or hopeless:
            break
        stalls = stalls + 1 if energy > STALLED * previous else 0
        comparable = share == 1.0 and work.touched[0] == touched
        shrinking = expected_contraction(cable, iterations, energy / previous, comparable, made)
        share, touched = 1.0, work.touched[0]
        exhausted = moved <= ROUND_OFF or (stalls > 1 and moved <= NOISE)
        converged = exhausted or min(SAFETY * shrinking, 1.0) * defect <= allowed
        if converged and cable.terms & CONTACT:
            contact.add_force(cable, YES, cable.state.x, work.rate)
            converged = exhausted or work.touched[0] == touched
        if exhausted:
            # Corrections are round-off: the energy balance cannot be more accurate than this.
            floor = RESOLUTION * defect
        if converged and not needs_forces(cable, reach, max(energy, defect), allowed):
            break
        renew = energy > SLOW * previous and not converged
        previous = energy
    return converged, iterations, made, lost, floor


@inline
def is_valid(cable, tau, level, halvings):
    """Whether a step that converged may be accepted, after `level` of at most `halvings`: Newton's
    method may converge to a cable that is folded over or passes through itself or an obstacle.
    """
    valid = level >= CAREFUL_HALVINGS or not turned_over(cable)
    if valid and cable.terms & SELF:
        valid = self_contact.validate(cable, tau, level, halvings - level)
    if valid and cable.terms & CONTACT:
        valid = contact.validate(cable, cable.work.change)
    return valid


@inline
def accept_step(cable, t0, tau, whole, lost):
    """Make the configuration that was found that at the end of the step (`finish_step`)."""
    if cable.terms & SELF:
        self_contact.commit(cable)
    finish_step(cable, t0, tau, whole, lost)
    if cable.terms & CONTACT:
        contact.commit(cable, tau)
    cable.state.balance.slip = 0.5  # the energy balance takes the mean with both methods
    flow(cable, t0 + tau)


@kernel(
    *(boolean, CABLE, METHOD),
    *(float64, float64, float64, int64, boolean, boolean),
    family=IMPLICIT,
)
def try_step(cable, method, t0, tau, whole, level, careful, predicts):
    """One step in place, of which `results.evaluations` counts the iterations; returns whether it
    converged. If not, x, w, the constraints and the multipliers of a constant length are restored.

    It is a part of a step of length `whole`, over which reactions are averaged, that was halved
    `level` times. If `careful`, corrections that overshoot are shortened; if `predicts`, the
    tangent has the tension that the last correction predicted (`engine.tension`). At low levels, a
    step that folds the cable over (`turned_over`), or lets it pass through itself, counts as not
    converged.

    The matrix is reused, across steps too, while the iteration contracts fast (`judge_matrix`). It
    belongs to the state, so that a run continues bitwise identically from a snapshot.
    """
    balance = cable.state.balance
    begin_step(cable, t0, tau)
    if cable.terms & SELF and self_contact.too_many(cable, level, method.halvings - level):
        undo_step(cable)
        return False
    converged, iterations, made, lost, floor = iterate(cable, method, t0, tau, careful, predicts)
    judge_matrix(balance, iterations, made)
    converged = converged and is_valid(cable, tau, level, method.halvings)
    if converged:
        balance.floor = max(balance.floor, floor)
        accept_step(cable, t0, tau, whole, lost)
    else:
        undo_step(cable)
    balance.slip = 0.0
    cable.work.results.evaluations += iterations
    return converged


# -- a whole step ------------------------------------------------------------------------------


@kernel(boolean, METHOD, CABLE, int64, float64, terms=IMPLICIT)
def implicit_step(method, cable, step, tau):
    """Step number `step`, of length tau, in the substeps of a composition method, each halved where
    Newton's method does not converge; returns whether it succeeded.
    """
    results = cable.work.results
    begun, budget = results.evaluations, max(BUDGET // (cable.n * cable.lines), LEAST_BUDGET)
    whole = 1 << MAX_HALVINGS
    for k in range(cable.rows.count):
        cable.state.reaction_before[k] = cable.state.reaction[k]
        cable.state.reaction[k] = 0.0
    at = 0.0
    for k in range(method.stages):
        t0, length = step * tau + at * tau, method.substeps[k] * tau
        # Contact changes its mind, and twist acts on the shape in second order of a step: only
        # without them does Newton's method converge quadratically, or soon is hopeless. A cable
        # that is stretched by far is not stiff along itself: a tension predicted to first order is
        # then worse than that of the shape.
        keeps_length = cable.physics.keeps_length != 0.0
        wary = cable.terms & (CONTACT | SELF | BISHOP) != 0 and not keeps_length
        careful = wary
        level, done = 0, 0  # `done` in units of 2^-MAX_HALVINGS of the substep
        while done < whole:
            one = whole >> level
            begin = t0 + length * done / whole
            predicts = level < CAREFUL_HALVINGS and (wary or not careful)
            if try_step(cable, method, begin, length * one / whole, tau, level, careful, predicts):
                done += one
                # Double again only where the longer piece is aligned, so that pieces nest.
                if level > 0 and done % (2 * one) == 0:
                    level -= 1
                careful = wary or level >= CAREFUL_HALVINGS
            elif not careful:  # the same again
                careful = True
            elif level == method.halvings or results.evaluations - begun > budget:
                return False
            else:
                level += 1
                careful = wary or level >= CAREFUL_HALVINGS
        at += method.substeps[k]
    cable.state.balance.reactions = min(cable.state.balance.reactions + 1.0, 2.0)
    return True
