"""Implicit steps: one Newton loop for the energy-momentum method, the implicit midpoint rule and
the generalised-alpha method.

All three are a momentum balance in the unknown q1, tested with motions that keep what is held,
    M (a (q1 - q0) - b v0 - c a0) = f(q0, q1),
where f is minus the discrete gradient (`energy_momentum`) or the force at q0 + theta (q1 - q0),
plus loads and damping there. The midpoint rule and the energy-momentum method have theta = 1/2,
a = 2 / tau^2, b = 2 / tau, c = 0; `core.methods` holds the generalised-alpha constants. Newton's
method uses the exact tangent of everything but the geometry inside the viscosity. A step whose
iteration does not converge is taken back and done in halves, quarters, ... of its length. The twist
line is linear and always integrated by the midpoint rule.

Where a clamp turns, its force acts along its directions at the middle of the step, and its
conditions hold at the end: symmetric, and exact in the energy account.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, bare, first, load, shifted, store
from dlo_sim.compiling.pieces import (
    COUNTS,
    NOTHING,
    NUMBERS,
    REAL,
    REALS,
    TABLE,
    TRUTH,
    WHOLE,
    WHOLES,
    part,
    piece,
)
from dlo_sim.engine.account import (
    COUNT,
    RESOLUTION,
    book,
    measure,
    notes_of,
    update_account,
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
    turn_vector,
)
from dlo_sim.engine.border import balance_border, set_border, solve_border, stiffen_border
from dlo_sim.engine.discrete import discrete_force
from dlo_sim.engine.forces import add_weight, energies
from dlo_sim.engine.held import (
    add_shifts,
    add_velocity_of_held,
    aim,
    defects,
    directions_turn,
    grasps_move,
    pin,
    project,
    row_value,
    through_inverse,
    turn_to_aim,
    values_along,
)
from dlo_sim.engine.layout import (
    AHEAD,
    BETA,
    BORDER,
    DAMPED,
    DIM,
    DIRECTION,
    DIRECTION_ROWS,
    DISSIPATED,
    DIVERGED,
    DRIVE_WORK,
    ENERGY,
    ENERGY_ERROR,
    ENERGY_START,
    EXCHANGED,
    FLOOR,
    FORCE,
    GRAVITY,
    HAS_REACTION,
    HELD,
    HISTORY,
    INVERSE,
    KNOWN,
    LEDGER,
    LINE,
    LINES,
    LOAD_WORK,
    LOADS,
    MARGIN,
    MASS,
    NEW_LOAD,
    NOT_CONVERGED,
    OK,
    RATES,
    REACTION,
    SIZE,
    SYSTEM,
    TARGETS,
    TERMS,
    TWISTED,
    VISCOUS,
    N,
    W,
    X,
)
from dlo_sim.engine.lines import add, add_product, clear, copy, difference, mass_of, row_product
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.engine.springs import (
    anchor_work,
    book_anchors,
    move_anchors,
    restore_anchors,
    spring_force,
)
from dlo_sim.engine.tables import line_of
from dlo_sim.engine.tangent import add_tangent
from dlo_sim.methods.implicit_layout import (
    BAND,
    CHANGE,
    COAST,
    CORRECTIONS,
    DAMPING_FORCE,
    FACTORS_OF_SAMPLES,
    FORCE_OF_HELD,
    INERTIA,
    MIDDLE,
    MIDDLE_DIRECTION,
    MOST_CORRECTIONS,
    OLD_DIRECTION,
    OLD_INVERSE,
    SEEN,
    START,
    START_V,
    TRAVEL,
    residual_of,
)
from dlo_sim.methods.newton import (
    apply_step,
    correct,
    dot,
    largest,
    predict,
    shortened,
    turned_over,
)
from dlo_sim.methods.twist_step import solve_twist

MAX_ITERATIONS = 40  # force evaluations before a step is halved
MAX_HALVINGS = 12
CAREFUL_HALVINGS = 4  # of a step that turns a part of the cable over; then that is its motion
SLOW = 0.02  # ratio of successive correction energies above which the matrix is renewed
STALLED = 0.2  # ratio of correction energies from which small corrections are round-off
GROWTH = 1.0  # of the residual along a correction beyond which the correction is shortened
SMALLEST_SHARE = 1e-6  # of a correction; below, the step is halved
NOISE = 1e-9  # largest share of the coordinates that such corrections may have
BUDGET = 300_000  # unknowns times iterations per step, with all its pieces: some 30 ms
LEAST_BUDGET = 500  # iterations per step
ROOM = 10.0  # tolerances that the energy account may be off by in the long run
TIGHT = 1e-10  # tolerance of steps once it is
SAFETY = 10.0  # on the shrinking of the next correction
SMALLEST_SHRINKING = 1e-3  # of corrections that is believed
ROUND_OFF = 1e-14  # corrections below this share of the coordinates are round-off
THETA, MASS_WEIGHT, NEWMARK_BETA, NEWMARK_GAMMA, INERTIA_WEIGHT = 0, 1, 2, 3, 4  # of `constants`


@piece(
    *(REAL, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, discrete_force),
    *(REAL, REAL, REAL, REAL, TRUTH),
)
def step_force(shape, model, inputs, state, scratch, discrete_force, t, tau, theta, rate, discrete):
    """All forces of the step between START and the present configuration into FORCE.

    CHANGE is what is between the two. Damping sees the velocity at theta; tau times it is SEEN:
    rate (q1 - q0) + COAST, which is q1 - q0 for the midpoint family. Returns the energy lost to
    damping.
    """
    x, force = shifted(state, shape[X]), shifted(scratch, shape[FORCE])
    start, change = shifted(scratch, shape[START]), shifted(scratch, shape[CHANGE])
    middle, seen = shifted(scratch, shape[MIDDLE]), shifted(scratch, shape[SEEN])
    damping, coast = shifted(scratch, shape[DAMPING_FORCE]), shifted(scratch, shape[COAST])
    loads, notes = shifted(scratch, shape[NEW_LOAD]), notes_of(shape, scratch)
    clear(shape, force)
    clear(shape, loads)
    clear(shape, damping)
    for at in range(0, shape[SIZE], LANES):
        moved = load(change, at)
        store(middle, at, load(start, at) + theta * moved)
        store(seen, at, rate * moved + load(coast, at))
    viscous = model[shape[BETA]] / tau if shape[TERMS] & DAMPED else 0.0
    if discrete:
        discrete_force(shape, model, state, start, x, seen, viscous, force, notes)
    else:
        discrete_force(shape, model, state, middle, middle, seen, viscous, force, notes)
    lost = notes[0]
    if shape[TERMS] & GRAVITY:
        add_weight(shape, model, force)
    spring_force(shape, model, state, middle, theta, force)
    if shape[LOADS]:
        load_force(shape, model, inputs, scratch, middle, t + theta * tau, loads)
        add(shape, 1.0, loads, force)
    if shape[TERMS] & DAMPED:
        for line in range(shape[LINES]):
            matrix = shape[VISCOUS] + mass_of(shape, line) - shape[MASS]
            add_product(shape, model, matrix, line, -1.0 / tau, seen, damping)
        add(shape, 1.0, damping, force)
        lost -= first(row_product(shape, damping, change))
    return lost


@part
def balance(shape, model, state, scratch, a, b, c):
    """Residual of the momentum balance into RESIDUAL, in the frames of the clamps, and what is
    missing on held rows into FORCE_OF_HELD. Returns the size of the work against inertia.
    """
    dim, n, width = shape[DIM], shape[N], shape[LINE]
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    acceleration = shifted(state, shape[HISTORY] + 2 * shape[SIZE])
    row, push = shifted(scratch, shape[SEEN]), shifted(scratch, shape[INERTIA])
    force, residual = shifted(scratch, shape[FORCE]), residual_of(shape, scratch)
    for at in range(0, dim * width, LANES):
        f = a * load(change, at) - b * load(speed, at)
        store(row, at, f - c * load(acceleration, at))
        store(push, at, 0.0)
    inertia = 0.0
    for d in range(dim):
        add_product(shape, model, shape[MASS], d, 1.0, row, push)
        for i in range(n):
            at = d * width + MARGIN + i
            inertia += abs(push[at] * change[at])
            residual[i * dim + d] = force[at] - push[at]
    turn_vector(shape, shifted(scratch, shape[MIDDLE_DIRECTION]), True, residual)
    for k in range(shape[HELD]):
        own, line = own_point(shape, k), line_of(shape, k)
        if own >= 0 and line < dim:
            d = line
            if line < 0:
                d = 1 if clamps_here(shape, k) else 2
            store(scratch, shape[FORCE_OF_HELD] + k * LANES, -residual[own * dim + d])
    clear_held(shape, residual)
    balance_border(shape, scratch, residual, shifted(scratch, shape[FORCE_OF_HELD]))
    return inertia


@piece(
    *(TRUTH, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, add_tangent),
    *(REAL, REAL, REAL, REAL, REAL, TRUTH),
)
def newton_matrix(
    shape, model, inputs, state, scratch, add_tangent, t, tau, a, theta, rate, discrete
):
    """Tangent of the momentum balance into BAND, factorised; whether that went well."""
    band, x = shifted(scratch, shape[BAND]), shifted(state, shape[X])
    start, middle = shifted(scratch, shape[START]), shifted(scratch, shape[MIDDLE])
    factors = shifted(scratch, shape[FACTORS_OF_SAMPLES])
    clear_band(shape, band)
    add_lines(shape, model, shape[MASS], a, band)
    viscous = 0.0
    if shape[TERMS] & DAMPED:
        add_lines(shape, model, shape[VISCOUS], rate / tau, band)
        viscous = model[shape[BETA]] * rate / (2.0 * theta * tau)
    if discrete:
        add_tangent(shape, model, state, start, x, viscous, 2.0 * theta, factors, band)
    else:
        add_tangent(shape, model, state, middle, middle, viscous, 2.0 * theta, factors, band)
    add_springs(shape, model, theta, band)
    add_load_stiffness(shape, model, inputs, middle, t + theta * tau, theta, band)
    rows = shifted(scratch, shape[MIDDLE_DIRECTION])
    hold(shape, rows, shifted(state, shape[DIRECTION]), band)
    stiffen_border(shape, scratch, band)
    if not eliminate(band, shape[N] * shape[DIM], shape[DIM]):
        return False
    solve_border(shape, scratch, band)
    return True


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, TRUTH),
    *(REAL, REAL, REAL, REAL, REAL),
)
def begin_step(shape, model, inputs, state, scratch, newmark, t0, tau, theta, rate, g):
    """First guess: the history goes on, and what is held is placed where it is at the end.

    START_V becomes the velocity at the begin, where nothing moves that of w; MIDDLE_DIRECTION and
    DIRECTION the directions at the middle and at the end; CHANGE and COAST are set.
    """
    x, w = shifted(state, shape[X]), shifted(state, shape[W])
    start, speed = shifted(scratch, shape[START]), shifted(scratch, shape[START_V])
    coast, change = shifted(scratch, shape[COAST]), shifted(scratch, shape[CHANGE])
    directions = shape[HELD] * DIRECTION_ROWS * LANES
    moves = grasps_move(shape, inputs)
    copy(shape, x, start)
    copy(shape, w, speed)
    for at in range(directions):
        scratch[shape[OLD_DIRECTION] + at] = state[shape[DIRECTION] + at]
        scratch[shape[MIDDLE_DIRECTION] + at] = state[shape[DIRECTION] + at]
    for at in range(shape[HELD] * shape[HELD] * LANES):
        scratch[shape[OLD_INVERSE] + at] = state[shape[INVERSE] + at]
    if moves:
        add_velocity_of_held(shape, model, inputs, state, scratch, x, t0, speed)
    predict(shape, state, x, w, tau)
    if not moves:
        keep_held(shape, model, state, scratch, start, x)
    if moves:
        aim(shape, model, inputs, scratch, t0 + 0.5 * tau)
        for k in range(shape[HELD]):
            if line_of(shape, k) < 0:
                for at in range(DIRECTION_ROWS * LANES * k, DIRECTION_ROWS * LANES * (k + 1)):
                    scratch[shape[MIDDLE_DIRECTION] + at] = scratch[shape[AHEAD] + at]
        aim(shape, model, inputs, scratch, t0 + tau)
        if directions_turn(shape, state, scratch):
            turn_to_aim(shape, model, state, scratch)
        defects(shape, model, state, shape[DIRECTION], scratch, x)
        add_shifts(shape, model, state, scratch, 1.0, x)
        for k in range(shape[HELD]):
            pin(shape, k, load(scratch, shape[TARGETS] + k * LANES), x)
        move_anchors(shape, inputs, state, t0 + tau)
    middle_rows, end_rows = (
        shifted(scratch, shape[MIDDLE_DIRECTION]),
        shifted(state, shape[DIRECTION]),
    )
    set_border(shape, model, scratch, middle_rows, end_rows)
    difference(shape, x, start, change)
    clear(shape, coast)
    if newmark:
        acceleration = shifted(state, shape[HISTORY] + 2 * shape[SIZE])
        driven = shifted(scratch, shape[TRAVEL])
        clear(shape, driven)
        # the change is the travel P (x - start) and what moving grasps carry along
        copy(shape, change, coast)
        if moves:
            time, middle = t0 + theta * tau, shifted(scratch, shape[MIDDLE])
            copy(shape, start, middle)
            add(shape, theta, change, middle)
            aim(shape, model, inputs, scratch, time)
            turn_to_aim(shape, model, state, scratch)
            add_velocity_of_held(shape, model, inputs, state, scratch, middle, time, driven)
            project(shape, model, state, scratch, coast, scratch, shape[SYSTEM])
            aim(shape, model, inputs, scratch, t0 + tau)
            turn_to_aim(shape, model, state, scratch)
        for at in range(shape[SIZE]):
            carried = change[at] - coast[at]
            if at < shape[DIM] * shape[LINE]:
                free = (1.0 - rate) * w[at] + g * tau * acceleration[at]
                coast[at] = tau * (free + driven[at]) - rate * carried
            else:
                coast[at] = (1.0 - rate) * carried


@part
def keep_held(shape, model, state, scratch, start, x):
    """Leave what is held where it is: a parabola through equal numbers is not equal to them, and
    what it is off by would grow from step to step.
    """
    width, dim = shape[LINE], shape[DIM]
    for k in range(shape[HELD]):
        own, line = own_point(shape, k), line_of(shape, k)
        at = MARGIN + own
        if own >= 0 and line >= 0:
            x[line * width + at] = start[line * width + at]
        elif own >= 0:
            e = shape[DIRECTION] + DIRECTION_ROWS * LANES * k
            away = 0.0
            for d in range(dim):
                away += state[e + d * LANES] * (x[d * width + at] - start[d * width + at])
            for d in range(dim):
                x[d * width + at] -= away * state[e + d * LANES]
    if shape[BORDER]:
        difference(shape, start, x, shifted(scratch, shape[CHANGE]))
        values_along(shape, model, state, scratch, shifted(scratch, shape[CHANGE]))
        add_shifts(shape, model, state, scratch, 1.0, x)


@part
def undo_step(shape, state, scratch):
    """The state at the begin of the step; what is known of the motion before is forgotten."""
    copy(shape, shifted(scratch, shape[START]), shifted(state, shape[X]))
    for at in range(shape[HELD] * DIRECTION_ROWS * LANES):
        state[shape[DIRECTION] + at] = scratch[shape[OLD_DIRECTION] + at]
    for at in range(shape[HELD] * shape[HELD] * LANES):
        state[shape[INVERSE] + at] = scratch[shape[OLD_INVERSE] + at]
    restore_anchors(shape, state)
    state[shape[LEDGER] + KNOWN * LANES] = 0.0


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, TRUTH),
    *(REAL, REAL, REAL, REAL, TRUTH),
)
def finish_step(
    shape, model, inputs, state, scratch, constants, newmark, t0, tau, whole, lost, dissipates
):
    """Momentum after the step, reactions, and the step's entries in the account."""
    x, w = shifted(state, shape[X]), shifted(state, shape[W])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    travel, held = shifted(scratch, shape[TRAVEL]), shape[HELD]
    moves = grasps_move(shape, inputs)
    if shape[TERMS] & TWISTED:
        lost += solve_twist(shape, model, inputs, scratch, x, t0, tau)
        hold_of_twist(shape, model, scratch, tau)
    work = 0.0
    ahead = shifted(scratch, shape[SEEN])
    for at in range(shape[SIZE]):
        ahead[at] = 2.0 / tau * change[at] - speed[at]
    if moves:
        if newmark:
            carry_inertia(shape, model, state, scratch, constants, tau)
        for k in range(held):
            f = row_value(shape, model, k, scratch, shape[MIDDLE_DIRECTION], change)
            work += first(f * load(scratch, shape[FORCE_OF_HELD] + k * LANES))
        work += held_energy(shape, model, state, scratch, speed, True)
        work -= held_energy(shape, model, state, scratch, ahead, False)
    copy(shape, change, travel)
    if newmark and moves:
        project(shape, model, state, scratch, travel, scratch, shape[SYSTEM])
    acceleration = shifted(state, shape[HISTORY] + 2 * shape[SIZE])
    beta, gamma = constants[NEWMARK_BETA], constants[NEWMARK_GAMMA]
    for at in range(shape[SIZE]):
        w0, a0 = w[at], acceleration[at]
        if newmark and at < shape[DIM] * shape[LINE]:
            a1 = (travel[at] / tau - w0 - tau * (0.5 - beta) * a0) / (tau * beta)
            w[at] = w0 + tau * ((1.0 - gamma) * a0 + gamma * a1)
            acceleration[at] = a1
        else:
            w[at] = ahead[at]
            if dissipates:
                acceleration[at] = (w[at] - w0) / tau
    if moves:
        project(shape, model, state, scratch, w, scratch, shape[SYSTEM])
        if dissipates:
            project(shape, model, state, scratch, acceleration, scratch, shape[SYSTEM])
    if not dissipates:
        book(shape, state, DISSIPATED, lost)
    loads, start = shifted(scratch, shape[NEW_LOAD]), shifted(scratch, shape[START])
    if shape[LOADS]:
        book(shape, state, LOAD_WORK, row_product(shape, loads, change))
    book(shape, state, DRIVE_WORK, work + first(anchor_work(shape, model, state, start, x)))
    book_anchors(shape, state)
    for k in range(held):
        at = shape[REACTION] + k * LANES
        share = tau / whole * first(load(scratch, shape[FORCE_OF_HELD] + k * LANES))
        store(state, at, load(state, at) + share)
    state[shape[LEDGER] + HAS_REACTION * LANES] = 1.0
    state[shape[LEDGER] + KNOWN * LANES] += 1.0


