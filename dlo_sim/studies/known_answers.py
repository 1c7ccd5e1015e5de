"""Known answers: what the tests of a study measure beside exact values."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Values = dict[str, object]


class Answer(NamedTuple):
    """A measured quantity beside its exact value, and the error that is allowed, relative unless
    the exact value is 0.
    """

    quantity: str
    exact: float
    value: float
    allowed: float

    @property
    def error(self) -> float:
        """Relative error, or the value where it should be 0."""
        return self.value / self.exact - 1.0 if self.exact else self.value

    @property
    def meets(self) -> bool:
        """Whether the error is at most the allowed one."""
        return abs(self.error) <= self.allowed

    @property
    def words(self) -> str:
        """The error beside the allowed one."""
        if self.exact:
            return (
                f"{self.quantity} off by {100.0 * abs(self.error):.2g} %, "
                f"allowed {100.0 * self.allowed:.2g} %"
            )
        return f"{self.quantity} {abs(self.error):.2g}, allowed {self.allowed:.2g}"


class Measured(NamedTuple):
    """Answers of one run, and the processor time [s] of its steps; of knots the rows of LOOPS."""

    answers: tuple[Answer, ...]
    seconds: float
    simulator: Simulator | None
    loops: tuple[tuple[object, ...], ...] = ()


def simulator(*values: Values, step: float, method: str = "energy_momentum") -> Simulator:
    """A simulator of merged values."""
    merged: Values = {"integrator.method": method, "integrator.step": step}
    for one in values:
        merged |= one
    return Simulator(scene_from_values(merged))


def advanced(sim: Simulator, seconds: float) -> float:
    """Advance; returns the processor time [s]."""
    began = time.process_time()
    report = sim.advance(seconds)
    if not report.status.ok:
        raise RuntimeError(f"contact: {report.message}")
    return time.process_time() - began


def motion(seconds: float, position: Array, velocity: Array, start: float = 0.0) -> EndMotion:
    """A motion at constant velocity from time `start`."""
    return EndMotion(
        start=start,
        duration=seconds,
        position=position,
        orientation=rotations.IDENTITY,
        velocity=velocity,
    )
