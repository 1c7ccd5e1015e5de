"""Terms, mesh, time integration, inputs and outputs: groups of parameters, as in `cable.py`."""

from dataclasses import dataclass

from dlo_sim.scene.parameter import parameter

SWITCH = ("auto", "on", "off")
LEAST_LATENCY, MOST_LATENCY = 0.06, 10.0  # s, of inputs.latency auto
LEAST_BY_SPAN = 9  # control points from which stretching by span is never less accurate


@dataclass(frozen=True)
class Discretization:
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
        mass: Mass matrix: consistent (banded), lumped (diagonal, less accurate), or selective:
            consistent, with added mass for motion that the spline does not resolve, which allows
            explicit steps about twice as long.
        knots: Knot spans of equal length (uniform), or shorter ones near clamped ends: by
            `discretization.grading` (graded; with gauss), or where a cable bends sharply there and
            nothing speaks against it (auto).
        grading: With knots graded: density of the knots at the start and at the end in excess of
            that elsewhere, which counts as 1, and the length [m] over which the excess decays by
            1/e.
    """

    control_points: int = parameter(0, "", (0, 2000))
    quadrature: str = parameter("gauss", choices=("gauss", "uniform"))
    samples: int = parameter(3, "", (1, 100_000))
    stretch: str = parameter("auto", choices=("auto", "sample", "span"))
    mass: str = parameter("consistent", choices=("consistent", "lumped", "selective"))
    knots: str = parameter("auto", choices=("auto", "uniform", "graded"))
    grading: tuple[float, float, float] = parameter((0.0, 0.0, 1.0), "", (0.0, 1e3))

    @property
    def stretch_by_span(self) -> bool:
        """Whether the stretching energy uses the strain projected on each span."""
        many = self.control_points == 0 or self.control_points >= LEAST_BY_SPAN
        enough = self.quadrature == "gauss" and many
        return self.stretch == "span" or (self.stretch == "auto" and enough)


@dataclass(frozen=True)
class Terms:
    """Terms of the model: `auto`, `on`, `off`, or a variant of the term.

    Parameters:
        stretch: Axial stretching energy. If off and integrator.method is auto, the cable is
            inextensible (rattle) where possible.
        bend: Bending energy.
        twist: Torsional energy and twist angle theta. bishop: in a rotation-minimising frame, so
            that twist and shape act on each other; quasistatic: as bishop, without rotary inertia
            about the axis; auto: quasistatic where the roll is held or turned, with explicit
            methods bishop; on: twist rate theta', which does not affect the shape; frenet: relative
            to the torsion of the centerline.
        gravity: Weight.
        damping: All damping.
        plasticity: Plastic bending.
        contact: Contact.
        out_of_plane: The third coordinate. Auto omits it if everything stays in a coordinate plane;
            off drops forces and moments out of the plane and projects the motion of the ends onto
            it.
    """

    stretch: str = parameter("auto", choices=SWITCH)
    bend: str = parameter("auto", choices=SWITCH)
    twist: str = parameter("auto", choices=("auto", "on", "off", "bishop", "frenet", "quasistatic"))
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
            are one cable length apart, else equilibrium.
    """

    shape: str = parameter("auto", choices=("auto", "straight", "equilibrium"))


IMPLICIT_METHODS = ("auto", "implicit_midpoint", "energy_momentum", "energy_momentum_4")
"""Values of integrator.method with which steps may be implicit."""


@dataclass(frozen=True)
class Integrator:
    """Time integration: method, step, and the reaction to a failure.

    Parameters:
        method: Time integration method; see `dlo_sim methods`.
        step: Time step tau, at least 1e-9; 0 = chosen from the scene and accuracy.target.
        zhai_psi: Parameter psi of Zhai's method; the pair 0.5, 0.5 has the largest stable step.
        zhai_phi: Parameter phi of Zhai's method; only 0.5 is second order.
        tolerance: Energy balance error allowed in one step of an implicit method, as a fraction of
            the energy exchanged; the error of the whole run stays within ten times this value.
        on_failure: If a step fails: hold the last good state until ~/reset, or stop the node.
    """

    method: str = parameter("auto")
    step: float = parameter(0.0, "s", (0.0, 1.0))
    zhai_psi: float = parameter(0.5, "", (0.0, 1.0))
    zhai_phi: float = parameter(0.5, "", (0.0, 1.0))
    tolerance: float = parameter(1.0e-6, "", (1.0e-15, 1.0e-2))
    on_failure: str = parameter("hold", choices=("hold", "stop"))


