"""From the poses of one end effector to a continuous path, as a sequence of `EndMotion`.

SMOOTHING. Poses tracked by a camera have errors of about half a millimetre. That hardly affects
shapes but spoils forces: at 30 Hz a white noise of 1 mm is an acceleration noise of sqrt(6) mm /
dt^2 = 2 m/s^2, which acts on the mass of the whole cable. With `pose_smoothing` w each pose is
replaced by the value, at its own stamp, of the parabola that best fits the poses within +-w
(weights 1 - (t/w)^2). Motion of constant acceleration is unchanged, without a phase lag. The cost
is latency: a pose is ready when one beyond its window has arrived, or after a silence.

PATH. Between the midpoints of consecutive stamps the path is a parabola. For equal intervals it is
the quadratic B-spline whose control points are the poses: C1, with piecewise constant acceleration,
no delay for a moving gripper, and a smoothing of only 1/8 of the second difference. With d = target
minus present position, v0 = present velocity, v1 = (p_next - p) / dt and the duration h of a
segment:
    defect c = h (v0 + v1)/2 - d;  end velocity = v1 - c/h;  so the path misses its target by c/2.
For equal intervals c = 0. For unequal ones the miss decays within one segment instead of growing
(correcting all of c at once would make it alternate forever). Each segment starts where the last
one ended, so the path is continuous. Knots are rounded up to the simulator's steps, so that no step
contains two parabolas.

SILENCE. The path is never extrapolated: without the next pose there is no next segment, and the
simulation waits. After a silence longer than `pose_timeout` the last pose is held as if it were
repeated; when poses return, they are shifted to the held pose, and the shift fades.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import mul
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
from dlo_sim.scene.description import Holder, Obstacle
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import Waiting

Array = NDArray[np.float64]

_ZERO: Vector = (0.0, 0.0, 0.0)

_MOST_WAITING = 5000  # poses; a paused simulation must not collect them without limit

# Largest mean speeds [m/s], [rad/s] and least duration [s] of a return to the poses.
SPEED, TURN, LEAST_TIME = 1.0, 2.0, 0.1
_NEAR = 1e-9  # m, rad


@dataclass
class StepGrid:
    """Start times of the simulator's steps [s]: step 0 is at `origin_ns` in the time base."""

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
    """The first multiple of the step [s], rounded to 1 ns, at or after `base_ns` [ns]."""
    step_ns = max(1, round(step * 1e9))
    return -(-base_ns // step_ns) * step_ns


class Pose(NamedTuple):
    """Stamp in the time base [ns], position [m], orientation as a unit quaternion x, y, z, w."""

    stamp_ns: int
    position: Vector
    orientation: Quaternion


class SmoothedPoses(Waiting[Pose]):
    """Poses that wait to be used, and are smoothed as they are taken out.

    A pose is ready once one beyond its window is there; later messages are inserted until then.

    Args:
        half_window_ns: w; 0 = no smoothing. longest_gap_ns: that a window may contain.
        most: number of newest poses that are kept.
    """

    def __init__(self, half_window_ns: int, longest_gap_ns: int, most: int = 5000) -> None:
        self.half_window_ns = half_window_ns
        self.longest_gap_ns = longest_gap_ns
        super().__init__(most)

    def clear(self) -> None:
        """Discard all poses."""
        super().clear()
        self._past: deque[Pose] = deque()  # taken, as they were, back to the last window
        self._settled_ns: int | None = None

    def settle(self) -> None:
        """Let the poses that are there be taken with incomplete windows."""
        if self._pending:
            self._settled_ns = self._pending[-1].stamp_ns

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next pose if it is ready; else None."""
        return self._pending[0].stamp_ns if self._pending and self._ready() else None

    def due(self, now_ns: int) -> Iterator[Pose]:
        """Take out and yield the ready poses up to a time [ns], the oldest first."""
        while (change := self.next_change_ns()) is not None and change <= now_ns:
            yield self.take()

    def take(self) -> Pose:
        """Take out the next pose, smoothed; it must be ready."""
        pose = self._pending.popleft()
        self.passed_ns = pose.stamp_ns
        if not self.half_window_ns:
            self._past.clear()
            return pose
        before = self._near(pose, reversed(self._past))
        window = [*reversed(before), pose, *self._near(pose, self._pending)]
        self._past.append(pose)
        while pose.stamp_ns - self._past[0].stamp_ns > self.half_window_ns:
            self._past.popleft()
        return _fitted(pose, window, self.half_window_ns)

    def _ready(self) -> bool:
        first_ns, newest_ns = self._pending[0].stamp_ns, self._pending[-1].stamp_ns
        if not self.half_window_ns or newest_ns - first_ns > self.half_window_ns:
            return True
        if self._settled_ns is not None and first_ns <= self._settled_ns:
            return True
        gaps = (b.stamp_ns - a.stamp_ns for a, b in pairwise(self._pending))
        return self.longest_gap_ns < self.half_window_ns and max(gaps, default=0) > (
            self.longest_gap_ns
        )

    def _near(self, pose: Pose, others: Iterable[Pose]) -> list[Pose]:
        """Those of the others, which follow each other away from the pose, in its window."""
        near: list[Pose] = []
        last_ns = pose.stamp_ns
        for other in others:
            if (
                abs(other.stamp_ns - pose.stamp_ns) > self.half_window_ns
                or abs(other.stamp_ns - last_ns) > self.longest_gap_ns
            ):
                break
            last_ns = other.stamp_ns
            near.append(other)
        return near


def _fitted(pose: Pose, window: list[Pose], half_window_ns: int) -> Pose:
    """Value at the pose's stamp of the weighted parabola through the poses of its window."""
    if len(window) < 4:  # a parabola through three points smooths nothing
        return pose
    # Slightly wider, so that the weights of poses at the very ends are not zero.
    scale = 1.0 / (1.001 * half_window_ns)
    weights = weights_of_the_value_at_zero([(p.stamp_ns - pose.stamp_ns) * scale for p in window])
    position = _weighted(weights, [p.position for p in window])
    middle = pose.orientation
    if all(p.orientation == middle for p in window):
        return Pose(pose.stamp_ns, position, middle)
    turn = _weighted(weights, [turn_between(middle, p.orientation) for p in window])
    return Pose(pose.stamp_ns, position, turned(middle, turn))


def _weighted(weights: list[float], vectors: list[Vector]) -> Vector:
    """Weighted sum of vectors."""
    x, y, z = zip(*vectors, strict=True)
    return sum(map(mul, weights, x)), sum(map(mul, weights, y)), sum(map(mul, weights, z))


def weights_of_the_value_at_zero(times: list[float]) -> list[float]:
    """Weights g so that g.y = a for the best parabola a + b t + c t^2 through y; |t| < 1.

    With w = 1 - t^2 and the moments m_k = sum w t^k, g_i = w_i (x_0 + x_1 t_i + x_2 t_i^2), where x
    solves [m_(j+k)] x = (1, 0, 0). Plain floats take a fifth of the time of arrays for nine poses.
    """
    m0 = m1 = m2 = m3 = m4 = 0.0
    weights = []
    for t in times:
        w = 1.0 - t * t
        wt, wtt = w * t, w * t * t
        weights.append((w, wt, wtt))
        m0 += w
        m1 += wt
        m2 += wtt
        m3 += wtt * t
        m4 += wtt * t * t
    x0, x1, x2 = m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2
    determinant = m0 * x0 + m1 * x1 + m2 * x2
    x0, x1, x2 = x0 / determinant, x1 / determinant, x2 / determinant
    return [x0 * w + x1 * wt + x2 * wtt for w, wt, wtt in weights]


class Shift(NamedTuple):
    """A displacement of poses that fades by 1 - 3 x^2 + 2 x^3, x = (stamp - begin) / duration [s].

    At the beginning it is `offset` [m] and the rotation vector `turn` [rad], world frame.
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
        """Remaining fraction of the shift, from 1 to 0."""
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


class Segment(NamedTuple):
    """A motion from step `first` to step `last` of the grid; None: at rest until further notice."""

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
    """The path of one end effector, or obstacle, from its accepted poses.

    Args:
        end: its name, for messages. holder: gives pose_timeout and pose_smoothing.
        journal: counts silences, returns and late poses.

    Attributes:
        silent: whether the last pose is being held after a silence.
        newest: the last pose received, used or not; None = none since `clear`.
    """

    def __init__(self, end: str, holder: Holder | Obstacle, journal: Journal) -> None:
        self.end = end
        self._note = journal.event
        super().__init__(0, 0, _MOST_WAITING)
        self.configure(holder)

    def configure(self, holder: Holder | Obstacle) -> None:
        """Use the settings of this holder from the next pose on."""
        self.timeout_ns = self.longest_gap_ns = round(holder.pose_timeout * SECOND)
        self.half_window_ns = round(holder.pose_smoothing * SECOND)
        self._in_frame: tuple[Vector, Quaternion] | None = None
        if isinstance(holder, Obstacle) and holder.frame:
            self._in_frame = holder.position, normalized(holder.orientation)

    def clear(self) -> None:
        """Discard all poses; the next one starts a new path."""
        super().clear()
        self.silent = False
        self.newest: Pose | None = None
        self._center: Pose | None = None
        self._interval_ns = 0
        self._shift: Shift | None = None
        self._present = _State()

    def add(self, pose: Pose) -> None:
        """Take an accepted pose, as `Waiting.add`: that of the frame for an obstacle in a frame."""
        if self._in_frame is not None:
            way, turn = self._in_frame
            way = _plain(rotations.rotate(pose.orientation, np.array(way)))
            turned_by = normalized(_plain(rotations.multiply(pose.orientation, np.array(turn))))
            pose = pose._replace(position=_sum(pose.position, way), orientation=turned_by)
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

    def begin(self, base_ns: int) -> tuple[Array, Array]:
        """Start at rest at the newest pose not after `base_ns`, else at the first; return that
        pose.
        """
        while (stamp_ns := self.next_change_ns()) is not None and (
            self._center is None or stamp_ns <= base_ns
        ):
            self._center = self.take()
        assert self._center is not None, "begin() needs a pose"
        self._present = _State(self._center.position, self._center.orientation)
        return np.array(self._present.position), np.array(self._present.orientation)

    def skip_to(self, base_ns: int, position: Array, orientation: Array) -> None:
        """Jump to `base_ns`, with the end at rest at this pose: drop older poses and rejoin newer
        ones.
        """
        for pose in self.due(base_ns):
            self._center = pose
        self._present = _State(_plain(position), _plain(orientation))
        if self._center is not None:
            self._rejoin(self._center._replace(stamp_ns=base_ns))

    def replan(self, motion: EndMotion, now: float, grid: StepGrid, last: int) -> Segment:
        """The remainder of a motion of `next_segment` on another grid, up to its step `last`.

        `now`: present time of the old simulator [s]; the new one is at time 0 and step 0.
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
        """The motion from step `index` (simulator time `time` [s]), or None while it waits for a
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
        """The parabola that ends half-way in time between two poses; None if that is past or too
        close.
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
        """Parabola from the present state to a target (formula of the module); move the state to
        its end.
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
        """A segment to the last pose as if repeated, then one to remove the miss; None once at
        rest.
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
        """Skip the poses before `now_ns`, and rejoin the later ones from the present pose of the
        end.
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
