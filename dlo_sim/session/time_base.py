"""Two clocks and a grid: header stamps, the clock that delivers messages, and the simulator's
steps.

Everything inside a session is counted in the *time base* [ns]: the header stamps of the inputs, so
that the result does not depend on when a message arrived. The offset (clock minus time base) is
zero unless the stamps come from another epoch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SECOND = 1_000_000_000

# Stamps this far from the clock come from another epoch (an old recording, a device's own clock).
OTHER_EPOCH = 1 * SECOND


class TimeBase:
    """Converts between the clock and the time base, and decides their offset once.

    Args:
        mode: `auto` = stamps; the first stamped message fixes an offset if it is more than 1 s from
            the clock; `stamp` = stamps, never an offset; `arrival` = stamps are ignored, arrival
            times count.
    """

    def __init__(self, mode: str) -> None:
        self.set_mode(mode)

    def set_mode(self, mode: str) -> None:
        """Start over in this mode, without an offset."""
        self.mode = mode
        self.offset_ns = 0
        self.decided = mode != "auto"
        self._confirmations = 0

    def from_clock(self, clock_ns: int) -> int:
        """Time base [ns] at this time of the clock."""
        return clock_ns - self.offset_ns

    def to_clock(self, base_ns: int) -> int:
        """Time of the clock [ns] at this time of the time base."""
        return base_ns + self.offset_ns

    def uses_stamp(self, stamp_ns: int) -> bool:
        """Whether a message with this header stamp is placed by it; stamp 0 means unstamped."""
        return stamp_ns != 0 and self.mode != "arrival"

    def decide(self, stamp_ns: int, arrival_ns: int, tolerance_ns: int = OTHER_EPOCH) -> int:
        """Fix the offset by a message that is known to be sound.

        Returns:
            How much the offset changed [ns]; 0 if it was decided before or the stamps agree with
            the clock.
        """
        if self.decided:
            return 0
        self.decided = True
        difference = arrival_ns - stamp_ns
        before = self.offset_ns
        self.offset_ns = difference if abs(difference) > tolerance_ns else 0
        return self.offset_ns - before

    @property
    def confirmed(self) -> bool:
        """Whether another message has agreed with the one that decided the offset."""
        return self._confirmations > 1

    def confirm(self) -> None:
        """Note a stamped message that was used."""
        self._confirmations += 1

    def forget(self) -> None:
        """Let the next stamped message decide the offset again (after a jump of the clock or the
        stamps).
        """
        if self.mode == "auto":
            self.decided = False
            self._confirmations = 0


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
