"""Known answers: what the tests of study contact measure beside exact values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.loading import flat_keys, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import Timed

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


class Answers(NamedTuple):
    """Answers of a test, the processor time [s] of its steps, its last simulator; of knots the rows
    of LOOPS.
    """

    answers: tuple[Answer, ...]
    seconds: float
    simulator: Simulator | None
    loops: tuple[tuple[object, ...], ...] = ()


def answered(sims: Timed | list[Timed], *answers: Answer) -> Answers:
    """Answers of one or several simulators."""
    every = [sims] if isinstance(sims, Timed) else sims
    return Answers(answers, sum(one.seconds for one in every), every[-1])


def simulator(*values: Mapping[str, object], step: float) -> Timed:
    """A simulator of merged values, nested or not, with energy_momentum."""
    merged: Values = {"integrator.method": "energy_momentum", "integrator.step": step}
    for one in values:
        merged |= flat_keys(one)
    return Timed(scene_from_values(merged))
