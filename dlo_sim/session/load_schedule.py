"""Accepted wrenches and forces -> the load that acts during a step (zero-order hold).

During a step acts the newest load whose stamp is not after the start of the step; it is held until
the next one, or until `timeout` after its stamp, when it is removed. A load, times
`loads.<name>.sign`, is a wrench ON THE CABLE.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.scene.cable import Load
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.simulator import Simulator

_MOST_WAITING = 20_000
_ZERO = (0.0, 0.0, 0.0)


class LoadMessage(NamedTuple):
    """An accepted load.

    Attributes:
        stamp_ns: time base [ns].
        force: x, y, z [N], world frame, or the end-effector's if `end` names one.
        torque: x, y, z [N m], likewise.
        end: "" = world frame; "start" or "end" = the frame of that end-effector.
    """

    stamp_ns: int
    force: tuple[float, ...]
    torque: tuple[float, ...]
    end: str


class LoadSchedule(Waiting[LoadMessage]):
    """The pending messages of one load.

    Args:
        load: its description.
        note: called with the name of an event and one line of text.
    """

    def __init__(self, load: Load, note: Callable[[str, str], None]) -> None:
        super().__init__(_MOST_WAITING)
        self._note = note
        self.configure(load)

    def configure(self, load: Load) -> None:
        """Take name, timeout, and the sign of the messages that come from now on."""
        self.name, self._sign = load.name, load.sign
        self.timeout_ns = round(load.timeout * SECOND)

    def add(self, message: LoadMessage) -> None:
        """Take an accepted message; stamps must increase."""
        force = tuple(self._sign * value for value in message.force)
        torque = tuple(self._sign * value for value in message.torque)
        super().add(message._replace(force=force, torque=torque))

    def clear(self) -> None:
        """Forget all messages."""
        super().clear()
        self._held: LoadMessage | None = None

    def shift_time(self, delta_ns: int) -> None:
        """Relabel all stamps by delta [ns]."""
        super().shift_time(delta_ns)
        if self._held is not None:
            self._held = self._held._replace(stamp_ns=self._held.stamp_ns + delta_ns)

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next change that is known now, None = none."""
        change = super().next_change_ns()
        if self._held is None or not self.timeout_ns:
            return change
        removed = self._held.stamp_ns + self.timeout_ns
        return removed if change is None else min(change, removed)

    def apply(self, now_ns: int, step_ns: float, simulator: Simulator | ErrorEstimate) -> None:
        """Give the simulator the load that acts during the step that begins at `now_ns`."""
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
        """Apply the load that is held again (to a new simulator)."""
        if self._held is not None:
            self._pending.appendleft(self._held)
            self.apply(self._held.stamp_ns, 0.0, simulator)
