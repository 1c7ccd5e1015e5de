"""What a scene says of the ends of the cable, of grippers that hold it, and of loads."""

from dataclasses import dataclass
from typing import Any

from dlo_sim.scene.parameter import ORIGIN, Group, Switches, Vector, parameter
from dlo_sim.scene.refusal import Rules, shown

JOINTS = ("rigid", "hinged", "elastic")


@dataclass(frozen=True)
class Load(Group):
    """A force or wrench on the cable, from a topic or from a signal.

    Parameters:
        topic: Topic of the load; empty without a signal = `~/<name>/wrench` or `~/<name>/force`
            (for a load named `force` of type force: `~/force`).
        type: Message type: WrenchStamped, or Vector3Stamped (a force).
        on: The cable that it acts on: cable (the main one), or the name of a branch or further
            cable.
        position: Location on the cable: 0 at start, 1 at end; the default for a load named `start`
            is 0.0.
        timeout: Time without messages after which the load is removed; 0 = never.
        sign: 1: messages give the load exerted on the cable by the end effector; -1: the opposite.
        frame: Frame of messages without a frame_id: the name in `start.frame`, `end.frame` or
            `grasps.<name>.frame` for a sensor that turns with that end effector, or `frame_id`, or,
            with inputs.tf, any frame of tf2; empty = `frame_id`, with a line when it is used.
        signal: Load without a topic: constant, or force and torque times sin(2 pi frequency t).
        force: Force of the signal, world frame.
        torque: Torque of the signal, world frame.
        frequency: Frequency of a sine.
    """

    name: str
    topic: str = parameter("", read_only=True)
    type: str = parameter("wrench", choices=("wrench", "force"), read_only=True)
    on: str = parameter("cable", read_only=True)
    position: float = parameter(1.0, "", (0.0, 1.0))
    timeout: float = parameter(0.5, "s", (0.0, 3600.0))
    sign: float = parameter(1.0, "", (-1.0, 1.0), choices=(1.0, -1.0))
    frame: str = parameter("")
    signal: str = parameter("none", choices=("none", "constant", "sine"), read_only=True)
    force: Vector = parameter(ORIGIN, "N", (-1.0e9, 1.0e9))
    torque: Vector = parameter(ORIGIN, "N m", (-1.0e9, 1.0e9))
    frequency: float = parameter(1.0, "Hz", (1.0e-6, 1.0e4))

    @property
    def input_topic(self) -> str:
        """The topic of this load, the default if none is given; empty for a signal."""
        if self.signal != "none":
            return ""
        if self.topic:
            return self.topic
        if self.type == "force":
            return "~/force" if self.name == "force" else f"~/{self.name}/force"
        return f"~/{self.name}/wrench"

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Values of a load that would be ignored."""
        if self.signal != "none" and self.topic:
            yield "topic", f"cannot be used with {key}.signal {self.signal}; remove one of them"
        for part in ("force", "torque") if self.signal == "none" else ():
            if any(getattr(self, part)):
                cure = f"set {key}.signal to constant or sine, or remove it"
                yield part, f"would be ignored; {cure}"
        if self.type == "force" and any(self.torque):
            yield "torque", f"would be ignored; set {key}.type to wrench"


@dataclass(frozen=True)
class Holder(Group):
    """An end-effector that holds the cable at one place.

    Parameters:
        position: End-effector position until the first pose arrives; for a free end it only sets
            the direction of the initial straight line.
        fixed: Per world axis: held at the position of the end effector.
        spring: Per world axis that is not fixed: stiffness of a spring to the end effector.
        clamped: The end effector holds tangent and roll; needs all three axes fixed.
        tangent_spring: If not clamped: stiffness k of a spring that aligns the cable with
            `tangent`; its moment is k times the sine of the angle between them.
        roll_spring: If the roll is not held: stiffness of a torsion spring to the roll of the end
            effector; needs the direction held by `clamped` or `tangent_spring`.
        tangent: Direction of the cable here, from start towards end, in the end-effector frame;
            zeros = from start.position to end.position, or with two_points the x axis.
        offset: Point where the cable is attached, in the end-effector frame.
        jaw: Length of cable that a clamp holds straight: from an end inwards, or centred on a
            grasp.
        frame: Name of the end-effector frame; wrenches stamped with it are rotated to the world
            frame.
        pose_topic: Topic of the end-effector pose; empty = it does not move.
        tf_frame: tf2 frame of the end effector; the node reads the pose from tf2 instead of a
            topic.
        pose_type: Message type: PoseStamped, or PoseArray with two points on the line of the cable,
            the first nearer to the start. The end effector is midway between them; its x axis
            points from the first to the second and is the tangent.
        pose_spacing: Distance between two_points; a message that is off by more than 10 % is
            refused; 0 = any.
        pose_timeout: Time without poses after which the last pose is held, with a warning.
        pose_smoothing: Half the window of a local quadratic fit that smooths noisy poses. It delays
            the poses: a given inputs.latency must be longer by as much; 0 = off.
    """

    position: Vector = parameter(ORIGIN, "m", (-1.0e8, 1.0e8))
    fixed: Switches = parameter((True, True, True))
    spring: Vector = parameter(ORIGIN, "N/m", (0.0, 1.0e12))
    clamped: bool = parameter(False)
    tangent_spring: float = parameter(0.0, "N m/rad", (0.0, 1.0e9))
    roll_spring: float = parameter(0.0, "N m/rad", (0.0, 1.0e9))
    tangent: Vector = parameter(ORIGIN, "", (-1.0e6, 1.0e6))
    offset: Vector = parameter(ORIGIN, "m", (-1.0e3, 1.0e3))
    jaw: float = parameter(0.0, "m", (0.0, 1.0e3))
    frame: str = parameter("")
    pose_topic: str = parameter("", read_only=True)
    tf_frame: str = parameter("", read_only=True)
    pose_type: str = parameter("pose", choices=("pose", "two_points"), read_only=True)
    pose_spacing: float = parameter(0.0, "m", (0.0, 1.0e3))
    pose_timeout: float = parameter(1.0, "s", (0.01, 3600.0))
    pose_smoothing: float = parameter(0.0, "s", (0.0, 1.0))

    @property
    def held(self) -> bool:
        """Whether a fixed axis or a spring connects the cable to the end-effector."""
        return any(self.fixed) or any(self.spring) or self.tangent_spring > 0.0

    @property
    def holds_direction(self) -> bool:
        """Whether it holds the direction of the cable, rigidly or by a spring."""
        return self.clamped or self.tangent_spring > 0.0

    @property
    def holds_roll(self) -> bool:
        """Whether it holds the roll of the cable, rigidly or by a spring."""
        return self.roll_spring > 0.0

    @property
    def driven(self) -> bool:
        """Whether poses from a topic or tf2 move the end-effector."""
        return bool(self.pose_topic or self.tf_frame)

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Springs, clamps, roll, jaws, topics and frames that would have no effect."""
        none, all_fixed = "would do nothing", f"{key}.fixed: [true, true, true]"
        for axis, stiffness in enumerate(self.spring):
            if self.fixed[axis] and stiffness > 0.0:
                why = f"since {key}.fixed[{axis}] is true; set one of them to zero or false"
                yield f"spring[{axis}]", f"N/m {none}, {why}"
        if self.clamped and not all(self.fixed):
            yield "clamped", f"needs {all_fixed} (it is {shown(self.fixed)})"
        if self.clamped and self.tangent_spring:
            cure = f"remove it, or set {key}.clamped: false"
            yield "tangent_spring", f"N m/rad {none} beside a clamp; {cure}"
        if self.holds_roll and not self.holds_direction:
            what = "roll_spring" if self.roll_spring else "roll"
            yield what, f"needs the direction held; set {key}.clamped or {key}.tangent_spring"
        if self.jaw > scene.cable.length:
            yield "jaw", f"m is longer than the cable, {scene.cable.length:g} m; shorten the jaw"
        if self.jaw and not self.clamped:
            cure = f"set {key}.clamped: true, or remove it"
            yield "jaw", f"m of cable is held straight by a clamp alone; {cure}"
        if self.pose_type == "two_points" and any(self.tangent):
            why = f"since {key}.pose_type two_points makes it the x axis"
            yield "tangent", f"would be ignored, {why}; remove it"
        if self.pose_type == "pose" and self.pose_spacing:
            cure = f"set {key}.pose_type to two_points, or remove it"
            yield "pose_spacing", f"m would be ignored; {cure}"
        if self.driven and not self.held:
            what = "pose_topic" if self.pose_topic else "tf_frame"
            cure = f"set {all_fixed} or remove {key}.{what}"
            yield what, f"would move nothing, since it holds nothing; {cure}"
        if self.tf_frame and (self.pose_topic or self.pose_type != "pose"):
            cure = f"remove {key}.pose_topic and {key}.pose_type, or tf_frame"
            yield "tf_frame", f"gives the pose; {cure}"
        if self.tf_frame.startswith("/"):
            yield "tf_frame", f"is no frame of tf2; give {self.tf_frame.lstrip('/') or 'tool0'}"
        if self.tf_frame and self.tf_frame == scene.frame_id:
            yield "tf_frame", "is the world frame, frame_id; give the frame of the end-effector"


