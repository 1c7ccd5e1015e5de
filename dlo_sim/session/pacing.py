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


class Pacing:
    """The limits of a tick in whole numbers, and the lag.

    Attributes:
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
        self._grid = OutputGrid(scene.rate)
        self._latency_ns = round(inputs.latency * SECOND)
        self.most_steps = max(1, round(max(inputs.catch_up, 1.0 / scene.rate) / step))
        if self._live:
            self.most_steps = min(self.most_steps, _MOST_LIVE_STEPS)
        self._most_listened_ns = round(max(_MOST_LISTENED, 2.0 / scene.rate) * SECOND)
        self._most_lag_ns = round((max([MOST_LAG, *timeouts]) + inputs.catch_up) * SECOND)

    def clear(self) -> None:
        """Forget the lag and what was listened to."""
        self.lag_ns = 0
        self.listen_anew()

    def listen_anew(self) -> None:
        """The time base has other names: a silence begins with the next tick."""
        self._listened_ns: int | None = None

    def aim(self, base_ns: int) -> int:
        """The state [ns] that is wanted at this time of the time base [ns]."""
        return self._grid.aim(base_ns - self._latency_ns)

    def listen(self, wanted_ns: int) -> int:
        """Up to where a silence would have been noticed by this tick [ns]."""
        listened_ns = wanted_ns if self._listened_ns is None else self._listened_ns
        self._listened_ns = min(wanted_ns, listened_ns + self._most_listened_ns)
        return self._listened_ns

    def reached(self, wanted_ns: int, drive: Drive, held_up: bool) -> None:
        """Note the lag; keep a simulation that is too slow from falling behind for ever: first
        without the error estimate, then by leaving out time.

        Args:
            held_up: it waits for a pose or has failed, and is not slow.
        """
        before, self.lag_ns = self.lag_ns, max(0, wanted_ns - drive.now_ns)
        if held_up:
            return
        falling = self.lag_ns >= before > self._most_lag_ns // 2
        if falling and drive.spare_estimate():
            self._journal.event(
                "estimate_spared",
                "the prediction fell behind and goes on without its error estimate; keep it with "
                "accuracy.estimate: on",
            )
        too_slow = self.lag_ns >= before > self._most_lag_ns
        if too_slow or self.lag_ns > self._most_lag_ns + MOST_CATCH_UP * SECOND:
            skipped = drive.skip_to(wanted_ns)
            self._journal.skipped_ns += skipped
            self._journal.event(
                "time_skipped",
                f"{skipped * 1e-9:.3f} s could not be computed in time and were skipped",
            )
