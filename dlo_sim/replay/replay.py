"""Replay: a recorded bag through a session into a new bag, offline and deterministic.

Ticks follow the scene's rate in the time of the bag (the time of recording counts as arrival), so
that a replay computes what the node would have computed live, bit for bit wherever arrival jitter
stayed below `inputs.latency`. Nothing of the wall clock gets into the output.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dlo_sim.replay.bags import Bag, BagError, BagWriter, topic_list
from dlo_sim.replay.comparison import AxisComparison, ForceSeries, compare_reaction
from dlo_sim.replay.storage import Record
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import Refusal
from dlo_sim.session import cdr
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import DIAGNOSTICS, input_topics, output_topics, reactions, resolved

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

_DIAGNOSTICS_PERIOD = 1 * SECOND
LONGEST_GAP = 600 * SECOND  # in a recording, after which the session starts over
_PROGRESS_TICKS = 100
_OPENING = 0.1  # of the progress, for opening the bag
MOST_REFUSED = 0.05  # of a topic's messages; beyond it a replay is `refused`, not `done`


@dataclass
class ReplayFigures:
    """How a replay ended, and its numbers.

    Attributes:
        status: `done`; `truncated`: the bag is damaged, its readable part was used; `diverged`: the
            simulator failed; `refused`: more than 5 % of the messages of a topic were refused;
            `unresolved`: at some time the shape was no cable's; `output_incomplete`: the disk was
            full, the output holds what was written until then.
        message: one line that explains any status but `done`, else "".
        messages_used, messages_written: input and output messages.
        simulated_s, wall_s, compile_s: simulated time; wall time for reading, stepping and writing;
            wall time for building the simulator [s]. real_time_factor: simulated_s / wall_s.
    """

    status: str = "done"
    message: str = ""
    messages_used: int = 0
    messages_written: int = 0
    simulated_s: float = 0.0
    wall_s: float = 0.0
    compile_s: float = 0.0
    real_time_factor: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether the whole bag was replayed, and used but for a few messages."""
        return self.status == "done"


