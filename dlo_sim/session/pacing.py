"""Limits how far a tick advances, and handles simulations that are too slow."""

from __future__ import annotations

from dlo_sim.scene.description import Scene
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.drive import Drive
from dlo_sim.session.step_grid import OutputGrid
from dlo_sim.session.time_base import SECOND

# A simulation that does not catch up skips time once its lag exceeds this [s], or the longest
# pose_timeout if that is longer, plus inputs.catch_up.
MOST_LAG = 1.0
# A lag that exceeds that limit by more than this [s] is skipped at once (a stopped process).
MOST_CATCH_UP = 3.0
# Before a late tick no messages were received. At most this much of that time [s], or two timer
# periods, counts as silence: the messages that waited are delivered between the next ticks.
_MOST_LISTENED = 0.1
# Most steps of a live tick, since callbacks, services and diagnostics wait for it. If the step is
# too short for that, the simulation falls behind, which is reported as lag and skipped time.
_MOST_LIVE_STEPS = 20_000
# What a simulation that falls behind drops, in this order, before it skips time: event, share of
# the largest lag at which it is dropped, and what is dropped.
_SHED = (
    ("markers_spared", 0.25, "its markers"),
    ("estimate_spared", 0.5, "its error estimate; keep it with accuracy.estimate: on"),
)
# What was dropped last is resumed after the simulation has kept up for this long [s], the next
# after twice as long, up to a limit: it may be what makes the simulation too slow.
_CALM, _MOST_CALM = 10.0, 600.0


class Pacing:
    """The limits of a tick, the lag, and the reactions to a lag.

    Attributes:
        grid: times of the states to publish.
        most_steps: most steps of one tick.
        lag_ns: time by which the state is behind the wanted one [ns].
        longest_lag_ns: the longest since this was last set to 0 [ns].
    """

    def __init__(self, scene: Scene, step: float, journal: Journal, live: bool) -> None:
        self._journal = journal
        self._live = live
        self.configure(scene, step)
        self.clear()

    def configure(self, scene: Scene, step: float) -> None:
        """Use the limits of this scene and the step [s] of its simulator."""
        inputs = scene.inputs
        timeouts = [end.pose_timeout for end in scene.holders.values() if end.driven]
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
        self._shed = 0  # number of entries of _SHED that are dropped
        self._calm_ns = round(_CALM * SECOND)
        self._kept_up_since_ns: int | None = None
        self.listen_anew()

    @property
    def without_markers(self) -> bool:
        """Whether markers are dropped."""
        return self._shed > 0

    def listen_anew(self) -> None:
        """Measure silences from the next tick on, after the time base has changed its offset."""
        self._listened_ns: int | None = None

    def listen(self, wanted_ns: int) -> int:
        """Time base [ns] up to which a silence can be detected by this tick."""
        listened_ns = wanted_ns if self._listened_ns is None else self._listened_ns
        self._listened_ns = min(wanted_ns, listened_ns + self._most_listened_ns)
        return self._listened_ns

    def reached(self, wanted_ns: int, drive: Drive, held_up: bool) -> None:
        """Update the lag. If the simulation is too slow, drop optional work first, then skip time.

        Args:
            held_up: it waits for a pose or has failed, so it is not too slow.
        """
        before, self.lag_ns = self.lag_ns, max(0, wanted_ns - drive.now_ns)
        self.longest_lag_ns = max(self.longest_lag_ns, self.lag_ns)
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
        """Resume what was dropped last once the simulation has kept up for long enough."""
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
