"""Whether the discretisation error is estimated, and the warning with its cause and cure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import needs_of

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.geometry import Pose
    from dlo_sim.simulation.simulator import Simulator

AGAIN = 0.5  # of the target: the error must have fallen below it before an excess counts again
# EA h^2 / EI of a knot span h above which stretching by span was more accurate for strongly bent
# cables (cantilever of the work-precision study: 225 to 3600).
THIN = 200.0
_SPARE = 1.2  # safety factor of the advice, so that the error ends up below the target


def estimated(scene: Scene, live: bool) -> bool:
    """Whether the error of a prediction is estimated."""
    wanted = scene.accuracy.estimate
    corrected = scene.measured.type != "none"  # by measurements; companions are not corrected
    return wanted == "on" or (wanted == "auto" and live and not corrected)


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
    """

    def __init__(self, scene: Scene, note: Callable[[str, str], None]) -> None:
        self._note = note
        self._target = scene.accuracy.target
        self._control_points = scene.discretization.control_points
        self._locks = _locks(scene)
        self._estimate: ErrorEstimate | None = None
        self._exceeded = False
        self.warning = ""

    def look(self, estimate: ErrorEstimate | None) -> None:
        """Compare the largest error of the last second with the target; None: no estimate."""
        self._estimate = estimate
        if estimate is None:
            self._exceeded, self.warning = False, ""
            return
        error = estimate.recent
        exceeds = error.total > self._target
        if exceeds and not self._exceeded:
            self._exceeded = True
            self._note("inaccurate", self._explain(estimate))
        elif error.total < AGAIN * self._target:
            self._exceeded = False
        self.warning = self._explain(estimate) if exceeds else ""

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

    def _explain(self, estimate: ErrorEstimate) -> str:
        error = estimate.recent
        if error.unknown:
            return f"the position error is unknown: {error.unknown}"
        excess = _SPARE * error.total / self._target
        if error.space >= error.time:
            spans = (self._control_points - 3) * math.sqrt(excess)
            part = f"mostly of space; raise discretization.control_points to {spans + 3:.0f}"
            if self._locks:
                part += "; discretization.stretch: span may do as well, since the cable is thin"
        else:
            step = estimate.simulator.step / excess ** (1.0 / estimate.order)
            part = f"mostly of time; lower integrator.step to {step:.2g} s"
        return f"position error of some {error.total:.2g} m exceeds {self._target:g} m, {part}"


def _locks(scene: Scene) -> bool:
    """Whether the cable is so thin for its spans that stretching at every sample may keep it from
    bending freely (locking), and discretization.stretch can be set to span.
    """
    needs, cable = needs_of(scene), scene.cable
    span = cable.length / max(scene.discretization.control_points - 3, 1)
    thin = needs.stretch and needs.bend and cable.EA * span**2 > THIN * cable.EI
    if not thin or scene.discretization.stretch_by_span:
        return False
    try:
        scene.with_values({"discretization.stretch": "span"})
    except SceneError:
        return False
    return True


def _shown(error: float) -> str:
    return f"{error:.3g}" if math.isfinite(error) else "unknown"
