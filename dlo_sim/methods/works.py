"""Work of loads and grasps between evaluations of the forces, by the trapezoidal rule; work of a
grasp that turns the natural shape of one cable, by the change of energy.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, shifted, zero
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.account import COUNT, add_to_ledger, measure, set_ledger
from dlo_sim.engine.assembly import ANY, all_forces
from dlo_sim.engine.held import grasps_move, project
from dlo_sim.engine.held_motion import clear_moved, pulled
from dlo_sim.engine.lines import add, clear, copy, gathered, solve_mass
from dlo_sim.engine.loads import load_force
from dlo_sim.engine.springs import accept_anchors, anchor_work


@part
def has_work(shape, inputs):
    """Whether loads or moving grasps do work on the cable."""
    return shape[layout.LOADS] > 0 or grasps_move(shape, inputs)


@part
def force_work(shape, force, x, before):
    """force . (x - before), a row."""
    sum_ = zero()
    for at in range(0, shape[layout.SIZE], LANES):
        sum_ += load(force, at) * (load(x, at) - load(before, at))
    return gathered(shape, sum_)


@piece(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, ANY.forces, REAL)
def evaluate(shape, model, inputs, state, scratch, forces, t):
    """FORCE = P M^-1 f at the present configuration; the work up to it goes into the ledger."""
    x, force = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.FORCE])
    loaded, before = shifted(state, shape[layout.LOADED]), shifted(state, shape[layout.BOOKED])
    is_booked = state[shape[layout.LEDGER] + layout.IS_BOOKED * LANES] != 0.0
    works = has_work(shape, inputs)
    all_forces(forces, shape, model, state, x, force)
    if shape[layout.LOADS]:
        new = shifted(scratch, shape[layout.NEW_LOAD])
        clear(shape, new)
        load_force(shape, model, inputs, scratch, x, t, new)
        add(shape, 1.0, new, force)
        if is_booked:
            done = force_work(shape, new, x, before) + force_work(shape, loaded, x, before)
            add_to_ledger(shape, state, layout.LOAD_WORK, 0.5 * done)
        copy(shape, new, loaded)
    solve_mass(shape, model, force)
    half = zero()
    if works and is_booked:
        half = pulled(shape, state, state, shape[layout.MOVED])
    if shape[layout.HELD]:
        project(shape, model, state, scratch, force, state, shape[layout.PULL])
    if works:
        if is_booked:
            done = -0.5 * (half + pulled(shape, state, state, shape[layout.MOVED]))
            if shape[layout.SPRINGS]:
                done += anchor_work(shape, model, state, before, x)
            add_to_ledger(shape, state, layout.DRIVE_WORK, done)
        reset_work(shape, state, x, before)


@part
def potential(shape, model, state, scratch, look):
    """Potential energy [J] of the present state of one cable, from `measure`."""
    measure(shape, model, state, scratch, look)
    total = 0.0
    for k in range(COUNT):
        total += state[shape[layout.LEDGER] + (layout.ENERGY + k) * LANES]
    return total


@part
def turn_natural_shape(shape, model, state, scratch, look, rows, turns, at):
    """NATURAL = `rows`, with each vector rotated by the 3 x 3 matrix at offset `at` of `turns`; the
    change of energy is work of the grasps.
    """
    before = potential(shape, model, state, scratch, look)
    for start in range(0, len(rows), layout.NATURAL_ROWS * LANES):
        for lane in range(start, start + LANES):
            x, y, z = rows[lane], rows[lane + LANES], rows[lane + 2 * LANES]
            for d in range(3):
                turned = turns[at + 3 * d] * x + turns[at + 3 * d + 1] * y
                to = shape[layout.NATURAL] + lane + d * LANES
                state[to] = turned + turns[at + 3 * d + 2] * z
            to = shape[layout.NATURAL] + lane + 3 * LANES
            state[to] = rows[lane + 3 * LANES]
    done = potential(shape, model, state, scratch, look) - before
    state[shape[layout.LEDGER] + layout.DRIVE_WORK * LANES] += done


@part
def reset_work(shape, state, x, before):
    """Mark the ledger as containing all work up to the present configuration."""
    copy(shape, x, before)
    clear_moved(shape, state)
    accept_anchors(shape, state)
    set_ledger(shape, state, layout.IS_BOOKED, 1.0)
    set_ledger(shape, state, layout.PENDING, 0.0)


@part
def estimate_pending_work(shape, model, inputs, state):
    """PENDING = work since the last evaluation, with its forces: for steps ending in a drift."""
    if has_work(shape, inputs):
        x, before = shifted(state, shape[layout.X]), shifted(state, shape[layout.BOOKED])
        done = -pulled(shape, state, state, shape[layout.MOVED])
        if shape[layout.LOADS]:
            done += force_work(shape, shifted(state, shape[layout.LOADED]), x, before)
        if shape[layout.SPRINGS]:
            done += anchor_work(shape, model, state, before, x)
        set_ledger(shape, state, layout.PENDING, done)