@dataclass(frozen=True)
class Inputs:
    """Processing of input messages: time base, latency, limits, catching up.

    Parameters:
        latency: Lag of the prediction, so that poses are interpolated, never extrapolated: auto
            (-1) = 0.06, or as much more as the measured rate and delay of the poses need. A warning
            says what they need if a given lag is too short.
        time: Time of an input: its header stamp, its arrival, or (auto) the stamp, shifted if its
            epoch differs from the clock's.
        tf: Look up frames that the scene does not name in tf2, at the stamp of the message; the
            message waits at most inputs.latency for its transform.
        max_speed: Poses that imply a higher speed are refused.
        max_force: Larger forces are refused.
        max_torque: Larger torques are refused.
        catch_up: Maximum simulated time per timer tick; at least one timer period.
    """

    latency: float = parameter(-1.0, "s", (0.0, MOST_LATENCY), auto=-1.0)
    time: str = parameter("auto", choices=("auto", "stamp", "arrival"))
    tf: bool = parameter(False, read_only=True)
    max_speed: float = parameter(20.0, "m/s", (1.0e-3, 1.0e6))
    max_force: float = parameter(1.0e4, "N", (1.0e-6, 1.0e9))
    max_torque: float = parameter(1.0e3, "N m", (1.0e-6, 1.0e9))
    catch_up: float = parameter(0.1, "s", (1.0e-3, 10.0))

    @property
    def least_latency(self) -> float:
        """The lag [s] if no pose needs more."""
        return LEAST_LATENCY if self.latency < 0.0 else self.latency


@dataclass(frozen=True)
class Measured:
    """Measured points on the cable that correct the prediction.

    Parameters:
        type: Message type of ~/measured: points on the cable in any order, not necessarily all
            visible; none = no correction.
        noise: Standard deviation of each measured coordinate.
        error: Standard deviation of the error of the uncorrected prediction: the larger it is
            relative to the noise, the more a measured point moves the cable.
        alike_along: Correlation length of that error, as a fraction of the cable.
        alike_for: Correlation time of that error: the lag of the correction.
        gate: Points farther than this from the prediction are rejected.
    """

    type: str = parameter("none", choices=("none", "point_cloud", "pose_array"), read_only=True)
    noise: float = parameter(0.005, "m", (1e-6, 1.0))
    error: float = parameter(0.02, "m", (1e-6, 10.0))
    alike_along: float = parameter(0.1, "", (0.01, 1.0))
    alike_for: float = parameter(0.25, "s", (1e-3, 100.0))
    gate: float = parameter(0.1, "m", (1e-6, 100.0))


@dataclass(frozen=True)
class Outputs:
    """Outputs other than the control points.

    Parameters:
        centerline_samples: Number of centerline points in markers and recordings.
        marker_rate: Rate of the markers.
        color_by: Quantity shown by the colours of the centerline marker, from dark (low) to bright
            (high): tension [N] or curvature [1/m].
        points: Publish the centerline as PointCloud2 on ~/points, with x, y, z, u [m] and, if
            known, tension [N].
        capsules: Number of capsules that together enclose the cable, published on ~/capsules for
            planning scenes; 0 = none. A capsule is thicker where the cable bends inside it.
        tf: Publish the ends of the cable and the grippers of its grasps on /tf, as frames
            `<node>/start`, `<node>/end`, `<node>/<grasp>`.
        color_range: Values at the darkest and the brightest colour, in the unit of
            outputs.color_by; two equal values = the range of the current shape.
    """

    centerline_samples: int = parameter(50, "", (2, 10_000))
    marker_rate: float = parameter(30.0, "Hz", (0.1, 1000.0))
    color_by: str = parameter("none", choices=("none", "tension", "curvature"))
    points: bool = parameter(False)
    capsules: int = parameter(0, "", (0, 1000))
    tf: bool = parameter(False, read_only=True)
    color_range: tuple[float, float] = parameter((0.0, 0.0), "", (-1.0e9, 1.0e9))


@dataclass(frozen=True)
class Forecasts:
    """Forecasts of the cable along received plans.

    Parameters:
        processes: Worker processes that forecast the plans on ~/plan; 0 = no forecasts.
        every: Time between shapes of a forecast.
        ghosts: Number of future shapes shown by the marker ~/forecast/ghosts.
    """

    processes: int = parameter(0, "", (0, 64), read_only=True)
    every: float = parameter(0.05, "s", (1e-3, 10.0))
    ghosts: int = parameter(5, "", (1, 100))


@dataclass(frozen=True)
class Accuracy:
    """Acceptable position error, and whether the error is estimated.

    Parameters:
        target: Acceptable position error; a larger estimate causes a warning.
        estimate: Estimate the error from two refined simulations run alongside; auto = unless
            measured points correct the prediction, and in the node as long as it keeps up.
    """

    target: float = parameter(0.001, "m", (1e-9, 1e3))
    estimate: str = parameter("auto", choices=SWITCH)


@dataclass(frozen=True)
class State:
    """State that is kept across restarts of the node.

    Parameters:
        save_to: File to which the node writes its state once a second, and from which it resumes
            when restarted with the same scene; empty = none.
    """

    save_to: str = parameter("", read_only=True)
