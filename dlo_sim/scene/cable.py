"""What a scene says of the cable: material, damping, plasticity; what is in and around it."""

import math
from dataclasses import dataclass
from typing import Any

from dlo_sim.scene.parameter import ORIGIN, Group, Vector, off_unit, parameter
from dlo_sim.scene.refusal import Rules, shown

LEAST_DENSITY = 1e-15  # [kg/m], of the least diameter and density allowed
NO_SURFACE = 1e9  # [m], water.level of water that is everywhere


@dataclass(frozen=True)
class Cable(Group):
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
        square, fourth, section = "D^2", "D^4", "a solid section"
        if self.bore:
            square, fourth, section = "(D^2 - d^2)", "(D^4 - d^4)", "a hose's section"
        axial, bending, given = self.axial_stiffness, self.bending_stiffness, "not given beside"
        GJ = f"GJ = 2 G / E EI = {self.GJ:.3g} N m^2, as of an isotropic section"
        EA = f"EA = E pi {square} / 4 = {self.EA:.3g} N, as of {section}"
        EI = f"EI = E pi {fourth} / 64 = {self.EI:.3g} N m^2, as of {section}"
        polar = (
            f"mu {square.replace('-', '+')} / 8 = {self.polar_inertia:.3g} kg m, as of {section}"
        )
        rows = (
            (bending and not self.torsional_stiffness, f"torsional_stiffness: {given} bending", GJ),
            (bending and not axial, f"axial_stiffness: {given} bending", EA),
            (axial and not bending, f"bending_stiffness: {given} axial", EI),
        )
        lines = [f"cable.{what}_stiffness, so {value}" for applies, what, value in rows if applies]
        if self.linear_density:
            lines.append(f"cable.linear_density: the polar inertia that belongs to it is {polar}")
        return tuple(lines)

    def conflicts(self, key: str, scene: Any) -> Rules:
        """No mass, no natural shape, and an axis that is none."""
        if 0.0 < self.linear_density < LEAST_DENSITY:
            cure = f"give {LEAST_DENSITY:g} kg/m or more, or 0 for rho pi D^2 / 4"
            yield "linear_density", f"is next to no mass; {cure}"
        for name in ("rest_curvature", "rest_curvature_2", "rest_twist"):
            if not getattr(self, name):
                yield name, "is empty; give [0.0] for a straight cable"
        if unit := off_unit(self.rest_curvature_axis):
            yield "rest_curvature_axis", f"is not a unit vector; give {shown(unit)}"


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
class Water(Group):
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

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A surface or a current of no water."""
        if self.level != NO_SURFACE and self.density == 0.0:
            yield "level", "m is the surface of no water; give water.density, or remove it"
        if any(self.velocity) and self.density == 0.0:
            cure = "give water.density, 1.2 for wind, or remove it"
            yield "velocity", f"is the current of no water; {cure}"


@dataclass(frozen=True)
class Hose(Group):
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

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A bore that does not fit."""
        if not (0.0 if self.pressure else -1.0) < self.bore < scene.cable.diameter:
            what = "no inner diameter for a hose.pressure" if self.bore == 0.0 else "too wide"
            yield "bore", f"m is {what}; give it, below cable.diameter ({scene.cable.diameter:g} m)"


@dataclass(frozen=True)
class Plasticity:
    """Plastic bending, or friction between strands of a cable, which slip at the yield curvature.

    Beyond it, the fraction `hardening` of the bending stiffness remains.

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
