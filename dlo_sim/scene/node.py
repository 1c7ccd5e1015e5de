"""What a scene says of the node: its inputs and outputs, measured points, forecasts, its state."""

from dataclasses import dataclass
from typing import Any

from dlo_sim.scene.parameter import Group, parameter
from dlo_sim.scene.refusal import Rules, shown

LEAST_LATENCY, MOST_LATENCY = 0.06, 10.0  # s, of inputs.latency auto


@dataclass(frozen=True)
class Inputs(Group):
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

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Less time to catch up than passes between two ticks."""
        if self.catch_up < 1.0 / scene.rate:
            what = f"one timer period ({1.0 / scene.rate:g} s at rate {scene.rate:g} Hz)"
            yield "catch_up", f"s is shorter than {what}; give at least {1.0 / scene.rate:g}"


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
class Outputs(Group):
    """Outputs other than the control points.

    Parameters:
        centerline_samples: Number of centerline points in markers and recordings.
        marker_rate: Rate of the markers.
        color_by: Quantity shown by the colours of the centerline marker, from dark (low) to bright
            (high): tension [N] or curvature [1/m].
        points: Publish the centerline as PointCloud2 on ~/points, with x, y, z, u [m] and, if
            known, tension [N].
        capsules: Number of capsules that together enclose each cable, published on ~/capsules for
            planning scenes; 0 = none. A capsule is thicker where the cable bends inside it.
        tf: Publish the ends of the cable and the grippers of its grasps on /tf, as frames
            `<node>/start`, `<node>/end`, `<node>/<grasp>`; of a net also
            `<node>/branches/<name>/end` and so on.
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

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A falling colour range, and colours by a tension that is not known."""
        low, high = self.color_range
        if low > high:
            yield "color_range", f"falls; give {shown((high, low))}"
        if self.color_by == "tension" and scene.without_tension:
            yield "color_by", f"{scene.without_tension}; give curvature"


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
class State:
    """State that is kept across restarts of the node.

    Parameters:
        save_to: File to which the node writes its state once a second, and from which it resumes
            when restarted with the same scene; empty = none.
    """

    save_to: str = parameter("", read_only=True)
