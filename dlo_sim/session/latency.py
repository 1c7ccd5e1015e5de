"""The lag of the prediction behind the clock: as given, or (auto) as much as the poses need.

The path of an end effector turns half-way between two poses towards the one that follows them, so
with intervals dt and a delay D of the messages the simulation needs to run 1.5 dt + D behind. Both
are measured here. With `auto` the lag follows this need; a given lag that is shorter is reported at
once, with the lag that would do.

The lag decides which states are published and when, and how late a message may be. It does not
change the states otherwise: steps, paths and stamps do not depend on it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping

from dlo_sim.scene.computation import LEAST_LATENCY, MOST_LATENCY
from dlo_sim.scene.description import Scene
from dlo_sim.session.time_base import SECOND

# The need of an end is the second largest of so many intervals: one dropout is no rate.
_INTERVALS = 10
# Until so many poses were used, the need is foreseen from those that have come.
_FORESEEN = 3
# So many of them that are longer than pose_timeout are a rate, not silences.
_SILENCES = 3
# A need that has become less lowers the lag after one to two times this time [ns].
_CALM = 5 * SECOND
# Delays are looked at in windows of at least so long [ns] and so many messages. Those that come at
# once count as one, with the largest of their delays: before them, the path was known no further.
# The delay of an end is the smallest of the largest of so many windows, so that no hold-up is a
# delay, but poses that always come in bursts are.
_AT_ONCE, _WINDOW, _PER_WINDOW, _WINDOWS = SECOND // 50, SECOND // 4, 5, 8
# A need is reported again when it has grown by this factor.
_GROWN = 1.2
_QUANTUM = 10_000_000  # steps of the lag [ns], at least


class PoseTiming:
    """What the poses of one end effector need."""

    def __init__(self) -> None:
        self.timeout_ns = self.window_ns = 0
        self._used: deque[int] = deque(maxlen=_INTERVALS)  # intervals on the path
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)  # as poses come
        self._held = self._held_before = self._foreseen = 0
        self._held_since_ns: int | None = None
        self.clear()

    def configure(self, timeout_ns: int, window_ns: int) -> None:
        """Use pose_timeout, as longer intervals are silences, and half the smoothing window."""
        self.timeout_ns, self.window_ns = timeout_ns, window_ns

    def clear(self) -> None:
        """Forget the last poses, since stamps or clock have jumped; the rate stays."""
        self._newest_ns: int | None = None
        self._delays: list[int] = []
        self._slot_ns = self._since_ns = self._least_ns = 0
        self._largest: deque[int] = deque(maxlen=_WINDOWS)

    def accept(self, stamp_ns: int, now_ns: int) -> None:
        """Note that a pose has come at this time of the time base [ns]."""
        self._note_delay(now_ns - stamp_ns, now_ns)
        newest_ns = self._newest_ns
        if newest_ns is None or stamp_ns > newest_ns:
            self._newest_ns = stamp_ns
        if newest_ns is None or stamp_ns <= newest_ns:
            return
        interval_ns = stamp_ns - newest_ns
        self._intervals.append(interval_ns)
        if len(self._used) < _FORESEEN and interval_ns <= self.timeout_ns:
            self._foreseen = max(self._foreseen, self._need(interval_ns))

    def use(self, before_ns: int, stamp_ns: int) -> None:
        """Note that the path goes from one stamp to the next [ns]: none comes between any more."""
        self._used.append(stamp_ns - before_ns)
        if len(self._used) >= _FORESEEN:
            self._foreseen = 0
        if self._held_since_ns is None or stamp_ns - self._held_since_ns > _CALM:
            self._held_before, self._held = self._held, 0
            self._held_since_ns = stamp_ns
        self._held = max(self._held, self._need(_second_largest(self._used)))

    def _need(self, interval_ns: int) -> int:
        smoothing = self.window_ns + interval_ns if self.window_ns else 0
        return interval_ns + interval_ns // 2 + smoothing

    def _note_delay(self, delay_ns: int, now_ns: int) -> None:
        begun = bool(self._delays or self._largest)
        self._least_ns = min(delay_ns, self._least_ns) if begun else delay_ns
        if self._delays and abs(now_ns - self._slot_ns) < _AT_ONCE:
            self._delays[-1] = max(delay_ns, self._delays[-1])
            return
        if len(self._delays) >= _PER_WINDOW and now_ns - self._since_ns >= _WINDOW:
            self._largest.append(max(self._delays))
            self._delays = []
        if not self._delays:
            self._since_ns = now_ns
        self._delays.append(delay_ns)
        self._slot_ns = now_ns

    @property
    def interval_ns(self) -> int:
        """The second longest of the last intervals [ns]."""
        return _second_largest(self._intervals)

    @property
    def delay_ns(self) -> int:
        """The usual delay of the messages [ns]."""
        # A hold-up at the beginning may be the largest of the first window.
        return max(0, min(self._largest) if len(self._largest) > 1 else self._least_ns)

    @property
    def need_ns(self) -> int:
        """The lag that these poses need [ns]; 0 = not known yet."""
        need = max(self._held, self._held_before, self._foreseen)
        return need + self.delay_ns if need else 0

    @property
    def known(self) -> bool:
        """Whether the rate is seen from more than a few poses."""
        return len(self._intervals) >= 3

    @property
    def slower_than_timeout(self) -> bool:
        """Whether poses often come at longer intervals than pose_timeout."""
        slow = sum(interval > self.timeout_ns for interval in self._intervals)
        return slow >= _SILENCES


class Latency:
    """The lag of the prediction.

    Args:
        timings: end or grasp -> what is known of its poses.
        note: called with the name of an event and one line of text.

    Attributes:
        ns: the lag now [ns].
    """

    def __init__(
        self, scene: Scene, timings: Mapping[str, PoseTiming], note: Callable[[str, str], None]
    ) -> None:
        self._timings, self._note = timings, note
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use the settings of this scene; what is known of the poses stays."""
        self._auto = scene.inputs.latency < 0.0
        self._period_ns = round(1e9 / scene.rate)
        self.ns = round(scene.inputs.least_latency * SECOND)
        self._said: dict[tuple[str, str], int] = {}
        self._choose()

    def update(self) -> None:
        """Choose the lag from what is known of the poses now, or say what they need."""
        before_ns = self.ns
        self._choose()
        for end, timing in self._timings.items():
            need_ns = timing.need_ns
            if timing.slower_than_timeout:
                self._say(end, timing.interval_ns, self._of_timeout)
            elif self._auto and need_ns > before_ns and self.ns > before_ns:
                self._say(end, self.ns, self._of_auto)
            elif need_ns > self.ns and timing.known:
                self._say(end, need_ns, self._of_need)

    def _choose(self) -> None:
        if not self._auto:
            return
        least = round(LEAST_LATENCY * SECOND)
        need = max((timing.need_ns for timing in self._timings.values()), default=0)
        # Whole timer periods more than the least, so that the phase of the ticks stays right.
        quantum = self._period_ns * math.ceil(_QUANTUM / self._period_ns)
        more = max(0, -(-(need - least) // quantum)) * quantum
        self.ns = min(least + more, round(MOST_LATENCY * SECOND))

    def _say(self, end: str, size_ns: int, text: Callable[[str, PoseTiming], str]) -> None:
        key = end, text.__name__
        if size_ns > _GROWN * self._said.get(key, 0):
            self._said[key] = size_ns
            self._note("slow_poses", text(end, self._timings[end]))

    def _of_timeout(self, end: str, timing: PoseTiming) -> str:
        timeout, enough = timing.timeout_ns / SECOND, math.ceil(30 * timing.interval_ns / SECOND)
        return (
            f"{_rate(end, timing)}, further apart than {_key(end)}.pose_timeout {timeout:g} s: "
            f"each is held as the last; set it to {enough / 10:g} to move between them"
        )

    def _of_auto(self, end: str, timing: PoseTiming) -> str:
        return (
            f"{_rate(end, timing)}; to move between them, outputs are {self.ns / SECOND:g} s late"
        )

    def _of_need(self, end: str, timing: PoseTiming) -> str:
        need = math.ceil(100 * (timing.need_ns + self._period_ns) / SECOND) / 100
        cure = f"set it to {need:g} or auto"
        if self._auto or need > MOST_LATENCY:
            cure = "send them at a higher rate or earlier"
        return (
            f"{_rate(end, timing)}; inputs.latency {self.ns / SECOND:g} s is too short for that, "
            f"and outputs stop until the next one is there; {cure}"
        )


def _rate(end: str, timing: PoseTiming) -> str:
    late = f", {timing.delay_ns / SECOND:.3g} s late" if timing.delay_ns > _QUANTUM else ""
    return f"poses of {end} come {timing.interval_ns / SECOND:.3g} s apart{late}"


def _key(end: str) -> str:
    return end if end in ("start", "end") else f"grasps.{end}"


def _second_largest(values: deque[int]) -> int:
    """The second largest of several values, the largest of fewer than four."""
    ordered = sorted(values)
    return ordered[-2 if len(ordered) > 3 else -1] if ordered else 0
