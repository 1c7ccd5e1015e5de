"""A smooth return of a held end to its poses, by a shift of the poses that fades."""

from __future__ import annotations

import math
from typing import NamedTuple

from dlo_sim.core.one_rotation import Quaternion, Vector, turn_between, turned
from dlo_sim.session.pose_smoothing import Pose
from dlo_sim.session.time_base import SECOND

# Largest mean speeds of the return, and its shortest duration.
SPEED, TURN, LEAST_TIME = 1.0, 2.0, 0.1  # m/s, rad/s, s

_NEAR = 1e-9  # m, rad


class Shift(NamedTuple):
    """A displacement of poses that fades by 1 - 3 x^2 + 2 x^3, x = (stamp - begin) / duration.

    Attributes:
        begin_ns: time base [ns]; duration: [s].
        offset: displacement [m] at the beginning.
        turn: rotation vector [rad] at the beginning, world frame.
    """

    begin_ns: int
    duration: float
    offset: Vector
    turn: Vector

    @classmethod
    def to_present(cls, pose: Pose, position: Vector, orientation: Quaternion) -> Shift | None:
        """The shift from `pose` at its stamp to the pose of the end; None if they agree."""
        (x, y, z), (px, py, pz) = position, pose.position
        offset = (x - px, y - py, z - pz)
        turn = turn_between(pose.orientation, orientation)
        distance, angle = math.hypot(*offset), math.hypot(*turn)
        if distance < _NEAR and angle < _NEAR:
            return None
        duration = max(LEAST_TIME, distance / SPEED, angle / TURN)
        return cls(pose.stamp_ns, duration, offset, turn)

    @property
    def distance(self) -> float:
        """Displacement at the beginning [m]."""
        return math.hypot(*self.offset)

    def weight(self, stamp_ns: int) -> float:
        """Remaining share of the shift, from 1 to 0."""
        x = min(1.0, max(0.0, (stamp_ns - self.begin_ns) / (self.duration * SECOND)))
        return 1.0 - x * x * (3.0 - 2.0 * x)

    def applied(self, pose: Pose) -> Pose:
        """The displaced pose."""
        weight = self.weight(pose.stamp_ns)
        if weight == 0.0:
            return pose
        (x, y, z), (ox, oy, oz), (tx, ty, tz) = pose.position, self.offset, self.turn
        return Pose(
            pose.stamp_ns,
            (x + weight * ox, y + weight * oy, z + weight * oz),
            turned(pose.orientation, (weight * tx, weight * ty, weight * tz)),
        )

    def moved(self, delta_ns: int) -> Shift:
        """The same shift with its time shifted by delta [ns]."""
        return self._replace(begin_ns=self.begin_ns + delta_ns)
