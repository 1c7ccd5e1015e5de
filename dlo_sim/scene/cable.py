"""The cable, its loads and obstacles: groups of parameters in SI units.

ROS declarations, checks and the reference in config/README.md are generated from them.
"""

import math
from dataclasses import dataclass

from dlo_sim.scene.parameter import parameter

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Cable:
    """Material and cross-section. Direct values of 0 are derived from moduli, density, diameter.

    Parameters:
        length: Rest length L.
        diameter: Diameter D of the round section.
        density: Density rho.
        youngs_modulus: Young's modulus E.
        shear_modulus: Shear modulus G.
        linear_density: Mass per length mu; 0 = rho pi D^2 / 4. The polar inertia per length is mu
            D^2 / 8.
        axial_stiffness: EA; 0 = E pi D^2 / 4, as of a solid section, also if bending_stiffness is
            given.
        bending_stiffness: EI; 0 = E pi D^4 / 64, as of a solid section, also if axial_stiffness is
            given.
        torsional_stiffness: GJ; 0 = 2 G / E EI, as of an isotropic section (G pi D^4 / 32 if it is
            solid).
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
        """Cross-sectional area A = pi D^2 / 4 [m^2]."""
        return math.pi * self.diameter**2 / 4.0

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
        """Bending stiffness EI = E pi D^4 / 64 [N m^2], or the value given directly."""
        return self.bending_stiffness or self.youngs_modulus * math.pi * self.diameter**4 / 64.0

    @property
    def GJ(self) -> float:
        """Torsional stiffness GJ = 2 G / E EI [N m^2], or the value given directly."""
        return self.torsional_stiffness or 2.0 * self.shear_modulus / self.youngs_modulus * self.EI

    @property
    def polar_inertia(self) -> float:
        """Polar inertia per length mu D^2 / 8 [kg m]; equals rho pi D^4 / 32 when mu is derived."""
        return self.mu * self.diameter**2 / 8.0

    @property
    def assumptions(self) -> tuple[str, ...]:
        """One line for each value that is derived although its partner is given: the assumption."""
        lines = []
        if self.bending_stiffness and not self.torsional_stiffness:
            lines.append(
                "cable.torsional_stiffness: not given beside bending_stiffness, so GJ = 2 G / E EI "
                f"= {self.GJ:.3g} N m^2, as of an isotropic section"
            )
        if self.bending_stiffness and not self.axial_stiffness:
            lines.append(
                f"cable.axial_stiffness: not given beside bending_stiffness, so EA = E pi D^2 / 4 "
                f"= {self.EA:.3g} N, as of a solid section"
            )
        if self.axial_stiffness and not self.bending_stiffness:
            lines.append(
                f"cable.bending_stiffness: not given beside axial_stiffness, so EI = E pi D^4 / 64 "
                f"= {self.EI:.3g} N m^2, as of a solid section"
            )
        if self.linear_density:
            lines.append(
                f"cable.linear_density: the polar inertia that belongs to it is mu D^2 / 8 = "
                f"{self.polar_inertia:.3g} kg m, as of a solid section"
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
        density: Density of the water; 0 = no water. The cable displaces its section.
        velocity: Velocity of its current, world frame. An equilibrium at the start is that in still
            water; from there the cable drifts.
        drag: Drag coefficient across the cable, on its diameter.
        drag_along: Drag coefficient along the cable, on its surface.
    """

    density: float = parameter(0.0, "kg/m^3", (0.0, 1.0e5))
    velocity: Vector = parameter(ORIGIN, "m/s", (-1.0e3, 1.0e3))
    drag: float = parameter(1.2, "", (0.0, 100.0))
    drag_along: float = parameter(0.01, "", (0.0, 100.0))


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
    """Contact between the cable and obstacles: what they have in common.

    Parameters:
        stiffness: Contact force per unit length and penetration depth; 0 = chosen so that under
            earth gravity a cable penetrates a plane by a thousandth of its diameter, and another
            obstacle that all of it hangs over by at most a hundredth.
        damping: Share of critical damping of what touches: 0 = it bounces; auto (-1) = 0.3, or 0
            with methods that cannot dissipate in contact (rattle, energy_momentum_4).
        friction: Coefficient of friction of obstacles that have none of their own.
    """

    stiffness: float = parameter(0.0, "N/m^2", (0.0, 1.0e12))
    damping: float = parameter(-1.0, "", (0.0, 10.0), auto=-1.0)
    friction: float = parameter(0.0, "", (0.0, 100.0))


@dataclass(frozen=True)
class Obstacle:
    """A rigid body that the cable cannot enter.

    Parameters:
        shape: plane: the half-space below the plane through position, normal to the obstacle's z
            axis; box; sphere; cylinder; capsule: the latter two about the z axis.
        size: Extent along its x, y and z axes. A sphere has the diameter x; a cylinder and a
            capsule have the diameter x and the length z, that of a capsule with its caps; a plane
            has none.
        position: Its centre, or of a plane a point on its surface.
        orientation: Quaternion x, y, z, w of its axes, world frame.
        friction: Coefficient of Coulomb friction of the cable on it; auto (-1) = contact.friction.
        pose_topic: Topic of its pose (PoseStamped), which moves it; empty = it rests.
        pose_timeout: Time without poses after which the last pose is held, with a warning.
        pose_smoothing: Half the window of a local quadratic fit that smooths noisy poses; 0 = off.
    """

    name: str
    shape: str = parameter("plane", choices=("plane", "box", "sphere", "cylinder", "capsule"))
    size: Vector = parameter((0.1, 0.1, 0.1), "m", (0.0, 1.0e6))
    position: Vector = parameter(ORIGIN, "m", (-1.0e8, 1.0e8))
    orientation: Quaternion = parameter((0.0, 0.0, 0.0, 1.0), "", (-1.0, 1.0))
    friction: float = parameter(-1.0, "", (0.0, 100.0), auto=-1.0)
    pose_topic: str = parameter("", read_only=True)
    pose_timeout: float = parameter(1.0, "s", (0.01, 3600.0))
    pose_smoothing: float = parameter(0.0, "s", (0.0, 1.0))

    @property
    def driven(self) -> bool:
        """Whether poses from a topic move it."""
        return bool(self.pose_topic)

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

    def pushes_along(self, axis: int, place: float) -> bool:
        """Whether it can push a cable out of the plane normal to a world axis, at this place on it:
        unless it is mirrored in that plane, or a prism across it.
        """
        if self.shape == "plane":
            return self.normal[axis] != 0.0
        away = abs(self.position[axis] - place)
        if self.shape == "sphere":
            return away != 0.0
        for half, one in zip(self.size, self.axes, strict=True):
            if abs(one[axis]) == 1.0:
                prism = self.shape == "box" or one == self.axes[2]
                room = 0.5 * half - (0.5 * self.size[0] if self.shape == "capsule" else 0.0)
                return away > (room if prism else 0.0)
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
