"""Terms, mesh, time integration, inputs and outputs: groups of parameters, as in `cable.py`."""

from dataclasses import dataclass

from dlo_sim.scene.parameter import parameter

SWITCH = ("auto", "on", "off")
LEAST_BY_SPAN = 9  # control points from which stretching by span is never less accurate


@dataclass(frozen=True)
class Discretization:
    """Spline, quadrature and mass matrix."""

    control_points: int = parameter(
        13, "Number of control points n_u of the cubic B-spline.", "", (4, 2000)
    )
    quadrature: str = parameter(
        "gauss",
        "Quadrature along the cable: Gauss points in each knot span, or uniformly spaced points.",
        choices=("gauss", "uniform"),
    )
    samples: int = parameter(
        3,
        "Quadrature points: per knot span for gauss (2 to 10), in total for uniform (at least 2 a "
        "span).",
        "",
        (1, 100_000),
    )
    stretch: str = parameter(
        "auto",
        "Where the stretching energy is evaluated: at every quadrature point, or from the mean "
        "stretch of each knot span, which avoids membrane locking of thin cables with few control "
        "points (needs gauss and 5 control points). Auto: span with gauss and 9 or more.",
        choices=("auto", "sample", "span"),
    )
    mass: str = parameter(
        "consistent",
        "Mass matrix: consistent (banded), lumped (diagonal, less accurate), or selective: "
        "consistent with more mass for motion that the spline does not resolve, which lets "
        "explicit steps be about twice as long.",
        choices=("consistent", "lumped", "selective"),
    )
    knots: str = parameter(
        "uniform",
        "Knot spans of equal length, or (auto) shorter ones at clamped ends of a soft cable, which "
        "bends most there (needs gauss).",
        choices=("uniform", "auto"),
    )

    @property
    def stretch_by_span(self) -> bool:
        """Whether the stretching energy uses the strain projected on each span."""
        enough = self.quadrature == "gauss" and self.control_points >= LEAST_BY_SPAN
        return self.stretch == "span" or (self.stretch == "auto" and enough)


@dataclass(frozen=True)
class Terms:
    """Terms of the model: `auto`, `on`, `off`, or a variant of the term."""

    stretch: str = parameter(
        "auto",
        "Axial stretching energy. Off with integrator.method auto: the cable is inextensible "
        "(rattle) where that is possible.",
        choices=SWITCH,
    )
    bend: str = parameter("auto", "Bending energy.", choices=SWITCH)
    twist: str = parameter(
        "auto",
        "Torsion energy and the twist angle: on = theta' alone; bishop = in a rotation-minimising "
        "frame, which bends the cable too; quasistatic = as bishop, without inertia about the "
        "axis; frenet = against the torsion of the centerline.",
        choices=("auto", "on", "off", "bishop", "frenet", "quasistatic"),
    )
    gravity: str = parameter("auto", "Weight.", choices=SWITCH)
    damping: str = parameter("auto", "All damping.", choices=SWITCH)
    plasticity: str = parameter("auto", "Plastic bending.", choices=SWITCH)
    contact: str = parameter("auto", "Contact.", choices=SWITCH)
    out_of_plane: str = parameter(
        "auto",
        "The third coordinate. Auto leaves it out where everything stays in a coordinate plane; "
        "off drops forces and moments out of the plane and projects the ends' motion onto it.",
        choices=SWITCH,
    )


@dataclass(frozen=True)
class Initial:
    """Shape at the start."""

    shape: str = parameter(
        "auto",
        "Shape at the start and after a reset; auto = straight when an end is free or the held "
        "ends are one length apart, else equilibrium.",
        choices=("auto", "straight", "equilibrium"),
    )


@dataclass(frozen=True)
class Integrator:
    """Time integration: method, step, and the reaction to a failure."""

    method: str = parameter("auto", "Time integration method; see `dlo_sim methods`.")
    step: float = parameter(
        0.0,
        "Time step tau, at least 1e-9; 0 = chosen from the scene and the accuracy asked for.",
        "s",
        (0.0, 1.0),
    )
    spectral_radius: float = parameter(
        0.8,
        "Spectral radius of generalized_alpha at infinite frequency: 1 = no numerical damping, 0 = "
        "the highest frequencies vanish within a step.",
        "",
        (0.0, 1.0),
    )
    zhai_psi: float = parameter(
        0.5,
        "Parameter psi of Zhai's method; the pair 0.5, 0.5 has the largest stable step.",
        "",
        (0.0, 1.0),
    )
    zhai_phi: float = parameter(
        0.5, "Parameter phi of Zhai's method; second order only with 0.5.", "", (0.0, 1.0)
    )
    tolerance: float = parameter(
        1.0e-6,
        "Energy that a step of an implicit method may leave unaccounted for, as a share of the "
        "energy exchanged; all steps together leave ten times as much.",
        "",
        (1.0e-15, 1.0e-2),
    )
    on_failure: str = parameter(
        "hold",
        "When a step fails: hold the last good state until ~/reset, or stop the node.",
        choices=("hold", "stop"),
    )


