"""How far a tick advances: the lag behind the clock, the published times, and what overload drops.

The path of an end effector turns half-way between two poses towards the next one. With intervals dt
and a delay D of the messages, the simulation therefore has to run 1.5 dt + D behind the clock
(measured by `gripper_path.PoseTiming`). With inputs.latency `auto` the lag follows this need; a
shorter fixed lag is reported with the one that would do. The lag decides which states are published
and when, and how late a message may be; steps, paths and stamps do not depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum

from dlo_sim.scene.description import Scene
from dlo_sim.scene.node import LEAST_LATENCY, MOST_LATENCY
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.gripper_path import PoseTiming
from dlo_sim.session.time_base import SECOND

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


class Latency:
    """The lag `ns` [ns] of the prediction.

    Args:
        timings: end or grasp -> the rate and delay of its poses.
    """

    def __init__(self, scene: Scene, timings: Mapping[str, PoseTiming], journal: Journal) -> None:
        self._timings, self._note = timings, journal.event
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
        if not any(timing.fresh for timing in self._timings.values()):
            return
        before_ns = self.ns
        self._choose()
        for end, timing in self._timings.items():
            timing.fresh = False
            need_ns = timing.need_ns
            if timing.slower_than_timeout:
                enough = math.ceil(30 * timing.interval_ns / SECOND) / 10
                key = end if end in ("start", "end") else f"grasps.{end}"
                self._say(
                    *(end, "timeout", timing.interval_ns),
                    f", further apart than {key}.pose_timeout {timing.timeout_ns / SECOND:g} s: "
                    f"each is held as the last; set it to {enough:g} to move between them",
                )
            elif self._auto and need_ns > before_ns and self.ns > before_ns:
                late = f"; to move between them, outputs are {self.ns / SECOND:g} s late"
                self._say(end, "auto", self.ns, late)
            elif need_ns > self.ns and timing.known:
                self._say(end, "need", need_ns, self._too_short(need_ns))

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

    def _say(self, end: str, what: str, size_ns: int, text: str) -> None:
        """Say what follows from the rate of the poses, once unless it has grown since."""
        if size_ns > _GROWN * self._said.get((end, what), 0):
            self._said[end, what] = size_ns
            timing = self._timings[end]
            late = timing.delay_ns / SECOND
            late_by = f", {late:.3g} s late" if timing.delay_ns > _QUANTUM else ""
            apart = f"{timing.interval_ns / SECOND:.3g} s apart"
            self._note("slow_poses", f"poses of {end} come {apart}{late_by}{text}")


class Shed(Enum):
    """What a simulation that falls behind drops, in this order, and resumes in the other."""

    MARKERS = "its markers"
    ESTIMATE = "its error estimate"


class Pacing:
    """The limits of a tick, the lag, and the outputs that are dropped because of it.

    Attributes:
        grid: times of the states to publish. most_steps: largest number of steps of one tick.
        lag_ns, longest_lag_ns: how far the state is behind the wanted one [ns], and the longest
            such lag since this was set to 0.
        shed: which outputs the caller must leave out.
    """

    def __init__(self, scene: Scene, step: float, live: bool) -> None:
        self._live = live
        self.configure(scene, step)
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