@part
def carry_inertia(shape, model, state, scratch, constants, tau):
    """Add to FORCE_OF_HELD the inertia of what moving grasps carry: the accelerations of the
    generalised-alpha method are those of the free motion alone.
    """
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    acceleration = shifted(state, shape[HISTORY] + 2 * shape[SIZE])
    push = shifted(scratch, shape[INERTIA])
    weight, beta = constants[INERTIA_WEIGHT], constants[NEWMARK_BETA]
    c = weight * (0.5 - beta) - constants[MASS_WEIGHT]
    clear(shape, push)
    for at in range(shape[DIM] * shape[LINE]):
        gain = (change[at] - tau * speed[at]) / (tau * tau)
        push[at] = (2.0 - weight) * gain + c * acceleration[at]
    for k in range(shape[HELD]):
        f = row_value(shape, model, k, scratch, shape[MIDDLE_DIRECTION], push)
        store(scratch, shape[RATES] + k * LANES, f)
    through_inverse(shape, state, shape[INVERSE], scratch, 1.0, scratch, shape[SYSTEM])
    for k in range(shape[HELD]):
        at = shape[FORCE_OF_HELD] + k * LANES
        f = load(scratch, shape[SYSTEM] + k * LANES)
        store(scratch, at, load(scratch, at) + f)


