"""A scene: the complete definition of a simulation, as frozen dataclasses in SI units.

The path of an attribute is the key of its parameter (`scene.cable.length` is `cable.length`), and
its description is in the docstring of its class: ROS declarations, checks and the tables of
config/README.md are generated from them. What a scene derives from its parameters is a property.

Scenes are built by `scene_from_values`, so that every scene has passed the checks: of single values
(`parameter.check_value`), then of values that are valid one by one but not together. Each rule of
the latter yields the key, its value and the problem with the cure; the first one refuses the scene.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from dlo_sim.scene.parameter import (
    Parameter,
    check_names,
    check_value,
    markdown_row,
    parameter,
    parameters_of,
    unknown_key,
    with_parameters,
)
from dlo_sim.scene.refusal import SceneError, brief, refusal, shown
from dlo_sim.scene.retired import without_retired

EARTH = 9.81  # [m/s^2]
ORIGIN = (0.0, 0.0, 0.0)
NO_SURFACE = 1e9  # [m], water.level of water that is everywhere
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Switches = tuple[bool, bool, bool]
Names = tuple[str, ...]
# Groups with a block for each name, and their reserved names.
_NAMED: dict[str, Names] = {
    "loads": (),
    "grasps": ("start", "end"),
    "obstacles": ("start", "end", "itself"),
}
# Parameters of the node, not of the scene, that a scene file may contain.
_NODE_KEYS = re.compile(
    r"(use_sim_time|start_type_description_service|qos_overrides\..*|lifecycle|cables)"
)
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
LEAST_STEP = 1e-9  # [s]; 0 = chosen automatically
LEAST_DENSITY = 1e-15  # [kg/m], of the least diameter and density allowed
LEAST_CELLS = 8  # of a mesh's field
LEAST_QUATERNION = 1e-3  # norm below which an orientation is refused
LEAST_SIZE = 1e-9  # [m], of an obstacle
LEAST_STIFFNESS = 1e-6  # [N/m^2], of contact
_LARGEST_STRETCH = 2.0  # distance of held ends, in lengths, above which it is surely a mistake

Conflicts = Iterator[tuple[str, object, str]]

# -- the cable, what surrounds it and what acts on it ---------------------------------------------
SWITCH = ("auto", "on", "off")


@dataclass(frozen=True)
class Cable:
    """Material and cross-section. Direct values of 0 are derived from moduli, density, diameter D,
    and of a hose its bore d.

    Parameters:
        length: Rest length L; where it touches, its round tips reach half a diameter beyond both
            ends.
        diameter: Diameter D of the round section.
        density: Density rho.
        youngs_modulus: Young's modulus E.
        shear_modulus: Shear modulus G.
        linear_density: Mass per length mu; 0 = rho pi (D^2 - d^2) / 4. The polar inertia per length
            is mu (D^2 + d^2) / 8.
        axial_stiffness: EA; 0 = E pi (D^2 - d^2) / 4, as of a homogeneous section, also if
            bending_stiffness is given.
        bending_stiffness: EI; 0 = E pi (D^4 - d^4) / 64, as of a homogeneous section, also if
            axial_stiffness is given.
        torsional_stiffness: GJ; 0 = 2 G / E EI, as of an isotropic section (G pi (D^4 - d^4) / 32
            if it is homogeneous).
        rest_curvature: Natural curvature at equally spaced points from start to end, interpolated
            linearly; one value = constant.
        rest_curvature_axis: Axis about which the unloaded cable is bent: a unit vector in the frame
            of the start end effector, normal to the cable where it leaves the start. Where twist
            acts on the shape it follows the material frame along the cable. Positive curvature
            rotates the tangent about it by the right-hand rule.
        rest_curvature_2: Natural curvature in the second plane, in the same format: about the axis
            tangent x rest_curvature_axis, with the tangent where the cable leaves the start.
        rest_twist: Twist rate of the unloaded cable, in the same format; needs terms.twist auto,
            bishop or quasistatic.
    """

    length: float = parameter(1.0, "m", (1.0e-4, 1.0e4))
    diameter: float = parameter(0.005, "m", (1.0e-6, 1.0))
    density: float = parameter(1200.0, "kg/m^3", (1.0e-2, 1.0e5))
    youngs_modulus: float = parameter(1.0e7, "Pa", (1.0, 1.0e13))
    shear_modulus: float = parameter(3.5e6, "Pa", (1.0, 1.0e13))
    linear_density: float = parameter(0.0, "kg/m", (0.0, 1.0e4))
    axial_stiffness: float = parameter(0.0, "N", (0.0, 1.0e14))
    bending_stiffness: float = parameter(0.0, "N m^2", (0.0, 1.0e12))
    torsional_stiffness: float = parameter(0.0, "N m^2", (0.0, 1.0e12))
    rest_curvature: tuple[float, ...] = parameter((0.0,), "1/m", (-1.0e5, 1.0e5))
    rest_curvature_axis: Vector = parameter((0.0, 1.0, 0.0), "", (-1.0, 1.0))

    rest_curvature_2: tuple[float, ...] = parameter((0.0,), "1/m", (-1.0e5, 1.0e5))
    rest_twist: tuple[float, ...] = parameter((0.0,), "rad/m", (-1.0e5, 1.0e5))
    bore: float = 0.0  # hose.bore [m], from `scene_from_values`; no parameter

    @property
    def natural_shape(self) -> tuple[tuple[float, ...], ...]:
        """Two curvatures [1/m] and twist rate [rad/m] along the unloaded cable."""
        return self.rest_curvature, self.rest_curvature_2, self.rest_twist

    @property
    def shaped(self) -> bool:
        """Whether the unloaded cable is bent or twisted."""
        return any(map(any, self.natural_shape))

    @property
    def area(self) -> float:
        """Cross-sectional area A = pi (D^2 - d^2) / 4 [m^2]."""
        return math.pi * (self.diameter**2 - self.bore**2) / 4.0

    @property
    def mu(self) -> float:
        """Linear density mu = rho A [kg/m], or the value given directly."""
        return self.linear_density or self.density * self.area

    @property
    def EA(self) -> float:
        """Axial stiffness EA [N], or the value given directly."""
        return self.axial_stiffness or self.youngs_modulus * self.area

    @property
    def EI(self) -> float:
        """Bending stiffness EI = E pi (D^4 - d^4) / 64 [N m^2], or the value given directly."""
        moment = math.pi * (self.diameter**4 - self.bore**4) / 64.0
        return self.bending_stiffness or self.youngs_modulus * moment

    @property
    def GJ(self) -> float:
        """Torsional stiffness GJ = 2 G / E EI [N m^2], or the value given directly."""
        return self.torsional_stiffness or 2.0 * self.shear_modulus / self.youngs_modulus * self.EI

    @property
    def polar_inertia(self) -> float:
        """Polar inertia per length mu (D^2 + d^2) / 8 [kg m], rho pi (D^4 - d^4) / 32 if mu is
        derived.
        """
        return self.mu * (self.diameter**2 + self.bore**2) / 8.0

    @property
    def assumptions(self) -> tuple[str, ...]:
        """One line for each value that is derived although its partner is given: the assumption."""
        lines = []
        EA, EI, inertia, section = "D^2 / 4", "D^4 / 64", "D^2 / 8", "solid section"
        if self.bore:
            EA, EI, section = "(D^2 - d^2) / 4", "(D^4 - d^4) / 64", "hose's section"
            inertia = "(D^2 + d^2) / 8"
        if self.bending_stiffness and not self.torsional_stiffness:
            lines.append(
                "cable.torsional_stiffness: not given beside bending_stiffness, so GJ = 2 G / E EI "
                f"= {self.GJ:.3g} N m^2, as of an isotropic section"
            )
        if self.bending_stiffness and not self.axial_stiffness:
            lines.append(
                f"cable.axial_stiffness: not given beside bending_stiffness, so EA = E pi {EA} = "
                f"{self.EA:.3g} N, as of a {section}"
            )
        if self.axial_stiffness and not self.bending_stiffness:
            lines.append(
                f"cable.bending_stiffness: not given beside axial_stiffness, so EI = E pi {EI} = "
                f"{self.EI:.3g} N m^2, as of a {section}"
            )
        if self.linear_density:
            lines.append(
                f"cable.linear_density: the polar inertia that belongs to it is mu {inertia} = "
                f"{self.polar_inertia:.3g} kg m, as of a {section}"
            )
        return tuple(lines)


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping and air drag.

    Parameters:
        mass: Rayleigh alpha: force -alpha M v on the cable.
        stiffness: Rayleigh beta: internal damping beta K.
        stretch: Added to damping.stiffness for stretching only.
        bend: Added to damping.stiffness for bending only.
        thinning: Rate thinning of bending damping, as from friction between strands: it is
            multiplied by 1 / sqrt(1 + (thinning w)^2), with the rate of curvature w.
        twist: Added to damping.stiffness for twisting only.
        air_drag: Linear drag: force per unit length and unit speed.
        air_drag_ratio: Ratio of tangential to normal drag: 1 = isotropic, 0.5 = a thin cylinder in
            slow flow.
    """

    mass: float = parameter(0.0, "1/s", (0.0, 1.0e6))
    stiffness: float = parameter(0.0, "s", (0.0, 1.0e3))
    stretch: float = parameter(0.0, "s", (0.0, 1.0e3))
    bend: float = parameter(0.0, "s", (0.0, 1.0e3))
    thinning: float = parameter(0.0, "m s", (0.0, 1.0e6))
    twist: float = parameter(0.0, "s", (0.0, 1.0e3))
    air_drag: float = parameter(0.0, "N s/m^2", (0.0, 1.0e6))
    air_drag_ratio: float = parameter(1.0, "", (0.0, 1.0))

    @property
    def internal(self) -> Vector:
        """Internal damping of stretching, bending and twisting [s]."""
        beta = self.stiffness
        return beta + self.stretch, beta + self.bend, beta + self.twist

    @property
    def drag_across(self) -> float:
        """Normal minus tangential air drag c_n - c_t [N s/m^2]."""
        return self.air_drag * (1.0 - self.air_drag_ratio)


