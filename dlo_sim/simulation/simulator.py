"""The simulator: one cable that can be stepped, loaded, moved by its ends, and looked at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import bspline
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.kernels import layout
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import Needs, needs_of, needs_of_load
from dlo_sim.simulation import optional_terms, workspace
from dlo_sim.simulation.account import grossly_open, open_account
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import ENDS, Pose, end_geometries
from dlo_sim.simulation.model import build_model, local_axis
from dlo_sim.simulation.placement import place
from dlo_sim.simulation.report import Report, Status
from dlo_sim.simulation.selection import choose
from dlo_sim.simulation.stepper import Stepper, largest_frequency
from dlo_sim.simulation.transfer import carry_inputs, put_state, resampled
from dlo_sim.simulation.view import CableView

Array = NDArray[np.float64]
_STATUS = (Status.OK, Status.DIVERGED, Status.NOT_CONVERGED)
CHUNK = 4096  # steps between two saved states of a long advance


@dataclass(frozen=True)
class Snapshot:
    """Everything that `Simulator.restore` needs to go on with the same bits."""

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
        self.scene = scene
        needs = needs_of(scene)
        _refuse_unbuilt(scene)
        optional_terms.check_terms(scene, needs)
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
        self._unrecorded = workspace.new_recorder(self._model, np.zeros(0))
        self._load_index = {load.name: k for k, load in enumerate(scene.loads)}
        self._kept: tuple[tuple[Array, Array], ...] = ()
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
        started = time.perf_counter()
        self._stepper.advance(self._state, self._work, self._solver, 0, 0, self._unrecorded)
        self.compile_seconds = time.perf_counter() - started
        self._initial = self.snapshot()

    # -- change ---------------------------------------------------------------------------------

    def advance(self, duration: float) -> Report:
        """Advance by `duration` [s] in whole steps; what does not fill a step is carried over."""
        wanted = duration + self._remainder
        steps = int(np.floor(wanted / self.step + 1e-9))
        report = self.advance_steps(max(steps, 0))
        self._remainder = wanted - report.steps * self.step if report.status.ok else 0.0
        return report

    def advance_steps(self, steps: int, recorder: layout.Recorder | None = None) -> Report:
        """Advance by whole steps. A failed run keeps the last good state and says why."""
        done = 0
        evaluations = 0
        recorder = self._unrecorded if recorder is None else recorder
        while done < steps:
            piece = min(CHUNK, steps - done)
            self._keep()
            first = self._steps
            code, made, used = self._stepper.advance(
                self._state, self._work, self._solver, first, piece, recorder
            )
            evaluations += used
            status = _STATUS[code]
            if status.ok and not self._sane(first + made):
                status = Status.DIVERGED
            if not status.ok:
                failed_at = (first + made) * self.step
                self._go_back()
                if status is not Status.DIVERGED:
                    # The failed step was left half done: do the good ones again.
                    self._stepper.advance(
                        self._state, self._work, self._solver, first, made, self._unrecorded
                    )
                    self._steps = first + made
                    if not self._sane(self._steps):
                        self._go_back()
                        self._steps = first
                done = self._steps - (first - done)
                return Report(
                    status,
                    f"{status.value} (at {failed_at:.6g} s; method {self.method}, "
                    f"step {self.step:g} s)",
                    done,
                    done * self.step,
                    evaluations,
                )
            self._steps += piece
            done += piece
        return Report(Status.OK, "", done, done * self.step, evaluations)

    def set_load(
        self, name: str, force: ArrayLike | None = None, torque: ArrayLike | None = None
    ) -> None:
        """Set force [N] and moment [N m] of a load, world frame, ON the cable, until changed.

        Raises:
            KeyError: no such load. ValueError: not three finite numbers.
        """
        if name not in self._load_index:
            raise KeyError(
                f"no load '{name}'; the scene has {', '.join(self._load_index) or 'none'}"
            )
        push, turn = _three(name, force), _three(name, torque)
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
        """
        self._ends.place(end, self.time, position, orientation, tangent)
        self._after_end_moved(end)

    def set_motion(self, end: str, motion: EndMotion) -> None:
        """Let an end effector follow `motion`; afterwards it rests at its last pose."""
        self._ends.follow(end, self.time, motion)
        self._after_end_moved(end)

    def snapshot(self) -> Snapshot:
        """The present state, to go on from later with the same bits."""
        return Snapshot(
            self._steps,
            self._remainder,
            self._needs,
            tuple(array.copy() for array in self._mutable()),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this simulator."""
        self._steps = snapshot.steps
        self._remainder = snapshot.remainder
        if snapshot.needs != self._needs:
            self._rebuild(snapshot.needs)
        for array, saved in zip(self._mutable(), snapshot.arrays, strict=True):
            array[:] = saved
        self._ends.restored()

    def reset(self) -> None:
        """Go back to the first state."""
        self.restore(self._initial)

    def start_from(self, points: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Make this the first state: control points (x, y, z, theta), shape (n_u, 4), and their
        velocities (default: at rest). What the ends hold stays where they hold it.

        Raises:
            ValueError: another shape, not finite, or out of the coordinates of the scene's step.
        """
        place = self._own_coordinates("control points", points, self._model.to_columns)
        speed = np.zeros_like(place)
        if rates is not None:
            speed = self._own_coordinates("velocities", rates, self._still)
        self._ends.put(place, 0.0)
        self._set(place, speed)
        self._steps, self._remainder = 0, 0.0
        self._open_account()
        self._initial = self.snapshot()

    def _still(self, rows: Array) -> Array:
        return self._model.to_columns(rows, rest=False)

    def _own_coordinates(
        self, what: str, value: ArrayLike, back: Callable[[Array], Array]
    ) -> Array:
        columns = np.array(value, dtype=float)
        if columns.shape != (self._model.n, 4) or not np.isfinite(columns).all():
            raise ValueError(f"{what}: needs finite numbers of shape ({self._model.n}, 4)")
        if not np.allclose(back(self._model.to_rows(columns)), columns, rtol=0.0, atol=1e-12):
            raise ValueError(
                f"{what}: leave the coordinates of the step, {self._model.columns} of x, y, z, "
                f"theta; set terms.out_of_plane or terms.twist to on"
            )
        return columns

    def reconfigured(self, scene: Scene) -> Simulator:
        """A simulator of another scene that starts with this one's shape, motion and ends.

        Building it takes time. What changes meanwhile it can `take_over` at the end.
        """
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
        points, rates = other.control_points, other.velocities
        old, new = other._model, self._model
        if new.n != old.n or self.scene.cable.length != other.scene.cable.length:
            u = self.greville * (other.scene.cable.length / self.scene.cable.length)
            points, rates = (resampled(values, old, new, u) for values in (points, rates))
        self._ends.take_over(other._ends, other.time)
        if self.scene.terms.twist == "auto" and any(self._ends.twists(end) for end in ENDS):
            self._extend(self._needs.with_twist())
        self._ends.put(points, 0.0)
        self._set(points, rates)
        optional_terms.carry_plastic(other._model.terms, self._model.terms)
        self._open_account()
        self._initial = self.snapshot()

    # -- inside ---------------------------------------------------------------------------------

    def _sane(self, step: int) -> bool:
        """Whether the state may be shown: explicit loops look at the energy only now and then."""
        position = self._state.position
        if not math.isfinite(np.vdot(position, position)):  # half the time of isfinite().all()
            return False
        if self._stepper.looked_at(step):
            return True
        return not grossly_open(self._model, self._state, self._work)

    def _keep(self) -> None:
        """Remember the state before an advance, without allocating."""
        if not self._kept:
            arrays = self._mutable()
            self._kept = tuple((array, array.copy()) for array in arrays)
        for array, copy in self._kept:
            copy[...] = array  # half the time of copyto

    def _go_back(self) -> None:
        """Take back the advance since `_keep`."""
        for array, copy in self._kept:
            array[...] = copy

    def _mutable(self) -> tuple[Array, ...]:
        terms = self._model.terms
        arrays: list[Any] = workspace.memory(self._state, self._work)
        if terms.loads is not None:
            arrays += [terms.loads.force, terms.loads.torque, terms.loads.frequency]
        if terms.springs is not None:
            arrays.append(terms.springs.anchor)
        if terms.rest is not None:
            arrays.append(terms.rest.axis)
        if terms.plastic is not None:
            arrays += [terms.plastic.curvature, terms.plastic.tangent]
        arrays.append(self._ends.motion)
        return tuple(arrays)

    def _share_drive(self) -> None:
        """Let the kernels read the ends' motion where the step contains a drive."""
        drive = self._model.terms.drive
        if drive is not None:
            terms = self._model.terms._replace(drive=drive._replace(motion=self._ends.motion))
            self._model = replace(self._model, terms=terms)

    def _after_end_moved(self, end: str) -> None:
        """Bring in what a moved end needs: the drive itself, the third coordinate, twist."""
        needs = self._needs.with_drive()
        if not self._ends.stays_in_plane(end, self._model.axes):
            needs = needs.spatial()
        if self.scene.terms.twist == "auto" and not needs.twist and self._ends.twists(end):
            needs = needs.with_twist()
        self._extend(needs)
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
        self._kept = ()
        self._model = build_model(self.scene, needs, self._geometries)
        self._share_drive()
        self._state = workspace.new_state(self._model)
        self._work = workspace.new_work(self._model)
        self._solver = workspace.new_solver(self._model)
        self._unrecorded = workspace.new_recorder(self._model, np.zeros(0))
        self._stepper = Stepper(self.scene, self._model, self._choice)

    def _extend(self, needs: Needs) -> None:
        """Something that was left out matters now: it comes into the step, the state stays."""
        if needs == self._needs:
            return
        points, rates = self.control_points, self.velocities
        old, ledger = self._model.terms, self._state.ledger
        self._rebuild(needs)
        new = self._model.terms
        carry_inputs(old, new)
        optional_terms.carry_plastic(old, new)
        self._set(points, rates)
        self._state.ledger[:] = ledger
        self._state.ledger[[layout.BOOKED, layout.HISTORY, layout.REACTION]] = 0.0
        self._turn_rest_axis()


def _three(name: str, value: ArrayLike | None) -> Array | None:
    """Three finite numbers of a load, or None."""
    if value is None:
        return None
    vector = np.asarray(value, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"load '{name}': needs three finite numbers, got {value!r}")
    return vector


def _refuse_unbuilt(scene: Scene) -> None:
    if scene.terms.contact == "on":
        raise SceneError("terms.contact: 'on' is not available in this version; use auto or off")
    if scene.terms.twist == "quasistatic":
        raise SceneError(
            "terms.twist: 'quasistatic' is not available in this version; use auto, on or frenet"
        )
