"""What a scene says of nets: branches, further cables, the joints between them, and connectors.

A strand is one spline: the main cable, a branch or a further cable. A scene with more than the main
cable, with a joint or a connector, is a net. `strands_of` takes it apart into scenes of one cable.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

from dlo_sim.scene.cable import Cable
from dlo_sim.scene.holders import JOINTS, End, Holder, joint_conflicts
from dlo_sim.scene.obstacles import Obstacle
from dlo_sim.scene.parameter import ORIGIN, Group, Names, Vector, off_unit, parameter
from dlo_sim.scene.refusal import Rules, nearest, refusal, shown

MAIN = "cable"  # name of the main cable
Conflicts = Iterator[tuple[str, object, str]]
LARGEST_STRETCH = 2.0  # distance of held places, in lengths between, that is surely a mistake


@dataclass(frozen=True)
class Spline(Group):
    """How the spline of a branch or further cable is computed; all else is as of the main cable.

    Parameters:
        control_points: Number of its control points, as discretization.control_points.
    """

    control_points: int = parameter(0, "", (0, 2000))

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Too few, or too few beside what `discretization` asks for."""
        for name, problem in scene.discretization.conflicts("discretization", scene):
            if name != "control_points":
                value = shown(getattr(scene.discretization, name))
                problem = f"do not go with discretization.{name}, of which {value} {problem}"
            yield "control_points", problem


