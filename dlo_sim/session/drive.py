"""One simulator on the grid of its steps, fed with end motions and loads at exactly the steps where
they begin.

How far it goes decides `session.py`; what acts when is decided here, by stamps alone, so that the
same messages give the same bits however the advance is cut into ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.session.gripper_path import GripperPath
from dlo_sim.session.load_schedule import LoadSchedule
from dlo_sim.session.observer import Observer
from dlo_sim.session.step_grid import StepGrid, grid_multiple_at_or_after
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import TakeMessage, Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.error_estimate import ErrorEstimate
    from dlo_sim.simulation.simulator import Simulator, Snapshot


class Advance(NamedTuple):
    """What an advance did: steps taken, ends that wait for a pose, why the simulator gave up or was
    slow ("" = it did not, was not).
    """

    steps: int
    waiting: tuple[str, ...] = ()
    failure: str = ""
    slow: str = ""


class Prepared(NamedTuple):
    """What goes on with another scene: a simulator, and its companions if it has any.

    before: the scene that was simulated when this was made.
    """

    before: Scene
    simulator: Simulator
    estimate: ErrorEstimate | None


class Drive:
    """A simulator, the paths of its driven ends, the schedules of its loads, and the time of its
    steps.

    Args:
        scene: what is simulated.
        factory: builds the simulator: factory(scene, end_poses=None).
        note: called with the name of an event and one line of text.
        live: whether the prediction is made live, for accuracy.estimate auto.

    Attributes:
        scene: what is simulated now.
        simulator: the simulator; placed by `begin`.
        estimate: runs its companions, None without any.
        observer: corrects the simulator by what is measured, None unless asked for.
        grid: times of its steps, None before `begin`.
        index: the step at which it is.
    """

    def __init__(
        self,
        scene: Scene,
        factory: Callable[..., Simulator],
        note: Callable[[str, str], None],
        live: bool = False,
    ) -> None:
        self.simulator = factory(scene)
        self.estimate: ErrorEstimate | None = None
        self._live = live
        self._too_slow = False
        self._rebuilt = False  # the simulator, so that its first state is not the scene's
        self.scene = scene
        self._note = note
        self._factory = factory
        self.paths = {
            name: GripperPath(
                name, round(end.pose_timeout * SECOND), round(end.pose_smoothing * SECOND), note
            )
            for name, end in scene.holders.items()
            if end.driven
        }
        self.schedules = {x.name: LoadSchedule(x, note) for x in scene.loads if x.input_topic}
        self.takes = {g.name: Waiting[TakeMessage]() for g in scene.grasps if g.taken_topic}
        self.observer: Observer | None = None
        if scene.measured.type != "none":
            self.observer = Observer(scene.measured, note)
        self.grid: StepGrid | None = None
        self.index = 0
        self._knots: dict[str, int | None] = {}
        self._motions: dict[str, EndMotion] = {}

    @property
    def saved(self) -> Snapshot:
        """All that `resume` needs."""
        return self.simulator.snapshot()

    @property
    def _estimating(self) -> bool:
        """Whether companions run from the next beginning on."""
        return _estimated(self.scene, self._live and not self._too_slow)

    @property
    def _driven(self) -> Simulator | ErrorEstimate:
        """What takes motions, loads and steps: the simulator, alone or with its companions."""
        return self.simulator if self.estimate is None else self.estimate

    @property
    def _pending(self) -> list[Waiting[Any]]:
        return [*self.schedules.values(), *self.takes.values()]

    @property
    def now_ns(self) -> int:
        """Time of the state in the time base [ns]; needs `begin`."""
        assert self.grid is not None
        return self.grid.time_of(self.index)

    @property
    def without_pose(self) -> tuple[str, ...]:
        """Driven ends of which no pose is known yet."""
        return tuple(name for name, path in self.paths.items() if path.first_stamp_ns is None)

    def ready_ns(self, wanted_ns: int) -> int | None:
        """Time base [ns] from which every driven end has a pose; None: not yet, or none is driven.

        Args:
            wanted_ns: how far the simulation would like to go, to tell a silence.
        """
        for path in self.paths.values():
            path.settle(wanted_ns)
        stamps = [path.first_stamp_ns for path in self.paths.values()]
        known = [stamp for stamp in stamps if stamp is not None]
        return max(known) if known and len(known) == len(stamps) else None

    def begin(self, base_ns: int) -> None:
        """Place the cable at the poses known at `base_ns`; step 0 is the first multiple of the step
        from there.

        Raises:
            ValueError: if the cable cannot be placed there (the simulator says why).
        """
        origin = grid_multiple_at_or_after(base_ns, self.simulator.step)
        poses = {name: path.begin(origin) for name, path in self.paths.items()}
        told = self._told(origin)
        if told is not self.scene:
            self.scene, self._rebuilt = told, True
        if poses or self._rebuilt:
            self.simulator = self._factory(self.scene, end_poses=poses)
            self._rebuilt = False
        else:
            self.simulator.reset()
        if self._estimating:
            from dlo_sim.simulation.error_estimate import ErrorEstimate

            self.estimate = ErrorEstimate.placed(self.simulator, poses)
        self.grid = StepGrid(origin, self.simulator.step)
        self.index = 0
        self._knots, self._motions = dict.fromkeys(self.paths, 0), {}

    def resume(self, base_ns: int, saved: Snapshot) -> None:
        """`begin` with a saved state: loads are those of the scene, ends rejoin their poses
        smoothly from where they were.

        Raises:
            ValueError: as `begin`, or it is the state of another simulator.
        """
        self.begin(base_ns)
        poses = {name: (one.position, one.orientation) for name, one in saved.geometries.items()}
        before = self._factory(saved.scene, end_poses=poses)
        before.restore(saved)
        self.simulator, self._rebuilt = before.reconfigured(self.scene), True
        if self.estimate is not None:
            from dlo_sim.simulation.error_estimate import ErrorEstimate

            self.estimate = ErrorEstimate.continued(self.simulator)
        for name, path in self.paths.items():
            path.skip_to(self.now_ns, *self.simulator.end_pose(name))

    def clear(self) -> None:
        """Forget the inputs and the place in time; the simulator keeps its state until `begin`."""
        for path in self.paths.values():
            path.clear()
        for schedule in self.schedules.values():
            schedule.remove(self.simulator)
        for take in self.takes.values():
            take.clear()
        if self.observer is not None:
            self.observer.clear()
        self.grid = None
        self.estimate = None
        self._too_slow = False

    def advance(self, wanted_ns: int, most_steps: int, silence_ns: int | None = None) -> Advance:
        """Take whole steps up to `wanted_ns`, at most so many, stopping where a pose is missing.

        Args:
            silence_ns: time by which a silence is measured; None = `wanted_ns`.
        """
        grid = self.grid
        assert grid is not None, "advance() needs begin()"
        silence_ns = wanted_ns if silence_ns is None else silence_ns
        begin = self.index
        target = min(grid.last_at_or_before(wanted_ns), begin + most_steps)
        slow = ""
        while self.index < target:
            waiting = self._renew_motions(grid, silence_ns)
            if waiting:
                return Advance(self.index - begin, waiting, slow=slow)
            stop = self._apply_inputs(grid, self._correct(grid, target))
            report = self._driven.advance_steps(stop - self.index)
            self.index += report.steps
            slow = report.note or slow
            if not report.status.ok:
                return Advance(self.index - begin, failure=report.message, slow=slow)
        # A state at a knot belongs to the motion that begins there (its velocity is the same, its
        # acceleration is not), so whoever looks at it now must find that motion if it is known.
        self._renew_motions(grid, silence_ns)
        return Advance(self.index - begin, slow=slow)

    def _renew_motions(self, grid: StepGrid, silence_ns: int) -> tuple[str, ...]:
        """Give every end whose motion is over the next one; returns the ends that have none yet."""
        waiting: tuple[str, ...] = ()
        for name, path in self.paths.items():
            knot = self._knots[name]
            resting = knot is None and path.silent and not path.waiting
            if resting or (knot is not None and self.index < knot):
                continue
            segment = path.next_segment(grid, self.index, self.simulator.time, silence_ns)
            if segment is None:
                waiting += (name,)
            else:
                self._knots[name] = segment.last
                self._motions[name] = segment.motion
                self._driven.set_motion(name, segment.motion)
        return waiting

    def _apply_inputs(self, grid: StepGrid, target: int) -> int:
        """Take, release and load as of the present step; returns the step up to which nothing
        changes.
        """
        told = self._told(self.now_ns)
        if told is not self.scene:
            self._take_and_release(told)
        stop = target
        for knot in self._knots.values():
            if knot is not None and knot < stop:
                stop = knot
        for schedule in self.schedules.values():
            schedule.apply(self.now_ns, grid.step * 1e9, self._driven)
        for pending in self._pending:
            change = pending.next_change_ns()
            if change is not None and change < grid.time_of(stop):
                stop = min(stop, max(self.index + 1, grid.first_at_or_after(change)))
        return stop

    def _correct(self, grid: StepGrid, target: int) -> int:
        """Correct the present state by what is measured; the step of the next correction."""
        if self.observer is None:
            return target
        self.observer.apply(self.now_ns, grid.step * 1e9, self.simulator)
        change = self.observer.next_change_ns()
        return target if change is None else min(target, grid.first_at_or_after(change))

    def skip_to(self, base_ns: int) -> int:
        """Leave out the time up to `base_ns`: the state stays, its time jumps, ends rejoin their
        poses smoothly.

        Returns:
            The time left out [ns].
        """
        grid = self.grid
        assert grid is not None, "skip_to() needs begin()"
        before = self.now_ns
        after = max(before, grid_multiple_at_or_after(base_ns, grid.step))
        grid.origin_ns += after - before
        for name, path in self.paths.items():
            path.skip_to(after, *self.simulator.end_pose(name))
            self._knots[name] = self.index
        return after - before

    def spare_estimate(self) -> bool:
        """Go on without companions that are not asked for by name; whether there were any."""
        if self.estimate is None or self.scene.accuracy.estimate == "on":
            return False
        self.estimate, self._too_slow = None, True
        return True

    def resume_estimate(self) -> bool:
        """Estimate again after `spare_estimate`, from the present state; whether it was spared and
        can go on: companions would begin a sine load anew.
        """
        if any(load.signal == "sine" for load in self.scene.loads):
            return False
        spared, self._too_slow = self._too_slow, False
        if spared:
            from dlo_sim.simulation.error_estimate import ErrorEstimate

            self.estimate = ErrorEstimate.continued(self.simulator)
            for name, motion in self._motions.items():
                self.estimate.go_on(name, motion)
            for schedule in self.schedules.values():
                schedule.resend(self.estimate)
        return spared

    def rename_free_run(self, delta_ns: int) -> None:
        """Relabel by delta [ns] a simulation that waits for no pose: its time is read off the
        clock.
        """
        if self.grid is not None and not self.paths:
            self.grid.origin_ns += delta_ns

    def rename_inputs(self, delta_ns: int) -> None:
        """Relabel by delta [ns] inputs that were dated by the clock until now, and the simulation
        that follows them.
        """
        if self.grid is not None:
            self.grid.origin_ns += delta_ns
        for path in self.paths.values():
            path.shift_time(delta_ns)
        for pending in self._pending:
            pending.shift_time(delta_ns)
        if self.observer is not None:
            self.observer.shift_time(delta_ns)

    def prepare(self, scene: Scene) -> Prepared:
        """What `reconfigure` needs for another scene with the same driven ends and loads.

        Nothing is changed, and `advance` may go on meanwhile in another thread. The simulator goes
        on itself where grasps only take or release the cable.

        Raises:
            ValueError: the simulator refuses the scene.
        """
        if scene == _with_taken(self.scene, {g.name: g.taken for g in scene.grasps}):
            for grasp in _taking(self.scene, scene):
                self.simulator.check_take(grasp)
            return Prepared(self.scene, self.simulator, self.estimate)
        placed = self.grid is not None
        simulator = self.simulator.reconfigured(scene) if placed else self._factory(scene)
        if not _estimated(scene, self._live):
            return Prepared(self.scene, simulator, None)
        from dlo_sim.simulation.error_estimate import ErrorEstimate

        estimate = ErrorEstimate.continued(simulator)
        return Prepared(self.scene, simulator, estimate)

    def reconfigure(self, scene: Scene, prepared: Prepared) -> None:
        """Continue from the present state with another scene, for which `prepare` was called.

        Taking over the state takes a small part of the time that building took.
        """
        old, grid = self.simulator, self.grid
        # Messages may have let grasps take or release since `prepare`.
        pairs = zip(prepared.before.grasps, self.scene.grasps, strict=True)
        told = _with_taken(scene, {g.name: g.taken for was, g in pairs if g.taken != was.taken})
        if prepared.simulator is old:
            self._take_and_release(told)
            return
        _, self.simulator, self.estimate = prepared
        self.scene, self._rebuilt = scene, True
        self._too_slow = self._too_slow and scene.accuracy.estimate != "on"
        if self._too_slow:
            self.estimate = None
        if self.observer is not None:
            self.observer.measured = scene.measured
        if grid is not None:
            self.simulator.take_over(old)
            if self.estimate is not None:
                self.estimate.take_over()
            self._continue_motions(grid, old.time)
        for name, path in self.paths.items():
            end = scene.holders[name]
            path.configure(round(end.pose_timeout * SECOND), round(end.pose_smoothing * SECOND))
        for schedule in self.schedules.values():
            schedule.timeout_ns = round(scene.load(schedule.name).timeout * SECOND)
            schedule.resend(self._driven)
        if told is not scene:
            self._take_and_release(told)

    def _told(self, now_ns: int) -> Scene:
        """The scene with grasps as messages up to a time tell them to hold the cable."""
        if not self.takes:
            return self.scene
        takes = self.takes.items()
        told = {name: message.taken for name, take in takes for message in take.due(now_ns)}
        return _with_taken(self.scene, told)

    def _take_and_release(self, scene: Scene) -> None:
        """Let the grasps hold what another scene, which differs in that alone, says."""
        refused = {}
        for grasp in _taking(scene, self.scene):
            self._driven.release(grasp)
        for grasp in _taking(self.scene, scene):
            try:
                self._driven.take(grasp)
            except ValueError as refusal:
                refused[grasp] = False
                self._note("not_taken", str(refusal))
        self.scene, self._rebuilt = _with_taken(scene, refused), True

    def _continue_motions(self, old: StepGrid, old_time: float) -> None:
        """Put a new simulator, which is at its time 0, on a new grid, its ends going on as they
        were.
        """
        now_ns, simulator = self.now_ns, self.simulator
        grid = self.grid = StepGrid(now_ns, simulator.step)
        for name, knot in self._knots.items():
            if knot is None or knot <= self.index or name not in self._motions:
                self._knots[name] = None if knot is None else 0
                continue
            last = grid.first_at_or_after(old.time_of(knot))
            motion = self._motions[name]
            segment = self.paths[name].replan(motion, old_time, grid, last, simulator.time)
            self._knots[name], self._motions[name] = last, segment.motion
            self._driven.set_motion(name, segment.motion)
        self.index = 0


def _taking(scene: Scene, other: Scene) -> list[str]:
    """Grasps that hold the cable in another scene, but not in this one."""
    pairs = zip(scene.grasps, other.grasps, strict=True)
    return [grasp.name for before, grasp in pairs if grasp.taken and not before.taken]


def _with_taken(scene: Scene, taken: Mapping[str, bool]) -> Scene:
    """A scene whose grasps of these names hold the cable, or do not; itself if they do already."""
    if not any(taken.get(g.name, g.taken) != g.taken for g in scene.grasps):
        return scene
    grasps = (replace(g, taken=taken.get(g.name, g.taken)) for g in scene.grasps)
    return replace(scene, grasps=tuple(grasps))


def _estimated(scene: Scene, live: bool) -> bool:
    """Whether the error of a prediction is estimated."""
    wanted = scene.accuracy.estimate
    corrected = scene.measured.type != "none"  # its companions are not
    return wanted == "on" or (wanted == "auto" and live and not corrected)
