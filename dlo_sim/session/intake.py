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
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from dlo_sim.core.one_rotation import normalized
from dlo_sim.scene.description import Load, Scene
from dlo_sim.session import cdr
from dlo_sim.session.content import ContentCheck, Refused
from dlo_sim.session.diagnostics import Journal, TopicRecord
from dlo_sim.session.load_schedule import LoadMessage
from dlo_sim.session.pose_smoothing import Pose
from dlo_sim.session.time_base import SECOND, TimeBase

# A stamp may be this far ahead of its arrival (two clocks that are not quite synchronised), and
# this far behind.
MOST_AHEAD = SECOND // 2
MOST_BEHIND = 1 * SECOND

# A jump back of stamps counts as a jump (and not as stray messages) when so many messages in a row
# agree on it.
JUMP_AGREEMENT = 3

# Poses may differ by inputs.max_speed times the time between them, but no more time than this
# counts, plus a little noise.
SPEED_WINDOW, SPEED_SLACK = 0.1, 1e-3  # s, m

_CURE = "synchronise the clocks or set inputs.time: arrival"

_TYPES = {
    "pose": cdr.POSE_STAMPED,
    "wrench": cdr.WRENCH_STAMPED,
    "force": cdr.VECTOR3_STAMPED,
}


class InputTopic(NamedTuple):
    """A topic that the scene listens to.

    Attributes:
        topic: name as in the scene, `~/...` not resolved.
        kind: `pose`, `wrench` or `force`.
        target: `start` or `end` for a pose, the load's name otherwise.
    """

    topic: str
    kind: str
    target: str

    @property
    def type(self) -> str:
        """ROS message type, for example geometry_msgs/msg/PoseStamped."""
        return _TYPES[self.kind]


def input_topics(scene: Scene) -> tuple[InputTopic, ...]:
    """Every topic that this scene listens to, poses first; a topic may drive several targets."""
    found = [InputTopic(e.pose_topic, "pose", name) for name, e in scene.ends.items() if e.driven]
    found += [InputTopic(x.input_topic, x.type, x.name) for x in scene.loads if x.input_topic]
    return tuple(found)


@dataclass
class Accepted:
    """A message that is used.

    Attributes:
        poses: end -> pose; loads: load name -> message (one topic may drive several).
        restart: the stamps have jumped back: reset first.
    """

    poses: dict[str, Pose]
    loads: dict[str, LoadMessage]
    restart: bool


class _Topic:
    """One topic: what it drives, and what is known of its last messages."""

    def __init__(self, entries: tuple[InputTopic, ...], record: TopicRecord) -> None:
        self.record = record
        self.type = entries[0].type
        self.is_pose = entries[0].kind == "pose"
        self.entries = entries
        self.loads: tuple[Load, ...] = ()
        self.clear()

    def configure(self, scene: Scene) -> None:
        """Take what the scene says about the targets."""
        targets = [entry.target for entry in self.entries]
        if self.is_pose:
            self.record.timeout = min(scene.ends[target].pose_timeout for target in targets)
        else:
            self.loads = tuple(scene.load(target) for target in targets)
            self.record.timeout = min(load.timeout for load in self.loads)

    def clear(self) -> None:
        """Forget the last messages."""
        self.last_stamp_ns: int | None = None
        self.last_position: tuple[float, ...] | None = None
        self.too_fast_since_ns: int | None = None
        self.strays: list[tuple[int, int]] = []