@dataclass(frozen=True)
class Inputs:
    """Processing of input messages: time base, latency, limits, catching up."""

    latency: float = parameter(
        0.06,
        "The prediction lags by this much, so that poses are interpolated, never extrapolated.",
        "s",
        (0.0, 10.0),
    )
    time: str = parameter(
        "auto",
        "Time of an input: its header stamp, its arrival, or (auto) the stamp, shifted if it is "
        "from another epoch than the clock.",
        choices=("auto", "stamp", "arrival"),
    )
    tf: bool = parameter(
        False,
        "Look up frames that the scene does not name in tf2, at the stamp of the message, which "
        "waits for that no longer than inputs.latency.",
        read_only=True,
    )
    max_speed: float = parameter(
        20.0, "Poses that move faster are refused.", "m/s", (1.0e-3, 1.0e6)
    )
    max_force: float = parameter(1.0e4, "Larger forces are refused.", "N", (1.0e-6, 1.0e9))
    max_torque: float = parameter(1.0e3, "Larger torques are refused.", "N m", (1.0e-6, 1.0e9))
    catch_up: float = parameter(
        0.1, "Most simulated time per timer tick; at least one timer period.", "s", (1.0e-3, 10.0)
    )


@dataclass(frozen=True)
class Measured:
    """Measured points on the cable that correct the prediction."""

    type: str = parameter(
        "none",
        "Message type of ~/measured, points on the cable in any order, some hidden; none = the "
        "prediction is not corrected.",
        choices=("none", "point_cloud", "pose_array"),
        read_only=True,
    )
    noise: float = parameter(
        0.005, "Standard deviation of a coordinate of a measured point.", "m", (1e-6, 1.0)
    )
    error: float = parameter(
        0.02,
        "Standard deviation of the error of the uncorrected prediction: the larger beside the "
        "noise, the more a point moves the cable.",
        "m",
        (1e-6, 10.0),
    )
    alike_along: float = parameter(
        0.1, "Share of the length over which that error is alike.", "", (0.01, 1.0)
    )
    alike_for: float = parameter(
        0.25, "Time for which that error is alike: the lag of the correction.", "s", (1e-3, 100.0)
    )
    gate: float = parameter(
        0.1, "Points further than this from the prediction are rejected.", "m", (1e-6, 100.0)
    )


@dataclass(frozen=True)
class Outputs:
    """Outputs other than the control points."""

    centerline_samples: int = parameter(
        50, "Points of the centerline in markers and recordings.", "", (2, 10_000)
    )
    marker_rate: float = parameter(30.0, "Rate of the markers.", "Hz", (0.1, 1000.0))
    color_by: str = parameter(
        "none",
        "What the colours of the marker of the centerline show, dark for low, bright for high: "
        "tension [N] or curvature [1/m].",
        choices=("none", "tension", "curvature"),
    )
    points: bool = parameter(
        False,
        "Publish the centerline as PointCloud2 on ~/points, with x, y, z, u [m] and, where it is "
        "known, tension [N].",
    )
    capsules: int = parameter(
        0,
        "Capsules that together hold the cable, published on ~/capsules for planning scenes; 0 = "
        "none. Their radii grow where the cable bends within one.",
        "",
        (0, 1000),
    )
    tf: bool = parameter(
        False,
        "Publish on /tf where the ends of the cable and the grippers of its grasps are, as frames "
        "`<node>/start`, `<node>/end`, `<node>/<grasp>`.",
        read_only=True,
    )
    color_range: tuple[float, float] = parameter(
        (0.0, 0.0),
        "Values of the darkest and of the brightest colour, in the unit of what they show; the "
        "same twice = those of the present shape.",
        "",
        (-1.0e9, 1.0e9),
    )


@dataclass(frozen=True)
class Forecasts:
    """Forecasts of the cable along received plans."""

    processes: int = parameter(
        0,
        "Processes that forecast the plans on ~/plan, beside the ticks; 0 = no forecasts.",
        "",
        (0, 64),
        read_only=True,
    )
    every: float = parameter(0.05, "Time between two shapes of a forecast.", "s", (1e-3, 10.0))
    ghosts: int = parameter(
        5, "Shapes to come that the marker ~/forecast/ghosts shows.", "", (1, 100)
    )


@dataclass(frozen=True)
class Accuracy:
    """Acceptable position error, and whether the error is estimated."""

    target: float = parameter(
        0.001, "Acceptable position error; a larger estimate causes a warning.", "m", (1e-9, 1e3)
    )
    estimate: str = parameter(
        "auto",
        "Estimate the error by two finer simulations that run beside; auto = in the node, as "
        "long as it keeps up.",
        choices=SWITCH,
    )


@dataclass(frozen=True)
class State:
    """State that is kept across restarts of the node."""

    save_to: str = parameter(
        "",
        "File to which the node writes its state once a second, and from which it goes on when it "
        "is started again with the same scene; empty = none.",
        read_only=True,
    )
