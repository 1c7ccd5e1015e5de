"""The simulator: one cable that can be stepped, loaded, moved by its ends, and looked at."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.kernels import layout
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, needs_of, needs_of_end, needs_of_load
from dlo_sim.simulation import optional_terms, workspace
from dlo_sim.simulation.account import open_account
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import ENDS, Pose, end_geometries
from dlo_sim.simulation.guarded_loop import GuardedLoop
from dlo_sim.simulation.model import build_model, local_axis
from dlo_sim.simulation.placement import place
from dlo_sim.simulation.report import Report, Status, newton_note
from dlo_sim.simulation.selection import check_named_method, choose
from dlo_sim.simulation.stepper import Stepper, largest_frequency
from dlo_sim.simulation.transfer import carry_inputs, put_state, resampled
from dlo_sim.simulation.view import CableView

Array = NDArray[np.float64]
CHUNK = 4096  # steps between two saved states of a long advance


@dataclass(frozen=True)
class Snapshot:
    """Everything that `Simulator.restore` needs to go on with the same bits."""

    scene: Scene
    steps: int
    remainder: float
    needs: Needs
    arrays: tuple[Array, ...]


class Simulator(CableView):
    """A cable of one scene.

    Args:
        scene: what to simulate, from `dlo_sim.load_scene`.
        end_poses: end-effector poses at time 0, {"start": (position [m] (3,), quaternion x, y, z, w
            (4,)), ...}; ends that are not named are where the scene says.
        unchecked_step: take integrator.step even beyond the stability limit (to study stability).

    Every method refuses an argument of a wrong type (TypeError) or value (ValueError) in one line
    with the cure, and leaves the state as it was.

    Raises:
        SceneError: a scene that cannot be simulated, in one line.
    """

    def __init__(
        self,
        scene: Scene,
        end_poses: Mapping[str, Pose] | None = None,
        *,
        unchecked_step: bool = False,
    ) -> None:
        self.scene = arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        needs = needs_of(scene)
        optional_terms.check_terms(scene, needs)
        check_named_method(scene)
        self._needs = needs
        self._geometries = end_geometries(scene, end_poses)
        self._model = build_model(scene, needs, self._geometries)
        self._greville = bspline.greville(self._model.knots)
        self._pose_points = np.zeros((self._model.n, 4))
        x, y, z = np.eye(3)[np.argmin(np.abs(self._geometries["start"].tangent))].tolist()
        self._frame_axis = x, y, z
        self._ends = EndDrive(scene, self._geometries)
        self._share_drive()
        self._state = workspace.new_state(self._model)
        self._work = workspace.new_work(self._model)
        self._solver = workspace.new_solver(self._model)
        self._load_index = {load.name: k for k, load in enumerate(scene.loads)}
        self._bases: dict[bytes, tuple[NDArray[np.int64], Array, Array]] = {}
        self._steps = 0
        self._remainder = 0.0
        self._turn_rest_axis()
        place(
            scene, self._geometries, self._ends, self._model, self._state, self._work, self._solver
        )
        frequency = largest_frequency(self._model, self._state, self._work, self._solver)
        self._choice = choose(scene, frequency, unchecked_step)
        self._stepper = Stepper(scene, self._model, self._choice)
        self._open_account()
        self._loop = self._new_loop()
        self.compile_seconds = 0.0
        self.make_ready()
        self._initial = self.snapshot()

    # -- change ---------------------------------------------------------------------------------

    def make_ready(self) -> None:
        """Compile the step if that is still to be done, and add the time [s] to `compile_seconds`.

        The first motion of an end, or the first moment, may bring in what no step contained so far.
        `advance` makes it ready if nobody did; call this where time counts.
        """
        if not self._stepper.ready:
            started = time.perf_counter()
            self._loop.advance(self._steps, 0, None)
            self.compile_seconds += time.perf_counter() - started

    def advance(self, duration: float) -> Report:
        """Advance by `duration` [s] in whole steps; what does not fill a step is carried over.

        Raises:
            ValueError: not a finite time of 0 or more.
        """
        duration = arguments.number("duration", duration, "s, 0 or more")
        if duration < 0.0:
            raise ValueError(f"duration: needs 0 s or more, got {duration!r}")
        wanted = duration + self._remainder
        steps = float(np.floor(wanted / self.step + 1e-9))
        report = self.advance_steps(arguments.count(f"duration / {self.step:g} s", steps))
        self._remainder = wanted - report.steps * self.step if report.status.ok else 0.0
        return report

    def advance_steps(self, steps: int, recorder: layout.Recorder | None = None) -> Report:
        """Advance by whole steps. A failed run keeps the last good state and says why.

        Raises:
            ValueError: not a whole number of 0 or more.
        """
        steps, done = arguments.count("steps", steps), 0
        if recorder is not None:
            workspace.check_recorder(recorder, self._model)
        self.make_ready()
        evaluations = 0
        while done < steps:
            piece = min(CHUNK, steps - done)
            status, made, used, worst = self._loop.advance(self._steps, piece, recorder)
            self._steps += made
            done += made
            evaluations += used
            if not status.ok:
                message = (
                    f"{status.value} (at {self.time:.6g} s, u = {self.greville[worst]:.3g} m; "
                    f"method {self.method}, step {self.step:g} s)"
                )
                return Report(status, message, done, done * self.step, evaluations)
        note = newton_note(self.choice.method, self.step, done, evaluations)
        return Report(Status.OK, "", done, done * self.step, evaluations, note)

    def set_load(
        self, name: str, force: ArrayLike | None = None, torque: ArrayLike | None = None
    ) -> None:
        """Set force [N] and moment [N m] of a load, world frame, ON the cable, until changed.

        Raises:
            TypeError, ValueError: no such load, or not three finite numbers.
        """
        arguments.one_of("load", name, self._load_index)
        push, turn = (
            _three(f"force of {name}", force, "N"),
            _three(f"torque of {name}", torque, "N m"),
        )
        self._extend(needs_of_load(self._needs, self.scene, push, turn))
        loads = self._model.terms.loads
        assert loads is not None
        k = self._load_index[name]
        if push is not None:
            loads.force[k] = push[list(self._model.axes)]
        if turn is not None:
            loads.torque[k] = turn
        loads.frequency[k] = 0.0

    def set_end(
        self,
        end: str,
        position: ArrayLike | None = None,
        orientation: ArrayLike | None = None,
        tangent: ArrayLike | None = None,
    ) -> None:
        """Put an end effector at a pose from now on, at rest.

        Args:
            position: [m]; default: where it is. orientation: quaternion x, y, z, w; default: as it
            is. tangent: direction of the cable at this end instead of an orientation.

        Raises:
            TypeError, ValueError: no end, or not a pose.
        """
        self._ends.place(end, self.time, position, orientation, tangent)
        self._after_end_moved(end)
        self._stepper.jump(self._state, self._work, self.time)

    def set_motion(self, end: str, motion: EndMotion) -> None:
        """Let an end effector follow a motion; afterwards it rests at its last pose.

        The motion begins now or later (it may be given up to a step late), at the end effector's
        present pose: `set_end` is for jumps.

        Raises:
            TypeError, ValueError: no end, no motion, or one that begins before now or elsewhere.
        """
        self._ends.check_motion(end, self.time, motion, self.step)
        self._ends.follow(end, self.time, motion)
        self._after_end_moved(end)

    def snapshot(self) -> Snapshot:
        """The present state, to go on from later with the same bits."""
        return Snapshot(
            self.scene,
            self._steps,
            self._remainder,
            self._needs,
            tuple(array.copy() for array in self._mutable()),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this simulator.

        Raises:
            TypeError: no snapshot. ValueError: one of another scene.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        if snapshot.scene != self.scene:
            raise ValueError("snapshot: is of another scene; restore it where it was taken")
        self._steps = snapshot.steps
        self._remainder = snapshot.remainder
        if snapshot.needs != self._needs:
            self._rebuild(snapshot.needs)
        self._needs = snapshot.needs  # its warnings may differ
        for array, saved in zip(self._mutable(), snapshot.arrays, strict=True):
            array[:] = saved
        self._ends.restored()

    def reset(self) -> None:
        """Go back to the first state."""
        self.restore(self._initial)

    def start_from(self, points: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Make this the first state: control points (x, y, z, theta), shape (n_u, 4), and their
        velocities (default: at rest). Points held by the ends are moved back to the held poses,
        with a UserWarning if they differ.

        Raises:
            TypeError: not numbers. ValueError: another shape, not finite, out of the coordinates of
                the scene's step, or without a finite energy.
        """
        place = self._model.own_columns("control points", points)
        speed = np.zeros_like(place)
        if rates is not None:
            speed = self._model.own_columns("velocities", rates, rest=False)
        before = self.snapshot()
        given = place.copy()
        self._ends.put(place, 0.0)
        moved = np.abs(place - given).max()
        self._set(place, speed)
        self._open_account()
        if not math.isfinite(self._state.ledger[layout.ENERGY_START]):
            self.restore(before)
            raise ValueError("control points: have no finite energy; neighbours must not coincide")
        self._steps, self._remainder = 0, 0.0
        self._initial = self.snapshot()
        if moved > 1e-9 * self.scene.cable.length:
            warnings.warn(
                "control points: those held by the ends differ from the held poses by "
                f"{moved:.3g} m (or rad) and were moved back; start from `control_points`, or move "
                "the ends with set_end first",
                stacklevel=2,
            )

    def reconfigured(self, scene: Scene) -> Simulator:
        """A simulator of another scene that starts with this one's shape, motion and ends.

        Loads are those of the scene: what `set_load` gave is to be given again.

        Building it takes time. What changes meanwhile it can `take_over` at the end.
        """
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        # Tangents that the scene leaves open are those of the cable as it was placed.
        tangents = {
            f"{end}.tangent": list(self._geometries[end].tangent)
            for end in ENDS
            if not any(scene.ends[end].tangent)
        }
        poses = {end: self.end_pose(end) for end in ENDS}
        other = Simulator(scene.with_values(tangents), poses)
        other.scene = scene
        other.take_over(self)
        return other

    def take_over(self, other: Simulator) -> None:
        """Start with the present shape, motion and ends of another simulator of the same ends and
        loads. Only before the first step.
        """
        arguments.instance("other", other, Simulator, "one that runs")
        points, rates = other.control_points, other.velocities
        old, new = other._model, self._model
        if new.n != old.n or self.scene.cable.length != other.scene.cable.length:
            u = self.greville * (other.scene.cable.length / self.scene.cable.length)
            points, rates = (resampled(values, old, new, u) for values in (points, rates))
        self._ends.take_over(other._ends, other.time)
        if any(self._ends.twists(end) for end in ENDS):
            self._extend(self._needs.with_twist(self.scene))
        self._ends.put(points, 0.0)
        self._set(points, rates)
        optional_terms.carry_plastic(other._model.terms, self._model.terms)
        self._open_account()
        self._initial = self.snapshot()

    # -- inside ---------------------------------------------------------------------------------

    def _new_loop(self) -> GuardedLoop:
        arrays = self._mutable()
        return GuardedLoop(
            self._model,
            self._stepper,
            self._state,
            self._work,
            self._solver,
            workspace.new_recorder(self._model, np.zeros(0)),
            arrays,
            tuple(array.copy() for array in arrays),
        )

    def _mutable(self) -> tuple[Array, ...]:
        kept = workspace.memory(self._model.terms, self._state, self._work)
        return (*kept, self._ends.motion)

    def _share_drive(self) -> None:
        """Let the kernels read the ends' motion where the step contains a drive."""
        drive = self._model.terms.drive
        if drive is not None:
            terms = self._model.terms._replace(drive=drive._replace(motion=self._ends.motion))
            self._model = replace(self._model, terms=terms)

    def _after_end_moved(self, end: str) -> None:
        """Bring in what a moved end needs: the drive itself, the third coordinate, twist."""
        leaves_plane = not self._ends.stays_in_plane(end, self._model.axes)
        twists = not self._needs.twist and self._ends.twists(end)
        self._extend(
            needs_of_end(self._needs, self.scene, leaves_plane=leaves_plane, twists=twists)
        )
        self._turn_rest_axis()

    def _turn_rest_axis(self) -> None:
        """The natural curvature's axis turns with the start's end effector."""
        rest = self._model.terms.rest
        if rest is not None:
            x, y, z = self.scene.cable.rest_curvature_axis
            turned = self._ends.turned("start", self.time, (float(x), float(y), float(z)))
            rest.axis[:] = local_axis(np.array(turned) / math.hypot(x, y, z), self._model.axes)

    def _open_account(self) -> None:
        open_account(self.scene, self._model, self._state, self._work)

    def _set(self, points: Array, rates: Array) -> None:
        """Take over control points (n, 4) and their velocities."""
        put_state(self._model, self._state, points, rates)

    def _rebuild(self, needs: Needs) -> None:
        """Arrays and step of other needs; their state is empty."""
        self._needs = needs
        self._model = build_model(self.scene, needs, self._geometries)
        self._share_drive()
        self._state = workspace.new_state(self._model)
        self._work = workspace.new_work(self._model)
        self._solver = workspace.new_solver(self._model)
        self._stepper = Stepper(self.scene, self._model, self._choice)
        self._loop = self._new_loop()

    def _extend(self, needs: Needs) -> None:
        """Something that was left out matters now: it comes into the step, the state stays."""
        if needs == self._needs:
            self._needs = needs  # its warnings may be new
            return
        points, rates = self.control_points, self.velocities
        old, ledger = self._model.terms, self._state.ledger
        self._rebuild(needs)
        new = self._model.terms
        carry_inputs(old, new)
        optional_terms.carry_plastic(old, new)
        self._set(points, rates)
        self._state.ledger[:] = ledger
        self._state.ledger[layout.LOAD_WORK] += ledger[layout.PENDING]
        anew = [layout.BOOKED, layout.PENDING, layout.HISTORY, layout.REACTION]
        self._state.ledger[anew] = 0.0
        self._turn_rest_axis()


def _three(name: str, value: ArrayLike | None, unit: str) -> Array | None:
    """Three finite numbers, or None."""
    return None if value is None else arguments.numbers(name, value, (3,), unit)
