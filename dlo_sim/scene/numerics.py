"""What a scene says of how it is computed: spline, terms, first shape, method and accuracy."""

from dataclasses import dataclass
from typing import Any

from dlo_sim.scene.parameter import SWITCH, Group, parameter
from dlo_sim.scene.refusal import Rules

LEAST_STEP = 1e-9  # [s]; 0 = chosen automatically
LEAST_BY_SPAN = 9  # control points from which stretching by span is never less accurate


@dataclass(frozen=True)
class Discretization(Group):
    """Spline, quadrature and mass matrix.

    Parameters:
        control_points: Number of control points n_u of the cubic B-spline, at least 4; 0 = chosen
            from the scene and accuracy.target.
        quadrature: Quadrature along the cable: Gauss points in each knot span, or uniformly spaced
            points.
        samples: Quadrature points: per knot span for gauss (2 to 10), in total for uniform (at
            least 2 per span).
        stretch: How the stretching energy is evaluated: at every quadrature point (sample), or from
            the mean stretch of each knot span (span; needs gauss and 5 control points), which
            avoids membrane locking of thin cables with few control points. Auto: span with gauss
            and 9 control points or more, else sample.
        mass: Mass matrix: consistent (banded), or lumped (diagonal, less accurate).
        knots: Knot spans of equal length (uniform), or shorter ones near clamped ends: by
            `discretization.grading` (graded; with gauss), or where a cable bends sharply there
            (auto).
        grading: With knots graded: density of the knots at the start and at the end in excess of
            that elsewhere, which counts as 1, and the length [m] over which the excess decays by
            1/e.
    """

    control_points: int = parameter(0, "", (0, 2000))
    quadrature: str = parameter("gauss", choices=("gauss", "uniform"))
    samples: int = parameter(3, "", (1, 100_000))
    stretch: str = parameter("auto", choices=("auto", "sample", "span"))
    mass: str = parameter("consistent", choices=("consistent", "lumped"))
    knots: str = parameter("auto", choices=("auto", "uniform", "graded"))
    grading: tuple[float, float, float] = parameter((0.0, 0.0, 1.0), "", (0.0, 1e3))

    @property
    def stretch_by_span(self) -> bool:
        """Whether the stretching energy uses the strain projected on each span."""
        many = self.control_points == 0 or self.control_points >= LEAST_BY_SPAN
        enough = self.quadrature == "gauss" and many
        return self.stretch == "span" or (self.stretch == "auto" and enough)

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Quadratures that do not fit the knots, or leave motions that cost no energy."""
        gauss, by_span = self.quadrature == "gauss", self.stretch == "span"
        number = self.control_points
        least = max(2 * (number - 3), 4)
        if 0 < number < 4:
            yield "control_points", "are too few for a cubic; give 4 or more, or 0"
        if self.knots == "graded" and not gauss:
            yield "knots", "need Gauss points; set discretization.quadrature to gauss"
        if self.knots == "graded" and self.grading[2] == 0.0:
            yield "grading", "decays over no length; give one above 0 m as the third number"
        if gauss and not 2 <= self.samples <= 10:
            cure = (
                "give 2 to 10 (a single one leaves ways to bend that cost no energy), or set "
                "discretization.quadrature to uniform"
            )
            yield "samples", f"points per knot span will not do for gauss; {cure}"
        if by_span and not gauss:
            cure = "set discretization.quadrature to gauss, or stretch to sample"
            yield "stretch", f"needs Gauss points; {cure}"
        if by_span and 0 < number < 5:
            cure = "give 5 control points or more, or set it to sample"
            yield "stretch", f"leaves a single span ways to stretch that cost no energy; {cure}"
        if not gauss and self.samples < least:
            cure = f"give {least} or more in all, two a knot span"
            yield "samples", f"samples are too few for uniform quadrature; {cure}"


@dataclass(frozen=True)
class Terms:
    """Terms of the model: `auto`, `on`, `off`, or a variant of the term.

    Parameters:
        stretch: Axial stretching energy. If off, the cable keeps its length (with energy_momentum
            and energy_momentum_4, unless its ends pull it taut).
        bend: Bending energy.
        twist: Torsional energy and twist angle theta. bishop: in a rotation-minimising frame, so
            that twist and shape act on each other, and friction of obstacles rolls the cable;
            quasistatic: as bishop, without rotary inertia about the axis, and without rolling;
            frenet: relative to the torsion of the centerline, with explicit methods; auto:
            quasistatic where the roll is held or turned, with friction bishop, off with explicit
            methods.
        gravity: Weight.
        damping: All damping.
        plasticity: Plastic bending.
        contact: Contact.
        out_of_plane: The third coordinate. Auto omits it of a cable that hangs taut in a coordinate
            plane and cannot fall over sideways; off keeps any cable in its plane: it drops forces
            and moments out of it and projects the motion of the ends onto it.
    """

    stretch: str = parameter("auto", choices=SWITCH)
    bend: str = parameter("auto", choices=SWITCH)
    twist: str = parameter("auto", choices=("auto", "off", "bishop", "quasistatic", "frenet"))
    gravity: str = parameter("auto", choices=SWITCH)
    damping: str = parameter("auto", choices=SWITCH)
    plasticity: str = parameter("auto", choices=SWITCH)
    contact: str = parameter("auto", choices=SWITCH)
    out_of_plane: str = parameter("auto", choices=SWITCH)


@dataclass(frozen=True)
class Initial:
    """Shape at the start.

    Parameters:
        shape: Initial shape, also after a reset; auto = straight if an end is free or the held ends
            are one cable length apart, and the straight cable begins in no obstacle, else
            equilibrium.
    """

    shape: str = parameter("auto", choices=("auto", "straight", "equilibrium"))


@dataclass(frozen=True)
class Integrator(Group):
    """Time integration: method, step, and the reaction to a failure.

    Parameters:
        method: Time integration method; see `dlo_sim methods`.
        step: Time step tau, at least 1e-9; 0 = chosen from the scene and accuracy.target.
        tolerance: Energy balance error allowed in one step of an implicit method, as a fraction of
            the energy exchanged; the error of the whole run stays within ten times this value.
        on_failure: If a step fails: hold the last good state until ~/reset, or stop the node.
    """

    method: str = parameter("auto")
    step: float = parameter(0.0, "s", (0.0, 1.0))
    tolerance: float = parameter(1.0e-6, "", (1.0e-15, 1.0e-2))
    on_failure: str = parameter("hold", choices=("hold", "stop"))

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A step below the resolution of stamps."""
        if 0.0 < self.step < LEAST_STEP:
            what = f"s is below {LEAST_STEP:g} s, the resolution of stamps"
            yield "step", f"{what}; give 0 to have it chosen"


@dataclass(frozen=True)
class Accuracy(Group):
    """Acceptable position error, and whether the error is estimated.

    Parameters:
        target: Acceptable position error; a larger estimate causes a warning.
        estimate: Estimate the error from two refined simulations in threads beside the run; auto =
            unless measured points correct the prediction, and in the node as long as it keeps up.
    """

    target: float = parameter(0.001, "m", (1e-9, 1e3))
    estimate: str = parameter("auto", choices=SWITCH)

    def conflicts(self, key: str, scene: Any) -> Rules:
        """An estimate by finer runs, which measured points do not correct."""
        if self.estimate == "on" and scene.measured.type != "none":
            cure = "give auto, or measured.type: none"
            yield "estimate", f"cannot be had while measured points correct the prediction; {cure}"