@part
def held_energy(shape, model, state, scratch, v, old):
    """Kinetic energy [J] of the motion of what is held, (B v)^T S^-1 (B v) / 2, with the directions
    at the begin of the step or those of the state.
    """
    held = shape[HELD]
    for k in range(held):
        f = row_value(shape, model, k, state, shape[DIRECTION], v)
        if old:
            f = row_value(shape, model, k, scratch, shape[OLD_DIRECTION], v)
        store(scratch, shape[RATES] + k * LANES, f)
    if old:
        through_inverse(shape, scratch, shape[OLD_INVERSE], scratch, 0.5, scratch, shape[SYSTEM])
    else:
        through_inverse(shape, state, shape[INVERSE], scratch, 0.5, scratch, shape[SYSTEM])
    energy = 0.0
    for k in range(held):
        energy += scratch[shape[SYSTEM] + k * LANES] * scratch[shape[RATES] + k * LANES]
    return energy


@part
def hold_of_twist(shape, model, scratch, tau):
    """What is missing on held rows of the twist, into FORCE_OF_HELD."""
    line, dim = shape[DIM], shape[DIM]
    at = line * shape[LINE]
    row, push = shifted(scratch, shape[SEEN]), shifted(scratch, shape[INERTIA])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    force = shifted(scratch, shape[FORCE])
    for k in range(at, at + shape[LINE]):
        row[k] = 2.0 / tau * (change[k] / tau - speed[k])
        push[k] = -force[k]
    add_product(shape, model, mass_of(shape, line), line, 1.0, row, push)
    for k in range(shape[HELD]):
        if line_of(shape, k) == dim:
            f = row_value(shape, model, k, scratch, shape[OLD_DIRECTION], push)
            store(scratch, shape[FORCE_OF_HELD] + k * LANES, f)


