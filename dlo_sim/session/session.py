"""A session takes input messages, steps the simulator up to a time and gives output messages.

The live node and the bag replay are shells around it. Inputs take effect at their header stamps
(`inputs.time`). The prediction runs `inputs.latency` behind the clock, so that poses can be
interpolated and loads sorted; an arrival jitter below that does not change the result by a single
bit. The simulation never runs ahead of its inputs: if the next pose is missing it waits, up to
`pose_timeout`, and then catches up by at most `inputs.catch_up` per tick. Time that cannot be
caught up is skipped, counted and reported. Published states are stamped with their time, converted
to the clock.

The session never raises on a message or a tick, and never outputs a number that is not finite.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING

from dlo_sim.core.bspline import ACTIVE
from dlo_sim.scene.description import Scene, parameters_of
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import (
    ERROR,
    KNOTS,
    OK,
    WARN,
    Accuracy,
    Journal,
    SessionStatus,
    TickReport,
    topic_status,
)
from dlo_sim.session.drive import Drive, Prepared
from dlo_sim.session.gripper_path import Pose
from dlo_sim.session.intake import Intake, Message, Transforms
from dlo_sim.session.outputs import OutgoingMessage, Outputs
from dlo_sim.session.pacing import Latency, Pacing, Shed
from dlo_sim.session.time_base import MOST_AHEAD, TimeBase
from dlo_sim.session.topics import DEFAULT_NAMING, InputTopic, Naming, tf_inputs
from dlo_sim.simulation.resolution import knot_grading

if TYPE_CHECKING:
    from dlo_sim.simulation.obstacles import Contact
    from dlo_sim.simulation.running import Snapshot
    from dlo_sim.simulation.simulator import Simulator


class Session:
    """Simulates one scene from messages.

    Args:
        simulator_factory: builds the simulator, default `Simulator`: factory(scene,
            end_poses=None).
        transforms: looks up frames of tf2; needed if the scene uses them.
        naming: names of the node and its topics; default: not remapped.
        live: whether the prediction must keep up with the clock. resume: a saved state to begin
            with.

    Attributes:
        inputs: the input topics, by their resolved names.
        journal: counts everything accepted, refused, held, skipped.
        restarts: how often it has started over, for whatever reason.

    Raises:
        ValueError: the simulator refuses the scene, or two topics of different types have one name.
    """

    def __init__(
        self,
        scene: Scene,
        simulator_factory: Callable[..., Simulator] | None = None,
        *,
        transforms: Transforms | None = None,
        naming: Naming = DEFAULT_NAMING,
        live: bool = False,
        resume: Snapshot | None = None,
    ) -> None:
        if simulator_factory is None:
            # Imported here because it loads the compiler; importing this module must stay fast.
            from dlo_sim.simulation.simulator import Simulator

            simulator_factory = Simulator
        self._time = TimeBase(scene.inputs.time)
        self._naming = naming
        self.inputs = naming.inputs(scene)
        self._transforms = transforms
        sources = (*self.inputs, *tf_inputs(scene))
        self.journal = Journal([entry.topic for entry in sources])
        self._drive = Drive(scene, simulator_factory, self.journal, live, resume)
        self._latency = Latency(scene, self.journal)
        queues = {entry: self._drive.queue(entry) for entry in sources}
        self._intake = Intake(scene, queues, self._time, self.journal, self._take, transforms)
        self._clock_ns = self._offset_ns = 0  # of the last message or tick
        self._live, self._accuracy = live, Accuracy(scene, self.journal)
        _look_at(self._drive.simulator, scene)
        self._pacing = Pacing(live)
        self._follow_simulator()
        self.restarts = 0
        self._paused = False
        self._resuming = False
        self._next_look = 0
        self._failure = ""
        self._marker_count: int | None = None
        self._given_out: tuple[Simulator, int] | None = None
        self._markers_due = False
        for entry in sources:  # so that no tick waits for what is generated at first use
            cdr.learn(entry.type)
        self.diagnostics(0)

    @property
    def scene(self) -> Scene:
        """The scene as configured now; its grasps are taken or not as messages have told."""
        return self._drive.scene

    @property
    def simulator(self) -> Simulator:
        """The simulator, read-only; replaced when the cable is placed or the scene changes."""
        return self._drive.simulator

    @property
    def started(self) -> bool:
        """Whether the cable has been placed (every driven end has received a pose)."""
        return self._drive.grid is not None

    @property
    def newest_poses(self) -> dict[str, Pose | None]:
        """The last pose received of each driven end; the simulation may not have reached it yet."""
        return {name: path.newest for name, path in self._drive.paths.items()}

    @property
    def saved(self) -> Snapshot | None:
        """A state from which another session of this scene can continue, or None (not placed,
        failed).
        """
        return self._drive.simulator.snapshot() if self.started and not self._failure else None

    @property
    def status(self) -> SessionStatus:
        """State of the session."""
        if self._failure:
            return SessionStatus.FAILED
        if self._paused:
            return SessionStatus.PAUSED
        return SessionStatus.RUNNING if self.started else SessionStatus.WAITING

    @property
    def accuracy(self) -> Accuracy:
        """The estimated errors; anew after `reconfigure`."""
        self._accuracy.look(self._drive.estimate)
        return self._accuracy

    @property
    def offset_ns(self) -> int:
        """Clock minus time base of the stamps [ns]."""
        return self._time.offset_ns

    @property
    def latency_ns(self) -> int:
        """Time by which the prediction runs behind the clock now [ns]."""
        return self._latency.ns

    @property
    def stamp_ns(self) -> int:
        """Clock time of the present state [ns]; needs `started`."""
        return self._time.to_clock(self._drive.now_ns)

    def receive(self, topic: str, raw: cdr.Bytes, arrival_ns: int) -> None:
        """Take one serialised message on a topic of `inputs`; a bad one is refused and counted.

        Args:
            raw: CDR bytes. arrival_ns: clock time of its arrival [ns].
        """
        self._watch_clock(arrival_ns, tick=False)
        self._intake.accept(topic, raw, arrival_ns, self._latency.ns)
        self._follow_offset()

    def until_tick(self, now_ns: int) -> int:
        """Time [ns] from this clock time to the next regular tick, just after a state has become
        due.
        """
        return self._pacing.grid.until_tick(self._due_ns(now_ns))

    def tick(self, now_ns: int) -> TickReport:
        """Advance to `now_ns` (clock) minus the latency, down to a multiple of the timer period, as
        far as inputs and limits allow.
        """
        self._watch_clock(now_ns, tick=True)
        self._intake.look(now_ns, self._latency.ns)
        self._follow_offset()
        self._latency.update()
        pacing, drive = self._pacing, self._drive
        count = int(now_ns * self._marker_rate)
        self._markers_due = count != self._marker_count and Shed.MARKERS not in pacing.shed
        self._marker_count = count
        wanted_ns = pacing.grid.aim(self._due_ns(now_ns))
        if self._paused or self._failure or not (self.started or self._begin(wanted_ns)):
            return self._report(0)
        if self._resuming:
            self._resuming = False
            drive.skip_to(wanted_ns)
        shed = pacing.shed
        steps = self._advance(wanted_ns, pacing.most_steps, pacing.listen(wanted_ns))
        held_up = bool(drive.waiting or self._failure)
        skip = pacing.reached(wanted_ns, drive.now_ns, held_up)
        if pacing.shed != shed:
            self._follow_load(shed)
        if skip:
            skipped = drive.skip_to(wanted_ns)
            self.journal.skipped_ns += skipped
            lost = f"{skipped * 1e-9:.3f} s could not be computed in time and were skipped"
            self.journal.event("time_skipped", lost)
        return self._report(steps)

    @property
    def unresolved(self) -> str:
        """One line if the present shape is no cable's (`simulation.soundness`), else ""."""
        return self._drive.unresolved

    def messages(
        self, wanted: Collection[str] | None = None, again: Collection[str] = ()
    ) -> list[OutgoingMessage]:
        """Serialised messages that are due for the present state; empty until the cable is placed.

        A state is published once, but markers, which expire, at outputs.marker_rate.

        Args:
            wanted: topics to build, None = all. again: topics to build in any case, for new
                subscribers.
        """
        if not self.started:
            return []
        simulator, now_ns = state = self._drive.simulator, self._drive.now_ns
        fresh, self._given_out = state != self._given_out, state
        markers, self._markers_due = self._markers_due, False
        stamp_ns = self._time.to_clock(now_ns)
        messages = self._outputs.messages(simulator, stamp_ns, wanted, again, fresh, markers)
        if self._outputs.not_finite:
            self._outputs.not_finite = 0
            self.journal.event("not_published", "an output was not finite and was not published")
        return messages

    def diagnostics(self, now_ns: int) -> bytes:
        """A serialised DiagnosticArray at this clock time [ns]: the session, and each input."""
        topics = [topic_status(record, now_ns) for record in self.journal.topics.values()]
        message = cdr.encode_diagnostic_array(
            now_ns, self._naming.node, [self._state(now_ns), *topics]
        )
        self._pacing.longest_lag_ns = self._pacing.lag_ns
        return message

    def reset(self, jump: str = "") -> None:
        """Start over: place the cable at the next poses, without the loads received so far.

        Args:
            jump: what has happened to the clock, if that is the reason.
        """
        self._time.start_over()
        self._intake.clear()
        self._restart("time_jump" if jump else "reset", jump or "reset was called")

    def end_inputs(self) -> None:
        """Refuse the messages whose stamps still wait for confirmation, as no more will come."""
        self._intake.refuse_waiting()

    def pause(self, flag: bool) -> None:
        """Pause or resume. A pause is not simulated; driven ends rejoin their poses smoothly after
        it.
        """
        if self._paused and not flag and self.started:
            self._resuming = True
        self._paused = flag

    def step_once(self) -> TickReport:
        """Advance a paused session by one timer period (at least one step); else do nothing."""
        if not self._paused or not self.started or self._failure:
            return self._report(0)
        step = self._drive.simulator.step
        steps = max(1, round(1.0 / (self.scene.rate * step)))
        # There is nothing to wait for: an end without a further pose is held at its last one.
        done = self._advance(self._drive.now_ns + round(steps * step * 1e9) + 1, steps, 1 << 62)
        self._markers_due = True
        return self._report(done)

    def prepare(self, scene: Scene) -> Prepared:
        """Prepare `reconfigure` for other parameters; ticks may continue in another thread.

        Raises ValueError if a read-only parameter differs, or the simulator refuses the scene.
        """
        now, then = _fixed(self.scene), _fixed(scene)
        if now != then:
            changed = ", ".join(sorted(key for key in now | then if now.get(key) != then.get(key)))
            raise ValueError(
                f"{changed}: cannot change while the session runs; restart with the new scene"
            )
        prepared = self._drive.prepare(scene)
        if prepared.simulator is not self._drive.simulator:
            _look_at(prepared.simulator, scene)
        return prepared

    def reconfigure(self, scene: Scene, prepared: Prepared | None = None) -> None:
        """Continue with other parameters from the same state, between two ticks.

        Args:
            prepared: result of `prepare` for this scene, to save time between the ticks.

        Raises:
            ValueError: as `prepare`; nothing is changed.
        """
        if prepared is None:
            prepared = self.prepare(scene)
        time_mode_changed = scene.inputs.time != self.scene.inputs.time
        self._drive.reconfigure(scene, prepared)
        self._intake.configure(scene)
        self._accuracy = Accuracy(scene, self.journal)
        self._latency.configure(scene)
        self._follow_simulator()
        if time_mode_changed:
            self._time.set_mode(scene.inputs.time)
            self._offset_ns = 0
            self.reset("inputs.time was changed; simulation reset")

    def _due_ns(self, now_ns: int) -> int:
        """Time base [ns] up to which states are due at this clock time [ns]."""
        return self._time.from_clock(now_ns) - self._latency.ns

    def _watch_clock(self, clock_ns: int, tick: bool) -> None:
        self._clock_ns, back_ns = clock_ns, self._time.watch(clock_ns, tick)
        if back_ns:
            back = back_ns * 1e-9
            self._intake.clear()
            self._restart("time_jump", f"the clock went back by {back:.3f} s; simulation reset")

    def _take(self, entries: tuple[InputTopic, ...], message: Message, restart: bool) -> None:
        """Note a message that some inputs use; all before it is forgotten if `restart`."""
        if restart:
            line = "stamps or clock jumped; simulation reset"
            self._restart("time_jump" if self.started else "", line)
        stamp_ns, now_ns = message.stamp_ns, self._time.from_clock(self._clock_ns)
        self._drive.hear()
        if isinstance(message, Pose):
            for entry in entries:
                self._latency.accept(entry.target, stamp_ns, now_ns)
        topic = entries[0].topic
        if self.journal.topics[topic].note_delay(now_ns - stamp_ns):
            ahead = (stamp_ns - now_ns) * 1e-9
            self.journal.event(
                "clock_ahead",
                f"{topic}: stamps are {ahead:.3f} s ahead of the clock, and act late by as "
                "much; synchronise the clocks or set inputs.time: arrival",
            )

    def _follow_offset(self) -> None:
        """Note a new offset of the time base."""
        offset, before = self._time.offset_ns, self._offset_ns
        if offset == before:
            return
        self._offset_ns = offset
        self._pacing.listen_anew()
        self._drive.follow_offset(before - offset)
        if offset and abs(offset - before) > MOST_AHEAD:
            side = "behind" if offset > 0 else "ahead of"
            away = f"{abs(offset) * 1e-9:.6g} s {side} the clock"
            self.journal.event("other_epoch", f"stamps are {away}; using their own time base")

    def _begin(self, wanted_ns: int) -> bool:
        """Place the cable if every driven end has received a pose; returns whether it is placed."""
        begin_ns = self._drive.ready_ns(wanted_ns)
        if begin_ns is None or begin_ns > wanted_ns:
            return False
        try:
            resumed = self._drive.begin(begin_ns)
        except ValueError as error:
            self._fail(f"the cable cannot be placed: {error}{self._intake.unit}")
            return False
        if resumed:
            self.journal.event("resumed", "went on from the state in state.save_to")
        self._follow_simulator()
        return True

    def _advance(self, wanted_ns: int, most_steps: int, silence_ns: int) -> int:
        drive, simulator = self._drive, self._drive.simulator
        unresolved, before = drive.unresolved, simulator.steps
        failure = drive.advance(wanted_ns, most_steps, silence_ns)
        if drive.unresolved and not unresolved:
            self.journal.event("unresolved", drive.unresolved)
        if drive.slow:
            self.journal.event("slow_newton", drive.slow)
        # In a replay only where it is told, as refined runs would be waited for.
        if self._live and drive.estimate is not None and simulator.steps >= self._next_look:
            self._next_look = drive.estimate.next_look(simulator.steps)
            self._accuracy.look(drive.estimate)
        if failure:
            at = drive.now_ns * 1e-9
            self._fail(f"{failure} (at {simulator.time:.6f} s, stamp {at:.6f} s)")
        return simulator.steps - before

    def _follow_load(self, before: tuple[Shed, ...]) -> None:
        """Drop or resume what the pacing has dropped or resumed; `before` was dropped before."""
        now = self._pacing.shed
        (changed,) = set(before) ^ set(now)
        if changed is Shed.ESTIMATE:
            follow = self._drive.spare_estimate if changed in now else self._drive.resume_estimate
            if not follow():
                return
        line = f"the prediction keeps up and goes on with {changed.value}"
        event = "taken_up"
        if changed in now:
            event = f"{changed.name.lower()}_spared"
            keep = "; keep it with accuracy.estimate: on" if changed is Shed.ESTIMATE else ""
            line = f"the prediction fell behind and goes on without {changed.value}{keep}"
        self.journal.event(event, line)

    def _fail(self, message: str) -> None:
        self._failure = message
        self.journal.event("failed", message)

    def _restart(self, event: str, detail: str) -> None:
        self.restarts += 1
        self._accuracy.look(self._drive.estimate)
        self._drive.clear()
        self._latency.clear()
        self._accuracy.look(None)
        if self._transforms is not None:
            self._transforms.clear()
        self._failure = ""
        self._pacing.clear()
        self._resuming = False
        if event:
            self.journal.event(event, detail)

    def _message(self) -> str:
        if self._failure:
            return self._failure
        started = self.started
        if missing := self._drive.waiting if started else self._drive.without_pose:
            order = "next" if started else "first"
            moved = [self.scene.moved[name] for name in missing]
            sources = [one.tf_frame or self._naming.topic(one.pose_topic) for one in moved]
            return f"waiting for the {order} pose on {', '.join(dict.fromkeys(sources))}"
        return ""

    def _report(self, steps: int) -> TickReport:
        stop = bool(self._failure) and self.scene.integrator.on_failure == "stop"
        return TickReport(steps, self._pacing.lag_ns, self.status, self._message(), stop)

    def _state(self, now_ns: int) -> cdr.DiagnosticStatus:
        """State, time, energy, lag and events; the message is the first problem, permanent ones
        last.
        """
        drive, journal, simulator = self._drive, self.journal, self._drive.simulator
        self._accuracy.look(drive.estimate)
        lag = self._pacing.longest_lag_ns * 1e-9
        fresh, energy = journal.fresh_events(), simulator.energy()
        contacts = simulator.contacts
        warnings = simulator.warnings_with(contacts)
        level, text = OK, ""
        if self._failure:
            level, text = ERROR, self._failure
        elif drive.unresolved:
            level, text = ERROR, drive.unresolved
        elif not self.started or lag > self.scene.inputs.catch_up:
            level = WARN
        elif self._accuracy.warning:
            level, text = WARN, self._accuracy.warning
        elif fresh:
            level, text = WARN, journal.last_event
        elif warnings:
            level, text = WARN, warnings[0]
        delay = f"{(now_ns - self.stamp_ns) * 1e-9:.4f}" if self.started else "never"
        left_out = "; ".join(f"{name}: {why}" for name, why in simulator.left_out.items())
        values = [
            ("status", self.status.value),
            ("simulated time [s]", f"{simulator.time:.6f}"),
            ("step [s]", f"{simulator.step:.9g}"),
            ("method", simulator.method),
            *_spline_values(simulator),
            ("active terms", ", ".join(simulator.active_terms)),
            ("left out", left_out),
            ("warnings", "; ".join(warnings)),
            ("energy [J]", f"{energy.total:.9g}"),
            ("kinetic energy [J]", f"{energy.kinetic:.9g}"),
            *_contact_values(simulator, contacts.values()),
            *_tension_values(simulator),
            *self._accuracy.values(),
            ("latency [s]", f"{self._latency.ns * 1e-9:.3f}"),
            ("lag [s]", f"{lag:.3f}"),
            ("inputs act after [s]", delay),
            ("skipped [s]", f"{journal.skipped_ns * 1e-9:.3f}"),
            ("clock minus stamps [s]", f"{self._time.offset_ns * 1e-9:.9g}"),
            ("messages used", str(journal.accepted)),
            ("messages refused", str(sum(journal.refused.values()))),
            *((f"event {name}", str(count)) for name, count in sorted(journal.events.items())),
        ]
        if journal.last_event:
            values.append(("last event", journal.last_event))
        if drive.observer is not None:
            values += drive.observer.values()
        text = self._message() or text or self.status.value
        return cdr.DiagnosticStatus(level, "session", text, tuple(values))

    def _follow_simulator(self) -> None:
        """Go on with a simulator that is new or has another scene."""
        scene, simulator = self.scene, self._drive.simulator
        self._outputs = Outputs(scene, *_counts(simulator), node=self._naming.node)
        self._pacing.configure(scene, simulator.step)
        self._marker_rate = 1e-9 * scene.outputs.marker_rate
        self._next_look = 0  # step at which the estimate may have changed


