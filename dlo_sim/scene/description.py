"""A scene: the complete definition of a simulation, as frozen dataclasses in SI units.

The path of an attribute is the key of its parameter (`scene.cable.length` is `cable.length`), and
its description is in the docstring of its class: ROS declarations, checks and the tables of
config/README.md are generated from them. Values derived from parameters are properties.

Scenes are built by `scene_from_values`, so that every scene has passed the checks: of single values
(`parameter.check_value`), then of values together, by the `conflicts` of their group or, for
several groups, here. Each rule yields the key, its value and the problem with the cure; the first
one refuses the scene.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from itertools import groupby
from typing import Any

from dlo_sim.scene.cable import NO_SURFACE, Cable, Damping, Hose, Plasticity, Torsion, Water
from dlo_sim.scene.holders import End, Grasp, Holder, Load
from dlo_sim.scene.nets import (
    LARGEST_STRETCH,
    MAIN,
    Branch,
    Connector,
    FurtherCable,
    Joint,
    Strand,
    arrangement,
    ends_of,
    in_order,
    joints_of,
    references,
    strands_of,
)
from dlo_sim.scene.node import Forecasts, Inputs, Measured, Outputs, State
from dlo_sim.scene.numerics import Accuracy, Discretization, Initial, Integrator, Terms
from dlo_sim.scene.obstacles import Contact, Obstacle
from dlo_sim.scene.parameter import (
    Group,
    Names,
    Parameter,
    Vector,
    check_names,
    check_value,
    descriptions,
    markdown_row,
    parameter,
    parameters_of,
    unknown_key,
    with_parameters,
)
from dlo_sim.scene.refusal import SceneError, brief, refusal, shown
from dlo_sim.scene.retired import without_retired

Conflicts = Iterator[tuple[str, object, str]]  # keys, their values, and the problems with them
EARTH = 9.81  # [m/s^2]
# Groups with a block for each name, and their reserved names.
NAMED: dict[str, Names] = {
    "loads": (),
    "grasps": ("start", "end"),
    "obstacles": ("start", "end", "itself"),
    "branches": (MAIN, "start", "end", "itself"),
    "cables": (MAIN, "start", "end", "itself"),
    "connectors": (MAIN, "start", "end", "itself"),
}
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
# Parameters of the node, not of the scene, that a scene file may contain.
_NODE_KEYS = re.compile(
    r"(use_sim_time|start_type_description_service|qos_overrides\..*|lifecycle|cables)"
)


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
        branches: Names of the branches (cables that begin at another one); each has a block
            `branches.<name>`.
        cables: Names of further cables; each has a block `cables.<name>`.
        connectors: Names of the connectors (rigid bodies on cables); each has a block
            `connectors.<name>`.
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
    gravity: Vector = parameter((0.0, 0.0, -EARTH), "m/s^2", (-1.0e4, 1.0e4))
    start: End = End()
    end: End = End(position=(1.0, 0.0, 0.0), fixed=(False, False, False))
    loads: tuple[Load, ...] = parameter((), read_only=True)
    grasps: tuple[Grasp, ...] = parameter((), read_only=True)
    obstacles: tuple[Obstacle, ...] = parameter((), read_only=True)
    branches: tuple[Branch, ...] = parameter((), read_only=True)
    cables: tuple[FurtherCable, ...] = parameter((), read_only=True)
    connectors: tuple[Connector, ...] = parameter((), read_only=True)
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
        lines: dict[str, str] = {}  # each, without the key of the strand, said once
        for strand in self.strands:
            for line in strand.scene.cable.assumptions:
                lines.setdefault(line, strand.key_of(line))
        if self.water.density and self.water_surface is None:
            everywhere = f"so that there is water of {self.water.density:g} kg/m^3 everywhere"
            lines["water"] = f"water.level: not given, {everywhere}"
        return tuple(lines.values())

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

        The excess of the drag across the cable is assembled with the forces (`engine.drag`).
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
        estimate = self.accuracy.estimate
        return estimate == "on" or (estimate == "auto" and self.measured.type == "none")

    def friction_of(self, touched: Obstacle | Grasp) -> float:
        """Coefficient of friction of the cable on an obstacle, or in a grasp that slides."""
        return self.contact.friction if touched.friction < 0.0 else touched.friction

    @property
    def rubbing(self) -> Names:
        """Names of the obstacles that rub on the cable."""
        touched = self.bodies if self.touches else ()
        return tuple(one.name for one in touched if self.friction_of(one) > 0.0)

    @property
    def may_roll(self) -> bool:
        """Whether friction of obstacles would roll a cable whose twist acts on its shape; not with
        contact.self_contact on, as the matrix of an iteration is then without the twist.
        """
        later = bool(self.contact.markers) and self.touches and self.contact.friction > 0.0
        return (bool(self.rubbing) or later) and not self.touches_itself

    @property
    def touches_itself(self) -> bool:
        """Whether the cable touches itself, instead of passing through itself."""
        return self.contact.self_contact == "on"

    @property
    def ends(self) -> dict[str, End]:
        """Both ends of the main cable by name."""
        return {"start": self.start, "end": self.end}

    @property
    def is_net(self) -> bool:
        """Whether there is more than one cable: branches, others, joints, or connectors."""
        joined = self.start.joined or self.end.joined
        return bool(self.branches or self.cables or self.connectors or joined)

    @cached_property
    def strands(self) -> tuple[Strand, ...]:
        """The cables of a net, each with a scene of its own: the main one first, each branch after
        what it begins at.
        """
        return strands_of(self)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """The joints of a net: those at which branches begin, then those of joined ends."""
        return joints_of(self)

    @property
    def passes_roll(self) -> bool:
        """Whether a connector, or a joint that closes a loop or leads across the line of a cable,
        carries the roll over. One in line adds length, which needs no twist.
        """
        across = {one.name for one in self.branches if any(one.direction)}
        turning = any(one.joint == "rigid" for one in self.connectors)
        return turning or any(
            one.kind != "hinged" and (one.loop or one.strand in across) for one in self.joints
        )

    @property
    def shaped(self) -> bool:
        """Whether any cable is bent or twisted while it is unloaded."""
        return any(cable.shaped for cable in self.materials)

    @property
    def materials(self) -> tuple[Cable, ...]:
        """What all cables are made of, in the order of `strands`."""
        return tuple(strand.scene.cable for strand in self.strands)

    @cached_property
    def holders(self) -> dict[str, Holder]:
        """Both ends, then the grasps, by name: of each strand in turn, `<strand>.start` and
        `<strand>.end` unless it is the main one.
        """
        return {name: holder for name, _, holder in self._held()}

    def load(self, name: str) -> Load:
        """The load of this name; KeyError if there is none."""
        for load in self.loads:
            if load.name == name:
                return load
        names = ", ".join(load.name for load in self.loads) or "none"
        raise KeyError(f"no load '{name}' in this scene (its loads: {names})")

    def grasp(self, name: str) -> Grasp:
        """The grasp of this name; KeyError if there is none."""
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
        """Whether the roll is held by anything other than a clamp at an end, all but rigidly."""
        springs = any(holder.roll_spring for holder in self.holders.values())
        return springs or any(grasp.roll for grasp in self.grasps)

    @property
    def may_twist(self) -> bool:
        """Whether anything can twist the cable: a moving clamp, a moment, or a held roll."""
        ends = (one for one in self.holders.values() if isinstance(one, End))
        turned = any(end.clamped and end.driven for end in ends)
        moments = any(load.type == "wrench" for load in self.loads)
        return turned or moments or self.is_rolled

    @cached_property
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
        """`holders` with the keys of their blocks, which the start of a branch has not."""
        return [(key, holder) for _, key, holder in self._held() if key]

    def _held(self) -> Iterator[tuple[str, str, Holder]]:
        """Ends and grasps: name, key and holder."""
        blocks = {(name, place): (key, end) for name, key, place, end in ends_of(self)}
        for strand in self.strands:
            for place, name in enumerate(("start", "end")):
                unnamed = "", strand.scene.start  # of a branch
                yield strand.holder(name), *blocks.get((strand.name, float(place)), unnamed)
            grasps = (one for one in self.grasps if one.on == strand.name)
            yield from ((one.name, f"grasps.{one.name}", one) for one in grasps)

    @property
    def tf_keys(self) -> Names:
        """Keys of the parameters that require tf2."""
        asked: dict[str, object] = {"inputs.tf": self.inputs.tf, "outputs.tf": self.outputs.tf}
        asked |= {f"connectors.{one.name}.frame": one.frame for one in self.connectors}
        return tuple(key for key, value in (asked | self.followed_frames).items() if value)

    @property
    def followed_frames(self) -> dict[str, str]:
        """Key -> frame of tf2 that an end effector or an obstacle follows."""
        frames = {f"{key}.tf_frame": holder.tf_frame for key, holder in self.holder_keys()}
        frames |= {f"obstacles.{one.name}.frame": one.frame for one in self.obstacles}
        return {key: frame for key, frame in frames.items() if frame}

    def with_values(self, values: Mapping[str, object]) -> "Scene":
        """A copy with these parameters changed, all checked together: `{"cable.length": 2.0}`.

        Loads, grasps and obstacles that are no longer named are dropped. Raises SceneError for an
        unknown key or an invalid scene.
        """
        values = overridden(scene_values(self), mapping("values", values))
        return replace(scene_from_values(values), added=self.added)

    @property
    def without_tension(self) -> str:
        """Why the tension does not follow from the shape; empty if it does."""
        if self.terms.stretch == "off":
            return "is not known of a cable that does not stretch"
        if self.shaped or self.plasticity.yield_curvature:
            return "is not known of a cable that is bent at rest or plastic"
        return ""


# -- scenes from values ---------------------------------------------------------------------------


def default_scene(*names_of_groups: Names) -> Scene:
    """The scene with default values and these names in the groups of `NAMED`."""
    groups = dict(zip(NAMED, names_of_groups, strict=False))
    blocks: dict[str, Any] = {
        group: tuple(_block(group, name) for name in names) for group, names in groups.items()
    }
    return replace(Scene(), **blocks)


def _block(group: str, name: str) -> Any:
    """The block of a name with default values."""
    if group == "loads":
        return Load(name, position=0.0 if name == "start" else 1.0)
    kinds = {"grasps": Grasp, "obstacles": Obstacle, "branches": Branch, "cables": FurtherCable}
    return kinds.get(group, Connector)(name=name)


@lru_cache(maxsize=16)
def scene_parameters(*names_of_groups: Names) -> tuple[Parameter, ...]:
    """Every parameter of a scene with these names in the groups of `NAMED`, with its default."""
    names = {f"{group}.names" for group in NAMED}
    rows = parameters_of(default_scene(*names_of_groups))
    return tuple(replace(row, default=()) if row.key in names else row for row in rows)


def placeholder_parameters() -> tuple[Parameter, ...]:
    """Every parameter, with `<name>` for the name in every group of blocks."""
    return scene_parameters(*[("<name>",)] * len(NAMED))


def parameters_of_scene(scene: Scene) -> tuple[Parameter, ...]:
    """Every parameter of a scene, with its default, of which some depend on the scene."""
    groups = (getattr(scene, group) for group in NAMED)
    rows = scene_parameters(*(tuple(item.name for item in group) for group in groups))
    if not (scene.branches or scene.cables):
        return rows
    values = {row.key: row.default for row in parameters_of(scene)}
    origins = _origins({one.name: one.from_ for one in scene.branches}, _names("cables", values))
    inherited = {own: values[of] for own, of in origins.items()}
    return tuple(replace(row, default=inherited.get(row.key, row.default)) for row in rows)


def _origins(parents: Mapping[str, str], cables: Names) -> dict[str, str]:
    """Key of a value that is that of another key unless it is given, and that key; in an order in
    which those come first from which others follow. SceneError for branches from nowhere.
    """
    if not (parents or cables):
        return {}
    members = [row.key for row in parameters_of(Cable(), "cable.")]
    origins = {f"cables.{name}.{key}": key for name in cables for key in members}
    prefix = {MAIN: "", **{name: f"cables.{name}." for name in cables}}
    for name in in_order(parents, tuple(prefix)):
        prefix[name] = f"branches.{name}."
        origins |= {f"{prefix[name]}{key}": prefix[parents[name]] + key for key in members}
    return origins


def is_node_key(key: str) -> bool:
    """Whether this key of a scene file is a parameter of the node that is not part of the scene."""
    return _NODE_KEYS.fullmatch(key) is not None


def scene_from_values(values: Mapping[str, object]) -> Scene:
    """Build a scene from flat values, `{"cable.length": 2.0}`; missing keys have their defaults.

    Raises SceneError for an unknown key, a wrong type, a value out of range, or an inconsistent
    scene.
    """
    accepted = without_retired(mapping("values", values))
    names = [_names(group, accepted) for group in NAMED]
    known = {row.key: row for row in scene_parameters(*names)}
    checked: dict[str, Any] = {}
    for key, value in accepted.items():
        if not isinstance(key, str):
            raise SceneError(f"{brief(key)}: a key must be a string; give one like 'cable.length'")
        if key in known:
            checked[key] = check_value(known[key], value)
        elif not is_node_key(key):
            raise unknown_key(key, value, known)
    given = dict(zip(NAMED, names, strict=True))
    parents = {name: checked.get(f"branches.{name}.from", MAIN) for name in given["branches"]}
    for own, of in _origins(parents, given["cables"]).items():
        checked.setdefault(own, checked.get(of, known[of].default))
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
    changes = without_retired(changes)
    left = dict(values)
    for group in NAMED:
        if f"{group}.names" in changes:
            dropped = set(_names(group, values)) - set(_names(group, changes))
            blocks = tuple(f"{group}.{name}." for name in dropped)
            left = {key: value for key, value in left.items() if not key.startswith(blocks)}
    return {**left, **changes}


def mapping(name: str, values: object) -> dict[str, object]:
    """A copy of a mapping as a dictionary, else TypeError; `name` appears in the error."""
    if not isinstance(values, Mapping):
        raise TypeError(f"{name}: needs a mapping, {{'cable.length': 2.0}}, got {brief(values)}")
    return dict(values)


def _names(group: str, values: Mapping[str, object]) -> Names:
    """The names of a group's blocks, from `<group>.names` in the values."""
    row = next(row for row in scene_parameters() if row.key == f"{group}.names")
    names = check_value(row, values.get(row.key, row.default))
    texts = tuple(str(name) for name in names)  # type: ignore[union-attr]
    check_names(row.key, texts, NAMED[group])
    return texts


