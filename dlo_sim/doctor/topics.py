"""What was heard on the topics of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from dlo_sim.doctor.finding import Finding, note, ok, problem
from dlo_sim.session.topics import InputTopic, input_topics, resolved

if TYPE_CHECKING:
    from dlo_sim.ros.survey import Heard, Survey
    from dlo_sim.scene.description import Scene

_SAME_EPOCH = 1.0  # [s]; the node takes stamps that are farther off for those of another epoch


def findings(scene: Scene, found: Survey) -> Iterator[Finding]:
    """Each input topic, then the clock."""
    entries = {resolved(entry.topic): entry for entry in input_topics(scene)}
    if not found.heard:
        yield ok("the scene has no input topics")
    if scene.tf_keys:
        yield note(
            "tf2 is not used here; messages in tf2 frames are counted as refused",
            f"check each frame with: ros2 run tf2_ros tf2_echo {scene.frame_id} FRAME",
        )
    for heard in found.heard:
        yield from _topic(heard, entries[heard.sources.topic])
    if found.simulated_time:
        yield note("/clock is published", "start the node with --ros-args -p use_sim_time:=true")
    if found.offset is not None:
        yield epoch(found.offset, found.simulated_time)


def _topic(heard: Heard, entry: InputTopic) -> Iterator[Finding]:
    topic, kind = heard.sources.topic, heard.sources.type
    for line in heard.sources.problems:
        yield problem(line, "correct the publisher, or the topic name in the scene")
    for line in heard.incompatible:
        yield problem(line, "correct the publisher's QoS")
    if not heard.sources.count:
        cure = f"publish {kind} on it, or change the topic name in the scene"
        if entry.is_pose:
            yield problem(f"nobody publishes {topic}; the node waits for it", cure)
        elif entry.kind == "taken":
            yield note(f"nobody publishes {topic}; '{entry.target}' keeps its state", cure)
        else:
            yield note(f"nobody publishes {topic}; the load is zero", cure)
        return
    if entry.kind == "taken":
        yield ok(f"{topic} is published")
        return
    if not heard.rate:
        yield problem(f"{topic} has a publisher, but too few messages arrived", "check it")
        return
    frames = ", ".join(repr(frame) for frame in heard.frames)
    what = f"{topic}: {heard.rate:.3g} Hz, frame {frames or 'unknown'}"
    if heard.record.refusals:
        refused = f"{heard.record.refusals} refused, last {heard.record.last_refusal}"
        yield problem(f"{what}; {refused}", "see 'Bad input' in config/NODE.md")
    else:
        yield ok(what)
    if heard.record.unframed:
        key = f"loads.{entry.target}.frame"
        yield note(
            f"{topic}: messages without a frame_id are taken in {heard.record.unframed!r}",
            f"set {key} to the frame of an end effector if the sensor turns with it",
        )


def epoch(offset: float, simulated_time: bool) -> Finding:
    """In which time the stamps are; offset: clock minus stamps [s]."""
    clock = "/clock" if simulated_time else "the wall clock"
    if abs(offset) < _SAME_EPOCH:
        return ok(f"stamps agree with {clock}")
    side = "behind" if offset > 0.0 else "ahead of"
    return note(
        f"stamps are {abs(offset):.6g} s {side} {clock}",
        "with inputs.time auto the node uses the time base of the stamps; to use one clock, play "
        "bags with --clock and set use_sim_time",
    )