def joint_conflicts(joint: Any, key: str) -> Rules:
    """A stiffness of a joint that is missing or does nothing; of a branch or a joined end."""
    if joint.joint == "elastic" and not joint.joint_stiffness:
        cure = f"give one above 0, or set {key}.joint to hinged"
        yield "joint_stiffness", f"N m/rad is none for an elastic joint; {cure}"
    if joint.joint != "elastic" and joint.joint_stiffness:
        cure = f"set {key}.joint to elastic, or remove it"
        yield "joint_stiffness", f"N m/rad does nothing in a joint that is {joint.joint}; {cure}"


@dataclass(frozen=True)
class End(Holder):
    """One end of the cable, `start` (u = 0) or `end` (u = L), and its end-effector.

    Parameters:
        mass: Point mass at this end.
        joined: What this end is joined to, instead of being held: cable (the main one), or the name
            of a branch or further cable; its own cable makes a ring. Empty = it is not joined.
        joined_at: Where on that: 0 at start, 1 at end.
        joint: Joint of a joined end, as `branches.<name>.joint`.
        joint_stiffness: Stiffness of an elastic joint.
    """

    mass: float = parameter(0.0, "kg", (0.0, 1.0e4))
    joined: str = parameter("", read_only=True)
    joined_at: float = parameter(0.0, "", (0.0, 1.0), read_only=True)
    joint: str = parameter("rigid", choices=JOINTS, read_only=True)
    joint_stiffness: float = parameter(0.0, "N m/rad", (0.0, 1.0e9))

    @property
    def holds_roll(self) -> bool:
        """Whether it holds the roll of the cable, rigidly or by a spring."""
        return self.clamped or super().holds_roll

    def conflicts(self, key: str, scene: Any) -> Rules:
        """The same, a spring beside a clamp that holds the roll, and joints of what is held."""
        yield from super().conflicts(key, scene)
        for what in ("fixed", "spring", "tangent_spring", "pose_topic", "tf_frame"):
            value = getattr(self, what)
            if self.joined and (any(value) if isinstance(value, tuple) else value):
                none = {"fixed": "set it to [false, false, false]"}.get(what, "remove it")
                why = f"is not possible, since {key}.joined is {self.joined}"
                yield what, f"{why}; {none}, or hold the cable by a grasp"
        for what in () if self.joined else ("joined_at", "joint_stiffness", "joint"):
            if getattr(self, what) not in (0.0, "rigid"):
                yield what, f"does nothing; name a cable in {key}.joined, or remove it"
        yield from joint_conflicts(self, key)
        if self.roll_spring and self.clamped:
            cure = f"remove it, or take {key}.tangent_spring instead of the clamp"
            yield "roll_spring", f"N m/rad would do nothing beside a clamp; {cure}"