class Intake:
    """Checks every message of a scene's input topics.

    Args:
        scene: gives topics, limits, frames and signs.
        time_base: converts stamps; decided by the first sound stamped message.
        journal: where messages are counted.
    """

    def __init__(self, scene: Scene, time_base: TimeBase, journal: Journal) -> None:
        self.inputs = input_topics(scene)
        self.time_base = time_base
        names = dict.fromkeys(entry.topic for entry in self.inputs)
        self._topics = {
            name: _Topic(tuple(e for e in self.inputs if e.topic == name), journal.topics[name])
            for name in names
        }
        self._used_since_stray = False
        self.configure(scene)

    def configure(self, scene: Scene) -> None:
        """Take limits, frames, signs and timeouts from this scene; its topics are the same."""
        self._limits = scene.inputs
        self._content = ContentCheck(scene)
        for topic in self._topics.values():
            topic.configure(scene)

    def clear(self) -> None:
        """Forget the last messages, so that the next ones are taken wherever they are (reset)."""
        for topic in self._topics.values():
            topic.clear()

    def shift_time(self, delta_ns: int, decided_by: str) -> None:
        """Relabel the last stamps by delta [ns], except that of the topic whose message decided the
        time base.
        """
        for name, topic in self._topics.items():
            if topic.last_stamp_ns is not None and name != decided_by:
                topic.last_stamp_ns += delta_ns

    def accept(self, name: str, raw: cdr.Bytes, arrival_ns: int) -> Accepted | None:
        """Check one message; None = refused and counted.

        Raises:
            KeyError: if the scene has no such input topic (a mistake of the caller, not of a
                message).
        """
        topic = self._topics[name]
        topic.record.last_arrival_ns = arrival_ns
        try:
            message = cdr.decode(topic.type, raw)
            end = self._content.check(message, topic.is_pose)
            stamp_ns, restart = self._check_time(topic, message, arrival_ns)
            if topic.is_pose:
                self._check_speed(topic, message.values, stamp_ns, restart)
        except cdr.DecodeError as error:
            topic.record.refuse("undecodable", f"{error}; publish {topic.type}")
            return None
        except Refused as refused:
            topic.record.refuse(refused.reason, refused.detail)
            return None
        topic.record.accepted += 1
        topic.last_stamp_ns = stamp_ns
        if topic.is_pose:
            topic.last_position = message.values[:3]
            return Accepted(self._poses(topic, message.values, stamp_ns), {}, restart)
        return Accepted({}, self._loads(topic, message.values, stamp_ns, end), restart)

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

    def _check_time(self, topic: _Topic, message: cdr.Stamped, arrival_ns: int) -> tuple[int, bool]:
        """Place the message in the time base; returns its stamp there and whether time has jumped
        back.
        """
        base = self.time_base
        if not base.uses_stamp(message.stamp_ns):
            stamp_ns = base.from_clock(arrival_ns)
            self._check_order(topic, stamp_ns)
            return stamp_ns, False
        stamp_ns = message.stamp_ns
        base.decide(stamp_ns, arrival_ns)
        try:
            ahead = stamp_ns - base.from_clock(arrival_ns)
            if ahead > MOST_AHEAD:
                raise Refused(
                    "in_future", f"stamp is {ahead * 1e-9:.3f} s ahead of its arrival; {_CURE}"
                )
            if -ahead > MOST_BEHIND:
                raise Refused(
                    "too_old", f"stamp is {-ahead * 1e-9:.3f} s behind its arrival; {_CURE}"
                )
            self._check_order(topic, stamp_ns)
        except Refused as refused:
            if self._jumped(topic, refused.reason, stamp_ns, arrival_ns):
                base.forget()
                base.decide(stamp_ns, arrival_ns, MOST_AHEAD)
                self.clear()
                return stamp_ns, True
            raise
        base.confirm()
        topic.strays.clear()
        self._used_since_stray = True
        return stamp_ns, False

    def _check_order(self, topic: _Topic, stamp_ns: int) -> None:
        last = topic.last_stamp_ns
        if last is not None and stamp_ns <= last:
            raise Refused(
                "out_of_order",
                f"stamp is {(last - stamp_ns) * 1e-9:.6f} s before the last one used",
            )

    def _jumped(self, topic: _Topic, reason: str, stamp_ns: int, arrival_ns: int) -> bool:
        """Whether the stamps have started over (a bag loops, a clock was set back, the first stamp
        was nonsense).

        True when JUMP_AGREEMENT messages of one topic in a row are more than 1 s back, follow each
        other in time as they arrived,
        and no stamped message of any topic was used meanwhile: one source must not undo what the
        others agree on. Stamps in the future count only while the offset rests on a single message.
        """
        last = topic.last_stamp_ns
        near = reason == "out_of_order" and last is not None and last - stamp_ns <= MOST_BEHIND
        forward = reason == "in_future" and self.time_base.confirmed
        fixed = reason != "out_of_order" and self.time_base.mode != "auto"
        if near or forward or fixed:
            topic.strays.clear()
            return False
        if topic.strays:
            stamp_before, arrival_before = topic.strays[-1]
            passed, arrived = stamp_ns - stamp_before, arrival_ns - arrival_before
            if passed <= 0 or abs(passed - arrived) > MOST_AHEAD or self._used_since_stray:
                topic.strays.clear()
        if not topic.strays:
            self._used_since_stray = False
        topic.strays.append((stamp_ns, arrival_ns))
        return len(topic.strays) >= JUMP_AGREEMENT

    def _check_speed(
        self, topic: _Topic, values: tuple[float, ...], stamp_ns: int, restart: bool
    ) -> None:
        """Refuse |p - p_last| > inputs.max_speed min(dt, 0.1 s) + 1 mm; p_last = last one used."""
        last, last_stamp = topic.last_position, topic.last_stamp_ns
        if last is None or last_stamp is None or restart:
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