def _spline_values(simulator: Simulator) -> Iterator[tuple[str, str]]:
    """Number of control points, and where the knots lie; of a net as shares of each cable."""
    if not simulator.scene.is_net:
        yield "control points", str(len(simulator.greville))
        yield KNOTS, _density(simulator.scene)
        return
    for part in simulator.model.parts:
        inside = part.model.knots[ACTIVE:-ACTIVE] / part.length
        yield f"control points of {part.name}", str(part.model.n)
        yield f"knots of {part.name}", " ".join(f"{knot:.17g}" for knot in inside)


def _tension_values(simulator: Simulator) -> Iterator[tuple[str, str]]:
    """The peak tension, and of sliding grasps their place and the tension before and after them."""
    if not simulator.scene.without_tension:
        peak = max(curve.tension(curve.greville).max() for curve in simulator.curves.values())
        yield "peak tension [N]", f"{peak:.6g}"
    for name, one in simulator.slides.items():
        yield f"{name} holds [m]", f"{one.u:.6g}"
        yield f"{name} tensions [N]", f"{one.before:.6g}, {one.after:.6g}"


def _contact_values(simulator: Simulator, contacts: Collection[Contact]) -> list[tuple[str, str]]:
    """Forces and clearances of obstacles and of the cable with itself, or only the latter's
    clearance.
    """
    to_itself = [("clearance to itself [m]", f"{simulator.clearance_to_itself:.6g}")]
    if not contacts:
        return to_itself
    forces = [one.exerted for one in contacts]
    return to_itself + [
        ("contact force [N]", f"{sum(forces):.6g}"),
        ("largest contact force [N]", f"{max(forces):.6g}"),
        ("largest contact pressure [N/m]", f"{max(one.pressure for one in contacts):.6g}"),
        ("clearance [m]", f"{min(one.clearance for one in contacts):.6g}"),
    ]


def _look_at(simulator: Simulator, scene: Scene) -> None:
    """Make every output once, as the first one of each kind loads or compiles machine code."""
    outputs = Outputs(scene, *_counts(simulator))
    outputs.messages(simulator, 0)
    simulator.energy()


def _counts(simulator: Simulator) -> list[int]:
    """Numbers of control points of the cables."""
    return [len(curve.greville) for curve in simulator.curves.values()]


def _fixed(scene: Scene) -> dict[str, object]:
    """The parameters that a running session cannot change: key -> value."""
    return {row.key: row.default for row in parameters_of(scene) if row.read_only}


def _density(scene: Scene) -> str:
    """Excess of the knot density at start and end, and the length over which it decays as a
    fraction of the cable's; with it a reader of control points can evaluate the curve.
    """
    start, end, reach = knot_grading(scene)
    return f"{start:.17g} {end:.17g} {reach / scene.cable.length:.17g}"
