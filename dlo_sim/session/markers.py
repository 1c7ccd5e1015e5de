"""Obstacles from markers on ~/obstacles.

A marker is one obstacle, named by its namespace and id: CUBE a box, SPHERE a sphere, CYLINDER a
cylinder about z, whose size is `scale`; TRIANGLE_LIST a closed mesh, times `scale`. ADD, which is
MODIFY too, adds it, or moves it if it is there with this shape; DELETE and DELETEALL remove it, and
so does the end of a `lifetime` that is not renewed. A message takes effect at the stamp of its
first marker.

A pose that differs from the one before is reached at a constant velocity, in the time between the
two messages but at most `LONGEST`: the obstacle is late by as much, and carries along what lies on
it. What would be faster than inputs.max_speed is a jump and is not followed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.one_rotation import Quaternion, Vector, normalized, turn_between
from dlo_sim.scene.description import LEAST_SIZE, Obstacle, Scene
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Journal, Refused
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.simulator import Simulator

LONGEST = 0.2  # [s] for the way to a new pose
ROUND = 1e-3  # share by which the diameters of a sphere or cylinder may differ
MOST_TRIANGLES = 1000
_CELLS = 32  # of the field of a mesh, along its longest side
_SHAPES = {cdr.CUBE: "box", cdr.SPHERE: "sphere", cdr.CYLINDER: "cylinder"}
_SHAPES[cdr.TRIANGLE_LIST] = "mesh"
_LARGEST, _LONGEST_NAME = 1e6, 255  # [m], characters
_MOST_WAITING = 1000  # messages


class Change(NamedTuple):
    """What a marker says of the obstacle `name`, of all in a namespace if it ends with a slash, or
    of all if it is empty: it is there until `lifetime_ns` after the message, 0 = until it is
    removed, or (None) no longer.
    """

    name: str
    obstacle: Obstacle | None = None
    lifetime_ns: int = 0


class Markers(NamedTuple):
    """An accepted message: stamp in the time base [ns], and its markers in their order."""

    stamp_ns: int
    changes: tuple[Change, ...]


def change_of(marker: cdr.Marker) -> Change:
    """What a marker in the world frame says; its numbers are finite, its quaternion is a rotation.

    Raises:
        Refused: `bad_marker`: it is no obstacle.
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
        mesh, size = _mesh_of(marker)
    obstacle = Obstacle(marker.name, shape, size, (px, py, pz), turn, mesh=mesh, mesh_cells=_CELLS)
    return Change(marker.name, obstacle, marker.lifetime_ns)


def _mesh_of(marker: cdr.Marker) -> tuple[str, Vector]:
    """The triangles of a marker as `Obstacle.mesh`, and their extents [m]."""
    from dlo_sim.simulation.meshes import as_text  # imports the compiler

    count = len(marker.points)
    if count % 3 or not 4 <= count // 3 <= MOST_TRIANGLES:
        raise _bad(f"{count} points; give three for each of 4 to {MOST_TRIANGLES} triangles")
    points = np.array(marker.points) * marker.scale
    try:
        mesh = as_text(points.reshape(-1, 3, 3))
    except ValueError as problem:
        raise _bad(str(problem)) from None
    x, y, z = np.ptp(points, axis=0).tolist()
    return mesh, (x, y, z)


def _bad(detail: str) -> Refused:
    return Refused("bad_marker", detail)


