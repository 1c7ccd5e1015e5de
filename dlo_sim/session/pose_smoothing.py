"""Smooths measured poses by local parabolas.

Poses tracked by a camera have errors of about half a millimetre. That hardly affects shapes but
spoils forces: at 30 Hz a white noise of 1 mm is an acceleration noise of sqrt(6) mm / dt^2
= 2 m/s^2, and the inertia of the whole cable makes it a force noise. Each pose is replaced by the
value, at its own stamp, of the parabola that best fits the poses within +-w (weights 1 - (t/w)^2).
Motion of constant acceleration is unchanged, without a phase lag. The cost is latency: a pose is
released when one beyond its window has arrived, or after a silence.
"""

from __future__ import annotations

from collections import deque
from operator import mul
from typing import NamedTuple

from dlo_sim.core.one_rotation import Quaternion, Vector, turn_between, turned


class Pose(NamedTuple):
    """Stamp in the time base [ns], position [m], orientation as a unit quaternion x, y, z, w."""

    stamp_ns: int
    position: Vector
    orientation: Quaternion

    def moved(self, delta_ns: int) -> Pose:
        """The same pose with its stamp shifted by delta [ns]."""
        return self._replace(stamp_ns=self.stamp_ns + delta_ns)


class PoseSmoother:
    """Smooths a stream of poses whose stamps increase.

    Args:
        half_window_ns: w; 0 = no smoothing.
        longest_gap_ns: windows do not extend across a longer gap.
    """

    def __init__(self, half_window_ns: int, longest_gap_ns: int) -> None:
        self.half_window_ns = half_window_ns
        self.longest_gap_ns = longest_gap_ns
        self.clear()

    def clear(self) -> None:
        """Discard all poses."""
        self._poses: deque[Pose] = deque()
        self._next = 0  # index in _poses of the first one not released yet

    @property
    def held_back(self) -> int:
        """Number of poses that wait for the end of their window."""
        return len(self._poses) - self._next

    def add(self, pose: Pose) -> list[Pose]:
        """Take a pose; returns the smoothed poses whose windows are now complete."""
        if self.half_window_ns == 0 and not self.held_back:
            return [pose]
        released: list[Pose] = []
        if self._poses and pose.stamp_ns - self._poses[-1].stamp_ns > self.longest_gap_ns:
            released = self.flush()
        self._poses.append(pose)
        while pose.stamp_ns - self._poses[self._next].stamp_ns > self.half_window_ns:
            released.append(self._release())
        return released

    def flush(self) -> list[Pose]:
        """Release all poses with incomplete windows, and start anew."""
        released = [self._release() for _ in range(self.held_back)]
        self.clear()
        return released

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns]."""
        self._poses = deque(p.moved(delta_ns) for p in self._poses)

    def _release(self) -> Pose:
        """The next pose, smoothed; drops poses that no window needs any more."""
        pose = self._poses[self._next]
        oldest = pose.stamp_ns - self.half_window_ns
        while self._poses[0].stamp_ns < oldest:
            self._poses.popleft()
            self._next -= 1
        newest = pose.stamp_ns + self.half_window_ns
        window = [p for p in self._poses if p.stamp_ns <= newest]
        self._next += 1
        return _fitted(pose, window, self.half_window_ns)


def _fitted(pose: Pose, window: list[Pose], half_window_ns: int) -> Pose:
    """Value at the pose's stamp of the weighted parabola through the poses of its window."""
    if len(window) < 4:  # a parabola through three points smooths nothing
        return pose
    # Slightly wider, so that the weights of poses at the very ends are not zero.
    scale = 1.0 / (1.001 * half_window_ns)
    share = weights_of_the_value_at_zero([(p.stamp_ns - pose.stamp_ns) * scale for p in window])
    position = _weighted(share, [p.position for p in window])
    middle = pose.orientation
    if all(p.orientation == middle for p in window):
        return Pose(pose.stamp_ns, position, middle)
    turn = _weighted(share, [turn_between(middle, p.orientation) for p in window])
    return Pose(pose.stamp_ns, position, turned(middle, turn))


def _weighted(share: list[float], vectors: list[Vector]) -> Vector:
    """Weighted sum of vectors."""
    x, y, z = zip(*vectors, strict=True)
    return sum(map(mul, share, x)), sum(map(mul, share, y)), sum(map(mul, share, z))


def weights_of_the_value_at_zero(times: list[float]) -> list[float]:
    """Weights g so that g.y = a for the best parabola a + b t + c t^2 through y; |t| < 1.

    With w = 1 - t^2 and the moments m_k = sum w t^k, g_i = w_i (x_0 + x_1 t_i + x_2 t_i^2), where x
    solves the normal equations [m_(j+k)] x = (1, 0, 0). For nine poses plain floats take a fifth of
    the time of arrays.
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
