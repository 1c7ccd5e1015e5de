"""Grids in the time base: of the simulator's steps, and of the published states."""

from __future__ import annotations

import math
from dataclasses import dataclass

_JITTER = 500_000  # [ns]: usual jitter of ticks; at most a quarter of the period is used


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
    """The first multiple of the step [s], rounded to 1 ns, at or after `base_ns` [ns], where a
    simulation may begin.
    """
    step_ns = max(1, round(step * 1e9))
    return -(-base_ns // step_ns) * step_ns


class OutputGrid:
    """Times of the published states: integer multiples of the timer period.

    Their stamps therefore do not depend on when the timer was started.

    Args:
        rate: of the timer [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._jitter_ns = min(self._period_ns // 4, _JITTER)
        self._last: int | None = None

    def until_tick(self, base_ns: int) -> int:
        """Time [ns] from when a state of `base_ns` would be due to when a regular tick should come,
        less than a period: after a state has become due, by slightly more than the jitter of ticks.
        """
        return (5 * self._jitter_ns // 4 - base_ns) % self._period_ns

    def aim(self, base_ns: int) -> int:
        """The time [ns] to which a tick should advance at which states up to `base_ns` are due.

        It is the newest multiple; but the successor of the last tick's multiple is used until the
        next one is older than the jitter, so that ticks which jitter about a multiple skip none.
        """
        period = self._period_ns
        index = base_ns // period
        if self._last is not None:
            following = self._last + 1
            if following * period <= base_ns < (following + 1) * period + self._jitter_ns:
                index = following
        self._last = index
        return index * period
