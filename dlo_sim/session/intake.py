"""Checks serialised input messages: poses, loads, grasps that take or release, measured points.

A bad message is refused with a reason and never used. Signs and frames: config/NODE.md.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from dlo_sim.core.one_rotation import Quaternion, Vector, normalized, turn_between
from dlo_sim.core.rotations import IDENTITY, multiply, rotate
from dlo_sim.core.two_points import LEAST_APART, poses_of_two_points
from dlo_sim.scene.description import Holder, Scene
from dlo_sim.session import cdr
from dlo_sim.session.cdr import Stamped
from dlo_sim.session.diagnostics import Journal, Refused, TopicRecord
from dlo_sim.session.gripper_path import Pose
from dlo_sim.session.markers import Change, Markers, change_of
from dlo_sim.session.observer import Points
from dlo_sim.session.time_base import MOST_BEHIND, SECOND, Copy, Decision, Source, TimeBase
from dlo_sim.session.topics import POINT_KINDS, InputTopic, tf_inputs
from dlo_sim.session.waiting import LoadMessage, TakeMessage, Waiting

MOST_DISTANT = 1e8  # [m] from the origin; positions beyond it must be a mistake
SPACING_TOLERANCE = 0.1  # of pose_spacing, by which the distance of two points may differ
# The remark about positions that are as expected if divided by 1000.
MILLIMETRES = "1000 times too large: metres?"
# Distances from the expected place in cable lengths: of a suspected pose, and of its thousandth.
_UNSUSPECTED, _NEAR = 50.0, 10.0

NORM_TOLERANCE = 1e-3  # by which the norm of a quaternion may differ from 1; it is normalised
# Consecutive positions may differ by inputs.max_speed times the time between them, at most this
# window [s], plus a slack [m] for noise.
SPEED_WINDOW, SPEED_SLACK = 0.1, 1e-3
MOST_TURN = 0.5 * math.pi  # [rad] of two points from one message to the next
_MOST_WAITING = 1000  # messages of a topic that wait for transforms while the clock stands still


class Transform(NamedTuple):
    """Pose of a frame in the world: stamp [ns], 0 = static; position [m], quaternion x, y, z, w."""

    stamp_ns: int
    position: Vector
    orientation: Quaternion


class Transforms(Protocol):
    """Looks up frames."""

    def lookup(self, frame: str, stamp_ns: int | None) -> Transform:
        """Pose of a frame at a stamp [ns], interpolated, never extrapolated; None = the newest.

        Raises Refused (`no_transform`) if it is not available at that stamp, or not yet.
        """

    def clear(self) -> None:
        """Discard the poses of moving frames, because the clock or the stamps have jumped."""


def in_world(message: Stamped, kind: str, transform: Transform) -> Stamped:
    """The message of a kind (`session.topics`) in the frame of the transform, in the world frame.

    Positions become p + R x. Forces and torques become R x: the point they refer to is the same.
    """
    _, position, orientation = transform
    values = np.array(message.values)
    if kind == "pose":
        at = rotate(orientation, values[:3]) + position
        values = np.concatenate([at, multiply(orientation, values[3:])])
    else:
        rows = rotate(orientation, values.reshape(-1, 3))
        values = (rows if kind in ("wrench", "force") else rows + position).ravel()
    return Stamped(message.stamp_ns, "", tuple(values.tolist()))


def in_millimetres(position: Sequence[float], expected: Sequence[float], length: float) -> bool:
    """Whether a position seems to be in millimetres: far from the expected one [m], compared with
    the cable's length [m], but near to it if divided by 1000.
    """
    thousandth = [1e-3 * x for x in position]
    far = math.dist(position, expected) > _UNSUSPECTED * length
    return far and math.dist(thousandth, expected) < _NEAR * length


class ContentCheck:
    """Checks messages against the limits and frames of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._limits = scene.inputs
        self._frames: dict[str, str] = {scene.frame_id: "", "": ""}
        for name, end in scene.holders.items():
            if end.frame:
                self._frames.setdefault(end.frame, name)

    @property
    def tools(self) -> list[str]:
        """The frames of end effectors."""
        return [name for name, end in self._frames.items() if end]

    def knows(self, frame_id: str) -> bool:
        """Whether the scene names this frame."""
        return frame_id in self._frames

    def check(self, message: Stamped, kind: str, spacing: float = 0.0) -> Stamped:
        """Check that a message is finite, within the limits and in a known frame.

        Args:
            kind: of its topic (`session.topics`). spacing: [m] of two points, 0 = any.

        Returns:
            The message; its frame_id is replaced by the name of the end or grasp in whose
                end-effector frame it is, or "" for the world frame.

        Raises:
            Refused: it cannot be used.
        """
        values = message.values
        check_finite(values)
        if kind == "pose":
            check_pose(values)
        elif kind == "two_points":
            _check_points(values, spacing)
        elif kind in ("wrench", "force"):
            self._check_size(values)
        elif values and max(map(abs, values)) > MOST_DISTANT:
            raise _too_distant(values)
        return message._replace(frame_id=self._check_frame(message.frame_id, kind))

    def _check_size(self, values: tuple[float, ...]) -> None:
        for name, unit, vector, limit in (
            ("force", "N", values[:3], self._limits.max_force),
            ("torque", "N m", values[3:], self._limits.max_torque),
        ):
            size = math.hypot(*vector)
            if size > limit:
                raise Refused(
                    "too_large",
                    f"{name} {size:.6g} {unit} exceeds inputs.max_{name} {limit:g} {unit}",
                )

    def _check_frame(self, frame_id: str, kind: str) -> str:
        end = self._frames.get(frame_id)
        # Only forces and torques may be given in the frame of an end effector, which moves.
        fixed = kind not in ("wrench", "force")
        if end is not None and not (end and fixed):
            return end
        known = [name for name, of in self._frames.items() if name and not (of and fixed)]
        world = f"set frame_id: {frame_id} if it is the world frame, "
        raise Refused(
            "unknown_frame",
            f"frame_id '{frame_id}', known: {', '.join(known)}; {world if end is None else ''}"
            "transform before publishing, or run live with inputs.tf: true",
        )


