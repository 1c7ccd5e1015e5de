"""A recorded run read back: shape over time, values for its colours, and curves to plot."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import arguments, bspline, rotations
from dlo_sim.core.npz import NpzRefused, read_npz
from dlo_sim.core.strain import strain
from dlo_sim.replay.bags import Bag, BagError
from dlo_sim.scene.description import Obstacle, Scene
from dlo_sim.scene.nets import MAIN
from dlo_sim.scene.refusal import Refusal, SceneError, one_line, printable
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import KNOTS
from dlo_sim.session.topics import (
    CONNECTORS,
    CONTACTS,
    CONTROL_POINTS,
    DIAGNOSTICS,
    REACTION,
    resolved,
)
from dlo_sim.simulation import resolution

Array = NDArray[np.float64]

TENSION, CURVATURE = "tension [N]", "curvature [1/m]"
_COLORS = {"tension": TENSION, "curvature": CURVATURE}
_POINTS = 60  # of the centerline of a bag
# Keys of the diagnostics.
_ENERGY, _ERROR = "energy [J]", "error estimate [m]"
_FORCE, _CLEARANCE = "contact force [N]", "clearance [m]"
_LARGEST = float(np.finfo("f4").max)  # a page has 32-bit floats
_SHAPES = {cdr.CUBE: "box", cdr.SPHERE: "sphere", cdr.CYLINDER: "cylinder"}
_LAST = CONTROL_POINTS.removeprefix("~")
# Arrays in an output of `dlo_sim simulate`, the first three in each, and their shapes: digits, and
# letters for numbers that agree.
_ARRAYS = {
    **{"time": "T", "centerline": "Tm3", "control_points": "Tn4"},
    **{"tension": "Tm", "curvature": "Tm", "energy": "T"},
    **{"obstacle_triangles": "k33", "obstacle_of": "k", "obstacle_poses": "Tb7"},
    **{"contact_points": "c3", "contact_forces": "c3", "contact_samples": "c"},
    **{"contact_looks": "l", "contact_total": "l", "contact_clearance": "l"},
}
# The same of each further cable of a net, `a.centerline`, and of connectors, `plug.pose`.
_OF_CABLES = {name: _ARRAYS[name] for name in ("centerline", "control_points", *_COLORS)}
_OF_CONNECTORS = {"pose": "T7", "triangles": "k33"}
_LINE = ".centerline"
_TOUCHING = [name for name in _ARRAYS if name.startswith(("obstacle", "contact"))]
_Values = list[tuple[int, dict[str, str]]]  # stamps [ns], and the values of the diagnostics
_GIVE = "give the scene of that run"
_LONGEST_FORCE = 0.15  # line of the largest contact force, in extents of the run


class _Recorded:
    """The names of all these arrays."""

    def __contains__(self, name: object) -> bool:
        of, _, what = str(name).rpartition(".")
        return what in (_OF_CABLES | _OF_CONNECTORS if of else _ARRAYS)


class RunError(Refusal):
    """A file that is refused: one line that names it, what is wrong and the cure."""


@dataclass(frozen=True)
class Curve:
    """Quantities over time: a title with the unit, time [s] (k,), a name for each row of values."""

    title: str
    time: Array
    values: dict[str, Array]

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of a plot: the range of the values, a little more, and at least
        some 1e-6 of their size, so that a constant with its round-off looks constant.
        """
        numbers = np.concatenate(list(self.values.values()))
        numbers = np.clip(numbers[np.isfinite(numbers)], -_LARGEST, _LARGEST)
        low, high = (numbers.min(), numbers.max()) if numbers.size else (0.0, 0.0)
        size = max(abs(low), abs(high))
        pad = max(0.05 * (high - low), 1e-6 * size) or 1.0
        return float(low - pad), float(high + pad)


@dataclass(frozen=True)
class Body:
    """An obstacle: triangles of its surface in its frame [m], shape (k, 3, 3), and its poses,
    position [m] and quaternion x, y, z, w, shape (T, 7), NaN where it is not there.
    """

    triangles: Array
    poses: Array

    def at(self, frame: int) -> Array:
        """Its triangles in the world [m], shape (k, 3, 3); none where it is not there."""
        pose = self.poses[frame]
        if not np.isfinite(pose).all():
            return np.zeros((0, 3, 3))
        return rotations.rotate(pose[3:], self.triangles) + pose[:3]