PARAMETERS = scene_parameters()
"""All parameters except those of loads, grasps and obstacles, whose keys contain their names."""


def markdown_table() -> str:
    """The parameter table as GitHub markdown, without a trailing newline; a group within a named
    block, `branches.<name>.cable`, is one row.
    """
    lines = ["| parameter | type | default | unit | range | meaning |", "|---|---|---|---|---|---|"]
    for key, members in groupby(placeholder_parameters(), lambda row: row.key.split(".")[:3]):
        row, *more = members
        if more:
            block = type(_block(key[0], key[1]))
            meaning = descriptions(block)[key[2]]  # type: ignore[arg-type]
            lines.append(f"| `{'.'.join(key)}.*` |  |  |  |  | {meaning} |")
        else:
            lines.append(markdown_row(row))
    return "\n".join(lines)


# -- values that are valid one by one but not together --------------------------------------------


def _check(scene: Scene) -> None:
    """Raise SceneError for the first values that are valid one by one but not together."""
    _refuse(references(scene))
    for key, group, of in _groups(scene):
        check_group(key, group, of)
    for rules in (_placement, arrangement, _frames, _load_frames, _topics):
        _refuse(rules(scene))


def _refuse(conflicts: Conflicts) -> None:
    """Raise SceneError for the first of them."""
    for key, value, problem in conflicts:
        raise refusal(key, value, problem)


