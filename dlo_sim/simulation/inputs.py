"""What may be done to a running cable: loads, end effectors, grasps that take and release it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine.arrays import MATERIAL, PLASTICITY
from dlo_sim.methods import between_steps
from dlo_sim.scene.holders import Grasp
from dlo_sim.scene.needs import Needs, inextensible, needs_of_end, needs_of_load
from dlo_sim.simulation.arrays import to_blocks
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.geometry import NEAREST, Geometries, Geometry
from dlo_sim.simulation.guarded_loop import GuardedLoop
from dlo_sim.simulation.holding import holding_of
from dlo_sim.simulation.natural_shape import (
    has_natural_shape,
    local_turn,
    natural_rows,
    rows_in_frames,
    turned_rows,
    unslipped,
    weighted,
)
from dlo_sim.simulation.transfer import carry_inputs, carry_samples
from dlo_sim.simulation.view import CableView

Array = NDArray[np.float64]


class CableInputs(CableView):
    """The part of `Simulator` that takes inputs and activates the terms that they need."""

    _load_index: dict[str, int]
    _loop: GuardedLoop
    _natural: Array  # rows of the natural shape in the frame of the start
    _turning: Array | None  # those that turn with the start's end effector, weighted, as blocks

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
        self._extend(needs_of_load(self._needs, self.scene, push, turn))
        row = self.cable.loads[self._load_index[name]]
        if push is not None:
            row[:3] = push
        if turn is not None:
            row[3:6] = turn
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
        if position is not None:
            place = arguments.numbers(f"position of {end}", position, (3,), "m")
            position = place - self.model.origin
        self._put_end(end, position, orientation, tangent)

    def set_motion(self, end: str, motion: EndMotion) -> None:
        """Let an end effector follow a motion; afterwards it rests at its last pose.

        The motion begins now or later (it may be given up to a step late), where the end effector
        is at that time: `set_end` is for jumps. Until then the motions given before go on, so that
        several can be given at once, of any duration (`EndMotion.then`); what they prescribe from
        then on is dropped.

        Raises:
            TypeError, ValueError: no end, no motion, or one that begins before now or elsewhere.
        """
        self._ends.check_motion(end, self.time, motion, self.step, self.model.origin)
        motion = motion.moved(-self.model.origin)
        if not self._ends.follow_later(end, self.time, motion):
            self._ends.follow(end, self.time, motion)
        self._extend(self._needs_moved(end))
        self._natural_shape_moves()

    def correct(self, shift: ArrayLike, speed: ArrayLike) -> float:
        """Add to the positions [m] and velocities [m/s] of the control points, shapes (n_u, 3).

        What is held stays where it is held. The energy that this puts in, which is returned [J], is
        booked as work of the loads.

        Raises:
            TypeError, ValueError: not such numbers, or a shape without a finite energy; a method
                whose constraints keep the length.
        """
        if inextensible(self.scene):
            raise ValueError("correct: breaks the constraints of rattle; use energy_momentum")
        points, rates, cable = self.cable.points, self.velocities, self.cable
        shape = len(points), 3
        points[:, :3] += arguments.numbers("shift", shift, shape, "m")
        rates[:, :3] += arguments.numbers("speed", speed, shape, "m/s")
        cable.settle(self.time)
        before, kept = cable.present_energy(), (cable.state.copy(), cable.inputs.copy())
        lost = cable.account.dissipated
        self._ends.take_frame_turns(cable.frame_turn)
        self._ends.put(points, self.time)
        cable.put(points, rates, self.time, follow=True)
        work = cable.present_energy() - before + cable.account.dissipated - lost
        if not math.isfinite(work):
            cable.state[:], cable.inputs[:] = kept
            raise ValueError(
                "shift, speed: give a shape without a finite energy; give smaller ones"
            )
        cable.account.load_work += work
        return float(work)

    def take(self, grasp: str, at: float | None = None) -> None:
        """Let a grasp take the cable: from now on what it holds moves with its gripper.

        The cable stays where it is; only the velocity of what is held becomes the gripper's, and
        the energy of that is booked as work of the end effectors.

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

    def _geometry_taken(self, grasp: str, at: float | None) -> Geometry:
        """How a grasp would hold the cable if it took it now."""
        scene_grasp = self._known_grasp(grasp)
        if self._geometries[grasp].u is not None:
            raise ValueError(f"grasp '{grasp}': holds the cable already; release it before")
        share = scene_grasp.at if at is None else arguments.number("at", at, "from -1 to 1")
        if not -1.0 <= share <= 1.0:
            raise ValueError(f"at: needs a number from 0 to 1, or below for nearest, got {share!r}")
        u = share * self.scene.cable.length
        position, orientation = self._ends.pose(grasp, self.time)
        if share < 0.0:
            places = np.linspace(0.0, self.scene.cable.length, NEAREST)
            away = np.linalg.norm(self.centerline(places) - self.model.origin - position, axis=1)
            u = float(places[np.argmin(away)])
        columns, values, slopes = self._basis(np.array([u]))
        points = self.cable.points[columns[0], :3]
        tangent = slopes[0] @ points
        tangent = rotations.rotate(rotations.conjugate(orientation), tangent)
        tangent /= np.linalg.norm(tangent)
        return Geometry(position, orientation, values[0] @ points, tangent, u)

    def release(self, grasp: str) -> None:
        """Let a grasp release the cable; its gripper goes on as it does.

        Raises:
            TypeError, ValueError: no grasp, or one that does not hold the cable.
        """
        self._known_grasp(grasp)
        if self._geometries[grasp].u is None:
            raise ValueError(f"grasp '{grasp}': does not hold the cable; take it before")
        self._hold(grasp, replace(self._geometries[grasp], u=None))

    # -- inside ---------------------------------------------------------------------------------

    def _put_end(
        self,
        end: str,
        position: ArrayLike | None,
        orientation: ArrayLike | None,
        tangent: ArrayLike | None = None,
    ) -> None:
        """`set_end` to a position in the cable's coordinates."""
        before = self._ends.state_of(end)
        self._ends.place(end, self.time, position, orientation, tangent)
        # What the jump brings in begins where the end was: its springs do work on the way.
        needs, after = self._needs_moved(end), self._ends.state_of(end)
        self._ends.set_state(end, before)
        self._extend(needs)
        self._ends.set_state(end, after)
        self._natural_shape_moves()
        self._stepper.jump(self.cable, self._ends, self.time)

    def _fill_inputs(self) -> None:
        """Loads, motions, anchors and natural shape of the scene in the arrays of the cable."""
        cable, model = self.cable, self.model
        for row, load in zip(cable.loads, self.scene.loads, strict=False):
            if load.signal != "none":
                row[:3], row[3:6] = load.force, load.torque
            row[6] = load.frequency if load.signal == "sine" else 0.0
        self._ends.live_in(cable.motion)
        self._ends.pull_springs(self.cable, self.time)
        cable.point_grasps(self.time if self._steps else 0.0)
        self._natural = np.zeros((*model.rule.xi.shape, 4))
        if has_natural_shape(self.scene, model):
            self._natural = natural_rows(self.scene, model, self._geometries["start"].tangent)
        self._turning = None
        if has_natural_shape(self.scene, model) and not model.has(MATERIAL):
            rows = weighted(model, self._natural)
            self._turning = to_blocks(rows)
            cable.natural = turned_rows(rows, self._turn_of_start)
            between_steps.turn_natural.load()  # a tick must not have to compile it

    def _needs_moved(self, end: str) -> Needs:
        """What a moved end needs: the drive itself, the third coordinate, twist."""
        first = self._geometries[end].position
        leaves_plane = not self._ends.stays_in_plane(end, self.model.axes, first)
        twists = not self._needs.twist and self._ends.twists(end)
        return needs_of_end(self._needs, self.scene, leaves_plane=leaves_plane, twists=twists)

    def _needs_along(self, end: str, path: Array) -> Needs:
        """Needs once an end effector moves along a path of poses, shape (K, 7)."""
        turned = rotations.multiply(path[:, 3:], rotations.conjugate(path[0, 3:]))
        turns = rotations.to_rotation_vector(turned)
        across = [axis for axis in range(3) if axis not in self.model.axes]
        leaves = bool(across) and bool(
            np.ptp(path[:, across]) > 0.0 or np.abs(turns[:, list(self.model.axes)]).max() > 1e-12
        )
        rolls = self.scene.holders[end].holds_roll
        twists = rolls and bool(np.abs(turns @ self._ends.tangent(end, self.time)).max() > 1e-12)
        return needs_of_end(self._needs, self.scene, leaves_plane=leaves, twists=twists)

    @property
    def _turn_of_start(self) -> Array:
        """Rotation matrix of the start's end effector, in the coordinates of the lines."""
        orientation = self._ends.orientation("start", self.time)
        return local_turn(rotations.to_matrix(orientation), self.model.axes)

    def _natural_shape_moves(self) -> None:
        """Turn the natural shape with the start's end effector, which does the work."""
        if self._turning is not None:
            self.cable.turn_natural(self._turning, self._turn_of_start)

    @property
    def _lays_natural_shape(self) -> bool:
        """Whether the natural shape follows the cable, all of it or that of its plastic part."""
        return self.model.has(MATERIAL) or self.model.has(PLASTICITY)

    def _has_natural_shape_of(self, other: CableInputs) -> bool:
        """Whether `carry_samples` took over the same natural shape from another simulator."""
        terms = MATERIAL | PLASTICITY
        same_terms = self.cable.terms & terms == other.cable.terms & terms
        scenes = self.scene, other.scene
        shapes = {(scene.cable.natural_shape, scene.cable.rest_curvature_axis) for scene in scenes}
        shares = self.model.elastic_share, other.model.elastic_share
        return same_terms and len(shapes) == 1 and (min(shares) > 0.0 or max(shares) == 0.0)

    def _lay_natural_shape(self) -> None:
        """The natural shape along the present shape, and plastic flow as if bent in one motion."""
        model, start = self.model, self.end_pose("start")[1]
        frames = self.frames(np.append(0.0, model.sample_shares.ravel() * self.scene.cable.length))
        samples = frames[1:].reshape(*model.rule.xi.shape, 4)
        if model.has(MATERIAL):
            rows = rows_in_frames(self._natural, start, frames[0], samples)
            self.cable.natural = weighted(model, rows)
        else:
            rows = turned_rows(self._natural, self._turn_of_start)
        if model.has(PLASTICITY):
            tangents = rotations.rotate(samples.reshape(-1, 4), np.array([1.0, 0.0, 0.0]))
            self.cable.plastic = unslipped(model, rows, tangents.reshape(*rows.shape[:2], 3))
            self.cable.flow()
        self.cable.open_frame()

    def _rebuild(self, needs: Needs) -> None:
        """Arrays and step of other needs; their state is empty."""
        self._needs = needs
        model = build_model(self.scene, needs, self._geometries, origin=self._origin)
        self.cable = Cable(model)
        self._fill_inputs()
        self._loop = GuardedLoop(self.cable, self._stepper)

    def _extend(self, needs: Needs) -> None:
        """Activate the terms that these needs add; the state is kept."""
        lines = (self._needs.axes, self._needs.twist, self._needs.loads)
        if (needs.axes, needs.twist, needs.loads) == lines:
            self._needs = needs
            return
        self._replace(needs, self._geometries)

    def _replace(self, needs: Needs, geometries: Geometries) -> None:
        """Continue with other needs or grasps from the present state."""
        points, rates = self.cable.points, self.velocities
        self._ends.take_frame_turns(self.cable.frame_turn)
        old = self.cable
        self._geometries = geometries
        self._rebuild(needs)
        carry_inputs(old, self.cable)
        self.cable.put(points, rates)
        carry_samples(old, self.cable)
        self.cable.continue_account(old)

    def _hold(self, grasp: str, geometry: Geometry) -> None:
        """Hold the cable as a grasp does from now on; what that changes in energy is its work."""
        geometries = self._held_with(grasp, geometry)
        self.cable.settle(self.time)
        before = self.cable.present_energy()
        self._ends.hold(grasp, geometry)
        if geometry.u is not None:
            angle = self._angle_at(geometry.u, self.cable.points)
            self._ends.count_from(grasp, self.time, angle)
        self._replace(self._needs, geometries)
        self.cable.account.drive_work += self.cable.present_energy() - before

    def _held_with(self, grasp: str, geometry: Geometry) -> Geometries:
        """All that holds the cable, with a grasp like this.

        Raises:
            SceneError: it holds what is held already.
        """
        geometries = {**self._geometries, grasp: geometry}
        model = self.model
        holding_of(self.scene, geometries, model.knots, model.axes, model.twist)
        return geometries

    def _angle_at(self, u: float, points: Array) -> float:
        """Twist angle [rad] of control points (n, 4) at u [m]."""
        columns, values, _ = self._basis(np.array([u]))
        return float(values[0] @ points[columns[0], 3])

    def _known_grasp(self, name: str) -> Grasp:
        known = [grasp.name for grasp in self.scene.grasps]
        return self.scene.grasp(arguments.one_of("grasp", name, known))


def _three(name: str, value: ArrayLike | None, unit: str) -> Array | None:
    """Three finite numbers, or None."""
    return None if value is None else arguments.numbers(name, value, (3,), unit)