@dataclass(frozen=True)
class Branch(Group):
    """A cable that begins at a place of another one, to which a joint holds it.

    Parameters:
        from: What it begins at: cable (the main one), or the name of a branch or further cable.
        at: Where on that: 0 at start, 1 at end.
        direction: Direction in which it leaves when all cables are straight and untwisted: a unit
            vector in the frame of the start end effector of the main cable; zeros = along the cable
            that it begins at.
        joint: rigid: carries position, direction and roll over, at the angles that the branch has
            when all cables are straight; elastic: carries the position over, and direction and roll
            by a stiffness; hinged: the position alone.
        joint_stiffness: Stiffness of an elastic joint.
        cable: Material and length, as `cable.*`; the default of each is the value of what it begins
            at.
        end: Its far end, as `end.*`; free by default.
    """

    name: str
    from_: str = parameter(MAIN, read_only=True)
    at: float = parameter(0.5, "", (0.0, 1.0), read_only=True)
    direction: Vector = parameter(ORIGIN, "", (-1.0, 1.0))
    joint: str = parameter("rigid", choices=JOINTS, read_only=True)
    joint_stiffness: float = parameter(0.0, "N m/rad", (0.0, 1.0e9))
    cable: Cable = Cable()
    discretization: Spline = Spline()
    end: End = End(fixed=(False, False, False))

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A direction that is none, and a stiffness that is missing or does nothing."""
        unit = off_unit(self.direction) if any(self.direction) else None
        if unit:
            zeros = "or zeros to go on along the cable that it begins at"
            yield "direction", f"is not a unit vector; give {shown(unit)}, {zeros}"
        yield from joint_conflicts(self, key)


@dataclass(frozen=True)
class FurtherCable:
    """A cable beside the main one, with ends of its own.

    Parameters:
        cable: Material and length, as `cable.*`; the default of each is the value of the main
            cable.
        start: Its start, as `start.*`.
        end: Its end, as `end.*`.
    """

    name: str
    cable: Cable = Cable()
    discretization: Spline = Spline()
    start: End = End()
    end: End = End(position=(1.0, 0.0, 0.0), fixed=(False, False, False))


@dataclass(frozen=True)
class Connector(Group):
    """A rigid body on a cable: a plug, a tool, a payload.

    Its axes: x along the cable, from start towards end, y and z as those of the start end effector
    of the main cable carried along the straight cables. Its origin is the place on the cable.

    Parameters:
        on: The cable that it is on: cable (the main one), or the name of a branch or further cable.
        at: Where on that: 0 at start, 1 at end.
        mass: Its mass, which has to be given.
        center: Its centre of mass, in its axes.
        inertia: Moments of inertia about its x, y and z axes through the centre of mass, which have
            to be given, since it turns.
        joint: rigid: it turns with the cable; hinged: it hangs on its origin.
        shape: Shape with which it touches obstacles and cables, centred at `center`; none = it
            touches nothing.
        size: Extent along its x, y and z axes. A sphere has the diameter x; a capsule about its x
            axis has the length x, with its caps, and the diameter y.
        frame: Name of its frame in tf2; empty = none.
    """

    name: str
    on: str = parameter(MAIN, read_only=True)
    at: float = parameter(1.0, "", (0.0, 1.0), read_only=True)
    mass: float = parameter(0.0, "kg", (0.0, 1.0e4))
    center: Vector = parameter(ORIGIN, "m", (-1.0e3, 1.0e3))
    inertia: Vector = parameter(ORIGIN, "kg m^2", (0.0, 1.0e9))
    joint: str = parameter("rigid", choices=("rigid", "hinged"), read_only=True)
    shape: str = parameter("none", choices=("none", "sphere", "capsule", "box"))
    size: Vector = parameter(ORIGIN, "m", (0.0, 1.0e3))
    frame: str = parameter("", read_only=True)

    @property
    def body(self) -> Obstacle:
        """Its shape, placed in its frame."""
        x, y, _ = self.size
        if self.shape != "capsule":
            return Obstacle(self.name, self.shape, self.size, self.center)
        half = math.sqrt(0.5)  # turns z, the axis of that of an obstacle, to x
        return Obstacle(self.name, "capsule", (y, y, x), self.center, (0.0, half, 0.0, half))

    def conflicts(self, key: str, scene: Any) -> Rules:
        """No mass, no inertia or that of no body, no extent."""
        if self.mass == 0.0:
            yield "mass", "kg is no mass; give that of the connector, above 0"
        largest, others = max(self.inertia), sum(self.inertia) - max(self.inertia)
        if min(self.inertia) == 0.0:
            what = "leaves an axis without inertia, about which it may turn"
            yield "inertia", f"kg m^2 {what}; give three moments above 0"
        if largest > others * (1.0 + 1e-9):
            what = f"kg m^2 is of no body, since {largest:g} exceeds the sum of the other two"
            yield "inertia", f"{what}; give each at most that of the other two together"
        used = {"none": 0, "sphere": 1, "capsule": 2, "box": 3}[self.shape]
        if not all(self.size[:used]):
            yield "size", f"has a zero that a {self.shape} needs; give its extents"
        if self.shape == "none" and any(self.size):
            yield "size", f"m does nothing without a shape; give {key}.shape, or remove it"
        if self.frame == scene.frame_id:
            yield "frame", "is the world frame, frame_id; give a frame of its own"


@dataclass(frozen=True)
class Joint:
    """A joint: holds an end of a strand at a place of a strand.

    Attributes:
        key: of the block of parameters that says so: `branches.a`, or of a joined end, `end`.
        strand: name of the strand that ends or begins here. end: where on that, 0.0 or 1.0.
        other: name of the strand that it is held to. at: where on that, 0 to 1.
        kind: rigid, hinged or elastic. stiffness: of an elastic one [N m/rad].
        loop: whether it is of a joined end, not of the start of a branch.
    """

    key: str
    strand: str
    end: float
    other: str
    at: float
    kind: str
    stiffness: float
    loop: bool

    @property
    def places(self) -> tuple[tuple[str, float], tuple[str, float]]:
        """Both places: name of a strand, and where on it, 0 to 1."""
        return (self.strand, self.end), (self.other, self.at)


@dataclass(frozen=True)
class Strand:
    """One cable of a net.

    Attributes:
        name: `cable` for the main one.
        scene: the `Scene` of this cable alone: with its loads and grasps, as if on the main cable,
            without joints; all else as in the net. The start of a branch is free there, and
            its tangent the direction in which it leaves. Where nothing holds an end, its position
            is that with all cables straight.
        key: of its block of parameters, `branches.a`; empty for the main cable.
        parent: name of the strand that a branch begins at; empty if it begins at none.
        at, direction, joint, joint_stiffness: as those of the branch.
    """

    name: str
    scene: Any
    key: str = ""
    parent: str = ""
    at: float = 0.0
    direction: Vector = ORIGIN
    joint: str = ""
    joint_stiffness: float = 0.0

    def key_of(self, name: str) -> str:
        """Key of one of its parameters, or groups of them: `branches.a.cable`."""
        return f"{self.key}.{name}" if self.key else name

    def holder(self, end: str) -> str:
        """Name of its `start` or `end` in `Scene.holders`."""
        return f"{self.name}.{end}" if self.key else end


def in_order(parents: Mapping[str, str], roots: Names) -> Names:
    """Branches, those that others begin at first; SceneError if one begins at none of the roots.

    Args:
        parents: branch -> what it begins at. roots: names of the strands that are no branches.
    """
    ordered: list[str] = []
    for name, parent in parents.items():
        key, path = f"branches.{name}.from", [name]
        if parent == name:
            raise refusal(key, parent, f"is the branch itself; give {MAIN}, or another one")
        if parent not in parents and parent not in roots:
            raise refusal(key, parent, _unknown(parent, (*roots, *parents), name))
        while path[-1] in parents:
            path.append(parents[path[-1]])
            if path[-1] == name:
                circle = " from ".join(path)
                cure = f"let one of them begin at {MAIN}, and join an end to close a loop"
                raise refusal(key, parent, f"makes a circle ({circle}); {cure}")
            if path.count(path[-1]) > 1:
                break  # a circle of others, which is refused there
        ordered += [one for one in reversed(path) if one in parents and one not in ordered]
    return tuple(ordered)


def root_of(name: str, parents: Mapping[str, str]) -> str:
    """The strand without a parent from which one branches off, by way of others."""
    while name in parents:
        name = parents[name]
    return name


def _unknown(name: str, known: Names, itself: str = "") -> str:
    """What is wrong with a name that is of no strand."""
    there = [one for one in known if one != itself]
    return f"is no cable here; give one of {', '.join(there)}{nearest(name, there)}"


def strands_of(scene: Any) -> tuple[Strand, ...]:
    """The main cable and its branches, then further cables, then their branches; each branch comes
    after what it begins at.
    """
    if not scene.is_net:
        return (Strand(MAIN, scene),)
    placed = {MAIN: Strand(MAIN, _alone(scene, MAIN, scene, scene.start))}
    for one in scene.cables:
        key = f"cables.{one.name}"
        placed[one.name] = Strand(one.name, _alone(scene, one.name, one, one.start), key)
    branches = {one.name: one for one in scene.branches}
    parents = {one.name: one.from_ for one in scene.branches}
    ordered = in_order(parents, tuple(placed))
    for name in ordered:
        one = branches[name]
        parent = placed[one.from_].scene
        along = _along(parent)
        place = _moved(parent.start, one.at * parent.cable.length, along)
        tangent = one.direction if any(one.direction) else along
        start = End(position=place, fixed=(False, False, False), tangent=tangent)
        joint = (one.from_, one.at, one.direction, one.joint, one.joint_stiffness)
        own = _alone(scene, name, one, start)
        placed[name] = Strand(name, own, f"branches.{name}", *joint)
    of_main = [name for name in ordered if root_of(name, parents) == MAIN]
    names = dict.fromkeys((MAIN, *of_main, *placed))
    return tuple(placed[name] for name in names)


def _alone(scene: Any, name: str, of: Any, start: End) -> Any:
    """The scene of one cable of a net, which has a cable, a discretization and an end."""
    apart: dict[str, Any] = {
        "joined": "",
        "joined_at": 0.0,
        "joint": "rigid",
        "joint_stiffness": 0.0,
    }
    points = of.discretization.control_points
    own = replace(
        scene,
        cable=replace(of.cable, bore=scene.hose.bore),
        discretization=replace(scene.discretization, control_points=points),
        start=replace(start, **apart),
        end=replace(of.end, **apart),
        loads=tuple(replace(one, on=MAIN) for one in scene.loads if one.on == name),
        grasps=tuple(replace(one, on=MAIN) for one in scene.grasps if one.on == name),
        branches=(),
        cables=(),
        connectors=(),
    )
    if name == MAIN or own.end.held:
        return own
    far = _moved(start, own.cable.length, _along(own))
    return replace(own, end=replace(own.end, position=far, offset=ORIGIN))


def _along(scene: Any) -> Vector:
    """Unit vector along a single cable that is straight."""
    x, y, z = scene.start.tangent
    if not any((x, y, z)):
        pairs = zip(scene.start.position, scene.end.position, strict=True)
        x, y, z = (b - a for a, b in pairs)
    size = math.hypot(x, y, z)
    return (x / size, y / size, z / size) if size else (1.0, 0.0, 0.0)


def _moved(start: End, by: float, along: Vector) -> Vector:
    """A place on a straight cable [m]."""
    x, y, z = (a + b + by * c for a, b, c in zip(start.position, start.offset, along, strict=True))
    return x, y, z


def joints_of(scene: Any) -> tuple[Joint, ...]:
    """The joints at the starts of branches, then those of joined ends."""
    joints = [
        Joint(one.key, one.name, 0.0, one.parent, one.at, one.joint, one.joint_stiffness, False)
        for one in scene.strands
        if one.parent
    ]
    for name, key, place, end in ends_of(scene):
        if end.joined:
            to = (end.joined, end.joined_at, end.joint, end.joint_stiffness)
            joints.append(Joint(key, name, place, *to, True))
    return tuple(joints)


def ends_of(scene: Any) -> Iterator[tuple[str, str, float, End]]:
    """Ends that have a block of parameters: name of the strand, key, where on it, and the end."""
    yield from ((MAIN, "start", 0.0, scene.start), (MAIN, "end", 1.0, scene.end))
    for branch in scene.branches:
        yield branch.name, f"branches.{branch.name}.end", 1.0, branch.end
    for one in scene.cables:
        yield one.name, f"cables.{one.name}.start", 0.0, one.start
        yield one.name, f"cables.{one.name}.end", 1.0, one.end


# -- values that are valid one by one but not together --------------------------------------------


def references(scene: Any) -> Conflicts:
    """Names that stand for two things, or for no cable, and what nets have not."""
    seen: dict[str, str] = {}
    for group in ("grasps", "obstacles", "branches", "cables", "connectors"):
        for one in getattr(scene, group):
            other = seen.setdefault(one.name, group)
            if other != group:
                problem = f"is a name in {other}.names too; rename one of them"
                yield f"{group}.names", one.name, problem
    if scene.is_net and scene.measured.type != "none":
        problem = "corrects a single cable, not one of a net; give none"
        yield "measured.type", scene.measured.type, problem
    if scene.is_net and scene.discretization.knots == "graded":
        yield "discretization.knots", "graded", "is not available for a net of cables; set uniform"
    known = (MAIN, *(one.name for one in scene.branches), *(one.name for one in scene.cables))
    for group in ("loads", "grasps", "connectors"):
        for one in getattr(scene, group):
            if one.on not in known:
                yield f"{group}.{one.name}.on", one.on, _unknown(one.on, known)
    for name, key, place, end in ends_of(scene):
        if end.joined and end.joined not in known:
            yield f"{key}.joined", end.joined, _unknown(end.joined, known)
        if (end.joined, end.joined_at) == (name, place):
            cure = f"give another place, {1.0 - place:g} for a ring"
            yield f"{key}.joined_at", end.joined_at, f"is this end itself; {cure}"


def arrangement(scene: Any) -> Conflicts:
    """Joints and connectors at one place, joints in clamps, and loops that are too short."""
    seen: dict[object, str] = {}
    for joint in scene.joints:
        other = seen.setdefault(frozenset(joint.places), joint.key)
        if other != joint.key:
            problem = f"is the joint of {other} again; remove one of them"
            yield f"{joint.key}.joined", joint.other, problem
    for one in scene.connectors:
        other = seen.setdefault((one.on, one.at), one.name)
        if other != one.name:
            problem = f"is where connectors.{other} is; give another place, or one body for both"
            yield f"connectors.{one.name}.at", one.at, problem
    held = list(_held_places(scene))
    for joint in scene.joints:
        yield from _clamped(scene, joint, held) if joint.kind != "hinged" else ()
    yield from _too_far(scene, held)


def _held_places(scene: Any) -> Iterator[tuple[str, tuple[str, float], Holder]]:
    """Ends and grasps: their key, the place that they hold (strand, 0 to 1), and what they are."""
    yield from ((key, (name, place), end) for name, key, place, end in ends_of(scene))
    for one in scene.grasps:
        if one.at >= 0.0:  # else it takes the cable where it finds it
            yield f"grasps.{one.name}", (one.on, one.at), one


def _clamped(
    scene: Any, joint: Joint, held: Sequence[tuple[str, tuple[str, float], Holder]]
) -> Conflicts:
    """A joint that holds the direction where a clamp or a jaw does."""
    lengths = {strand.name: strand.scene.cable.length for strand in scene.strands}
    for key, (strand, at), holder in held:
        for own, (on, place) in enumerate(reversed(joint.places)):
            reach = holder.jaw if isinstance(holder, End) else 0.5 * holder.jaw
            away = abs(place - at) * lengths[strand]
            if on != strand or not holder.clamped or (away >= reach and away > 0.0):
                continue
            clamp = f"jaw of {holder.jaw:g} m" if holder.jaw else "clamp"
            where = f"{joint.key}.{'joined_at' if joint.loop else 'at'}", joint.at
            problem = f"is {away:g} m from {key}, whose {clamp} holds the direction there, too"
            if own:  # at the end that is joined, near which only a grasp can hold
                where = f"{key}.at", at
                problem = f"is {away:g} m from the joint of {joint.key}, inside a {clamp}"
            yield *where, f"{problem}; move one of them, or set {joint.key}.joint to hinged"


def _too_far(scene: Any, held: Sequence[tuple[str, tuple[str, float], Holder]]) -> Conflicts:
    """Resting ends that the cables between them cannot reach, even if they are stretched."""
    points = {
        place: (key, [a + b for a, b in zip(one.position, one.offset, strict=True)])
        for key, place, one in held
        if isinstance(one, End) and all(one.fixed) and not one.driven
    }
    lengths = {strand.name: strand.scene.cable.length for strand in scene.strands}
    places = dict.fromkeys([*points, *(place for one in scene.joints for place in one.places)])
    between = {
        (a, b): abs(a[1] - b[1]) * lengths[a[0]] if a[0] == b[0] else math.inf
        for a in places
        for b in places
    }  # least length of cable between two places, with the joints so far
    for joint in (None, *scene.joints):
        if joint:
            p, q = joint.places
            for (a, b), old in list(between.items()):
                by_way = (between[a, p] + between[q, b], between[a, q] + between[p, b])
                between[a, b] = min(old, *by_way)
        for (a, (key, point)), (b, (other, there)) in combinations(points.items(), 2):
            apart, length = math.dist(point, there), between[a, b]
            if apart <= LARGEST_STRETCH * length:
                continue
            what = f"is {apart:g} m from {key}.position, but only {length:g} m of cable lie between"
            cure = "move them together, or lengthen the cables"
            if joint and joint.loop:
                what = f"closes no loop: {other}.position {what}"
                yield f"{joint.key}.joined", joint.other, f"{what}; {cure}"
            yield f"{other}.position", tuple(there), f"{what}; {cure}"
