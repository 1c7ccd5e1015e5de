"""Checks serialised input messages: poses, loads, grasps that take or release, measured points.

A bad message is refused with a reason; it never raises and is never used. Signs and frames of the
inputs: config/NODE.md. Loads act on the cable; a torque is about the point of the cable where it
acts, whatever the frame of its axes.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from dlo_sim.core.one_rotation import normalized, turn_between
from dlo_sim.core.rotations import IDENTITY
from dlo_sim.core.two_points import poses_of_two_points
from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.cdr import Stamped
from dlo_sim.session.cdr_points import decode_input
from dlo_sim.session.content import MILLIMETRES, ContentCheck, Refused, in_millimetres
from dlo_sim.session.diagnostics import Journal, TopicRecord
from dlo_sim.session.latency import Latency
from dlo_sim.session.observer import Points
from dlo_sim.session.pose_smoothing import Pose
from dlo_sim.session.time_base import MOST_BEHIND, SECOND, Copy, Decision, Source, TimeBase, Verdict
from dlo_sim.session.topics import POINT_KINDS, InputTopic, tf_inputs
from dlo_sim.session.transforms import Transforms, in_world
from dlo_sim.session.waiting import LoadMessage, TakeMessage

# Consecutive positions may differ by inputs.max_speed times the time between them, at most this
# window, plus a slack for noise.
SPEED_WINDOW, SPEED_SLACK = 0.1, 1e-3  # s, m

# Largest rotation of two points from one message to the next [rad].
MOST_TURN = 0.5 * math.pi

# Most messages of a topic that wait for their transforms while the clock stands still.
_MOST_WAITING = 1000


class Accepted(NamedTuple):
    """A message that is used, or of which only the stamp is used.

    Attributes:
        verdict: what its stamp means for everything before it.
        entries: the inputs that it is for (one topic may drive several); empty if only the stamp is
            used.
    """

    verdict: Verdict
    entries: tuple[InputTopic, ...] = ()
    message: Pose | LoadMessage | TakeMessage | Points | None = None


class _Topic:
    """One topic: its inputs, and the state of its last messages."""

    def __init__(
        self, entries: tuple[InputTopic, ...], record: TopicRecord, source: Source
    ) -> None:
        self.record = record
        self.source = source
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
            holders = [scene.holders[target] for target in targets]
            self.record.timeout = min(holder.pose_timeout for holder in holders)
            self.spacing = max(holder.pose_spacing for holder in holders)
        elif self.kind in ("wrench", "force"):
            self.record.timeout = min(scene.load(target).timeout for target in targets)
            self.frame = scene.load(targets[0]).frame
        self.record.occasional = self.kind == "taken"

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

    def follow_offset(self) -> None:
        """Shift poses that were dated by the clock as the time base has shifted their stamps."""
        if self.poses and self.source.last_ns is not None:
            delta_ns = self.source.last_ns - self.poses[-1].stamp_ns
            self.poses = [pose.moved(delta_ns) for pose in self.poses]


class Intake:
    """Checks every message of a scene's input topics.

    Args:
        scene: gives limits, frames and timeouts.
        inputs: the input topics, by their resolved names, and frames of tf2.
        time_base: decides from the stamps which messages are used and at which time.
        journal: counts the messages.
        latency: the lag of the prediction, for which a message waits for its transform.
        transforms: looks up frames that the scene does not name; None: such frames are refused.
        passed: stamp up to which the simulation has used an input [ns], None = nothing used.
    """

    def __init__(
        self,
        scene: Scene,
        inputs: Sequence[InputTopic],
        time_base: TimeBase,
        journal: Journal,
        latency: Latency,
        transforms: Transforms | None = None,
        passed: Callable[[InputTopic], int | None] = lambda entry: None,
    ) -> None:
        self._passed, self._note = passed, journal.event
        self._latency = latency
        self.time_base = time_base
        self._transforms = transforms
        # Frame -> stamp of its last pose [ns].
        self._sampled = {entry.topic: 0 for entry in tf_inputs(scene)}
        self._topics: dict[str, _Topic] = {}
        for name, record in journal.topics.items():
            entries = tuple(entry for entry in inputs if entry.topic == name)
            source = time_base.add_source(entries[0].is_pose)
            self._topics[name] = _Topic(entries, record, source)
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Use limits, frames and timeouts of this scene, which has the same topics."""
        self._expected = {name: x.position for name, x in scene.holders.items()}
        self._length = scene.cable.length
        self._limits, self._world = scene.inputs, scene.frame_id
        self._content = ContentCheck(scene)
        for topic in self._topics.values():
            topic.configure(scene)

    def clear(self) -> None:
        """Accept the next poses wherever they are (reset)."""
        for topic in self._topics.values():
            topic.clear()

    def accept(self, name: str, raw: cdr.Bytes, arrival_ns: int) -> list[Accepted]:
        """Check one message; returns the messages to be used now: this one, and waiting ones of its
        topic. Refused messages are counted.

        Raises:
            KeyError: the scene has no such input topic (an error of the caller, not of a message).
        """
        topic = self._topics[name]
        topic.record.last_arrival_ns = arrival_ns
        try:
            decode = decode_input if topic.kind in POINT_KINDS else cdr.decode
            message = decode(topic.type, raw)
        except cdr.DecodeError as error:
            topic.record.refuse(error.reason, f"{error}; publish {topic.type}")
            return []
        topic.waiting.append((message, arrival_ns))
        return self._look_up(topic, arrival_ns)

    def sample(self, clock_ns: int) -> list[Accepted]:
        """Take the newest pose of every tf2 frame that drives an end effector, unless it was taken
        before, as a message that arrives at this clock time [ns].
        """
        found: list[Accepted] = []
        if self._transforms is None:
            return found
        for frame, last_ns in self._sampled.items():
            try:
                stamp_ns, position, orientation = self._transforms.lookup(frame, None)
            except Refused:  # the session reports that it waits
                continue
            if stamp_ns and stamp_ns == last_ns:
                continue
            self._sampled[frame] = stamp_ns
            topic = self._topics[frame]
            topic.record.last_arrival_ns = clock_ns
            topic.waiting.append((Stamped(stamp_ns, "", (*position, *orientation)), clock_ns))
            found += self._look_up(topic, clock_ns)
        return found

    def due(self, clock_ns: int) -> list[Accepted]:
        """Messages that have waited and are to be used at this clock time [ns]."""
        found: list[Accepted] = []
        for topic in self._topics.values():
            found += self._look_up(topic, clock_ns)
            if topic.source.pending:
                found += self._follow(topic, self.time_base.due(topic.source, clock_ns))
        return found

    def refuse_waiting(self) -> None:
        """Refuse the messages whose stamps still wait for confirmation, as no more will arrive."""
        for topic in self._topics.values():
            self._follow(topic, self.time_base.refute(topic.source))

    def _look_up(self, topic: _Topic, clock_ns: int) -> list[Accepted]:
        """Process the messages of a topic in order, up to one whose transform may still arrive."""
        found: list[Accepted] = []
        while topic.waiting:
            message, arrival_ns = topic.waiting[0]
            if not message.frame_id and topic.kind in ("wrench", "force"):
                message = self._in_meant_frame(topic, message)
            try:
                message = self._in_world(message, arrival_ns, topic.kind)
                message = self._content.check(message, topic.kind, topic.spacing)
            except Refused as refused:
                young = abs(clock_ns - arrival_ns) <= self._latency.ns
                few = len(topic.waiting) <= _MOST_WAITING
                if refused.reason == "no_transform" and young and few:
                    break
                topic.record.refuse(refused.reason, refused.detail)
            else:
                decisions = self.time_base.sort(topic.source, message, arrival_ns)
                found += self._follow(topic, decisions)
            topic.waiting.popleft()
        return found

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
        """A message, transformed to the world frame unless the scene names its frame.

        Raises:
            Refused: the transform is not available, or not yet.
        """
        if self._transforms is None or not self._limits.tf or self._content.knows(message.frame_id):
            return message
        stamped = message.stamp_ns and self.time_base.mode != "arrival"
        stamp_ns = message.stamp_ns if stamped else self.time_base.from_clock(arrival_ns)
        return in_world(message, kind, self._transforms.lookup(message.frame_id, stamp_ns))

    def _follow(self, topic: _Topic, decisions: Iterable[Decision]) -> list[Accepted]:
        """Use or refuse messages as the time base decides."""
        found = []
        passed = [stamp for entry in topic.entries if (stamp := self._passed(entry)) is not None]
        topic.source.passed_ns = max(passed, default=None)
        for decision in decisions:
            try:
                found.append(self._use(topic, decision))
            except Copy:
                topic.record.copies += 1
            except Refused as refused:
                topic.record.refuse(refused.reason, refused.detail)
                if decision.verdict is Verdict.DECIDE:  # its stamp is valid all the same
                    found.append(Accepted(decision.verdict))
        return found

    def _use(self, topic: _Topic, decision: Decision) -> Accepted:
        """Convert and count a message that the time base accepts.

        Raises:
            Copy: it is the same message again.
            Refused: the time base refuses it, or its pose is too far from those around it.
        """
        if decision.refusal is not None:
            raise decision.refusal
        stamp_ns, end, values = decision.message
        if decision.verdict is Verdict.START_OVER:
            self.clear()
        elif decision.verdict is Verdict.DECIDE:
            for other in self._topics.values():
                other.follow_offset()
        message: Pose | LoadMessage | TakeMessage | Points
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
        elif topic.kind in POINT_KINDS:
            message = Points(stamp_ns, np.reshape(values, (-1, 3)))
        else:
            message = LoadMessage(stamp_ns, values[:3], values[3:] or (0.0, 0.0, 0.0), end)
        topic.source.use(decision.message)
        topic.record.accepted += 1
        return Accepted(decision.verdict, topic.entries, message)

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
        """Refuse |p - p_last| > inputs.max_speed min(dt, 0.1 s) + 1 mm, p_last = the used pose
        before or after it.
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