@part
def allowed_defect(shape, state, tolerance, inertia):
    """Energy [J] that this step may leave unaccounted for.

    The errors of many steps do not add up: it falls to TIGHT as the account's error approaches ROOM
    tolerances. What is no exchange of energy, inertia at the start or round-off, counts only so.
    """
    ledger = shape[LEDGER]
    exchanged = state[ledger + EXCHANGED * LANES]
    loose = tolerance * exchanged - state[ledger + ENERGY_ERROR * LANES] / ROOM
    scale = max(exchanged, max(state[ledger + FLOOR * LANES], 0.1 * inertia))
    return max(loose, min(tolerance, TIGHT) * scale)


PARTS_OF_STEP = (begin_step, step_force, newton_matrix, finish_step, discrete_force, add_tangent)
"""The pieces of one implicit step."""


@piece(
    *((TRUTH, WHOLE), TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, PARTS_OF_STEP),
    *(NUMBERS, REAL, REAL, REAL, TRUTH, REAL, TRUTH),
)
def implicit_step(
    shape,
    model,
    inputs,
    state,
    scratch,
    pieces,
    constants,
    t0,
    tau,
    whole,
    discrete,
    tolerance,
    careful,
):
    """One step in place: whether it converged, and its iterations. On failure the state is
    unchanged.

    It is a part of a step of length `whole`, over which reactions are averaged. `careful`: one that
    turns an edge of the control polygon over does not count as converged.

    The matrix is factorised at the first guess and kept while corrections shrink fast.
    """
    _, begin_step, step_force, newton_matrix, finish_step, discrete_force, add_tangent = pieces
    ledger = shape[LEDGER]
    # The generalised-alpha method needs an acceleration; its first step is one by the midpoint
    # rule.
    dissipates = constants[THETA] != 0.5
    newmark = dissipates and state[ledger + KNOWN * LANES] > 0.0
    theta, a, c, rate, g = 0.5, 2.0 / (tau * tau), 0.0, 1.0, 0.0
    if newmark:
        beta, gamma = constants[NEWMARK_BETA], constants[NEWMARK_GAMMA]
        theta, a = constants[THETA], constants[INERTIA_WEIGHT] / (tau * tau)
        c = constants[INERTIA_WEIGHT] * (0.5 - beta) - constants[MASS_WEIGHT]
        rate = theta * gamma / beta
        g = theta * (1.0 - gamma) - rate * (0.5 - beta)
    b = a * tau
    size = shape[N] * shape[DIM]
    x, start = shifted(state, shape[X]), shifted(scratch, shape[START])
    change, residual = shifted(scratch, shape[CHANGE]), residual_of(shape, scratch)
    begin_step(shape, model, inputs, state, scratch, newmark, t0, tau, theta, rate, g)
    reach = largest(shape, x)  # size of the configuration, for the iteration's round-off floor
    moves = grasps_move(shape, inputs)
    converged = False
    iterations = 0
    previous = np.inf
    # Of the types that they keep: a literal would have numba compile what it is passed to twice.
    linearize = iterations == 0
    slope = 0.0  # |residual . correction| before the last correction
    share = 1.0  # of the last correction that is in x
    stalls = 0  # corrections in a row that did not get smaller
    known = np.int64(0)  # corrections since the matrix was made
    lost = 0.0
    while True:
        lost = step_force(
            shape, model, inputs, state, scratch, discrete_force, t0, tau, theta, rate, discrete
        )
        inertia = balance(shape, model, state, scratch, a, b, c)
        if converged or iterations == MAX_ITERATIONS:
            break
        iterations += 1
        if known > 0:
            last = shifted(scratch, shape[CORRECTIONS] + (known - 1) * (size + 1))
            along = dot(residual, last, size)
            if not abs(along) <= GROWTH * slope and share > SMALLEST_SHARE:
                # Too far: back on the way that the last correction went, and on with a new matrix.
                less = share * shortened(slope, along)
                apply_step(shape, state, scratch, known - 1, less - share, x, change)
                share = less
                linearize = True
                continue
        if linearize or known == MOST_CORRECTIONS:
            if not newton_matrix(
                shape, model, inputs, state, scratch, add_tangent, t0, tau, a, theta, rate, discrete
            ):
                break
            known = np.int64(0)
        energy, slope, defect, moved = correct(shape, state, scratch, known, x, change)
        known += 1
        if not energy < 1e300:
            break
        stalls = stalls + 1 if energy > STALLED * previous else 0
        # The correction just made leaves about `shrinking` of the defect.
        shrinking = 1.0
        if share == 1.0 and iterations > 1:
            shrinking = max(np.sqrt(energy / previous), SMALLEST_SHRINKING)
        share = 1.0
        exhausted = moved <= ROUND_OFF * reach or (stalls > 1 and moved <= NOISE * reach)
        allowed = allowed_defect(shape, state, tolerance, inertia)
        converged = exhausted or min(SAFETY * shrinking, 1.0) * defect <= allowed
        if exhausted:
            # The coordinates have no digits left: the account cannot be better than this.
            at = ledger + FLOOR * LANES
            state[at] = max(state[at], RESOLUTION * defect)
        # What moving grasps do is booked with the forces after the last correction.
        if converged and not moves:
            break
        linearize = energy > SLOW * previous and not converged
        previous = energy
    # Newton's method may find a cable folded through itself, at no cost in energy.
    if converged and careful:
        converged = not turned_over(shape, x, start, change)
    if converged:
        finish_step(
            shape,
            model,
            inputs,
            state,
            scratch,
            constants,
            newmark,
            t0,
            tau,
            whole,
            lost,
            dissipates,
        )
    else:
        undo_step(shape, state, scratch)
    return converged, iterations