@dataclass(frozen=True)
class Water:
    """Water around the cable: buoyancy, and drag that is quadratic in the velocity relative to it.

    Parameters:
        density: Density of the water; 0 = no water. The cable displaces its section. Air of 1.2
            kg/m^3 with a velocity is wind.
        level: Height of its surface in the world, against gravity (without gravity along z): above
            it there is neither buoyancy nor drag. auto (1e9) = no surface, all of the cable is in
            water.
        velocity: Velocity of its current, world frame. An equilibrium at the start is that in still
            water; from there the cable drifts.
        drag: Drag coefficient across the cable, on its diameter.
        drag_along: Drag coefficient along the cable, on its surface.
    """

    density: float = parameter(0.0, "kg/m^3", (0.0, 1.0e5))
    level: float = parameter(NO_SURFACE, "m", (-1.0e8, NO_SURFACE), auto=NO_SURFACE)
    velocity: Vector = parameter(ORIGIN, "m/s", (-1.0e3, 1.0e3))
    drag: float = parameter(1.2, "", (0.0, 100.0))
    drag_along: float = parameter(0.01, "", (0.0, 100.0))


@dataclass(frozen=True)
class Hose:
    """A hose: its bore, and pressure, which makes it longer, or pushes apart what holds its ends.

    The tension of a hose is that of its wall, which bears the pressure; reactions include what the
    pressure pushes on the ends.

    Parameters:
        pressure: Pressure inside in excess of that outside.
        bore: Inner diameter d, which the pressure does not widen; mass and stiffnesses that are
            derived are those of the wall, and the mass of what is inside belongs to
            cable.linear_density.
    """

    pressure: float = parameter(0.0, "Pa", (0.0, 1.0e9))
    bore: float = parameter(0.0, "m", (0.0, 1.0))

    @property
    def thrust(self) -> float:
        """Force of the pressure on an end [N], p pi d^2 / 4."""
        return self.pressure * math.pi * self.bore**2 / 4.0


@dataclass(frozen=True)
class Plasticity:
    """Plastic bending, or friction between strands of a cable, which slip at the yield curvature.

    Beyond it, the share `hardening` of the bending stiffness remains.

    Parameters:
        yield_curvature: Curvature beyond which bending is plastic, or at which strands slip; 0 =
            always elastic.
        hardening: Ratio of tangent to elastic bending stiffness beyond yield (linear kinematic
            hardening); cable.bending_stiffness is the elastic one, of small motion.
    """

    yield_curvature: float = parameter(0.0, "1/m", (0.0, 1.0e5))
    hardening: float = parameter(0.0, "", (0.0, 0.999))


@dataclass(frozen=True)
class Torsion:
    """Frenet torsion.

    Parameters:
        curvature_floor: For terms.twist frenet: curvature below which the torsion of the centerline
            is undefined and suppressed; 0 = 1 % of the curvature of the cable closed to a ring.
    """

    curvature_floor: float = parameter(0.0, "1/m", (0.0, 1.0e5))


@dataclass(frozen=True)
class Contact:
    """Contact of the cable with obstacles and with itself: what they have in common.

    Parameters:
        self: Whether the cable touches itself, with contact.friction, instead of passing through
            itself; needs energy_momentum or implicit_midpoint. auto = off, with a warning where it
            passes through.
        stiffness: Contact force per unit length and penetration depth; 0 = chosen for each
            obstacle: so that the weight on earth presses the cable in by a thousandth of its
            diameter, landing at 2 m/s by a fiftieth, usual tension round an edge or a body by a
            fiftieth, its tip gives way by a fortieth of what the cable gives way along itself, and
            no throw at inputs.max_speed goes through a body.
        restitution: Speed at which the cable leaves an obstacle that it hits, in the speed at which
            it came: 0 = it lies where it lands, 1 = it bounces without loss; the same at every
            step.
        damping: Share of critical damping where the cable touches itself, and nowhere else: 0 = it
            bounces.
        friction: Coefficient of friction of the cable on itself, and on obstacles that have none of
            their own.
        markers: Largest number of obstacles that markers on ~/obstacles add while the node runs;
            0 = it does not listen there.
    """

    self: str = parameter("auto", choices=SWITCH)
    stiffness: float = parameter(0.0, "N/m^2", (0.0, 1.0e12))
    restitution: float = parameter(0.0, "", (0.0, 1.0))
    damping: float = parameter(0.3, "", (0.0, 10.0))
    friction: float = parameter(0.0, "", (0.0, 100.0))
    markers: int = parameter(0, "", (0, 1000), read_only=True)


SHAPES = ("plane", "box", "sphere", "cylinder", "capsule", "ring", "channel", "mesh")
# What the name of a mesh begins with that is no file: one kept in the process, or itself as text.
IN_MEMORY, IN_TEXT = "triangles:", "base64:"


