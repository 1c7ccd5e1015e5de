"""Dynamic relaxation: steps in time with kinetic damping until a cable rests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dlo_sim.engine import layout
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.stepper import Loop

RESTS = 3
FREQUENCY = 6  # row of a load, after force and moment


def settle(
    cable: Cable,
    loop: Loop,
    step: float,
    stop: Callable[[], None],
    rest: float = 1e-7,
    most: int = 40_000,
) -> bool:
    """Let a cable come to rest from its present shape; whether it did. Sine loads are left out.

    Whenever the kinetic energy falls, `stop` takes the velocity away (Cundall's dynamic
    relaxation), until the cable moves by less than `rest` [of the length, or of 1 rad] between two
    stops three times in a row. Where it does not in `most` steps, it is left as it was.
    """
    dim = len(cable.model.axes)
    scale = np.ones((len(cable.x), 1))
    scale[:dim] = float(cable.model.knots[-1])
    nothing = Recorder(cable.model, np.zeros(0))
    kept = cable.state.copy(), cable.inputs.copy()
    if cable.loads.size:
        cable.loads[cable.loads[:, FREQUENCY, 0] > 0.0, :FREQUENCY] = 0.0
    peak, still = 0.0, 0
    stop()
    resting = cable.x.copy()
    for _ in range(most):
        if loop(cable, 0, 1, step, nothing)[0] != layout.OK:
            break
        kinetic = cable.kinetic()
        if kinetic >= peak:
            peak = kinetic
            continue
        stop()
        moved = float((np.abs(cable.x - resting) / scale).max())
        still = still + 1 if moved < rest else 0
        if still == RESTS:
            break
        resting[:] = cable.x
        peak = 0.0
    cable.inputs[:] = kept[1]
    if still < RESTS:
        cable.state[:] = kept[0]
    return still == RESTS
