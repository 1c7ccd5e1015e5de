"""The simulator: one cable of one scene, with everything that may be done to it and read from it.

Its attributes are the scene, the arrays of the cable (`Cable`), the end effectors and their motions
(`EndDrive`), and the method's steps (`Stepper`). Positions in the arrays are relative to the origin
of the model; those that callers give and get are in the world.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine.grasps import ACTIVE, DURATION, START
from dlo_sim.scene.description import EARTH, Obstacle, Scene, check_added
from dlo_sim.scene.needs import check_terms, inextensible, needs_of, with_load
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation import following, obstacles, remarks, self_contact
from dlo_sim.simulation.bodies import write
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.curve import Curve
from dlo_sim.simulation.drawn_strands import held_geometries, twists_of
from dlo_sim.simulation.ends import NEAR, apart
from dlo_sim.simulation.forecast import EVERY, Forecast, Plan, checked_times, shape_times
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import Pose, known_holder, moved, origin_of
from dlo_sim.simulation.going_on import load_ahead, take_over
from dlo_sim.simulation.model import MAIN
from dlo_sim.simulation.play import stretch
from dlo_sim.simulation.reaction import reaction
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Slide
from dlo_sim.simulation.resolution import continued, resolved
from dlo_sim.simulation.running import Running
from dlo_sim.simulation.selection import choose, method_of
from dlo_sim.simulation.soundness import sound_now
from dlo_sim.simulation.start_from_points import cable_through
from dlo_sim.simulation.statics import FirstShape
from dlo_sim.simulation.timeline import recorded

Array = NDArray[np.float64]
LIGHT = 20.0  # weights of the cable that an obstacle in which it begins may press it with


class Simulator(Running):
    """A cable of one scene that is stepped, loaded, moved by its ends, and observed.

    Attributes:
        scene: with the number of control points and the knots that were chosen where it left them
            open. choice: method, step and the reason for them. cable: the arrays. follower: repeats
            every change (`timeline.recorded`), or None.

    Args:
        scene: what to simulate, from `dlo_sim.load_scene`.
        end_poses: poses of end effectors and obstacles at time 0, {"start": (position [m] (3,),
            quaternion x, y, z, w (4,)), ...}; the others have the poses of the scene.
        unchecked_step: use integrator.step even above the stability limit (to study stability).
        near: another simulator; of several equilibria the cable begins in that nearest to its
            present shape, so that a finer run of the same scene begins as it did.
        before: another simulator whose state this one will `take_over`, so that no first shape is
            looked for, nor refused.

    For an argument of a wrong type or value, every method raises a TypeError or ValueError of one
    line that names the cure, and leaves the state unchanged.

    Raises:
        SceneError: a scene that cannot be simulated, in one line.
    """

    compile_seconds = 0.0

    def __init__(
        self,
        scene: Scene,
        end_poses: Mapping[str, Pose] | None = None,
        *,
        unchecked_step: bool = False,
        near: Simulator | None = None,
        before: Simulator | None = None,
    ) -> None:
        arguments.instance("scene", scene, Scene, "dlo_sim.load_scene")
        scene, resolution = resolved(scene)
        needs = needs_of(scene, before is not None)
        check_terms(scene, needs)
        implicit = method_of(scene)[0].family == IMPLICIT
        bodies = {one.name for one in scene.bodies}
        given = {} if end_poses is None else end_poses
        poses = given
        if isinstance(given, Mapping):  # else `geometries_of` refuses it
            poses = {name: pose for name, pose in given.items() if name not in bodies}
        held = held_geometries(scene, poses, before.geometries if before else None)
        origin = origin_of(held)
        super().__init__(build_model(scene, needs, moved(held, -origin), origin))
        for name in bodies & set(given):
            self.move_obstacle(name, EndMotion.resting(*given[name]))
        self.cable.place_obstacles(0.0)
        lay = self.lay_unslipped if self.natural.follows else None
        shape = self.cable.shape_of(near.cable, near.time)[0] if near else None
        first = FirstShape(self.ends, self.cable, lay)
        resting = first.place(shape, before is not None)
        if not before:
            places = [
                [one.u for one in part.model.geometries.values() if one.u is not None]
                for part in self.model.parts
            ]
            self_contact.check_start(self.cable, places)
        frequency = 0.0 if implicit else largest_frequency(scene, self.cable)
        choice = choose(scene, frequency, unchecked_step)
        self.step_by(replace(choice, resolution=resolution))
        if not given and not before and not scene.is_net:
            remarks.look_at_start(self)
        if not resting:
            self.give_way(let_be=LIGHT * scene.cable.mu * EARTH)
        self.cable.open_account()
        started = time.perf_counter()
        self.stepper.advance(0, 0)  # no tick must have to compile this or the next line
        sound_now(self.cable, self.ends, 0.0)
        self.noticed.unstable_first = remarks.unstable_in_plane(self)
        self.initial = self.snapshot()
        load_ahead(self)
        self.compile_seconds = time.perf_counter() - started

    # -- what it is -------------------------------------------------------------------------------

    @property
    def resolution(self) -> str:
        """How many control points it has, and why, one line."""
        return self.choice.resolution

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return self.choice.method.name

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
        return remarks.warnings(self, found)

    @property
    def control_points_needed(self) -> int:
        """Number of control points that follow the bends of the cable round what it touches now, or
        touched in a recorded run; 0 if these do.
        """
        return remarks.points_needed(self, self.contacts)

    @property
    def contact_stiffness_needed(self) -> float:
        """The `contact.stiffness` [N/m^2] with which the cable would not have been pressed too deep
        into what it touched; 0 if it was not.
        """
        return remarks.stiffness_needed(self, self.contacts)

    @property
    def clearance_to_itself(self) -> float:
        """Smallest gap [m] between strands of the cable, negative where they overlap; infinite if
        it is nearly straight.
        """
        return self_contact.nearest(self.model, self.cable.points).clearance

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers of the results, one line each."""
        return self.warnings + remarks.notes(self)

    # -- shape and forces -------------------------------------------------------------------------

    @property
    def greville(self) -> Array:
        """Material coordinate [m] of each control point (Greville abscissa), shape (n_u,)."""
        return self.curve.greville.copy()

    def centerline(self, u: ArrayLike, strand: str = MAIN) -> Array:
        """Points of the cable [m] at material coordinates u [m] in [0, L], shape (len(u), 3).

        Args:
            strand: of a net, `cable` or the name of a branch or further cable.

        Raises:
            TypeError, ValueError: not such numbers; no such cable.
        """
        return self.strand(strand).points(_coordinates(u))

    def strand(self, name: str) -> Curve:
        """A cable of a net, `cable` or the name of a branch or further cable: its rest length,
        control points and their material coordinates.

        Raises:
            TypeError, ValueError: no such cable.
        """
        return self.curves[arguments.one_of("strand", name, self.curves)]

    def tension(self, u: ArrayLike, strand: str = MAIN) -> Array:
        """Tension EA (|r'| - 1) - EI kappa^2 [N] at u, shape (len(u),), without damping forces.

        Interpolated linearly between the means of the knot spans; negative under compression.

        Raises:
            TypeError, ValueError: as `centerline`; the shape does not determine the tension.
        """
        return self.strand(strand).tension(_coordinates(u))

    def curvature(self, u: ArrayLike, strand: str = MAIN) -> Array:
        """Curvature [1/m] at u, shape (len(u),), 0 or more.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        return self.strand(strand).curvature(_coordinates(u))

    def frames(self, u: ArrayLike, strand: str = MAIN) -> Array:
        """Material frames at u as quaternions x, y, z, w, shape (len(u), 4); x axis = tangent.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        return self.strand(strand).frames(_coordinates(u), self.time)

    def control_poses(self, out: Array, strand: str = MAIN) -> None:
        """Write into out, shape (n_u, 7), every control point [m] of a cable with the material
        frame at its material coordinate, quaternion x, y, z, w.

        Raises:
            TypeError: out is not such an array of doubles, contiguous and writeable.
            ValueError: no such cable.
        """
        curve = self.strand(strand)
        shape = len(curve.greville), 7
        fits = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == np.float64
        if not (fits and out.flags.c_contiguous and out.flags.writeable):
            raise TypeError(f"out: needs np.empty({shape}), got {arguments.given(out)}")
        curve.control_poses(self.time, out)

    def connector_pose(self, name: str) -> tuple[Array, Array]:
        """Position [m] (3,), world frame, and quaternion x, y, z, w (4,) of a connector.

        Raises:
            TypeError, ValueError: no such connector.
        """
        bodies = {one.connector.name: one for one in self.model.bodies if one.connector}
        body = bodies[arguments.one_of("connector", name, bodies)]
        pose = body.pose(self.cable.points[body.points, :3])
        return pose[:3] + self.origin, pose[3:]

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
        wanted = duration + self.remainder
        steps = float(np.floor(wanted / self.step + 1e-9))
        report = self.advance_steps(arguments.count(f"duration / {self.step:g} s", steps))
        self.remainder = wanted - report.steps * self.step if report.status.advanced else 0.0
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
        return following.record_along(self, times, poses, samples)

    def forecast(self, plan: Plan, every: float = EVERY) -> Forecast:
        """Predict the shapes along a plan, at multiples of `every` [s], bit for bit as `follow`.

        This simulator is not changed. Loads continue unchanged, and obstacles follow their motions.

        Raises:
            TypeError, ValueError: as `follow`, or a plan that does not begin at the present poses.
        """
        future = self.resumed(self.snapshot(), self.initial)
        times = checked_times(plan)
        given, count = plan.poses.items(), len(times)
        poses = {name: following.checked_path(self, name, rows, count) for name, rows in given}
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
        count, shapes = recorder.count, recorder.along()
        drawn = remarks.look_back(future, recorder, samples[:count])
        needed = future.control_points_needed, future.contact_stiffness_needed
        told = future.warnings, *needed
        return Forecast(samples[:count], *shapes, report, drawn, *told, recorder.net())

    # -- loads, end effectors and obstacles -------------------------------------------------------

    @recorded
    def set_load(
        self, name: str, force: ArrayLike | None = None, torque: ArrayLike | None = None
    ) -> None:
        """Set force [N] and moment [N m] of a load, world frame, ON the cable, until changed.

        Raises:
            TypeError, ValueError: no such load, or not three finite numbers.
        """
        names = [load.name for load in self.scene.loads]
        number = names.index(arguments.one_of("load", name, names))
        push = _three(f"force of {name}", force, "N")
        turn = _three(f"torque of {name}", torque, "N m")
        self.needs = with_load(self.needs, self.scene, name, push, turn)
        row = self.cable.loads[number]
        if push is not None:
            row[:3] = push
        if turn is not None:
            row[3:6] = turn
        row[6] = 0.0

    @recorded
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
        self.put_end(end, position, orientation, tangent)

    @recorded
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
        self.move_along(end, motion)
        if not self.ends.follow_later(end, self.time, motion):
            self.ends.follow(end, motion)
        self.turn_natural_shape()

    @recorded
    def set_obstacle(
        self, name: str, position: ArrayLike, orientation: ArrayLike = rotations.IDENTITY
    ) -> None:
        """Put an obstacle at a pose from now on, at rest; the work that this does is its own.

        Raises:
            TypeError, ValueError: no obstacle, or not a pose.
        """
        motion = EndMotion.resting(position, orientation, self.time)
        kept = {one: found for one, found in self.pressures.items() if one == name}
        with self.cable.working(self.time):
            self.move_obstacle(name, motion)
            self.cable.place_obstacles(self.time)
            self.give_way(kept, obstacles.Overlap.JUMPED)

    @recorded
    def move_obstacle(self, name: str, motion: EndMotion) -> None:
        """Let an obstacle follow a motion, which begins where it is then; afterwards it rests.
        Motions that begin later wait, as those of `set_motion`.

        Raises:
            TypeError, ValueError: no obstacle, or no motion.
        """
        self.body(name)
        arguments.instance("motion", motion, EndMotion, "dlo_sim.EndMotion")
        motion = motion.moved(-self.model.origin)
        if obstacles.leaves_plane(motion, self.model.axes):
            self.needs = self.needs.in_plane(self.scene)
        row = self.body(name)
        row[ACTIVE] = 1.0
        moves = bool(row[START] + row[DURATION] > self.time)
        if not self.ends.queue.keep(name, self.time, motion, moves):
            self.ends.queue.by_name.pop(name, None)
            write(row, motion)

    def add_obstacles(self, added: Iterable[Obstacle]) -> None:
        """Add obstacles, at rest at their poses from now on; the work that this does is theirs.

        Needs the method energy_momentum or another one with one implicit step. Code is compiled
        with the first one of a shape, unless the scene says that some may come (contact.markers).

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
        for strand, curve in zip(self.scene.strands, self.curves.values(), strict=True):
            u = np.linspace(0.0, curve.length, obstacles.PLACES)
            diameter = strand.scene.cable.diameter
            if wrong := obstacles.inside(obstacle, diameter, u, curve.points(u)):
                raise SceneError(f"{wrong}; move the obstacle or the cable's ends")

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

    def surface(self, name: str) -> Array:
        """Triangles [m] that show an obstacle that is a mesh, ring or channel, in its frame, shape
        (k, 3, 3).

        Raises:
            TypeError, ValueError: no obstacle that the cable can touch.
        """
        self.body(name)
        return obstacles.surface(next(o for o in self.scene.bodies if o.name == name))

    # -- grasps -----------------------------------------------------------------------------------

    @recorded
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
        self.hold(grasp, self.geometry_taken(grasp, at))

    def check_take(self, grasp: str, at: float | None = None) -> None:
        """Refuse what `take` would refuse now.

        Raises:
            TypeError, ValueError: as `take`.
        """
        self.model_held(grasp, self.geometry_taken(grasp, at))

    @recorded
    def release(self, grasp: str) -> None:
        """Let a grasp release the cable; its gripper goes on as it does.

        Raises:
            TypeError, ValueError: no grasp, or one that does not hold the cable.
        """
        self.known_grasp(grasp)
        if self.held_now[grasp].u is None:
            raise ValueError(f"grasp '{grasp}': does not hold the cable; take it before")
        self.hold(grasp, replace(self.held_now[grasp], u=None))

    @property
    def slides(self) -> dict[str, Slide]:
        """What slides through which grasp."""
        found = {}
        for name in [grasp.name for grasp in self.scene.grasps if grasp.slides]:
            u, curve = self.held_now[name].u, self.curve_held(name)
            if u is not None:
                away = 2.0 * curve.length / (len(curve.greville) - bspline.DEGREE)
                beside = np.clip([u - away, u + away], 0.0, curve.length)
                bent = 0.5 * curve.bending_stiffness * curve.curvature(beside) ** 2
                pulls = curve.tension(beside) + bent
                found[name] = Slide(float(u), *pulls.tolist())
        return found

    # -- another state, another scene -------------------------------------------------------------

    def start_from(self, points: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Set the initial state: control points (x, y, z, theta), shape (n_u, 4), and their
        velocities (default: at rest). Points held by the ends are moved back to the held poses,
        with a UserWarning if they differ.

        Raises:
            TypeError: not numbers. ValueError: another shape, not finite, a coordinate differs that
                the scene does not simulate, or the energy is not finite.
        """
        self.check_may_stretch("start_from")
        place = arguments.numbers("control points", points, (self.model.n, 4)).copy()
        place[:, :3] -= self.origin
        self.begin(place, rates)

    def start_from_points(
        self,
        points: ArrayLike | Mapping[str, ArrayLike],
        times: ArrayLike | None = None,
        coordinates: ArrayLike | Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Set the initial state: a smooth cable of the right length through measured points.

        Noise is smoothed and outliers are rejected. Ends and grasps keep their poses.

        Args:
            points: in their order along the cable [m], shape (M, 3), NaN where missing; or several
                frames of the same points, shape (F, M, 3). Of a net: cable -> its points.
            times: of the frames [s], rising, shape (F,); the initial state is that of time 0. Its
                velocities are those of lines through up to four frames, of parabolas through more;
                one frame: at rest.
            coordinates: material coordinates of the points [m], rising, shape (M,); default: found
                from the distances between the points. Of a net: cable -> its coordinates.

        Raises:
            TypeError: not numbers. ValueError: another shape, fewer than two points, points that
                coincide or are too far apart for the cable, times or coordinates that do not rise,
                or coordinates that are beyond the cable or not simulated.
        """
        self.check_may_stretch("start_from_points")
        place, rates = cable_through(self.ends, self.model, points, times, coordinates)
        twist = self.control_points[:, 3:]
        if self.model.joins:
            held = self.cable.held_twists(0.0)
            twist = twists_of(self.model, place, self.ends.orientation("start", 0.0), held)[:, None]
        self.begin(np.hstack([place, twist]), np.hstack([rates, np.zeros_like(twist)]))

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
        scene = replace(continued(scene, self.scene), added=())
        same = (scene.cable.length, scene.discretization) == (
            self.scene.cable.length,
            self.scene.discretization,
        )
        if inextensible(scene) and not (same and inextensible(self.scene)):
            raise ValueError(
                "terms.stretch: off keeps the length from the start of a run, with its "
                "cable.length and control points; begin anew with it, or set it to auto"
            )
        poses = {name: self.end_pose(name) for name in scene.holders | scene.moved}
        other = Simulator(scene, poses, before=self)
        other.take_over(self)
        if not math.isfinite(other.cable.account.energy_start):
            raise ValueError("scene: the present shape and motion have no finite energy in it")
        return other

    def take_over(self, other: Simulator) -> None:
        """Start with the present shape, motion and ends of another simulator, whose scene has the
        same ends, grasps and loads. Call it only before the first step.
        """
        take_over(self, arguments.instance("other", other, Simulator, "one that runs"))


def _three(name: str, value: ArrayLike | None, unit: str) -> Array | None:
    """Three finite numbers, or None."""
    return None if value is None else arguments.numbers(name, value, (3,), unit)


def _coordinates(u: ArrayLike) -> Array:
    """Material coordinates given by a caller, checked to be numbers."""
    return arguments.numbers("u", u, (None,), "m, from 0 to the length")
