"""Turning constraint directions, for methods that evaluate forces at stage times.

Where a grasp turns, its held rows B and the projection P = 1 - Y B depend on time, so the momentum
variable w = P v satisfies w' = P M^-1 f + P' v with
    P' v = - P M^-1 B'^T S^-1 B v - Y B' w.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, store, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import MOTION_SIZE, rates, turned
from dlo_sim.engine.held import (
    component3,
    directions_turn,
    grasps_move,
    project,
    row_value,
    set_targets,
    shift_row,
    take_directions,
    through_inverse,
)
from dlo_sim.engine.tables import grasp_of, line_of


@part
def set_directions(shape, model, inputs, state, scratch, t):
    """Set DIRECTION and INVERSE to those at time t."""
    if grasps_move(shape, inputs):
        set_targets(shape, model, inputs, state, scratch, t)
        if directions_turn(shape, state, scratch):
            take_directions(shape, model, state, scratch)


@part
def turns(shape, k):
    """Whether the direction of row k turns with its grasp."""
    return line_of(shape, k) < 0


@part
def direction_rates(shape, model, inputs, scratch, t):
    """AHEAD = e' = omega x e of the turning rows; return whether any is not zero."""
    found = False
    for k in range(shape[layout.HELD]):
        grasp = shape[layout.MOTION] + MOTION_SIZE * grasp_of(shape, k)
        if not turns(shape, k):
            continue
        body = shape[layout.HELD_BODY] + layout.DIRECTION_ROWS * LANES * k
        e = turned(inputs, grasp, t, model[body], model[body + LANES], model[body + 2 * LANES])
        v = rates(inputs, grasp, t)
        spin = (v[5] * e[2] - v[6] * e[1], v[6] * e[0] - v[4] * e[2], v[4] * e[1] - v[5] * e[0])
        moves = inputs[grasp] != 0.0
        for d in range(shape[layout.DIM]):
            rate = component3(spin, shape[layout.AXES + d]) if moves else 0.0
            store(scratch, shape[layout.AHEAD] + (layout.DIRECTION_ROWS * k + d) * LANES, rate)
            found = found or rate != 0.0
    return found


@part
def add_turning(shape, model, inputs, state, scratch, w, t, out):
    """out += P' v, for out = P M^-1 f and the directions at time t.

    SYSTEM must hold S^-1 B v, from `add_velocity_of_held`. Returns the power of the grasps
    w^T M P' v = - (B' w) . (S^-1 B v), a row.
    """
    power = zero()
    if not grasps_move(shape, inputs):
        return power
    if not direction_rates(shape, model, inputs, scratch, t):
        return power
    held, system, ahead = shape[layout.HELD], shape[layout.SYSTEM], shape[layout.AHEAD]
    for k in range(held):
        if turns(shape, k):
            f = load(scratch, system + k * LANES)
            shift_row(shape, model, k, scratch, ahead, -f, out)
            power -= f * row_value(shape, model, k, scratch, ahead, w)
    project(shape, model, state, scratch, out, scratch, system)
    for k in range(held):
        rate = zero()
        if turns(shape, k):
            rate = row_value(shape, model, k, scratch, ahead, w)
        store(scratch, shape[layout.RATES] + k * LANES, rate)
    through_inverse(shape, state, shape[layout.INVERSE], scratch, 1.0, scratch, system)
    for k in range(held):
        f = -load(scratch, system + k * LANES)
        shift_row(shape, model, k, state, shape[layout.DIRECTION], f, out)
    return power