@dataclass(frozen=True)
class Cable:
    """A cable of a run: its name, and the attributes of `Run` that are of a cable."""

    name: str
    centerline: Array
    control_points: Array
    colors: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Run:
    """The data of a run that are shown.

    Attributes:
        name: of the file. time: [s], shape (T,).
        others, connectors: further cables of a net, and its connectors; the rest that is of a cable
            is of the main one.
        centerline: points of the cable from start to end [m], shape (T, m, 3).
        control_points: [m], shape (T, n, 3).
        colors: title with the unit -> a value for each point of the centreline, shape (T, m).
        frames: material frames of start and end, quaternions x, y, z, w, shape (T, 2, 4), or None.
        reactions: end -> force on the cable by the end effector [N], shape (T, 3).
        curves: further quantities to plot.
        bodies: obstacles. forces: contact forces on the cable as lines from where they act [m],
            shape (c, 2, 3) each, and looks: which of them is that of each time, shape (T,).
    """

    name: str
    time: Array
    centerline: Array
    control_points: Array
    colors: dict[str, Array] = field(default_factory=dict)
    frames: Array | None = None
    reactions: dict[str, Array] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()
    bodies: tuple[Body, ...] = ()
    forces: tuple[Array, ...] = ()
    looks: NDArray[np.int64] | None = None
    others: tuple[Cable, ...] = ()
    connectors: tuple[Body, ...] = ()

    @property
    def cables(self) -> tuple[Cable, ...]:
        """All cables, the main one first."""
        return Cable(MAIN, self.centerline, self.control_points, self.colors), *self.others

    def range_of(self, title: str) -> tuple[float, float]:
        """Least and largest value of a colour over all cables."""
        rows = [cable.colors[title] for cable in self.cables if title in cable.colors]
        return float(min(map(np.min, rows))), float(max(map(np.max, rows)))

    @property
    def extent(self) -> tuple[Array, Array]:
        """Lower and upper corner of the box in which all cables and connectors are [m]."""
        points = [cable.centerline.reshape(-1, 3) for cable in self.cables]
        for body in (one for one in self.connectors if len(one.triangles)):
            reach = np.linalg.norm(body.triangles, axis=-1).max()
            points += [body.poses[:, :3] - reach, body.poses[:, :3] + reach]
        found = np.concatenate(points)
        return np.nanmin(found, axis=0), np.nanmax(found, axis=0)

    def forces_at(self, frame: int) -> Array:
        """The lines of `forces` at one time, shape (c, 2, 3)."""
        return np.zeros((0, 2, 3)) if self.looks is None else self.forces[self.looks[frame]]

    @property
    def plots(self) -> tuple[Curve, ...]:
        """All plots over time: position of the end, reactions, largest colour values, `curves`."""
        axes = dict(zip("xyz", self.centerline[:, -1].T, strict=True))
        found = [Curve("end of the cable [m]", self.time, axes)]
        for end, force in self.reactions.items():
            title = f"force on the cable at its {end} [N]"
            found.append(Curve(title, self.time, dict(zip("xyz", force.T, strict=True))))
        for title, values in self.colors.items():
            rows = {"largest": values.max(axis=1)}
            if self.others:
                of = ((one.name, one.colors.get(title)) for one in self.cables)
                rows = {name: one.max(axis=1) for name, one in of if one is not None}
            found.append(Curve(f"largest {title}", self.time, rows))
        return (*found, *self.curves)


def read_run(path: Path, scene: Scene | None = None, node: str = "") -> Run:
    """Read a recording of `dlo_sim simulate` (npz), or a bag with control points.

    Args:
        path: file or folder.
        scene: for a bag, gives the knots and the tension.
        node: for a bag with several cables, selects one.

    Raises:
        RunError: it contains no run, or none of this scene or node.
    """
    return read_bag(path, scene, node) if path.is_dir() else read_recording(path)


