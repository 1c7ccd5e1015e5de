"""Queues of stamped messages until the simulation reaches their time, and loads that act from their
stamps on (zero-order hold).

During a step the newest load whose stamp is not after the start of the step acts. It is held until
the next one, or removed `timeout` after its stamp. A load times `loads.<name>.sign` is a wrench ON
THE CABLE.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.scene.cable import Load
from dlo_sim.session.time_base import SECOND

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.simulator import Simulator

_MOST_LOADS = 20_000
_ZERO = (0.0, 0.0, 0.0)


class TakeMessage(NamedTuple):
    """Whether a grasp holds the cable from this stamp in the time base [ns] on."""

    stamp_ns: int
    taken: bool


class LoadMessage(NamedTuple):
    """An accepted load.

    Attributes:
        stamp_ns: time base [ns].
        force: x, y, z [N], in the world frame or that of the end effector `end`.
        torque: x, y, z [N m], in the same frame.
        end: name of an end or a grasp; "" = world frame.
    """

    stamp_ns: int
    force: tuple[float, ...]
    torque: tuple[float, ...]
    end: str


Message = TypeVar("Message", bound=Any)  # a named tuple with `stamp_ns` in the time base [ns]


class Waiting(Generic[Message]):
    """The pending messages of one input, in the order of their stamps.

    Args:
        most: number of newest ones that are kept, so that a paused simulation does not collect
            them without limit.

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
        """Take an accepted message. One that comes late is put in its place; its stamp must be
        newer than `passed_ns` and differ from those that wait.
        """
        newer = []
        while self._pending and self._pending[-1].stamp_ns > message.stamp_ns:
            newer.append(self._pending.pop())
        self._pending.append(message)
        self._pending.extend(reversed(newer))

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns], when the offset of the time base is decided after the
        first messages have come.
        """
        for k, one in enumerate(self._pending):
            self._pending[k] = one._replace(stamp_ns=one.stamp_ns + delta_ns)
        if self.passed_ns is not None:
            self.passed_ns += delta_ns

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

    Args:
        load: its description.
        note: called with the name of an event and one line of text.
    """

    def __init__(self, load: Load, note: Callable[[str, str], None]) -> None:
        super().__init__(_MOST_LOADS)
        self._note = note
        self.configure(load)

    def configure(self, load: Load) -> None:
        """Use name and timeout of this load, and its sign for messages received from now on."""
        self.name, self._sign = load.name, load.sign
        self.timeout_ns = round(load.timeout * SECOND)

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
        self._held: LoadMessage | None = None

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns]."""
        super().shift_time(delta_ns)
        if self._held is not None:
            self._held = self._held._replace(stamp_ns=self._held.stamp_ns + delta_ns)

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next known change of the load, None = none."""
        change = super().next_change_ns()
        if self._held is None or not self.timeout_ns:
            return change
        removed = self._held.stamp_ns + self.timeout_ns
        return removed if change is None else min(change, removed)

    def apply(self, now_ns: int, step_ns: float, simulator: Simulator | ErrorEstimate) -> None:
        """Set the load that acts during the step that begins at `now_ns`."""
        newest: LoadMessage | None = None
        for newest in self.due(now_ns):
            if now_ns - newest.stamp_ns > step_ns:
                self._note(
                    "late", f"load {self.name} came after the simulation had passed its stamp"
                )
        if newest is not None:
            self._held = newest
            force, torque = newest.force, newest.torque
            if newest.end:
                orientation = simulator.end_pose(newest.end)[1]
                turned = rotations.rotate(orientation, np.array([force, torque]))
                force, torque = turned[0], turned[1]
            simulator.set_load(self.name, force=force, torque=torque)
        held = self._held
        if held is not None and self.timeout_ns and now_ns >= held.stamp_ns + self.timeout_ns:
            self._held = None
            timeout = self.timeout_ns / SECOND
            self._note("load_removed", f"load {self.name}: no message for {timeout:g} s; removed")
            simulator.set_load(self.name, force=_ZERO, torque=_ZERO)

    def resend(self, simulator: Simulator | ErrorEstimate) -> None:
        """Set the held load again, for a new simulator."""
        if self._held is not None:
            self._pending.appendleft(self._held)
            self.apply(self._held.stamp_ns, 0.0, simulator)