@dataclass(frozen=True)
class Obstacle:
    """A rigid body that the cable cannot enter.

    Parameters:
        shape: plane: the half-space below the plane through position, normal to the obstacle's z
            axis; box; sphere; cylinder; capsule; ring: an eyelet through which the cable runs, a
            torus; channel: a tube open at both ends, with round rims; the latter four about the z
            axis; mesh: a closed surface of triangles.
        size: Extent along its x, y and z axes. A sphere has the diameter x; a cylinder and a
            capsule have the diameter x and the length z, that of a capsule with its caps; a ring
            has an opening of diameter x and a wire of thickness y; a channel an opening of diameter
            x, a wall of thickness y and the length z; a plane and a mesh have none.
        position: Its centre, or of a plane a point on its surface; in `frame` if there is one.
        orientation: Quaternion x, y, z, w of its axes, world frame, or `frame` if there is one.
        mesh: File of the mesh (STL, OBJ, PLY, GLB or DAE; needs the extra `mesh`): a path relative
            to the scene's file (to the working directory if there is none), or
            package://PACKAGE/PATH. All its bodies are one obstacle.
        mesh_scale: Factor from the lengths in the file to m: 0.001 for an STL file in mm. DAE files
            name their unit, which is known.
        mesh_cells: Cells of the grid of distances along the longest side of the mesh. Edges and
            openings, and walls thinner than two cells, are rounded by about a cell; 0 = chosen: 48,
            or as many as make cells no larger than the cable's radius, up to a million in all.
        friction: Coefficient of Coulomb friction of the cable on it; auto (-1) = contact.friction.
        pose_topic: Topic of its pose (PoseStamped), which moves it; empty = it rests.
        frame: tf2 frame to which it is attached and with which it moves, such as that of a table or
            of a link of the robot. Without tf2, in a simulation from Python or the command line,
            this frame is the world frame.
        pose_timeout: Time without poses after which the last pose is held, with a warning.
        pose_smoothing: Half the window of a local quadratic fit that smooths noisy poses; 0 = off.
    """

    name: str
    shape: str = parameter("plane", choices=SHAPES)
    size: Vector = parameter((0.1, 0.1, 0.1), "m", (0.0, 1.0e6))
    position: Vector = parameter(ORIGIN, "m", (-1.0e8, 1.0e8))
    orientation: Quaternion = parameter((0.0, 0.0, 0.0, 1.0), "", (-1.0, 1.0))
    mesh: str = parameter("")
    mesh_scale: float = parameter(1.0, "", (1.0e-9, 1.0e9))
    mesh_cells: int = parameter(0, "", (0, 2000))
    friction: float = parameter(-1.0, "", (0.0, 100.0), auto=-1.0)
    pose_topic: str = parameter("", read_only=True)
    frame: str = parameter("", read_only=True)
    pose_timeout: float = parameter(1.0, "s", (0.01, 3600.0))
    pose_smoothing: float = parameter(0.0, "s", (0.0, 1.0))

    @property
    def tf_frame(self) -> str:
        """`frame`, which an end effector has under this name."""
        return self.frame

    @property
    def driven(self) -> bool:
        """Whether poses from a topic or tf2 move it."""
        return bool(self.pose_topic or self.frame)

    @property
    def normal(self) -> Vector:
        """Unit vector of its z axis, the outward normal of a plane."""
        return self.axes[2]

    @property
    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Unit vectors of its axes."""
        size = math.hypot(*self.orientation)
        x, y, z, w = (part / size for part in self.orientation)
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        )

    @property
    def mesh_url(self) -> str:
        """Where other programs find the file of its mesh; empty for triangles without a file."""
        if self.mesh.startswith((IN_MEMORY, IN_TEXT)):
            return ""
        if "://" in self.mesh:
            return self.mesh
        return Path(os.path.expanduser(self.mesh)).absolute().as_uri()

    def pushes_along(self, axis: int, place: float) -> bool:
        """Whether it can push a cable out of the plane normal to a world axis, at this place on it:
        unless it is mirrored in that plane, or a prism across it, which of a mesh is not known.
        """
        if self.shape == "plane":
            return self.normal[axis] != 0.0
        away = abs(self.position[axis] - place)
        if self.shape == "mesh":
            return True
        if self.shape == "sphere":
            return away != 0.0
        rounding = {"capsule": self.size[0], "channel": self.size[1]}.get(self.shape, 0.0)
        for extent, one in zip(self.size, self.axes, strict=True):
            if abs(one[axis]) == 1.0:
                prism = self.shape == "box" or (one == self.axes[2] and self.shape != "ring")
                return away > (0.5 * (extent - rounding) if prism else 0.0)
        return True


@dataclass(frozen=True)
class Load:
    """A force or wrench on the cable, from a topic or from a signal.

    Parameters:
        topic: Topic of the load; empty without a signal = `~/<name>/wrench` or `~/<name>/force`
            (for a load named `force` of type force: `~/force`).
        type: Message type: WrenchStamped, or Vector3Stamped (a force).
        position: Location on the cable: 0 at start, 1 at end; the default for a load named `start`
            is 0.0.
        timeout: Time without messages after which the load is removed; 0 = never.
        sign: 1: messages give the load exerted on the cable by the end effector; -1: the opposite.
        frame: Frame of messages without a frame_id: the name in `start.frame`, `end.frame` or
            `grasps.<name>.frame` for a sensor that turns with that end effector, or `frame_id`, or,
            with inputs.tf, any frame of tf2; empty = `frame_id`, which is said when it is used.
        signal: Load without a topic: constant, or force and torque times sin(2 pi frequency t).
        force: Force of the signal, world frame.
        torque: Torque of the signal, world frame.
        frequency: Frequency of a sine.
    """

    name: str
    topic: str = parameter("", read_only=True)
    type: str = parameter("wrench", choices=("wrench", "force"), read_only=True)
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


# -- what holds it --------------------------------------------------------------------------------


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


# -- how it is computed, inputs and outputs -------------------------------------------------------

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
        mass: Mass matrix: consistent (banded), or lumped (diagonal, less accurate).
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
    mass: str = parameter("consistent", choices=("consistent", "lumped"))
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
class Integrator:
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


# -- the scene ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """A cable, its ends and loads, and how it is computed. Hashable and comparable by value.

    Parameters:
        frame_id: World frame of all outputs and of inputs without a frame.
        rate: Rate of the node's timer.
        gravity: Acceleration of gravity, world frame.
        loads: Names of the loads; each has a block `loads.<name>`.
        grasps: Names of the grasps (grippers between the ends); each has a block `grasps.<name>`.
        obstacles: Names of the obstacles; each has a block `obstacles.<name>`.
    """

    frame_id: str = parameter("world", read_only=True)
    rate: float = parameter(200.0, "Hz", (1.0, 2000.0))
    cable: Cable = Cable()
    damping: Damping = Damping()
    discretization: Discretization = Discretization()
    terms: Terms = Terms()
    plasticity: Plasticity = Plasticity()
    water: Water = Water()
    hose: Hose = Hose()
    torsion: Torsion = Torsion()
    gravity: Vector = parameter((0.0, 0.0, -9.81), "m/s^2", (-1.0e4, 1.0e4))
    start: End = End()
    end: End = End(position=(1.0, 0.0, 0.0), fixed=(False, False, False))
    loads: tuple[Load, ...] = parameter((), read_only=True)
    grasps: tuple[Grasp, ...] = parameter((), read_only=True)
    obstacles: tuple[Obstacle, ...] = parameter((), read_only=True)
    contact: Contact = Contact()
    initial: Initial = Initial()
    integrator: Integrator = Integrator()
    inputs: Inputs = Inputs()
    measured: Measured = Measured()
    outputs: Outputs = Outputs()
    forecast: Forecasts = Forecasts()
    accuracy: Accuracy = Accuracy()
    state: State = State()
    added: tuple[Obstacle, ...] = ()  # by `Simulator.add_obstacles`; no parameters

    @property
    def curvature_floor(self) -> float:
        """Curvature floor of the Frenet torsion [1/m]: as given, or 1 % of the curvature of the
        cable bent to a closed ring, 0.01 * 2 pi / L."""
        return self.torsion.curvature_floor or 0.02 * math.pi / self.cable.length

    @property
    def drag_across(self) -> float:
        """Normal minus tangential air drag c_n - c_t [N s/m^2]; 0 without damping."""
        return 0.0 if self.terms.damping == "off" else self.damping.drag_across

    @property
    def water_drag(self) -> tuple[float, float]:
        """k_n and k_t [N s^2/m^3] of the drag of water across and along the cable: half its density
        times coefficient and diameter, or circumference; 0 without damping.
        """
        if self.terms.damping == "off":
            return 0.0, 0.0
        scale = 0.5 * self.water.density * self.cable.diameter
        return scale * self.water.drag, scale * math.pi * self.water.drag_along

    @property
    def assumptions(self) -> tuple[str, ...]:
        """One line for each assumption about the cable and the water around it."""
        if self.water.density == 0.0 or self.water_surface is not None:
            return self.cable.assumptions
        everywhere = f"so that there is water of {self.water.density:g} kg/m^3 everywhere"
        return (*self.cable.assumptions, f"water.level: not given, {everywhere}")

    @property
    def water_surface(self) -> tuple[Vector, float] | None:
        """Unit normal of the surface of the water and its height along that [m]; None without."""
        if self.water.density == 0.0 or self.water.level == NO_SURFACE:
            return None
        x, y, z = self.gravity
        pull = math.hypot(x, y, z)
        up = (-x / pull, -y / pull, -z / pull) if pull else (0.0, 0.0, 1.0)
        return up, self.water.level

    @property
    def displaced(self) -> float:
        """Mass of the water that the cable displaces, per length [kg/m]."""
        return self.water.density * math.pi * self.cable.diameter**2 / 4.0

    @property
    def decay_rates(self) -> tuple[float, float]:
        """Rates [1/s] at which external damping lets the momenta of centreline and twist decay:
        alpha + c / mu with the air drag c along the cable, and alpha; 0 without damping.

        Air drag is a force per length and speed of the centreline. It has no torque about the
        centreline, so it does not damp twist. The excess of the drag across the cable is assembled
        with the forces (`engine.drag`).
        """
        if self.terms.damping == "off":
            return 0.0, 0.0
        alpha = self.damping.mass
        along = self.damping.air_drag * self.damping.air_drag_ratio
        return alpha + along / self.cable.mu, alpha

    @property
    def estimates_errors(self) -> bool:
        """Whether the error of a prediction is estimated, as long as there is time for it. With
        `auto` not where measured points correct the prediction: they do not correct finer runs.
        """
        wanted = self.accuracy.estimate
        return wanted == "on" or (wanted == "auto" and self.measured.type == "none")

    def friction_of(self, one: Obstacle | Grasp) -> float:
        """Coefficient of friction of the cable on an obstacle, or in a grasp that slides."""
        return self.contact.friction if one.friction < 0.0 else one.friction

    @property
    def rubbing(self) -> Names:
        """Names of the obstacles that rub on the cable."""
        touched = self.bodies if self.touches else ()
        return tuple(one.name for one in touched if self.friction_of(one) > 0.0)

    @property
    def may_roll(self) -> bool:
        """Whether friction of obstacles would roll a cable whose twist acts on its shape; not with
        contact.self on, as the matrix of an iteration is then without the twist.
        """
        later = bool(self.contact.markers) and self.touches and self.contact.friction > 0.0
        return (bool(self.rubbing) or later) and self.contact.self != "on"

    @property
    def rubs_itself(self) -> bool:
        """Whether the cable touches itself with friction."""
        return self.contact.self == "on" and self.contact.friction > 0.0

    @property
    def ends(self) -> dict[str, End]:
        """Both ends by name."""
        return {"start": self.start, "end": self.end}

    @cached_property
    def holders(self) -> dict[str, Holder]:
        """Both ends, then the grasps, by name."""
        return {**self.ends, **{grasp.name: grasp for grasp in self.grasps}}

    def load(self, name: str) -> Load:
        """The load of this name.

        Raises:
            KeyError: if there is none.
        """
        for load in self.loads:
            if load.name == name:
                return load
        names = ", ".join(load.name for load in self.loads) or "none"
        raise KeyError(f"no load '{name}' in this scene (its loads: {names})")

    def grasp(self, name: str) -> Grasp:
        """The grasp of this name.

        Raises:
            KeyError: if there is none.
        """
        return {grasp.name: grasp for grasp in self.grasps}[name]

    @property
    def bodies(self) -> tuple[Obstacle, ...]:
        """All obstacles, those of the scene first."""
        return (*self.obstacles, *self.added)

    @property
    def is_plastic(self) -> bool:
        """Whether bending can be plastic."""
        switch, yields = self.terms.plasticity, self.plasticity.yield_curvature > 0.0
        return switch == "on" or (switch == "auto" and yields)

    @property
    def is_driven(self) -> bool:
        """Whether poses move a gripper that holds the cable."""
        return any(holder.driven and holder.held for holder in self.holders.values())

    @property
    def is_rolled(self) -> bool:
        """Whether the roll is held by anything other than a clamp at an end: a spring, whose
        stiffness limits explicit steps.
        """
        springs = any(holder.roll_spring for holder in self.holders.values())
        return springs or any(grasp.roll for grasp in self.grasps)

    @property
    def may_twist(self) -> bool:
        """Whether anything can twist the cable: a moving clamp, a moment, or a held roll."""
        turned = any(end.clamped and end.driven for end in self.ends.values())
        moments = any(load.type == "wrench" for load in self.loads)
        return turned or moments or self.is_rolled

    @property
    def touches(self) -> bool:
        """Whether there are obstacles that the cable touches, or may come."""
        return bool(self.bodies or self.contact.markers) and self.terms.contact != "off"

    @property
    def touched(self) -> str:
        """The first obstacle that the cable touches, in words."""
        return f"obstacle {self.bodies[0].name}" if self.bodies else "contact.markers"

    @cached_property
    def moved(self) -> dict[str, Holder | Obstacle]:
        """What poses move, by name."""
        touched = self.obstacles if self.touches else ()
        bodies: dict[str, Holder | Obstacle] = {**self.holders}
        bodies |= {obstacle.name: obstacle for obstacle in touched}
        return {name: one for name, one in bodies.items() if one.driven}

    def holder_keys(self) -> list[tuple[str, Holder]]:
        """`holders` with the keys of their blocks."""
        return [*self.ends.items(), *((f"grasps.{grasp.name}", grasp) for grasp in self.grasps)]

    @property
    def tf_keys(self) -> Names:
        """Keys of the parameters that require tf2."""
        asked: dict[str, object] = {"inputs.tf": self.inputs.tf, "outputs.tf": self.outputs.tf}
        return tuple(key for key, value in (asked | self.followed_frames).items() if value)

    @property
    def followed_frames(self) -> dict[str, str]:
        """Key -> frame of tf2 that an end effector or an obstacle follows."""
        found = {f"{key}.tf_frame": holder.tf_frame for key, holder in self.holder_keys()}
        found |= {f"obstacles.{one.name}.frame": one.frame for one in self.obstacles}
        return {key: frame for key, frame in found.items() if frame}

    def with_values(self, values: Mapping[str, object]) -> "Scene":
        """A copy of the scene with these parameters changed, all checked together.

        Args:
            values: dotted key -> value, for example `{"cable.length": 2.0}`; loads, grasps
                and obstacles that are no longer named are dropped.

        Raises:
            SceneError: an unknown key or an invalid scene.
        """
        values = overridden(scene_values(self), mapping("values", values))
        return replace(scene_from_values(values), added=self.added)

    @property
    def without_tension(self) -> str:
        """Why the tension does not follow from the shape; empty if it does."""
        if self.terms.stretch == "off" or self.integrator.method == "rattle":
            return "is not known of a cable that does not stretch"
        if self.cable.shaped or self.plasticity.yield_curvature:
            return "is not known of a cable that is bent at rest or plastic"
        return ""


# -- terms of the model and methods that know them ------------------------------------------------


@dataclass(frozen=True)
class Term:
    """A term of the model: when a scene has it, and what it gives to the engine.

    Attributes:
        name: as in `left_out`; also of its switch in `terms`, and of its bit in
            `engine.arrays.BITS`, where it has one.
        needed: whether a scene needs it, `terms.twist` apart (`needs`).
        absent: why a scene lacks it that does not need it.
        loss: what a scene loses in which it is needed but switched off.
        forces: forces that it exerts, or velocities that it imposes, in the world; the cable stays
            in a plane only if all are in it.
        numbers: what `engine.arrays.Physics` holds for it, by name; vectors are in the world.
        faint: values that put it into a scene without visible effect, for `dlo_sim study omission`,
            where those are all it takes.
    """

    name: str
    needed: Callable[[Scene], bool]
    absent: str
    loss: Callable[[Scene], str] = lambda scene: ""
    forces: Callable[[Scene], Sequence[Vector]] = lambda scene: ()
    numbers: Callable[[Scene], dict[str, float | Vector]] = lambda scene: {}
    faint: Mapping[str, object] = field(default_factory=dict)


TERMS = (
    Term(
        "stretch",
        needed=lambda scene: scene.cable.EA > 0.0,
        absent="axial stiffness is 0",
        loss=lambda scene: f"nothing resists stretching, although EA is {scene.cable.EA:.3g} N",
        numbers=lambda scene: {"axial_round_off": scene.cable.EA * scene.cable.length},
    ),
    Term(
        "bend",
        needed=lambda scene: scene.cable.EI > 0.0,
        absent="bending stiffness is 0",
        loss=lambda scene: f"nothing resists bending, although EI is {scene.cable.EI:.3g} N m^2",
        numbers=lambda scene: {"bending_round_off": scene.cable.EI * scene.cable.length},
    ),
    Term(
        "twist",
        needed=lambda scene: scene.may_twist,
        absent="nothing twists the cable",
        loss=lambda scene: (
            "nothing turns the cable about its own axis, although a gripper or a moment does"
        ),
        numbers=lambda scene: {
            "GJ": scene.cable.GJ,
            "torsion_floor": scene.curvature_floor**2,
        },
    ),
    Term(
        "plasticity",
        needed=lambda scene: scene.plasticity.yield_curvature > 0.0,
        absent="no yield curvature",
        loss=lambda scene: (
            "bending leaves no set, although plasticity.yield_curvature is "
            f"{scene.plasticity.yield_curvature:g} 1/m"
        ),
        numbers=lambda scene: {
            "yield_moment": scene.cable.EI * scene.plasticity.yield_curvature,
            # H = EI h / (1 - h) gives the tangent stiffness h EI.
            "hardening": scene.plasticity.hardening / (1.0 - scene.plasticity.hardening),
        },
    ),
    Term(
        "contact",
        needed=lambda scene: bool(scene.bodies),
        absent="no obstacles",
        loss=lambda scene: "the cable goes through its obstacles",
    ),
    Term(
        "self_contact",
        needed=lambda scene: scene.contact.self == "on",
        absent="contact.self is not on",
    ),
    Term(
        "friction",
        needed=lambda scene: bool(scene.rubbing) or scene.rubs_itself,
        absent="the cable touches no obstacle, nor itself, with friction",
    ),
    Term(
        "gravity",
        needed=lambda scene: any(scene.gravity),
        absent="gravity is 0",
        loss=lambda scene: (
            f"the cable has no weight, although gravity is {list(scene.gravity)} m/s^2"
        ),
        forces=lambda scene: (scene.gravity,),
    ),
    Term(
        "springs",
        needed=lambda scene: any(
            any(one.spring) or one.tangent_spring or (isinstance(one, Grasp) and one.slides)
            for one in scene.holders.values()
        ),
        absent="no end hangs on a spring",
    ),
    Term("loads", needed=lambda scene: bool(scene.loads), absent="no loads"),
    Term("drive", needed=lambda scene: scene.is_driven, absent="no gripper moves an end"),
    Term(
        "damping",
        needed=lambda scene: (
            any((*scene.damping.internal, scene.damping.mass, scene.damping.air_drag))
            or scene.water.density > 0.0
        ),
        absent="no damping",
        loss=lambda scene: "no motion dies away, although the scene has damping coefficients",
        numbers=lambda scene: {
            "beta_stretch": scene.damping.internal[0],
            "beta_bend": scene.damping.internal[1],
            "beta_twist": scene.damping.internal[2],
            "thinning": scene.damping.thinning**2,
            "drag_across": scene.drag_across,
        },
    ),
    Term(
        "water",
        needed=lambda scene: scene.water.density > 0.0,
        absent="no water",
        forces=lambda scene: (scene.water.velocity,) if any(scene.water_drag) else (),
        numbers=lambda scene: {
            "water_across": scene.water_drag[0],
            "water_along": scene.water_drag[1],
            "water_current": scene.water.velocity,
        },
        faint={"water.density": 1e-9},
    ),
    Term(
        "pressure",
        needed=lambda scene: scene.hose.thrust > 0.0,
        absent="no pressure inside",
        numbers=lambda scene: {"thrust": scene.hose.thrust},
        faint={"hose.pressure": 1e-3, "hose.bore": 1e-4},
    ),
)

# Names of methods (`core.methods`), the best first.
EXPLICIT = ("velocity_verlet", "rk4", "forest_ruth", "zhai")
IMPLICIT = ("energy_momentum", "implicit_midpoint", "energy_momentum_4")
IMPLICIT_METHODS = ("auto", *IMPLICIT)  # values with which steps may be implicit
FORWARD = ("energy_momentum", "implicit_midpoint")  # implicit, without negative sub-steps
LOSSY = (*FORWARD, *EXPLICIT)
SINGLE = (*FORWARD, "velocity_verlet", "rk4", "zhai", "rattle")
NOT_EXPLICIT = (*IMPLICIT, "rattle")


@dataclass(frozen=True)
class Restriction:
    """Something that only some methods can step.

    Attributes:
        methods: the methods that can.
        key: the parameter by which a scene asks for it.
        value: its value; 0 or "" if the scene does not ask for it.
        off: the value with which every method will do.
        why: why other methods cannot, if that is not plain, to go on behind the value.
    """

    methods: Names
    key: str
    value: Callable[[Scene], float | str]
    off: str = "0.0"
    why: str = ""

    def asked(self, scene: Scene) -> str:
        """Key and value with which the scene asks for it."""
        value = self.value(scene)
        return f"{self.key} {value if isinstance(value, str) else f'{value:g}'}"

    @property
    def kind(self) -> str:
        """What kind of method can."""
        if self.methods == EXPLICIT:
            return "an explicit method"
        if set(self.methods) <= set(IMPLICIT):
            return "an implicit method"
        return f"one of {', '.join(self.methods)}"


def _of_twist(model: str) -> Callable[[Scene], str]:
    return lambda scene: model if scene.terms.twist == model else ""


def _of_damping(
    name: str, if_also: Callable[[Scene], float] = lambda scene: 1.0
) -> Callable[[Scene], float]:
    def value(scene: Scene) -> float:
        present = scene.terms.damping != "off" and if_also(scene)
        return float(getattr(scene.damping, name)) if present else 0.0

    return value


def _on(scene: Scene) -> str:
    return "on" if scene.contact.self == "on" else ""


def _touching(scene: Scene) -> str:
    return f"{scene.terms.contact} ({scene.touched})" if scene.touches else ""


def _sliding(scene: Scene) -> str:
    return next((f"of grasp {one.name}" for one in scene.grasps if one.slides), "")


def _grasping(scene: Scene) -> str:
    return ", ".join(grasp.name for grasp in scene.grasps)


def _rolled(scene: Scene) -> float:
    return max(end.roll_spring for end in scene.ends.values())


def _shaped(scene: Scene) -> str:
    """The natural shape, as curvatures and twist rate along the cable."""
    return " ".join(shown(one) for one in scene.cable.natural_shape if any(one))


def _turned_drag(scene: Scene) -> str:
    return f"{scene.damping.air_drag_ratio:g}" if scene.drag_across else ""


def _measured(scene: Scene) -> str:
    return "" if scene.measured.type == "none" else scene.measured.type


_GROWING = ", since its negative sub-steps make damping grow"
_POINT_MASS = " beside a point mass (start.mass, end.mass)"
RESTRICTIONS = (
    Restriction(EXPLICIT, "terms.twist", _of_twist("frenet"), "auto"),
    Restriction(IMPLICIT, "terms.twist", _of_twist("quasistatic"), "auto"),
    Restriction(NOT_EXPLICIT, "terms.twist", _of_twist("bishop"), "off"),
    Restriction(FORWARD, "contact.self", _on, "off"),
    Restriction(FORWARD, "damping.stiffness", _of_damping("stiffness")),
    Restriction(FORWARD, "damping.stretch", _of_damping("stretch")),
    Restriction(FORWARD, "damping.bend", _of_damping("bend")),
    Restriction(FORWARD, "damping.twist", _of_damping("twist")),
    Restriction(
        ("energy_momentum",),
        "damping.thinning",
        _of_damping("thinning", if_also=lambda scene: scene.damping.internal[1]),
    ),
    Restriction(IMPLICIT, "damping.air_drag_ratio", _turned_drag, "1.0"),
    Restriction(IMPLICIT, "water.density", lambda scene: scene.water.density),
    Restriction(NOT_EXPLICIT, "hose.pressure", lambda scene: scene.hose.pressure),
    Restriction(
        IMPLICIT,
        "damping.air_drag",
        _of_damping("air_drag", if_also=lambda scene: scene.start.mass or scene.end.mass),
        why=_POINT_MASS,
    ),
    Restriction(SINGLE, "damping.mass", _of_damping("mass"), why=_GROWING),
    Restriction(SINGLE, "damping.air_drag", _of_damping("air_drag"), why=_GROWING),
    Restriction(
        LOSSY,
        "plasticity.yield_curvature",
        lambda scene: scene.plasticity.yield_curvature if scene.is_plastic else 0.0,
    ),
    Restriction(FORWARD, "terms.contact", _touching, "off", ", since its steps cannot land"),
    Restriction(
        FORWARD, "slides", _sliding, "false", ", since its steps cannot let the cable slide"
    ),
    Restriction(NOT_EXPLICIT, "grasps.names", _grasping, "[]"),
    Restriction(NOT_EXPLICIT, "roll_spring", _rolled),
    Restriction(NOT_EXPLICIT, "cable.rest_curvature", _shaped, "[0.0]"),
    Restriction(IMPLICIT, "measured.type", _measured, "none"),
)


def restrictions_of(scene: Scene) -> list[Restriction]:
    """What of a scene only some methods can step."""
    return [one for one in RESTRICTIONS if one.value(scene)]


# -- scenes from values ---------------------------------------------------------------------------


def default_scene(
    load_names: Names = (), grasp_names: Names = (), obstacle_names: Names = ()
) -> Scene:
    """The scene with default values and these loads, grasps and obstacles."""
    return replace(
        Scene(),
        loads=tuple(Load(name, position=0.0 if name == "start" else 1.0) for name in load_names),
        grasps=tuple(Grasp(name=name) for name in grasp_names),
        obstacles=tuple(Obstacle(name) for name in obstacle_names),
    )


@lru_cache(maxsize=16)
def scene_parameters(*names_of_groups: Names) -> tuple[Parameter, ...]:
    """Every parameter of a scene with these loads, grasps and obstacles, with its default."""
    names = {f"{group}.names" for group in _NAMED}
    rows = parameters_of(default_scene(*names_of_groups))
    return tuple(replace(row, default=()) if row.key in names else row for row in rows)


def placeholder_parameters() -> tuple[Parameter, ...]:
    """Every parameter, with `<name>` for the name in every group of blocks."""
    return scene_parameters(*[("<name>",)] * len(_NAMED))


def parameters_of_scene(scene: Scene) -> tuple[Parameter, ...]:
    """Every parameter of a scene, with its default."""
    groups = (getattr(scene, group) for group in _NAMED)
    return scene_parameters(*(tuple(item.name for item in group) for group in groups))


def is_node_key(key: str) -> bool:
    """Whether this key of a scene file is a parameter of the node that is not part of the scene."""
    return _NODE_KEYS.fullmatch(key) is not None


def scene_from_values(values: Mapping[str, object]) -> Scene:
    """Build a scene from flat values; missing keys have their defaults.

    Args:
        values: dotted key -> value, as in `{"cable.length": 2.0, "start.fixed": [True] * 3}`.

    Raises:
        SceneError: unknown key, wrong type, out of range, or an inconsistent scene.
    """
    given = without_retired(mapping("values", values))
    names = [_names(group, given) for group in _NAMED]
    known = {row.key: row for row in scene_parameters(*names)}
    checked: dict[str, Any] = {}
    for key, value in given.items():
        if not isinstance(key, str):
            raise SceneError(f"{brief(key)}: a key must be a string; give one like 'cable.length'")
        if key in known:
            checked[key] = check_value(known[key], value)
        elif not is_node_key(key):
            raise unknown_key(key, value, known)
    scene = with_parameters(default_scene(*names), checked)
    scene = replace(scene, cable=replace(scene.cable, bore=scene.hose.bore))
    _check(scene)
    return scene


def scene_values(scene: Scene) -> dict[str, Any]:
    """All parameters of a scene, dotted key -> value; lists for arrays.

    `scene_from_values(scene_values(scene)) == scene`.
    """
    return {
        row.key: list(row.default) if isinstance(row.default, tuple) else row.default
        for row in parameters_of(scene)
    }


def overridden(values: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """The values with changes applied, without the blocks of names that are dropped."""
    left = dict(values)
    for group in _NAMED:
        if f"{group}.names" in changes:
            dropped = set(_names(group, values)) - set(_names(group, changes))
            blocks = tuple(f"{group}.{name}." for name in dropped)
            left = {key: value for key, value in left.items() if not key.startswith(blocks)}
    return {**left, **changes}


def mapping(name: str, values: object) -> dict[str, object]:
    """A copy of a mapping as a dictionary; `name` appears in the error.

    Raises:
        TypeError: not a mapping.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"{name}: needs a mapping, {{'cable.length': 2.0}}, got {brief(values)}")
    return dict(values)


