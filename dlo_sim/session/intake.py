"""Serialised input messages -> checked poses and loads. A bad message is refused with a reason,
never raised, never used.

SIGN AND FRAME OF EVERY INPUT
- `WrenchStamped` of a load (`~/start/wrench`, `~/end/wrench`, `loads.<name>.topic`): force [N] and
  torque [N m] acting ON THE CABLE BY THE END EFFECTOR, at the material point
  `loads.<name>.position`; multiplied by `loads.<name>.sign`. A force-torque sensor that reports the
  load of the cable on the robot needs `sign: -1.0`. Axes: those of `header.frame_id`: `frame_id` of
  the scene or empty = world axes; the name in `start.frame` or `end.frame` = axes of that end
  effector, rotated to the world by its pose when the load takes effect. The torque is about the
  material point, whatever the frame's origin.
- `Vector3Stamped` of a force load (`~/force`): force [N] ON THE CABLE, sign and axes as above.
- `PoseStamped` (`start.pose_topic`, `end.pose_topic`): pose of the END EFFECTOR in the world frame
  (`frame_id` or empty); rotates vectors from the end effector's axes into the world's. The cable is
  attached at `<end>.offset` with `<end>.tangent` in it.
- `PointCloud2` or `PoseArray` (`~/measured`): points on the cable in the world frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dlo_sim.core.one_rotation import normalized
from dlo_sim.scene.cable import Load
from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.cdr_points import decode_input
from dlo_sim.session.content import ContentCheck, Refused
from dlo_sim.session.diagnostics import Journal, TopicRecord
from dlo_sim.session.load_schedule import LoadMessage
from dlo_sim.session.observer import Points
from dlo_sim.session.pose_smoothing import Pose
from dlo_sim.session.time_base import SECOND, Decision, Source, TimeBase, Verdict
from dlo_sim.session.topics import InputTopic

# Poses may differ by inputs.max_speed times the time between them, but no more time than this
# counts, plus a little noise.
SPEED_WINDOW, SPEED_SLACK = 0.1, 1e-3  # s, m


@dataclass
class Accepted:
    """A message that is used.

    Attributes:
        poses: end -> pose; loads: load name -> message (one topic may drive several).
        verdict: what its stamp means for everything before it.
        points: measured on the cable.
    """

    poses: dict[str, Pose]
    loads: dict[str, LoadMessage]
    verdict: Verdict
    points: Points | None = None


class _Topic:
    """One topic: what it drives, and what is known of its last messages."""

    def __init__(
        self, entries: tuple[InputTopic, ...], record: TopicRecord, source: Source
    ) -> None:
        self.record = record
        self.source = source
        self.type = entries[0].type
        self.kind = entries[0].kind
        self.is_pose = self.kind == "pose"
        self.entries = entries
        self.loads: tuple[Load, ...] = ()
        self.clear()

    def configure(self, scene: Scene) -> None:
        """Take what the scene says about the targets."""
        targets = [entry.target for entry in self.entries]
        if self.is_pose:
            self.record.timeout = min(scene.holders[target].pose_timeout for target in targets)
        elif self.kind in ("wrench", "force"):
            self.loads = tuple(scene.load(target) for target in targets)
            self.record.timeout = min(load.timeout for load in self.loads)

    def clear(self) -> None:
        """Forget where the last pose was."""
        self.last_position: tuple[float, ...] | None = None
        self.too_fast_since_ns: int | None = None


class Intake:
    """Checks every message of a scene's input topics.

    Args:
        scene: gives limits, frames and signs.
        inputs: the topics it listens to, by their names on the wire.
        time_base: decides by the stamps which messages are used, and where in time.
        journal: where messages are counted.
    """

    def __init__(
        self, scene: Scene, inputs: Sequence[InputTopic], time_base: TimeBase, journal: Journal
    ) -> None:
        self.time_base = time_base
        self._topics: dict[str, _Topic] = {}
        for name, record in journal.topics.items():
            entries = tuple(entry for entry in inputs if entry.topic == name)
            self._topics[name] = _Topic(entries, record, time_base.add_source())
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Take limits, frames, signs and timeouts from this scene; its topics are the same."""
        self._limits = scene.inputs
        self._content = ContentCheck(scene)
        for topic in self._topics.values():
            topic.configure(scene)

    def clear(self) -> None:
        """Take the next poses wherever they are (reset)."""
        for topic in self._topics.values():
            topic.clear()

    def accept(self, name: str, raw: cdr.Bytes, arrival_ns: int) -> list[Accepted]:
        """Check one message; returns what is used now: it, and others that it has waited with.
        Everything refused is counted.

        Raises:
            KeyError: if the scene has no such input topic (a mistake of the caller, not of a
                message).
        """
        topic = self._topics[name]
        topic.record.last_arrival_ns = arrival_ns
        try:
            message = decode_input(topic.type, raw)
            sound = self._content.check(message, topic.kind)
        except cdr.DecodeError as error:
            topic.record.refuse("undecodable", f"{error}; publish {topic.type}")
            return []
        except Refused as refused:
            topic.record.refuse(refused.reason, refused.detail)
            return []
        decisions = self.time_base.sort(topic.source, message.stamp_ns, arrival_ns, sound)
        return self._follow(topic, decisions)

    def due(self, clock_ns: int) -> list[Accepted]:
        """Messages that have waited and are used at this time of the clock [ns]."""
        found: list[Accepted] = []
        for topic in self._topics.values():
            if topic.source.pending:
                found += self._follow(topic, self.time_base.due(topic.source, clock_ns))
        return found

    def refuse_waiting(self) -> None:
        """Nothing more will come that could tell about the messages that still wait."""
        for topic in self._topics.values():
            self._follow(topic, self.time_base.refute(topic.source))

    def _follow(self, topic: _Topic, decisions: Iterable[Decision]) -> list[Accepted]:
        """Use or refuse messages as the time base decides."""
        found = []
        for decision in decisions:
            try:
                found.append(self._use(topic, decision))
            except Refused as refused:
                topic.record.refuse(refused.reason, refused.detail)
                if decision.verdict is Verdict.DECIDE:  # its place does not depend on its content
                    found.append(Accepted({}, {}, decision.verdict))
        return found

    def _use(self, topic: _Topic, decision: Decision) -> Accepted:
        """Note a message that is in time.

        Raises:
            Refused: it is not, or its pose is out of reach.
        """
        if decision.refusal is not None:
            raise decision.refusal
        (values, end), stamp_ns, verdict = decision.content, decision.stamp_ns, decision.verdict
        if verdict is Verdict.START_OVER:
            self.clear()
        if topic.is_pose:
            self._check_speed(topic, values, stamp_ns)
            topic.last_position = values[:3]
        topic.source.last_ns = stamp_ns
        topic.record.accepted += 1
        if topic.is_pose:
            return Accepted(self._poses(topic, values, stamp_ns), {}, verdict)
        if not topic.loads:
            points = Points(stamp_ns, np.reshape(values, (-1, 3)))
            return Accepted({}, {}, verdict, points)
        return Accepted({}, self._loads(topic, values, stamp_ns, end), verdict)

    def _poses(self, topic: _Topic, values: tuple[float, ...], stamp_ns: int) -> dict[str, Pose]:
        px, py, pz, x, y, z, w = values
        pose = Pose(stamp_ns, (px, py, pz), normalized((x, y, z, w)))
        return {entry.target: pose for entry in topic.entries}

    def _loads(
        self, topic: _Topic, values: tuple[float, ...], stamp_ns: int, end: str
    ) -> dict[str, LoadMessage]:
        found = {}
        for load in topic.loads:
            fx, fy, fz, *torque = (load.sign * value for value in values)
            tx, ty, tz = torque or (0.0, 0.0, 0.0)
            found[load.name] = LoadMessage(stamp_ns, (fx, fy, fz), (tx, ty, tz), end)
        return found

    def _check_speed(self, topic: _Topic, values: tuple[float, ...], stamp_ns: int) -> None:
        """Refuse |p - p_last| > inputs.max_speed min(dt, 0.1 s) + 1 mm; p_last = last one used."""
        last, last_stamp = topic.last_position, topic.source.last_ns
        if last is None or last_stamp is None:
            topic.too_fast_since_ns = None
            return
        passed = (stamp_ns - last_stamp) * 1e-9
        distance = math.dist(values[:3], last)
        if distance <= self._limits.max_speed * min(passed, SPEED_WINDOW) + SPEED_SLACK:
            topic.too_fast_since_ns = None
            return
        limit = self._limits.max_speed
        detail = f"pose jumps {distance:.6g} m in {passed:.4g} s, inputs.max_speed is {limit:g} m/s"
        if topic.too_fast_since_ns is None:
            topic.too_fast_since_ns = stamp_ns
        elif stamp_ns - topic.too_fast_since_ns > SECOND:
            since = (stamp_ns - topic.too_fast_since_ns) * 1e-9
            detail += f"; for {since:.1f} s now: if the gripper really is there, call ~/reset"
        raise Refused("too_fast", detail)