def check_finite(values: Sequence[float]) -> None:
    """Raise Refused (`not_finite`) for a number that is not finite."""
    # The sum of finite numbers overflows only far beyond every limit.
    if not math.isfinite(sum(values)):
        raise Refused("not_finite", f"{cdr.shown(values)} is not finite; repair its source")


def _check_points(values: tuple[float, ...], spacing: float) -> None:
    if len(values) != 6:
        raise Refused("bad_points", f"{len(values) // 3} points; publish two")
    first, second = values[:3], values[3:]
    _check_position(first)
    _check_position(second)
    apart = math.dist(first, second)
    if apart < LEAST_APART:
        raise Refused("bad_points", f"{apart:.3g} m apart: they give no direction; publish two")
    if spacing and abs(apart - spacing) > SPACING_TOLERANCE * spacing:
        fits_in_millimetres = abs(1e-3 * apart - spacing) <= SPACING_TOLERANCE * spacing
        raise Refused(
            "bad_points",
            f"{apart:.6g} m apart, pose_spacing is {spacing:g} m; "
            f"{MILLIMETRES + ', ' if fits_in_millimetres else ''}"
            "correct it, or the markers",
        )


def _check_position(position: Sequence[float]) -> None:
    if math.hypot(*position) > MOST_DISTANT:
        raise _too_distant(position)


def check_pose(values: Sequence[float]) -> None:
    """Raise Refused for a pose (7) that is not finite, too far away, or has no unit quaternion."""
    check_finite(values)
    _check_position(values[:3])
    norm = math.hypot(*values[3:])
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise Refused(
            "bad_quaternion", f"orientation {cdr.shown(values[3:])} has norm {norm:.6g}, needs 1"
        )


