"""A scene: the complete definition of a simulation, as frozen dataclasses in SI units.

The path of an attribute is the key of its parameter (`scene.cable.length` is `cable.length`).
Scenes are built by `scene_from_values`, so that every scene has passed the checks: of single values
(`parameter.check_value`), then of values that are valid one by one but not together. Each rule of
the latter yields the key, its value and the problem with the cure; the first one refuses the scene.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

from dlo_sim.scene.cable import (
    Cable,
    Contact,
    Damping,
    Load,
    Obstacle,
    Plasticity,
    Torsion,
    Vector,
    Water,
)
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

EARTH = 9.81  # [m/s^2]
DEPTH = 1e-3  # penetration of a cable into an obstacle under its weight on earth, in diameters
Names = tuple[str, ...]
# Groups with a block for each name, and their reserved names.
_NAMED: dict[str, Names] = {"loads": (), "grasps": ("start", "end"), "obstacles": ("start", "end")}
# Parameters of the node, not of the scene, that a scene file may contain.
_NODE_KEYS = re.compile(
    r"(use_sim_time|start_type_description_service|qos_overrides\..*|lifecycle|cables)"
)


_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
LEAST_STEP = 1e-9  # [s]; 0 = chosen automatically
LEAST_DENSITY = 1e-15  # [kg/m], of the least diameter and density allowed
LEAST_QUATERNION = 1e-3  # norm below which an orientation is refused
_LARGEST_STRETCH = 2.0  # distance of held ends, in lengths, above which it is surely a mistake

Conflicts = Iterator[tuple[str, object, str]]


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
    def displaced(self) -> float:
        """Mass of the water that the cable displaces, per length [kg/m]."""
        return self.water.density * math.pi * self.cable.diameter**2 / 4.0

    @property
    def implicit_drag(self) -> str:
        """Key and value of drag that only implicit methods know, since it is not isotropic and
        linear in the velocity; empty if there is none.
        """
        if self.drag_across:
            return f"damping.air_drag_ratio: {self.damping.air_drag_ratio:g}"
        return f"water.density: {self.water.density:g}" if any(self.water_drag) else ""

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
        """Contact force of a plane per length of cable and penetration depth [N/m^2]: as given, or
        such that the weight on earth leads to the penetration DEPTH."""
        return self.contact.stiffness or self.cable.mu * EARTH / (DEPTH * self.cable.diameter)

    def friction_of(self, obstacle: Obstacle) -> float:
        """Coefficient of friction of the cable on an obstacle."""
        return self.contact.friction if obstacle.friction < 0.0 else obstacle.friction

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
    def touches(self) -> bool:
        """Whether there are obstacles that the cable touches."""
        return bool(self.obstacles) and self.terms.contact != "off"

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


# ---------------------------------------------------------------------------------- conflicts


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
    yield from _obstacles(scene.obstacles, {grasp.name for grasp in scene.grasps})
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


def _obstacles(obstacles: tuple[Obstacle, ...], grasps: set[str]) -> Conflicts:
    for obstacle in obstacles:
        if obstacle.name in grasps:
            problem = "is the name of a grasp too; rename one of them"
            yield "obstacles.names", obstacle.name, problem
        used = {"plane": 0, "sphere": 1}.get(obstacle.shape, 3)
        if 0.0 in obstacle.size[:used]:
            problem = f"has a zero that a {obstacle.shape} needs; give its extents, or remove it"
            yield f"obstacles.{obstacle.name}.size", obstacle.size, problem
        if math.hypot(*obstacle.orientation) < LEAST_QUATERNION:
            problem = "is no rotation; give x, y, z, w, [0.0, 0.0, 0.0, 1.0] for none"
            yield f"obstacles.{obstacle.name}.orientation", obstacle.orientation, problem


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
