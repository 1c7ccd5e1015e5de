"""The simulator: one cable that can be stepped, loaded, moved by its ends, and observed."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs, moments_may_come, needs_of, needs_of_load
from dlo_sim.simulation import following, optional_terms
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive, Waiting
from dlo_sim.simulation.forecast import EVERY, Forecast, Plan, forecast
from dlo_sim.simulation.frequency import largest_frequency, with_grasps_and_contact
from dlo_sim.simulation.geometry import Geometries, Pose, geometries_of, moved, origin_of
from dlo_sim.simulation.guarded_loop import GuardedLoop
from dlo_sim.simulation.inputs import CableInputs
from dlo_sim.simulation.placement import place
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Status, explained, newton_note
from dlo_sim.simulation.resolution import continued, resolved
from dlo_sim.simulation.selection import check_named_method, choose
from dlo_sim.simulation.soundness import judged, unexplained_stretch
from dlo_sim.simulation.start_from_points import cable_through
from dlo_sim.simulation.stepper import Stepper
from dlo_sim.simulation.symmetry import is_bent, release_from_line, steps_between_looks
from dlo_sim.simulation.transfer import carry_samples

Array = NDArray[np.float64]
CHUNK = 4096  # steps of a long advance after which the state is kept in case of a failure


@dataclass(frozen=True)
class Snapshot:
    """Everything that `Simulator.restore` needs to continue bit for bit. State, inputs and
    geometries are relative to `origin`, shape (3,) [m].
    """

    scene: Scene
    steps: int
    remainder: float
    needs: Needs
    state: Array
    inputs: Array
    geometries: Geometries
    origin: Array
    waiting: Waiting = field(default_factory=dict)


class Simulator(CableInputs):
    """A cable of one scene.

    Attributes:
        scene: with the number of control points and the knots that were chosen where it left them
            open; resolution: why, one line. choice: method and step.

    Args:
        scene: what to simulate, from `dlo_sim.load_scene`.
        end_poses: end-effector poses at time 0, {"start": (position [m] (3,), quaternion x, y, z, w
            (4,)), ...}; the other ends have the poses of the scene.
        unchecked_step: use integrator.step even above the stability limit (to study stability).

    For an argument of a wrong type or value, every method raises a TypeError or ValueError of one
    line that names the cure, and leaves the state unchanged.

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
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        self.scene, self.resolution = resolved(scene)
        scene = self.scene
        needs = needs_of(scene)
        optional_terms.check_terms(scene, needs)
        check_named_method(scene)
        self._needs = needs
        geometries = geometries_of(scene, end_poses)
        self._origin = origin_of(geometries)
        self._geometries: Geometries = moved(geometries, -self._origin)
        model = build_model(scene, needs, self._geometries, origin=self._origin)
        self.cable = Cable(model)
        self._greville = bspline.greville(model.knots)
        self._frame_axis = np.eye(3)[np.argmin(np.abs(self._geometries["start"].tangent))]
        self._ends = EndDrive(scene, self._geometries, model.knots)
        self._load_index = {load.name: k for k, load in enumerate(scene.loads)}
        self._bases = {}
        self._steps, self._remainder = 0, 0.0
        self._fill_inputs()
        lay = self._lay_natural_shape if self._lays_natural_shape else None
        place(scene, self._geometries, self._ends, self.cable, lay)
        frequency = largest_frequency(scene, self.cable)
        frequency = with_grasps_and_contact(scene, model, frequency)
        self.choice = choose(scene, frequency, unchecked_step)
        self._needs = needs.stepped(self.choice.method.family == IMPLICIT)
        self._stepper = Stepper(scene, self.choice)
        self._look_every = steps_between_looks(self.choice.step, self._stepper.guard_steps)
        self._loop = GuardedLoop(self.cable, self._stepper)
        self.cable.open_account(self.scene)
        started = time.perf_counter()
        self._loop.advance(0, 0, None)
        self._initial = self.snapshot()
        if moments_may_come(scene):
            self._load_twist()
        self.compile_seconds = time.perf_counter() - started

    # -- change ---------------------------------------------------------------------------------

    def advance(self, duration: float) -> Report:
        """Advance by `duration` [s] in whole steps; the remainder is carried over to the next call.

        Raises:
            ValueError: not a finite time of 0 or more.
        """
        duration = arguments.number("duration", duration, "s, 0 or more")
        if duration < 0.0:
            raise ValueError(f"duration: needs 0 s or more, got {duration!r}")
        wanted = duration + self._remainder
        steps = float(np.floor(wanted / self.step + 1e-9))
        report = self.advance_steps(arguments.count(f"duration / {self.step:g} s", steps))
        self._remainder = wanted - report.steps * self.step if report.status.advanced else 0.0
        return report

    def advance_steps(self, steps: int, recorder: Recorder | None = None) -> Report:
        """Advance by whole steps. On failure the last good state is kept and the report says why.

        Raises:
            TypeError, ValueError: not a whole number of 0 or more, or a recorder of another model.
        """
        steps, done = arguments.count("steps", steps), 0
        if recorder is not None:
            arguments.instance("recorder", recorder, Recorder, "a Recorder of the present model")
        if recorder is not None and recorder.model is not self.model:
            raise ValueError("recorder: is of another model; make a new one of the present model")
        evaluations = 0
        while done < steps:
            piece = min(CHUNK, steps - done, self._steps_of_motions(), self._steps_to_look())
            status, made, used, worst = self._loop.advance(self._steps, piece, recorder)
            self._steps += made
            done += made
            evaluations += used
            if made:
                self._look()
            if self._ends.waiting and self._ends.begin_motions(self.time):
                self._natural_shape_moves()
            if not status.ok:
                message = (
                    f"{explained(status, self.choice.method)} (at {self.time:.6g} s, "
                    f"u = {self.greville[worst]:.3g} m; method {self.method}, step {self.step:g} s)"
                )
                return Report(status, message, done, done * self.step, evaluations)
        note = newton_note(self.choice.method, self.step, done, evaluations)
        wrong = unexplained_stretch(self.model, self.cable.points, self._ends, self.time)
        status = Status.UNRESOLVED if wrong else Status.OK
        return Report(status, wrong, done, done * self.step, evaluations, note)

    def follow(
        self, times: ArrayLike, poses: Mapping[str, ArrayLike], samples: ArrayLike
    ) -> tuple[Report, Array]:
        """Advance while end effectors move through poses; needs an implicit method.

        Between two poses the position is a cubic with the velocities of central differences; within
        a step position and orientation change linearly. End effectors without poses continue their
        present motion.

        Args:
            times: of the poses, rising [s], shape (T,), the first not after the present; the
                advance ends with the first step that reaches the last one.
            poses: end or grasp -> position [m] and quaternion x, y, z, w, shape (T, 7); or two
                points on the line of the cable [m], shape (T, 2, 3), the first nearer to the start,
                with the end effector midway and no roll.
            samples: times of the samples [s], rising, after the present and not after the last of
                `times`.

        Returns:
            The report, and control points x, y, z, theta of the samples up to the last good state,
            shape (S, n_u, 4).

        Raises:
            TypeError, ValueError: an explicit method, or invalid times or poses.
        """
        report, recorder = self.record_along(times, poses, samples)
        return report, recorder.control_points

    def record_along(
        self, times: ArrayLike, poses: Mapping[str, ArrayLike], samples: ArrayLike
    ) -> tuple[Report, Recorder]:
        """`follow`, but returns the recorder of the samples, which has their energies too."""
        if self.choice.method.family != IMPLICIT:
            raise ValueError(
                f"integrator.method: {self.method} follows no poses; give energy_momentum"
            )
        if not isinstance(poses, Mapping):
            raise TypeError(
                f"poses: needs {{'start': numbers (T, 7)}}, got {arguments.given(poses)}"
            )
        for name, waiting in self._ends.waiting.items():
            if name not in poses:
                raise ValueError(
                    f"poses: none of {name}, whose next motion begins at {waiting[0].start:g} s, "
                    "while poses can only be followed beside motions that have begun; give poses "
                    f"of {name} too, or follow them after that time"
                )
        stamps, grid = following.checked_times(times, self._steps, self.step)
        wanted = following.checked_samples(samples, self.time, stamps[-1])
        away = np.append(self._origin, np.zeros(4))
        rows = {name: self.path(name, given, len(stamps)) - away for name, given in poses.items()}
        paths = {name: following.on_grid(grid, stamps, given) for name, given in rows.items()}
        for name, path in paths.items():
            self._put_end(name, path[0, :3], path[0, 3:])
            self._extend(self._needs_along(name, path))
        cable = self.cable  # after set_end, which may have activated more terms
        recorder = Recorder(self.model, wanted)
        motions = np.repeat(cable.motion[None], len(grid) - 1, axis=0)
        for name, path in paths.items():
            row = list(self.scene.holders).index(name)
            motions[:, row] = following.motions_along(cable.motion[row], grid, path)
        moments, turns = following.natural_along(self.model, self._turning, motions)
        done, evaluations, status = 0, 0, Status.OK
        while done < len(motions) and status.ok:
            piece = slice(done, done + self._steps_to_look())
            natural = moments, turns[piece]
            made = self._loop.advance_along(self._steps, recorder, motions[piece], natural)
            self._steps += made.steps
            done, evaluations, status = (
                done + made.steps,
                evaluations + made.evaluations,
                made.status,
            )
            if made.steps:
                self._look()
        self._ends.restored()
        why = explained(status, self.choice.method)
        message = "" if status.ok else f"{why} (at {self.time:.6g} s)"
        report = Report(status, message, done, done * self.step, evaluations)
        return judged(report, recorder), recorder

    def forecast(self, plan: Plan, every: float = EVERY) -> Forecast:
        """Predict the shapes along a plan, at multiples of `every` [s], bit for bit as `follow`.

        This simulator is not changed. Loads continue unchanged.

        Raises:
            TypeError, ValueError: as `follow`, or a plan that does not begin at the present poses.
        """
        future = deepcopy(self)
        return forecast(future, future.record_along, plan, every)

    def snapshot(self) -> Snapshot:
        """The present state, from which `restore` continues bit for bit."""
        return Snapshot(
            self.scene,
            self._steps,
            self._remainder,
            self._needs,
            self.cable.state.copy(),
            self.cable.inputs.copy(),
            self._geometries,
            self._origin,
            self._ends.waiting,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this simulator.

        Raises:
            TypeError: not a snapshot. ValueError: a snapshot of another scene.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        if snapshot.scene != self.scene:
            raise ValueError("snapshot: is of another scene; restore it where it was taken")
        self._steps = snapshot.steps
        self._remainder = snapshot.remainder
        if snapshot.needs != self._needs or snapshot.geometries is not self._geometries:
            self._geometries, self._origin = snapshot.geometries, snapshot.origin
            self._rebuild(snapshot.needs)
        self._needs = snapshot.needs  # equal needs may have different warnings
        self.cable.state[:] = snapshot.state
        self.cable.inputs[:] = snapshot.inputs
        self._ends.restored(snapshot.waiting)

    def reset(self) -> None:
        """Go back to the initial state."""
        self.restore(self._initial)

    def start_from(self, points: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Set the initial state: control points (x, y, z, theta), shape (n_u, 4), and their
        velocities (default: at rest). Points held by the ends are moved back to the held poses,
        with a UserWarning if they differ.

        Raises:
            TypeError: not numbers. ValueError: another shape, not finite, a coordinate differs that
                the scene does not simulate, or the energy is not finite.
        """
        place = arguments.numbers("control points", points, (self.model.n, 4)).copy()
        place[:, :3] -= self._origin
        self._begin(place, rates)

    def _begin(self, points: ArrayLike, rates: ArrayLike | None) -> None:
        """`start_from` control points in the cable's coordinates."""
        place = self.model.own_columns("control points", points)
        speed = np.zeros_like(place)
        if rates is not None:
            speed = self.model.own_columns("velocities", rates, rest=False)
        before = self.snapshot()
        given = place.copy()
        self._ends.take_frame_turns(self.cable.frame_turn)
        self._ends.put(place, 0.0)
        self.cable.put(place, speed, 0.0)
        if self._lays_natural_shape:
            self._lay_natural_shape()
        shifted = np.abs(self.cable.points - given).max()
        self.cable.open_account(self.scene)
        if not math.isfinite(self.cable.account.energy_start):
            self.restore(before)
            raise ValueError("control points: have no finite energy; neighbours must not coincide")
        self._steps, self._remainder = 0, 0.0
        self._initial = self.snapshot()
        if shifted > 1e-9 * self.scene.cable.length:
            warnings.warn(
                "control points: those held by the ends differ from the held poses by "
                f"{shifted:.3g} m (or rad) and were moved back; start from `control_points`, or "
                "move the ends with set_end first",
                stacklevel=2,
            )

    def start_from_points(
        self,
        points: ArrayLike,
        times: ArrayLike | None = None,
        coordinates: ArrayLike | None = None,
    ) -> None:
        """Set the initial state: a smooth cable of the right length through measured points.

        Noise is smoothed and outliers are rejected. Ends and grasps keep their poses.

        Args:
            points: in their order along the cable [m], shape (M, 3), NaN where missing; or several
                frames of the same points, shape (F, M, 3).
            times: of the frames [s], rising, shape (F,); the initial state is that of time 0. Its
                velocities are those of lines through up to four frames, of parabolas through more;
                one frame: at rest.
            coordinates: material coordinates of the points [m], rising, shape (M,); default: found
                from the distances between the points.

        Raises:
            TypeError: not numbers. ValueError: another shape, fewer than two points, points that
                coincide or are too far apart for the cable, times or coordinates that do not rise,
                or coordinates that are beyond the cable or not simulated.
        """
        given = points, times, coordinates
        place, rates = cable_through(self.scene, self._ends, self._geometries, self.model, *given)
        twist = self.control_points[:, 3:]
        self._begin(np.hstack([place, twist]), np.hstack([rates, np.zeros_like(twist)]))

    def reconfigured(self, scene: Scene) -> Simulator:
        """A simulator of another scene that starts with this one's shape, motion and ends.

        Loads are those of the scene; `set_load` must be called again. Building takes time: if this
        simulator has advanced meanwhile, let the new one `take_over` its state. Control points and
        knots that the scene leaves open are those of this simulator.
        """
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        scene, resolution = resolved(continued(scene, self.scene))
        # Tangents that the scene does not give are those of this simulator.
        tangents = {
            f"{end}.tangent": list(self._geometries[end].tangent)
            for end in scene.ends
            if not any(scene.ends[end].tangent)
        }
        poses = {name: self.end_pose(name) for name in scene.holders}
        other = Simulator(scene.with_values(tangents), poses)
        other.scene, other.resolution = scene, resolution
        other.take_over(self)
        return other

    def take_over(self, other: Simulator) -> None:
        """Start with the present shape, motion and ends of another simulator, whose scene has the
        same ends, grasps and loads. Call it only before the first step.
        """
        arguments.instance("other", other, Simulator, "one that runs")
        points, rates = other.cable.points, other.velocities
        way = other._origin - self._origin
        points[:, :3] += way
        old, new = other.model, self.model
        if not np.array_equal(new.knots, old.knots):
            u = self.greville * (other.scene.cable.length / self.scene.cable.length)
            there = (bspline.evaluate(values, old.knots, u) for values in (points, rates))
            points, rates = (bspline.interpolate(new.knots, values) for values in there)
        self._ends.take_over(other._ends, other.time, other.cable.frame_turn, way)
        if any(self._ends.twists(name) for name in self.scene.holders):
            self._extend(self._needs.with_twist(self.scene))
        taking = self._take_over_grasps(other)
        for name, holder in self.scene.holders.items():
            at = self._geometries[name].u
            if at is not None and holder.holds_roll and not other.scene.holders[name].holds_roll:
                self._ends.count_from(name, 0.0, self._angle_at(at, points))
        self._ends.pull_springs(self.cable, self.time)
        self._ends.put(points, 0.0)
        self.cable.point_grasps(0.0)
        self.cable.put(points, rates, 0.0)
        carry_samples(other.cable, self.cable)
        if self._lays_natural_shape and not self._has_natural_shape_of(other):
            self._lay_natural_shape()
        self.cable.flow()
        for grasp in taking:
            self.take(grasp)
        self.cable.open_account(self.scene)
        self._initial = self.snapshot()

    # -- inside ---------------------------------------------------------------------------------

    def _steps_to_look(self) -> int:
        """Number of steps up to the next look at a straight cable; many where it is bent: it will
        not be exactly straight so soon.
        """
        if is_bent(self.cable):
            return CHUNK
        return self._look_every - self._steps % self._look_every

    def _look(self) -> None:
        """Look at a straight cable where it is time to."""
        if self._steps % self._look_every == 0:
            release_from_line(self.cable, self.scene)

    def _steps_of_motions(self) -> int:
        """Number of steps that the present motions of the end effectors last."""
        steps = self._ends.steps_until_begin(self.time, self.step)
        if steps == 0:
            self._ends.lead_over(self.time, self.step)
            self._natural_shape_moves()
        return CHUNK if steps is None else max(steps, 1)

    def _load_twist(self) -> None:
        """Load the code of the twist that a moment brings: a tick must not have to compile it."""
        needs = needs_of_load(self._needs, self.scene, None, np.ones(3))
        if needs.twist and not self._needs.twist:
            self._extend(needs)
            self._loop.advance(0, 0, None)
            self.restore(self._initial)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Connect the end effectors of a copy to the copy's own arrays."""
        self.__dict__.update(state)
        self._ends.live_in(self.cable.motion)

    def _take_over_grasps(self, other: Simulator) -> list[str]:
        """Hold what the other simulator's grasps hold, as far as the scene agrees; returns the
        names of the grasps that still have to take the cable.
        """
        held, taking = dict(self._geometries), []
        theirs = moved(other._geometries, other._origin - self._origin)
        for grasp in self.scene.grasps:
            name, before = grasp.name, theirs[grasp.name]
            if grasp.taken and before.u is not None and grasp.at == other.scene.grasp(name).at:
                longer = self.scene.cable.length / other.scene.cable.length
                held[name] = replace(before, u=before.u * longer)
                self._ends.hold(name, held[name])
            else:
                held[name] = replace(held[name], u=None)
                taking += [name] * grasp.taken
        if self.scene.grasps:
            self._geometries = held
            self._rebuild(self._needs)
        return taking
