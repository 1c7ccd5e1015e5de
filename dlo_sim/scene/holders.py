"""Ends and grasps, which hold the cable. Groups of parameters in SI units."""

from dataclasses import dataclass

from dlo_sim.scene.cable import ORIGIN, Vector
from dlo_sim.scene.parameter import parameter

Switches = tuple[bool, bool, bool]


@dataclass(frozen=True)
class Holder:
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


@dataclass(frozen=True)
class End(Holder):
    """One end of the cable, `start` (u = 0) or `end` (u = L), and its end-effector.

    Parameters:
        mass: Point mass at this end.
    """

    mass: float = parameter(0.0, "kg", (0.0, 1.0e4))

    @property
    def holds_roll(self) -> bool:
        """Whether it holds the roll of the cable, rigidly or by a spring."""
        return self.clamped or super().holds_roll


@dataclass(frozen=True)
class Grasp(Holder):
    """A gripper that can hold the cable between its ends, and take and release it.

    Parameters:
        at: Location on the cable: 0 at start, 1 at end; negative = the point nearest to the gripper
            when it takes the cable.
        taken: Whether it holds the cable; a point taken during the simulation is held where it is.
        taken_topic: Topic (Bool): on arrival, true takes the cable and false releases it; `taken`
            is updated. Empty = only the parameter and the services do this.
        clamped: The gripper also holds the direction of the cable (not its roll, see `roll`); needs
            all three axes fixed.
        roll: The gripper also holds the roll, by a stiff spring: one revolution of twist over the
            length of the cable turns it by less than 0.001 rad; needs the direction held.
    """

    name: str = ""
    at: float = parameter(0.5, "", (-1.0, 1.0))
    taken: bool = parameter(True)
    taken_topic: str = parameter("", read_only=True)
    clamped: bool = parameter(False)
    roll: bool = parameter(False)

    @property
    def holds_roll(self) -> bool:
        """Whether it holds the roll of the cable, rigidly or by a spring."""
        return self.roll or super().holds_roll