class Surroundings(Waiting[Markers]):
    """Messages of markers that wait, and what they have said of the obstacles.

    Args:
        scene: gives the limits.
        journal: counts what is not followed.
    """

    def __init__(self, scene: Scene, journal: Journal) -> None:
        self._note = journal.event
        self._maker: ThreadPoolExecutor | None = None
        self._making: list[Future[object]] = []
        super().__init__(_MOST_WAITING)
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use the limits of this scene."""
        self._radius = 0.5 * scene.cable.diameter
        self._most, self._max_speed = scene.contact.markers, scene.inputs.max_speed

    def clear(self) -> None:
        """Discard all messages and what was said of obstacles."""
        super().clear()
        # Obstacle -> as the last message has it, the stamp of that, and the end of its life [ns].
        self._said: dict[str, tuple[Obstacle, int]] = {}
        self._ends: dict[str, int] = {}

    def add(self, message: Markers) -> None:
        """Take an accepted message, as `Waiting.add`; a full queue loses its oldest."""
        if len(self._pending) == self._pending.maxlen:
            self._note("full", f"more than {_MOST_WAITING} messages of markers wait")
        for _, obstacle, _ in message.changes:
            if obstacle is not None and obstacle.shape == "mesh":
                self._prepare(obstacle)
        super().add(message)

    def _prepare(self, obstacle: Obstacle) -> None:
        """Make the field of a mesh in another thread while the message waits; it takes 50 ms."""
        from dlo_sim.simulation.meshes import field_of  # imports the compiler

        if self._maker is None:
            self._maker = ThreadPoolExecutor(1, "meshes")
        self._making.append(self._maker.submit(field_of, obstacle, self._radius))

    def shift_time(self, delta_ns: int) -> None:
        """Shift all stamps by delta [ns]."""
        super().shift_time(delta_ns)
        self._said = {name: (one, ns + delta_ns) for name, (one, ns) in self._said.items()}
        self._ends = {name: ns + delta_ns for name, ns in self._ends.items()}

    def next_change_ns(self) -> int | None:
        """Time base [ns] of the next known message or end of a life, None = none."""
        changes = (super().next_change_ns(), *self._ends.values())
        return min((change for change in changes if change is not None), default=None)

    def apply(
        self, now_ns: int, step_ns: float, simulator: Simulator, driven: Simulator | ErrorEstimate
    ) -> None:
        """Let the messages up to a time [ns] take effect on a simulator, and with it on all of
        `driven`, that is at this time.
        """
        change = self.next_change_ns()
        if change is None or change > now_ns:
            return
        while self._making:  # so that what takes effect depends on stamps alone
            self._making.pop().result()
        before = {one.name: one for one in simulator.scene.added}
        there = dict(before)
        moving: dict[str, tuple[Obstacle, int]] = {}
        for stamp_ns, changes in self.due(now_ns):
            if now_ns - stamp_ns > step_ns:
                self._note("late", "markers came after the simulation had passed their stamp")
            for name, obstacle, lifetime_ns in changes:
                if obstacle is None:
                    self._forget(name, there, moving)
                else:
                    new = name not in before or before[name] is not there.get(name)
                    self._say(obstacle, stamp_ns, new, there, moving)
                    self._ends.pop(name, None)
                    if lifetime_ns:
                        self._ends[name] = stamp_ns + lifetime_ns
        for name in [name for name, end_ns in self._ends.items() if end_ns <= now_ns]:
            self._forget(name, there, moving)
        self._replace(before, there, simulator, driven)
        for name, (obstacle, way_ns) in moving.items():
            self._move(name, obstacle, max(way_ns, step_ns) / SECOND, simulator, driven)

    def _forget(
        self, name: str, there: dict[str, Obstacle], moving: dict[str, tuple[Obstacle, int]]
    ) -> None:
        gone = [name]
        if not name or name.endswith("/"):
            gone = [one for one in there if not name or one.rpartition("/")[0] == name[:-1]]
        for one in gone:
            for known in (there, moving, self._said, self._ends):
                known.pop(one, None)

    def _say(
        self,
        obstacle: Obstacle,
        stamp_ns: int,
        new: bool,
        there: dict[str, Obstacle],
        moving: dict[str, tuple[Obstacle, int]],
    ) -> None:
        """Note that a marker has an obstacle: a new one, which is added where the newest marker of
        this step has it, or one at another place.
        """
        name, present = obstacle.name, there.get(obstacle.name)
        if new or present is None or _body(present) != _body(obstacle):
            there[name] = obstacle
            moving.pop(name, None)
        else:
            said, last_ns = self._said.get(name, (present, stamp_ns - round(LONGEST * SECOND)))
            if _pose(said) != _pose(obstacle):
                moving[name] = obstacle, min(stamp_ns - last_ns, round(LONGEST * SECOND))
        self._said[name] = obstacle, stamp_ns

    def _replace(
        self,
        before: Mapping[str, Obstacle],
        there: Mapping[str, Obstacle],
        simulator: Simulator,
        driven: Simulator | ErrorEstimate,
    ) -> None:
        """Replace the obstacles before by these, as far as they can be added."""
        kept = [one for name, one in there.items() if before.get(name) == one]
        for name, one in there.items():
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
        driven.replace_added(tuple(kept))

    def _move(
        self,
        name: str,
        obstacle: Obstacle,
        duration: float,
        simulator: Simulator,
        driven: Simulator | ErrorEstimate,
    ) -> None:
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
        driven.set_motion(name, motion)


def _body(obstacle: Obstacle) -> tuple[str, Vector, str]:
    return obstacle.shape, obstacle.size, obstacle.mesh


def _pose(obstacle: Obstacle) -> tuple[Vector, Quaternion]:
    return obstacle.position, obstacle.orientation