def _groups(scene: Scene) -> Iterator[tuple[str, Group, Scene]]:
    """The groups that have rules, with their keys, and the scene of the cable that they are of."""
    of = {strand.name: strand.scene for strand in scene.strands}
    for member in fields(scene):
        value = getattr(scene, member.name)
        if isinstance(value, Group):
            every = of.values() if member.name == "hose" else (of[MAIN],)
            yield from ((member.name, value, one) for one in every)
        for one in value if member.name in NAMED else ():
            key = f"{member.name}.{one.name}"
            if isinstance(one, Group):
                yield key, one, of[getattr(one, "on", MAIN)]
            for part in fields(one):
                block = getattr(one, part.name)
                if isinstance(block, Group):
                    yield f"{key}.{part.name}", block, of[one.name]


def check_group(key: str, group: Group, scene: Scene) -> None:
    """Raise SceneError for the first values of a group that are not valid together."""
    for name, problem in group.conflicts(key, scene):
        field, _, index = name.rstrip("]").partition("[")
        value = getattr(group, field)
        raise refusal(f"{key}.{name}", value[int(index)] if index else value, problem)


def _placement(scene: Scene) -> Conflicts:
    """Ends that leave the first or the clamped direction undefined, or that are too far apart."""
    cables: list[tuple[str, Scene | FurtherCable]] = [("", scene)]
    cables += [(f"cables.{one.name}.", one) for one in scene.cables]
    for prefix, of in cables:
        start, end, length = of.start, of.end, of.cable.length
        gap = math.dist(start.position, end.position)
        rigid = all(start.fixed) and all(end.fixed)
        for name, held in (("start", start), ("end", end)):
            if gap == 0.0 and held.clamped and not any(held.tangent):
                what = "gives no direction, since both ends are at the same place"
                yield f"{prefix}{name}.tangent", held.tangent, f"{what}; give a direction"
        first, last = f"{prefix}start.position", f"{prefix}end.position"
        if gap == 0.0 and (scene.initial.shape == "straight" or not rigid):
            what = f"equals {first}, so a straight cable has no direction"
            yield last, end.position, f"{what}; move it or {first} apart"
        if rigid and gap > LARGEST_STRETCH * length and not (start.driven or end.driven):
            what = f"is {gap:g} m from {first}, but the cable is only {length:g} m long"
            cure = f"move the ends together or lengthen {prefix}cable.length"
            yield last, end.position, f"{what}; {cure}"


