"""A scene: the complete definition of a simulation, as frozen dataclasses in SI units.

The path of an attribute is the key of its parameter (`scene.cable.length` is `cable.length`).
Scenes are built by `scene_from_values`, so that every scene has passed the checks.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

from dlo_sim.scene import consistency
from dlo_sim.scene.cable import (
    Cable,
    Contact,
    Damping,
    Load,
    Obstacle,
    Plasticity,
    Torsion,
    Vector,
)
from dlo_sim.scene.checking import check_names, check_value, unknown_key
from dlo_sim.scene.computation import (
    Accuracy,
    Discretization,
    Forecasts,
    Initial,
    Inputs,
    Integrator,
    Measured,
    Outputs,
    State,
    Terms,
)
from dlo_sim.scene.holders import End, Grasp, Holder
from dlo_sim.scene.parameter import Parameter, parameter, parameters_of, with_parameters
from dlo_sim.scene.refusal import SceneError, brief

EARTH = 9.81  # [m/s^2]
DEPTH = 1e-3  # penetration of a cable into an obstacle under its weight on earth, in diameters
Names = tuple[str, ...]
# Groups with a block for each name, and their reserved names.
_NAMED: dict[str, Names] = {"loads": (), "grasps": ("start", "end"), "obstacles": ()}
# Parameters of the node, not of the scene, that a scene file may contain.
_NODE_KEYS = re.compile(
    r"(use_sim_time|start_type_description_service|qos_overrides\..*|lifecycle|cables)"
)


@dataclass(frozen=True)
class Scene:
    """A cable, its ends and loads, and how it is computed. Hashable and comparable by value."""

    frame_id: str = parameter(
        "world", "World frame of all outputs and of inputs without a frame.", read_only=True
    )
    rate: float = parameter(200.0, "Rate of the node's timer.", "Hz", (1.0, 2000.0))
    cable: Cable = Cable()
    damping: Damping = Damping()
    discretization: Discretization = Discretization()
    terms: Terms = Terms()
    plasticity: Plasticity = Plasticity()
    torsion: Torsion = Torsion()
    gravity: Vector = parameter(
        (0.0, 0.0, -9.81), "Acceleration of gravity, world frame.", "m/s^2", (-1.0e4, 1.0e4)
    )
    start: End = End()
    end: End = End(position=(1.0, 0.0, 0.0), fixed=(False, False, False))
    loads: tuple[Load, ...] = parameter(
        (), "Names of the loads; each has a block `loads.<name>`.", read_only=True
    )
    grasps: tuple[Grasp, ...] = parameter(
        (),
        "Names of the grasps (grippers between the ends); each has a block `grasps.<name>`.",
        read_only=True,
    )
    obstacles: tuple[Obstacle, ...] = parameter(
        (),
        "Names of the obstacles; each has a block `obstacles.<name>`.",
        read_only=True,
    )
    contact: Contact = Contact()
    initial: Initial = Initial()
    integrator: Integrator = Integrator()
    inputs: Inputs = Inputs()
    measured: Measured = Measured()
    outputs: Outputs = Outputs()
    forecast: Forecasts = Forecasts()
    accuracy: Accuracy = Accuracy()
    state: State = State()

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

    @property
    def contact_stiffness(self) -> float:
        """Contact force per length of cable and penetration depth [N/m^2]: as given, or such that
        the weight on earth leads to the penetration DEPTH."""
        return self.contact.stiffness or self.cable.mu * EARTH / (DEPTH * self.cable.diameter)

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

    def holder_keys(self) -> list[tuple[str, Holder]]:
        """`holders` with the keys of their blocks."""
        return [*self.ends.items(), *((f"grasps.{grasp.name}", grasp) for grasp in self.grasps)]

    @property
    def tf_keys(self) -> Names:
        """Keys of the parameters that require tf2."""
        asked: dict[str, object] = {"inputs.tf": self.inputs.tf, "outputs.tf": self.outputs.tf}
        asked |= {f"{key}.tf_frame": holder.tf_frame for key, holder in self.holder_keys()}
        return tuple(key for key, value in asked.items() if value)

    def with_values(self, values: Mapping[str, object]) -> "Scene":
        """A copy of the scene with these parameters changed, all checked together.

        Args:
            values: dotted key -> value, for example `{"cable.length": 2.0}`; loads, grasps
                and obstacles that are no longer named are dropped.

        Raises:
            SceneError: an unknown key or an invalid scene.
        """
        return scene_from_values(overridden(scene_values(self), mapping("values", values)))

    @property
    def without_tension(self) -> str:
        """Why the tension does not follow from the shape; empty if it does."""
        if self.terms.stretch == "off" or self.integrator.method == "rattle":
            return "is not known of a cable that does not stretch"
        if self.cable.shaped or self.plasticity.yield_curvature:
            return "is not known of a cable that is bent at rest or plastic"
        return ""

    def check(self) -> None:
        """Refuse values that are valid one by one but not together.

        Raises:
            SceneError: naming the key, the value and the cure of the first conflict.
        """
        consistency.check_cable(self.cable)
        consistency.check_discretization(self.discretization)
        for key, holder in self.holder_keys():
            consistency.check_holder(key, holder, self.cable.length)
            consistency.check_tf_frame(key, holder, self.frame_id)
        consistency.check_placement(self.ends, self.cable.length, self.initial.shape)
        consistency.check_frames(self.frame_id, dict(self.holder_keys()))
        for load in self.loads:
            consistency.check_load(load)
        holders = dict(self.holder_keys())
        consistency.check_load_frames(self.frame_id, holders, self.loads, self.inputs.tf)
        consistency.check_topics(dict(self.holder_keys()), self.loads)
        consistency.check_obstacles(self.obstacles)
        consistency.check_times(self.rate, self.integrator.step, self.inputs.catch_up)
        if self.measured.type != "none" and self.accuracy.estimate == "on":
            raise SceneError(
                "accuracy.estimate: on cannot be had while measured points correct the prediction; "
                "give auto, or measured.type: none"
            )
        consistency.check_colors(self.outputs, self.without_tension)


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
    given = mapping("values", values)
    names = [_names(group, given) for group in _NAMED]
    known = {row.key: row for row in scene_parameters(*names)}
    checked: dict[str, Any] = {}
    for key, value in values.items():
        if not isinstance(key, str):
            raise SceneError(f"{brief(key)}: a key must be a string; give one like 'cable.length'")
        if key in known:
            checked[key] = check_value(known[key], value)
        elif not is_node_key(key):
            raise unknown_key(key, value, known)
    scene = with_parameters(default_scene(*names), checked)
    scene.check()
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
