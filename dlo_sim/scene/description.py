"""A scene: everything that decides a simulation, as frozen dataclasses in SI units.

The path of an attribute is the key of its parameter (`scene.cable.length` is `cable.length`);
ranges, units and defaults are in `parameters.py`, and only `loading.py` builds scenes, so that
every scene has passed its checks.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

Vector = tuple[float, float, float]
Switches = tuple[bool, bool, bool]


@dataclass(frozen=True)
class Cable:
    """Material and section. Direct values of 0 mean: derived from modulus, density and diameter."""

    length: float
    diameter: float
    density: float
    youngs_modulus: float
    shear_modulus: float
    linear_density: float
    axial_stiffness: float
    bending_stiffness: float
    torsional_stiffness: float
    rest_curvature: tuple[float, ...]
    rest_curvature_axis: Vector

    @property
    def area(self) -> float:
        """Section area A = pi D^2 / 4 [m^2]."""
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
        """Torsional stiffness GJ = G pi D^4 / 32 [N m^2], or the value given directly."""
        return self.torsional_stiffness or self.shear_modulus * math.pi * self.diameter**4 / 32.0

    @property
    def polar_inertia(self) -> float:
        """Polar inertia per length mu D^2 / 8 [kg m]; equals rho pi D^4 / 32 when mu is derived."""
        return self.mu * self.diameter**2 / 8.0


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping alpha [1/s] and beta [s], and linear air drag [N s/m^2]."""

    mass: float
    stiffness: float
    air_drag: float


@dataclass(frozen=True)
class Discretization:
    """Spline, quadrature and mass matrix."""

    control_points: int
    quadrature: str
    samples: int
    stretch: str
    mass: str


@dataclass(frozen=True)
class Terms:
    """Which parts of the model are there: `auto`, `on`, `off`, or a variant of the term."""

    stretch: str
    bend: str
    twist: str
    gravity: str
    damping: str
    plasticity: str
    contact: str
    out_of_plane: str


@dataclass(frozen=True)
class Plasticity:
    """Plastic bending: yield curvature [1/m] (0 = never yields), tangent over elastic stiffness."""

    yield_curvature: float
    hardening: float


@dataclass(frozen=True)
class Torsion:
    """Frenet torsion: curvature floor [1/m] of its regularisation, 0 = derived from the length."""

    curvature_floor: float


@dataclass(frozen=True)
class End:
    """One end of the cable and the end-effector that holds it."""

    position: Vector
    fixed: Switches
    spring: Vector
    clamped: bool
    tangent: Vector
    offset: Vector
    frame: str
    mass: float
    pose_topic: str
    pose_timeout: float
    pose_smoothing: float

    @property
    def held(self) -> bool:
        """Whether anything (a fixed axis or a spring) ties this end to its end-effector."""
        return any(self.fixed) or any(self.spring)

    @property
    def driven(self) -> bool:
        """Whether poses from a topic move this end."""
        return bool(self.pose_topic)


@dataclass(frozen=True)
class Load:
    """A force or wrench on the cable, from a topic or from a signal."""

    name: str
    topic: str
    type: str
    position: float
    timeout: float
    sign: float
    signal: str
    force: Vector
    torque: Vector
    frequency: float

    @property
    def input_topic(self) -> str:
        """The topic that drives this load, the default one if none is named; empty for a signal."""
        if self.signal != "none":
            return ""
        if self.topic:
            return self.topic
        if self.type == "force":
            return "~/force" if self.name == "force" else f"~/{self.name}/force"
        return f"~/{self.name}/wrench"


@dataclass(frozen=True)
class Initial:
    """Shape at the start."""

    shape: str


@dataclass(frozen=True)
class Integrator:
    """Time integration: method, step [s] (0 = chosen), parameters of Zhai's method, solver
    tolerance, what a failure does."""

    method: str
    step: float
    zhai_psi: float
    zhai_phi: float
    spectral_radius: float
    tolerance: float
    on_failure: str


@dataclass(frozen=True)
class Inputs:
    """How messages are taken in: time base, latency [s], limits, catching up [s]."""

    latency: float
    time: str
    max_speed: float
    max_force: float
    max_torque: float
    catch_up: float


@dataclass(frozen=True)
class Outputs:
    """What is put out besides the control points."""

    centerline_samples: int
    marker_rate: float


@dataclass(frozen=True)
class Accuracy:
    """Position error [m] that is acceptable, and whether the error is estimated."""

    target: float
    estimate: str


@dataclass(frozen=True)
class Scene:
    """A cable, its ends and loads, and how it is computed. Hashable and comparable by value."""

    frame_id: str
    rate: float
    cable: Cable
    damping: Damping
    discretization: Discretization
    terms: Terms
    plasticity: Plasticity
    torsion: Torsion
    gravity: Vector
    start: End
    end: End
    loads: tuple[Load, ...]
    initial: Initial
    integrator: Integrator
    inputs: Inputs
    outputs: Outputs
    accuracy: Accuracy

    @property
    def curvature_floor(self) -> float:
        """Floor of the Frenet torsion [1/m]: as given, or 1 % of the curvature of the ring that the
        cable can be bent to, 0.01 * 2 pi / L."""
        return self.torsion.curvature_floor or 0.02 * math.pi / self.cable.length

    @property
    def ends(self) -> dict[str, End]:
        """Both ends by name."""
        return {"start": self.start, "end": self.end}

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

    def with_values(self, values: Mapping[str, object]) -> "Scene":
        """A scene with these parameters changed, all checked together.

        Args:
            values: dotted key -> value, for example `{"cable.length": 2.0}`.

        Raises:
            SceneError: if a key is unknown or the scene would be impossible.
        """
        from dlo_sim.scene.loading import changed_values, scene_from_values

        return scene_from_values(changed_values(self, values))