def _too_distant(values: Sequence[float]) -> Refused:
    shown = cdr.shown(values[:3])
    return Refused("too_large", f"position {shown} is beyond {MOST_DISTANT:g} m; check its unit")


Message = Pose | LoadMessage | TakeMessage | Points | Markers
Take = Callable[[tuple[InputTopic, ...], Message, bool], None]
"""What is told of a message before it is put into the queues of these inputs (one topic may drive
several), and whether everything before it is forgotten.
"""


class _Topic:
    """One topic: its inputs, and the state of its last messages."""

    def __init__(
        self,
        entries: tuple[InputTopic, ...],
        queues: list[Waiting[Any]],
        record: TopicRecord,
        source: Source,
    ) -> None:
        self.queues, self.record, self.source = queues, record, source
        self.type, self.kind = entries[0].type, entries[0].kind
        self.is_pose = entries[0].is_pose
        self.entries = entries
        self.frame = ""  # of messages without one; empty = not given
        self.spacing = 0.0
        # Messages that wait for a transform, with their arrivals.
        self.waiting: deque[tuple[Stamped, int]] = deque()
        self.unit = ""  # what seems to be wrong with the unit of the first pose
        self.clear()

    def configure(self, scene: Scene) -> None:
        """Use the settings of the targets in this scene."""
        targets = [entry.target for entry in self.entries]
        if self.is_pose:
            moved = [scene.moved[target] for target in targets]
            self.record.timeout = min(one.pose_timeout for one in moved)
            held = [one for one in moved if isinstance(one, Holder)]
            self.spacing = max((holder.pose_spacing for holder in held), default=0.0)
        elif self.kind in ("wrench", "force"):
            self.record.timeout = min(scene.load(target).timeout for target in targets)
            self.frame = scene.load(targets[0]).frame
        self.record.occasional = self.kind in ("taken", "markers")

    def clear(self) -> None:
        """Forget the last pose."""
        self.poses: list[Pose] = []  # used in the last second, in the order of their stamps
        self.too_fast_since_ns: int | None = None

    def pose(self, values: tuple[float, ...], stamp_ns: int) -> Pose:
        """The pose of a message with these values."""
        if self.kind == "two_points":
            last, _ = self.around(stamp_ns)
            before = IDENTITY if last is None else last.orientation
            points = np.reshape(values, (1, 2, 3))
            (values,) = poses_of_two_points(points, before).tolist()
        px, py, pz, x, y, z, w = values
        return Pose(stamp_ns, (px, py, pz), normalized((x, y, z, w)))

    def around(self, stamp_ns: int) -> tuple[Pose | None, Pose | None]:
        """The used poses before and after a stamp, None = none."""
        at = bisect_right(self.poses, stamp_ns, key=_stamp)
        return self.poses[at - 1] if at else None, self.poses[at] if at < len(self.poses) else None

    def keep(self, pose: Pose) -> None:
        """Note that a pose is used."""
        insort(self.poses, pose, key=_stamp)
        old = self.poses[-1].stamp_ns - MOST_BEHIND
        if self.poses[0].stamp_ns < old:  # the last one stays, however old
            del self.poses[: bisect_right(self.poses, old, key=_stamp)]


