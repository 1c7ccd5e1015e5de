"""Implicit steps with a new motion of the grasps for every step."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, bare
from dlo_sim.compiling.pieces import (
    COUNTS,
    REAL,
    REALS,
    TRUTH,
    WHOLE,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.account import COUNT, measure
from dlo_sim.engine.bundles import CABLE, RECORDS, bared
from dlo_sim.methods import implicit


@part
def potential(shape, model, state, scratch, look):
    """Potential energy [J] of the present state."""
    measure(shape, model, state, scratch, look)
    total = 0.0
    for k in range(COUNT):
        total += state[shape[layout.LEDGER] + (layout.ENERGY + k) * LANES]
    return total


@part
def turn_natural_shape(shape, rows, size, turns, at, state):
    """NATURAL = `rows`, with each vector rotated by the 3 x 3 matrix at offset `at` of `turns`."""
    for start in range(0, size, layout.NATURAL_ROWS * LANES):
        for lane in range(start, start + LANES):
            x, y, z = rows[lane], rows[lane + LANES], rows[lane + 2 * LANES]
            for d in range(3):
                turned = turns[at + 3 * d] * x + turns[at + 3 * d + 1] * y
                to = shape[layout.NATURAL] + lane + d * LANES
                state[to] = turned + turns[at + 3 * d + 2] * z
            to = shape[layout.NATURAL] + lane + 3 * LANES
            state[to] = rows[lane + 3 * LANES]


@piece(
    *(COUNTS, implicit.advance_implicit, CABLE, implicit.ENGINE),
    *(REALS, REALS, TRUTH, REAL, WHOLE, WHOLE, REAL, RECORDS),
    *(WHOLE, WHOLE, REALS, REALS, REALS),
)
def advance_along(
    advance,
    cable,
    engine,
    constants,
    substeps,
    discrete,
    tolerance,
    halvings,
    first,
    tau,
    records,
    steps,
    width,
    motions,
    moments,
    turns,
):
    """Advance by whole steps; returns (status, steps done, Newton iterations).

    `motions`, (steps, width): numbers of all grasps in each step. `turns`, (steps, 9): rotation, in
    each step, of the natural curvature vectors `moments`, whose change of energy counts as work of
    the grasps.
    """
    shape, model, inputs, state, scratch = bared(cable)
    used, at = 0, shape[layout.MOTION]
    for k in range(steps):
        for j in range(width):
            inputs[at + j] = motions[k * width + j]
        if len(moments):
            before = potential(shape, model, state, scratch, engine.pieces[1])
            turn_natural_shape(shape, bare(moments), len(moments), turns, 9 * k, state)
            turned = potential(shape, model, state, scratch, engine.pieces[1]) - before
            state[shape[layout.LEDGER] + layout.DRIVE_WORK * LANES] += turned
        status, _, iterations = advance(
            cable, engine, constants, substeps, discrete,
            tolerance, halvings, first + k, 1, tau, records,
        )  # fmt: skip
        used += iterations
        if status != layout.OK:
            return status, k, used
    return layout.OK, steps, used