def _names(group: str, values: Mapping[str, object]) -> Names:
    """The names of a group's blocks, from `<group>.names` in the values."""
    row = next(row for row in scene_parameters() if row.key == f"{group}.names")
    names = check_value(row, values.get(row.key, row.default))
    texts = tuple(str(name) for name in names)  # type: ignore[union-attr]
    check_names(row.key, texts, _NAMED[group])
    return texts


PARAMETERS = scene_parameters()
"""All parameters except those of loads, grasps and obstacles, whose keys contain their names."""


def markdown_table() -> str:
    """The parameter table as GitHub markdown, without a trailing newline."""
    lines = ["| parameter | type | default | unit | range | meaning |", "|---|---|---|---|---|---|"]
    return "\n".join(lines + [markdown_row(row) for row in placeholder_parameters()])


# -- values that are valid one by one but not together --------------------------------------------


def _check(scene: Scene) -> None:
    """Refuse values that are valid one by one but not together.

    Raises:
        SceneError: naming the key, the value and the cure of the first conflict.
    """
    for key, value, problem in _conflicts(scene):
        raise refusal(key, value, problem)
    if scene.measured.type != "none" and scene.accuracy.estimate == "on":
        raise SceneError(
            "accuracy.estimate: on cannot be had while measured points correct the prediction; "
            "give auto, or measured.type: none"
        )


