"""The end effectors of a simulator: their poses and motions, and what these prescribe."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, one_rotation, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine import grasps
from dlo_sim.engine.arrays import MOTION_SIZE
from dlo_sim.engine.grasps import ACTIVE
from dlo_sim.methods import between_steps
from dlo_sim.scene.holders import End
from dlo_sim.scene.nets import Strand
from dlo_sim.simulation.bodies import motion_of, write
from dlo_sim.simulation.geometry import Geometry, given_quaternion, known_holder
from dlo_sim.simulation.holding import across
from dlo_sim.simulation.model import Model, Part
from dlo_sim.simulation.timeline import WaitingMotions

Array = NDArray[np.float64]
LEAST_THIRD = 0.01  # of a third of the span at a clamp: least distance of the clamp's neighbour
IN_PLANE = 1e-12  # [m], and of a direction
NEAR = 1e-6  # cable lengths, and radians: largest gap between an end effector and its next motion


class EndDrive:
    """All end effectors of a scene: those of the ends, then those of the grasps.

    Attributes:
        motion: their motions for compiled functions (`engine.grasps`), shape (holders,
            MOTION_SIZE); after `live_in` a view of the inputs. A row is active if the scene drives
            the end effector or a caller has moved it.
        queue: motions of these, and of obstacles, that have not begun.
        tips: the ends of the strands.
    """

    def __init__(self, model: Model) -> None:
        scene, geometries = model.scene, model.geometries
        self._scene = scene
        self._rows = {name: row for row, name in enumerate(scene.holders)}
        self.motion = np.zeros((len(self._rows), MOTION_SIZE))
        self.tips = [
            tip
            for strand, part in zip(scene.strands, model.parts, strict=True)
            for tip in _tips(strand, part)
        ]
        self._motions: dict[str, EndMotion] = {}
        self.queue = WaitingMotions()
        self._near = NEAR * scene.cable.length
        for name, holder in scene.holders.items():
            geometry = geometries[name]
            self.hold(name, geometry)
            self._write(name, EndMotion.resting(geometry.position, geometry.orientation))
            self.motion[self._rows[name], 0] = float(holder.driven and holder.held)

    def hold(self, end: str, geometry: Geometry) -> None:
        """Hold the cable at the attachment point and tangent of a geometry."""
        row, turn = self.motion[self._rows[end]], rotations.conjugate(geometry.orientation)
        arm = rotations.rotate(turn, geometry.attachment - geometry.position)
        row[grasps.ATTACHMENT : grasps.ATTACHMENT + 3] = arm
        row[grasps.DIRECTION : grasps.DIRECTION + 3] = geometry.tangent
        row[grasps.DIRECTOR : grasps.DIRECTOR + 3] = across(geometry, (0, 1, 2))[0]

    def clamped_rows(self, first: int) -> tuple[int, int]:
        """Rows of the holders that clamp the ends of the strand whose first holder is in row
        `first`, -1 without.
        """
        clamped = {self._rows[tip.name] for tip in self.tips if tip.end.clamped}
        start, end = (row if row in clamped else -1 for row in (first, first + 1))
        return start, end

    def live_in(self, motion: Array) -> None:
        """From now on write to `motion`, a view of the inputs."""
        motion[:] = self.motion
        self.motion = motion

    def held_at(self, end: str, t: float) -> tuple[Array, Array]:
        """Attachment point [m] and direction of the cable at time t."""
        out = np.empty(6)
        between_steps.place_of_grasp(np.ascontiguousarray(self.motion[self._rows[end]]), t, out)
        return out[:3], out[3:]

    def state_of(self, end: str) -> tuple[Array, EndMotion]:
        """Pose and motion of an end effector, for `set_state`."""
        return self.motion[self._rows[known_holder(self._scene, end)]].copy(), self._motions[end]

    def set_state(self, end: str, state: tuple[Array, EndMotion]) -> None:
        """Restore the pose and motion that `state_of` returned."""
        self.motion[self._rows[end]], self._motions[end] = state

    def pose(self, end: str, t: float) -> tuple[Array, Array]:
        """Position [m] and quaternion of an end effector at time t."""
        motion = self._motions[known_holder(self._scene, end)]
        for later in self.queue.of(end):
            if later.start <= t:
                motion = later
        return motion.position_at(t), motion.orientation_at(t)

    def orientation(self, end: str, t: float) -> Array:
        """Quaternion of an end effector at time t."""
        return self._motions[end].orientation_at(t)

    def tangent(self, end: str, t: float) -> Array:
        """Direction of the cable at a clamped end, world frame, start towards end."""
        return self.held_at(end, t)[1]

    def put(self, points: Array, t: float, twists: Array, anew: bool = False) -> None:
        """Write the entries of control points (n, 4) that the ends prescribe at time t, with these
        twist angles [rad] (`Cable.held_twists`).

        The neighbour of a clamped end is projected onto the tangent. With `anew`, or if it is then
        too close to the end, it is put at a distance of a third of the span at that end.
        """
        for tip in self.tips:
            place, direction = self.held_at(tip.name, t)
            for axis in range(3):
                if tip.end.fixed[axis]:
                    points[tip.outer, axis] = place[axis]
            if tip.end.clamped:
                direction *= 1.0 if tip.inner > tip.outer else -1.0
                along = float(((points[tip.inner, :3] - place) * direction).sum())
                if anew or abs(along) < LEAST_THIRD * tip.third:
                    along = tip.third
                at = place + along * direction
                # A difference of round-off must not change the bits of a running simulation.
                if anew or np.abs(points[tip.inner, :3] - at).max() > 1e-3 * self._near:
                    points[tip.inner, :3] = at
                points[tip.outer, 3] = twists[self._rows[tip.name]]

    def place(
        self,
        end: str,
        t: float,
        position: ArrayLike | None,
        orientation: ArrayLike | None,
        tangent: ArrayLike | None,
    ) -> None:
        """Rest at a pose from time t on.

        Raises:
            TypeError, ValueError: not finite numbers, a zero quaternion or tangent, or both an
                orientation and a tangent.
        """
        old_position, old_orientation = self.pose(end, t)
        if orientation is not None and tangent is not None:
            raise ValueError(f"tangent of {end}: is given beside an orientation; leave one out")
        turned = old_orientation
        if orientation is not None:
            turned = given_quaternion(f"orientation of {end}", orientation)
        if tangent is not None:
            direction = arguments.numbers(f"tangent of {end}", tangent, (3,))
            try:
                swing = rotations.minimal_rotation(self.tangent(end, t), direction)
            except ValueError as refusal:
                raise ValueError(
                    f"tangent of {end}: {refusal}; give the cable's direction"
                ) from None
            turned = rotations.multiply(swing, old_orientation)
        place = old_position
        if position is not None:
            place = arguments.numbers(f"position of {end}", position, (3,), "m")
        self.follow(end, EndMotion.resting(place, turned, t))

    def check_motion(
        self, end: str, t: float, motion: EndMotion, late: float, origin: Array
    ) -> None:
        """Check that a motion in the world begins where the end effector will be then.

        Args:
            late: how much before t it may start [s]. origin: of the cable's coordinates [m].

        Raises:
            TypeError, ValueError: no such end effector, no motion, or one that starts too early or
                at another pose.
        """
        known_holder(self._scene, end)
        arguments.instance("motion", motion, EndMotion, "dlo_sim.EndMotion")
        if motion.start < t - late - 1e-9:
            raise ValueError(
                f"motion of {end}: starts at {motion.start!r} s, before the present; start it at "
                f"the simulator's time, {t!r} s, or later"
            )
        position, orientation = self.pose(end, motion.start)
        there = position + origin, orientation
        way, turn = apart(there, motion.position, motion.orientation)
        if way > self._near or turn > NEAR:
            place = [float(f"{x:.9g}") for x in there[0]]
            raise ValueError(
                f"motion of {end}: starts {way:.3g} m and {turn:.3g} rad away from the end "
                f"effector, which is at {place} m at {motion.start!r} s; start it at "
                f"end_pose('{end}'), or with EndMotion.then where the motion before ends, or put "
                "the end there with set_end before"
            )

    def follow_later(self, end: str, t: float, motion: EndMotion) -> bool:
        """Keep a motion until its start if the end effector still moves (`WaitingMotions.keep`)."""
        return self.queue.keep(end, t, motion, moves=self._motions[end].end > t)

    def go_on(self, end: str, motion: EndMotion) -> None:
        """Follow a motion from now on."""
        self._write(end, motion)

    def follow(self, end: str, motion: EndMotion) -> None:
        """Follow a motion from now on, a caller's. Motions that wait are dropped."""
        self.queue.by_name.pop(end, None)
        self._write(end, motion)
        self.motion[self._rows[end], ACTIVE] = 1.0

    def take_over(self, other: EndDrive, t: float, way: Array) -> None:
        """Go on with the motions of another simulator's end effectors at time t, which is 0 here.

        Args:
            way: from the origin of this simulator to the other's [m], shape (3,).
        """
        for end, row in self._rows.items():
            self._write(end, other.state_of(end)[1].later(-t).moved(way))
            self.motion[row, ACTIVE] = max(self.motion[row, ACTIVE], other.state_of(end)[0][ACTIVE])

    def leaves_plane(self, end: str, path: Array, axes: tuple[int, ...], first: Geometry) -> bool:
        """Whether poses (K, 7) lead an end's attachment point or tangent out of the plane of two
        axes, in which it is first; never for three axes.
        """
        if len(axes) == 3:
            return False
        (normal,) = (axis for axis in range(3) if axis not in axes)
        row = self.motion[self._rows[end]]
        arm = row[grasps.ATTACHMENT : grasps.ATTACHMENT + 3]
        away = path[:, normal] + rotations.rotate(path[:, 3:], arm)[:, normal]
        away -= first.attachment[normal]
        tangent = rotations.rotate(path[:, 3:], self._direction(end))[:, normal]
        if not self._scene.holders[end].holds_direction:
            tangent = 0.0 * tangent
        return bool(max(np.abs(away).max(), np.abs(tangent).max()) > IN_PLANE)

    def twists(self, end: str, path: Array, rolled: float) -> bool:
        """Whether an end effector holds the roll and turns about its tangent along poses (K, 7), or
        has, by `rolled` [rad].
        """
        if not self._scene.holders[end].holds_roll:
            return False
        turned = rotations.multiply(path[:, 3:], rotations.conjugate(path[0, 3:]))
        along = rotations.to_rotation_vector(turned) @ rotations.rotate(
            path[0, 3:], self._direction(end)
        )
        return bool(max(abs(rolled), np.abs(along).max()) > 1e-12)

    def restored(self) -> None:
        """Rebuild the motions after `motion` was overwritten by a snapshot."""
        self._motions = {name: motion_of(self.motion[row]) for name, row in self._rows.items()}

    def _direction(self, end: str) -> Array:
        """Direction of the cable in an end effector's frame."""
        return self.motion[self._rows[end], grasps.DIRECTION : grasps.DIRECTION + 3]

    def _write(self, end: str, motion: EndMotion) -> None:
        write(self.motion[self._rows[end]], motion)
        self._motions[end] = motion


class Tip(NamedTuple):
    """An end of a strand.

    Attributes:
        name: of its holder. end: what the scene says of it. outer, inner: its control point, and
            the next one. third: of the knot span there [m].
    """

    name: str
    end: End
    outer: int
    inner: int
    third: float


def _tips(strand: Strand, part: Part) -> tuple[Tip, Tip]:
    spans = np.diff(bspline.breaks(part.model.knots)) / 3.0
    first, last = part.here.start, part.here.stop - 1
    return (
        Tip(strand.holder("start"), strand.scene.start, first, first + 1, float(spans[0])),
        Tip(strand.holder("end"), strand.scene.end, last, last - 1, float(spans[-1])),
    )


def apart(pose: tuple[Array, Array], position: Array, orientation: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between a pose and a position and quaternion."""
    way = math.dist(pose[0].tolist(), position.tolist())
    turn = one_rotation.turn_between(pose[1].tolist(), orientation.tolist())
    return way, math.hypot(*turn)
