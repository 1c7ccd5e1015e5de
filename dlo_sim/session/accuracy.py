"""The estimated error of a session: its companions, and the warning when it is too large."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from dlo_sim.scene.description import Scene
from dlo_sim.simulation.report import DiscretizationError

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.geometry import Pose
    from dlo_sim.simulation.simulator import Simulator

AGAIN = 0.5  # of the target: the error must have fallen below it before an excess counts again


def companions(simulator: Simulator, poses: Mapping[str, Pose] | None = None) -> ErrorEstimate:
    """Companions of a simulator that was placed at these poses; None: from its present state on."""
    from dlo_sim.simulation.error_estimate import ErrorEstimate  # imports the compiler

    if poses is None:
        return ErrorEstimate.continued(simulator)
    return ErrorEstimate.placed(simulator, poses)


class Accuracy:
    """Compares the estimated error of a session with its target.

    Args:
        note: called with the name of an event and one line of text.

    Attributes:
        warning: the excess and its cure, one line; empty while the error is acceptable.
        largest: the largest errors so far; None if none were estimated.
        advice: the cure for them; empty if they are acceptable.
    """

    def __init__(self, scene: Scene, note: Callable[[str, str], None]) -> None:
        self._note = note
        self._target = scene.accuracy.target
        self._estimate: ErrorEstimate | None = None  # of the present
        self._last: ErrorEstimate | None = None  # also once there is no time for it any more
        self._exceeded = False
        self.largest: DiscretizationError | None = None

    def look(self, estimate: ErrorEstimate | None) -> None:
        """Compare the largest error of the last second with the target; None: no estimate."""
        self._estimate = estimate
        if estimate is None:
            self._exceeded = False
            return
        error = estimate.recent
        exceeds = error.total > self._target
        self._keep_largest(estimate)
        if exceeds and not self._exceeded:
            self._exceeded = True
            self._note("inaccurate", estimate.advice(error))
        elif error.total < AGAIN * self._target:
            self._exceeded = False

    @property
    def warning(self) -> str:
        """The present error and what helps, if it exceeds the target; made when it is asked for."""
        estimate = self._estimate
        if estimate is None or estimate.recent.total <= self._target:
            return ""
        return estimate.advice(estimate.recent)

    @property
    def advice(self) -> str:
        """The same for the largest error so far."""
        if self._last is None or self.largest is None:
            return ""
        return self._last.advice(self.largest)

    def values(self) -> list[tuple[str, str]]:
        """Keys and values for the diagnostics."""
        if self._estimate is None:
            return [("error estimate [m]", "off")]
        error = self._estimate.recent
        return [
            ("error estimate [m]", _shown(error.total)),
            ("time error [m]", _shown(error.time)),
            ("space error [m]", _shown(error.space)),
            ("accuracy target [m]", f"{self._target:g}"),
        ]

    def _keep_largest(self, estimate: ErrorEstimate) -> None:
        error, before = estimate.recent, self.largest
        if before is None:
            self.largest = error
        elif error.time > before.time or error.space > before.space:
            parts = max(error.time, before.time), max(error.space, before.space)
            self.largest = DiscretizationError(*parts, error.unknown or before.unknown)
        self._last = estimate


def _shown(error: float) -> str:
    return f"{error:.3g}" if math.isfinite(error) else "unknown"
