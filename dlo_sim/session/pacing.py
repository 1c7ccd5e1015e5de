"""How far a tick advances: the lag behind the clock, the published times, and what overload drops.

The path of an end effector turns half-way between two poses towards the next one. With intervals dt
and a delay D of the messages, the simulation therefore has to run 1.5 dt + D behind the clock, and
a smoothing window and an interval more if poses are smoothed (`PoseTiming`). With inputs.latency
`auto` the lag follows this need; a shorter fixed lag is reported with the one that would do. The
lag decides which states are published and when, and how late a message may be; steps, paths and
stamps do not depend on it.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections import deque
from enum import Enum
from itertools import pairwise

from dlo_sim.scene.description import Scene
from dlo_sim.scene.node import LEAST_LATENCY, MOST_LATENCY
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.time_base import SECOND

_INTERVALS = 10  # of which the second largest is the need: a single dropout does not count
_FEW = 4  # intervals from which the need is known, and held; of fewer, the longest foretells it
_KEPT = 100  # stamps, of which the newest may still come out of order
_SILENCES = 3  # intervals longer than pose_timeout that are a rate, not silences
_HELD = 5 * SECOND  # a need that has decreased lowers the lag after one to two times this time
# The delay of the poses is the smallest of the largest delays in each of _WINDOWS windows: a single
# hold-up does not count, bursts do. A window lasts at least _WINDOW and contains _PER_WINDOW
# arrivals. Messages within _AT_ONCE are one arrival with the delay of the oldest, because the path
# could not continue before they came.
_AT_ONCE, _WINDOW, _PER_WINDOW, _WINDOWS = SECOND // 50, SECOND // 4, 5, 8
_GROWN = 1.2  # factor by which a need has grown when it is reported again
_QUANTUM = 10_000_000  # steps of the lag [ns], at least
_JITTER = 500_000  # [ns]: usual jitter of ticks; at most a quarter of the period is used

# Time is skipped once the lag exceeds this [s], or the longest pose_timeout, plus inputs.catch_up.
MOST_LAG = 1.0
MOST_CATCH_UP = 3.0  # [s] beyond that limit from which a lag is skipped at once (a stopped process)
# Before a late tick no messages were received. At most this much of that time [s], or two timer
# periods, counts as silence: the messages that waited are delivered between the next ticks.
_MOST_LISTENED = 0.1
_MOST_LIVE_STEPS = 20_000  # of one tick, for which callbacks, services and diagnostics wait
_SHED = (0.25, 0.5)  # fractions of the largest lag at which markers, then the estimate, are dropped
# [s] of keeping up after which the output dropped last is resumed, and the limit to which this
# doubles with each further one: the resumed output may be what makes the simulation too slow.
_CALM, _MOST_CALM = 10.0, 600.0


class OutputGrid:
    """Times of the published states: integer multiples of the timer period at a rate [Hz].

    They do not depend on when the timer was started.
    """

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._jitter_ns = min(self._period_ns // 4, _JITTER)
        self._last: int | None = None

    def until_tick(self, base_ns: int) -> int:
        """Time [ns] from when a state of `base_ns` is due to the next regular tick, less than a
        period.

        Ticks come after a state has become due, by slightly more than their jitter.
        """
        return (5 * self._jitter_ns // 4 - base_ns) % self._period_ns

    def aim(self, base_ns: int) -> int:
        """The time [ns] to which a tick advances when states up to `base_ns` are due: the newest
        multiple.

        The successor of the last tick's multiple is kept until the next one is older than the
        jitter, so that ticks which jitter about a multiple skip none.
        """
        period = self._period_ns
        index = base_ns // period
        if self._last is not None:
            following = self._last + 1
            if following * period <= base_ns < (following + 1) * period + self._jitter_ns:
                index = following
        self._last = index
        return index * period


class PoseTiming:
    """The lag that the poses of one end effector need, from their newest stamps and their delays.

    Attributes:
        timeout_ns, window_ns: pose_timeout, as longer intervals are silences, and half the
            smoothing window [ns].
        interval_ns: second longest of the last intervals [ns].
        slower_than_timeout: whether poses often come at longer intervals than pose_timeout.
    """

    def __init__(self, timeout_ns: int = SECOND, window_ns: int = 0) -> None:
        self.timeout_ns, self.window_ns = timeout_ns, window_ns
        self.interval_ns, self.slower_than_timeout = 0, False
        self._held = self._held_before = self._held_since_ns = self._foreseen = 0
        self.clear()

    def clear(self) -> None:
        """Forget the last poses, since stamps or clock have jumped; the need stays."""
        self._stamps: list[int] = []  # the newest, in their order
        self._delays: list[int] = []
        self._at_ns = self._since_ns = self._least_ns = 0
        self._largest: deque[int] = deque(maxlen=_WINDOWS)

    def accept(self, stamp_ns: int, now_ns: int) -> None:
        """Note that a pose has come at this time of the time base [ns]."""
        self._note_delay(now_ns - stamp_ns, now_ns)
        insort(self._stamps, stamp_ns)
        del self._stamps[:-_KEPT]
        # Between later ones, others may still come.
        late_ns = min(self._largest, default=max(self._delays))
        settled = bisect_right(self._stamps, now_ns - late_ns)
        newest = self._stamps[max(settled - _INTERVALS - 1, 0) : settled]
        intervals = sorted(b - a for a, b in pairwise(newest))
        slow = sum(one > self.timeout_ns for one in intervals)
        self.interval_ns, self.slower_than_timeout = _second_largest(intervals), slow >= _SILENCES
        interval_ns = _second_largest(intervals[: len(intervals) - slow])
        smoothing_ns = self.window_ns + interval_ns if self.window_ns and interval_ns else 0
        need_ns = interval_ns + interval_ns // 2 + smoothing_ns
        if abs(now_ns - self._held_since_ns) > _HELD:
            self._held_before, self._held, self._held_since_ns = self._held, 0, now_ns
        self._foreseen = need_ns if len(intervals) < _FEW else 0
        if not self._foreseen:
            self._held = max(self._held, need_ns)

    def _note_delay(self, delay_ns: int, now_ns: int) -> None:
        begun = bool(self._delays or self._largest)
        self._least_ns = min(delay_ns, self._least_ns) if begun else delay_ns
        if self._delays and abs(now_ns - self._at_ns) < _AT_ONCE:
            self._delays[-1] = max(delay_ns, self._delays[-1])
            return
        if len(self._delays) >= _PER_WINDOW and now_ns - self._since_ns >= _WINDOW:
            self._largest.append(max(self._delays))
            self._delays = []
        if not self._delays:
            self._since_ns = now_ns
        self._delays.append(delay_ns)
        self._at_ns = now_ns

    @property
    def delay_ns(self) -> int:
        """The usual delay of the messages [ns]."""
        # The only window may contain a hold-up at the beginning.
        return max(0, min(self._largest) if len(self._largest) > 1 else self._least_ns)

    @property
    def need_ns(self) -> int:
        """The lag that these poses need [ns]; 0 = not known yet."""
        need = max(self._held, self._held_before, self._foreseen)
        return need + self.delay_ns if need else 0

    @property
    def known(self) -> bool:
        """Whether the rate is seen from more than a few poses."""
        return len(self._stamps) > 3


def _second_largest(rising: list[int]) -> int:
    """The second largest of several values, the largest of few."""
    return rising[-2 if len(rising) >= _FEW else -1] if rising else 0


class Latency:
    """The lag `ns` [ns] of the prediction."""

    def __init__(self, scene: Scene, journal: Journal) -> None:
        self._note = journal.event
        self._timings = {name: PoseTiming() for name in scene.moved}
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use the settings of this scene; what is known of the poses stays."""
        self._auto = scene.inputs.latency < 0.0
        self._period_ns = round(1e9 / scene.rate)
        self.ns = round(scene.inputs.least_latency * SECOND)
        self._said: dict[tuple[str, str], int] = {}
        self._fresh: dict[str, None] = {}  # those whose poses came since the last update
        for name, one in scene.moved.items():
            timing = self._timings[name]
            timing.timeout_ns = round(one.pose_timeout * SECOND)
            timing.window_ns = round(one.pose_smoothing * SECOND)
        self._choose()

    def clear(self) -> None:
        """Forget the last poses, since stamps or clock have jumped."""
        for timing in self._timings.values():
            timing.clear()

    def accept(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Note that a pose of an end effector has come at this time of the time base [ns]."""
        self._timings[name].accept(stamp_ns, now_ns)
        self._fresh[name] = None

    def update(self) -> None:
        """Choose the lag from what is known of the poses now, or say what they need."""
        before_ns = self.ns
        if self._fresh:
            self._choose()
        for name in self._fresh:
            timing = self._timings[name]
            need_ns = timing.need_ns
            if timing.slower_than_timeout:
                enough = math.ceil(30 * timing.interval_ns / SECOND) / 10
                key = name if name in ("start", "end") else f"grasps.{name}"
                self._say(
                    *(name, "timeout", timing.interval_ns),
                    f", further apart than {key}.pose_timeout {timing.timeout_ns / SECOND:g} s: "
                    f"each is held as the last; set it to {enough:g} to move between them",
                )
            elif self._auto and need_ns > before_ns and self.ns > before_ns:
                late = f"; to move between them, outputs are {self.ns / SECOND:g} s late"
                self._say(name, "auto", self.ns, late)
            elif need_ns > self.ns and timing.known:
                self._say(name, "need", need_ns, self._too_short(need_ns))
        self._fresh.clear()

    def _choose(self) -> None:
        if not self._auto:
            return
        least = round(LEAST_LATENCY * SECOND)
        need = max((timing.need_ns for timing in self._timings.values()), default=0)
        # The excess over the least lag is whole timer periods, which keeps the phase of the ticks.
        quantum = self._period_ns * math.ceil(_QUANTUM / self._period_ns)
        more = max(0, -(-(need - least) // quantum)) * quantum
        self.ns = min(least + more, round(MOST_LATENCY * SECOND))

    def _too_short(self, need_ns: int) -> str:
        need = math.ceil(100 * (need_ns + self._period_ns) / SECOND) / 100
        cure = f"set it to {need:g} or auto"
        if self._auto or need > MOST_LATENCY:
            cure = "send them at a higher rate or earlier"
        return (
            f"; inputs.latency {self.ns / SECOND:g} s is too short for that, and outputs stop "
            f"until the next one is there; {cure}"
        )

    def _say(self, name: str, what: str, size_ns: int, text: str) -> None:
        """Say what follows from the rate of the poses, once unless it has grown since."""
        if size_ns > _GROWN * self._said.get((name, what), 0):
            self._said[name, what] = size_ns
            timing = self._timings[name]
            late = timing.delay_ns / SECOND
            late_by = f", {late:.3g} s late" if timing.delay_ns > _QUANTUM else ""
            apart = f"{timing.interval_ns / SECOND:.3g} s apart"
            self._note("slow_poses", f"poses of {name} come {apart}{late_by}{text}")


class Shed(Enum):
    """What a simulation that falls behind drops, in this order, and resumes in the other."""

    MARKERS = "its markers"
    ESTIMATE = "its error estimate"


class Pacing:
    """The limits of a tick, the lag, and the outputs that are dropped because of it; to be given a
    scene by `configure`.

    Attributes:
        grid: times of the states to publish. most_steps: largest number of steps of one tick.
        lag_ns, longest_lag_ns: how far the state is behind the wanted one [ns], and the longest
            such lag since this was set to 0.
        shed: which outputs the caller must leave out.
    """

    def __init__(self, live: bool) -> None:
        self._live = live
        self.clear()

    def configure(self, scene: Scene, step: float) -> None:
        """Use the limits of this scene and the step [s] of its simulator."""
        inputs = scene.inputs
        timeouts = [one.pose_timeout for one in scene.moved.values()]
        self.grid = OutputGrid(scene.rate)
        self.most_steps = max(1, round(max(inputs.catch_up, 1.0 / scene.rate) / step))
        if self._live:
            self.most_steps = min(self.most_steps, _MOST_LIVE_STEPS)
        self._most_listened_ns = round(max(_MOST_LISTENED, 2.0 / scene.rate) * SECOND)
        self._catch_up_ns = round(inputs.catch_up * SECOND)
        self._most_lag_ns = round(max([MOST_LAG, *timeouts]) * SECOND) + self._catch_up_ns

    def clear(self) -> None:
        """Clear the lag, resume what was dropped, and start to measure silences anew."""
        self.lag_ns = self.longest_lag_ns = 0
        self.shed: tuple[Shed, ...] = ()
        self._calm_ns = round(_CALM * SECOND)
        self._kept_up_since_ns: int | None = None
        self.listen_anew()

    def listen_anew(self) -> None:
        """Measure silences from the next tick on, after the time base has changed its offset."""
        self._listened_ns: int | None = None

    def listen(self, wanted_ns: int) -> int:
        """Time base [ns] up to which a silence can be detected by this tick."""
        listened_ns = wanted_ns if self._listened_ns is None else self._listened_ns
        self._listened_ns = min(wanted_ns, listened_ns + self._most_listened_ns)
        return self._listened_ns

    def reached(self, wanted_ns: int, now_ns: int, held_up: bool) -> bool:
        """Update the lag and what is dropped because of it; return whether the lag is to be
        skipped.

        Args:
            wanted_ns, now_ns: time base [ns] to which a tick should have advanced, and has.
            held_up: it waits for a pose or has failed, so it is not too slow.
        """
        before, self.lag_ns = self.lag_ns, max(0, wanted_ns - now_ns)
        self.longest_lag_ns = max(self.longest_lag_ns, self.lag_ns)
        if held_up:
            return False
        falling_by = before if self.lag_ns >= before else 0
        dropped = len(self.shed)
        if dropped < len(_SHED) and falling_by > _SHED[dropped] * self._most_lag_ns:
            self.shed = tuple(Shed)[: dropped + 1]
            self._kept_up_since_ns = None
        elif dropped:
            self._take_up(wanted_ns)
        return (
            falling_by > self._most_lag_ns
            or self.lag_ns > self._most_lag_ns + MOST_CATCH_UP * SECOND
        )

    def _take_up(self, wanted_ns: int) -> None:
        """Resume what was dropped last once the simulation has kept up for long enough."""
        if self._kept_up_since_ns is None or self.lag_ns > self._catch_up_ns:
            self._kept_up_since_ns = wanted_ns
        if wanted_ns - self._kept_up_since_ns >= self._calm_ns:
            self._kept_up_since_ns = None
            self._calm_ns = min(2 * self._calm_ns, round(_MOST_CALM * SECOND))
            self.shed = self.shed[:-1]