@dataclass
class ReplaySummary(ReplayFigures):
    """The results of a replay.

    Attributes:
        output: the bag written.
        messages_copied: input messages that were recorded twice, and ignored.
        messages_refused, refused_by_reason: of the input; refused_by_topic: topic -> reason ->
            number.
        events: what else was counted (silences, resets, ...). ticks: of the session.
        comparison: end -> rows per axis, for the ends asked for.
        warnings: one line each. resolution: how many control points, and why.
        error_estimate: largest estimated position errors [m]: `time`, `space`, `total` (None =
            unknown); None if errors were not estimated (accuracy.estimate).
        advice: the error if it exceeds accuracy.target, and its cure, one line; else empty.
    """

    output: str = ""
    messages_copied: int = 0
    messages_refused: int = 0
    refused_by_reason: dict[str, int] = field(default_factory=dict)
    refused_by_topic: dict[str, dict[str, int]] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    ticks: int = 0
    comparison: dict[str, list[AxisComparison]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    resolution: str = ""
    error_estimate: dict[str, float | None] | None = None
    advice: str = ""


class ReplayError(Refusal):
    """A replay that is refused: one line names bag or topic and the cure. Nothing was written."""


def replay_bag(
    bag: str | os.PathLike[str],
    scene: Scene,
    output: str | os.PathLike[str] | None,
    *,
    compare: Mapping[str, str] | None = None,
    progress: Callable[[float], None] | None = None,
    simulator_factory: Callable[..., Simulator] | None = None,
) -> ReplaySummary:
    """Replay a bag through a scene into a new bag of the same storage.

    Args:
        bag: rosbag2 directory, `.mcap` or `.db3` file.
        scene: its topics are looked up in the bag, `~/x` as `/dlo_sim/x`.
        output: directory to create; must not exist.
        compare: end (`start`, `end`) -> recorded WrenchStamped topic, load of the cable on the
            robot, to compare the predicted reaction with.
        progress: called with the fraction done. simulator_factory: as for `Session`.

    Raises:
        ReplayError: refused input or output, before anything is written; or no usable message.
        ValueError: the simulator refuses the scene.
    """
    compare = dict(compare or {})
    say = progress or (lambda fraction: None)
    try:
        source = Bag(bag, lambda fraction: say(_OPENING * fraction))
        wanted = _wanted_topics(source, scene, compare)
        outputs = {resolved(topic): kind for topic, kind in output_topics(scene).items()}
        writer = None if output is None else BagWriter(output, outputs, source.storage)
        try:
            run = _Replay(source, scene, writer, compare, say, simulator_factory)
            run.execute(wanted)
            summary = run.summary
            if not summary.simulated_s:
                raise ReplayError(run.why_nothing())
            if writer is not None:
                writer.finish()
                if writer.failure:
                    summary.status, summary.message = "output_incomplete", writer.failure
                    summary.messages_written = _readable(writer.path)
        except BaseException:
            if writer is not None:
                writer.discard()
            raise
    except BagError as error:
        raise ReplayError(str(error)) from None
    summary.output = "" if output is None else str(output)
    return summary


def _readable(bag: Path) -> int:
    """Number of messages in an incomplete bag."""
    try:
        return Bag(bag).count
    except BagError:
        return 0


def _wanted_topics(bag: Bag, scene: Scene, compare: Mapping[str, str]) -> dict[str, str]:
    """Topic -> type of everything to be read; refuses a bag that cannot drive the scene."""
    if not bag.count:
        raise ReplayError(f"bag {bag.path} is empty: there is no message in it")
    for key, frame in scene.followed_frames.items():
        raise ReplayError(
            f"{key}: '{frame}' is looked up in tf2, which a replay has not; record its pose on a "
            f"topic and give {key.rpartition('.')[0]}.pose_topic"
        )
    present = topic_list(bag.topics)
    inputs = {resolved(entry.topic): entry.type for entry in input_topics(scene)}
    if not inputs:
        raise ReplayError(
            "the scene listens to no topic: give an end a pose_topic or add a load with a topic"
        )
    for end, topic in compare.items():
        if end not in scene.holders:
            known = ", ".join(scene.holders)
            raise ReplayError(
                f"compare '{end}': nothing of that name holds the cable; give {known}"
            )
        if not scene.holders[end].held:
            raise ReplayError(
                f"compare '{end}': this end is free and has no reaction; hold it or do not compare"
            )
        if resolved(topic) not in bag.topics:
            raise ReplayError(
                f"compare: no topic {resolved(topic)} in bag {bag.path}; it has {present}"
            )
    wanted = inputs | {resolved(topic): cdr.WRENCH_STAMPED for topic in compare.values()}
    for topic, kind in wanted.items():
        types = bag.topics.get(topic, (kind,))
        if kind not in types:
            raise ReplayError(
                f"topic {topic} of bag {bag.path} is {', '.join(types)}, the scene needs {kind}"
            )
    if not any(topic in bag.topics for topic in inputs):
        names = ", ".join(inputs)
        raise ReplayError(f"bag {bag.path} has no message on {names}; it has {present}")
    driven = [resolved(entry.topic) for entry in input_topics(scene) if entry.is_pose]
    missing = [topic for topic in driven if topic not in bag.topics]
    if missing:
        raise ReplayError(f"bag {bag.path} has no pose on {', '.join(missing)}; it has {present}")
    return wanted


class _Replay:
    """One replay being run."""

    def __init__(
        self,
        bag: Bag,
        scene: Scene,
        writer: BagWriter | None,
        compare: Mapping[str, str],
        progress: Callable[[float], None],
        factory: Callable[..., Simulator] | None,
    ) -> None:
        self.summary = ReplaySummary()
        self._unresolved = ""  # the first line about a shape that is no cable's
        self._bag, self._scene, self._writer = bag, scene, writer
        self._progress = progress
        begin = time.perf_counter()
        self._session = Session(scene, factory)
        self.summary.compile_s = time.perf_counter() - begin
        self._inputs = {entry.topic for entry in self._session.inputs}
        self._names = {topic: resolved(topic) for topic in output_topics(scene)}
        if bag.undated:
            some = f"{bag.undated} of {bag.count} messages were recorded at time 0"
            how = "before /clock began; they count as recorded with the first that has a time, or "
            self.summary.warnings.append(
                f"{some}; they count as recorded at their stamps"
                if bag.undated == bag.count
                else f"{some}, {how}with the one written before them"
            )
        # Without an output only what is compared has to be computed.
        self._predicted_on = {end: reactions(scene)[end] for end in compare}
        self._wanted = None if writer is not None else list(self._predicted_on.values())
        self._recordings = {resolved(topic): ForceSeries(end) for end, topic in compare.items()}
        self._predictions = {topic: ForceSeries(end) for end, topic in self._predicted_on.items()}

    def execute(self, wanted: Mapping[str, str]) -> None:
        """Run to the end of the bag and fill the summary."""
        begin = time.perf_counter()
        with suppress(BagError):  # the disk is full; the writer says so when it is finished
            self._run(self._bag.messages(wanted))
            self._session.end_inputs()
        summary, journal = self.summary, self._session.journal
        summary.wall_s = time.perf_counter() - begin
        summary.real_time_factor = summary.simulated_s / summary.wall_s
        summary.messages_used = journal.accepted
        summary.messages_copied = sum(record.copies for record in journal.topics.values())
        summary.refused_by_reason = dict(sorted(journal.refused.items()))
        summary.messages_refused = sum(summary.refused_by_reason.values())
        summary.warnings += journal.advice
        summary.events = dict(sorted(journal.events.items()))
        summary.resolution = self._session.simulator.resolution
        accuracy = self._session.accuracy
        if accuracy.largest is not None:
            summary.error_estimate = accuracy.largest.numbers
        summary.advice = accuracy.advice
        if self._bag.damage and summary.status == "done":
            read, promised = self._bag.count, self._bag.promised
            of = f" of {promised}" if promised is not None else ""
            first, last = self._bag.span_ns
            summary.status = "truncated"
            summary.message = (
                f"bag {self._bag.path} is damaged ({self._bag.damage}); {read}{of} messages could "
                f"be read, {(last - first) * 1e-9:.3f} s"
            )
        self._report_refusals()
        if self._unresolved:
            self._add("unresolved", self._unresolved)
        self._compare()

    def _add(self, status: str, why: str) -> None:
        """Add why the prediction is not what was asked for; the first reason is the status."""
        summary = self.summary
        summary.status = status if summary.status == "done" else summary.status
        summary.message = "; ".join(filter(None, [summary.message, why]))

    def _report_refusals(self) -> None:
        """A prediction that lacks more than a few messages of a topic is not what was asked for."""
        summary = self.summary
        records = {r.topic: r for r in self._session.journal.topics.values() if r.refusals}
        summary.refused_by_topic = {
            topic: dict(sorted(record.refused.items())) for topic, record in sorted(records.items())
        }
        lacking = [
            f"{r.topic}: {r.refusals} of {r.refusals + r.accepted} messages refused, "
            f"last {r.last_refusal}"
            for r in records.values()
            if r.refusals > MOST_REFUSED * (r.refusals + r.accepted)
        ]
        if lacking:
            self._add("refused", "; ".join(lacking))

    def _run(self, messages: Iterator[Record]) -> None:
        """Receive, tick, write, until the bag is exhausted and its last stamp simulated."""
        session, summary = self._session, self.summary
        period = 1e9 / self._scene.rate
        message = next(messages, None)
        if message is None:
            return
        first, last = self._bag.span_ns
        origin = now = latest = message.time_ns
        self._next_diagnostics_ns = origin + _DIAGNOSTICS_PERIOD
        count = 0

        def simulated() -> bool:
            """Whether all that has been handed over is simulated."""
            return now > latest + session.latency_ns + round(period)

        while message is not None or not simulated():
            while message is not None and message.time_ns <= now:
                latest = max(latest, message.time_ns)
                self._take(message, latest)
                message = next(messages, None)
            self._tick(now)
            if summary.status == "diverged":
                return
            if summary.ticks % _PROGRESS_TICKS == 0:
                done = min(1.0, (now - first) / max(1, last - first))
                self._progress(_OPENING + (1.0 - _OPENING) * done)
            count += 1
            now = origin + round(count * period)
            if message is not None and message.time_ns - now > LONGEST_GAP and simulated():
                gap = (message.time_ns - latest) * 1e-9
                summary.warnings.append(
                    f"a gap of {gap:.1f} s in the bag was left out; simulation reset"
                )
                session.reset()
                origin = now = latest = message.time_ns
                self._next_diagnostics_ns = now + _DIAGNOSTICS_PERIOD
                count = 0
        self._progress(1.0)

    def _take(self, message: Record, arrival_ns: int) -> None:
        """Hand over a message; one out of the order of recording arrives when it was written."""
        if message.topic in self._inputs:
            self._session.receive(message.topic, message.data, arrival_ns)
        recording = self._recordings.get(message.topic)
        if recording is not None:
            try:
                stamped = cdr.decode(cdr.WRENCH_STAMPED, message.data)
            except cdr.DecodeError:
                return
            if all(np.isfinite(stamped.values)):
                recording.frames.add(stamped.frame_id)
                recording.add(stamped.stamp_ns or message.time_ns, stamped.values[:3])

    def _tick(self, now: int) -> None:
        session, summary, writer = self._session, self.summary, self._writer
        report = session.tick(now)
        summary.ticks += 1
        summary.simulated_s += report.advanced_steps * session.simulator.step
        for topic, _, stamp_ns, data in session.messages(self._wanted):
            if writer is not None:
                writer.write(self._names[topic], now, data)
                summary.messages_written += 1
            if topic in self._predictions:
                force = np.frombuffer(data, "<f8", 3, len(data) - 48)
                self._predictions[topic].add(stamp_ns - session.offset_ns, force)
        if now >= self._next_diagnostics_ns:
            self._next_diagnostics_ns += _DIAGNOSTICS_PERIOD
            if writer is not None:
                writer.write(DIAGNOSTICS, now, session.diagnostics(now))
                summary.messages_written += 1
        self._unresolved = self._unresolved or session.unresolved
        if report.status is SessionStatus.FAILED:
            summary.status = "diverged"
            summary.message = report.message

    def _compare(self) -> None:
        """Fill in the comparison of every end asked for."""
        for recording in self._recordings.values():
            prediction = self._predictions[self._predicted_on[recording.end]]
            strange = recording.frames - {"", self._scene.frame_id}
            if strange:
                self.summary.warnings.append(
                    f"compare {recording.end}: recorded in frame {', '.join(sorted(strange))}, "
                    f"predicted in {self._scene.frame_id}; compared as if they were the same"
                )
            try:
                rows = compare_reaction(*prediction.arrays(), *recording.arrays())
            except ValueError as error:
                self.summary.warnings.append(f"compare {recording.end}: {error}")
            else:
                self.summary.comparison[recording.end] = rows

    def why_nothing(self) -> str:
        """One line for a replay without output."""
        if self.summary.status == "diverged":
            return f"nothing could be simulated: {self.summary.message}"
        records = [r for r in self._session.journal.topics.values() if r.refusals]
        reasons = "; ".join(
            f"{r.topic}: {r.refusals} refused, last {r.last_refusal}" for r in records
        )
        if not reasons:
            return (
                f"bag {self._bag.path} is too short: {self.summary.messages_used} of its messages "
                "are for the scene, and nothing could be simulated between them"
            )
        return f"no message of bag {self._bag.path} could be used ({reasons})"
