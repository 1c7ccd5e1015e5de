"""Prescribed motion of the held rows (`engine.held`): drift, target rates, work."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, store, zero
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import MOTION_SIZE, place, rates, turned
from dlo_sim.engine.held import (
    add_shifts,
    component,
    component3,
    directions_turn,
    fill_system,
    grasps_move,
    invert,
    pin,
    point_value,
    project,
    set_targets,
    take_directions,
    target_residuals,
    values_along,
)
from dlo_sim.engine.lines import add, kinetic
from dlo_sim.engine.tables import grasp_of, line_of, point_of


@part
def add_moved(shape, state, scratch, share):
    """MOVED += share RATES."""
    for k in range(shape[layout.HELD]):
        at = shape[layout.MOVED] + k * LANES
        store(state, at, load(state, at) + share * load(scratch, shape[layout.RATES] + k * LANES))


@part
def clear_moved(shape, state):
    """MOVED = 0."""
    for at in range(shape[layout.HELD] * LANES):
        state[shape[layout.MOVED] + at] = 0.0


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS),
    *(NUMBERS, NUMBERS, REAL, REAL),
)
def carry(shape, model, inputs, state, scratch, x, w, t, dt):
    """Drift over dt to time t: x += dt w, then x += Y (targets - B x).

    MOVED += displacement of the held rows, the mean of those along the directions before and after.
    Where directions turn, the constraint impulses change the kinetic energy of w; this is added to
    the work of the grasps. dt = 0 is a jump: x only moves onto the constraints.
    """
    held = shape[layout.HELD]
    moves = grasps_move(shape, inputs)
    turn = False
    energy = zero()
    if moves:
        set_targets(shape, model, inputs, state, scratch, t)
        turn = directions_turn(shape, state, scratch)
        target_residuals(shape, model, scratch, shape[layout.AHEAD], scratch, x)
        add_moved(shape, state, scratch, 0.5 if turn else 1.0)
        if turn:
            energy = kinetic(shape, model, w)
            values_along(shape, model, state, scratch, x)
            add_moved(shape, state, scratch, -0.5)
    add(shape, dt, w, x)
    if not moves:
        return
    target_residuals(shape, model, scratch, shape[layout.AHEAD], scratch, x)
    if turn and dt == 0.0:
        take_directions(shape, model, state, scratch)  # a jump uses the new directions
    elif turn:
        fill_system(
            shape, model, scratch, scratch, shape[layout.AHEAD], state, shape[layout.DIRECTION]
        )
        invert(shape, scratch, state, shape[layout.INVERSE])
    add_shifts(shape, model, state, scratch, 1.0, x)
    if turn:
        if dt != 0.0:
            add_shifts(shape, model, state, scratch, 1.0 / dt, w)
        values_along(shape, model, state, scratch, x)
        add_moved(shape, state, scratch, 0.5)
        take_directions(shape, model, state, scratch)
        project(shape, model, state, scratch, w, scratch, shape[layout.SYSTEM])
        at = shape[layout.LEDGER] + layout.DRIVE_WORK * LANES
        store(state, at, load(state, at) + kinetic(shape, model, w) - energy)
    for k in range(held):
        pin(shape, k, load(scratch, shape[layout.TARGETS] + k * LANES), x)


@part
def target_rates(shape, model, inputs, state, scratch, x, t):
    """RATES = target rates s e.A' - e'.(b.x - s A); attachment A, direction e, s = sum of b."""
    for k in range(shape[layout.HELD]):
        point = point_of(shape, k)
        line = line_of(shape, k)
        grasp = shape[layout.MOTION] + MOTION_SIZE * grasp_of(shape, k)
        share = model[shape[layout.HELD_WEIGHTS] + (layout.POINT_ROWS * point + 4) * LANES]
        v = rates(inputs, grasp, t)
        rate = 0.0
        if inputs[grasp] == 0.0:
            pass
        elif line == shape[layout.DIM]:
            rate = share * v[3]
        elif line >= 0:
            rate = share * component((v[0], v[1], v[2], 0.0), shape[layout.AXES + line])
        else:
            body = shape[layout.HELD_BODY] + layout.DIRECTION_ROWS * LANES * k
            e = turned(inputs, grasp, t, model[body], model[body + LANES], model[body + 2 * LANES])
            spin = (
                v[4 + 1] * e[2] - v[4 + 2] * e[1],
                v[4 + 2] * e[0] - v[4] * e[2],
                v[4] * e[1] - v[4 + 1] * e[0],
            )
            a = place(inputs, grasp, t)
            for d in range(shape[layout.DIM]):
                axis = shape[layout.AXES + d]
                arm = first(point_value(shape, model, point, d, x)) - share * component(a, axis)
                rate += share * component3(e, axis) * component((v[0], v[1], v[2], 0.0), axis)
                rate -= component3(spin, axis) * arm
        store(scratch, shape[layout.RATES] + k * LANES, rate)


@part
def add_velocity_of_held(shape, model, inputs, state, scratch, x, t, v):
    """v += Y (rates of the targets at time t), which makes w the velocity."""
    if not grasps_move(shape, inputs):
        return
    target_rates(shape, model, inputs, state, scratch, x, t)
    add_shifts(shape, model, state, scratch, 1.0, v)


@part
def pulled(shape, state, rows, at):
    """PULL . rows at `at`: minus the work of the grasps for displacements of the held rows, minus
    their power for rates.
    """
    f = zero()
    for k in range(shape[layout.HELD]):
        f += load(state, shape[layout.PULL] + k * LANES) * load(rows, at + k * LANES)
    return f