@dataclass(frozen=True)
class Grasp(Holder):
    """A gripper that can hold the cable between its ends, and take and release it.

    Parameters:
        on: The cable that it holds: cable (the main one), or the name of a branch or further cable.
        at: Location on the cable: 0 at start, 1 at end; negative = the point nearest to the gripper
            when it takes the cable.
        taken: Whether it holds the cable; a point taken during the simulation is held where it is.
        taken_topic: Topic (Bool): on arrival, true takes the cable and false releases it; `taken`
            is updated. Empty = only the parameter and the services do this.
        clamped: The gripper also holds the direction of the cable (not its roll, see `roll`); needs
            all three axes fixed.
        slides: The cable can slide through the gripper, which holds it across, and its direction by
            `tangent_spring`; what resists is friction. It then moves along the cable, and loses it
            at an end.
        friction: Coefficient of friction of a gripper that slides; auto (-1) = contact.friction.
        grip: Force with which the jaws of a gripper that slides press on the cable, all together:
            it slides where a force along it exceeds friction (grip + force across).
        roll: The gripper also holds the roll, by a stiff spring: one revolution of twist over the
            length of the cable turns it by less than 0.001 rad; needs the direction held.
    """

    name: str = ""
    on: str = parameter("cable", read_only=True)
    at: float = parameter(0.5, "", (-1.0, 1.0))
    taken: bool = parameter(True)
    taken_topic: str = parameter("", read_only=True)
    clamped: bool = parameter(False)
    roll: bool = parameter(False)
    slides: bool = parameter(False)
    friction: float = parameter(-1.0, "", (0.0, 100.0), auto=-1.0)
    grip: float = parameter(0.0, "N", (0.0, 1.0e6))

    @property
    def holds_roll(self) -> bool:
        """Whether it holds the roll of the cable, rigidly or by a spring."""
        return self.roll or super().holds_roll

    def conflicts(self, key: str, scene: Any) -> Rules:
        """The same, and what a grasp alone can have."""
        yield from super().conflicts(key, scene)
        if self.roll and self.roll_spring:
            cure = f"remove it, or set {key}.roll: false"
            yield "roll_spring", f"N m/rad would do nothing beside {key}.roll: true; {cure}"
        if not self.slides and (self.grip or self.friction >= 0.0):
            cure = f"set {key}.slides: true, or remove it"
            yield "grip" if self.grip else "friction", f"does nothing for a cable held fast; {cure}"
        if self.slides and self.clamped:
            cure = f"set {key}.clamped: false; tangent_spring holds the direction"
            yield "slides", f"is not possible with a clamp; {cure}"
        if self.slides and self.holds_roll:
            yield "slides", f"is not possible where the roll is held; remove {key}.roll"
        if self.slides and not all(self.fixed):
            yield "slides", f"needs {key}.fixed: [true, true, true] (it is {shown(self.fixed)})"
