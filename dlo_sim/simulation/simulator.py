"""The simulator: one cable of one scene, with everything that may be done to it and read from it.

Its attributes are the scene, the arrays of the cable (`Cable`), the end effectors and their motions
(`EndDrive`), and the method's steps (`Stepper`). Positions in the arrays are relative to the origin
of the model; those that callers give and get are in the world.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.core.strain import strain
from dlo_sim.engine.arrays import ENERGIES, MATERIAL, SLIDING, TORSION
from dlo_sim.engine.grasps import ACTIVE, DURATION, START
from dlo_sim.engine.sliding import LOST
from dlo_sim.scene.description import EARTH, Grasp, Obstacle, Scene, check_added
from dlo_sim.scene.needs import (
    Needs,
    check_terms,
    inextensible,
    moments_may_come,
    needs_of,
    needs_of_end,
    needs_of_load,
)
from dlo_sim.simulation import following, obstacles, self_contact
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.curve import Curve
from dlo_sim.simulation.ends import NEAR, EndDrive, apart
from dlo_sim.simulation.forecast import (
    EVERY,
    Forecast,
    Plan,
    checked_times,
    shape_times,
)
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import (
    Geometries,
    Geometry,
    Pose,
    geometries_of,
    known_holder,
    moved,
    origin_of,
)
from dlo_sim.simulation.holding import holding_of
from dlo_sim.simulation.meshes import as_text
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.natural_shape import NaturalShape
from dlo_sim.simulation.play import CHUNK, stretch
from dlo_sim.simulation.reaction import reaction
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.remarks import Overlaps, Remarks
from dlo_sim.simulation.report import (
    Energy,
    Report,
    Slide,
    UndefinedTorsion,
)
from dlo_sim.simulation.resolution import continued, resolved
from dlo_sim.simulation.selection import check_named_method, choose, is_implicit
from dlo_sim.simulation.soundness import judged, sound_now
from dlo_sim.simulation.start_from_points import cable_through
from dlo_sim.simulation.statics import FirstShape
from dlo_sim.simulation.stepper import Along, Stepper
from dlo_sim.simulation.waiting_motions import Waiting

Array = NDArray[np.float64]
LIGHT = 20.0  # weights of the cable that an obstacle in which it begins may press it with
MOST_BASES = 16  # sets of material coordinates whose basis values are kept


@dataclass(frozen=True)
class Snapshot:
    """Everything that `Simulator.restore` needs to continue bit for bit. State, inputs and
    geometries are relative to `origin`, shape (3,) [m]; `step` [s] is that of `steps`.
    """

    scene: Scene
    steps: int
    remainder: float
    needs: Needs
    state: Array
    inputs: Array
    geometries: Geometries
    origin: Array
    step: float
    waiting: Waiting = field(default_factory=dict)
    overlaps: Overlaps = field(default_factory=dict)


class Simulator:
    """A cable of one scene that is stepped, loaded, moved by its ends, and observed.

    Attributes:
        scene: with the number of control points and the knots that were chosen where it left them
            open; resolution: why, one line. choice: method, step and the reason for them. cable:
            the arrays.

    Args:
        scene: what to simulate, from `dlo_sim.load_scene`.
        end_poses: poses of end effectors and obstacles at time 0, {"start": (position [m] (3,),
            quaternion x, y, z, w (4,)), ...}; the others have the poses of the scene.
        unchecked_step: use integrator.step even above the stability limit (to study stability).
        continues: `take_over` or `restore` follows, so no first shape is looked for, nor refused.
        near: another simulator; of several equilibria the cable begins in that nearest to its
            present shape, so that a finer run of the same scene begins as it did.

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
        continues: bool = False,
        near: Simulator | None = None,
    ) -> None:
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        self.scene, self.resolution = resolved(scene)
        scene = self.scene
        needs = needs_of(scene)
        check_terms(scene, needs)
        check_named_method(scene)
        self.needs = needs
        bodies = {one.name for one in scene.bodies}
        given = {} if end_poses is None else end_poses
        poses = given
        if isinstance(given, Mapping):  # else `geometries_of` refuses it
            poses = {name: pose for name, pose in given.items() if name not in bodies}
        geometries = geometries_of(scene, poses)
        self._origin = origin_of(geometries)
        self._geometries: Geometries = moved(geometries, -self._origin)
        self.cable = Cable(build_model(scene, needs, self._geometries, origin=self._origin))
        self._curve = Curve(self.cable, self._geometries["start"].tangent)
        self.ends = EndDrive(scene, self._geometries, self.model.knots)
        self._load_index = {load.name: k for k, load in enumerate(scene.loads)}
        self.steps, self._remainder = 0, 0.0
        self.remarks = Remarks()
        self._fill_loads()
        for name in bodies & set(given):
            self.move_obstacle(name, EndMotion.resting(*given[name]))
        self._hold_cable()
        self._shape_naturally()
        resting = self._place(near, continues)
        if not continues:
            held = [one.u for one in self._geometries.values() if one.u is not None]
            self_contact.check_start(scene, self.cable, held)
        self.choice = choose(scene, self._largest_frequency(), unchecked_step)
        self.needs = needs
        self.stepper = Stepper(scene, self.cable, self.choice.method, self.choice.step)
        if not given and not continues:
            self.remarks.look_at_start(self)
        if not resting:
            self._give_way(let_be=LIGHT * scene.cable.mu * EARTH)
        self.cable.open_account(self.scene)
        started = time.perf_counter()
        self.stepper.advance(0, 0)  # no tick must have to compile this or the next line
        sound_now(self.cable, self.ends, 0.0)
        self.remarks.unstable_first = self.remarks.unstable_in_plane(self)
        self._initial = self.snapshot()
        self._load_ahead()
        self.compile_seconds = time.perf_counter() - started

    @classmethod
    def resumed(cls, snapshot: Snapshot) -> Simulator:
        """A simulator that goes on from a snapshot of another process, whatever has happened since
        the start to what holds the cable; its scene is that of the snapshot without added
        obstacles.

        Raises:
            TypeError: not a snapshot. ValueError: its numbers are none of a cable.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        held = moved(snapshot.geometries, snapshot.origin)
        poses = {name: (one.position, one.orientation) for name, one in held.items()}
        found = cls(replace(snapshot.scene, added=()), poses, unchecked_step=True, continues=True)
        found.restore(snapshot)
        if not (found.cable.indices_fit and math.isfinite(found.cable.present_energy())):
            raise ValueError("snapshot: its numbers do not fit; give one of Simulator.snapshot")
        return found

    def _place(self, near: Simulator | None, continues: bool) -> bool:
        """Put the cable into its first shape (`statics.FirstShape`)."""
        lay = self._lay_unslipped if self._natural.follows else None
        shape = self.cable.shape_of(near.cable, near.time)[0] if near else None
        first = FirstShape(self.scene, self._geometries, self.ends, self.cable, lay)
        return first.place(shape, continues)

    # -- what it is -------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time [s]: whole steps since the start."""
        return self.steps * self.choice.step if self.steps else 0.0

    @property
    def step(self) -> float:
        """Step tau [s]."""
        return self.choice.step

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return self.choice.method.name

    @property
    def model(self) -> Model:
        """Constant arrays of the scene."""
        return self.cable.model

    @property
    def active_terms(self) -> tuple[str, ...]:
        """Terms that the compiled step contains."""
        return self.needs.active

    @property
    def left_out(self) -> dict[str, str]:
        """Terms that the step does not contain, and obstacles beyond the cable's reach, with the
        reason.
        """
        return self.needs.left_out | obstacles.out_of_reach(self.scene)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is missing because of terms that the scene needs but are switched off, and what the
        model cannot show in its present state, one line each.
        """
        return self.warnings_with(self.contacts)

    def warnings_with(self, found: Mapping[str, obstacles.Contact]) -> tuple[str, ...]:
        """`warnings` where `contacts` are known, which take long with many obstacles."""
        return self.remarks.warnings(self, found)

    @property
    def control_points_needed(self) -> int:
        """Number of control points that follow the bends of the cable round what it touches now, or
        touched in a recorded run; 0 if these do.
        """
        return self.remarks.points_needed(self, self.contacts)

    @property
    def clearance_to_itself(self) -> float:
        """Smallest gap [m] between strands of the cable, negative where they overlap; infinite if
        it is nearly straight.
        """
        found = self_contact.nearest(self.model, self.cable.points, self.scene.cable.diameter)
        return found.clearance

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers of the results, one line each."""
        return self.warnings + self.remarks.notes(self)

    # -- shape and motion -------------------------------------------------------------------------

    @property
    def control_points(self) -> Array:
        """Control points (x, y, z [m], theta [rad]), shape (n_u, 4), a copy."""
        return self.model.in_world(self.cable.points)

    @property
    def velocities(self) -> Array:
        """Velocities of the control points [m/s, rad/s], shape (n_u, 4)."""
        return self.model.to_columns(self.cable.velocities(self.time), rest=False)

    @property
    def greville(self) -> Array:
        """Material coordinate [m] of each control point (Greville abscissa), shape (n_u,)."""
        return self._curve.greville.copy()

    def centerline(self, u: ArrayLike) -> Array:
        """Points of the cable [m] at material coordinates u [m] in [0, L], shape (len(u), 3).

        Raises:
            TypeError, ValueError: not such numbers.
        """
        return self._curve.points(_coordinates(u))

    def tension(self, u: ArrayLike) -> Array:
        """Tension EA (|r'| - 1) - EI kappa^2 [N] at u, shape (len(u),), without damping forces.

        Interpolated linearly between the means of the knot spans; negative under compression.

        Raises:
            TypeError, ValueError: as `centerline`; the shape does not determine the tension.
        """
        if self.scene.without_tension:
            raise ValueError(f"tension: {self.scene.without_tension}")
        shape, cable = strain(self.model.knots, _coordinates(u)), self.scene.cable
        return shape.tension(self.cable.points[:, :3], cable.EA, cable.EI)

    def curvature(self, u: ArrayLike) -> Array:
        """Curvature [1/m] at u, shape (len(u),), 0 or more.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        return strain(self.model.knots, _coordinates(u)).curvature(self.cable.points[:, :3])

    def frames(self, u: ArrayLike) -> Array:
        """Material frames at u as quaternions x, y, z, w, shape (len(u), 4); x axis = tangent.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        return self._curve.poses(_coordinates(u), self.time)[:, 3:]

    def control_poses(self, out: Array) -> None:
        """Write into out, shape (n_u, 7), every control point [m] with the material frame at its
        material coordinate, quaternion x, y, z, w.

        Raises:
            TypeError: out is not such an array of doubles, contiguous and writeable.
        """
        shape = self.model.n, 7
        fits = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == np.float64
        if not (fits and out.flags.c_contiguous and out.flags.writeable):
            raise TypeError(f"out: needs np.empty({shape}), got {arguments.given(out)}")
        self._curve.control_poses(self.time, out)

    # -- energies and forces ----------------------------------------------------------------------

    def energy(self) -> Energy:
        """Energies of the present state."""
        e = dict(zip(ENERGIES, self.cable.potentials().tolist(), strict=True))
        return Energy(
            kinetic=self.cable.kinetic(self.cable.velocities(self.time)),
            stretch=e["stretch"],
            bend=e["bend"] + e["plasticity"],
            twist=e["twist"] + e["torsion"],
            gravity=e["gravity"],
            spring=e["spring"],
            contact=e["contact"],
        )

    @property
    def energy_error(self) -> float:
        """Largest |energy - work done + energy lost| so far, as a share of the energy exchanged."""
        return self.cable.worst_balance(self.stepper.checked(self.steps))

    @property
    def undefined_torsion(self) -> UndefinedTorsion:
        """At how many samples the Frenet torsion was undefined in the run so far."""
        if not self.model.has(TORSION):
            return UndefinedTorsion(0, 0, 0.0, 0, 0.0)
        account = self.cable.account
        return UndefinedTorsion(
            samples=int(np.count_nonzero(self.model.rule.weights)),
            last=int(account.torsion_last),
            mean=float(account.torsion_sum / max(account.torsion_looks, 1.0)),
            worst=int(account.torsion_worst),
            floor=self.scene.curvature_floor,
        )

    @property
    def plastic_work(self) -> float:
        """Energy [J] that plastic bending has dissipated since the start, and what rotating the
        plastic curvature with the tangent took from the stored energy, which may be negative.
        """
        return float(self.cable.account.plastic_work)

    def reaction(self, end: str) -> tuple[Array, Array]:
        """Force [N] and moment [N m] ON THE CABLE BY the end effector, world frame, each (3,).

        The moment is about the attachment point; it is zero if neither a clamp nor a spring holds
        the direction. The inertia and weight of the end's point mass are included.
        """
        wrench = np.array(self.reaction_wrench(end))
        return wrench[:3], wrench[3:]

    def reaction_wrench(self, end: str) -> tuple[float, ...]:
        """`reaction` as six floats: force, then moment."""
        number = list(self.scene.holders).index(known_holder(self.scene, end))
        return tuple(reaction(self.cable, self.time, number).tolist())

    # -- steps ------------------------------------------------------------------------------------

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
        steps = arguments.count("steps", steps)
        if recorder is not None:
            arguments.instance("recorder", recorder, Recorder, "a Recorder of the present model")
        if recorder is not None and recorder.model is not self.model:
            raise ValueError("recorder: is of another model; make a new one of the present model")
        return stretch(self, steps, recorder)

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
        for name in self.scene.holders:
            waiting = self.ends.queue.of(name)
            if waiting and name not in poses:
                raise ValueError(
                    f"poses: none of {name}, whose next motion begins at {waiting[0].start:g} s, "
                    "while poses can only be followed beside motions that have begun; give poses "
                    f"of {name} too, or follow them after that time"
                )
        stamps, grid = following.checked_times(times, self.steps, self.step)
        wanted = following.checked_samples(samples, self.time, stamps[-1])
        away = np.append(self._origin, np.zeros(4))
        rows = {name: self.path(name, given, len(stamps)) - away for name, given in poses.items()}
        paths = {name: following.on_grid(grid, stamps, given) for name, given in rows.items()}
        for name, path in paths.items():
            self._put_end(name, path[0, :3], path[0, 3:])
            self._need(self._needs_along(name, path))
        cable = self.cable  # after set_end, which may have activated more terms
        recorder = Recorder(self.model, wanted)
        motions = np.repeat(cable.motion[None], len(grid) - 1, axis=0)
        for name, path in paths.items():
            row = list(self.scene.holders).index(name)
            motions[:, row] = following.motions_along(cable.motion[row], grid, path)
        along = Along(motions, *self._natural.turns_along(motions))
        report = stretch(self, len(motions), recorder, along)
        self.ends.restored()
        return judged(report, recorder), recorder

    def forecast(self, plan: Plan, every: float = EVERY) -> Forecast:
        """Predict the shapes along a plan, at multiples of `every` [s], bit for bit as `follow`.

        This simulator is not changed. Loads continue unchanged, and obstacles follow their motions.

        Raises:
            TypeError, ValueError: as `follow`, or a plan that does not begin at the present poses.
        """
        future = deepcopy(self)
        times = checked_times(plan)
        poses = {name: self.path(name, rows, len(times)) for name, rows in plan.poses.items()}
        for name, rows in poses.items():
            first = rows[0, :3], rotations.normalized(rows[0, 3:])
            way, turn = apart(self.end_pose(name), *first)
            if way > NEAR * self.scene.cable.length or turn > NEAR:
                raise ValueError(
                    f"poses of {name}: begin {way:.3g} m and {turn:.3g} rad away from the end "
                    f"effector; begin at end_pose('{name}')"
                )
        samples, now = shape_times(times, every), self.time
        at = np.minimum(now + samples, now + times[-1])
        report, recorder = future.record_along(now + times, poses, at)
        count, shapes = recorder.count, recorder.along(self.scene)
        drawn = future.remarks.look_back(future, recorder, samples[:count])
        points = recorder.control_points
        told = future.warnings, future.control_points_needed
        return Forecast(samples[:count], points, *shapes, report, drawn, *told)

    @property
    def steps_of_motions(self) -> int:
        """Number of steps for which end effectors and obstacles keep to their present motions."""
        queue = self.ends.queue
        if not queue:
            return CHUNK
        steps = queue.steps_until_begin(self.time, self.step)
        if steps == 0:
            self._go_on(queue.leading(self.time, self.step, self._pose_of))
        return max(steps, 1)

    def begin_motions(self) -> None:
        """Let motions begin that have waited for the present time."""
        if self.ends.queue:
            self._go_on(self.ends.queue.take_due(self.time))

    def _go_on(self, motions: Mapping[str, EndMotion]) -> None:
        """Let end effectors and obstacles follow these motions from now on."""
        held = self.scene.holders.keys() & motions.keys()
        for name, motion in motions.items():
            if name in held:
                self.ends.go_on(name, self.time, motion)
            else:
                obstacles.write(self._obstacle(name), motion)
        if held:
            self._turn_natural_shape()

    def _pose_of(self, name: str, t: float) -> tuple[Array, Array]:
        """Position [m] and quaternion of an end effector or obstacle at time t, in the coordinates
        of the model.
        """
        if name in self.scene.holders:
            return self.ends.pose(name, t)
        return obstacles.pose_at(self._obstacle(name), t, np.zeros(3))

    # -- loads and end effectors ------------------------------------------------------------------

    def set_load(
        self, name: str, force: ArrayLike | None = None, torque: ArrayLike | None = None
    ) -> None:
        """Set force [N] and moment [N m] of a load, world frame, ON the cable, until changed.

        Raises:
            TypeError, ValueError: no such load, or not three finite numbers.
        """
        arguments.one_of("load", name, self._load_index)
        push = _three(f"force of {name}", force, "N")
        turn = _three(f"torque of {name}", torque, "N m")
        self._need(needs_of_load(self.needs, self.scene, push, turn))
        row = self.cable.loads[self._load_index[name]]
        if push is not None:
            row[:3] = push
        if turn is not None:
            row[3:6] = turn
        row[6] = 0.0

    def end_pose(self, end: str) -> tuple[Array, Array]:
        """Pose of an end effector or an obstacle at the present time: position [m] (3,), quaternion
        x, y, z, w (4,).
        """
        if any(obstacle.name == end for obstacle in self.scene.bodies):
            return obstacles.pose_at(self._obstacle(end), self.time, self.model.origin)
        position, orientation = self.ends.pose(end, self.time)
        return position + self.model.origin, orientation

    def path(self, name: str, given: ArrayLike, count: int) -> Array:
        """Check poses (count, 7), or pairs of points (count, 2, 3), of an end effector.

        Returns:
            Poses, shape (count, 7).

        Raises:
            TypeError, ValueError: no such end effector, or not such poses.
        """
        orientation = self.end_pose(known_holder(self.scene, name))[1]
        tangent = self._geometries[name].tangent
        return following.checked_poses(name, given, count, orientation, tangent)

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
        if position is not None:
            place = arguments.numbers(f"position of {end}", position, (3,), "m")
            position = place - self.model.origin
        self._put_end(end, position, orientation, tangent)

    def set_motion(self, end: str, motion: EndMotion) -> None:
        """Let an end effector or an obstacle follow a motion; then it rests at its last pose.

        The motion begins now or later (it may be given up to a step late), where the end effector
        is at that time: `set_end` is for jumps. Until then the motions given before go on, so that
        several can be given at once, of any duration (`EndMotion.then`); what they prescribe from
        then on is dropped.

        Raises:
            TypeError, ValueError: no end, no motion, or one that begins before now or elsewhere.
        """
        if any(obstacle.name == end for obstacle in self.scene.bodies):
            return self.move_obstacle(end, motion)
        self.ends.check_motion(end, self.time, motion, self.step, self.model.origin)
        motion = motion.moved(-self.model.origin)
        if not self.ends.follow_later(end, self.time, motion):
            self.ends.follow(end, self.time, motion)
        self._need(self._needs_moved(end))
        self._turn_natural_shape()

    # -- obstacles --------------------------------------------------------------------------------

    def set_obstacle(
        self, name: str, position: ArrayLike, orientation: ArrayLike = rotations.IDENTITY
    ) -> None:
        """Put an obstacle at a pose from now on, at rest; the work that this does is its own.

        Raises:
            TypeError, ValueError: no obstacle, or not a pose.
        """
        motion = EndMotion.resting(position, orientation, self.time)
        kept = {one: found for one, found in self._pressures.items() if one == name}
        self.cable.settle(self.time)
        before = self.cable.present_energy()
        self.move_obstacle(name, motion)
        self.cable.place_obstacles(self.time)
        self._give_way(kept, obstacles.Overlap.JUMPED)
        self.cable.account.drive_work += self.cable.present_energy() - before

    def move_obstacle(self, name: str, motion: EndMotion) -> None:
        """Let an obstacle follow a motion, which begins where it is then; afterwards it rests.
        Motions that begin later wait, as those of `set_motion`.

        Raises:
            TypeError, ValueError: no obstacle, or no motion.
        """
        self._obstacle(name)
        arguments.instance("motion", motion, EndMotion, "dlo_sim.EndMotion")
        motion = motion.moved(-self.model.origin)
        leaves = obstacles.leaves_plane(motion, self.model.axes)
        needs = self.needs.spatial(self.scene) if leaves else self.needs
        self._need(needs)
        row = self._obstacle(name)
        row[ACTIVE] = 1.0
        moves = bool(row[START] + row[DURATION] > self.time)
        if not self.ends.queue.keep(name, self.time, motion, moves):
            self.ends.queue.drop(name)
            obstacles.write(row, motion)

    def add_obstacles(self, added: Iterable[Obstacle]) -> None:
        """Add obstacles, at rest at their poses from now on; the work that this does is theirs.

        Needs the method energy_momentum or another one with one implicit step. The memory grows
        with their number, and code is compiled with the first one of a shape, unless the scene
        makes room for them (contact.markers).

        Raises:
            TypeError, ValueError: an obstacle as no scene has it, the name of another one, the
                cable is inside it, or another method; none of them is added.
        """
        found, new = self.scene, tuple(added)
        for obstacle in new:
            arguments.instance("obstacle", obstacle, Obstacle, "dlo_sim.Obstacle")
            check_added(found, obstacle)
            self.check_obstacle(obstacle)
            found = replace(found, added=(*found.added, obstacle))
        self.replace_added(found.added)

    def check_obstacle(self, obstacle: Obstacle) -> None:
        """Refuse an obstacle that the cable is inside of now.

        Raises:
            SceneError: it is.
        """
        diameter, length = self.scene.cable.diameter, self.scene.cable.length
        u = np.linspace(0.0, length, obstacles.PLACES)
        obstacles.check_outside(obstacle, diameter, u, self.centerline(u))

    def remove_obstacles(self, names: Iterable[str]) -> None:
        """Remove obstacles that `add_obstacles` added; what that takes away is their work.

        Raises:
            TypeError, ValueError: no such obstacle; none of them is removed.
        """
        known = [one.name for one in self.scene.bodies]
        gone = {arguments.one_of("obstacle", name, known) for name in names}
        for name in sorted(gone - {one.name for one in self.scene.added}):
            raise ValueError(
                f"obstacle: {name!r} is of the scene, and only added ones can be removed; move it "
                "away"
            )
        self.replace_added(tuple(one for one in self.scene.added if one.name not in gone))

    def replace_added(self, added: tuple[Obstacle, ...]) -> None:
        """Replace the obstacles that were added to those of the scene, without checking them: new
        ones rest at their poses, those that were there continue their motion.

        Raises:
            ValueError: the method, or terms.contact, allows none.
        """
        if added == self.scene.added:
            return
        scene, known = replace(self.scene, added=added), set(self.scene.bodies)
        if self.choice.method.family != IMPLICIT or len(self.choice.method.substeps) > 1:
            raise ValueError(
                f"obstacles: none can be added with integrator.method {self.method}, as they may "
                "be stiffer than its steps allow; use energy_momentum"
            )
        if not scene.touches and added:
            raise ValueError("obstacles: terms.contact is off; set it to auto")
        obstacles.fields_of(scene)  # refuses a mesh while nothing is changed
        self.cable.settle(self.time)
        before, kept = self.cable.present_energy(), self._pressures
        self.scene, needs = scene, self.needs.with_contact(bool(scene.bodies) and scene.touches)
        place = self._geometries["start"].attachment + self._origin
        missing = {0, 1, 2} - set(needs.axes)
        across = any(one.pushes_along(k, float(place[k])) for k in missing for one in added)
        if across or (added and scene.terms.out_of_plane != "off"):
            needs = needs.spatial(scene)
        for one in known ^ set(scene.bodies):
            self.ends.queue.drop(one.name)
        self.activate(needs, self._geometries)
        new = (one.name for one in set(scene.bodies) - known)
        self._give_way({name: kept.get(name, obstacles.UNTOUCHED) for name in new})
        self.cable.account.drive_work += self.cable.present_energy() - before

    @property
    def contacts(self) -> dict[str, obstacles.Contact]:
        """`contact` of all obstacles by name, and of the cable with itself under ITSELF."""
        touching = self.scene.bodies if "contact" in self.needs else ()
        found = {obstacle.name: self.contact(obstacle.name) for obstacle in touching}
        if "self_contact" in self.needs:
            tension = obstacles.tension_along(self.scene, self.cable)
            found[obstacles.ITSELF] = self_contact.contact_with_itself(
                self.cable, self.scene.cable.diameter, tension
            )
        return found

    def contact(self, name: str) -> obstacles.Contact:
        """What of the cable touches an obstacle now.

        Raises:
            TypeError, ValueError: no obstacle that the cable can touch.
        """
        self._obstacle(name)
        number = [o.name for o in self.scene.bodies].index(name)
        tension = obstacles.tension_along(self.scene, self.cable)
        body = self.scene.bodies[number]
        pose = self.end_pose(name) if body.shape in obstacles.GUIDES else None
        return obstacles.contact_with(self.cable, number, body, pose, tension)

    @property
    def _touchable(self) -> tuple[str, ...]:
        """Names of the obstacles that the cable can touch, in the order of their numbers."""
        return tuple(one.name for one in self.scene.bodies) if "contact" in self.needs else ()

    @property
    def _pressures(self) -> dict[str, obstacles.Pressure]:
        """By which pressure each obstacle presses the cable now."""
        names = self._touchable
        return {name: obstacles.pressure_by(self.cable, k) for k, name in enumerate(names)}

    def _give_way(
        self,
        kept: Mapping[str, obstacles.Pressure] | None = None,
        how: obstacles.Overlap = obstacles.Overlap.BEGAN,
        let_be: float = 0.0,
    ) -> None:
        """Let obstacles `give_way` that press the cable more than `kept`, by name; count them.
        Default: all, from no pressure.
        """
        diameter = self.scene.cable.diameter
        kept = dict.fromkeys(self._touchable, obstacles.UNTOUCHED) if kept is None else kept
        for number, name in enumerate(self._touchable):
            if name in kept:
                depth = obstacles.give_way(self.cable, number, kept[name], let_be)
                if depth > how.notable * diameter:
                    count, most = self.remarks.overlaps.get((name, how), (0, 0.0))
                    self.remarks.overlaps[name, how] = count + 1, max(most, depth)

    def surface(self, name: str) -> Array:
        """Triangles [m] that show an obstacle that is a mesh, ring or channel, in its frame, shape
        (k, 3, 3).

        Raises:
            TypeError, ValueError: no obstacle that the cable can touch.
        """
        self._obstacle(name)
        return obstacles.surface(next(o for o in self.scene.bodies if o.name == name))

    def _obstacle(self, name: str) -> Array:
        """Motion of the obstacle of this name, a view."""
        names = self._touchable
        return self.cable.obstacles[names.index(arguments.one_of("obstacle", name, names))]

    def _put_end(
        self,
        end: str,
        position: ArrayLike | None,
        orientation: ArrayLike | None,
        tangent: ArrayLike | None = None,
    ) -> None:
        """`set_end` to a position in the cable's coordinates."""
        before = self.ends.state_of(end)
        self.ends.place(end, self.time, position, orientation, tangent)
        # What the jump brings in begins where the end was: its springs do work on the way.
        needs, after = self._needs_moved(end), self.ends.state_of(end)
        self.ends.set_state(end, before)
        self._need(needs)
        self.ends.set_state(end, after)
        self._turn_natural_shape()
        if self.choice.method.family != IMPLICIT:  # implicit steps account for the jump exactly
            self.cable.jump(self.time, lambda points: self.ends.put(points, self.time))

    def _needs_moved(self, end: str) -> Needs:
        """What a moved end needs: the drive itself, the third coordinate, twist."""
        first = self._geometries[end].position
        leaves_plane = not self.ends.stays_in_plane(end, self.model.axes, first)
        twists = "twist" not in self.needs and self.ends.twists(end)
        return needs_of_end(self.needs, self.scene, leaves_plane=leaves_plane, twists=twists)

    def _needs_along(self, end: str, path: Array) -> Needs:
        """Needs once an end effector moves along a path of poses, shape (K, 7)."""
        turned = rotations.multiply(path[:, 3:], rotations.conjugate(path[0, 3:]))
        turns = rotations.to_rotation_vector(turned)
        across = [axis for axis in range(3) if axis not in self.model.axes]
        leaves = bool(across) and bool(
            np.ptp(path[:, across]) > 0.0 or np.abs(turns[:, list(self.model.axes)]).max() > 1e-12
        )
        rolls = self.scene.holders[end].holds_roll
        twists = rolls and bool(np.abs(turns @ self.ends.tangent(end, self.time)).max() > 1e-12)
        return needs_of_end(self.needs, self.scene, leaves_plane=leaves, twists=twists)

    # -- grasps -----------------------------------------------------------------------------------

    def take(self, grasp: str, at: float | None = None) -> None:
        """Let a grasp take the cable: from now on what it holds moves with its gripper.

        The cable stays where it is; only the velocity of what is held becomes the gripper's, and
        the energy of that counts as work of the end effectors.

        Args:
            at: where on the cable, 0 at start, 1 at end, negative: nearest to the gripper; default:
                as the scene says.

        Raises:
            TypeError, ValueError: no grasp, one that holds the cable, or no place on the cable.
        """
        self._hold(grasp, self._geometry_taken(grasp, at))

    def check_take(self, grasp: str, at: float | None = None) -> None:
        """Refuse what `take` would refuse now.

        Raises:
            TypeError, ValueError: as `take`.
        """
        self._held_with(grasp, self._geometry_taken(grasp, at))

    def release(self, grasp: str) -> None:
        """Let a grasp release the cable; its gripper goes on as it does.

        Raises:
            TypeError, ValueError: no grasp, or one that does not hold the cable.
        """
        self._known_grasp(grasp)
        if self.held_now[grasp].u is None:
            raise ValueError(f"grasp '{grasp}': does not hold the cable; take it before")
        self._hold(grasp, replace(self.held_now[grasp], u=None))

    def held_at(self, grasp: str) -> float | None:
        """Material coordinate [m] at which a grasp holds the cable now; None: it does not.

        Raises:
            TypeError, ValueError: no grasp.
        """
        self._known_grasp(grasp)
        return self.held_now[grasp].u

    @property
    def slides(self) -> dict[str, Slide]:
        """What slides through which grasp."""
        found, length, EI = {}, self.scene.cable.length, self.scene.cable.EI
        away = 2.0 * length / (self.model.n - bspline.DEGREE)
        for name in [grasp.name for grasp in self.scene.grasps if grasp.slides]:
            u = self.held_now[name].u
            if u is not None:
                beside = np.clip([u - away, u + away], 0.0, length)
                pulls = self.tension(beside) + 0.5 * EI * self.curvature(beside) ** 2
                found[name] = Slide(float(u), *pulls.tolist())
        return found

    @property
    def held_now(self) -> Geometries:
        """What holds the cable, at the present material coordinates; a cable that has slipped out
        of a grasp is not held by it.
        """
        if not self.model.has(SLIDING):
            return self._geometries
        names, held = list(self.scene.holders), dict(self._geometries)
        for slide, u in zip(self.model.holding.slides, self.cable.slides, strict=True):
            geometry = held[names[slide.grasp]]
            held[names[slide.grasp]] = replace(geometry, u=None if u == LOST else float(u))
        return held

    def _known_grasp(self, name: str) -> Grasp:
        known = [grasp.name for grasp in self.scene.grasps]
        return self.scene.grasp(arguments.one_of("grasp", name, known))

    def _geometry_taken(self, grasp: str, at: float | None) -> Geometry:
        """How a grasp would hold the cable if it took it now."""
        scene_grasp = self._known_grasp(grasp)
        if self.held_now[grasp].u is not None:
            raise ValueError(f"grasp '{grasp}': holds the cable already; release it before")
        share = scene_grasp.at if at is None else arguments.number("at", at, "from -1 to 1")
        length = self.scene.cable.length
        return self._curve.taken(share, length, *self.ends.pose(grasp, self.time))

    def _hold(self, grasp: str, geometry: Geometry) -> None:
        """Hold the cable as a grasp does from now on; what that changes in energy is its work."""
        geometries = self._held_with(grasp, geometry)
        self.cable.settle(self.time)
        before, held = self.cable.present_energy(), self.held_now[grasp].u
        self.ends.hold(grasp, geometry)
        if geometry.u is not None:
            angle = self._curve.twist_at(geometry.u, self.cable.points)
            self.ends.count_from(grasp, self.time, angle)
        self.activate(self.needs, geometries)
        if geometry.u is None:
            self.cable.part_strands(held)
        self.cable.account.drive_work += self.cable.present_energy() - before

    def _held_with(self, grasp: str, geometry: Geometry) -> Geometries:
        """All that holds the cable, with a grasp like this.

        Raises:
            SceneError: it holds what is held already.
        """
        geometries = {**self.held_now, grasp: geometry}
        model = self.model
        holding_of(self.scene, geometries, model.knots, model.axes, model.twist)
        return geometries

    # -- state ------------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """The present state, from which `restore` continues bit for bit."""
        return Snapshot(
            self.scene,
            self.steps,
            self._remainder,
            self.needs,
            self.cable.state.copy(),
            self.cable.inputs.copy(),
            self._geometries,
            self._origin,
            self.step,
            self.ends.queue.by_name,
            dict(self.remarks.overlaps),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this simulator.

        Raises:
            TypeError: not a snapshot. ValueError: a snapshot of another scene.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        if snapshot.scene != replace(self.scene, added=snapshot.scene.added):
            raise ValueError("snapshot: is of another scene; restore it where it was taken")
        self.steps = snapshot.steps
        self._remainder = snapshot.remainder
        known = snapshot.scene == self.scene and snapshot.geometries is self._geometries
        if snapshot.needs != self.needs or not known:
            self.scene = snapshot.scene
            self._geometries, self._origin = snapshot.geometries, snapshot.origin
            self.cable.activate(
                build_model(self.scene, snapshot.needs, self._geometries, origin=self._origin)
            )
            self._hold_cable()
            self._shape_naturally()
        self.needs = snapshot.needs  # equal needs may have different warnings
        self.cable.state[:] = snapshot.state
        self.cable.inputs[:] = snapshot.inputs
        if self.remarks.fell and self.remarks.fell[0] > self.time:
            self.remarks.fell = None
        self.ends.restored()
        self.ends.queue.replace(snapshot.waiting)
        self.remarks.overlaps = dict(snapshot.overlaps)
        if snapshot.step != self.step:  # of explicit steps, chosen in another shape
            self.choice = replace(self.choice, step=snapshot.step)
            self.stepper = Stepper(self.scene, self.cable, self.choice.method, self.step)

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
        place, rates = cable_through(self.scene, self.ends, self._geometries, self.model, *given)
        twist = self.control_points[:, 3:]
        self._begin(np.hstack([place, twist]), np.hstack([rates, np.zeros_like(twist)]))

    def _begin(self, points: ArrayLike, rates: ArrayLike | None) -> None:
        """`start_from` control points in the cable's coordinates."""
        place = self.model.own_columns("control points", points)
        speed = np.zeros_like(place)
        if rates is not None:
            speed = self.model.own_columns("velocities", rates, rest=False)
        before = self.snapshot()
        given = place.copy()
        self.ends.take_frame_turns(self.cable.frame_turn)
        self.ends.put(place, 0.0)
        self.cable.forget_contact()
        self.remarks.clear()
        self.cable.put(place, speed, 0.0)
        if self._natural.follows:
            self._lay_natural_shape()
        shifted = np.abs(self.cable.points - given).max()
        self._give_way(let_be=math.inf)
        self.cable.open_account(self.scene)
        if not math.isfinite(self.cable.account.energy_start):
            self.restore(before)
            raise ValueError("control points: have no finite energy; neighbours must not coincide")
        self.steps, self._remainder = 0, 0.0
        self._initial = self.snapshot()
        if shifted > 1e-9 * self.scene.cable.length:
            warnings.warn(
                "control points: those held by the ends differ from the held poses by "
                f"{shifted:.3g} m (or rad) and were moved back; start from `control_points`, or "
                "move the ends with set_end first",
                stacklevel=2,
            )

    def correct(self, shift: ArrayLike, speed: ArrayLike) -> float:
        """Add to the positions [m] and velocities [m/s] of the control points, shapes (n_u, 3).

        What is held stays where it is held. The energy that this puts in, which is returned [J],
        counts as work of the loads.

        Raises:
            TypeError, ValueError: not such numbers, or a shape without a finite energy; a cable
                of constant length.
        """
        if inextensible(self.scene):
            raise ValueError("correct: terms.stretch: off keeps the length; set it to auto")
        points, rates, cable = self.cable.points, self.velocities, self.cable
        shape = len(points), 3
        points[:, :3] += arguments.numbers("shift", shift, shape, "m")
        rates[:, :3] += arguments.numbers("speed", speed, shape, "m/s")
        cable.settle(self.time)
        before, kept = cable.present_energy(), (cable.state.copy(), cable.inputs.copy())
        lost = cable.account.dissipated
        self.ends.take_frame_turns(cable.frame_turn)
        self.ends.put(points, self.time)
        cable.put(points, rates, self.time, follow=True)
        work = cable.present_energy() - before + cable.account.dissipated - lost
        if not math.isfinite(work):
            cable.state[:], cable.inputs[:] = kept
            raise ValueError(
                "shift, speed: give a shape without a finite energy; give smaller ones"
            )
        cable.account.load_work += work
        return float(work)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Connect the end effectors of a copy to the copy's own arrays."""
        self.__dict__.update(state)
        self.ends.live_in(self.cable.motion)

    # -- another scene ----------------------------------------------------------------------------

    def reconfigured(self, scene: Scene) -> Simulator:
        """A simulator of another scene that starts with this one's shape, motion and ends, and with
        what its friction holds if the knots are the same (of strands, also diameter and stiffness).

        Loads are those of the scene; `set_load` must be called again. Building takes time: if this
        simulator has advanced meanwhile, let the new one `take_over` its state. Control points and
        knots that the scene leaves open are those of this simulator. Obstacles, and strands, yield
        until they press the cable no more than before.

        Raises:
            ValueError: the scene cannot be simulated, or the state has no finite energy in it.
        """
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        scene, resolution = resolved(continued(scene, self.scene))
        # Tangents that the scene does not give are those of this simulator.
        tangents = {
            f"{end}.tangent": list(self._geometries[end].tangent)
            for end in scene.ends
            if not any(scene.ends[end].tangent)
        }
        poses = {name: self.end_pose(name) for name in scene.holders | scene.moved}
        other = Simulator(replace(scene.with_values(tangents), added=()), poses, continues=True)
        other.scene, other.resolution = replace(scene, added=()), resolution
        other.take_over(self)
        if not math.isfinite(other.cable.account.energy_start):
            raise ValueError("scene: the present shape and motion have no finite energy in it")
        return other

    def take_over(self, other: Simulator) -> None:
        """Start with the present shape, motion and ends of another simulator, whose scene has the
        same ends, grasps and loads. Call it only before the first step.
        """
        arguments.instance("other", other, Simulator, "one that runs")
        self.replace_added(other.scene.added)
        if len(other.model.axes) == 3:
            self._need(self.needs.spatial(self.scene))
        if other.cable.points[:, 3].any():
            self._need(self.needs.with_twist(self.scene))
        way = other._origin - self._origin
        points, rates = self.cable.shape_of(other.cable, other.time)
        here = {*self.scene.holders, *(one.name for one in self.scene.bodies)}
        self.ends.queue.take_over(other.ends.queue.by_name, here, other.time, way)
        self.ends.take_over(other.ends, other.time, other.cable.frame_turn, way)
        for name in self.scene.holders:
            if self.ends.state_of(name)[0][ACTIVE]:
                self._need(self._needs_moved(name))
        taking = self._take_over_grasps(other)
        for name, holder in self.scene.holders.items():
            at = self._geometries[name].u
            if at is not None and holder.holds_roll and not other.scene.holders[name].holds_roll:
                self.ends.count_from(name, 0.0, self._curve.twist_at(at, points))
        obstacles.take_over(self.cable, other.cable, other.time)
        self.ends.pull_springs(self.cable, self.time)
        self.ends.put(points, 0.0)
        self.cable.point_grasps(0.0)
        self.cable.put(points, rates, 0.0)
        self.cable.take_over_samples(other.cable)
        self.cable.take_over_contact(other.cable)
        if self._natural.follows and not self._natural.equals(other._natural):
            self._lay_natural_shape()
        self.cable.flow()
        for grasp in taking:
            self.take(grasp)
        names = set(self._touchable)
        self.remarks.overlaps = {
            key: n for key, n in other.remarks.overlaps.items() if key[0] in names
        }
        kept = other._pressures
        self._give_way(kept, obstacles.Overlap.CHANGED)
        self._give_way(dict.fromkeys(names - kept.keys(), obstacles.UNTOUCHED))
        now, before = (
            {one.u for one in sim.held_now.values() if one.u is not None} for sim in (self, other)
        )
        self.cable.open_account(self.scene, other.cable, sorted(before - now))
        self._initial = self.snapshot()

    def _take_over_grasps(self, other: Simulator) -> list[str]:
        """Hold what the other simulator's grasps hold, as far as the scene agrees; returns the
        names of the grasps that still have to take the cable.
        """
        held, taking = dict(self._geometries), []
        theirs = moved(other.held_now, other._origin - self._origin)
        for grasp in self.scene.grasps:
            name, before = grasp.name, theirs[grasp.name]
            if grasp.taken and before.u is not None and grasp.at == other.scene.grasp(name).at:
                longer = self.scene.cable.length / other.scene.cable.length
                held[name] = replace(before, u=before.u * longer)
                self.ends.hold(name, held[name])
            else:
                held[name] = replace(held[name], u=None)
                slipped_out = before.u is None and other.scene.grasp(name).taken
                taking += [name] * (grasp.taken and not slipped_out)
        if self.scene.grasps:
            self.activate(self.needs, held)
        return taking

    # -- arrays -----------------------------------------------------------------------------------

    def _largest_frequency(self) -> float:
        """Of the cable as it begins, with what may hold it [rad/s]; 0 for implicit methods."""
        if is_implicit(self.scene):
            return 0.0
        return largest_frequency(self.scene, self.cable)

    def _fill_loads(self) -> None:
        """Loads of the scene in the inputs of the cable."""
        for row, load in zip(self.cable.loads, self.scene.loads, strict=False):
            if load.signal != "none":
                row[:3], row[3:6] = load.force, load.torque
            row[6] = load.frequency if load.signal == "sine" else 0.0

    def _hold_cable(self) -> None:
        """Let the end effectors and grasps hold the cable where they are now."""
        self.ends.live_in(self.cable.motion)
        self.ends.pull_springs(self.cable, self.time)
        self.cable.point_grasps(self.time if self.steps else 0.0)
        self.cable.place_obstacles(self.time)

    def _shape_naturally(self) -> None:
        """Write the natural shape of the scene to the arrays, turned with the start."""
        tangent = self._geometries["start"].tangent
        self._natural = NaturalShape(self.scene, self.cable, tangent, self._start_orientation)

    def _turn_natural_shape(self) -> None:
        """Turn the natural shape with the start's end effector, which does the work."""
        self._natural.turn(self._start_orientation)

    def _lay_natural_shape(self) -> None:
        """Lay the natural shape along the present shape, with plastic flow as if bent in one
        motion.
        """
        self._lay_unslipped()
        self.cable.flow()

    def _lay_unslipped(self) -> None:
        self._natural.lay(self._start_orientation, self.frames(self._natural.places))

    @property
    def _start_orientation(self) -> Array:
        return self.ends.orientation("start", self.time)

    def _load_ahead(self) -> None:
        """Load the code of what may come, which no step or tick must have to compile: reading the
        state, the twist that a moment brings, and a grasp that takes or releases the cable.
        """
        self.cable.velocities(0.0)
        self.cable.balance()
        self.cable.present_energy()
        needs = needs_of_load(self.needs, self.scene, None, np.ones(3))
        if moments_may_come(self.scene) and "twist" in needs and "twist" not in self.needs:
            self._need(needs)
            self._read()
            self.restore(self._initial)
        if self.scene.contact.markers and "contact" not in self.needs:
            x, y, z = (self._origin + 1e3 * self.scene.cable.length).tolist()
            mesh = as_text(obstacles.surface(Obstacle("box", "box")))
            body = Obstacle("body", "mesh", position=(x, y, z), mesh=mesh, mesh_cells=8)
            self.replace_added((body,))
            self._read()
            self.restore(self._initial)
        for grasp in self.scene.grasps:
            try:
                if self._geometries[grasp.name].u is None:
                    self.take(grasp.name)
                else:
                    self.release(grasp.name)
            except ValueError:  # refused where it is now, not for ever
                continue
            self._read()
            self.restore(self._initial)

    def _read(self) -> None:
        """Step and read the state as a node does, with the terms that are active now."""
        self.stepper.advance(0, 0)
        self.control_poses(np.empty((self.model.n, 7)))
        for holder in self.scene.holders:
            self.reaction_wrench(holder)
        self.contacts  # noqa: B018

    def _need(self, needs: Needs) -> None:
        """Activate the terms and lines that these needs add; the state is kept."""
        had, has = ((one.axes, "twist" in one, "loads" in one) for one in (self.needs, needs))
        if had == has:
            self.needs = needs
        else:
            self.activate(needs, self.held_now)

    def activate(self, needs: Needs, geometries: Geometries) -> None:
        """Go on with other needs or grasps from the present state."""
        cable, points, rates = self.cable, self.cable.points, self.velocities
        pulled = dict(zip(self.model.spring_places, cable.anchors.tolist(), strict=True))
        in_material_frame = self.model.has(MATERIAL)
        self.ends.take_frame_turns(cable.frame_turn)
        self.needs, self._geometries = needs, geometries
        cable.activate(build_model(self.scene, needs, geometries, origin=self._origin))
        self._hold_cable()
        for k, held in enumerate(self.model.spring_places):
            cable.anchors[k] = pulled.get(held, cable.anchors[k])
        self._shape_naturally()
        cable.put(points, rates)
        if self.model.has(MATERIAL) and not in_material_frame:
            self._lay_natural_shape()
        cable.flow()


def _three(name: str, value: ArrayLike | None, unit: str) -> Array | None:
    """Three finite numbers, or None."""
    return None if value is None else arguments.numbers(name, value, (3,), unit)


def _coordinates(u: ArrayLike) -> Array:
    """Material coordinates given by a caller, checked to be numbers."""
    return arguments.numbers("u", u, (None,), "m, from 0 to the length")
