"""The start of an implicit step: predictor and prescribed motion; and undoing a rejected step."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, shifted
from dlo_sim.compiling.pieces import (
    NOTHING,
    NUMBERS,
    REAL,
    TABLE,
    TRUTH,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.band import (
    own_point,
)
from dlo_sim.engine.border import set_border
from dlo_sim.engine.held import (
    add_shifts,
    directions_turn,
    grasps_move,
    pin,
    project,
    set_targets,
    take_directions,
    target_residuals,
    values_along,
)
from dlo_sim.engine.held_motion import add_velocity_of_held
from dlo_sim.engine.lines import add, clear, copy, difference
from dlo_sim.engine.springs import (
    move_anchors,
    restore_anchors,
)
from dlo_sim.engine.tables import line_of
from dlo_sim.methods.implicit_layout import (
    CHANGE,
    MIDDLE,
    MIDDLE_DIRECTION,
    OLD_DIRECTION,
    OLD_INVERSE,
    SEEN_FIXED,
    START,
    START_V,
    TRAVEL,
)
from dlo_sim.methods.newton import (
    predict,
)


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, TRUTH),
    *(REAL, REAL, REAL, REAL, REAL),
)
def begin_step(shape, model, inputs, state, scratch, newmark, t0, tau, theta, rate, g):
    """Predict the configuration at the end of the step and move its held rows to their targets.

    Sets START_V, the velocity at the start; MIDDLE_DIRECTION and DIRECTION, those at the middle and
    at the end of the step; the anchors of springs; CHANGE and SEEN_FIXED.
    """
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    start, speed = shifted(scratch, shape[START]), shifted(scratch, shape[START_V])
    fixed, change = shifted(scratch, shape[SEEN_FIXED]), shifted(scratch, shape[CHANGE])
    directions = shape[layout.HELD] * layout.DIRECTION_ROWS * LANES
    moves = grasps_move(shape, inputs)
    copy(shape, x, start)
    copy(shape, w, speed)
    for at in range(directions):
        scratch[shape[OLD_DIRECTION] + at] = state[shape[layout.DIRECTION] + at]
        scratch[shape[MIDDLE_DIRECTION] + at] = state[shape[layout.DIRECTION] + at]
    for at in range(shape[layout.HELD] * shape[layout.HELD] * LANES):
        scratch[shape[OLD_INVERSE] + at] = state[shape[layout.INVERSE] + at]
    if moves:
        add_velocity_of_held(shape, model, inputs, state, scratch, x, t0, speed)
    predict(shape, state, x, w, tau)
    if not moves:
        keep_held(shape, model, state, scratch, start, x)
    if moves:
        set_targets(shape, model, inputs, state, scratch, t0 + 0.5 * tau)
        for k in range(shape[layout.HELD]):
            if line_of(shape, k) < 0:
                for at in range(
                    layout.DIRECTION_ROWS * LANES * k, layout.DIRECTION_ROWS * LANES * (k + 1)
                ):
                    scratch[shape[MIDDLE_DIRECTION] + at] = scratch[shape[layout.AHEAD] + at]
        set_targets(shape, model, inputs, state, scratch, t0 + tau)
        if directions_turn(shape, state, scratch):
            take_directions(shape, model, state, scratch)
        target_residuals(shape, model, state, shape[layout.DIRECTION], scratch, x)
        add_shifts(shape, model, state, scratch, 1.0, x)
        for k in range(shape[layout.HELD]):
            pin(shape, k, load(scratch, shape[layout.TARGETS] + k * LANES), x)
        move_anchors(shape, model, inputs, state, t0 + tau)
    middle_rows, end_rows = (
        shifted(scratch, shape[MIDDLE_DIRECTION]),
        shifted(state, shape[layout.DIRECTION]),
    )
    set_border(shape, model, scratch, middle_rows, end_rows)
    difference(shape, x, start, change)
    clear(shape, fixed)
    if newmark:
        acceleration = shifted(state, shape[layout.HISTORY] + 2 * shape[layout.SIZE])
        driven = shifted(scratch, shape[TRAVEL])
        clear(shape, driven)
        # SEEN = rate P CHANGE + tau ((1 - rate) w + g tau acceleration + motion of the grasps)
        copy(shape, change, fixed)
        if moves:
            time, middle = t0 + theta * tau, shifted(scratch, shape[MIDDLE])
            copy(shape, start, middle)
            add(shape, theta, change, middle)
            set_targets(shape, model, inputs, state, scratch, time)
            take_directions(shape, model, state, scratch)
            add_velocity_of_held(shape, model, inputs, state, scratch, middle, time, driven)
            project(shape, model, state, scratch, fixed, scratch, shape[layout.SYSTEM])
            set_targets(shape, model, inputs, state, scratch, t0 + tau)
            take_directions(shape, model, state, scratch)
        for at in range(shape[layout.SIZE]):
            carried = change[at] - fixed[at]
            if at < shape[layout.DIM] * shape[layout.LINE]:
                free = (1.0 - rate) * w[at] + g * tau * acceleration[at]
                fixed[at] = tau * (free + driven[at]) - rate * carried
            else:
                fixed[at] = (1.0 - rate) * carried


@part
def keep_held(shape, model, state, scratch, start, x):
    """Restore the held rows after extrapolation, whose round-off would grow from step to step. For
    grasps at rest.
    """
    width, dim = shape[layout.LINE], shape[layout.DIM]
    for k in range(shape[layout.HELD]):
        own, line = own_point(shape, k), line_of(shape, k)
        at = layout.MARGIN + own
        if own >= 0 and line >= 0:
            x[line * width + at] = start[line * width + at]
        elif own >= 0:
            e = shape[layout.DIRECTION] + layout.DIRECTION_ROWS * LANES * k
            away = 0.0
            for d in range(dim):
                away += state[e + d * LANES] * (x[d * width + at] - start[d * width + at])
            for d in range(dim):
                x[d * width + at] -= away * state[e + d * LANES]
    if shape[layout.BORDER]:
        difference(shape, start, x, shifted(scratch, shape[CHANGE]))
        values_along(shape, model, state, scratch, shifted(scratch, shape[CHANGE]))
        add_shifts(shape, model, state, scratch, 1.0, x)


@part
def undo_step(shape, state, scratch):
    """Restore the state at the start of the step; discard the history and the matrix."""
    copy(shape, shifted(scratch, shape[START]), shifted(state, shape[layout.X]))
    for at in range(shape[layout.HELD] * layout.DIRECTION_ROWS * LANES):
        state[shape[layout.DIRECTION] + at] = scratch[shape[OLD_DIRECTION] + at]
    for at in range(shape[layout.HELD] * shape[layout.HELD] * LANES):
        state[shape[layout.INVERSE] + at] = scratch[shape[OLD_INVERSE] + at]
    restore_anchors(shape, state)
    state[shape[layout.LEDGER] + layout.KNOWN * LANES] = 0.0
    state[shape[layout.LEDGER] + layout.MATRIX_WEIGHT * LANES] = 0.0
