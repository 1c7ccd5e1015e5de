"""Obstacles from markers on ~/obstacles; config/NODE.md says what a user sees.

A marker is one obstacle, named by its namespace and id. A message takes effect at the stamp of its
first marker. The distance field of a new mesh is made beside the ticks; the mesh takes effect at a
time that depends on the stamps and the sizes of the fields alone (`Surroundings`), so that a replay
gives the same bits.

A new pose is reached at a constant velocity, in the time between the two messages but at most
`LONGEST`: the obstacle is late by as much, and carries along the cable that lies on it. A motion
faster than inputs.max_speed is a jump and is not followed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.one_rotation import Quaternion, Vector, normalized, turn_between
from dlo_sim.scene.description import Obstacle, Scene
from dlo_sim.scene.obstacles import LEAST_SIZE
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Journal, Refused
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.meshes import Field
    from dlo_sim.simulation.simulator import Simulator

LONGEST = 0.2  # [s] for the way to a new pose
ROUND = 1e-3  # relative difference of the diameters of a sphere or cylinder that is allowed
MOST_TRIANGLES = 1000
_CELLS = 32  # of the field of a mesh, along its longest side
_SHAPES = {cdr.CUBE: "box", cdr.SPHERE: "sphere", cdr.CYLINDER: "cylinder"}
_SHAPES[cdr.TRIANGLE_LIST] = "mesh"
_LARGEST, _LONGEST_NAME = 1e6, 255  # [m], characters
_MOST_WAITING = 1000  # messages


class Change(NamedTuple):
    """The change of the obstacle `name` by a marker (a slash at the end: of a namespace; empty: of
    all): present until `lifetime_ns` after the message, 0 = until it is removed, None = no longer.
    """

    name: str
    obstacle: Obstacle | None = None
    lifetime_ns: int = 0


class Markers(NamedTuple):
    """An accepted message: stamp in the time base [ns], and its markers in their order."""

    stamp_ns: int
    changes: tuple[Change, ...]


def change_of(marker: cdr.Marker, radius: float) -> Change:
    """The change by a marker in the world frame, for a cable of this radius [m].

    Its numbers are finite and its quaternion a rotation. Raises Refused (`bad_marker`).
    """
    namespace, _, _ = marker.name.rpartition("/")
    if marker.action == cdr.DELETE_ALL:
        return Change(f"{namespace}/" if namespace else "")
    if len(marker.name) > _LONGEST_NAME or not marker.name.isprintable():
        raise _bad(f"namespace of {len(marker.name)} letters; give a short printable one")
    if marker.action == cdr.DELETE:
        return Change(marker.name)
    if marker.action != cdr.ADD:
        raise _bad(f"action {marker.action}; give ADD (0), DELETE (2) or DELETEALL (3)")
    x, y, z = marker.scale
    shape = _SHAPES.get(marker.kind)
    if shape is None:
        known = "CUBE (1), SPHERE (2), CYLINDER (3) or TRIANGLE_LIST (11)"
        raise _bad(f"type {marker.kind} is no obstacle; give {known}")
    if not LEAST_SIZE <= min(x, y, z) <= max(x, y, z) <= _LARGEST:
        limits = f"of {LEAST_SIZE:g} to {_LARGEST:g} m"
        raise _bad(f"scale {cdr.shown(marker.scale)}; give lengths {limits}")
    if marker.lifetime_ns < 0:
        raise _bad(f"lifetime {marker.lifetime_ns / SECOND:g} s; give 0 for one that stays")
    alike = {"sphere": (x, y, z), "cylinder": (x, y)}.get(shape, (x,))
    if max(alike) - min(alike) > ROUND * max(alike):
        raise _bad(f"scale {cdr.shown(marker.scale)} of a {shape} that is not round; give it round")
    px, py, pz, qx, qy, qz, qw = marker.pose
    turn = normalized((qx, qy, qz, qw))
    mesh, size = "", (x, y, z)
    if shape == "mesh":
        mesh, size = _mesh_of(marker, radius)
    obstacle = Obstacle(marker.name, shape, size, (px, py, pz), turn, mesh=mesh, mesh_cells=_CELLS)
    return Change(marker.name, obstacle, marker.lifetime_ns)


def _mesh_of(marker: cdr.Marker, radius: float) -> tuple[str, Vector]:
    """The triangles of a marker as `Obstacle.mesh`, and their extents [m]."""
    from dlo_sim.simulation.meshes import Grid, box_of, keep_triangles  # imports the compiler

    count = len(marker.points)
    if count % 3 or not 4 <= count // 3 <= MOST_TRIANGLES:
        raise _bad(f"{count} points; give three for each of 4 to {MOST_TRIANGLES} triangles")
    with np.errstate(over="ignore"):
        points = marker.points * marker.scale
    if np.abs(points).max() > _LARGEST:
        raise _bad(f"a corner is more than {_LARGEST:g} m away; check the unit of its lengths")
    try:
        mesh = keep_triangles(points.reshape(-1, 3, 3))
        Grid(points, _CELLS, radius)
    except ValueError as problem:
        raise _bad(str(problem).partition(": ")[2]) from None
    low, high = box_of(points)
    x, y, z = (high - low).tolist()
    return mesh, (x, y, z)


def _bad(detail: str) -> Refused:
    return Refused("bad_marker", detail)


class _Later(NamedTuple):
    """The change of an obstacle when its batch is made, with the stamp of its message."""

    obstacle: Obstacle | None
    stamp_ns: int


class Surroundings(Waiting[Markers]):
    """Messages of markers that wait, and the obstacles that they describe.

    Changes of obstacles without a new mesh take effect at their stamp. New meshes wait, together
    with the removals of their messages, until the batch before them has taken effect, and then for
    the time that is allowed to make their fields (`meshes.time_to_make`), counted from their stamp:
    if that is shorter than inputs.latency, the simulation does not wait. Of one obstacle only the
    newest mesh waits. If the fields are not made in that time, a live session takes them later and
    reports it; a replay waits for them.

    Args:
        scene: gives the limits. journal: counts what is not followed.
        live: whether the session must keep up with the clock.
    """

    def __init__(self, scene: Scene, journal: Journal, live: bool = False) -> None:
        self._note, self._live = journal.event, live
        self._maker: ThreadPoolExecutor | None = None
        self._fields: dict[str, Future[Field]] = {}  # by the mesh
        self._radius = 0.0
        super().__init__(_MOST_WAITING)
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use the limits of this scene."""
        before, self._radius = self._radius, 0.5 * scene.cable.diameter
        self._most, self._max_speed = scene.contact.markers, scene.inputs.max_speed
        self._head_start_ns = round(scene.inputs.least_latency * SECOND)
        if self._radius != before:
            for field in self._fields.values():
                field.cancel()
            self._fields = {}
            self._make(one for one, _ in self._batch.values())

    def clear(self) -> None:
        """Discard all messages and obstacles."""
        super().clear()
        # Name -> obstacle of the last message and the stamp of that [ns].
        self._said: dict[str, tuple[Obstacle, int]] = {}
        # Obstacles after the present step, their targets and the times to them [ns], ends of life.
        self._there: dict[str, Obstacle] = {}
        self._moving: dict[str, tuple[Obstacle, int]] = {}
        self._ends: dict[str, int] = {}
        # Changes with the batch of meshes that is being made, its time [ns]; changes with the next.
        self._batch: dict[str, _Later] = {}
        self._ready_ns: int | None = None
        self._next: dict[str, _Later] = {}
        self._late = False
        self._free_ns = -(1 << 62)  # when all that was to be made before is made
        self._make_no_more()

    def add(self, message: Markers) -> None:
        """Take an accepted message, as `Waiting.add`; a full queue loses its oldest."""
        if len(self._pending) == self._pending.maxlen:
            self._note("full", f"more than {_MOST_WAITING} messages of markers wait")
        super().add(message)
        if not self._next and len(self._fields) <= self._most:  # not while it is paused
            self._make(change.obstacle for change in message.changes)

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next known message, end of a life, or batch; None = none."""
        changes = (super().next_change_ns(), self._ready_ns, *self._ends.values())
        return min((change for change in changes if change is not None), default=None)

    def apply(self, now_ns: int, step_ns: float, simulator: Simulator) -> None:
        """Let the messages up to a time [ns] take effect on a simulator that is at this time."""
        change = self.next_change_ns()
        if change is None or change > now_ns:
            return
        before = {one.name: one for one in simulator.scene.added}
        self._there, self._moving = dict(before), {}
        self._take_batch(now_ns)
        waited = bool(self._next)
        for message in self.due(now_ns):
            if now_ns - message.stamp_ns > step_ns:
                self._note("late", "markers came after the simulation had passed their stamp")
            self._hear(message, before)
        gone = [name for name, end_ns in self._ends.items() if end_ns <= now_ns]
        for name in gone:
            del self._ends[name]
        self._drop(gone)
        self._forget(gone)
        if self._ready_ns is None and self._next:
            self._begin(now_ns, now_ns + self._head_start_ns * waited)
            self._take_batch(now_ns)
        self._replace(before, simulator)
        self._make_no_more()
        for name, (obstacle, way_ns) in self._moving.items():
            self._move(name, obstacle, max(way_ns, step_ns) / SECOND, simulator)

    def _take_batch(self, now_ns: int) -> None:
        """Let the batch take effect if it is time and its fields are made."""
        if self._ready_ns is None or self._ready_ns > now_ns:
            return
        if not self._made:
            self._late = True
            return
        if self._late:
            late = (now_ns - self._ready_ns) / SECOND
            self._note("late", f"meshes of markers were made {late:.3g} s too late")
        for name, (obstacle, stamp_ns) in self._batch.items():
            if obstacle is None:
                self._forget([name])
            else:
                self._say(obstacle, stamp_ns, True)
        self._batch, self._ready_ns, self._late = {}, None, False

    def _hear(self, message: Markers, before: Mapping[str, Obstacle]) -> None:
        """Let a message take effect, or a part of it later."""
        stamp_ns, changes = message
        gone: dict[str, None] = {}
        said: dict[str, Obstacle] = {}
        for name, obstacle, lifetime_ns in changes:
            if obstacle is not None:
                said[name] = obstacle
                self._ends.pop(name, None)
                if lifetime_ns:
                    self._ends[name] = stamp_ns + lifetime_ns
                continue
            for one in [*self._there, *self._batch, *self._next, *said]:
                if name in ("", one, one.rpartition("/")[0] + "/"):
                    gone[one] = None
                    said.pop(one, None)
                    self._ends.pop(one, None)
        meshes = {one.mesh for one in self._there.values()}
        new = {name: one for name, one in said.items() if one.mesh and one.mesh not in meshes}
        self._drop([*(gone.keys() - new.keys()), *(said.keys() - new.keys())])
        self._forget(gone.keys() & (said.keys() - new.keys()))
        for name, obstacle in said.items():
            if name in new:
                self._postpone(name, obstacle, stamp_ns)
            else:
                added = name not in before or before[name] is not self._there.get(name)
                self._say(obstacle, stamp_ns, added)
        removed = [one for one in gone if one not in said and one in self._there]
        if new:
            self._next |= {one: _Later(None, stamp_ns) for one in removed}
        else:
            self._forget(removed)

    def _postpone(self, name: str, obstacle: Obstacle, stamp_ns: int) -> None:
        """Let an obstacle take effect when its mesh is made, unless too many wait."""
        making, waiting = (later.get(name, _Later(None, 0)).obstacle for later in self._both)
        if making is not None and making.mesh == obstacle.mesh:
            self._next.pop(name, None)
            self._batch[name] = _Later(obstacle, stamp_ns)
            return
        if waiting is not None and waiting.mesh != obstacle.mesh:
            self._note(
                "too_many",
                f"obstacle {name}: a newer mesh came before the last one was made; send meshes "
                "less often, or smaller ones",
            )
        elif waiting is None and len(self._next) >= 2 * self._most:  # removed and added
            self._note("too_many", f"obstacle {name}: {len(self._next)} others wait for meshes")
            return
        self._next[name] = _Later(obstacle, stamp_ns)

    @property
    def _both(self) -> tuple[dict[str, _Later], dict[str, _Later]]:
        return self._batch, self._next

    def _drop(self, names: Iterable[str]) -> None:
        """Let nothing be said of these obstacles later."""
        for name in names:
            for later in self._both:
                later.pop(name, None)

    def _begin(self, now_ns: int, begin_ns: int) -> None:
        """Let the batch be what waits, for which there is time from `begin_ns` on."""
        from dlo_sim.simulation.meshes import time_to_make  # imports the compiler

        self._batch, self._next = self._next, {}
        needed = 0.0
        for name, (obstacle, _) in list(self._batch.items()):
            if obstacle is not None:
                try:
                    needed += time_to_make(obstacle, self._radius)
                except ValueError as refusal:  # since the cable is thicker
                    self._note("not_added", str(refusal))
                    del self._batch[name]
        self._free_ns = max(begin_ns, self._free_ns) + round(needed * SECOND)
        self._ready_ns = max(now_ns, self._free_ns - self._head_start_ns)
        self._make(one for one, _ in self._batch.values())

    def _make(self, obstacles: Iterable[Obstacle | None]) -> None:
        """Make the fields of those that are meshes in another thread."""
        from dlo_sim.simulation.meshes import field_of  # imports the compiler

        if self._maker is None:
            self._maker = ThreadPoolExecutor(1, "meshes")  # which begins with its first task
        for one in obstacles:
            if one is not None and one.mesh and one.mesh not in self._fields:
                self._fields[one.mesh] = self._maker.submit(field_of, one, self._radius)

    def _make_no_more(self) -> None:
        """Forget the fields that nobody wants any more."""
        wanted = [one for both in self._both for one, _ in both.values()]
        wanted += [change.obstacle for message in self._pending for change in message.changes]
        for mesh in self._fields.keys() - {one.mesh for one in wanted if one is not None}:
            self._fields.pop(mesh).cancel()

    @property
    def _made(self) -> bool:
        """Whether the batch is made; a replay waits for it."""
        meshes = {one.mesh for one, _ in self._batch.values() if one is not None}
        fields = [self._fields[mesh] for mesh in meshes]
        if not self._live:
            wait(fields)
        return all(field.done() for field in fields)

    def _forget(self, gone: Iterable[str]) -> None:
        for one in gone:
            for known in (self._there, self._moving, self._said):
                known.pop(one, None)

    def _say(self, obstacle: Obstacle, stamp_ns: int, new: bool) -> None:
        """Note a new pose, or a new obstacle, at the pose of the newest marker of this step."""
        name, present = obstacle.name, self._there.get(obstacle.name)
        if new or present is None or _body(present) != _body(obstacle):
            self._there[name] = obstacle
            self._moving.pop(name, None)
        else:
            said, last_ns = self._said.get(name, (present, stamp_ns - round(LONGEST * SECOND)))
            if _pose(said) != _pose(obstacle):
                self._moving[name] = obstacle, min(stamp_ns - last_ns, round(LONGEST * SECOND))
        self._said[name] = obstacle, stamp_ns

    def _replace(self, before: Mapping[str, Obstacle], simulator: Simulator) -> None:
        """Replace the obstacles before by those that are said to be there, as far as they can be
        added.
        """
        kept = [one for name, one in self._there.items() if before.get(name) == one]
        for name, one in self._there.items():
            if before.get(name) == one:
                continue
            try:
                if len(kept) >= self._most:
                    raise ValueError(
                        f"obstacle {name}: not added beyond contact.markers {self._most}; raise "
                        "that, or delete others"
                    )
                simulator.check_obstacle(one)
            except ValueError as refusal:
                self._note("not_added", str(refusal))
                self._said.pop(name, None)
                self._ends.pop(name, None)
            else:
                kept.append(one)
        if kept == list(before.values()):
            return
        try:
            simulator.replace_added(tuple(kept))
        except ValueError as refusal:  # as when the file of a mesh is there no longer
            self._note("not_added", str(refusal))

    def _move(self, name: str, obstacle: Obstacle, duration: float, simulator: Simulator) -> None:
        """Let an obstacle go to the place of a marker within a time [s], unless it jumps."""
        position, orientation = simulator.end_pose(name)
        first: Quaternion = normalized(tuple(orientation.tolist()))
        way = np.array(obstacle.position) - position
        turn: Vector = turn_between(first, obstacle.orientation)
        far = math.hypot(*way) + 0.5 * math.hypot(*obstacle.size) * math.hypot(*turn)
        if far > self._max_speed * duration:
            self._note(
                "jumped",
                f"obstacle {name}: a marker is {far:.3g} m away after {duration:.3g} s, "
                f"inputs.max_speed is {self._max_speed:g} m/s; it stays, delete it and add it anew",
            )
            return
        path = np.array([position, way / duration, np.zeros(3)])
        turns = np.array([turn, (0.0, 0.0, 0.0)]) / duration
        begin = simulator.time
        motion = EndMotion.from_coefficients(begin, duration, path, np.array(first), turns)
        simulator.set_motion(name, motion)


def _body(obstacle: Obstacle) -> tuple[str, Vector, str]:
    return obstacle.shape, obstacle.size, obstacle.mesh


def _pose(obstacle: Obstacle) -> tuple[Vector, Quaternion]:
    return obstacle.position, obstacle.orientation
