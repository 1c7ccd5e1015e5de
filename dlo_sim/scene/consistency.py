"""Consistency checks across parameters whose values are valid one by one.

Every refusal is one line that names the key, the value and the cure.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence

from dlo_sim.scene.cable import Cable, Load, Obstacle, Vector
from dlo_sim.scene.computation import Discretization, Outputs
from dlo_sim.scene.holders import End, Grasp, Holder
from dlo_sim.scene.refusal import SceneError, refusal, shown

_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
LEAST_STEP = 1e-9  # [s]; 0 = chosen automatically
LEAST_DENSITY = 1e-15  # [kg/m], of the least diameter and density allowed
LEAST_QUATERNION = 1e-3  # norm below which an orientation is refused
_LARGEST_STRETCH = 2.0  # distance of held ends, in lengths, above which it is surely a mistake

Holders = Mapping[str, Holder]


def _refusals(prefix: str, group: object) -> Callable[[str, str], SceneError]:
    """A function that makes the refusal of a group's parameter from its name and problem."""
    return lambda name, problem: refusal(f"{prefix}.{name}", getattr(group, name), problem)


def _norm(vector: Vector) -> float:
    return math.hypot(*vector)


def check_cable(cable: Cable) -> None:
    """Refuse an empty natural shape, an axis that is not a unit vector, and a negligible mass."""
    axis = cable.rest_curvature_axis
    if 0.0 < cable.linear_density < LEAST_DENSITY:
        cure = f"give {LEAST_DENSITY:g} kg/m or more, or 0 for rho pi D^2 / 4"
        raise refusal("cable.linear_density", cable.linear_density, f"is next to no mass; {cure}")
    for name in ("rest_curvature", "rest_curvature_2", "rest_twist"):
        if not getattr(cable, name):
            raise refusal(f"cable.{name}", (), "is empty; give [0.0] for a straight cable")
    if abs(_norm(axis) - 1.0) > 1e-6:
        size = _norm(axis)
        unit = shown(tuple(round(a / size, 9) for a in axis)) if size > 0.0 else "[0.0, 1.0, 0.0]"
        raise refusal("cable.rest_curvature_axis", axis, f"is not a unit vector; give {unit}")


def check_discretization(discretization: Discretization) -> None:
    """Refuse quadratures that do not fit the knots or admit zero-energy modes."""
    refused = _refusals("discretization", discretization)
    samples, gauss = discretization.samples, discretization.quadrature == "gauss"
    by_span = discretization.stretch == "span"
    least = max(2 * (discretization.control_points - 3), 4)
    if 0 < discretization.control_points < 4:
        raise refused("control_points", "are too few for a cubic; give 4 or more, or 0")
    if discretization.knots == "graded":
        if not gauss:
            raise refused("knots", "need Gauss points; set discretization.quadrature to gauss")
        if discretization.grading[2] == 0.0:
            raise refused(
                "grading", "decays over no length; give one above 0 m as the third number"
            )
    if gauss and not 2 <= samples <= 10:
        raise refused(
            "samples",
            "points per knot span will not do for gauss; give 2 to 10 (a single one leaves ways to "
            "bend that cost no energy), or set discretization.quadrature to uniform",
        )
    if by_span and not gauss:
        cure = "set discretization.quadrature to gauss, or stretch to sample"
        raise refused("stretch", f"needs Gauss points; {cure}")
    if by_span and 0 < discretization.control_points < 5:
        cure = "give 5 control points or more, or set it to sample"
        raise refused(
            "stretch", f"leaves a single span ways to stretch that cost no energy; {cure}"
        )
    if not gauss and samples < least:
        cure = f"give {least} or more in all, two a knot span"
        raise refused("samples", f"samples are too few for uniform quadrature; {cure}")