def read_recording(path: Path) -> Run:
    """Read an output of `dlo_sim simulate`.

    Raises:
        RunError: it is not such a file.
    """
    try:
        found = read_npz(path, _Recorded())
    except NpzRefused as refused:
        raise RunError(
            f"{path}: {refused}; give an npz of dlo_sim simulate, or a bag's folder"
        ) from None
    for name in ("time", "control_points", "centerline"):
        if name not in found or not found[name].size:
            raise RunError(f"{path}: has no {name} of a run; make it with dlo_sim simulate")
    try:
        found |= _checked(found)
    except (TypeError, ValueError) as refusal:
        raise RunError(f"{path}: {refusal}; make it with dlo_sim simulate") from None
    further = [name[: -len(_LINE)] for name in found if name.endswith(_LINE)]
    main, *others = (_cable_of(found, name) for name in ("", *further))
    run = Run(
        name=printable(path.name),
        time=found["time"],
        centerline=main.centerline,
        control_points=main.control_points,
        colors=main.colors,
        others=tuple(others),
        connectors=tuple(
            Body(found[name.replace(".pose", ".triangles")], found[name])
            for name in found
            if name.endswith(".pose")
        ),
    )
    if "energy" in found:
        run = replace(run, curves=(Curve(_ENERGY, run.time, {"energy": found["energy"]}),))
    return _with_contacts(run, found) if all(name in found for name in _TOUCHING) else run


def _cable_of(found: dict[str, Array], name: str) -> Cable:
    """A cable of a recording; the main one has no name."""
    of = f"{name}." if name else ""
    shown = {title: found[of + key] for key, title in _COLORS.items() if of + key in found}
    points = found[f"{of}control_points"][:, :, :3]
    return Cable(printable(name) or MAIN, found[f"{of}centerline"], points, shown)


def _with_contacts(run: Run, found: dict[str, Array]) -> Run:
    """With the obstacles, and with forces and clearance where the contacts were computed."""
    number, poses, clearance = (
        found[name] for name in ("obstacle_of", "obstacle_poses", "contact_clearance")
    )
    triangles = found["obstacle_triangles"]
    bodies = [Body(triangles[number == k], poses[:, k]) for k in range(poses.shape[1])]
    known, near = found["contact_looks"], np.isfinite(clearance)
    time = run.time[known.astype(int)]
    curves = [*run.curves, Curve(_FORCE, time, {"total": found["contact_total"]})]
    if near.any():
        curves.append(Curve(_CLEARANCE, time[near], {"least": clearance[near]}))
    points, forces = found["contact_points"], found["contact_forces"]
    low, high = run.extent
    extent = float((high - low).max())
    sizes = np.linalg.norm(forces, axis=1)
    scale = _LONGEST_FORCE * extent / max(float(sizes.max(initial=0.0)), 1e-300)
    lines = np.stack([points, points + scale * forces], axis=1)
    return replace(
        run,
        curves=tuple(curves),
        bodies=tuple(bodies),
        forces=tuple(lines[found["contact_samples"] == sample] for sample in known),
        looks=np.searchsorted(known, np.arange(len(run.time)), side="right") - 1,
    )


def _checked(found: dict[str, Array]) -> dict[str, Array]:
    """The arrays of a run as floats.

    Raises:
        TypeError, ValueError: values are not finite or exceed 32-bit floats, shapes do not match,
            or times do not increase.
    """
    sizes: dict[str, int] = {}
    checked = {}
    shapes: dict[str, Iterable[str]] = {n: shape for n, shape in _ARRAYS.items() if n in found}
    for of in dict.fromkeys(name.rpartition(".")[0] for name in found if "." in name):
        own = _OF_CONNECTORS if f"{of}.pose" in found else _OF_CABLES
        for name, shape in own.items():
            if f"{of}.{name}" in found:
                shapes[f"{of}.{name}"] = [x if x in "T347" else f"{x} of {of}" for x in shape]
            elif name not in _COLORS:
                raise ValueError(f"{printable(of)}: has no {name}")
    for name, letters in shapes.items():
        given = found[name]
        if name == "contact_clearance":  # infinite where the cable is far from itself
            given = np.where(given == np.inf, 0.0, given)
        wanted = tuple(int(one) if one.isdigit() else sizes.get(one) for one in letters)
        checked[name] = arguments.numbers(name, given, wanted)
        sizes |= dict(zip(letters, checked[name].shape, strict=True))
        if np.abs(checked[name]).max(initial=0.0) > _LARGEST:
            most = np.abs(checked[name]).max()
            raise ValueError(f"{name}: needs numbers up to {_LARGEST:g}, got {most}")
    time, known = checked["time"], checked.get("contact_looks", np.zeros(1))
    if not np.all(np.diff(time) > 0.0):
        raise ValueError(f"time: needs to rise, got {arguments.given(time.tolist())}")
    rises = np.isin(known, np.arange(len(time))).all() and np.all(np.diff(known) > 0.0)
    if not (rises and len(known) and known[0] == 0.0):
        raise ValueError(
            f"contact_looks: needs rising numbers of the {len(time)} samples from 0 on, got "
            + arguments.given(known.tolist())
        )
    checked.pop("contact_clearance", None)
    return checked


