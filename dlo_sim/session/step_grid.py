"""The grid of the simulator's steps in the time base."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass
class StepGrid:
    """Start times of the simulator's steps in the time base.

    Attributes:
        origin_ns: time base [ns] of step 0.
        step: duration tau of a step [s].
    """

    origin_ns: int
    step: float

    def time_of(self, index: int) -> int:
        """Time base [ns] at the start of step `index`."""
        return self.origin_ns + round(index * self.step * 1e9)

    def last_at_or_before(self, base_ns: int) -> int:
        """The last step index whose start is not after `base_ns`."""
        index = math.floor((base_ns - self.origin_ns) / (self.step * 1e9))
        while self.time_of(index + 1) <= base_ns:
            index += 1
        while self.time_of(index) > base_ns:
            index -= 1
        return index

    def first_at_or_after(self, base_ns: int) -> int:
        """The first step index whose start is not before `base_ns`."""
        index = self.last_at_or_before(base_ns)
        return index if self.time_of(index) == base_ns else index + 1


def grid_multiple_at_or_after(base_ns: int, step: float) -> int:
    """The first integer multiple of the step [s] at or after `base_ns` [ns]: where a simulation may
    begin.
    """
    step_ns = max(1, round(step * 1e9))
    return -(-base_ns // step_ns) * step_ns