def _conflicts(scene: Scene) -> Conflicts:
    yield from _cable(scene.cable)
    mesh = scene.discretization
    yield from _of("discretization", mesh, _discretization(mesh))
    for name, holder in scene.holder_keys():
        yield from _springs(name, holder)
        yield from _of(name, holder, _holder(name, holder, scene.cable.length))
        yield from _of(name, holder, _tf_frame(name, holder, scene.frame_id))
    yield from _placement(scene)
    yield from _frames(scene)
    for load in scene.loads:
        key = f"loads.{load.name}"
        yield from _of(key, load, _load(key, load))
    yield from _load_frames(scene)
    yield from _topics(scene)
    names = {grasp.name for grasp in scene.grasps}
    yield from _obstacles(scene.obstacles, names, scene.cable.diameter)
    for obstacle in scene.obstacles:
        key = f"obstacles.{obstacle.name}"
        yield from _of(key, obstacle, _frame_of_obstacle(key, obstacle, scene.frame_id))
    yield from _contact(scene.contact)
    if scene.contact.markers and scene.terms.contact == "off":
        problem = "obstacles would do nothing, since terms.contact is off; set it to auto"
        yield "contact.markers", scene.contact.markers, problem
    if scene.water.level != NO_SURFACE and scene.water.density == 0.0:
        problem = "m is the surface of no water; give water.density, or remove it"
        yield "water.level", scene.water.level, problem
    least = 0.0 if scene.hose.pressure else -1.0
    if not least < scene.hose.bore < scene.cable.diameter:
        what = "no inner diameter for a hose.pressure" if scene.hose.bore == 0.0 else "too wide"
        cure = f"give it, below cable.diameter ({scene.cable.diameter:g} m)"
        yield "hose.bore", scene.hose.bore, f"m is {what}; {cure}"
    yield from _times(scene)
    yield from _colors(scene)