def read_bag(
    path: Path, scene: Scene | None = None, node: str = "", origin_ns: int | None = None
) -> Run:
    """Read the outputs of a node or a replay from a bag.

    Without a scene the knots are those of the diagnostics, or of equal spans.

    Args:
        origin_ns: stamp of time zero [ns]; default: the first.

    Raises:
        RunError: as `read_run`.
    """
    try:
        bag = Bag(path)
        node = node or _only_node(path, bag)
        states, forces, curves, told = _read(bag, node, origin_ns)
        topics = {MAIN: f"{node}{_LAST}", **_further(bag, node)}
        others = {one: _states(bag, topics[one]) for one in topics if one != MAIN}
        shown, connectors = (_markers(bag, f"{node}{one[1:]}") for one in (CONTACTS, CONNECTORS))
    except (BagError, cdr.DecodeError) as error:
        raise RunError(str(error)) from None
    stamps = np.array(sorted(states))
    strands = _strands(path, scene, others)
    main, *further = (
        _in_bag(f"{path}: {topics[name]}", name, stamps, poses, strands[name], told)
        for name, poses in {MAIN: states, **others}.items()
    )
    origin = stamps[0] if origin_ns is None else origin_ns
    run = Run(
        name=printable(path.resolve().name),
        time=(stamps - origin) * 1e-9,
        centerline=main.centerline,
        control_points=main.control_points,
        colors=main.colors,
        others=tuple(further),
        connectors=_surroundings(stamps, connectors).get("bodies", ()),
        frames=np.array([states[stamp] for stamp in stamps])[:, [0, -1], 3:],
        # A missing reaction is replaced by the previous one, or the first if there is none.
        reactions={end: _at(stamps, found) for end, found in forces.items() if found},
        curves=curves,
        **_surroundings(stamps, shown),
    )
    _check_shown(path, run)
    return run


def _strands(
    path: Path, scene: Scene | None, others: Mapping[str, object]
) -> dict[str, tuple[Scene, Array] | None]:
    """Cable in a bag -> its own scene and knots, if a scene is given."""
    from dlo_sim.simulation.build_model import knots_of  # imports the compiler

    if scene is None:
        return dict.fromkeys((MAIN, *others))
    known, _ = resolution.resolved(scene)
    knots = knots_of(known)
    found = {strand.name: (strand.scene, knots[strand.name]) for strand in known.strands}
    if found.keys() != {MAIN, *others}:
        there = ", ".join((MAIN, *others))
        raise RunError(f"{path}: has the cables {there}, the scene {', '.join(found)}; {_GIVE}")
    return dict(found)


def _in_bag(
    where: str,
    name: str,
    stamps: NDArray[np.int64],
    states: dict[int, Array],
    known: tuple[Scene, Array] | None,
    told: _Values,
) -> Cable:
    """A cable from its states by their stamps."""
    poses = _at(stamps, states)
    if poses.shape[1] < bspline.ACTIVE:
        raise RunError(
            f"{where} holds {poses.shape[1]} control points, a cable has "
            f"{bspline.ACTIVE} or more; give a bag of a run"
        )
    knots = _knots(told, name, poses.shape[1]) if known is None else known[1]
    if len(knots) != poses.shape[1] + bspline.ACTIVE:
        number = len(knots) - bspline.ACTIVE
        raise RunError(f"{where} has {poses.shape[1]} control points, the scene {number}; {_GIVE}")
    u = np.linspace(0.0, knots[-1], _POINTS)
    points = poses[:, :, :3]
    good = np.all(np.abs(poses) <= _LARGEST, axis=(1, 2))
    if not good.all():
        at = (stamps[np.argmin(good)] - stamps[0]) * 1e-9
        raise RunError(
            f"{where}: the message {at:g} s after the first is not finite; "
            "give a bag of a run that went well"
        )
    shape = strain(knots, u)
    with np.errstate(all="ignore"):  # points that coincide or are far apart; refused later
        colors = {CURVATURE: shape.curvature(points)}
        if known is not None and not known[0].without_tension:
            cable = known[0].cable
            tension = shape.tension(points, cable.EA, cable.EI)
            colors = {TENSION: tension, **colors}
    line = bspline.evaluate(np.eye(len(knots) - bspline.ACTIVE), knots, u) @ points
    return Cable(name, line, points, colors)


