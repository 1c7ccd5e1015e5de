"""The end of an implicit step: momentum variable, reactions, entries in the energy ledger."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, shifted, store, total, zero
from dlo_sim.compiling.pieces import (
    NO,
    NOTHING,
    NUMBERS,
    REAL,
    TABLE,
    TRUTH,
    YES,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.account import (
    add_to_ledger,
)
from dlo_sim.engine.band import clear_held, substitute, turn_vector
from dlo_sim.engine.border import keep_border
from dlo_sim.engine.held import (
    grasps_move,
    project,
    row_value,
    through_inverse,
)
from dlo_sim.engine.lines import add_product, clear, copy, row_product
from dlo_sim.engine.springs import (
    accept_anchors,
    anchor_work,
    roll_loss,
)
from dlo_sim.methods.implicit_layout import (
    CHANGE,
    FORCE_OF_HELD,
    INERTIA,
    INERTIA_WEIGHT,
    MASS_WEIGHT,
    MIDDLE_DIRECTION,
    NEWMARK_BETA,
    NEWMARK_GAMMA,
    OLD_DIRECTION,
    OLD_INVERSE,
    SEEN,
    START,
    START_V,
    STEP,
    TRAVEL,
    residual_of,
)
from dlo_sim.methods.step_equations import is_viscous
from dlo_sim.methods.twist_step import end_twist


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, end_twist, NUMBERS, TRUTH),
    *(REAL, REAL, REAL, REAL, TRUTH),
)
def finish_step(
    shape,
    model,
    inputs,
    state,
    scratch,
    end_twist,
    constants,
    newmark,
    t0,
    tau,
    whole,
    lost,
    dissipates,
):
    """Update w and the acceleration, the mean reactions, and the energy ledger."""
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    travel, held = shifted(scratch, shape[TRAVEL]), shape[layout.HELD]
    moves = grasps_move(shape, inputs)
    static = shape[layout.TERMS] & layout.STATIC_TWIST != 0
    lost += end_twist(shape, model, inputs, state, scratch, t0, tau)
    work = 0.0
    ahead = shifted(scratch, shape[SEEN])
    for at in range(shape[layout.SIZE]):
        ahead[at] = 2.0 / tau * change[at] - speed[at]
    if moves:
        if newmark:
            carry_inertia(shape, model, state, scratch, constants, tau)
        for k in range(held):
            f = row_value(shape, model, k, scratch, shape[MIDDLE_DIRECTION], change)
            work += first(f * load(scratch, shape[FORCE_OF_HELD] + k * LANES))
        work += held_energy(shape, model, state, scratch, speed, YES)
        work -= held_energy(shape, model, state, scratch, ahead, NO)
    copy(shape, change, travel)
    if newmark and moves:
        project(shape, model, state, scratch, travel, scratch, shape[layout.SYSTEM])
    acceleration = shifted(state, shape[layout.HISTORY] + 2 * shape[layout.SIZE])
    beta, gamma = constants[NEWMARK_BETA], constants[NEWMARK_GAMMA]
    for at in range(shape[layout.SIZE]):
        w0, a0 = w[at], acceleration[at]
        if newmark and at < shape[layout.DIM] * shape[layout.LINE]:
            a1 = (travel[at] / tau - w0 - tau * (0.5 - beta) * a0) / (tau * beta)
            w[at] = w0 + tau * ((1.0 - gamma) * a0 + gamma * a1)
            acceleration[at] = a1
        else:
            w[at] = ahead[at]
            if at >= shape[layout.DIM] * shape[layout.LINE] and static:
                w[at] = change[at] / tau  # `ahead` would alternate, undamped without inertia
            if dissipates:
                acceleration[at] = (w[at] - w0) / tau
    if moves:
        project(shape, model, state, scratch, w, scratch, shape[layout.SYSTEM])
        if dissipates:
            project(shape, model, state, scratch, acceleration, scratch, shape[layout.SYSTEM])
    ledger = shape[layout.LEDGER]
    known = state[ledger + layout.KNOWN * LANES] > 0.0
    if not dissipates and known and state[ledger + layout.LENGTH_BEFORE * LANES] == tau:
        if is_viscous(shape, model):
            lost += settle_overdamped(shape, model, state, scratch, moves, tau)
    if not dissipates:
        add_to_ledger(shape, state, layout.DISSIPATED, lost)
    loads, start = shifted(scratch, shape[layout.NEW_LOAD]), shifted(scratch, shape[START])
    if shape[layout.LOADS]:
        add_to_ledger(shape, state, layout.LOAD_WORK, row_product(shape, loads, change))
    work += first(anchor_work(shape, model, state, start, x))
    add_to_ledger(shape, state, layout.DRIVE_WORK, work + roll_loss(shape, model, state, change)[1])
    accept_anchors(shape, state)
    for k in range(held):
        at = shape[layout.REACTION] + k * LANES
        share = tau / whole * first(load(scratch, shape[FORCE_OF_HELD] + k * LANES))
        store(state, at, load(state, at) + share)
    state[shape[layout.LEDGER] + layout.HAS_REACTION * LANES] = 1.0
    state[shape[layout.LEDGER] + layout.KNOWN * LANES] += 1.0


@part
def settle_overdamped(shape, model, state, scratch, moves, tau):
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
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    w, start = shifted(state, shape[layout.W]), shifted(scratch, shape[START])
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    before = shifted(state, shape[layout.HISTORY] + shape[layout.SIZE])
    apart, push = shifted(scratch, shape[SEEN]), shifted(scratch, shape[INERTIA])
    step, solved = shifted(scratch, shape[STEP]), residual_of(shape, scratch)
    clear(shape, apart)
    alternating, mean = zero(), zero()
    for at in range(0, dim * width, LANES):
        moved = load(change, at)
        smooth = 0.5 * (moved - (load(start, at) - load(before, at)))
        row = (moved - smooth) * (1.0 / tau) - load(speed, at)
        store(apart, at, row)
        alternating += row * row
        mean += moved * moved
    if total(alternating) * tau * tau <= total(mean):
        return 0.0
    if moves:
        project(shape, model, state, scratch, apart, scratch, shape[layout.SYSTEM])
    for _ in range(3):
        clear(shape, push)
        for d in range(dim):
            add_product(shape, model, shape[layout.MASS], d, 2.0 / (tau * tau), apart, push)
            for i in range(n):
                solved[i * dim + d] = push[d * width + layout.MARGIN + i]
        turn_vector(shape, shifted(scratch, shape[MIDDLE_DIRECTION]), YES, solved)
        clear_held(shape, solved)
        substitute(shifted(state, shape[layout.MATRIX]), n * dim, dim, solved)
        keep_border(shape, scratch, solved)
        for r in range(n * dim):
            step[r] = solved[r]
        turn_vector(shape, shifted(state, shape[layout.DIRECTION]), NO, step)
        for d in range(dim):
            for i in range(n):
                apart[d * width + layout.MARGIN + i] -= step[i * dim + d]
    if moves:
        project(shape, model, state, scratch, apart, scratch, shape[layout.SYSTEM])
    clear(shape, push)
    for d in range(dim):
        add_product(shape, model, shape[layout.MASS], d, 1.0, apart, push)
    loss = 0.0
    for at in range(dim * width):
        loss += push[at] * (w[at] - 0.5 * apart[at])
    if loss <= 0.0:
        return 0.0
    for at in range(dim * width):
        w[at] -= apart[at]
    return loss


@part
def carry_inertia(shape, model, state, scratch, constants, tau):
    """Add to FORCE_OF_HELD the inertia of the prescribed motion, which the accelerations of the
    generalised-alpha method, those of the free motion, do not contain.
    """
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    acceleration = shifted(state, shape[layout.HISTORY] + 2 * shape[layout.SIZE])
    push = shifted(scratch, shape[INERTIA])
    weight, beta = constants[INERTIA_WEIGHT], constants[NEWMARK_BETA]
    c = weight * (0.5 - beta) - constants[MASS_WEIGHT]
    clear(shape, push)
    for at in range(shape[layout.DIM] * shape[layout.LINE]):
        gain = (change[at] - tau * speed[at]) / (tau * tau)
        push[at] = (2.0 - weight) * gain + c * acceleration[at]
    for k in range(shape[layout.HELD]):
        f = row_value(shape, model, k, scratch, shape[MIDDLE_DIRECTION], push)
        store(scratch, shape[layout.RATES] + k * LANES, f)
    through_inverse(
        shape, state, shape[layout.INVERSE], scratch, 1.0, scratch, shape[layout.SYSTEM]
    )
    for k in range(shape[layout.HELD]):
        at = shape[FORCE_OF_HELD] + k * LANES
        f = load(scratch, shape[layout.SYSTEM] + k * LANES)
        store(scratch, at, load(scratch, at) + f)


@part
def held_energy(shape, model, state, scratch, v, old):
    """Kinetic energy [J] of the prescribed motion, (B v)^T S^-1 (B v) / 2, with the directions at
    the start of the step (`old`) or at its end.
    """
    held = shape[layout.HELD]
    for k in range(held):
        f = row_value(shape, model, k, state, shape[layout.DIRECTION], v)
        if old:
            f = row_value(shape, model, k, scratch, shape[OLD_DIRECTION], v)
        store(scratch, shape[layout.RATES] + k * LANES, f)
    if old:
        through_inverse(
            shape, scratch, shape[OLD_INVERSE], scratch, 0.5, scratch, shape[layout.SYSTEM]
        )
    else:
        through_inverse(
            shape, state, shape[layout.INVERSE], scratch, 0.5, scratch, shape[layout.SYSTEM]
        )
    energy = 0.0
    for k in range(held):
        energy += (
            scratch[shape[layout.SYSTEM] + k * LANES] * scratch[shape[layout.RATES] + k * LANES]
        )
    return energy
