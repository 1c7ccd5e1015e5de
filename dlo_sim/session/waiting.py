"""Queues of stamped messages until the simulation reaches their time.

During a step the newest load whose stamp is not after its start acts. A load is held until the next
one, or removed `timeout` after its stamp. A load times `loads.<name>.sign` is a wrench ON THE
CABLE.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, Generic, NamedTuple, TypeVar

from dlo_sim.scene.description import Load
from dlo_sim.session.time_base import SECOND

_MOST_LOADS = 20_000


class TakeMessage(NamedTuple):
    """Whether a grasp holds the cable from this stamp in the time base [ns] on."""

    stamp_ns: int
    taken: bool


class LoadMessage(NamedTuple):
    """An accepted load.

    Attributes:
        stamp_ns: time base [ns]. force, torque: x, y, z [N], [N m].
        end: name of the end or grasp in whose end-effector frame they are; "" = world frame.
    """

    stamp_ns: int
    force: tuple[float, ...]
    torque: tuple[float, ...]
    end: str = ""


Message = TypeVar("Message", bound=Any)  # a named tuple with `stamp_ns` in the time base [ns]


class Waiting(Generic[Message]):
    """The pending messages of one input, in the order of their stamps; the newest `most` are kept.

    Attributes:
        passed_ns: stamp of the last message taken out [ns], None = none since `clear`; one that is
            not newer comes too late.
    """

    def __init__(self, most: int = 1000) -> None:
        self._pending: deque[Message] = deque(maxlen=most)
        self.clear()

    def clear(self) -> None:
        """Discard all messages."""
        self._pending.clear()
        self.passed_ns: int | None = None

    def add(self, message: Message) -> None:
        """Insert a message; its stamp must be newer than `passed_ns` and differ from those that
        wait.
        """
        newer = []
        while self._pending and self._pending[-1].stamp_ns > message.stamp_ns:
            newer.append(self._pending.pop())
        self._pending.append(message)
        self._pending.extend(reversed(newer))

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next known message, None = none."""
        return self._pending[0].stamp_ns if self._pending else None

    def due(self, now_ns: int) -> Iterator[Message]:
        """Remove and yield the messages up to a time [ns], the oldest first."""
        while self._pending and self._pending[0].stamp_ns <= now_ns:
            self.passed_ns = self._pending[0].stamp_ns
            yield self._pending.popleft()


class LoadSchedule(Waiting[LoadMessage]):
    """The pending messages of one load.

    Attributes:
        held: the load that acts now; None = none, or removed. timeout_ns: after its stamp when it
            is to be removed, 0 = never.
    """

    def __init__(self, load: Load) -> None:
        super().__init__(_MOST_LOADS)
        self.configure(load)

    def configure(self, load: Load) -> None:
        """Use the timeout of this load, and its sign for messages received from now on."""
        self._sign, self.timeout_ns = load.sign, round(load.timeout * SECOND)

    def add(self, message: LoadMessage) -> None:
        """Take an accepted message, as `Waiting.add`."""
        if self._sign != 1.0:
            force = tuple(self._sign * value for value in message.force)
            torque = tuple(self._sign * value for value in message.torque)
            message = message._replace(force=force, torque=torque)
        super().add(message)

    def clear(self) -> None:
        """Discard all messages and the held load."""
        super().clear()
        self.held: LoadMessage | None = None

    def removal_ns(self) -> int | None:
        """Time base [ns] at which the held load is to be removed, None = never."""
        if self.held is None or not self.timeout_ns:
            return None
        return self.held.stamp_ns + self.timeout_ns

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next known change of the load, None = none."""
        change, removal = super().next_change_ns(), self.removal_ns()
        return removal if change is None else change if removal is None else min(change, removal)
