"""Counters of what happened to messages and to the simulation, with reasons, for diagnostics.

Nothing is dropped, held, skipped or reset without being counted here with one line of text. REP-107
defines the levels OK, WARN, ERROR, STALE.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from dlo_sim.scene.refusal import one_line
from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.simulation.report import DiscretizationError

if TYPE_CHECKING:
    from dlo_sim.scene.description import Scene
    from dlo_sim.simulation.error_estimate import ErrorEstimate

OK, WARN, ERROR, STALE = 0, 1, 2, 3
_MOST_ADVICE = 20
AGAIN = 0.5  # of the target: the error must have fallen below it before an excess counts again
# A clock is wrong if _MANY messages in a row are ahead of it by more than _AHEAD [ns].
_AHEAD, _MANY = 20_000_000, 50

REASONS: dict[str, str] = {
    "undecodable": "not a complete message of the expected type",
    "not_finite": "a NaN or infinite number",
    "too_large": "a force, torque or position beyond inputs.max_force, inputs.max_torque, 1e8 m",
    "bad_quaternion": "an orientation whose norm is not 1",
    "bad_points": "two_points that coincide, are not two, not pose_spacing apart, or exchanged",
    "unknown_frame": "a frame that is neither frame_id nor an end-effector's frame",
    "no_transform": "a frame that tf2 could not take to frame_id within inputs.latency",
    "too_old": "a stamp more than 1 s behind the last one used, or behind the clock before any",
    "in_future": "a stamp more than 0.5 s ahead that later messages did not confirm",
    "out_of_order": "a stamp before one that the simulation has used, or that another message has",
    "too_fast": "a pose that would need more than inputs.max_speed",
    "too_many": "more points than are used (5,000 measured, 20,000 of a plan), a plan while a "
    "hundred wait, or more than 2 contact.markers + 1 markers or 1 MB of them in a message",
    "bad_marker": "a marker that is no obstacle: an ellipsoid, an open mesh, without size, tiny "
    "beside the cable, of another type",
    "bad_plan": "a plan whose joints, times or poses the end effectors cannot follow now",
}
"""The reasons for which messages are refused."""

KNOTS = "knot density"  # key of the diagnostics
EVENTS: dict[str, str] = {
    "other_epoch": "stamps come from another epoch than the clock; their own time base is used",
    "time_jump": "the clock or the stamps jumped; the simulation was reset",
    "silent": "no pose for pose_timeout; the last one is held",
    "rejoined": "poses came back after a silence or a skip; the end returns to them smoothly",
    "no_frame": "a load came without a frame_id and is taken in the world frame",
    "clock_ahead": "all stamps of a topic are ahead of the clock, so that they act too late",
    "units": "poses are so far from the scene that they may be in millimetres",
    "slow_poses": "poses come so slowly or late that outputs are delayed more than by 0.06 s, or "
    "that inputs.latency or pose_timeout is too short for them",
    "late": "a message arrived, or the mesh of a marker was made, after the simulation had passed "
    "its time; it takes effect now, measured points are rejected",
    "full": "more measurements wait than fit; the oldest is lost",
    "too_many": "meshes of markers came faster than they are made; of each obstacle the newest "
    "is made",
    "not_added": "an obstacle was not added: the cable is in it, or contact.markers is reached",
    "jumped": "an obstacle would have to move faster than inputs.max_speed; it stays where it is",
    "not_taken": "a gripper cannot take the cable where it is already held",
    "slipped_out": "the end of the cable has slipped out of a grasp that slides",
    "load_removed": "no message for the load's timeout; the load was removed",
    "time_skipped": "the simulation could not keep up; simulated time was skipped",
    "reset": "reset was called",
    "resumed": "the simulation resumed from the state in state.save_to",
    "failed": "a step failed; the last good state is held",
    "not_published": "an output was not finite and was not published",
    "unresolved": "the stretch of the cable is not what its tension explains: a fold or cusp; or "
    "the energy balance of an explicit method is open",
    "inaccurate": "the estimated error exceeds accuracy.target",
    "slow_newton": "Newton's method took far more iterations in a tick than usual",
    "markers_spared": "the prediction fell behind; markers are no longer published",
    "estimate_spared": "the prediction fell behind; its error is no longer estimated",
    "taken_up": "the prediction keeps up again; what was dropped last is resumed",
}
"""The other events that are counted."""

ADVICE = ("slow_poses", "no_frame", "units", "clock_ahead")
"""Events that say what should be set otherwise; a replay repeats what they say."""


class Refused(Exception):
    """Why a message is not used: a reason (`REASONS`) and one line of detail."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(reason, detail)
        self.reason, self.detail = reason, detail


