"""How far a tick goes, and what happens to a simulation that is too slow."""

from __future__ import annotations

from dlo_sim.scene.description import Scene
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.drive import Drive
from dlo_sim.session.step_grid import OutputGrid
from dlo_sim.session.time_base import SECOND

# Beyond pose_timeout and inputs.catch_up, a simulation this far behind that does not catch up skips
# time instead of falling back for ever [s].
MOST_LAG = 1.0
# A process that stood still catches up with at most so much [s]; what is further back is skipped.
MOST_CATCH_UP = 3.0
# A tick that comes late has not listened meanwhile. No more of that time than this, or two timer
# periods, counts as a silence: messages that waited are handed over between the next ticks [s].
_MOST_LISTENED = 0.1
# A live tick takes at most so many steps: callbacks, services and diagnostics wait for it. A step
# so short that this is not enough falls behind, which is reported as lag and skipped time.
_MOST_LIVE_STEPS = 20_000
# What a simulation that falls behind goes without, in this order, before it skips time: event,
# share of the most lag from which on, and what is given up.
_SHED = (
    ("markers_spared", 0.25, "its markers"),
    ("estimate_spared", 0.5, "its error estimate; keep it with accuracy.estimate: on"),
)
# The last of it comes back after the simulation has kept up for so long, and the next after twice
# as long: it may be just that which is too much [s].
_CALM, _MOST_CALM = 10.0, 600.0


class Pacing:
    """The limits of a tick in whole numbers, the lag, and what a lag costs.

    Attributes:
        grid: the states that are wanted.
        most_steps: steps that one tick may take.
        lag_ns: how far the simulation is behind what was wanted [ns].
    """

    def __init__(self, scene: Scene, step: float, journal: Journal, live: bool) -> None:
        self._journal = journal
        self._live = live
        self.configure(scene, step)
        self.clear()

    def configure(self, scene: Scene, step: float) -> None:
        """Take the limits from this scene and the step [s] of its simulator."""
        inputs = scene.inputs
        timeouts = [end.pose_timeout for end in scene.holders.values() if end.driven]
        self.grid = OutputGrid(scene.rate, round(inputs.latency * SECOND))
        self.most_steps = max(1, round(max(inputs.catch_up, 1.0 / scene.rate) / step))
        if self._live:
            self.most_steps = min(self.most_steps, _MOST_LIVE_STEPS)
        self._most_listened_ns = round(max(_MOST_LISTENED, 2.0 / scene.rate) * SECOND)
        self._catch_up_ns = round(inputs.catch_up * SECOND)
        self._most_lag_ns = round(max([MOST_LAG, *timeouts]) * SECOND) + self._catch_up_ns

    def clear(self) -> None:
        """Forget the lag, what was given up for it, and what was listened to."""
        self.lag_ns = 0
        self._shed = 0  # of _SHED, the first so many are given up
        self._calm_ns = round(_CALM * SECOND)
        self._kept_up_since_ns: int | None = None
        self.listen_anew()

    @property
    def without_markers(self) -> bool:
        """Whether there is no time for markers."""
        return self._shed > 0

    def listen_anew(self) -> None:
        """The time base has other names: a silence begins with the next tick."""
        self._listened_ns: int | None = None

    def listen(self, wanted_ns: int) -> int:
        """Up to where a silence would have been noticed by this tick [ns]."""
        listened_ns = wanted_ns if self._listened_ns is None else self._listened_ns
        self._listened_ns = min(wanted_ns, listened_ns + self._most_listened_ns)
        return self._listened_ns

    def reached(self, wanted_ns: int, drive: Drive, held_up: bool) -> None:
        """Note the lag; keep a simulation that is too slow from falling behind for ever: first
        without what it can go without, then by leaving out time.

        Args:
            held_up: it waits for a pose or has failed, and is not slow.
        """
        before, self.lag_ns = self.lag_ns, max(0, wanted_ns - drive.now_ns)
        if held_up:
            return
        falling_by = before if self.lag_ns >= before else 0
        if self._shed < len(_SHED) and falling_by > _SHED[self._shed][1] * self._most_lag_ns:
            self._give_up(drive)
        elif self._shed:
            self._take_up(wanted_ns, drive)
        if (
            falling_by > self._most_lag_ns
            or self.lag_ns > self._most_lag_ns + MOST_CATCH_UP * SECOND
        ):
            skipped = drive.skip_to(wanted_ns)
            self._journal.skipped_ns += skipped
            self._journal.event(
                "time_skipped",
                f"{skipped * 1e-9:.3f} s could not be computed in time and were skipped",
            )

    def _give_up(self, drive: Drive) -> None:
        event, _, what = _SHED[self._shed]
        self._shed += 1
        self._kept_up_since_ns = None
        if event != "estimate_spared" or drive.spare_estimate():
            self._journal.event(event, f"the prediction fell behind and goes on without {what}")

    def _take_up(self, wanted_ns: int, drive: Drive) -> None:
        """Give back what was given up last, once the simulation has kept up for long enough."""
        if self._kept_up_since_ns is None or self.lag_ns > self._catch_up_ns:
            self._kept_up_since_ns = wanted_ns
        if wanted_ns - self._kept_up_since_ns < self._calm_ns:
            return
        self._kept_up_since_ns = None
        self._calm_ns = min(2 * self._calm_ns, round(_MOST_CALM * SECOND))
        self._shed -= 1
        event, _, what = _SHED[self._shed]
        if event != "estimate_spared" or drive.resume_estimate():
            self._journal.event(
                "taken_up", f"the prediction keeps up and goes on with {what.partition(';')[0]}"
            )
