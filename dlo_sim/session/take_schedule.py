"""Messages that let a grasp take or release the cable, until their time comes."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

# A paused simulation must not collect them for ever; only the newest counts.
_MOST_WAITING = 1000


class TakeMessage(NamedTuple):
    """Time [ns] in the time base, and whether the grasp holds the cable from then on."""

    stamp_ns: int
    taken: bool


class TakeSchedule:
    """The pending messages of one grasp."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all messages."""
        self._pending: deque[TakeMessage] = deque(maxlen=_MOST_WAITING)

    def add(self, message: TakeMessage) -> None:
        """Take an accepted message; stamps must increase."""
        self._pending.append(message)

    def shift_time(self, delta_ns: int) -> None:
        """Relabel all stamps by delta [ns]."""
        moved = [m._replace(stamp_ns=m.stamp_ns + delta_ns) for m in self._pending]
        self._pending = deque(moved, maxlen=_MOST_WAITING)

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next message, None = none."""
        return self._pending[0].stamp_ns if self._pending else None

    def newest(self, now_ns: int) -> bool | None:
        """Whether the grasp holds the cable from `now_ns` on; None = no news."""
        newest = None
        while self._pending and self._pending[0].stamp_ns <= now_ns:
            newest = self._pending.popleft().taken
        return newest
