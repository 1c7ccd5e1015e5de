"""A cable that runs: its scene, its arrays, what holds and touches it, and its steps.

`Simulator` is what users call; what looks at a run (`remarks`) or steps it (`play`) works on this.
Positions are relative to the origin of the model.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine.arrays import ENERGIES, MATERIAL, SLIDING, TORSION
from dlo_sim.engine.sliding import LOST
from dlo_sim.scene.description import Grasp, Obstacle, Scene
from dlo_sim.scene.needs import Needs, inextensible, needs_of
from dlo_sim.simulation import bodies, obstacles, self_contact
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.curve import Curve
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import Geometries, Geometry, moved, origin_of
from dlo_sim.simulation.holding import holding_of
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.natural_shape import NaturalShape
from dlo_sim.simulation.report import Energy, UndefinedTorsion
from dlo_sim.simulation.resolution import Shortfall
from dlo_sim.simulation.selection import Choice
from dlo_sim.simulation.stepper import CHUNK, Stepper
from dlo_sim.simulation.timeline import Change, Waiting, recorded

Array = NDArray[np.float64]
Overlaps = dict[tuple[str, obstacles.Overlap], tuple[int, float]]
"""Obstacle that was inside the cable, how it came there -> how often, how deep at most [m]."""


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


class Running:
    """A cable of one scene with its ends, natural shape, motions and steps.

    Args:
        scene: that leaves nothing open (`resolution.resolved`). geometries: what holds it, in the
            world.

    Attributes:
        scene, needs: what is simulated, with which terms. geometries: what holds the cable, grasps
            as they took it. origin: of the cable's coordinates in the world [m], shape (3,).
        cable: the arrays. curve: its centerline. natural: its natural shape. ends: end effectors.
        choice: method, step and the reason for them. stepper: of these steps. steps: made so far.
        noticed: see there. follower: repeats every change (`timeline.recorded`), or None.
    """

    choice: Choice
    stepper: Stepper
    initial: Snapshot

    def __init__(self, scene: Scene, needs: Needs, geometries: Geometries) -> None:
        self.scene, self.needs = scene, needs
        self.origin = origin_of(geometries)
        self.geometries: Geometries = moved(geometries, -self.origin)
        self.cable = Cable(build_model(scene, needs, self.geometries, origin=self.origin))
        self.curve = Curve(self.cable, self.geometries["start"].tangent)
        self.ends = EndDrive(scene, self.geometries, self.model.knots)
        self.steps, self.remainder = 0, 0.0
        self.noticed = Noticed()
        self.follower: Callable[[Change], object] | None = None
        for row, load in zip(self.cable.loads, scene.loads, strict=False):
            if load.signal != "none":
                row[:3], row[3:6] = load.force, load.torque
            row[6] = load.frequency if load.signal == "sine" else 0.0

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
        obstacles.fields_of(scene)  # refuses a mesh while nothing is changed
        self.cable.settle(self.time)
        before, kept = self.cable.present_energy(), self.pressures
        self.scene, needs = scene, self.needs.with_contact(bool(scene.bodies) and scene.touches)
        if added and len(needs.axes) == 2:
            if scene.terms.out_of_plane != "off":  # what touches does not hang taut
                needs = needs_of(scene)
            elif self.pushed_across(added):
                needs = needs.in_plane(scene)
        for one in known ^ set(scene.bodies):
            self.ends.queue.by_name.pop(one.name, None)
        self.activate(needs, self.geometries)
        new = (one.name for one in set(scene.bodies) - known)
        self.give_way({name: kept.get(name, obstacles.UNTOUCHED) for name in new})
        self.cable.account.drive_work += self.cable.present_energy() - before

    def pushed_across(self, added: Iterable[Obstacle]) -> bool:
        """Whether obstacles push the cable out of its plane."""
        place = self.geometries["start"].attachment + self.origin
        missing = {0, 1, 2} - set(self.model.axes)
        return any(one.pushes_along(k, float(place[k])) for k in missing for one in added)

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
        self.body(name)
        number = [o.name for o in self.scene.bodies].index(name)
        tension = obstacles.tension_along(self.scene, self.cable)
        body = self.scene.bodies[number]
        pose = self.end_pose(name) if body.shape in obstacles.GUIDES else None
        return obstacles.contact_with(self.cable, number, body, pose, tension)

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
        length = self.scene.cable.length
        return self.curve.taken(share, length, *self.ends.pose(grasp, self.time))

    def hold(self, grasp: str, geometry: Geometry) -> None:
        """Hold the cable as a grasp does from now on; what that changes in energy is its work."""
        geometries = self.held_with(grasp, geometry)
        self.cable.settle(self.time)
        before, held = self.cable.present_energy(), self.held_now[grasp].u
        self.ends.hold(grasp, geometry)
        if geometry.u is not None:
            angle = self.curve.twist_at(geometry.u, self.cable.points)
            number = list(self.scene.holders).index(grasp)
            self.cable.count_twists(self.time, [(number, angle)])
        self.activate(self.needs, geometries)
        if geometry.u is None:
            self.cable.part_strands(held)
        self.cable.account.drive_work += self.cable.present_energy() - before

    def held_with(self, grasp: str, geometry: Geometry) -> Geometries:
        """All that holds the cable, with a grasp like this.

        Raises:
            SceneError: it holds what is held already.
        """
        geometries = {**self.held_now, grasp: geometry}
        model = self.model
        holding_of(self.scene, geometries, model.knots, model.axes, model.twist)
        return geometries

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
            self.scene,
            self.steps,
            self.remainder,
            self.needs,
            self.cable.state.copy(),
            self.cable.inputs.copy(),
            self.geometries,
            self.origin,
            self.step,
            dict(self.ends.queue.by_name),
            dict(self.noticed.overlaps),
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
        self.remainder = snapshot.remainder
        known = snapshot.scene == self.scene and snapshot.geometries is self.geometries
        if snapshot.needs != self.needs or not known:
            self.scene, self.origin = snapshot.scene, snapshot.origin
            self._take_model(snapshot.needs, snapshot.geometries)
        self.needs = snapshot.needs  # equal needs may have different warnings
        self.cable.state[:] = snapshot.state
        self.cable.inputs[:] = snapshot.inputs
        if self.noticed.fell and self.noticed.fell[0] > self.time:
            self.noticed.fell = None
        self.ends.restored()
        self.ends.queue.by_name = dict(snapshot.waiting)
        self.noticed.overlaps = dict(snapshot.overlaps)
        if snapshot.step != self.step:  # of explicit steps, chosen in another shape
            self.choice = replace(self.choice, step=snapshot.step)
            self.stepper = Stepper(self.scene, self.cable, self.choice.method, self.step)

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
        self.cable.open_account(self.scene)
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
        self.put_held(points, self.time)
        cable.put(points, rates, self.time, follow=True)
        work = cable.present_energy() - before + cable.account.dissipated - lost
        if not math.isfinite(work):
            cable.state[:], cable.inputs[:] = kept
            raise ValueError(
                "shift, speed: give a shape without a finite energy; give smaller ones"
            )
        cable.account.load_work += work
        return float(work)

    def __getstate__(self) -> dict[str, Any]:
        """A copy is not followed."""
        return self.__dict__ | {"follower": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Connect the end effectors of a copy to the copy's own arrays."""
        self.__dict__.update(state)
        self.ends.live_in(self.cable.motion)

    # -- model ------------------------------------------------------------------------------------

    def activate(self, needs: Needs, geometries: Geometries) -> None:
        """Go on with other needs or grasps from the present state."""
        cable, points, rates = self.cable, self.cable.points, self.velocities
        pulled = dict(zip(self.model.spring_places, cable.anchors.tolist(), strict=True))
        in_material_frame = self.model.has(MATERIAL)
        self._take_model(needs, geometries)
        for k, held in enumerate(self.model.spring_places):
            cable.anchors[k] = pulled.get(held, cable.anchors[k])
        cable.put(points, rates)
        if self.model.has(MATERIAL) and not in_material_frame:
            self.lay_natural_shape()
        cable.flow()

    def _take_model(self, needs: Needs, geometries: Geometries) -> None:
        """Make the model that of these needs and of what holds the cable."""
        self.needs, self.geometries = needs, geometries
        self.cable.activate(build_model(self.scene, needs, geometries, origin=self.origin))
        self.hold_cable()
        self.shape_naturally()

    def put_held(self, points: Array, t: float) -> None:
        """Write what the ends prescribe at time t to control points; twist counts from there."""
        twists = self.cable.held_twists(t)
        self.ends.put(points, t, twists)
        self.cable.count_twists(t, enumerate(twists))

    def hold_cable(self) -> None:
        """Let the end effectors and grasps hold the cable where they are now."""
        self.ends.live_in(self.cable.motion)
        self.ends.pull_springs(self.cable, self.time)
        self.cable.point_grasps(self.time if self.steps else 0.0)
        self.cable.place_obstacles(self.time)

    def shape_naturally(self) -> None:
        """Write the natural shape of the scene to the arrays, turned with the start."""
        tangent = self.geometries["start"].tangent
        self.natural = NaturalShape(self.scene, self.cable, tangent, self.start_orientation)

    def turn_natural_shape(self) -> None:
        """Turn the natural shape with the start's end effector, which does the work."""
        self.natural.turn(self.start_orientation)

    def lay_natural_shape(self) -> None:
        """Lay the natural shape along the present shape, with plastic flow as if bent in one
        motion.
        """
        self.lay_unslipped()
        self.cable.flow()

    def lay_unslipped(self) -> None:
        """Lay the natural shape along the present shape."""
        frames = self.curve.poses(self.natural.places, self.time)[:, 3:]
        self.natural.lay(self.start_orientation, frames)

    @property
    def start_orientation(self) -> Array:
        """Quaternion of the start's end effector now."""
        return self.ends.orientation("start", self.time)