class Intake:
    """Checks every message of a scene's input topics.

    Args:
        scene: gives limits, frames and timeouts.
        queues: input topics by resolved names, and tf2 frames -> queue of their messages, which
            knows up to which stamp the simulation has used it.
        time_base: decides from the stamps which messages are used and at which time.
        journal: counts the messages. take: is called with each message that is used.
        transforms: looks up frames that the scene does not name; None: they are refused.
    """

    def __init__(
        self,
        scene: Scene,
        queues: Mapping[InputTopic, Waiting[Any]],
        time_base: TimeBase,
        journal: Journal,
        take: Take,
        transforms: Transforms | None = None,
    ) -> None:
        self._note, self._take = journal.event, take
        self.time_base = time_base
        self._transforms = transforms
        # Frame -> stamp of its last pose [ns].
        self._sampled = {entry.topic: 0 for entry in tf_inputs(scene)}
        self._topics: dict[str, _Topic] = {}
        for name, record in journal.topics.items():
            entries = tuple(entry for entry in queues if entry.topic == name)
            source = time_base.add_source(entries[0].is_pose)
            self._topics[name] = _Topic(entries, [queues[e] for e in entries], record, source)
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use limits, frames and timeouts of this scene, which has the same topics."""
        self._expected = {name: x.position for name, x in scene.moved.items()}
        self._length = scene.cable.length
        self._limits, self._world = scene.inputs, scene.frame_id
        self._most_obstacles = scene.contact.markers
        self._radius = 0.5 * scene.cable.diameter
        self._content = ContentCheck(scene)
        for topic in self._topics.values():
            topic.configure(scene)

    def clear(self) -> None:
        """Accept the next poses wherever they are (reset)."""
        for topic in self._topics.values():
            topic.clear()

    def accept(self, name: str, raw: cdr.Bytes, arrival_ns: int, patience_ns: int) -> None:
        """Check one message; use it, and those of its topic that have waited.

        Refused messages are counted. `patience_ns`: how long a message waits for its transform
        [ns].

        Raises:
            KeyError: the scene has no such input topic (an error of the caller, not of a message).
        """
        topic = self._topics[name]
        topic.record.last_arrival_ns = arrival_ns
        if topic.kind == "markers" and cdr.lists_nothing(raw):  # as of a camera that sees nothing
            return
        try:
            keep_missing = topic.kind not in POINT_KINDS
            most = 2 * self._most_obstacles + 1  # removed and added, after DELETEALL
            message = cdr.decode(topic.type, raw, keep_missing=keep_missing, most=most)
        except cdr.DecodeError as error:
            topic.record.refuse(error.reason, f"{error}; publish {topic.type}")
            return
        topic.waiting.append((message, arrival_ns))
        self._look_up(topic, arrival_ns, patience_ns)

    def look(self, clock_ns: int, patience_ns: int) -> None:
        """Use messages that have waited, and new poses of tf2, at this clock time [ns]."""
        if self._transforms is not None:
            self._sample(self._transforms, clock_ns)
        for topic in self._topics.values():
            if topic.waiting:
                self._look_up(topic, clock_ns, patience_ns)
            if topic.source.pending or topic.source.undated:
                self._follow(topic, self.time_base.due(topic.source, clock_ns))

    def _sample(self, transforms: Transforms, clock_ns: int) -> None:
        """Take the newest pose of every tf2 frame that drives an end effector or an obstacle,
        unless it was taken before, as a message that arrives at this clock time [ns].
        """
        for frame, last_ns in self._sampled.items():
            try:
                stamp_ns, position, orientation = transforms.lookup(frame, None)
            except Refused:  # the session reports that it waits
                continue
            if not stamp_ns or stamp_ns != last_ns:
                self._sampled[frame] = stamp_ns
                topic = self._topics[frame]
                topic.record.last_arrival_ns = clock_ns
                topic.waiting.append((Stamped(stamp_ns, "", (*position, *orientation)), clock_ns))

    def refuse_waiting(self) -> None:
        """Refuse the messages whose stamps still wait for confirmation, as no more will arrive."""
        for topic in self._topics.values():
            self._follow(topic, self.time_base.refute(topic.source))

    def _look_up(self, topic: _Topic, clock_ns: int, patience_ns: int) -> None:
        """Process the messages of a topic in order, up to one whose transform may still arrive."""
        while topic.waiting:
            message, arrival_ns = topic.waiting[0]
            if not message.frame_id and topic.kind in ("wrench", "force"):
                message = self._in_meant_frame(topic, message)
            try:
                if topic.kind == "markers":
                    message = self._changes(topic, message, arrival_ns)
                else:
                    message = self._in_world(message, arrival_ns, topic.kind)
                    message = self._content.check(message, topic.kind, topic.spacing)
            except Refused as refused:
                young = abs(clock_ns - arrival_ns) <= patience_ns
                few = len(topic.waiting) <= _MOST_WAITING
                if refused.reason == "no_transform" and young and few:
                    break
                topic.record.refuse(refused.reason, refused.detail)
            else:
                decisions = self.time_base.sort(topic.source, message, arrival_ns)
                self._follow(topic, decisions)
            topic.waiting.popleft()

    def _changes(self, topic: _Topic, message: Stamped, arrival_ns: int) -> Stamped:
        """The changes of obstacles by the markers of a message, in the world frame.

        Bad markers are refused with one line; raises Refused if all are, or a transform is missing.
        """
        located = [
            self._in_world(Stamped(message.stamp_ns, one.frame_id, one.pose), arrival_ns, "pose")
            if one.action == cdr.ADD
            else None
            for one in message.values
        ]
        changes: list[Change] = []
        bad: list[tuple[str, Refused]] = []
        for marker, there in zip(message.values, located, strict=True):
            try:
                if there is not None:
                    marker = marker._replace(pose=self._content.check(there, "pose").values)
                    check_finite(marker.scale)
                changes.append(change_of(marker, self._radius))
            except Refused as refused:
                bad.append((marker.name, refused))
        if bad:
            name, first = bad[0]
            count = f"{len(bad)} of {len(message.values)} markers, the first is {name}: "
            if not changes:
                raise Refused(first.reason, count + first.detail)
            topic.record.refuse(first.reason, count + first.detail)
        return Stamped(message.stamp_ns, "", tuple(changes))

    def _in_meant_frame(self, topic: _Topic, message: Stamped) -> Stamped:
        """A load without a frame, in the frame that its key gives; the first one is noted."""
        if not topic.record.unframed:
            topic.record.unframed = topic.frame or self._world
            if not topic.frame:
                self._note("no_frame", self._advice_on_frame(topic))
        return message._replace(frame_id=topic.frame)

    def _advice_on_frame(self, topic: _Topic) -> str:
        key = f"loads.{topic.entries[0].target}.frame"
        tools = ", ".join(self._content.tools)
        cure = (
            f"set {key} to its frame ({tools})"
            if tools
            else (f"name that in start.frame or end.frame and in {key}")
        )
        return (
            f"{topic.record.topic}: loads without a frame_id are taken in '{self._world}'; if the "
            f"sensor turns with an end effector, {cure}, else set it to '{self._world}'"
        )

    def _in_world(self, message: Stamped, arrival_ns: int, kind: str) -> Stamped:
        """A message in the world frame, or as it is if the scene names its frame.

        Raises Refused if the transform is not available, or not yet.
        """
        if self._transforms is None or not self._limits.tf or self._content.knows(message.frame_id):
            return message
        stamped = message.stamp_ns and self.time_base.mode != "arrival"
        stamp_ns = message.stamp_ns if stamped else self.time_base.from_clock(arrival_ns)
        return in_world(message, kind, self._transforms.lookup(message.frame_id, stamp_ns))

    def _follow(self, topic: _Topic, decisions: Iterable[Decision]) -> None:
        """Use or refuse messages as the time base decides."""
        passed = [queue.passed_ns for queue in topic.queues]
        topic.source.passed_ns = max((ns for ns in passed if ns is not None), default=None)
        for decision in decisions:
            try:
                self._use(topic, decision)
            except Copy:
                topic.record.copies += 1
            except Refused as refused:
                topic.record.refuse(refused.reason, refused.detail)

    def _use(self, topic: _Topic, decision: Decision) -> None:
        """Convert, count and pass on a message that the time base accepts.

        Raises Copy if it is the same message again, Refused if it or its pose cannot be used.
        """
        if decision.refusal is not None:
            raise decision.refusal
        stamp_ns, end, values = decision.message
        if decision.restart:
            self.clear()
        message: Message
        if topic.is_pose:
            message = topic.pose(values, stamp_ns)
            before, after = topic.around(stamp_ns)
            if before is None and after is None:
                self._suspect_unit(topic, message)
            self._check_speed(topic, before, message)
            if after is not None:
                self._check_speed(topic, after, message)
            if topic.kind == "two_points":
                _check_turn(before, message)
            topic.keep(message)
        elif topic.kind == "taken":
            message = TakeMessage(stamp_ns, bool(values[0]))
        elif topic.kind == "markers":
            message = Markers(stamp_ns, values)
        elif topic.kind in POINT_KINDS:
            message = Points(stamp_ns, np.reshape(values, (-1, 3)))
        else:
            message = LoadMessage(stamp_ns, values[:3], values[3:] or (0.0, 0.0, 0.0), end)
        topic.source.use(decision.message)
        topic.record.accepted += 1
        self._take(topic.entries, message, decision.restart)
        for queue in topic.queues:
            queue.add(message)

    def _suspect_unit(self, topic: _Topic, pose: Pose) -> None:
        """Note a first pose that seems to be in millimetres."""
        topic.unit = ""
        for entry in topic.entries:
            expected = self._expected[entry.target]
            if in_millimetres(pose.position, expected, self._length):
                topic.unit = f"; {MILLIMETRES}"
                away = math.dist(pose.position, expected)
                self._note(
                    "units",
                    f"{topic.record.topic}: the first pose is {away:.4g} m from where the scene "
                    f"has '{entry.target}', {list(expected)}; {MILLIMETRES}",
                )

    @property
    def unit(self) -> str:
        """What seems to be wrong with the unit of poses, to be appended to a line; or empty."""
        return max(topic.unit for topic in self._topics.values()) if self._topics else ""

    def _check_speed(self, topic: _Topic, last: Pose | None, pose: Pose) -> None:
        """Refuse |p - p_last| > inputs.max_speed min(dt, 0.1 s) + 1 mm, p_last = a used pose beside
        it.
        """
        stamp_ns = pose.stamp_ns
        if last is None:
            topic.too_fast_since_ns = None
            return
        passed = abs(stamp_ns - last.stamp_ns) * 1e-9
        distance = math.dist(pose.position, last.position)
        if distance <= self._limits.max_speed * min(passed, SPEED_WINDOW) + SPEED_SLACK:
            topic.too_fast_since_ns = None
            return
        limit = self._limits.max_speed
        detail = f"pose jumps {distance:.6g} m in {passed:.4g} s, inputs.max_speed is {limit:g} m/s"
        detail += topic.unit
        if topic.too_fast_since_ns is None:
            topic.too_fast_since_ns = stamp_ns
        elif stamp_ns - topic.too_fast_since_ns > SECOND:
            since = (stamp_ns - topic.too_fast_since_ns) * 1e-9
            detail += f"; for {since:.1f} s now: if the gripper really is there, call ~/reset"
        raise Refused("too_fast", detail)


def _stamp(pose: Pose) -> int:
    return pose.stamp_ns


def _check_turn(last: Pose | None, pose: Pose) -> None:
    """Refuse two points that were exchanged, or turned by more than MOST_TURN."""
    turn = math.hypot(*turn_between(last.orientation, pose.orientation)) if last else 0.0
    if turn > MOST_TURN:
        raise Refused(
            "bad_points",
            f"turned by {math.degrees(turn):.0f} degrees since the last message; publish them in "
            "one order, first nearer to the start; if the gripper really turned, call ~/reset",
        )