def check_holder(name: str, end: Holder, length: float) -> None:
    """Refuse springs, clamps and topics that would have no effect."""
    for axis in range(3):
        if end.fixed[axis] and end.spring[axis] > 0.0:
            raise refusal(
                f"{name}.spring[{axis}]",
                end.spring[axis],
                f"N/m would do nothing, since {name}.fixed[{axis}] is true; set one of them to "
                "zero or false",
            )
    refused = _refusals(name, end)
    if end.clamped and not all(end.fixed):
        it_is = f"(it is {shown(end.fixed)})"
        raise refused("clamped", f"needs {name}.fixed: [true, true, true] {it_is}")
    if end.clamped and end.tangent_spring:
        cure = f"remove it, or set {name}.clamped: false"
        raise refused("tangent_spring", f"N m/rad would do nothing beside a clamp; {cure}")
    if end.holds_roll and not end.holds_direction:
        key = "roll_spring" if end.roll_spring else "roll"
        raise refused(key, f"needs the direction held; set {name}.clamped or {name}.tangent_spring")
    if end.roll_spring and isinstance(end, End) and end.clamped:
        cure = f"remove it, or take {name}.tangent_spring instead of the clamp"
        raise refused("roll_spring", f"N m/rad would do nothing beside a clamp; {cure}")
    if isinstance(end, Grasp) and end.roll and end.roll_spring:
        cure = f"remove it, or set {name}.roll: false"
        raise refused("roll_spring", f"N m/rad would do nothing beside {name}.roll: true; {cure}")
    if end.jaw > length:
        raise refused("jaw", f"m is longer than the cable, {length:g} m; shorten the jaw")
    if end.jaw and not end.clamped:
        cure = f"set {name}.clamped: true, or remove it"
        raise refused("jaw", f"m of cable is held straight by a clamp alone; {cure}")
    if end.pose_type == "two_points" and any(end.tangent):
        why = f"since {name}.pose_type two_points makes it the x axis"
        raise refused("tangent", f"would be ignored, {why}; remove it")
    if end.pose_type == "pose" and end.pose_spacing:
        cure = f"set {name}.pose_type to two_points, or remove it"
        raise refused("pose_spacing", f"m would be ignored; {cure}")
    if end.driven and not end.held:
        key = "pose_topic" if end.pose_topic else "tf_frame"
        cure = f"set {name}.fixed: [true, true, true] or remove {name}.{key}"
        raise refused(key, f"would move nothing, since it holds nothing; {cure}")


def check_tf_frame(name: str, end: Holder, world: str) -> None:
    """Refuse a frame in addition to a topic, and a frame that tf2 cannot have or never moves."""
    if not end.tf_frame:
        return
    reason = ""
    if end.pose_topic or end.pose_type != "pose":
        reason = f"gives the pose; remove {name}.pose_topic and {name}.pose_type, or tf_frame"
    elif end.tf_frame.startswith("/"):
        reason = f"is no frame of tf2; give {end.tf_frame.lstrip('/') or 'tool0'}"
    elif end.tf_frame == world:
        reason = "is the world frame, frame_id; give the frame of the end-effector"
    if reason:
        raise refusal(f"{name}.tf_frame", end.tf_frame, reason)


def check_obstacles(obstacles: Sequence[Obstacle]) -> None:
    """Refuse an orientation that is not a rotation."""
    for obstacle in obstacles:
        if math.hypot(*obstacle.orientation) < LEAST_QUATERNION:
            raise refusal(
                f"obstacles.{obstacle.name}.orientation",
                obstacle.orientation,
                "is no rotation; give x, y, z, w, [0.0, 0.0, 0.0, 1.0] for none",
            )


def check_placement(ends: Mapping[str, End], length: float, shape: str) -> None:
    """Refuse ends that leave the direction of the initial shape or a clamp undefined, or that are
    too far apart.
    """
    start, end = ends["start"], ends["end"]
    refused = _refusals("end", end)
    gap = math.dist(start.position, end.position)
    rigid = all(start.fixed) and all(end.fixed)
    if gap == 0.0:
        for name, held in ends.items():
            if held.clamped and _norm(held.tangent) == 0.0:
                why = "since both ends are at the same place"
                raise _refusals(name, held)(
                    "tangent", f"gives no direction, {why}; give a direction"
                )
        if shape == "straight" or not rigid:
            why = "so a straight cable has no direction"
            raise refused(
                "position", f"equals start.position, {why}; move it or start.position apart"
            )
    resting = not (start.driven or end.driven)
    if resting and rigid and gap > _LARGEST_STRETCH * length:
        raise refused(
            "position",
            f"is {gap:g} m from start.position, but the cable is only {length:g} m long; move the "
            "ends together or lengthen cable.length",
        )


