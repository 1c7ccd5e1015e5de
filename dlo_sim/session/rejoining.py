"""How an end that was held returns to its poses: by a shift that fades, never by a jump."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.session.pose_smoothing import Pose
from dlo_sim.session.time_base import SECOND

Array = NDArray[np.float64]

# Mean speed of the return, and the least time that it takes.
SPEED, TURN, LEAST_TIME = 1.0, 2.0, 0.1  # m/s, rad/s, s

_NEAR = 1e-9  # m, rad


class Shift(NamedTuple):
    """A displacement of poses that fades by 1 - 3 x^2 + 2 x^3, x = (stamp - begin) / duration.

    Attributes:
        begin_ns: time base [ns]; duration: [s].
        offset: displacement [m] at the beginning, shape (3,).
        turn: rotation vector [rad] at the beginning, world frame, shape (3,).
    """

    begin_ns: int
    duration: float
    offset: Array
    turn: Array

    @classmethod
    def to_present(cls, pose: Pose, position: Array, orientation: Array) -> Shift | None:
        """What takes `pose` at its stamp to where the end is; None if it is there already."""
        offset = position - pose.position
        turn = rotations.turns_from(pose.orientation, orientation)
        distance, angle = float(np.linalg.norm(offset)), float(np.linalg.norm(turn))
        if distance < _NEAR and angle < _NEAR:
            return None
        duration = max(LEAST_TIME, distance / SPEED, angle / TURN)
        return cls(pose.stamp_ns, duration, offset, turn)

    @property
    def distance(self) -> float:
        """Displacement at the beginning [m]."""
        return float(np.linalg.norm(self.offset))

    def weight(self, stamp_ns: int) -> float:
        """How much of the shift is left, 1 to 0."""
        x = min(1.0, max(0.0, (stamp_ns - self.begin_ns) / (self.duration * SECOND)))
        return 1.0 - x * x * (3.0 - 2.0 * x)

    def applied(self, pose: Pose) -> Pose:
        """The pose, displaced."""
        weight = self.weight(pose.stamp_ns)
        if weight == 0.0:
            return pose
        return pose._replace(
            position=pose.position + weight * self.offset,
            orientation=rotations.turned(pose.orientation, weight * self.turn),
        )

    def moved(self, delta_ns: int) -> Shift:
        """The same shift with its time relabelled by delta [ns]."""
        return self._replace(begin_ns=self.begin_ns + delta_ns)
