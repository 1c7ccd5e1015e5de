"""From the poses of one end effector to a continuous path, as a sequence of `EndMotion`.

Between the midpoints of consecutive stamps the path is a parabola. For equal intervals it is the
quadratic B-spline whose control points are the poses: C1, with piecewise constant acceleration, no
delay for a moving gripper, and a smoothing of only 1/8 of the second difference. With d = target
minus present position, v0 = present velocity, v1 = (p_next - p) / dt and the duration h of a
segment:
    defect c = h (v0 + v1)/2 - d;  end velocity = v1 - c/h;  so the path misses its target by c/2.
For equal intervals c = 0. For unequal ones the miss decays within one segment instead of growing
(correcting all of c at once would make it alternate forever). Each segment starts where the last
one ended, so the path is continuous for any sequence of poses. Knots are rounded up to the
simulator's steps, so that no step contains two parabolas.

The path is never extrapolated: without the next pose there is no next segment, and the simulation
waits. After a silence longer than `pose_timeout` the last pose is held as if it were repeated; when
poses return, the path rejoins them smoothly from the held pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.one_rotation import (
    Quaternion,
    Vector,
    angular_velocity,
    cross,
    normalized,
    turn_between,
    turned,
)
from dlo_sim.scene.holders import Holder
from dlo_sim.session.latency import PoseTiming
from dlo_sim.session.pose_smoothing import Pose, SmoothedPoses
from dlo_sim.session.rejoining import Shift
from dlo_sim.session.step_grid import StepGrid
from dlo_sim.session.time_base import SECOND

Array = NDArray[np.float64]

_ZERO: Vector = (0.0, 0.0, 0.0)

# Poses waiting to be used; a paused simulation must not collect them without limit.
_MOST_WAITING = 5000


class Segment(NamedTuple):
    """A motion from step `first` to step `last` (indices of the grid); `last` None: at rest until
    further notice.
    """

    first: int
    last: int | None
    motion: EndMotion


class _State(NamedTuple):
    """Pose [m, quaternion] and velocities [m/s, rad/s] of an end effector."""

    position: Vector = _ZERO
    orientation: Quaternion = rotations.IDENTITY
    velocity: Vector = _ZERO
    spin: Vector = _ZERO


class GripperPath(SmoothedPoses):
    """The path of one end effector from its accepted poses.

    Args:
        end: name of the end, for messages.
        holder: gives pose_timeout and pose_smoothing.
        note: called with the name of an event and one line of text.

    Attributes:
        silent: whether the last pose is being held after a silence.
        newest: the last pose received, used or not; None = none since `clear`.
        timing: how often and how late poses come.
    """

    def __init__(self, end: str, holder: Holder, note: Callable[[str, str], None]) -> None:
        self.end = end
        self._note = note
        self.timing = PoseTiming()
        super().__init__(0, 0, _MOST_WAITING)
        self.configure(holder)

    def configure(self, holder: Holder) -> None:
        """Use the settings of this holder from the next pose on."""
        self.timeout_ns = self.longest_gap_ns = round(holder.pose_timeout * SECOND)
        self.half_window_ns = round(holder.pose_smoothing * SECOND)
        self.timing.configure(self.timeout_ns, self.half_window_ns)

    def clear(self) -> None:
        """Discard all poses; the next one starts a new path."""
        super().clear()
        self.silent = False
        self.newest: Pose | None = None
        self.timing.clear()
        self._center: Pose | None = None
        self._interval_ns = 0
        self._shift: Shift | None = None
        self._present = _State()

    def add(self, pose: Pose) -> None:
        """Take an accepted pose, as `Waiting.add`."""
        if self.newest is None or pose.stamp_ns > self.newest.stamp_ns:
            self.newest = pose
        super().add(pose)

    def settle_after_silence(self, wanted_ns: int) -> None:
        """After a silence, stop waiting for poses that would complete a smoothing window."""
        if self._pending and self._long_silent(wanted_ns):
            self.settle()

    def _long_silent(self, wanted_ns: int) -> bool:
        """Whether the newest pose, which must exist, is older than the timeout at `wanted_ns`."""
        assert self.newest is not None
        return wanted_ns - self.newest.stamp_ns > self.timeout_ns

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns]."""
        super().shift_time(delta_ns)
        self.newest = self.newest and self.newest.moved(delta_ns)
        self._center = self._center and self._center.moved(delta_ns)
        self._shift = self._shift and self._shift.moved(delta_ns)

    def begin(self, base_ns: int) -> tuple[Array, Array]:
        """Start the path at rest at the newest pose not after `base_ns`, else at the first pose;
        returns (position, orientation).
        """
        while (stamp_ns := self.next_change_ns()) is not None and (
            self._center is None or stamp_ns <= base_ns
        ):
            self._center = self.take()
        assert self._center is not None, "begin() needs a pose"
        self._present = _State(self._center.position, self._center.orientation)
        return np.array(self._present.position), np.array(self._present.orientation)

    def skip_to(self, base_ns: int, position: Array, orientation: Array) -> None:
        """Handle a jump of the simulation to `base_ns`, with the end at rest at this pose: drop
        older poses and rejoin newer ones.
        """
        for pose in self.due(base_ns):
            self._center = pose
        self._present = _State(_plain(position), _plain(orientation))
        if self._center is not None:
            self._rejoin(self._center._replace(stamp_ns=base_ns))

    def replan(self, motion: EndMotion, now: float, grid: StepGrid, last: int) -> Segment:
        """The remainder of the present motion on another grid.

        Args:
            motion: the motion in progress, from `next_segment`.
            now: present time of the old simulator [s]; the new one is at time 0 and step 0.
            last: step of the new grid at which the motion ends.
        """
        target = self._present
        self._present = _State(
            _plain(motion.position_at(now)),
            normalized(_plain(motion.orientation_at(now))),
            _plain(motion.velocity_at(now)),
            _plain(motion.angular_velocity_at(now)),
        )
        return self._move_to(target, 0, last, grid.step, 0.0)

    def next_segment(
        self, grid: StepGrid, index: int, time: float, wanted_ns: int
    ) -> Segment | None:
        """The motion that begins at step `index` (simulator time `time` [s]), or None: wait for a
        pose.

        Args:
            wanted_ns: time base [ns] up to which a silence is measured, so that it is detected at
                the same stamp whenever poses arrive.
        """
        self.settle_after_silence(wanted_ns)
        self._pass_over(grid.time_of(index - 1))
        while (stamp_ns := self.next_change_ns()) is not None:
            center = self._center
            assert center is not None, "next_segment() needs begin()"
            if self.silent:
                segment = self._resume(stamp_ns, grid, index, time)
            elif stamp_ns - center.stamp_ns > self.timeout_ns:
                segment = self._come_to_rest(grid, index, time)
            else:
                self._center = self.take()
                self.timing.use(center.stamp_ns, stamp_ns)
                segment = self._segment_between(center, self._center, grid, index, time)
            if segment is not None:
                return segment
        if self._center is None:
            return None
        if not self.silent and self._long_silent(wanted_ns):
            segment = self._come_to_rest(grid, index, time)
            if segment is not None:
                return segment
        if self.silent:
            return Segment(index, None, self._resting(time))
        return None

    def _segment_between(
        self, center: Pose, pose: Pose, grid: StepGrid, index: int, time: float
    ) -> Segment | None:
        """The parabola that ends half-way in time between two poses; None if that time is past or
        too close.
        """
        interval_ns = pose.stamp_ns - center.stamp_ns
        self._interval_ns = interval_ns
        middle_ns = center.stamp_ns + interval_ns // 2
        last = grid.first_at_or_after(middle_ns)
        # In a segment much shorter than the interval, a small miss would cause a large
        # acceleration; the next segment covers that time.
        if last <= index or (last - index) * grid.step < 0.25e-9 * interval_ns:
            return None
        first_p, first_q = self._shifted(center)
        second_p, second_q = self._shifted(pose)
        rate = 1e9 / interval_ns
        ahead = (grid.time_of(last) - middle_ns) * 1e-9
        velocity = _scaled(_difference(second_p, first_p), rate)
        position = _sum(_scaled(_sum(first_p, second_p), 0.5), _scaled(velocity, ahead))
        turn = turn_between(first_q, second_q)
        orientation = turned(first_q, _scaled(turn, 0.5 + ahead * rate))
        target = _State(position, orientation, velocity, _scaled(turn, rate))
        return self._move_to(target, index, last, grid.step, time)

    def _move_to(self, target: _State, first: int, last: int, step: float, time: float) -> Segment:
        """Parabola from the present state to a target by the formula of the module; the present
        state becomes that at its end.
        """
        duration = (last - first) * step
        p0, q0, p1, w1 = self._present
        p2 = _curvature(_difference(target.position, p0), p1, target.velocity, duration)
        way = turn_between(q0, target.orientation)
        # Angular velocity -> rate of the rotation vector at `way`: inverse left Jacobian to second
        # order.
        once = cross(way, target.spin)
        twice = cross(way, once)
        end_rate = _sum(_sum(target.spin, _scaled(once, -0.5)), _scaled(twice, 1.0 / 12.0))
        w2 = _curvature(way, w1, end_rate, duration)
        path, turn = np.array((p0, p1, p2)), np.array((w1, w2))
        motion = EndMotion.from_coefficients(time, duration, path, np.array(q0), turn)
        reached = _way(w1, w2, duration)
        self._present = _State(
            _sum(p0, _way(p1, p2, duration)),
            normalized(turned(q0, reached)),
            _rate(p1, p2, duration),
            angular_velocity(reached, _rate(w1, w2, duration)),
        )
        return Segment(first, last, motion)

    def _come_to_rest(self, grid: StepGrid, index: int, time: float) -> Segment | None:
        """A segment to the last pose as if it were repeated, then one more to remove the miss; None
        once at rest.
        """
        center = self._center
        assert center is not None
        if not any(self._present.velocity) and not any(self._present.spin):
            self.silent = True
            timeout = self.timeout_ns / SECOND
            self._note("silent", f"no pose of {self.end} for {timeout:g} s; the last one is held")
            return None
        interval = max(1e-9 * self._interval_ns, 2.0 * grid.step)
        last = index + max(1, round(interval / grid.step))
        segment = self._move_to(_State(*self._shifted(center)), index, last, grid.step, time)
        position, orientation, velocity, spin = self._present
        if math.hypot(*velocity) < 1e-9 and math.hypot(*spin) < 1e-9:
            self._present = _State(position, orientation)
        return segment

    def _pass_over(self, now_ns: int) -> None:
        """Skip the poses before `now_ns`, which the simulation has passed, and rejoin the following
        ones from the present pose of the end.
        """
        late = list(self.due(now_ns - 1))
        for _ in late:
            self._note("late", f"a pose of {self.end} came after the simulation had passed it")
        if late:
            self.silent = False
            self._center = late[-1]
            self._rejoin(late[-1]._replace(stamp_ns=now_ns))

    def _resume(self, stamp_ns: int, grid: StepGrid, index: int, time: float) -> Segment | None:
        """After a silence: rest until the first new pose, then rejoin from the held pose."""
        first = grid.first_at_or_after(stamp_ns)
        if first > index:
            return Segment(index, first, self._resting(time))
        self.silent = False
        self._center = self.take()
        self._rejoin(self._center)
        return None

    def _rejoin(self, pose: Pose) -> None:
        """Shift poses from this one on so that it coincides with the end's; the shift fades."""
        self._shift = Shift.to_present(pose, self._present.position, self._present.orientation)
        if self._shift is not None:
            self._note(
                "rejoined", f"{self.end} returns to its poses, {self._shift.distance:.3g} m away"
            )

    def _shifted(self, pose: Pose) -> tuple[Vector, Quaternion]:
        pose = pose if self._shift is None else self._shift.applied(pose)
        return pose.position, pose.orientation

    def _resting(self, time: float) -> EndMotion:
        return EndMotion.resting(self._present.position, self._present.orientation, time)


# Vectors as tuples of floats: arrays of three numbers take ten times as long.


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _difference(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _scaled(a: Vector, factor: float) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


def _way(v0: Vector, curvature: Vector, s: float) -> Vector:
    """v0 s + curvature s^2."""
    return _scaled(_sum(v0, _scaled(curvature, s)), s)


def _rate(v0: Vector, curvature: Vector, s: float) -> Vector:
    """Derivative of `_way` with respect to s."""
    return _sum(v0, _scaled(curvature, 2.0 * s))


def _curvature(way: Vector, v0: Vector, v1: Vector, duration: float) -> Vector:
    """Quadratic coefficient by the formula of the module, per component; v0 is the linear one."""
    x, y, z = (
        (b - (0.5 * duration * (a + b) - d) / duration - a) / (2.0 * duration)
        for d, a, b in zip(way, v0, v1, strict=True)
    )
    return x, y, z


def _plain(values: Array) -> Any:
    return tuple(values.tolist())