def _frames(scene: Scene) -> Conflicts:
    """A frame of two end effectors or connectors, or of one and the world."""
    seen = {scene.frame_id: "frame_id"}
    frames = [(name, holder.frame) for name, holder in scene.holder_keys()]
    frames += [(f"connectors.{one.name}", one.frame) for one in scene.connectors]
    for name, frame in frames:
        key = f"{name}.frame"
        if frame and seen.setdefault(frame, key) != key:
            problem = f"is also {seen[frame]}; give the end-effector's own frame"
            yield key, frame, problem


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
        peer = first.setdefault(load.input_topic, load)
        if load.frame != peer.frame:
            what = f"differs from loads.{peer.name}.frame {shown(peer.frame)} of the same topic"
            yield key, load.frame, f"{what}; give both the same"


def _topics(scene: Scene) -> Conflicts:
    """Malformed topic names, and topics read as two types."""
    holders = scene.holder_keys()
    inputs = [(f"{name}.pose_topic", one.pose_topic, one.pose_type) for name, one in holders]
    bodies = scene.obstacles
    inputs += [(f"obstacles.{one.name}.pose_topic", one.pose_topic, "pose") for one in bodies]
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


def check_added(scene: Scene, obstacle: Obstacle) -> None:
    """Raise SceneError for an obstacle that cannot be added to a scene while it is simulated:
    invalid, driven by poses, or of the name of another.
    """
    if not (isinstance(obstacle.name, str) and obstacle.name.isprintable()):
        raise SceneError(f"obstacles: {obstacle.name!r:.60} is no name; give a printable text")
    for row in parameters_of(obstacle, f"obstacles.{obstacle.name}."):
        check_value(row, row.default)
    taken = set(scene.holders) | {one.name for one in scene.bodies}
    named = (scene.branches, scene.cables, scene.connectors)
    taken |= {one.name for group in named for one in group}
    if obstacle.name in taken:
        raise refusal("obstacles", obstacle.name, "is there already; remove it before")
    if obstacle.name in NAMED["obstacles"]:
        raise refusal("obstacles", obstacle.name, "means the cable itself; give another name")
    if obstacle.driven:
        raise SceneError(
            f"obstacles.{obstacle.name}: is moved by Simulator.move_obstacle, not poses"
        )
    check_group(f"obstacles.{obstacle.name}", obstacle, scene)
