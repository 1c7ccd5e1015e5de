"""Smooths measured poses by local parabolas.

Poses tracked by a camera have errors of about half a millimetre. That hardly affects shapes but
spoils forces: at 30 Hz a white noise of 1 mm is an acceleration noise of sqrt(6) mm / dt^2
= 2 m/s^2, and the inertia of the whole cable makes it a force noise. Each pose is replaced by the
value, at its own stamp, of the parabola that best fits the poses within +-w (weights 1 - (t/w)^2).
Motion of constant acceleration is unchanged, without a phase lag. The cost is latency: a pose is
ready when one beyond its window has arrived, or after a silence.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import pairwise
from operator import mul
from typing import NamedTuple

from dlo_sim.core.one_rotation import Quaternion, Vector, turn_between, turned
from dlo_sim.session.waiting import Waiting


class Pose(NamedTuple):
    """Stamp in the time base [ns], position [m], orientation as a unit quaternion x, y, z, w."""

    stamp_ns: int
    position: Vector
    orientation: Quaternion

    def moved(self, delta_ns: int) -> Pose:
        """The same pose with its stamp shifted by delta [ns]."""
        return self._replace(stamp_ns=self.stamp_ns + delta_ns)


class SmoothedPoses(Waiting[Pose]):
    """Poses that wait to be used, and are smoothed as they are taken out.

    A pose is ready once one beyond its window is there; until then messages that come late still
    find their place in the window.

    Args:
        half_window_ns: w; 0 = no smoothing.
        longest_gap_ns: windows do not extend across a longer gap.
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

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns]."""
        super().shift_time(delta_ns)
        self._past = deque(p.moved(delta_ns) for p in self._past)
        if self._settled_ns is not None:
            self._settled_ns += delta_ns

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
        found: list[Pose] = []
        last_ns = pose.stamp_ns
        for other in others:
            if (
                abs(other.stamp_ns - pose.stamp_ns) > self.half_window_ns
                or abs(other.stamp_ns - last_ns) > self.longest_gap_ns
            ):
                break
            last_ns = other.stamp_ns
            found.append(other)
        return found


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