def _check_shown(path: Path, run: Run) -> None:
    """Refuse a run with values that are undefined or exceed 32-bit floats."""
    shown = [(t, run.time, values) for one in run.cables for t, values in one.colors.items()]
    shown += [(f"force at the {end} [N]", run.time, force) for end, force in run.reactions.items()]
    shown += [(one.title, one.time, rows) for one in run.curves for rows in one.values.values()]
    for title, time, values in shown:
        good = np.abs(values.reshape(len(time), -1)) <= _LARGEST
        if not good.all():
            row = int(np.argmin(good.all(axis=1)))
            bad = values.reshape(len(time), -1)[row][~good[row]][0]
            raise RunError(
                f"{path}: {title} is {bad:g} at {time[row]:g} s, which cannot be shown; give a bag "
                "of a run that went well"
            )


def _only_node(path: Path, bag: Bag) -> str:
    nodes = sorted(
        topic.removesuffix(_LAST)
        for topic, kinds in bag.topics.items()
        if cdr.POSE_ARRAY in kinds and topic.endswith(_LAST)
    )
    nodes = [one for one in nodes if one.rpartition("/")[0].rpartition("/")[0] not in nodes]
    if not nodes:
        raise RunError(
            f"{path}: holds no control points (PoseArray, such as {resolved(CONTROL_POINTS)}); "
            "give what dlo_sim replay --output or a recording of the node has written"
        )
    if len(nodes) > 1:
        raise RunError(f"{path}: holds several cables; give --node with one of {', '.join(nodes)}")
    return nodes[0]


def _read(
    bag: Bag, node: str, origin_ns: int | None
) -> tuple[dict[int, Array], dict[str, dict[int, Array]], tuple[Curve, ...], _Values]:
    """Poses and forces by their stamps, and curves and values from the diagnostics."""
    poses = f"{node}{_LAST}"
    before, _, after = f"{node}{REACTION.removeprefix('~')}".partition("{}")
    ends = {
        topic: topic.removeprefix(before).removesuffix(after)
        for topic in bag.topics
        if topic.startswith(before) and topic.endswith(after)
    }
    wanted = {DIAGNOSTICS: cdr.DIAGNOSTIC_ARRAY, **dict.fromkeys(ends, cdr.WRENCH_STAMPED)}
    states = _states(bag, poses)
    forces: dict[str, dict[int, Array]] = {end: {} for end in ends.values()}
    told: list[tuple[int, dict[str, str]]] = []
    for message in bag.messages({t: k for t, k in wanted.items() if t in bag.topics}):
        if message.topic in ends:
            wrench = cdr.decode(cdr.WRENCH_STAMPED, message.data)
            forces[ends[message.topic]][wrench.stamp_ns] = np.array(wrench.values[:3])
        else:
            stamp_ns, statuses = cdr.decode_diagnostic_array(message.data)
            mine = [dict(s.values) for s in statuses if s.name == f"{node}: session"]
            told += [(stamp_ns, values) for values in mine]
    origin = min(states) if origin_ns is None else origin_ns
    return states, forces, tuple(_told(told, origin)), told


def _states(bag: Bag, topic: str) -> dict[int, Array]:
    """Poses of the control points of a cable by their stamps."""
    states: dict[int, Array] = {}
    for message in bag.messages({topic: cdr.POSE_ARRAY}):
        state = cdr.decode_pose_array(message.data)
        states[state.stamp_ns] = state.rows
    if len({len(rows) for rows in states.values()}) != 1:
        raise RunError(
            f"{bag.path}: {topic} holds {'several cables' if states else 'no message'}; give a bag "
            "of one run"
        )
    return states


def _further(bag: Bag, node: str) -> dict[str, str]:
    """Name of each further cable of a net, and its topic below the node."""
    found = {}
    for topic in sorted(bag.topics):
        _, is_own, rest = topic.partition(f"{node}/")
        kind, _, name = rest.removesuffix(_LAST).partition("/")
        if is_own and rest.endswith(_LAST) and kind in ("branches", "cables") and "/" not in name:
            found[name] = topic
    return found


