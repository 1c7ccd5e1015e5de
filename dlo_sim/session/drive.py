"""One simulator on the grid of its steps; end motions and inputs are applied at exactly the steps
where they begin.

The drive owns time: `session.py` says how far it advances, the queues hand out what is due, and
from here it goes into the simulator. When an input acts is decided here, from stamps only, so that
the same messages give the same bits however the advance is divided into ticks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError, one_line
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.gripper_path import (
    GripperPath,
    Segment,
    StepGrid,
    grid_multiple_at_or_after,
)
from dlo_sim.session.markers import Surroundings
from dlo_sim.session.observer import Observer
from dlo_sim.session.topics import InputTopic
from dlo_sim.session.waiting import LoadMessage, LoadSchedule, TakeMessage, Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.report import Report
    from dlo_sim.simulation.running import Snapshot
    from dlo_sim.simulation.simulator import Simulator

_ZERO = (0.0, 0.0, 0.0)
_NEVER = sys.maxsize


class Prepared(NamedTuple):
    """A simulator of another scene to continue with, and the estimate of its error if there is one.

    before: the scene that was simulated when this was prepared.
    """

    before: Scene
    simulator: Simulator
    estimate: ErrorEstimate | None


class Drive:
    """A simulator, the paths of its driven ends, the queues of its inputs, and the grid of its
    steps.

    Args:
        scene: what is simulated.
        factory: builds the simulator: factory(scene, end_poses=None).
        journal: counts what happens to inputs.
        live: whether it must keep up with the clock.
        saved: a state to begin with.

    Attributes:
        scene: what is simulated now; its grasps are taken or not as messages have told.
        simulator: the simulator; placed by `begin`.
        estimate: of the error of the simulator; None if errors are not estimated.
        unresolved: one line if a shape or the energy of the last advance was no cable's
            (`simulation.soundness`), else "".
        waiting: ends that wait for a pose, since the last advance; slow: a note of it, or "".
        surroundings: obstacles from markers; None if the scene takes none.
        observer: corrects the simulator by measurements; None if the scene has no measured points.
        grid: times of the steps; None before `begin`.
    """

    def __init__(
        self,
        scene: Scene,
        factory: Callable[..., Simulator],
        journal: Journal,
        live: bool = False,
        saved: Snapshot | None = None,
    ) -> None:
        scene = replace(scene, added=())  # as of a state to go on from, which adds them again
        self._factory, self._saved, self._live = factory, saved, live
        self.simulator = self._not_begun(scene)
        self.estimate: ErrorEstimate | None = None
        self.unresolved = ""
        self._too_slow = False
        self._rebuilt = False  # whether the simulator's initial state differs from the scene's
        self.scene = scene
        self._note = journal.event
        self.paths = {k: GripperPath(k, x, journal) for k, x in scene.moved.items()}
        self._loads = {x.name: LoadSchedule(x) for x in scene.loads if x.input_topic}
        self._takes = {g.name: Waiting[TakeMessage]() for g in scene.grasps if g.taken_topic}
        self._timed: list[Waiting[Any]] = [*self._loads.values(), *self._takes.values()]
        self.observer: Observer | None = None
        if scene.measured.type != "none":
            self.observer = Observer(scene.measured, journal)
            self._timed.append(self.observer)
        self.surroundings: Surroundings | None = None
        if scene.contact.markers:
            self.surroundings = Surroundings(scene, journal, live)
            self._timed.append(self.surroundings)
        self._queues: list[Waiting[Any]] = [*self.paths.values(), *self._timed]
        self.grid: StepGrid | None = None
        self._segments: dict[str, Segment] = {}
        self._next_change = 0  # step up to which neither motions nor inputs change
        self._silence_ns, self.slow = 0, ""
        self.waiting: tuple[str, ...] = ()

    def queue(self, entry: InputTopic) -> Waiting[Any]:
        """The queue into which the accepted messages of an input are put."""
        if entry.is_pose:
            return self.paths[entry.target]
        if entry.kind == "taken":
            return self._takes[entry.target]
        if entry.kind == "markers":
            assert self.surroundings is not None
            return self.surroundings
        if entry.target:
            return self._loads[entry.target]
        assert self.observer is not None
        return self.observer

    @property
    def now_ns(self) -> int:
        """Time of the state in the time base [ns]; needs `begin`."""
        assert self.grid is not None
        return self.grid.time_of(self.simulator.steps)

    @property
    def without_pose(self) -> tuple[str, ...]:
        """Driven ends that have no pose yet; valid until `begin`."""
        return tuple(name for name, path in self.paths.items() if path.next_change_ns() is None)

    def ready_ns(self, wanted_ns: int) -> int | None:
        """Time base [ns] from which every driven end has a pose, `wanted_ns` if none is driven;
        None: not yet.

        Args:
            wanted_ns: time to which the simulation should advance; a silence is measured up to it.
        """
        for path in self.paths.values():
            path.settle_after_silence(wanted_ns)
        stamps = [path.next_change_ns() for path in self.paths.values()]
        known = [stamp for stamp in stamps if stamp is not None]
        return max(known, default=wanted_ns) if len(known) == len(stamps) else None

    def begin(self, base_ns: int) -> bool:
        """Place the cable at the poses known at `base_ns`, or resume the saved state: loads are
        those of the scene then, and ends rejoin their poses smoothly from where they were. Step 0
        is at the first multiple of the step from there.

        Returns:
            Whether a state was resumed.

        Raises:
            ValueError: the simulator refuses the poses.
        """
        saved, self._saved = self._saved, None
        origin = grid_multiple_at_or_after(base_ns, self.simulator.step)
        poses = {name: path.begin(origin) for name, path in self.paths.items()}
        told = self._told(origin)
        if told:
            self.scene, self._rebuilt = _with_taken(self.scene, told), True
        if saved is not None:
            if told:
                self.simulator = self.simulator.reconfigured(self.scene)
        elif poses or self._rebuilt:
            self.simulator = self._factory(self.scene, end_poses=poses)
        else:
            self.simulator.reset()
        self._rebuilt = saved is not None
        self.grid = StepGrid(origin, self.simulator.step)
        self._segments, self._next_change = {}, 0
        if saved is not None:
            for name, path in self.paths.items():
                path.skip_to(origin, *self.simulator.end_pose(name))
        if self.scene.estimates_errors and not self._too_slow:
            self._estimate_by(_estimate(self.simulator, begins=saved is None))
        return saved is not None

    def clear(self) -> None:
        """Discard the inputs and the grid; the simulator keeps its state until `begin`."""
        for one in self._queues:
            one.clear()
        self.grid = None
        self.unresolved, self.waiting = "", ()
        self._estimate_by(None)
        self._too_slow = False

    def hear(self) -> None:
        """Look at the queues in the next step: there is a new message."""
        self._next_change = 0

    def advance(self, wanted_ns: int, most_steps: int, silence_ns: int) -> str:
        """Take at most `most_steps` whole steps up to `wanted_ns`; stop where a pose is missing.

        Args:
            silence_ns: time base [ns] up to which a silence is measured.

        Returns:
            Why the simulator failed, or "".
        """
        grid = self.grid
        assert grid is not None, "advance() needs begin()"
        steps = self.simulator.steps
        target = min(grid.last_at_or_before(wanted_ns), steps + most_steps)
        self._silence_ns, self.slow, self.waiting = silence_ns, "", ()
        if steps < target:
            from dlo_sim.simulation.play import play  # imports the compiler

            self.unresolved = ""
            watchers = (self,) if self.estimate is None else (self, self.estimate)
            report = play(self.simulator, target, timeline=self, watchers=watchers)
            if not report.status.advanced or self.waiting:
                return "" if report.status.advanced else report.message
        # A state between two motions belongs to the later one (velocities agree, accelerations do
        # not), so outputs of this state need that motion if it is known.
        if self.simulator.steps >= self._next_change:
            self._renew_motions(grid)
            self.waiting = ()
        return ""

    # A timeline of `play`: the drive makes all changes of the simulator.

    def apply(self, stop: int) -> int:
        """Renew the motions of the ends and apply what is due; returns the step, at most `stop`,
        until which nothing changes, or the present one if an end waits for a pose.
        """
        steps = self.simulator.steps
        if steps >= self._next_change:
            grid = self.grid
            assert grid is not None
            self._renew_motions(grid)
            if self.waiting:
                return steps
            self._apply_inputs(grid)
            lasts = [one.last for one in self._segments.values() if one.last is not None]
            changes = [one.next_change_ns() for one in self._timed]
            nexts = [grid.first_at_or_after(ns) for ns in changes if ns is not None]
            self._next_change = min(
                [*lasts, *(max(steps + 1, one) for one in nexts)], default=_NEVER
            )
        return min(stop, self._next_change)

    # A watcher of `play`.

    def next_look(self, steps: int) -> int:
        """At no step of its own."""
        return _NEVER

    def look(self, report: Report) -> str:
        """Keep what is wrong or slow."""
        self.slow = report.note or self.slow
        if report.status.advanced:
            self.unresolved = self.unresolved or report.message
            self._note_slipped_out()
        return ""

    def _renew_motions(self, grid: StepGrid) -> None:
        """Set the next motion of every end whose motion is over; those without one wait."""
        self.waiting = ()
        for name, path in self.paths.items():
            present = self._segments.get(name)
            if present is not None:
                resting = present.last is None and path.silent and path.next_change_ns() is None
                if resting or (present.last is not None and self.simulator.steps < present.last):
                    continue
            at = self.simulator.steps, self.simulator.time
            segment = path.next_segment(grid, *at, self._silence_ns)
            if segment is None:
                self.waiting += (name,)
            else:
                self._segments[name] = segment
                self.simulator.set_motion(name, segment.motion)

    def _apply_inputs(self, grid: StepGrid) -> None:
        """Apply corrections, takes, releases, markers and loads of the present step."""
        now_ns, step_ns = self.now_ns, grid.step * 1e9
        if self.observer is not None:
            for points in self.observer.in_time(now_ns, step_ns):
                correction = self.observer.correction(points, self.simulator)
                if correction is not None:
                    self.observer.work += self.simulator.correct(*correction)
        if self._takes:
            self._take_and_release(self._told(now_ns))
        if self.surroundings is not None:
            self.surroundings.apply(now_ns, step_ns, self.simulator)
        for name, schedule in self._loads.items():
            self._apply_loads(name, schedule, now_ns, step_ns)

    def _apply_loads(self, name: str, schedule: LoadSchedule, now_ns: int, step_ns: float) -> None:
        """Apply the newest load that is due, or remove one that has not been renewed in time."""
        newest: LoadMessage | None = None
        for newest in schedule.due(now_ns):
            if now_ns - newest.stamp_ns > step_ns:
                self._note("late", f"load {name} came after the simulation had passed its stamp")
        if newest is not None:
            schedule.held = newest
            self._set_load(name, newest)
        removal_ns = schedule.removal_ns()
        if removal_ns is not None and now_ns >= removal_ns:
            schedule.held = None
            self.simulator.set_load(name, force=_ZERO, torque=_ZERO)
            timeout = schedule.timeout_ns * 1e-9
            self._note("load_removed", f"load {name}: no message for {timeout:g} s; removed")

    def _set_load(self, name: str, load: LoadMessage) -> None:
        """Let a load act, turned to the world frame from that of its end effector."""
        wrench: Any = load.force, load.torque
        if load.end:
            wrench = rotations.rotate(self.simulator.end_pose(load.end)[1], np.array(wrench))
        self.simulator.set_load(name, *wrench)

    def _hold_loads(self) -> None:
        """Let the present loads act on a new simulator."""
        for name, schedule in self._loads.items():
            if schedule.held is not None:
                self._set_load(name, schedule.held)

    def skip_to(self, base_ns: int) -> int:
        """Skip the time up to `base_ns`: the state is kept, its time jumps, and ends rejoin their
        poses smoothly.

        Returns:
            The skipped time [ns].
        """
        grid = self.grid
        assert grid is not None, "skip_to() needs begin()"
        before = self.now_ns
        after = max(before, grid_multiple_at_or_after(base_ns, grid.step))
        grid.origin_ns += after - before
        for name, path in self.paths.items():
            path.skip_to(after, *self.simulator.end_pose(name))
        self._segments, self._next_change = {}, 0
        return after - before

    def spare_estimate(self) -> bool:
        """Stop estimating errors unless accuracy.estimate is on; returns whether it has stopped."""
        if self.estimate is None or self.scene.accuracy.estimate == "on":
            return False
        self._estimate_by(None)
        self._too_slow = True
        return True

    def _estimate_by(self, estimate: ErrorEstimate | None) -> None:
        """From now on let this estimate follow the simulator."""
        if self.estimate is not None:
            self.estimate.end()
        self.estimate = estimate
        if estimate is not None:
            estimate.waits = not self._live

    def resume_estimate(self) -> bool:
        """Estimate again from the present state after `spare_estimate`; returns whether it does.

        Not with sine loads, whose phase new refined runs would begin anew.
        """
        if any(load.signal == "sine" for load in self.scene.loads):
            return False
        spared, self._too_slow = self._too_slow, False
        if spared:
            self._estimate_by(_estimate(self.simulator))
            self._hold_loads()
        return spared

    def follow_offset(self, delta_ns: int) -> None:
        """Shift the time of a simulation without driven ends, which is that of the clock [ns]."""
        if self.grid is not None and not self.paths:
            self.grid.origin_ns += delta_ns
            self._next_change = 0

    def prepare(self, scene: Scene) -> Prepared:
        """Prepare `reconfigure` for another scene with the same driven ends and loads.

        Nothing is changed, and `advance` may run meanwhile in another thread. If the scenes differ
        only in which grasps hold the cable, the present simulator is kept.

        Raises:
            ValueError: the simulator refuses the scene.
        """
        if scene == _with_taken(self.scene, _taken(scene)):
            for name, taken in _taken(scene).items():
                if taken and not self.scene.grasp(name).taken:
                    self.simulator.check_take(name)
            return Prepared(self.scene, self.simulator, self.estimate)
        placed = self.grid is not None
        simulator = self.simulator.reconfigured(scene) if placed else self._not_begun(scene)
        estimate = _estimate(simulator) if scene.estimates_errors else None
        return Prepared(self.scene, simulator, estimate)

    def reconfigure(self, scene: Scene, prepared: Prepared) -> None:
        """Continue from the present state with another scene, for which `prepare` was called.

        This takes only a small part of the time of `prepare`.
        """
        old, grid, self._next_change = self.simulator, self.grid, 0
        # Messages may have let grasps take or release since `prepare`.
        told = dict(_taken(self.scene).items() - _taken(prepared.before).items())
        if prepared.simulator is old:
            self._take_and_release(_taken(scene) | told)
            return
        self.simulator = prepared.simulator
        self._estimate_by(prepared.estimate)
        self.scene, self._rebuilt = scene, True
        self._too_slow = self._too_slow and scene.accuracy.estimate != "on"
        if self._too_slow:
            self._estimate_by(None)
        if self.observer is not None:
            self.observer.measured = scene.measured
        if self.surroundings is not None:
            self.surroundings.configure(scene)
        if grid is not None:
            self.simulator.take_over(old)
            if self.estimate is not None:
                self.estimate.take_over()
            self._continue_motions(grid, old)
        for name, path in self.paths.items():
            path.configure(scene.moved[name])
        for name, schedule in self._loads.items():
            schedule.configure(scene.load(name))
        self._hold_loads()
        self._take_and_release(told)

    def _not_begun(self, scene: Scene) -> Simulator:
        """A simulator of a scene before `begin`."""
        if self._saved is None:
            return self._factory(scene)
        from dlo_sim.simulation.simulator import Simulator  # imports the compiler

        try:
            return Simulator.resumed(self._saved).reconfigured(scene)
        except SceneError:
            raise
        except (TypeError, ValueError, ArithmeticError) as error:
            raise SceneError(
                f"state.save_to: nothing goes on from the saved state ({one_line(error)}); "
                "remove the file"
            ) from None

    def _told(self, now_ns: int) -> dict[str, bool]:
        """Grasp -> whether it should hold the cable, from the messages up to a time."""
        takes = self._takes.items()
        return {name: message.taken for name, take in takes for message in take.due(now_ns)}

    def _take_and_release(self, told: Mapping[str, bool]) -> None:
        """Take or release the cable with those grasps whose state differs from `told`."""
        changed = [g.name for g in self.scene.grasps if told.get(g.name, g.taken) != g.taken]
        for name in sorted(changed, key=told.__getitem__):  # release before taking
            try:
                (self.simulator.take if told[name] else self.simulator.release)(name)
            except ValueError as refusal:
                self._note("not_taken", str(refusal))
            else:
                self.scene, self._rebuilt = _with_taken(self.scene, {name: told[name]}), True

    def _note_slipped_out(self) -> None:
        """Note the grasps out of which the cable has slipped."""
        for grasp in self.scene.grasps:
            if grasp.slides and grasp.taken and self.simulator.held_at(grasp.name) is None:
                self.scene, self._rebuilt = _with_taken(self.scene, {grasp.name: False}), True
                self._note("slipped_out", f"grasp {grasp.name}: the cable has slipped out of it")

    def _continue_motions(self, old_grid: StepGrid, old: Simulator) -> None:
        """Put a new simulator, which is at its time 0, on a new grid and continue the motions of
        its ends.
        """
        grid = self.grid = StepGrid(old_grid.time_of(old.steps), self.simulator.step)
        for name, segment in list(self._segments.items()):
            if segment.last is None:
                continue
            if segment.last <= old.steps:
                del self._segments[name]
                continue
            last = grid.first_at_or_after(old_grid.time_of(segment.last))
            rest = self.paths[name].replan(segment.motion, old.time, grid, last)
            self._segments[name] = rest
            self.simulator.set_motion(name, rest.motion)


def _estimate(simulator: Simulator, begins: bool = False) -> ErrorEstimate:
    """The estimate of the error of a simulator that begins, or that goes on from its state."""
    from dlo_sim.simulation.error_estimate import ErrorEstimate  # imports the compiler

    return ErrorEstimate(simulator) if begins else ErrorEstimate.continued(simulator)


def _taken(scene: Scene) -> dict[str, bool]:
    """Grasp -> whether it holds the cable."""
    return {grasp.name: grasp.taken for grasp in scene.grasps}


def _with_taken(scene: Scene, taken: Mapping[str, bool]) -> Scene:
    """The scene with these grasps taken or not; the same object if nothing changes."""
    if not any(taken.get(g.name, g.taken) != g.taken for g in scene.grasps):
        return scene
    grasps = (replace(g, taken=taken.get(g.name, g.taken)) for g in scene.grasps)
    return replace(scene, grasps=tuple(grasps))
