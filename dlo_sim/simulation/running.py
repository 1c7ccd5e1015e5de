"""A cable that runs: its scene, its arrays, what holds and touches it, and its steps.

`Simulator` is what users call; what looks at a run (`remarks`) or steps it (`play`) works on this.
Positions are relative to the origin of the model.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine.arrays import ENERGIES, MATERIAL, SLIDING
from dlo_sim.engine.sliding import LOST
from dlo_sim.scene.description import Grasp, Obstacle, Scene
from dlo_sim.scene.needs import Needs, inextensible, needs_of
from dlo_sim.simulation import bodies, obstacles, self_contact
from dlo_sim.simulation.build_model import build_model, with_obstacles
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.curve import Curve
from dlo_sim.simulation.drawn_strands import frames_of
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import Geometries, Geometry
from dlo_sim.simulation.model import MAIN, Model, Part
from dlo_sim.simulation.natural_shape import NaturalShape
from dlo_sim.simulation.report import Energy
from dlo_sim.simulation.resolution import Shortfall
from dlo_sim.simulation.selection import Choice
from dlo_sim.simulation.stepper import CHUNK, Stepper
from dlo_sim.simulation.timeline import Change, Waiting, recorded

Array = NDArray[np.float64]
Overlaps = dict[tuple[str, obstacles.Overlap], tuple[int, float]]
"""Obstacle that was inside the cable, how it came there -> how often, how deep at most [m]."""


class Noticed:
    """What was noticed of a cable while it ran (`remarks`).

    Attributes:
        overlaps: see there. bends: of recorded runs. watch: how near it came to itself.
        fell: when the cable could fall to either side, and the projection (3, 3) onto these
            directions.
        unstable_first: warning of the first shape, if it is unstable in its plane.
    """

    def __init__(self) -> None:
        self.unstable_first = ""
        self.clear()

    def clear(self) -> None:
        """Forget all but the first shape."""
        self.overlaps: Overlaps = {}
        self.bends: dict[str, Shortfall] = {}
        self.fell: tuple[float, Array] | None = None
        self.watch = self_contact.Watch()


@dataclass(frozen=True)
class Snapshot:
    """Everything that changes of a cable that runs, with the constants that it belongs to: from a
    copy of it, any process goes on bit for bit.

    Attributes:
        model: the constants. needs: with the warnings so far. choice: method and step.
        steps: made so far. remainder: time [s] that is carried over to the next advance.
        state, inputs: the numbers of the cable. waiting: motions that have not begun.
        noticed: see there.
    """

    model: Model
    needs: Needs
    choice: Choice
    steps: int
    remainder: float
    state: Array
    inputs: Array
    waiting: Waiting
    noticed: Noticed

    @property
    def scene(self) -> Scene:
        """What is simulated."""
        return self.model.scene

    @property
    def geometries(self) -> Geometries:
        """What holds the cable, grasps as they took it."""
        return self.model.geometries


class Running:
    """A cable of one scene with its ends, natural shape, motions and steps.

    Attributes:
        needs: the terms. cable: the arrays. curves: centerlines by strand. natural: its natural
            shape. ends: end effectors.
        choice: method, step and the reason for them. stepper: of these steps. steps: made so far.
        noticed: see there. follower: repeats every change (`timeline.recorded`), or None.
    """

    choice: Choice
    stepper: Stepper
    initial: Snapshot

    def __init__(self, model: Model) -> None:
        self.needs = model.needs
        self.cable = Cable(model)
        self.curves = {
            part.name: Curve(self.cable, model.geometries[held].tangent, number)
            for number, part in enumerate(model.parts)
            for held in list(model.scene.holders)[part.grasp : part.grasp + 1]
        }
        self.ends = EndDrive(model)
        self.steps, self.remainder = 0, 0.0
        self.noticed = Noticed()
        self.follower: Callable[[Change], object] | None = None
        for row, load in zip(self.cable.loads, model.scene.loads, strict=False):
            if load.signal != "none":
                row[:3], row[3:6] = load.force, load.torque
            row[6] = load.frequency if load.signal == "sine" else 0.0
        self.hold_cable()

    @classmethod
    def resumed(cls, snapshot: Snapshot, initial: Snapshot | None = None) -> Self:
        """One that goes on from a snapshot, of this process or another one.

        Args:
            initial: to which it can be reset; default: the snapshot.

        Raises:
            TypeError: not a snapshot. ValueError: its numbers are none of a cable.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        found = cls.__new__(cls)
        Running.__init__(found, snapshot.model)
        found.initial = initial or snapshot
        found.step_by(snapshot.choice)
        found.restore(snapshot)
        if not (found.cable.indices_fit and math.isfinite(found.cable.present_energy())):
            raise ValueError("snapshot: its numbers do not fit; give one of Simulator.snapshot")
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy goes on from the same state, and is not followed."""
        return type(self).resumed, (self.snapshot(), self.initial)

    @property
    def curve(self) -> Curve:
        """That of the main cable."""
        return self.curves[MAIN]

    def curve_held(self, holder: str) -> Curve:
        """That of the strand that an end or grasp may hold."""
        number = list(self.scene.holders).index(holder)
        return self.curves[self.model.part_held(number).name]

    def outline(self, shares: Array) -> Array:
        """Points [m] of all strands at shares of their lengths, shape (strands len(shares), 3)."""
        lines = [curve.points(shares * curve.length) for curve in self.curves.values()]
        return np.concatenate(lines)

    @property
    def scene(self) -> Scene:
        """What is simulated: a scene that leaves nothing open (`resolution.resolved`)."""
        return self.model.scene

    @property
    def geometries(self) -> Geometries:
        """What holds the cable, grasps as they took it."""
        return self.model.geometries

    @property
    def origin(self) -> Array:
        """Origin of the cable's coordinates in the world [m], shape (3,)."""
        return self.model.origin

    @property
    def time(self) -> float:
        """Simulated time [s]: whole steps since the start."""
        return self.steps * self.choice.step if self.steps else 0.0

    @property
    def step(self) -> float:
        """Step tau [s]."""
        return self.choice.step

    @property
    def model(self) -> Model:
        """Constant arrays of the scene."""
        return self.cable.model

    @property
    def control_points(self) -> Array:
        """Control points (x, y, z [m], theta [rad]), shape (n_u, 4), a copy."""
        return self.model.in_world(self.cable.points)

    @property
    def velocities(self) -> Array:
        """Velocities of the control points [m/s, rad/s], shape (n_u, 4)."""
        return self.model.to_columns(self.cable.velocities(self.time), rest=False)

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

    # -- end effectors and their motions ----------------------------------------------------------

    def end_pose(self, end: str) -> tuple[Array, Array]:
        """Pose of an end effector or an obstacle at the present time: position [m] (3,), quaternion
        x, y, z, w (4,).
        """
        position, orientation = self.pose_of(end, self.time)
        return position + self.model.origin, orientation

    def put_end(
        self,
        end: str,
        position: ArrayLike | None,
        orientation: ArrayLike | None,
        tangent: ArrayLike | None = None,
    ) -> None:
        """`set_end` to a position in the cable's coordinates."""
        before, waiting = self.ends.state_of(end), self.ends.queue.of(end)
        self.ends.place(end, self.time, position, orientation, tangent)
        try:
            self.move_along(end, self.ends.state_of(end)[1])
        except ValueError:
            self.ends.set_state(end, before)
            self.ends.queue.by_name |= {end: waiting} if waiting else {}
            raise
        self.turn_natural_shape()
        if self.choice.method.family != IMPLICIT:  # implicit steps account for the jump exactly
            twists = self.cable.held_twists(self.time)
            self.cable.jump(self.time, lambda points: self.ends.put(points, self.time, twists))

    def move_along(self, end: str, path: Array | EndMotion) -> None:
        """Say what the terms do not show of an end effector that moves through poses (K, 7).

        Raises:
            ValueError: they lead a cable out of its plane that is simulated only there.
        """
        needs = self.needs if "drive" in self.needs else self.needs.with_drive()
        if len(self.model.axes) == 2 or self.scene.terms.twist == "off":
            poses = bodies.poses_of(path) if isinstance(path, EndMotion) else path
            if self.ends.leaves_plane(end, poses, self.model.axes, self.geometries[end]):
                needs = needs.in_plane(self.scene)
            rolled = self.cable.held_twists(self.time)[list(self.scene.holders).index(end)]
            if self.scene.terms.twist == "off" and self.ends.twists(end, poses, rolled):
                needs = needs.twisted(self.scene)
        self.needs = needs

    @property
    def steps_of_motions(self) -> int:
        """Number of steps for which end effectors and obstacles keep to their present motions."""
        queue = self.ends.queue
        if not queue.by_name:
            return CHUNK
        steps = queue.steps_until_begin(self.time, self.step)
        if steps == 0:
            self.go_on(queue.leading(self.time, self.step, self.pose_of))
        return max(steps, 1)

    def begin_motions(self) -> None:
        """Let motions begin that have waited for the present time."""
        if self.ends.queue.by_name:
            self.go_on(self.ends.queue.take_due(self.time))

    def go_on(self, motions: Mapping[str, EndMotion]) -> None:
        """Let end effectors and obstacles follow these motions from now on."""
        held = self.scene.holders.keys() & motions.keys()
        for name, motion in motions.items():
            if name in held:
                self.ends.go_on(name, motion)
            else:
                bodies.write(self.body(name), motion)
        if held:
            self.turn_natural_shape()

    def pose_of(self, name: str, t: float) -> tuple[Array, Array]:
        """Position [m] and quaternion of an end effector or obstacle at time t, in the coordinates
        of the model.
        """
        if any(obstacle.name == name for obstacle in self.scene.bodies):
            return bodies.pose_at(self.body(name), t)
        return self.ends.pose(name, t)

    # -- obstacles --------------------------------------------------------------------------------

    @recorded
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
                f"obstacles: none can be added with integrator.method {self.choice.method.name}, "
                "as they may be stiffer than its steps allow; use energy_momentum"
            )
        if not scene.touches and added:
            raise ValueError("obstacles: terms.contact is off; set it to auto")
        needs = self.needs.with_contact(bool(scene.bodies) and scene.touches)
        if added and len(needs.axes) == 2:
            if scene.terms.out_of_plane != "off":  # what touches does not hang taut
                needs = needs_of(scene)
            else:  # out of its plane?
                place = (self.geometries["start"].attachment + self.origin).tolist()
                missing = {0, 1, 2} - set(self.model.axes)
                if any(one.pushes_along(k, place[k]) for k in missing for one in added):
                    needs = needs.in_plane(scene)
        model, kept = with_obstacles(self.model, scene, needs), self.pressures
        with self.cable.working(self.time):
            for one in known ^ set(scene.bodies):
                self.ends.queue.by_name.pop(one.name, None)
            self.activate(model)
            new = (one.name for one in set(scene.bodies) - known)
            self.give_way({name: kept.get(name, obstacles.UNTOUCHED) for name in new})

    @property
    def contacts(self) -> dict[str, obstacles.Contact]:
        """`contact` of all obstacles by name, and of the cable with itself under ITSELF."""
        return self_contact.contacts_of(self.cable)

    def contact(self, name: str) -> obstacles.Contact:
        """What of the cable touches an obstacle now.

        Raises:
            TypeError, ValueError: no obstacle that the cable can touch.
        """
        number = self.touchable.index(arguments.one_of("obstacle", name, self.touchable))
        return obstacles.contact_with(self.cable, number, obstacles.tension_along(self.cable))

    @property
    def touchable(self) -> tuple[str, ...]:
        """Names of the obstacles that the cable can touch, in the order of their numbers."""
        return tuple(one.name for one in self.scene.bodies) if "contact" in self.needs else ()

    @property
    def pressures(self) -> dict[str, obstacles.Pressure]:
        """By which pressure each obstacle presses the cable now."""
        names = self.touchable
        return {name: obstacles.pressure_by(self.cable, k) for k, name in enumerate(names)}

    def give_way(
        self,
        kept: Mapping[str, obstacles.Pressure] | None = None,
        how: obstacles.Overlap = obstacles.Overlap.BEGAN,
        let_be: float = 0.0,
    ) -> None:
        """Let obstacles overlap the cable that press it more than `kept`, by name; count them.
        Default: all, from no pressure.
        """
        diameter = self.scene.cable.diameter
        kept = dict.fromkeys(self.touchable, obstacles.UNTOUCHED) if kept is None else kept
        for number, name in enumerate(self.touchable):
            if name in kept:
                depth = obstacles.let_overlap(self.cable, number, kept[name], let_be)
                if depth > how.notable * diameter:
                    count, most = self.noticed.overlaps.get((name, how), (0, 0.0))
                    self.noticed.overlaps[name, how] = count + 1, max(most, depth)

    def body(self, name: str) -> Array:
        """Motion of the obstacle of this name, a view."""
        names = self.touchable
        return self.cable.obstacles[names.index(arguments.one_of("obstacle", name, names))]

    # -- grasps -----------------------------------------------------------------------------------

    @property
    def held_now(self) -> Geometries:
        """What holds the cable, at the present material coordinates; a cable that has slipped out
        of a grasp is not held by it.
        """
        if not self.model.has(SLIDING):
            return self.geometries
        names, held = list(self.scene.holders), dict(self.geometries)
        for slide, u in zip(self.model.holding.slides, self.cable.slides, strict=True):
            geometry = held[names[slide.grasp]]
            held[names[slide.grasp]] = replace(geometry, u=None if u == LOST else float(u))
        return held

    def known_grasp(self, name: str) -> Grasp:
        """The grasp of this name.

        Raises:
            TypeError, ValueError: no grasp.
        """
        known = [grasp.name for grasp in self.scene.grasps]
        return self.scene.grasp(arguments.one_of("grasp", name, known))

    def geometry_taken(self, grasp: str, at: float | None) -> Geometry:
        """How a grasp would hold the cable if it took it now."""
        scene_grasp = self.known_grasp(grasp)
        if self.held_now[grasp].u is not None:
            raise ValueError(f"grasp '{grasp}': holds the cable already; release it before")
        share = scene_grasp.at if at is None else arguments.number("at", at, "from -1 to 1")
        curve = self.curve_held(grasp)
        return curve.taken(share, curve.length, *self.ends.pose(grasp, self.time))

    def hold(self, grasp: str, geometry: Geometry) -> None:
        """Hold the cable as a grasp does from now on; what that changes in energy is its work."""
        model, held = self.model_held(grasp, geometry), self.held_now[grasp].u
        with self.cable.working(self.time):
            self.ends.hold(grasp, geometry)
            if geometry.u is not None:
                angle = self.curve_held(grasp).twist_at(geometry.u, self.cable.points)
                number = list(self.scene.holders).index(grasp)
                self.cable.count_twists(self.time, [(number, angle)])
            self.activate(model)
            if geometry.u is None:
                self.cable.part_strands(held)

    def model_held(self, grasp: str, geometry: Geometry) -> Model:
        """The constants with a grasp that holds the cable like this.

        Raises:
            SceneError: it holds what is held already.
        """
        held = {**self.held_now, grasp: geometry}
        return build_model(self.scene, self.needs, held, self.origin)

    def held_at(self, grasp: str) -> float | None:
        """Material coordinate [m] at which a grasp holds the cable now; None: it does not.

        Raises:
            TypeError, ValueError: no grasp.
        """
        self.known_grasp(grasp)
        return self.held_now[grasp].u

    # -- state ------------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """The present state, from which `restore` continues bit for bit."""
        return Snapshot(
            self.model,
            self.needs,
            self.choice,
            self.steps,
            self.remainder,
            self.cable.state.copy(),
            self.cable.inputs.copy(),
            dict(self.ends.queue.by_name),
            deepcopy(self.noticed),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this simulator.

        Raises:
            TypeError: not a snapshot. ValueError: a snapshot of another scene.
        """
        arguments.instance("snapshot", snapshot, Snapshot, "from Simulator.snapshot")
        if snapshot.scene != replace(self.scene, added=snapshot.scene.added):
            raise ValueError("snapshot: is of another scene; restore it where it was taken")
        if snapshot.model is not self.model:
            self.cable.allocate(snapshot.model)
            self.hold_cable()
        self.needs = snapshot.needs
        self.steps, self.remainder = snapshot.steps, snapshot.remainder
        self.cable.state[:], self.cable.inputs[:] = snapshot.state, snapshot.inputs
        self.ends.restored()
        self.ends.queue.by_name = dict(snapshot.waiting)
        self.noticed = deepcopy(snapshot.noticed)
        if snapshot.choice != self.choice:  # of explicit steps, chosen in another shape
            self.step_by(snapshot.choice)

    def step_by(self, choice: Choice) -> None:
        """Use this method and step from now on."""
        self.choice = choice
        self.stepper = Stepper(self.cable, choice.method, choice.step)

    def reset(self) -> None:
        """Go back to the initial state."""
        self.restore(self.initial)

    def begin(self, points: ArrayLike, rates: ArrayLike | None) -> None:
        """`start_from` control points in the cable's coordinates."""
        place = self.model.own_columns("control points", points)
        speed = np.zeros_like(place)
        if rates is not None:
            speed = self.model.own_columns("velocities", rates, rest=False)
        before = self.snapshot()
        given = place.copy()
        self.put_held(place, 0.0)
        self.cable.forget_contact()
        self.noticed.clear()
        self.cable.put(place, speed, 0.0)
        if self.natural.follows:
            self.lay_natural_shape()
        shifted = np.abs(self.cable.points - given).max()
        self.give_way(let_be=math.inf)
        self.cable.open_account()
        if not math.isfinite(self.cable.account.energy_start):
            self.restore(before)
            raise ValueError("control points: have no finite energy; neighbours must not coincide")
        self.steps, self.remainder = 0, 0.0
        self.initial = self.snapshot()
        if shifted > 1e-9 * self.scene.cable.length:
            warnings.warn(
                "control points: those held by the ends differ from the held poses by "
                f"{shifted:.3g} m (or rad) and were moved back; start from `control_points`, or "
                "move the ends with set_end first",
                stacklevel=2,
            )

    def check_may_stretch(self, what: str) -> None:
        """Refuse what would put a cable of constant length into a shape of another length.

        Raises:
            ValueError: the cable keeps its length.
        """
        if inextensible(self.scene):
            raise ValueError(f"{what}: terms.stretch: off keeps the length; set it to auto")

    @recorded
    def correct(self, shift: ArrayLike, speed: ArrayLike) -> float:
        """Add to the positions [m] and velocities [m/s] of the control points, shapes (n_u, 3).

        What is held stays where it is held. The energy that this puts in, which is returned [J],
        counts as work of the loads.

        Raises:
            TypeError, ValueError: not such numbers, or a shape without a finite energy; a cable
                of constant length.
        """
        self.check_may_stretch("correct")
        points, rates, cable = self.cable.points, self.velocities, self.cable
        shape = len(points), 3
        points[:, :3] += arguments.numbers("shift", shift, shape, "m")
        rates[:, :3] += arguments.numbers("speed", speed, shape, "m/s")
        cable.settle(self.time)
        before, kept = cable.present_energy(), (cable.state.copy(), cable.inputs.copy())
        lost = cable.account.dissipated
        strained = cable.strained_joints()
        self.put_held(points, self.time)
        cable.put(points, rates, self.time, follow=True, strained=strained)
        work = cable.present_energy() - before + cable.account.dissipated - lost
        if not math.isfinite(work):
            cable.state[:], cable.inputs[:] = kept
            raise ValueError(
                "shift, speed: give a shape without a finite energy; give smaller ones"
            )
        cable.account.load_work += work
        return float(work)

    # -- model ------------------------------------------------------------------------------------

    def activate(self, model: Model) -> None:
        """Go on with other terms, grasps or added obstacles from the present state."""
        cable, points, rates = self.cable, self.cable.points, self.velocities
        pulled = dict(zip(self.model.spring_places, cable.anchors.tolist(), strict=True))
        in_material_frame, strained = self.model.has(MATERIAL), cable.strained_joints()
        self.needs = model.needs
        cable.activate(model)
        self.hold_cable()
        for k, held in enumerate(self.model.spring_places):
            cable.anchors[k] = pulled.get(held, cable.anchors[k])
        cable.put(points, rates, strained=strained)
        if self.model.has(MATERIAL) and not in_material_frame:
            self.lay_natural_shape()
        cable.flow()

    def put_held(self, points: Array, t: float) -> None:
        """Write what the ends prescribe at time t to control points; twist counts from there."""
        twists = self.cable.held_twists(t)
        self.ends.put(points, t, twists)
        self.cable.count_twists(t, enumerate(twists))

    def hold_cable(self) -> None:
        """Let the end effectors and grasps hold the cable where they are now, with the natural
        shape of the scene.
        """
        self.ends.live_in(self.cable.motion)
        self.cable.pull(self.time)
        self.cable.point_grasps(self.time if self.steps else 0.0)
        self.cable.place_obstacles(self.time)
        self.natural = NaturalShape(self.cable, self.start_orientation)

    def turn_natural_shape(self) -> None:
        """Turn the natural shape with the start's end effector, which does the work."""
        self.natural.turn(lambda: self.start_orientation)

    def lay_natural_shape(self) -> None:
        """Lay the natural shape along the present shape, with plastic flow as if bent in one
        motion.
        """
        self.lay_unslipped()
        self.cable.flow()

    def lay_unslipped(self) -> None:
        """Lay the natural shape along the present shape."""
        laid = [
            (self._orientation_of(part), curve.frames(self.natural.places(number), self.time))
            for number, (part, curve) in enumerate(
                zip(self.model.parts, self.curves.values(), strict=True)
            )
        ]
        self.natural.lay(*laid[0], *laid[1:])

    def _orientation_of(self, part: Part) -> Array:
        """Quaternion of the start's end effector, carried to the start of another strand."""
        if part.name == MAIN:
            return self.start_orientation
        points = self.cable.points[:, :3]
        frames = frames_of(self.model, points, self.start_orientation)
        return rotations.from_matrix(frames[part.name] @ part.drawn.T)

    @property
    def start_orientation(self) -> Array:
        """Quaternion of the start's end effector now."""
        return self.ends.orientation("start", self.time)