def _markers(bag: Bag, topic: str) -> dict[int, Any]:
    """The messages on a topic of markers by their stamps."""
    if topic not in bag.topics:
        return {}
    found = {}
    for message in bag.messages({topic: cdr.MARKER_ARRAY}):
        markers = cdr.read(cdr.MARKER_ARRAY, message.data).markers
        if markers:
            found[cdr.head(markers[0].header)[0]] = markers
    return found


def _surroundings(stamps: NDArray[np.int64], shown: dict[int, Any]) -> dict[str, Any]:
    """Fields of a run from the messages on ~/contacts; `bodies` also of those on ~/connectors."""
    from dlo_sim.simulation.obstacles import surface  # imports the compiler

    known = np.array(sorted(shown))
    if not known.size:
        return {}
    looks = np.clip(np.searchsorted(known, stamps, side="right") - 1, 0, None)
    forces: list[Array] = []
    poses: dict[Any, dict[int, Any]] = {}
    for look, stamp in enumerate(known):
        lines = [m for m in shown[stamp] if m.type == cdr.LINE_LIST]
        points = [(p.x, p.y, p.z) for m in lines for p in m.points]
        forces.append(np.reshape(points, (-1, 2, 3)).astype(float))
        for m in shown[stamp]:
            if m.type in (*_SHAPES, cdr.TRIANGLE_LIST, cdr.MESH_RESOURCE):
                p, q, s = m.pose.position, m.pose.orientation, m.scale
                corners = tuple((c.x, c.y, c.z) for c in m.points)
                shown_as = corners or m.mesh_resource
                there = poses.setdefault((m.id, m.type, (s.x, s.y, s.z), shown_as), {})
                there[look] = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    bodies = []
    for (_, kind, size, corners), there in poses.items():
        rows = np.full((len(known), 7), np.nan)
        rows[list(there)] = list(there.values())
        if kind == cdr.TRIANGLE_LIST:
            triangles = np.reshape(corners, (-1, 3, 3)).astype(float)
        elif kind == cdr.MESH_RESOURCE:
            mesh = Obstacle("", "mesh", mesh=corners, mesh_scale=size[0])
            try:
                triangles = surface(mesh)
            except SceneError:
                warnings.warn(
                    f"{CONTACTS}: {one_line(corners)} is no mesh here; this obstacle is not drawn",
                    stacklevel=2,
                )
                continue
        else:
            triangles = surface(Obstacle("", _SHAPES[kind], size))
        bodies.append(Body(triangles, rows[looks]))
    return {"bodies": tuple(bodies), "forces": tuple(forces), "looks": looks}


def _told(told: _Values, origin_ns: int) -> list[Curve]:
    """Curves of the diagnostics."""
    curves = []
    keys = {_ENERGY: "energy", _ERROR: "error", _FORCE: "total", _CLEARANCE: "least"}
    for key, name in keys.items():
        rows = [(stamp, values.get(key, "")) for stamp, values in told]
        numbers = [(stamp, float(text)) for stamp, text in rows if _is_number(text)]
        if len(numbers) > 1:
            time, values = np.array(numbers).T
            curves.append(Curve(key, (time - origin_ns) * 1e-9, {name: values}))
    return curves


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _knots(told: _Values, name: str, n: int) -> Array:
    """Knots of a cable of length 1 with n control points, from the diagnostics; else of equal
    spans.
    """
    for _, values in told:
        words = values.get(f"knots of {name}", "").split()
        if len(words) == n - bspline.ACTIVE and all(map(_is_number, words)):
            inside = np.clip(np.sort(np.array(words, dtype=float)), 0.0, 1.0)
            return np.pad(inside, bspline.ACTIVE, constant_values=(0.0, 1.0))
        words = values.get(KNOTS, "").split()
        if len(words) == 3 and all(_is_number(word) and float(word) >= 0.0 for word in words):
            start, end, reach = map(float, words)
            density = bspline.Grading(start, end, reach) if reach else bspline.EQUAL
            return bspline.clamped_knots(n, 1.0, density)
    return bspline.clamped_knots(n, 1.0)


def _at(stamps: NDArray[np.int64], found: dict[int, Array]) -> Array:
    """The latest of the values `found` (by stamp) at each of `stamps`."""
    known = np.array(sorted(found))
    index = np.clip(np.searchsorted(known, stamps, side="right") - 1, 0, None)
    return np.array([found[stamp] for stamp in known])[index]
