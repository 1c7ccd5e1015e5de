"""A session: messages in, the simulator stepped up to a time, messages out. The live node and the
bag replay are shells of it.

TIME. Inputs count by their header stamps (`inputs.time`). The prediction runs `inputs.latency`
behind the clock, so that poses can be interpolated and loads sorted; arrival jitter below it
changes nothing, not a bit. The simulation never runs ahead of its inputs: if the next pose is
missing it waits, up to `pose_timeout`, and catches up at most `inputs.catch_up` per tick. What
cannot be caught up is skipped, counted and reported. Published states carry the time at which they
hold, converted to the clock.

The session never raises on a message or a tick and never puts out a number that is not finite.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.accuracy import Accuracy
from dlo_sim.session.diagnostics import Journal, session_status, topic_status
from dlo_sim.session.drive import Drive, Prepared, SimulatorFactory
from dlo_sim.session.intake import Accepted, InputTopic, Intake, input_topics
from dlo_sim.session.naming import AS_IN_THE_SCENE, Naming
from dlo_sim.session.outputs import EVERY_OUTPUT, OutgoingMessage, Outputs
from dlo_sim.session.status import SessionStatus, TickReport
from dlo_sim.session.step_grid import OutputGrid
from dlo_sim.session.time_base import SECOND, TimeBase, Verdict

__all__ = ["InputTopic", "OutgoingMessage", "Session", "SessionStatus", "TickReport"]

# Beyond pose_timeout and inputs.catch_up, a simulation this far behind that does not catch up skips
# time instead of falling back for ever [s].
MOST_LAG = 1.0
# A process that stood still catches up with at most so much [s]; what is further back is skipped.
MOST_CATCH_UP = 3.0
# A tick that comes late has not listened meanwhile. No more of that time than this, or two timer
# periods, counts as a silence: messages that waited are handed over between the next ticks [s].
_MOST_LISTENED = 0.1


class Session:
    """One scene being simulated from messages.

    Args:
        scene: what is simulated.
        simulator_factory: builds the simulator, `Simulator` by default: factory(scene,
            end_poses=None).
        naming: what node and topics are called; default: as the scene is written.
        live: a prediction made live, whose error is worth knowing (accuracy.estimate auto).

    Attributes:
        scene: the scene as configured now.
        inputs: the topics it listens to, by their names on the wire.
        journal: counters of everything accepted, refused, held, skipped.

    Raises:
        ValueError: the simulator refuses the scene, or two topics of different types have one name.
    """

    def __init__(
        self,
        scene: Scene,
        simulator_factory: SimulatorFactory | None = None,
        *,
        naming: Naming = AS_IN_THE_SCENE,
        live: bool = False,
    ) -> None:
        if simulator_factory is None:
            # Here, because it brings the compiler along; importing this module must stay light.
            from dlo_sim.simulation.simulator import Simulator

            simulator_factory = Simulator
        self.scene = scene
        self._time = TimeBase(scene.inputs.time)
        self._naming = naming
        self.inputs = tuple(e._replace(topic=naming.topic(e.topic)) for e in input_topics(scene))
        naming.check((*((e.topic, e.type) for e in input_topics(scene)), *EVERY_OUTPUT.items()))
        self.journal = Journal([entry.topic for entry in self.inputs])
        self._intake = Intake(scene, self.inputs, self._time, self.journal)
        self._drive = Drive(scene, simulator_factory, self.journal.event, live)
        self._accuracy = Accuracy(scene, self.journal.event)
        self._outputs = self._new_outputs()
        self._paused = False
        self._resuming = False
        self._failure = ""
        self._waiting: tuple[str, ...] = ()
        self._lag_ns = 0
        self._listened_ns: int | None = None  # up to where a silence would have been noticed
        self._marker_count: int | None = None
        self._given_out: tuple[Any, int] | None = None
        self._markers_due = False
        self._limits()

    @property
    def simulator(self) -> Any:
        """The simulator, for reading; it is replaced on reset and when the scene changes."""
        return self._drive.simulator

    @property
    def started(self) -> bool:
        """Whether the cable has been placed (every driven end has had a pose)."""
        return self._drive.grid is not None

    @property
    def status(self) -> SessionStatus:
        """What the session is doing."""
        if self._failure:
            return SessionStatus.FAILED
        if self._paused:
            return SessionStatus.PAUSED
        return SessionStatus.RUNNING if self.started else SessionStatus.WAITING

    @property
    def offset_ns(self) -> int:
        """Clock minus time base of the stamps [ns]."""
        return self._time.offset_ns

    @property
    def stamp_ns(self) -> int:
        """Time at which the present state holds, on the clock [ns]; needs `started`."""
        return self._time.to_clock(self._drive.now_ns)

    def receive(self, topic: str, raw: cdr.Bytes, arrival_ns: int) -> None:
        """Take one serialised message; a bad one is refused and counted.

        Args:
            topic: its name as in `inputs`.
            raw: CDR bytes.
            arrival_ns: when it came, on the clock [ns].
        """
        self._watch_clock(arrival_ns, tick=False)
        before = self._time.offset_ns
        self._use(self._intake.accept(topic, raw, arrival_ns), before)

    def tick(self, now_ns: int) -> TickReport:
        """Advance the simulation to `now_ns` (clock) minus the latency, down to a multiple of the
        timer period, as far as inputs and limits allow.
        """
        self._watch_clock(now_ns, tick=True)
        before = self._time.offset_ns
        self._use(self._intake.due(now_ns), before)
        count = int(now_ns * 1e-9 * self.scene.outputs.marker_rate)
        self._markers_due, self._marker_count = count != self._marker_count, count
        wanted_ns = self._grid.aim(self._time.from_clock(now_ns) - self._latency_ns)
        if self._paused or self._failure:
            return self._report(0)
        if not self.started and not self._begin(wanted_ns):
            return self._report(0)
        if self._resuming:
            self._resuming = False
            self._drive.skip_to(wanted_ns)
        listened_ns = wanted_ns if self._listened_ns is None else self._listened_ns
        self._listened_ns = min(wanted_ns, listened_ns + self._most_listened_ns)
        steps = self._advance(wanted_ns, self._most_steps, self._listened_ns)
        lag_before, self._lag_ns = self._lag_ns, max(0, wanted_ns - self._drive.now_ns)
        if not self._waiting and not self._failure:
            self._ease(wanted_ns, lag_before)
        return self._report(steps)

    @property
    def fresh(self) -> bool:
        """Whether `messages` has not seen the present state yet."""
        return self.started and self._given_out != (self._drive.simulator, self._drive.now_ns)

    def messages(self, wanted: Collection[str] | None = None) -> list[OutgoingMessage]:
        """The present state as serialised messages; empty until the cable is placed.

        Args:
            wanted: topics to build, whether the state is fresh or not; None = what is due after
                this tick: everything if the state is fresh, the markers at outputs.marker_rate.
                Diagnostics are made by `diagnostics`.
        """
        if not self.started or (wanted is None and not self.fresh):
            return []
        self._given_out = self._drive.simulator, self._drive.now_ns
        markers = self._markers_due or wanted is not None
        found = self._outputs.messages(self._drive.simulator, self.stamp_ns, wanted, markers)
        if self._outputs.not_finite:
            self._outputs.not_finite = 0
            self.journal.event("not_published", "an output was not finite and was not published")
        return found

    def diagnostics(self, now_ns: int, extra: Mapping[str, str] | None = None) -> bytes:
        """A serialised DiagnosticArray: the session, and each input with its refusals by reason.

        Args:
            now_ns: clock [ns].
            extra: more values for the session's status (what only the caller can measure).
        """
        drive = self._drive
        status = session_status(
            self.journal,
            self.status.value,
            self._message(),
            drive.simulator,
            self._accuracy,
            failed=bool(self._failure),
            waiting=not self.started,
            lag=self._lag_ns * 1e-9,
            most_lag=self.scene.inputs.catch_up,
            offset=self._time.offset_ns * 1e-9,
            extra=extra or {},
        )
        topics = [topic_status(record, now_ns) for record in self.journal.topics.values()]
        return cdr.encode_diagnostic_array(now_ns, self._naming.node, [status, *topics])

    def reset(self) -> None:
        """Start over: the cable is placed anew at the next poses (at once if no end is driven),
        loads are forgotten.
        """
        self._time.start_over()
        self._intake.clear()
        self._restart("reset", "reset was called")

    def end_inputs(self) -> None:
        """No message will come any more; those that still wait for their time are refused."""
        self._intake.refuse_waiting()

    def pause(self, flag: bool) -> None:
        """Stop or go on. The time of a pause is not simulated; driven ends rejoin their poses
        smoothly afterwards.
        """
        if self._paused and not flag and self.started:
            self._resuming = True
        self._paused = flag

    def step_once(self) -> TickReport:
        """While paused: advance by one timer period (at least one step). Does nothing unless paused
        and placed.
        """
        if not self._paused or not self.started or self._failure:
            return self._report(0)
        step = self._drive.simulator.step
        steps = max(1, round(1.0 / (self.scene.rate * step)))
        # There is no clock to wait for: an end without a further pose stays at its last one.
        done = self._advance(self._drive.now_ns + round(steps * step * 1e9) + 1, steps, 1 << 62)
        self._markers_due = True
        return self._report(done)

    def prepare(self, scene: Scene) -> Prepared:
        """Build what `reconfigure` needs for other parameters; ticks may go on in another thread.

        Raises:
            ValueError: the topics, loads or driven ends differ, or the simulator refuses the scene.
        """
        now, then = _wiring(self.scene), _wiring(scene)
        if now != then:
            changed = ", ".join(sorted(key for key in now | then if now.get(key) != then.get(key)))
            raise ValueError(
                f"{changed}: cannot change while the session runs; restart with the new scene"
            )
        return self._drive.prepare(scene)

    def reconfigure(self, scene: Scene, prepared: Prepared | None = None) -> None:
        """Continue with other parameters from the same state, between two ticks.

        Args:
            prepared: what `prepare` made for this scene, to lose less time between the ticks.

        Raises:
            ValueError: the topics, loads or driven ends differ, or the simulator refuses the scene;
                nothing is changed.
        """
        if prepared is None:
            prepared = self.prepare(scene)
        self._drive.reconfigure(scene, prepared)
        time_mode_changed = scene.inputs.time != self.scene.inputs.time
        self.scene = scene
        self._intake.configure(scene)
        self._accuracy.configure(scene)
        self._limits()
        self._outputs = self._new_outputs()
        if time_mode_changed:
            self._time.set_mode(scene.inputs.time)
            self.reset()

    def _watch_clock(self, clock_ns: int, tick: bool) -> None:
        back_ns = self._time.watch(clock_ns, tick)
        if back_ns:
            back = back_ns * 1e-9
            self._intake.clear()
            self._restart("time_jump", f"the clock went back by {back:.3f} s; simulation reset")

    def _use(self, found: list[Accepted], offset_before: int) -> None:
        """Hand messages to the drive; the offset may have changed by them."""
        offset = self._time.offset_ns
        verdicts = {accepted.verdict for accepted in found}
        if offset != offset_before:
            self._listened_ns = None
        if offset != offset_before and Verdict.START_OVER not in verdicts:
            self._drive.shift_time(offset_before - offset, inputs=Verdict.DECIDE in verdicts)
        for accepted in found:
            if accepted.verdict is Verdict.START_OVER:
                self._restart("time_jump", "stamps or clock jumped; simulation reset")
            if accepted.verdict is not Verdict.USE and offset and offset != offset_before:
                self._note_epoch(offset)
            for end, pose in accepted.poses.items():
                self._drive.paths[end].add(pose)
            for name, load in accepted.loads.items():
                self._drive.schedules[name].add(load)

    def _note_epoch(self, offset_ns: int) -> None:
        side = "behind" if offset_ns > 0 else "ahead of"
        self.journal.event(
            "other_epoch",
            f"stamps are {abs(offset_ns) * 1e-9:.6g} s {side} the clock; using their own time base",
        )

    def _begin(self, wanted_ns: int) -> bool:
        """Place the cable if every driven end has had a pose; returns whether it is placed."""
        drive = self._drive
        begin_ns = wanted_ns
        if drive.paths:
            ready_ns = drive.ready_ns(wanted_ns)
            if ready_ns is None or ready_ns > wanted_ns:
                return False
            begin_ns = ready_ns
        try:
            drive.begin(begin_ns)
        except ValueError as error:
            self._fail(f"the cable cannot be placed: {error}")
            return False
        self._outputs = self._new_outputs()
        self._limits()
        return True

    def _advance(self, wanted_ns: int, most_steps: int, silence_ns: int) -> int:
        steps, self._waiting, failure = self._drive.advance(wanted_ns, most_steps, silence_ns)
        self._accuracy.look(self._drive.estimate)
        if failure:
            at = self._drive.now_ns * 1e-9
            self._fail(f"{failure} (at {self._drive.simulator.time:.6f} s, stamp {at:.6f} s)")
        return steps

    def _ease(self, wanted_ns: int, lag_before: int) -> None:
        """Keep a simulation that is too slow from falling behind for ever: first without the error
        estimate, then by leaving out time.
        """
        falling = self._lag_ns >= lag_before > self._most_lag_ns // 2
        if falling and self._drive.spare_estimate():
            self.journal.event(
                "estimate_spared",
                "the prediction fell behind and goes on without its error estimate; keep it with "
                "accuracy.estimate: on",
            )
        too_slow = self._lag_ns >= lag_before > self._most_lag_ns
        if too_slow or self._lag_ns > self._most_lag_ns + MOST_CATCH_UP * SECOND:
            skipped = self._drive.skip_to(wanted_ns)
            self.journal.skipped_ns += skipped
            self.journal.event(
                "time_skipped",
                f"{skipped * 1e-9:.3f} s could not be computed in time and were skipped",
            )

    def _fail(self, message: str) -> None:
        self._failure = message
        self.journal.event("failed", message)

    def _restart(self, event: str, detail: str) -> None:
        self._drive.clear()
        self._accuracy.forget()
        self._failure = ""
        self._waiting = ()
        self._lag_ns = 0
        self._listened_ns = None
        self._resuming = False
        self.journal.event(event, detail)

    def _message(self) -> str:
        if self._failure:
            return self._failure
        missing = self._drive.without_pose if not self.started else self._waiting
        if missing:
            order = "first" if not self.started else "next"
            topics = [self._naming.topic(self.scene.ends[name].pose_topic) for name in missing]
            return f"waiting for the {order} pose on {', '.join(dict.fromkeys(topics))}"
        return ""

    def _report(self, steps: int) -> TickReport:
        stop = bool(self._failure) and self.scene.integrator.on_failure == "stop"
        return TickReport(steps, self._lag_ns, self.status, self._message(), stop)

    def _limits(self) -> None:
        """Whole numbers that a tick needs."""
        inputs, step = self.scene.inputs, self._drive.simulator.step
        timeouts = [end.pose_timeout for end in self.scene.ends.values() if end.driven]
        self._latency_ns = round(inputs.latency * SECOND)
        self._grid = OutputGrid(self.scene.rate)
        self._most_steps = max(1, round(max(inputs.catch_up, 1.0 / self.scene.rate) / step))
        self._most_listened_ns = round(max(_MOST_LISTENED, 2.0 / self.scene.rate) * SECOND)
        self._most_lag_ns = round((max([MOST_LAG, *timeouts]) + inputs.catch_up) * SECOND)

    def _new_outputs(self) -> Outputs:
        return Outputs(self.scene, len(self._drive.simulator.greville))


def _wiring(scene: Scene) -> dict[str, object]:
    """Everything that a running session cannot change: key -> value."""
    found: dict[str, object] = {"frame_id": scene.frame_id}
    found |= {f"{name}.pose_topic": end.pose_topic for name, end in scene.ends.items()}
    found["loads.names"] = tuple(load.name for load in scene.loads)
    found |= {f"loads.{load.name}.topic": load.input_topic for load in scene.loads}
    return found | {f"loads.{load.name}.type": load.type for load in scene.loads}
