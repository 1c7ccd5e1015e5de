"""Stamped messages that wait until the simulation comes to their time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, Generic, NamedTuple, TypeVar


class TakeMessage(NamedTuple):
    """Whether a grasp holds the cable from this stamp in the time base [ns] on."""

    stamp_ns: int
    taken: bool


Message = TypeVar("Message", bound=Any)  # a named tuple with `stamp_ns` in the time base [ns]


class Waiting(Generic[Message]):
    """The pending messages of one input.

    Args:
        most: of them are kept, the newest: a paused simulation must not collect them for ever.
    """

    def __init__(self, most: int = 1000) -> None:
        self._pending: deque[Message] = deque(maxlen=most)
        self.clear()

    def clear(self) -> None:
        """Forget all messages."""
        self._pending.clear()

    def add(self, message: Message) -> None:
        """Take an accepted message; stamps must increase."""
        self._pending.append(message)

    def shift_time(self, delta_ns: int) -> None:
        """Relabel all stamps by delta [ns] (the time base was decided later than the first messages
        came).
        """
        for k, one in enumerate(self._pending):
            self._pending[k] = one._replace(stamp_ns=one.stamp_ns + delta_ns)

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next message that is known now, None = none."""
        return self._pending[0].stamp_ns if self._pending else None

    def due(self, now_ns: int) -> Iterator[Message]:
        """Take out the messages up to a time [ns], the oldest first."""
        while self._pending and self._pending[0].stamp_ns <= now_ns:
            yield self._pending.popleft()