class SessionStatus(Enum):
    """State of a session; the values are for the user."""

    WAITING = "waiting for the first pose"
    RUNNING = "running"
    PAUSED = "paused"
    FAILED = "failed: the last good state is held, call ~/reset"


class TickReport(NamedTuple):
    """Result of a tick.

    Attributes:
        lag_ns: how far the state is behind the wanted time [ns], because poses are missing or the
            computer is too slow.
        message: one line: why it failed or what it waits for; else "".
        stop: the simulator failed and `integrator.on_failure` is `stop`.
    """

    advanced_steps: int
    lag_ns: int
    status: SessionStatus
    message: str = ""
    stop: bool = False


@dataclass
class TopicRecord:
    """Counters of one input topic.

    timeout: silence that is reported [s], 0 = never. occasional: it is normal to receive nothing.
    copies: repeated messages, as from a second recorder, which are ignored. unframed: frame in
    which messages without a frame_id are taken; empty = there were none. delays_ns: least and
    greatest age of the stamps [ns] on arrival since the last report. ahead: number of messages in a
    row whose stamps were ahead of the clock.
    """

    topic: str
    timeout: float = 0.0
    occasional: bool = False
    accepted: int = 0
    copies: int = 0
    unframed: str = ""
    refused: Counter[str] = field(default_factory=Counter)
    last_refusal: str = ""
    last_arrival_ns: int | None = None
    reported_refusals: int = 0
    delays_ns: tuple[int, int] | None = None
    ahead: int = 0

    @property
    def refusals(self) -> int:
        """Number of messages refused, for any reason."""
        return sum(self.refused.values())

    def note_delay(self, delay_ns: int) -> bool:
        """Note the age of a stamp [ns]; returns whether the topic has just shown to be ahead."""
        least, most = self.delays_ns or (delay_ns, delay_ns)
        self.delays_ns = min(least, delay_ns), max(most, delay_ns)
        self.ahead = self.ahead + 1 if delay_ns < -_AHEAD else 0
        return self.ahead == _MANY

    def refuse(self, reason: str, detail: str) -> None:
        """Count a refused message; `detail` names the value and the cure."""
        assert reason in REASONS, reason
        self.refused[reason] += 1
        self.last_refusal = one_line(f"{reason}: {detail}")