def check_frames(world: str, holders: Holders) -> None:
    """Refuse a frame name shared by two end-effectors, or by one and the world."""
    seen = {world: "frame_id"}
    for name, holder in holders.items():
        frame = holder.frame
        if frame and seen.setdefault(frame, f"{name}.frame") != f"{name}.frame":
            cure = "give the end-effector's own frame"
            raise refusal(f"{name}.frame", frame, f"is also {seen[frame]}; {cure}")


def check_load_frames(world: str, holders: Holders, loads: Sequence[Load], any_frame: bool) -> None:
    """Refuse a frame of a load that nothing has, and two frames of one topic.

    Args:
        any_frame: whether other frames are looked up in tf2.
    """
    known = [world, *(holder.frame for holder in holders.values() if holder.frame)]
    first: dict[str, Load] = {}
    for load in loads:
        if not load.input_topic:
            continue
        key = f"loads.{load.name}.frame"
        if load.frame and load.frame not in known and not any_frame:
            cure = "give one of them, or name that of the end effector in start.frame or end.frame"
            raise refusal(key, load.frame, f"is no frame here ({', '.join(known)}); {cure}")
        other = first.setdefault(load.input_topic, load)
        if load.frame != other.frame:
            raise refusal(
                key,
                load.frame,
                f"differs from loads.{other.name}.frame {shown(other.frame)} of the same topic; "
                "give both the same",
            )


def check_load(load: Load) -> None:
    """Refuse values of a load that would be ignored."""
    key = f"loads.{load.name}"
    refused = _refusals(key, load)
    if load.signal != "none" and load.topic:
        raise refused(
            "topic", f"cannot be used with {key}.signal {load.signal}; remove one of them"
        )
    for part in ("force", "torque") if load.signal == "none" else ():
        if any(getattr(load, part)):
            cure = f"set {key}.signal to constant or sine, or remove it"
            raise refused(part, f"would be ignored; {cure}")
    if load.type == "force" and any(load.torque):
        raise refused("torque", f"would be ignored; set {key}.type to wrench")


def check_topics(holders: Holders, loads: Sequence[Load]) -> None:
    """Refuse malformed topic names, and topics read as two types."""
    inputs = [(f"{n}.pose_topic", e.pose_topic, e.pose_type) for n, e in holders.items()]
    inputs += [
        (f"{n}.taken_topic", e.taken_topic, "taken")
        for n, e in holders.items()
        if isinstance(e, Grasp)
    ]
    inputs += [(f"loads.{load.name}.topic", load.input_topic, load.type) for load in loads]
    seen: dict[str, tuple[str, str]] = {}
    for key, topic, kind in inputs:
        if not topic:
            continue
        if not _TOPIC.fullmatch(topic):
            raise refusal(key, topic, "is not a topic name; give one like ~/wrench or /robot/pose")
        other, other_kind = seen.setdefault(topic, (key, kind))
        if other_kind != kind:
            raise refusal(
                key, topic, f"is read as {kind} here and as {other_kind} by {other}; use two topics"
            )


def check_times(rate: float, step: float, catch_up: float) -> None:
    """Refuse a step below the resolution of stamps, and a catch-up below the timer period."""
    if 0.0 < step < LEAST_STEP:
        raise refusal(
            "integrator.step",
            step,
            f"s is below {LEAST_STEP:g} s, the resolution of stamps; give 0 to have it chosen",
        )
    if catch_up < 1.0 / rate:
        raise refusal(
            "inputs.catch_up",
            catch_up,
            f"s is shorter than one timer period ({1.0 / rate:g} s at rate {rate:g} "
            f"Hz); give at least {1.0 / rate:g}",
        )


def check_colors(outputs: Outputs, without_tension: str) -> None:
    """Refuse a decreasing colour range, and colours by a tension that is not known."""
    low, high = outputs.color_range
    if low > high:
        raise refusal(
            "outputs.color_range", outputs.color_range, f"falls; give {shown((high, low))}"
        )
    if outputs.color_by == "tension" and without_tension:
        raise refusal("outputs.color_by", "tension", f"{without_tension}; give curvature")
