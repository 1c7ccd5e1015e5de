"""Initial geometry of a scene: end-effector poses, attachment points, tangents, first shape."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, one_rotation, rotations
from dlo_sim.core.two_points import X_AXIS
from dlo_sim.scene.description import Scene

Array = NDArray[np.float64]
Pose = tuple[ArrayLike, ArrayLike]
# Largest factor of EI, where a jaw holds a whole span. A span that is straight up to its ends keeps
# its neighbours from bending (with 20, a tip sags 10 % too little; without a limit, 14 %).
STIFFEST = 8.0
LEVEL = 1e-3  # share of a tangent across gravity that says in which direction it leads
TINY = 1e-300
NEAREST = 1001  # points of a shape that are searched for the nearest to a gripper


@dataclass(frozen=True)
class Geometry:
    """One end effector at time zero.

    Attributes:
        position, orientation: of the end effector, world frame; quaternion x, y, z, w.
        attachment: where it holds the cable [m], world frame.
        tangent: unit direction of the cable from start towards end, in the end-effector frame.
        u: material coordinate [m] of the held point; None for a grasp that does not hold the cable.
    """

    position: Array
    orientation: Array
    attachment: Array
    tangent: Array
    u: float | None


Geometries = Mapping[str, Geometry]
GRID = 1024.0  # [m]; a power of two, so that subtracting a multiple does not round


def origin_of(geometries: Geometries) -> Array:
    """Origin of the cable's coordinates in the world [m], shape (3,): zero unless the start is
    farther away than GRID / 2. Far from it, rounded coordinates would stretch a cable.
    """
    return np.asarray(GRID * np.round(geometries["start"].attachment / GRID) + 0.0)


def moved(geometries: Geometries, way: Array) -> dict[str, Geometry]:
    """The geometries, moved by a vector (3,) [m]."""
    return {
        name: replace(one, position=one.position + way, attachment=one.attachment + way)
        for name, one in geometries.items()
    }


def known_holder(scene: Scene, name: object) -> str:
    """The name of an end or a grasp, checked.

    Raises:
        TypeError, ValueError: not such a name.
    """
    return arguments.one_of("end", name, scene.holders)


def geometries_of(
    scene: Scene, poses: Mapping[str, Pose] | None = None, before: Geometries | None = None
) -> dict[str, Geometry]:
    """Geometry of all ends and grasps, from the scene or from end-effector poses where given;
    tangents of ends that the scene does not give are those `before`, if there are any.

    A grasp that takes the cable at the nearest point (negative `at`) finds it on the first shape.

    Raises:
        TypeError, ValueError: invalid poses.
    """
    poses = {} if poses is None else _checked(scene, poses)
    placed: dict[str, tuple[Array, Array, Array]] = {}
    straight = _direction_between(scene, *(np.array(e.position) for e in scene.ends.values()))
    for name, end in scene.holders.items():
        resting = rotations.IDENTITY
        if end.pose_type == "two_points":
            resting = one_rotation.aligned(resting, X_AXIS, straight.tolist())
        position, orientation = poses.get(name, (end.position, resting))
        position, orientation = np.asarray(position), np.asarray(orientation)
        placed[name] = (position, orientation, position + rotations.rotate(orientation, end.offset))
    line = _direction_between(scene, placed["start"][2], placed["end"][2])
    length, result = scene.cable.length, {}
    coordinates: dict[str, float | None] = {"start": 0.0, "end": length}
    coordinates |= {
        g.name: g.at * length if g.taken and g.at >= 0.0 else None for g in scene.grasps
    }
    for name, holder in scene.holders.items():
        position, orientation, attachment = placed[name]
        tangent = np.asarray(holder.tangent, dtype=float)
        if before and name in scene.ends and not tangent.any():
            tangent = before[name].tangent
        if holder.pose_type == "two_points":
            tangent = np.array(X_AXIS)
        elif not tangent.any():
            tangent = rotations.rotate(rotations.conjugate(orientation), line)
        tangent = tangent / math.hypot(*tangent)
        result[name] = Geometry(position, orientation, attachment, tangent, coordinates[name])
    u = np.linspace(0.0, length, NEAREST)
    for grasp in scene.grasps:
        if grasp.taken and grasp.at < 0.0:
            there = first_line(scene, result, u) - result[grasp.name].attachment
            nearest = float(u[np.argmin(np.linalg.norm(there, axis=1))])
            result[grasp.name] = replace(result[grasp.name], u=nearest)
    return result


def _checked(scene: Scene, poses: object) -> dict[str, Pose]:
    checked: dict[str, Pose] = {}
    if not isinstance(poses, Mapping):
        raise TypeError(
            'end_poses: needs {"start": (position, quaternion), ...}, got ' + arguments.given(poses)
        )
    for end, pose in poses.items():
        name = f"end_poses[{known_holder(scene, end)!r}]"
        if not isinstance(pose, Sequence) or len(pose) != 2:
            raise TypeError(
                f"{name}: needs (position, quaternion) as of end_pose, got {arguments.given(pose)}"
            )
        position = arguments.numbers(f"{name} position", pose[0], (3,), "m")
        checked[end] = position, given_quaternion(f"{name} quaternion", pose[1])
    return checked


def given_quaternion(name: str, value: object) -> Array:
    """A quaternion x, y, z, w, normalised, shape (4,).

    Raises:
        TypeError, ValueError: not four finite numbers, or zero.
    """
    quaternion = arguments.numbers(name, value, (4,), "x, y, z, w")
    try:
        return rotations.normalized(quaternion)
    except ValueError as refusal:
        raise ValueError(f"{name}: {refusal}; give [0, 0, 0, 1] for no turn") from None


def _direction_between(scene: Scene, start: Array, end: Array) -> Array:
    """Unit direction from start to end; if they coincide, that of gravity, or x without gravity."""
    line = end - start
    if math.hypot(*line) < 1e-9 * scene.cable.length:
        line = np.asarray(scene.gravity, dtype=float)
    if not line.any():
        line = np.array([1.0, 0.0, 0.0])
    return line / math.hypot(*line)


def first_shape(scene: Scene, geometries: Geometries, knots: Array) -> Array:
    """Control points [m], shape (n, 3), before any relaxation.

    Between neighbouring held points it is a straight line if their distance is at least the rest
    length, else a sagging arc of that length; before the first and after the last it is straight.
    """
    return bspline.interpolate(knots, first_line(scene, geometries, bspline.greville(knots)))


def held_places(scene: Scene, geometries: Geometries) -> list[tuple[float, Geometry]]:
    """Material coordinates [m] and geometries of what holds the cable, in rising order.

    If nothing does, the start is returned.
    """
    found = [
        (geometry.u, geometry)
        for name, geometry in geometries.items()
        if geometry.u is not None and scene.holders[name].held
    ]
    return sorted(found, key=lambda place: place[0]) or [(0.0, geometries["start"])]


def straight_direction(scene: Scene, places: list[tuple[float, Geometry]]) -> Array:
    """Direction of the straight cable that is held at these places."""
    (_, first), (_, last) = places[0], places[-1]
    tangents = np.sum([rotations.rotate(geo.orientation, geo.tangent) for _, geo in places], axis=0)
    gravity = np.array(scene.gravity)
    choices = [last.attachment - first.attachment, tangents, gravity, np.array([1.0, 0.0, 0.0])]
    if len(places) == 1:
        choices = choices[2:1:-1] + choices[1:2]
    for choice in choices:
        size = math.hypot(*choice)
        if size > 1e-6 * scene.cable.length:
            return np.asarray(choice / size)
    return choices[-1]


def laying_directions(scene: Scene, geometries: Geometries) -> list[Array]:
    """Directions of the straight cable to begin with where there are obstacles: from the first to
    the last held point, and as the cable leaves them; of a single one, along its tangent made
    level, so that the cable is laid down in the direction in which it leaves. One that leaves
    vertically is laid along x (or y), to the same side whatever its control points.
    """
    places = held_places(scene, geometries)
    tangents = [rotations.rotate(geo.orientation, geo.tangent) for _, geo in places]
    if len(places) == 1:
        gravity = np.array(scene.gravity)
        down = gravity / max(math.hypot(*gravity), 1e-300)
        for one in (tangents[0], *np.eye(3)):
            level = one - (one * down).sum() * down
            size = math.hypot(*level)
            if size > LEVEL:
                return [level / size]
    return [straight_direction(scene, places), tangents[0], tangents[-1]]


def stiffening(scene: Scene, geometries: Geometries, breaks: Array) -> Array:
    """Factor of EI in every span between breaks due to the jaws that hold the cable straight.

    It is 1 / (1 - s), at most STIFFEST, where a share s of the span is in a jaw: a moment then
    bends the span by the same angle as it would bend the free part. A spline cannot be straight
    over part of a span only; with the tangent held at both ends of a jaw it would be straight far
    beyond the jaw.
    """
    share = np.zeros(len(breaks) - 1)
    for name, geometry in geometries.items():
        jaw = scene.holders[name].jaw
        if jaw and geometry.u is not None:
            begin = {"start": 0.0, "end": geometry.u - jaw}.get(name, geometry.u - 0.5 * jaw)
            inside = np.minimum(breaks[1:], begin + jaw) - np.maximum(breaks[:-1], begin)
            share += np.maximum(inside, 0.0) / np.maximum(np.diff(breaks), TINY)
    return np.asarray(1.0 / np.maximum(1.0 - share, 1.0 / STIFFEST))


def first_line(scene: Scene, geometries: Geometries, u: Array) -> Array:
    """Points [m] of the first shape at material coordinates u, shape (len(u), 3)."""
    places = held_places(scene, geometries)
    line = np.empty((len(u), 3))
    for here, (begin, geometry) in ((u <= places[0][0], places[0]), (u > places[0][0], places[-1])):
        direction = rotations.rotate(geometry.orientation, geometry.tangent)
        line[here] = geometry.attachment + (u[here] - begin)[:, None] * direction
    for (begin, one), (end, other) in pairwise(places):
        if begin == end:  # a gripper that slides, or a spring, where something else holds, too
            continue
        here = (u >= begin) & (u <= end)
        share = (u[here] - begin) / (end - begin)
        line[here] = _arc(scene, one.attachment, other.attachment, end - begin, share)
    return line


def _arc(scene: Scene, start: Array, end: Array, length: float, share: Array) -> Array:
    """Points at shares of a circular arc of a length from start to end, shape (len(share), 3).

    The arc sags in the direction of gravity. If the chord is not shorter, the points are on it.
    """
    chord = end - start
    gap = math.hypot(*chord)
    if gap >= length * (1.0 - 1e-9):
        return start + share[:, None] * chord
    ratio = gap / length
    # sin(a) / a = ratio for the half angle a in (0, pi]
    low, high = 1e-9, np.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sin(middle) / middle > ratio else (low, middle)
    angle = 0.5 * (low + high)
    along = chord / gap if gap > 1e-9 * length else np.array([1.0, 0.0, 0.0])
    down = np.asarray(scene.gravity, dtype=float)
    down = down - along * (down * along).sum()
    if math.hypot(*down) < 1e-9:
        down = np.cross(along, [0.0, 1.0, 0.0])
        if math.hypot(*down) < 1e-6:
            down = np.cross(along, [1.0, 0.0, 0.0])
    down = down / math.hypot(*down)
    radius = length / (2.0 * angle)
    phase = angle * (2.0 * share - 1.0)
    middle_point = 0.5 * (start + end)
    return (
        middle_point
        + np.outer(radius * np.sin(phase), along)
        + np.outer(radius * (np.cos(phase) - np.cos(angle)), down)
    )