class Journal:
    """The counters of a session; outlives resets.

    Attributes:
        topics: counters of each input. events: name -> number. last_event: its line of text.
        advice: the lines of the events in `ADVICE`, once each. skipped_ns: skipped time [ns].
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.topics = {topic: TopicRecord(topic) for topic in topics}
        self.events: Counter[str] = Counter()
        self.last_event = ""
        self.advice: list[str] = []
        self.skipped_ns = 0
        self._reported = 0

    def event(self, name: str, detail: str) -> None:
        """Count an event; `detail` is one line for the user."""
        assert name in EVENTS, name
        self.events[name] += 1
        self.last_event = detail
        if name in ADVICE and detail not in self.advice and len(self.advice) < _MOST_ADVICE:
            self.advice.append(detail)

    def fresh_events(self) -> int:
        """Number of events since the last call."""
        total = sum(self.events.values())
        fresh, self._reported = total - self._reported, total
        return fresh

    @property
    def accepted(self) -> int:
        """Number of messages used."""
        return sum(record.accepted for record in self.topics.values())

    @property
    def refused(self) -> Counter[str]:
        """Number of messages refused on all topics, by reason."""
        total: Counter[str] = Counter()
        for record in self.topics.values():
            total.update(record.refused)
        return total


class Accuracy:
    """Compares the estimated error of a session with its target.

    Attributes:
        warning: the excess and its cure, one line; empty while the error is acceptable.
        largest, advice: the largest errors so far (None if none were estimated), and their cure.
    """

    def __init__(self, scene: Scene, journal: Journal) -> None:
        self._note = journal.event
        self._target = scene.accuracy.target
        self._estimate: ErrorEstimate | None = None  # of the present
        self._last: ErrorEstimate | None = None  # also once there is no time for it any more
        self._exceeded = False
        self.largest: DiscretizationError | None = None

    def look(self, estimate: ErrorEstimate | None) -> None:
        """Compare the largest error of the last second with the target; None: no estimate."""
        self._estimate = estimate
        if estimate is None:
            self._exceeded = False
            return
        error = estimate.recent
        exceeds = error.total > self._target
        self._keep_largest(error)
        self._last = estimate
        if exceeds and not self._exceeded:
            self._exceeded = True
            self._note("inaccurate", estimate.advice(error))
        elif error.total < AGAIN * self._target:
            self._exceeded = False

    @property
    def warning(self) -> str:
        """The present error and what helps, if it exceeds the target; made when it is asked for."""
        estimate = self._estimate
        if estimate is None or estimate.recent.total <= self._target:
            return ""
        return estimate.advice(estimate.recent)

    @property
    def advice(self) -> str:
        """The same for the largest error so far."""
        if self._last is None or self.largest is None:
            return ""
        return self._last.advice(self.largest)

    def values(self) -> list[tuple[str, str]]:
        """Keys and values for the diagnostics."""
        if self._estimate is None:
            return [("error estimate [m]", "off")]
        error = self._estimate.recent
        return [
            ("error estimate [m]", _shown(error.total)),
            ("time error [m]", _shown(error.time)),
            ("space error [m]", _shown(error.space)),
            ("accuracy target [m]", f"{self._target:g}"),
        ]

    def _keep_largest(self, error: DiscretizationError) -> None:
        before = self.largest
        if before is None:
            self.largest = error
        elif error.time > before.time or error.space > before.space:
            parts = max(error.time, before.time), max(error.space, before.space)
            self.largest = DiscretizationError(*parts, error.unknown or before.unknown)


def _shown(error: float) -> str:
    return f"{error:.3g}" if math.isfinite(error) else "unknown"


def topic_status(record: TopicRecord, now_ns: int) -> DiagnosticStatus:
    """Status of one input topic at this clock time [ns].

    WARN: refusals since the last report, or no message yet. STALE: silent for longer than timeout.
    """
    fresh = record.refusals - record.reported_refusals
    record.reported_refusals = record.refusals
    age = None if record.last_arrival_ns is None else (now_ns - record.last_arrival_ns) * 1e-9
    level, message = OK, "receiving"
    if age is None:
        level, message = OK if record.occasional else WARN, "no message yet"
    elif record.timeout and age > record.timeout:
        level, message = STALE, f"silent for {age:.1f} s"
    if fresh:
        level = max(level, WARN) if level != STALE else STALE
        message = f"{fresh} refused since the last report, last {record.last_refusal}"
    values = [
        ("accepted", str(record.accepted)),
        ("copies ignored", str(record.copies)),
        ("refused", str(record.refusals)),
        *((f"refused {reason}", str(count)) for reason, count in sorted(record.refused.items())),
        ("age [s]", "never" if age is None else f"{age:.3f}"),
    ]
    if record.delays_ns is not None:
        values.append(("delay [s]", " to ".join(f"{ns * 1e-9:.3f}" for ns in record.delays_ns)))
        record.delays_ns = None
    if record.unframed:
        values.append(("frame of messages without frame_id", record.unframed))
    if record.last_refusal:
        values.append(("last refusal", record.last_refusal))
    return DiagnosticStatus(level, f"input {record.topic}", message, tuple(values))
