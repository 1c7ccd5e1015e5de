"""Dynamic relaxation: steps in time with kinetic damping until a cable rests (Cundall 1976)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.stepper import Stepper

RESTS = 3
FREQUENCY = 6  # row of a load, after force and moment


def relax_in_time(
    cable: Cable,
    stepper: Stepper,
    stop: Callable[[], None],
    tolerance: float,
    max_steps: int,
) -> bool:
    """Let a cable come to rest from its present shape; whether it did. Sine loads are left out.

    Whenever the kinetic energy falls, `stop` takes the velocity away, until the cable moves by less
    than `tolerance` [of the length, or of 1 rad] between two stops three times in a row. Where it
    does not within `max_steps` steps, it is left as it was.
    """
    state, inputs = cable.state.copy(), cable.inputs.copy()
    peak, still = 0.0, 0
    try:
        if cable.loads.size:
            cable.loads[cable.loads[:, FREQUENCY] > 0.0, :FREQUENCY] = 0.0
        stop()
        resting = cable.x.copy()
        for _ in range(max_steps):
            if not stepper.run(0, 1).status.ok:
                break
            kinetic = cable.kinetic()
            if kinetic > peak:
                peak = kinetic
                continue
            stop()
            still = still + 1 if relative_movement(cable, resting) < tolerance else 0
            if still == RESTS:
                return True
            resting[:] = cable.x
            peak = 0.0
    finally:
        cable.inputs[:] = inputs
    cable.state[:] = state
    return False


def relative_movement(cable: Cable, before: NDArray[np.float64]) -> float:
    """Largest movement from configuration `before`, relative to the length or 1 rad."""
    moved = np.abs(cable.x - before).max(axis=1)
    dim = len(cable.model.axes)
    return float(max(moved[:dim].max() / cable.model.knots[-1], moved[dim:].max(initial=0.0)))