@part
def absorb_loss(shape, model, state, scratch):
    """Book what the method itself dissipated, for energies just measured; energy it adds stays an
    error."""
    at, notes = shape[LEDGER], notes_of(shape, scratch)
    total = notes[0]
    for k in range(COUNT):
        total += state[at + (ENERGY + k) * LANES]
    missing = state[at + ENERGY_START * LANES] + state[at + LOAD_WORK * LANES]
    missing += state[at + DRIVE_WORK * LANES] - state[at + DISSIPATED * LANES] - total
    if missing > 0.0:
        state[at + DISSIPATED * LANES] += missing


ENGINE = (energies, update_account, end_sample, implicit_step, PARTS_OF_STEP)
"""The pieces that the loop calls."""


@piece(
    *(COUNTS, WHOLES, REALS, REALS, REALS, REALS, ENGINE, REALS, REALS, TRUTH, REAL),
    *(WHOLE, WHOLE, WHOLE, REAL, REALS, REALS, REALS, WHOLES),
)
def advance_implicit(
    shape,
    model,
    inputs,
    state,
    scratch,
    engine,
    constants,
    substeps,
    discrete,
    tolerance,
    halvings,
    first_step,
    steps,
    tau,
    times,
    samples,
    powers,
    marks,
):
    """Advance by whole steps; returns (status, steps done, Newton iterations).

    `substeps` are the lengths of the parts that a step is composed of, in units of the step.
    `halvings` (at most MAX_HALVINGS) is how often a step may be halved. The energy account is
    updated every step.
    """
    _, look, update, end_sample, implicit_step, pieces = engine
    parts = len(substeps)
    shape, model, inputs = bare(shape), bare(model), bare(inputs)
    state, scratch, constants, substeps = (
        bare(state),
        bare(scratch),
        bare(constants),
        bare(substeps),
    )
    times, samples, powers, marks = bare(times), bare(samples), bare(powers), bare(marks)
    iterations = 0
    budget = max(BUDGET // (shape[N] * shape[DIM]), LEAST_BUDGET)
    whole = 1 << MAX_HALVINGS
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        begun = iterations
        sampling = begin_sample(shape, model, inputs, state, scratch, times, marks, t0, tau)
        for k in range(shape[HELD]):
            store(state, shape[REACTION] + k * LANES, 0.0)
        at = 0.0
        for k in range(parts):
            part_t, part_tau = t0 + at * tau, substeps[k] * tau
            # Done in smaller pieces where Newton's method does not converge.
            level, done = 0, 0  # `done` in units of the part 2^-MAX_HALVINGS
            while done < whole:
                one = whole >> level
                converged, used = implicit_step(
                    shape, model, inputs, state, scratch, pieces, constants,
                    part_t + part_tau * done / whole, part_tau * one / whole, tau,
                    discrete, tolerance, level < CAREFUL_HALVINGS,
                )  # fmt: skip
                iterations += used
                if converged:
                    done += one
                    # Grow again only where the larger piece is aligned, so that pieces nest.
                    if level > 0 and done % (2 * one) == 0:
                        level -= 1
                elif level == halvings or iterations - begun > budget:
                    return NOT_CONVERGED, step - first_step, iterations
                else:
                    level += 1
            at += substeps[k]
        if constants[THETA] != 0.5:
            measure(shape, model, state, scratch, look)
            absorb_loss(shape, model, state, scratch)
        if not update(shape, model, state, scratch, look):
            return DIVERGED, step - first_step, iterations
        if sampling:
            end_sample(
                shape,
                model,
                inputs,
                state,
                scratch,
                look,
                update,
                times,
                samples,
                powers,
                marks,
                t0,
                tau,
            )
    return OK, steps, iterations