def _of(prefix: str, group: object, rules: Iterator[tuple[str, str]]) -> Conflicts:
    """Conflicts of a group's parameters, from their names and problems."""
    for name, problem in rules:
        yield f"{prefix}.{name}", getattr(group, name), problem


def _cable(cable: Cable) -> Conflicts:
    if 0.0 < cable.linear_density < LEAST_DENSITY:
        cure = f"give {LEAST_DENSITY:g} kg/m or more, or 0 for rho pi D^2 / 4"
        yield "cable.linear_density", cable.linear_density, f"is next to no mass; {cure}"
    for name in ("rest_curvature", "rest_curvature_2", "rest_twist"):
        if not getattr(cable, name):
            yield f"cable.{name}", (), "is empty; give [0.0] for a straight cable"
    axis = cable.rest_curvature_axis
    size = math.hypot(*axis)
    if abs(size - 1.0) > 1e-6:
        unit = shown(tuple(round(a / size, 9) for a in axis)) if size > 0.0 else "[0.0, 1.0, 0.0]"
        yield "cable.rest_curvature_axis", axis, f"is not a unit vector; give {unit}"


def _discretization(mesh: Discretization) -> Iterator[tuple[str, str]]:
    """Quadratures that do not fit the knots, or leave motions that cost no energy."""
    gauss, number, by_span = mesh.quadrature == "gauss", mesh.control_points, mesh.stretch == "span"
    least = max(2 * (number - 3), 4)
    if 0 < number < 4:
        yield "control_points", "are too few for a cubic; give 4 or more, or 0"
    if mesh.knots == "graded" and not gauss:
        yield "knots", "need Gauss points; set discretization.quadrature to gauss"
    if mesh.knots == "graded" and mesh.grading[2] == 0.0:
        yield "grading", "decays over no length; give one above 0 m as the third number"
    if gauss and not 2 <= mesh.samples <= 10:
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
    if not gauss and mesh.samples < least:
        cure = f"give {least} or more in all, two a knot span"
        yield "samples", f"samples are too few for uniform quadrature; {cure}"


