"""Implicit steps along given motions of the grasps."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES
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
    axes,
):
    """Steps, each with its own `width` numbers of the motions of all grasps, (steps, width), and
    its own axis (steps, 3) of the natural moments; returns (status, steps done, Newton iterations).

    What turning that axis changes in energy is work of the grasps.
    """
    shape, model, inputs, state, scratch = bared(cable)
    used, at = 0, shape[layout.MOTION]
    for k in range(steps):
        for j in range(width):
            inputs[at + j] = motions[k * width + j]
        if len(moments):
            before = potential(shape, model, state, scratch, engine.pieces[1])
            for j in range(len(moments)):
                state[shape[layout.NATURAL] + j] = moments[j] * axes[3 * k + (j // LANES) % 3]
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
