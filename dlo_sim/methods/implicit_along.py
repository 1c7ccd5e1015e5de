"""Implicit steps with a new motion of the grasps for every step."""

from __future__ import annotations

from dlo_sim.compiling.pieces import (
    COUNTS,
    REAL,
    REALS,
    TRUTH,
    WHOLE,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.bundles import CABLE, RECORDS, bared
from dlo_sim.methods import implicit
from dlo_sim.methods.works import turn_natural_shape


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
    each step, of the natural curvature vectors `moments` (`works.turn_natural_shape`).
    """
    shape, model, inputs, state, scratch = bared(cable)
    used, at = 0, shape[layout.MOTION]
    for k in range(steps):
        for j in range(width):
            inputs[at + j] = motions[k * width + j]
        if len(moments):
            turn_natural_shape(
                shape, model, state, scratch, engine.pieces[1], moments, turns, 9 * k
            )
        status, _, iterations = advance(
            cable, engine, constants, substeps, discrete,
            tolerance, halvings, first + k, 1, tau, records,
        )  # fmt: skip
        used += iterations
        if status != layout.OK:
            return status, k, used
    return layout.OK, steps, used