def _springs(name: str, end: Holder) -> Conflicts:
    for axis, stiffness in enumerate(end.spring):
        if end.fixed[axis] and stiffness > 0.0:
            why = f"since {name}.fixed[{axis}] is true; set one of them to zero or false"
            yield f"{name}.spring[{axis}]", stiffness, f"N/m would do nothing, {why}"


def _holder(name: str, end: Holder, length: float) -> Iterator[tuple[str, str]]:
    """Clamps, roll, jaws and topics that would have no effect."""
    if end.clamped and not all(end.fixed):
        yield "clamped", f"needs {name}.fixed: [true, true, true] (it is {shown(end.fixed)})"
    if end.clamped and end.tangent_spring:
        cure = f"remove it, or set {name}.clamped: false"
        yield "tangent_spring", f"N m/rad would do nothing beside a clamp; {cure}"
    if end.holds_roll and not end.holds_direction:
        key = "roll_spring" if end.roll_spring else "roll"
        yield key, f"needs the direction held; set {name}.clamped or {name}.tangent_spring"
    if end.roll_spring and isinstance(end, End) and end.clamped:
        cure = f"remove it, or take {name}.tangent_spring instead of the clamp"
        yield "roll_spring", f"N m/rad would do nothing beside a clamp; {cure}"
    if isinstance(end, Grasp) and end.roll and end.roll_spring:
        cure = f"remove it, or set {name}.roll: false"
        yield "roll_spring", f"N m/rad would do nothing beside {name}.roll: true; {cure}"
    if isinstance(end, Grasp) and end.slides:
        if end.clamped:
            cure = f"set {name}.clamped: false; tangent_spring holds the direction"
            yield "slides", f"is not possible with a clamp; {cure}"
        if end.holds_roll:
            yield "slides", f"is not possible where the roll is held; remove {name}.roll"
        if not all(end.fixed):
            yield "slides", f"needs {name}.fixed: [true, true, true] (it is {shown(end.fixed)})"
    elif isinstance(end, Grasp) and (end.grip or end.friction >= 0.0):
        cure = f"set {name}.slides: true, or remove it"
        yield "grip" if end.grip else "friction", f"does nothing for a cable held fast; {cure}"
    if end.jaw > length:
        yield "jaw", f"m is longer than the cable, {length:g} m; shorten the jaw"
    if end.jaw and not end.clamped:
        cure = f"set {name}.clamped: true, or remove it"
        yield "jaw", f"m of cable is held straight by a clamp alone; {cure}"
    if end.pose_type == "two_points" and any(end.tangent):
        why = f"since {name}.pose_type two_points makes it the x axis"
        yield "tangent", f"would be ignored, {why}; remove it"
    if end.pose_type == "pose" and end.pose_spacing:
        cure = f"set {name}.pose_type to two_points, or remove it"
        yield "pose_spacing", f"m would be ignored; {cure}"
    if end.driven and not end.held:
        key = "pose_topic" if end.pose_topic else "tf_frame"
        cure = f"set {name}.fixed: [true, true, true] or remove {name}.{key}"
        yield key, f"would move nothing, since it holds nothing; {cure}"


def _tf_frame(name: str, end: Holder, world: str) -> Iterator[tuple[str, str]]:
    """A frame in addition to a topic, and one that tf2 cannot have or that never moves."""
    if end.tf_frame and (end.pose_topic or end.pose_type != "pose"):
        cure = f"remove {name}.pose_topic and {name}.pose_type, or tf_frame"
        yield "tf_frame", f"gives the pose; {cure}"
    if end.tf_frame.startswith("/"):
        yield "tf_frame", f"is no frame of tf2; give {end.tf_frame.lstrip('/') or 'tool0'}"
    if end.tf_frame and end.tf_frame == world:
        yield "tf_frame", "is the world frame, frame_id; give the frame of the end-effector"


def _placement(scene: Scene) -> Conflicts:
    """Ends that leave the direction of the initial shape or of a clamp undefined, or that are too
    far apart.
    """
    start, end, length = scene.start, scene.end, scene.cable.length
    gap = math.dist(start.position, end.position)
    rigid = all(start.fixed) and all(end.fixed)
    for name, held in scene.ends.items():
        if gap == 0.0 and held.clamped and not any(held.tangent):
            problem = "gives no direction, since both ends are at the same place; give a direction"
            yield f"{name}.tangent", held.tangent, problem
    if gap == 0.0 and (scene.initial.shape == "straight" or not rigid):
        problem = (
            "equals start.position, so a straight cable has no direction; move it or "
            "start.position apart"
        )
        yield "end.position", end.position, problem
    if rigid and gap > _LARGEST_STRETCH * length and not (start.driven or end.driven):
        problem = (
            f"is {gap:g} m from start.position, but the cable is only {length:g} m long; move the "
            "ends together or lengthen cable.length"
        )
        yield "end.position", end.position, problem


