"""A cable on a node: time, topics, parameters and services around one session.

A callback passes its input on, asks the session to advance to a time, and publishes. All decisions
about messages, ticks and warnings are in `dlo_sim.session`, which the bag replay shares.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockChange, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.parameter import Parameter as NodeParameter
from rclpy.timer import Timer
from std_srvs.srv import SetBool, Trigger

from dlo_sim.compiling.directory import compiling_told_to
from dlo_sim.ros.forecaster import Forecaster
from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.parameters import SceneParameters, check_qos_overrides
from dlo_sim.ros.status import LOG_PAUSE, REPORT_PERIOD, Reports, TickTimes, node_status
from dlo_sim.ros.topics import Publishers, Subscriptions
from dlo_sim.ros.transforms import transforms_of
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.refusal import one_line
from dlo_sim.session.cdr import encode_diagnostic_array
from dlo_sim.session.drive import Prepared
from dlo_sim.session.intake import Transforms
from dlo_sim.session.saved_state import StateKeeper
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.topics import (
    OBSTACLES,
    PLAN,
    Naming,
    input_topics,
    plan_topics,
    possible_outputs,
)
from dlo_sim.simulation.running import Snapshot

_LONGEST_WAIT = 50_000_000  # [ns] for a phase
_STEP_AHEAD = Duration(seconds=1)  # of the clock: the first /clock, a bag that seeks

Result = TypeVar("Result")


class LiveCable:
    """Predicts a cable live, on a node; `failure`: why it must end, one line; or None."""

    def __init__(self, node: GuardedNode, *, read_only: bool = True) -> None:
        """Read the parameters, build and compile the simulator, then open topics and services.

        Args:
            node: whose overrides are the scene; an executor spins it.
            read_only: declare the parameters that the scene fixes so, for the life of the node.

        Raises:
            SceneError: a parameter, the scene or a topic is refused; the node is as before.
        """
        self.failure: str | None = None
        self._node, self._log = node, node.get_logger()
        self._naming = Naming(node.get_fully_qualified_name(), node.resolved)
        self._times = TickTimes()
        self._reports = Reports(self._log)
        self._early: dict[str, bytes] = {}
        self._restarts = 0  # of the session that viewers know of
        self._back_ns = 0  # longest step back of the clock since the last tick
        self._ignores_markers = False  # and has said so
        self._timers: list[Timer] = []  # none while it is not active
        with ExitStack() as opened:
            self._open(opened, read_only)
            self._opened = opened.pop_all()
        self._log.info(f"listens to {', '.join(self._inputs.topics) or 'no topic'}")
        self._log.info(f"publishes {', '.join(self._outputs.topics)}")

    # -- start and end --------------------------------------------------------------------------

    def _open(self, opened: ExitStack, read_only: bool) -> None:
        """Do what `__init__` says; `opened` knows how to undo it."""
        node = self._node
        self._scene_parameters = SceneParameters(node, read_only)
        opened.callback(self._scene_parameters.close)
        scene = self._scene_parameters.scene
        inputs = (entry.topic for entry in (*input_topics(scene), *plan_topics(scene)))
        wire = self._naming.topic
        check_qos_overrides(node, map(wire, inputs), map(wire, possible_outputs(scene)))
        self._keeper = StateKeeper(scene, node.get_logger())
        saved = self._keeper.found(scene)
        opened.callback(self._keeper.release)
        if saved is not None:
            scene = saved.scene
            self._scene_parameters.take_over(scene)
        self._session = self._built(scene, saved, transforms_of(node, scene, opened))
        opened.callback(lambda: self._keeper.close(self._session))
        self._status = self._session.status
        self._period_ns = round(1e9 / scene.rate)
        self._plan_topic = wire(PLAN)
        count = scene.forecast.processes
        self._forecaster = Forecaster(self._session, self._plan_topic, count) if count else None
        if self._forecaster is not None:
            opened.callback(self._forecaster.close)
        try:
            self._outputs = Publishers(node, scene)
            opened.callback(self._outputs.close)
            plans = (entry._replace(topic=self._plan_topic) for entry in plan_topics(scene))
            self._inputs = Subscriptions(node, (*self._session.inputs, *plans), self._receive)
            opened.callback(self._inputs.close)
            self._serve(opened)
        except RuntimeError as error:
            raise SceneError(
                f"ROS cannot open topics and services: {one_line(error)}; correct their names or "
                "the remap rules"
            ) from None
        self._scene_parameters.follow(self._prepare, self._adopt)

    def _built(
        self, scene: Scene, saved: Snapshot | None, transforms: Transforms | None
    ) -> Session:
        """The session, with its machine code loaded."""
        self._log.info("building the simulator")
        begin = time.perf_counter()
        with compiling_told_to(self._log.info):
            session = Session(
                scene, naming=self._naming, transforms=transforms, live=True, resume=saved
            )
        self._log_simulator(session, after=f"; ready after {time.perf_counter() - begin:.1f} s")
        return session

    def _log_simulator(self, session: Session, before: str = "", after: str = "") -> None:
        """Say what the simulator of a session computes and how."""
        simulator = session.simulator
        left_out = "; ".join(f"{name} ({why})" for name, why in simulator.left_out.items())
        summary = (
            f"{simulator.method}, step {simulator.step:.6g} s "
            f"({simulator.choice.reason}); {simulator.resolution}; computes "
            f"{', '.join(simulator.active_terms)}; leaves out {left_out or 'nothing'}"
        )
        self._log.info(f"{before}{summary}{after}")
        for line in simulator.warnings:
            self._log.warning(line)

    def activate(self) -> None:
        """Begin to listen, to tick on the node's clock, and to publish; diagnostics on a steady
        clock.

        After `deactivate` the state continues as after a pause.
        """
        threshold = JumpThreshold(
            min_forward=_STEP_AHEAD, min_backward=Duration(nanoseconds=-1), on_clock_change=True
        )
        self._jump_handle = self._node.get_clock().create_jump_callback(
            threshold, post_callback=self._on_jump
        )
        if self._session.status is SessionStatus.RUNNING:
            self._session.pause(True)
            self._session.pause(False)
        self._times.interrupt()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._reports.begin()
        report = self._node.create_timer(REPORT_PERIOD, self._report_if_due, clock=steady)
        self._timers = [report, self._tick_timer()]

    def deactivate(self) -> None:
        """Stop all of that and keep the state."""
        if self._timers:
            self._jump_handle.unregister()
        while self._timers:
            self._node.destroy_timer(self._timers.pop())

    def close(self) -> None:
        """Keep the state, remove the markers from every viewer, and leave the node as before."""
        self.deactivate()
        self._outputs.say_goodbye(self._now())
        self._opened.close()

    def _tick_timer(self) -> Timer:
        """A timer that fires when states have just become due, for which this waits a little.

        Slow timers, and clocks that do not run at wall time, keep their phase.
        """
        if self._period_ns < _LONGEST_WAIT and not self._node.get_clock().ros_time_is_active:
            time.sleep(self._session.until_tick(self._now()) * 1e-9)
        return self._node.create_timer(self._period_ns * 1e-9, self._on_timer)

    def _serve(self, opened: ExitStack) -> None:
        def serve(kind: type, name: str, answer: Callable[..., Any]) -> None:
            service = self._node.create_service(kind, name, answer)
            opened.callback(self._node.destroy_service, service)

        serve(Trigger, "~/reset", self._on_reset)
        serve(Trigger, "~/step", self._on_step)
        serve(SetBool, "~/pause", self._on_pause)
        for grasp in self._session.scene.grasps:
            answer = partial(self._on_grasp, grasp.name)
            serve(Trigger, f"~/{grasp.name}/take", partial(answer, True))
            serve(Trigger, f"~/{grasp.name}/release", partial(answer, False))

    # -- ticks ----------------------------------------------------------------------------------

    def _now(self) -> int:
        """The node's clock [ns]; 0 while simulated time has not begun."""
        return int(self._node.get_clock().now().nanoseconds)

    def _receive(self, topic: str, raw: bytes) -> None:
        """Pass a serialised message to the session; before the first /clock, keep the newest of a
        topic.
        """
        now = self._now()
        if not self._timers:
            return
        if topic == self._plan_topic and self._forecaster is not None:
            self._forecaster.accept(raw, now)
        elif now == 0:
            self._early[topic] = raw
        else:
            self._session.receive(topic, raw, now)

    def _on_timer(self) -> None:
        """A tick, between two of which no parameters are being changed."""
        self._tick()
        scene = self._session.scene
        if scene is not self._scene_parameters.scene:  # messages let grasps take or release
            self._log_grasps(self._scene_parameters.scene)
            self._scene_parameters.take_over(scene)

    def _tick(self) -> None:
        """Advance the session to now and publish."""
        now = self._now()
        if now == 0 or not self._timers:
            return
        begin = time.perf_counter_ns()
        for topic in list(self._early):
            self._session.receive(topic, self._early.pop(topic), now)
        report = self._session.tick(now)
        self._note_restart()
        stepped = time.perf_counter_ns()
        self._outputs.publish(self._session.messages(*self._outputs.readers()))
        if self._forecaster is not None:
            self._outputs.publish(self._forecaster.answers())
        end = time.perf_counter_ns()
        self._times.record(now, begin, stepped, end, report.advanced_steps, self._period_ns)
        if report.stop:
            self.failure = report.message  # said once, as the reason why the node ends
        elif report.status is not self._status:
            self._status = report.status
            text = report.message or report.status.value
            if report.status is SessionStatus.FAILED:
                self._log.error(f"failed: {text}")
            else:
                self._log.info(text)

    def _on_jump(self, jump: TimeJump) -> None:
        """Start over when the clock was exchanged; steps back are handled by the session's next
        tick.
        """
        self._times.interrupt()
        exchanged = jump.clock_change in (
            ClockChange.ROS_TIME_ACTIVATED,
            ClockChange.ROS_TIME_DEACTIVATED,
        )
        back_ns = -jump.delta.nanoseconds
        if not exchanged and back_ns <= 0:
            return
        self._node.clock_watch.jumps += 1
        if exchanged:
            line = "the clock was exchanged; simulation reset"
            self._log.warning(line)
            self._start_over(line)
        else:
            self._back_ns = max(self._back_ns, back_ns)

    def _start_over(self, jump: str = "") -> None:
        self._early.clear()
        self._session.reset(jump)
        self._note_restart()

    def _note_restart(self) -> None:
        """Remove what viewers show if the session has started over; else, after a jump back, report
        that the cable waits.
        """
        back_ns, self._back_ns = self._back_ns, 0
        if self._session.restarts != self._restarts:
            self._restarts = self._session.restarts
            self._outputs.delete_markers(self._now())
        elif back_ns:
            line = f"the clock went back by {back_ns * 1e-9:.3f} s; the cable waits until then"
            self._log.warning(line, throttle_duration_sec=LOG_PAUSE)

    # -- parameters -----------------------------------------------------------------------------

    def _prepare(self, scene: Scene) -> Prepared:
        """Build the simulator of a changed scene; ticks and inputs continue, only services wait.

        Raises SceneError, in one line, if the simulator refuses the scene.
        """
        with compiling_told_to(self._log.info):
            return in_background(
                lambda: self._session.prepare(scene),
                self._keep_ticking,
                lambda: self._period_ns * 1e-9,
            )

    def _keep_ticking(self) -> None:
        """Do the executor's work in its callback, while changes of parameters follow each other."""
        self._inputs.take_waiting()
        self._tick()
        if self._timers:
            self._report_if_due()

    def _adopt(self, scene: Scene, prepared: Prepared) -> None:
        """Continue with a changed scene between two ticks: one right before and one right after, so
        that nothing else that is done with parameters lies between them.
        """
        self._keep_ticking()
        before, simulator = self._session.scene, self._session.simulator
        self._session.reconfigure(scene, prepared)
        self._outputs.follow(scene)
        if (scene.rate, scene.inputs.latency) != (before.rate, before.inputs.latency):
            self._period_ns = round(1e9 / scene.rate)
            if self._timers:
                self._node.destroy_timer(self._timers.pop())
                self._timers.append(self._tick_timer())
        self._times.interrupt()
        self._tick()
        self._log_grasps(before)
        if self._session.simulator is not simulator:
            self._log_simulator(self._session, before="parameters changed: ")

    def _log_grasps(self, before: Scene) -> None:
        """Say which grasps hold the cable now, and did not, or the other way round."""
        scene, saved = self._session.scene, self._session.saved
        for grasp, was in zip(scene.grasps, before.grasps, strict=True):
            if grasp.taken == was.taken or saved is None:
                continue
            u = saved.geometries[grasp.name].u
            where = "" if u is None else f" at u = {u / scene.cable.length:.2f}"
            verb = "released" if u is None else "took"
            self._log.info(f"{verb} '{grasp.name}'{where}")

    # -- services -------------------------------------------------------------------------------

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """~/reset: place the cable anew and forget the inputs."""
        self._start_over()
        return _answered(response, True, "reset")

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """~/pause: stop (true) or go on (false)."""
        self._session.pause(request.data)
        return _answered(response, True, self._session.status.value)

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """~/step: while paused, advance by one timer period."""
        if not self._timers:
            return _answered(response, False, "not active; activate the node first")
        if self._session.status is not SessionStatus.PAUSED:
            return _answered(response, False, "not paused; call ~/pause with data: true first")
        report = self._session.step_once()
        self._outputs.publish(self._session.messages())
        steps = report.advanced_steps
        message = report.message or (
            f"{steps} steps to {self._session.simulator.time:.6f} s"
            if steps
            else "the cable has not been placed yet; wait for the first pose, or unpause once"
        )
        return _answered(response, steps > 0, message)

    def _on_grasp(
        self, name: str, taken: bool, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """~/<name>/take, ~/<name>/release: set the parameter of a grasp."""
        key = f"grasps.{name}.taken"
        if self._session.scene.grasp(name).taken == taken:
            verb = "holds" if taken else "does not hold"
            return _answered(response, True, f"nothing to do: {name} {verb} the cable")
        (result,) = self._node.set_parameters([NodeParameter(key, NodeParameter.Type.BOOL, taken)])
        message = result.reason or f"{key}: {str(taken).lower()}"
        return _answered(response, result.successful, message)

    # -- diagnostics ----------------------------------------------------------------------------

    def _report_if_due(self) -> None:
        if self._reports.are_due():
            self._report()

    def _report(self) -> None:
        """Publish /diagnostics: what the session counts, and what only the node can measure."""
        now = self._now()
        steady = time.perf_counter_ns()
        self._node.clock_watch.look(now, steady * 1e-9)
        step, sources = self._session.simulator.step, self._inputs.sources()
        statuses = [node_status(self._times, steady, step, self._node.clock_watch, sources)]
        self._outputs.publish_diagnostics(self._session.diagnostics(now))
        if self._forecaster is not None:
            statuses += self._forecaster.statuses(now)
        self._outputs.publish_diagnostics(encode_diagnostic_array(now, self._naming.node, statuses))
        self._keeper.keep(self._session)
        self._reports.log(self._session.journal, sources)
        if not (self._ignores_markers or self._session.scene.contact.markers):
            self._ignores_markers = self._node.count_publishers(OBSTACLES) > 0
            if self._ignores_markers:
                self._log.warning(
                    f"{OBSTACLES}: is published, but adds no obstacle, as contact.markers is 0; "
                    "set it to the largest number of obstacles"
                )


def _answered(response: Any, success: bool, message: str) -> Any:
    response.success, response.message = success, message
    return response


def in_background(
    work: Callable[[], Result], meanwhile: Callable[[], None], period: Callable[[], float]
) -> Result:
    """Call `meanwhile`, then run `work` in a thread and call `meanwhile` until it is done.

    Args:
        work: must not touch what `meanwhile` changes.
        period: time between two calls [s], asked each time.

    Returns:
        The result of `work`. Whatever `work` or `meanwhile` raises, is raised after the thread has
            ended.
    """
    due = time.perf_counter()
    meanwhile()  # some of a period may have gone by since the last call
    with ThreadPoolExecutor(1, "preparing") as pool:
        future = pool.submit(work)
        while True:
            due = max(due + period(), time.perf_counter())
            wait([future], max(due - time.perf_counter(), 0.0))
            if future.done():
                return future.result()
            meanwhile()
