"""Whether errors are estimated, and what cures one that exceeds accuracy.target."""

from __future__ import annotations

import math

from dlo_sim.core import bspline
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import needs_of
from dlo_sim.scene.parameters import PARAMETERS
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.report import DiscretizationError

MOST_CONTROL_POINTS = next(
    int(row.high or 0) for row in PARAMETERS if row.key == "discretization.control_points"
)
# EA h^2 / EI of a knot span h above which stretching by span was more accurate for strongly bent
# cables (cantilever of the work-precision study: 225 to 3600).
THIN = 200.0
SMALL = 0.25  # of the target: a part of the error below it can stay as it is
_SPARE = 1.2  # safety factor of the advice, so that the error ends up below the target
# The same for where in its span a grasp is: errors with the grasp on a knot were 1.3 to 1.7 times
# those with it amid a span, for equal spans.
_UNEVEN = 1.7


def estimated(scene: Scene) -> bool:
    """Whether the error of a prediction is estimated, as long as there is time for it."""
    wanted = scene.accuracy.estimate
    corrected = scene.measured.type != "none"  # by measurements; companions are not corrected
    return wanted == "on" or (wanted == "auto" and not corrected)


def bent_off_knots(scene: Scene) -> bool:
    """Whether a grasp holds the direction of the cable, now or when it is taken.

    The curvature jumps at such a grasp, which is usually no knot: the error decreases with the
    first power of the span, and unevenly, by where in its span the grasp is.
    """
    return any(grasp.holds_direction for grasp in scene.grasps)


def space_order(scene: Scene) -> int:
    """Order of convergence in the number of spans; see `error_estimate`."""
    return 1 if bent_off_knots(scene) else 2


def advice(scene: Scene, method: str, step: float, order: int, error: DiscretizationError) -> str:
    """An estimated error that exceeds the target, and settings that would do, one line; else empty.

    Args:
        scene: as it was simulated. method, step: with this method and this step [s].
        order: of convergence in time.
    """
    target = scene.accuracy.target
    if error.unknown:
        return f"the position error is unknown: {error.unknown}"
    if error.total <= target:
        return ""
    if not math.isfinite(error.total):
        return "the position error is too large to be estimated; shorten integrator.step"
    smaller = min(error.time, error.space)
    allowed = (target - smaller if smaller < SMALL * target else 0.5 * target) / _SPARE
    cures = []
    if error.space > allowed:
        uneven = _UNEVEN if bent_off_knots(scene) else 1.0
        finer = (uneven * error.space / allowed) ** (1.0 / space_order(scene))
        cures.append(_finer_in_space(scene, method, finer))
    if error.time > allowed:
        shorter = step / (error.time / allowed) ** (1.0 / order)
        cures.append(f"lower integrator.step to {_rounded_down(shorter):g} s")
    if error.time < error.space:
        cures[0] += "; discretization.stretch: span may do as well, since the cable is thin" * (
            _locks(scene) and len(cures) == 1
        )
    most = "space" if error.space >= error.time else "time"
    return (
        f"position error of some {error.total:.2g} m exceeds accuracy.target {target:g} m, mostly "
        f"of {most}; {' and '.join(cures)}"
    )


def _finer_in_space(scene: Scene, method: str, finer: float) -> str:
    """The change of the scene by which spans are so many times shorter."""
    choice = scene.discretization
    spans = (choice.control_points - bspline.DEGREE) * finer
    number = math.ceil(spans) + bspline.DEGREE
    if number > MOST_CONTROL_POINTS:
        return (
            f"raise accuracy.target, since {number} control points would be needed and "
            f"{MOST_CONTROL_POINTS} are the most"
        )
    cure = f"raise discretization.control_points to {number}"
    samples = 2 * (number - bspline.DEGREE)
    if choice.quadrature == "uniform" and choice.samples < samples:
        cure += f" and discretization.samples to {samples}"
    if scene.integrator.step and METHODS[method].family != IMPLICIT:
        cure += " and set integrator.step to 0"  # a shorter one is stable
    return cure


def _rounded_down(step: float) -> float:
    """With two digits."""
    digit = 10.0 ** (math.floor(math.log10(step)) - 1)
    return math.floor(step / digit + 1e-9) * digit


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
