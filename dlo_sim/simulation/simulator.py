"""The simulator: one cable that can be stepped, loaded, moved by its ends, and looked at."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine import layout
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, inextensible, needs_of, needs_of_end, needs_of_load
from dlo_sim.simulation import optional_terms
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import ENDS, Pose, end_geometries
from dlo_sim.simulation.guarded_loop import GuardedLoop
from dlo_sim.simulation.inextensible import gradients as length_gradients
from dlo_sim.simulation.model import build_model, natural_vectors
from dlo_sim.simulation.placement import place
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Status, newton_note
from dlo_sim.simulation.selection import check_named_method, choose
from dlo_sim.simulation.start_from_points import cable_through
from dlo_sim.simulation.stepper import Stepper
from dlo_sim.simulation.transfer import carry_inputs, resampled
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
    state: Array
    inputs: Array


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
        model = build_model(scene, needs, self._geometries)
        self._cable = Cable.new(model)
        self._greville = bspline.greville(model.knots)
        self._pose_points = np.zeros((model.n, 4))
        x, y, z = np.eye(3)[np.argmin(np.abs(self._geometries["start"].tangent))].tolist()
        self._frame_axis = x, y, z
        first_span = float(np.diff(bspline.breaks(model.knots))[0])
        self._ends = EndDrive(scene, self._geometries, first_span)
        self._load_index = {load.name: k for k, load in enumerate(scene.loads)}
        self._bases: dict[bytes, tuple[NDArray[np.int64], Array, Array]] = {}
        self._steps = 0
        self._remainder = 0.0
        self._fill_inputs()
        place(scene, self._geometries, self._ends, self._cable)
        gradients = length_gradients(self._cable) if inextensible(scene) else None
        frequency = largest_frequency(scene, self._cable, gradients)
        self._choice = choose(scene, frequency, unchecked_step)
        self._stepper = Stepper(scene, self._choice)
        self._open_account()
        self._loop = GuardedLoop.of(self._cable, self._stepper)
        started = time.perf_counter()
        self._loop.advance(0, 0, None)
        self.compile_seconds = time.perf_counter() - started
        self._initial = self.snapshot()

    # -- change ---------------------------------------------------------------------------------

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

    def advance_steps(self, steps: int, recorder: Recorder | None = None) -> Report:
        """Advance by whole steps. A failed run keeps the last good state and says why.

        Raises:
            ValueError: not a whole number of 0 or more.
        """
        steps, done = arguments.count("steps", steps), 0
        if recorder is not None:
            arguments.instance("recorder", recorder, Recorder, "a Recorder of the present model")
        if recorder is not None and recorder.model is not self._model:
            raise ValueError("recorder: is of another model; make a new one of the present model")
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
        row = self._cable.loads[self._load_index[name]]
        if push is not None:
            row[:3] = push[:, None]
        if turn is not None:
            row[3:6] = turn[:, None]
        row[6] = 0.0

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
        self._stepper.jump(self._cable, self._ends, self.time)

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
            self._cable.state.copy(),
            self._cable.inputs.copy(),
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
        self._cable.state[:] = snapshot.state
        self._cable.inputs[:] = snapshot.inputs
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
        self._cable.put(place, speed)
        self._open_account()
        if not math.isfinite(self._cable.entry(layout.ENERGY_START)):
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

    def start_from_points(
        self,
        points: ArrayLike,
        times: ArrayLike | None = None,
        coordinates: ArrayLike | None = None,
    ) -> None:
        """Make a smooth cable of the right length through measured points the first state.

        Noise is smoothed and spikes are left out. Held ends stay where they are held.

        Args:
            points: in their order along the cable [m], shape (M, 3), NaN where missing; or several
                frames of the same points, shape (F, M, 3).
            times: of the frames [s], shape (F,); time 0 is the first state. Its velocities are
                those of lines through up to four frames, of parabolas through more; one frame is
                at rest.
            coordinates: material coordinates of the points [m], shape (M,); default: found from
                the distances between the points.

        Raises:
            TypeError: not numbers. ValueError: another shape, fewer than two points, coordinates
                beyond the cable, or points out of the coordinates of the scene's step.
        """
        given = points, times, coordinates
        place, rates = cable_through(self.scene, self._ends, self._model.knots, *given)
        twist = self.control_points[:, 3:]
        self.start_from(np.hstack([place, twist]), np.hstack([rates, np.zeros_like(twist)]))

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
        self._cable.point_grasps(0.0)
        self._cable.put(points, rates)
        optional_terms.carry_plastic(other._cable, self._cable)
        self._open_account()
        self._initial = self.snapshot()

    # -- inside ---------------------------------------------------------------------------------

    def _fill_inputs(self) -> None:
        """Loads, motions, anchors and natural shape of the scene in the arrays of the cable."""
        cable, model = self._cable, self._model
        for row, load in zip(cable.loads, self.scene.loads, strict=False):
            if load.signal != "none":
                row[:3], row[3:6] = np.array(load.force)[:, None], np.array(load.torque)[:, None]
            row[6] = load.frequency if load.signal == "sine" else 0.0
        self._ends.live_in(cable.motion)
        for anchor, spring in zip(cable.anchors, model.holding.springs, strict=True):
            place = self._geometries[ENDS[spring.grasp]].attachment
            anchor[:] = place[model.axes[spring.line]]
        booked = model.rows(cable.state, layout.ANCHOR_BOOKED, len(model.holding.springs))
        booked[:] = cable.anchors
        cable.point_grasps(self.time if self._steps else 0.0)
        self._turn_rest_axis()

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
        if self._model.has(layout.CURVED) and any(self.scene.cable.rest_curvature):
            x, y, z = self.scene.cable.rest_curvature_axis
            time = self.time if self._steps else 0.0
            turned = self._ends.turned("start", time, (float(x), float(y), float(z)))
            axis = np.array(turned) / math.hypot(x, y, z)
            vectors = natural_vectors(self.scene, self._model, axis)
            at = self._model.shape[layout.NATURAL]
            self._cable.state[at : at + vectors.size] = vectors.ravel()

    def _open_account(self) -> None:
        self._cable.open_account(self.scene)

    def _rebuild(self, needs: Needs) -> None:
        """Arrays and step of other needs; their state is empty."""
        self._needs = needs
        self._cable = Cable.new(build_model(self.scene, needs, self._geometries))
        self._fill_inputs()
        self._loop = GuardedLoop.of(self._cable, self._stepper)

    def _extend(self, needs: Needs) -> None:
        """A term that was left out matters now: it comes into the step, the state stays."""
        lines = (self._needs.axes, self._needs.twist, self._needs.loads)
        if (needs.axes, needs.twist, needs.loads) == lines:
            self._needs = needs
            return
        points, rates = self.control_points, self.velocities
        old, ledger = self._cable, self._cable.ledger.copy()
        self._rebuild(needs)
        carry_inputs(old, self._cable)
        optional_terms.carry_plastic(old, self._cable)
        self._cable.put(points, rates)
        ledger[layout.LOAD_WORK] += ledger[layout.PENDING]
        self._cable.ledger[:] = ledger
        anew = [layout.IS_BOOKED, layout.PENDING, layout.KNOWN, layout.HAS_REACTION]
        self._cable.ledger[anew] = 0.0


def _three(name: str, value: ArrayLike | None, unit: str) -> Array | None:
    """Three finite numbers, or None."""
    return None if value is None else arguments.numbers(name, value, (3,), unit)