def _frames(scene: Scene) -> Conflicts:
    """A frame name shared by two end-effectors, or by one and the world."""
    seen = {scene.frame_id: "frame_id"}
    for name, holder in scene.holder_keys():
        key = f"{name}.frame"
        if holder.frame and seen.setdefault(holder.frame, key) != key:
            problem = f"is also {seen[holder.frame]}; give the end-effector's own frame"
            yield key, holder.frame, problem


def _load(key: str, load: Load) -> Iterator[tuple[str, str]]:
    """Values of a load that would be ignored."""
    if load.signal != "none" and load.topic:
        yield "topic", f"cannot be used with {key}.signal {load.signal}; remove one of them"
    for part in ("force", "torque") if load.signal == "none" else ():
        if any(getattr(load, part)):
            cure = f"set {key}.signal to constant or sine, or remove it"
            yield part, f"would be ignored; {cure}"
    if load.type == "force" and any(load.torque):
        yield "torque", f"would be ignored; set {key}.type to wrench"


def _load_frames(scene: Scene) -> Conflicts:
    """A frame of a load that nothing has, and two frames of one topic."""
    known = [scene.frame_id, *(one.frame for _, one in scene.holder_keys() if one.frame)]
    first: dict[str, Load] = {}
    for load in scene.loads:
        if not load.input_topic:
            continue
        key = f"loads.{load.name}.frame"
        if load.frame and load.frame not in known and not scene.inputs.tf:
            cure = "give one of them, or name that of the end effector in start.frame or end.frame"
            yield key, load.frame, f"is no frame here ({', '.join(known)}); {cure}"
        other = first.setdefault(load.input_topic, load)
        if load.frame != other.frame:
            problem = (
                f"differs from loads.{other.name}.frame {shown(other.frame)} of the same topic; "
                "give both the same"
            )
            yield key, load.frame, problem


def _topics(scene: Scene) -> Conflicts:
    """Malformed topic names, and topics read as two types."""
    holders = scene.holder_keys()
    inputs = [(f"{name}.pose_topic", one.pose_topic, one.pose_type) for name, one in holders]
    inputs += [
        (f"obstacles.{one.name}.pose_topic", one.pose_topic, "pose") for one in scene.obstacles
    ]
    inputs += [(f"grasps.{one.name}.taken_topic", one.taken_topic, "taken") for one in scene.grasps]
    inputs += [(f"loads.{load.name}.topic", load.input_topic, load.type) for load in scene.loads]
    seen: dict[str, tuple[str, str]] = {}
    for key, topic, kind in inputs:
        if not topic:
            continue
        if not _TOPIC.fullmatch(topic):
            yield key, topic, "is not a topic name; give one like ~/wrench or /robot/pose"
        other, other_kind = seen.setdefault(topic, (key, kind))
        if other_kind != kind:
            problem = f"is read as {kind} here and as {other_kind} by {other}; use two topics"
            yield key, topic, problem


def _obstacles(obstacles: tuple[Obstacle, ...], grasps: set[str], diameter: float) -> Conflicts:
    for obstacle in obstacles:
        if obstacle.name in grasps:
            problem = "is the name of a grasp too; rename one of them"
            yield "obstacles.names", obstacle.name, problem
        if obstacle.shape == "mesh" and not obstacle.mesh:
            problem = "is no file; give a mesh file, or another shape"
            yield f"obstacles.{obstacle.name}.mesh", obstacle.mesh, problem
        if 0 < obstacle.mesh_cells < LEAST_CELLS:
            problem = f"are too few; give {LEAST_CELLS} or more, or 0 to have them chosen"
            yield f"obstacles.{obstacle.name}.mesh_cells", obstacle.mesh_cells, problem
        used = {"plane": 0, "mesh": 0, "sphere": 1, "ring": 2}.get(obstacle.shape, 3)
        key = f"obstacles.{obstacle.name}.size"
        least = min(obstacle.size[:used], default=LEAST_SIZE)
        if least < LEAST_SIZE:
            what = f"{least:g} m where a {obstacle.shape} needs more"
            if least == 0.0:
                what = f"a zero that a {obstacle.shape} needs"
            problem = f"has {what}; give its extents, or remove it"
            yield key, obstacle.size, problem
        elif obstacle.shape in ("ring", "channel") and obstacle.size[0] <= diameter:
            problem = (
                f"has an opening of {obstacle.size[0]:g} m, through which a cable of {diameter:g} "
                "m does not go; give a wider one, or a thinner cable"
            )
            yield key, obstacle.size, problem
        elif obstacle.shape == "channel" and obstacle.size[2] < obstacle.size[1]:
            problem = "is a channel shorter than its wall is thick; make it longer, or take a ring"
            yield key, obstacle.size, problem
        if math.hypot(*obstacle.orientation) < LEAST_QUATERNION:
            problem = "is no rotation; give x, y, z, w, [0.0, 0.0, 0.0, 1.0] for none"
            yield f"obstacles.{obstacle.name}.orientation", obstacle.orientation, problem


def check_added(scene: Scene, obstacle: Obstacle) -> None:
    """Refuse an obstacle that cannot be added to a scene while it is simulated.

    Raises:
        SceneError: as for an obstacle of a scene; it has the name of another one; poses move it.
    """
    triangles = isinstance(obstacle.mesh, str) and obstacle.mesh.startswith(IN_TEXT)
    for row in parameters_of(obstacle, f"obstacles.{obstacle.name}."):
        if not (triangles and row.default is obstacle.mesh):  # no name, and longer than one
            check_value(row, row.default)
    taken = set(scene.holders) | {one.name for one in scene.bodies}
    if obstacle.name in taken:
        raise refusal("obstacles", obstacle.name, "is there already; remove it before")
    if obstacle.name in _NAMED["obstacles"]:
        raise refusal("obstacles", obstacle.name, "means the cable itself; give another name")
    if obstacle.driven:
        raise SceneError(
            f"obstacles.{obstacle.name}: is moved by Simulator.move_obstacle, not poses"
        )
    for key, value, problem in _obstacles((obstacle,), set(), scene.cable.diameter):
        raise refusal(key, value, problem)


def _frame_of_obstacle(key: str, obstacle: Obstacle, world: str) -> Iterator[tuple[str, str]]:
    """A frame in addition to a topic, and one that tf2 cannot have or that never moves."""
    if obstacle.frame and obstacle.pose_topic:
        yield "frame", f"gives the pose; remove it or {key}.pose_topic"
    if obstacle.frame.startswith("/"):
        yield "frame", f"is no frame of tf2; give {obstacle.frame.lstrip('/') or 'table'}"
    if obstacle.frame == world:
        yield "frame", "is the world frame, frame_id, in which obstacles rest; remove it"


def _contact(contact: Contact) -> Conflicts:
    if 0.0 < contact.stiffness < LEAST_STIFFNESS:
        problem = f"is below {LEAST_STIFFNESS:g}; give 0 to have it chosen"
        yield "contact.stiffness", contact.stiffness, problem


def _times(scene: Scene) -> Conflicts:
    """A step below the resolution of stamps, and a catch-up below the timer period."""
    step, rate, catch_up = scene.integrator.step, scene.rate, scene.inputs.catch_up
    if 0.0 < step < LEAST_STEP:
        cure = "give 0 to have it chosen"
        problem = f"s is below {LEAST_STEP:g} s, the resolution of stamps; {cure}"
        yield "integrator.step", step, problem
    if catch_up < 1.0 / rate:
        problem = (
            f"s is shorter than one timer period ({1.0 / rate:g} s at rate {rate:g} Hz); give at "
            f"least {1.0 / rate:g}"
        )
        yield "inputs.catch_up", catch_up, problem


def _colors(scene: Scene) -> Conflicts:
    """A falling colour range, and colours by a tension that is not known."""
    low, high = scene.outputs.color_range
    if low > high:
        yield "outputs.color_range", (low, high), f"falls; give {shown((high, low))}"
    if scene.outputs.color_by == "tension" and scene.without_tension:
        problem = f"{scene.without_tension}; give curvature"
        yield "outputs.color_by", "tension", problem
