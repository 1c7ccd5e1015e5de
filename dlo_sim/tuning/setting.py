"""What a scene leaves to numerics: resolution, quadrature, method, step, and terms left out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dlo_sim.core.bspline import DEGREE
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene, scene_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.resolution import resolved

FEWEST = 2  # spans of a cable of a net
FEW = 7  # control points, of a cable with long spans
KEYS = {
    "method": "integrator.method",
    "control_points": "discretization.control_points",
    "step": "integrator.step",
    "samples": "discretization.samples",
    "quadrature": "discretization.quadrature",
    "stretch": "discretization.stretch",
    "knots": "discretization.knots",
}
"""Attribute of a setting -> key of the scene that it decides."""


@dataclass(frozen=True, order=True)
class Setting:
    """How a scene is computed.

    Attributes:
        method: integrator.method.
        control_points: n_u. samples: Gauss points per knot span, or uniform samples in all.
        step: tau [s]; 0 = what accuracy.target needs, at most 0.9 of the stability limit.
        stretch, knots: values of these keys of discretization.
        off: terms that are switched off although they are in the scene.
        tolerance: integrator.tolerance; None = the scene's.
    """

    method: str
    control_points: int
    step: float = 0.0
    samples: int = 3
    quadrature: str = "gauss"
    stretch: str = "sample"
    knots: str = "uniform"
    off: tuple[str, ...] = ()
    tolerance: float | None = None

    @property
    def values(self) -> dict[str, object]:
        """The scene's keys that this setting decides, and their values."""
        decided = {key: getattr(self, name) for name, key in KEYS.items()}
        if self.tolerance is not None:
            decided["integrator.tolerance"] = self.tolerance
        return decided | {f"terms.{name}": "off" for name in self.off}

    def applied(self, scene: Scene) -> Scene:
        """The scene computed with this setting; raises SceneError if it does not fit.

        The spans of further cables of a net are in proportion to those of the main one.
        """
        values = self.values
        if len(scene.strands) > 1:
            strands = resolved(scene)[0].strands
            main, *spans = (one.scene.discretization.control_points - DEGREE for one in strands)
            for strand, own in zip(strands[1:], spans, strict=True):
                number = max(math.ceil(own * (self.control_points - DEGREE) / main), FEWEST)
                values[strand.key_of("discretization.control_points")] = number + DEGREE
        return scene.with_values(values)

    @property
    def words(self) -> str:
        """One line for people."""
        step = "its own step" if self.step == 0.0 else f"{1e3 * self.step:.4g} ms"
        rule = "per span" if self.quadrature == "gauss" else "in all"
        without = f", without {', '.join(self.off)}" if self.off else ""
        by = ", stretch by span" if self.stretch == "span" else ""
        implicit = self.method in METHODS and METHODS[self.method].family == IMPLICIT
        may_grade = implicit and self.quadrature == "gauss"
        graded = f", knots {self.knots}" if self.knots != "uniform" and may_grade else ""
        points = f"{self.samples} points {rule}{by}{graded}"
        loose = "" if self.tolerance is None else f", tolerance {self.tolerance:g}"
        return f"{self.method}, n_u {self.control_points}, {points}, {step}{loose}{without}"


def present_setting(scene: Scene) -> Setting:
    """What a scene asks for now, with the number of control points that it gets."""
    values = scene_values(scene)
    asked = Setting(**{name: values[key] for name, key in KEYS.items()})
    return replace(asked, control_points=resolved(scene)[0].discretization.control_points)


def ways_to_resolve(scene: Scene, method: str) -> tuple[tuple[str, str], ...]:
    """Values of `stretch` and `knots` worth trying: stretching by span only of a scene that
    stretches, shorter spans at clamps only of one that has clamps and weight, by implicit steps.
    """
    integrator = replace(scene.integrator, method=method)
    plain = "sample", "uniform"
    if "stretch" not in needs_of(replace(scene, integrator=integrator)):
        return (plain,)
    coarse = Setting(method, FEW, 1e-3, knots="auto").applied(scene)
    try:
        graded = resolved(coarse)[0].discretization.knots == "graded"
    except SceneError:  # an attempt with this method is refused for the same reason
        graded = False
    return (plain, ("span", "uniform"), *[("span", "auto")] * graded)
