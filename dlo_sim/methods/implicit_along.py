"""Implicit steps along given motions of the grasps."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES
from dlo_sim.compiling.pieces import (
    COUNTS,
    REAL,
    REALS,
    TRUTH,
    WHOLE,
    WHOLES,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.methods import implicit


@piece(
    *(COUNTS, implicit.advance_implicit, WHOLES, REALS, REALS, REALS, REALS, implicit.ENGINE),
    *(REALS, REALS, TRUTH, REAL, WHOLE, WHOLE, REAL, REALS, REALS, REALS, WHOLES),
    *(WHOLE, WHOLE, REALS, REALS, REALS),
)
def advance_along(
    advance,
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
    first,
    tau,
    times,
    samples,
    powers,
    marks,
    steps,
    width,
    motions,
    moments,
    axes,
):
    """Steps, each with its own `width` numbers of the motions of all grasps, (steps, width), and
    its own axis (steps, 3) of the natural moments; returns (status, steps done, Newton iterations).
    """
    used, at = 0, shape[layout.MOTION]
    for k in range(steps):
        for j in range(width):
            inputs[at + j] = motions[k * width + j]
        for j in range(moments.shape[0]):
            state[shape[layout.NATURAL] + j] = moments[j] * axes[3 * k + (j // LANES) % 3]
        status, _, iterations = advance(
            shape, model, inputs, state, scratch, engine, constants, substeps, discrete,
            tolerance, halvings, first + k, 1, tau, times, samples, powers, marks,
        )  # fmt: skip
        used += iterations
        if status != layout.OK:
            return status, k, used
    return layout.OK, steps, used
