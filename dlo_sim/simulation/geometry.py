"""Where a scene's cable begins: end-effector poses, attachment points, tangents, first shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, rotations
from dlo_sim.scene.description import Scene

Array = NDArray[np.float64]
Pose = tuple[ArrayLike, ArrayLike]
ENDS = ("start", "end")


@dataclass(frozen=True)
class EndGeometry:
    """One end effector at time zero.

    Attributes:
        position, orientation: of the end effector, world frame; quaternion x, y, z, w.
        attachment: where it holds the cable [m], world frame.
        tangent: unit direction of the cable from start towards end, in the end-effector frame.
    """

    position: Array
    orientation: Array
    attachment: Array
    tangent: Array


def known_end(end: object) -> str:
    """The name of an end.

    Raises:
        TypeError, ValueError: not one.
    """
    return arguments.one_of("end", end, ENDS)


def end_geometries(scene: Scene, poses: Mapping[str, Pose] | None = None) -> dict[str, EndGeometry]:
    """Both ends from the scene, or from end-effector poses where given.

    Raises:
        TypeError, ValueError: poses that are none.
    """
    poses = {} if poses is None else _checked(poses)
    placed: dict[str, tuple[Array, Array, Array]] = {}
    for name in ENDS:
        end = scene.ends[name]
        position, orientation = poses.get(name, (end.position, rotations.IDENTITY))
        position, orientation = np.asarray(position), np.asarray(orientation)
        placed[name] = (position, orientation, position + rotations.rotate(orientation, end.offset))
    line = _straight_direction(scene, placed["start"][2], placed["end"][2])
    result = {}
    for name in ENDS:
        position, orientation, attachment = placed[name]
        tangent = np.asarray(scene.ends[name].tangent, dtype=float)
        if not tangent.any():
            tangent = rotations.rotate(rotations.conjugate(orientation), line)
        result[name] = EndGeometry(
            position, orientation, attachment, tangent / np.linalg.norm(tangent)
        )
    return result


def _checked(poses: object) -> dict[str, Pose]:
    checked: dict[str, Pose] = {}
    if not isinstance(poses, Mapping):
        raise TypeError(
            'end_poses: needs {"start": (position, quaternion), ...}, got ' + arguments.given(poses)
        )
    for end, pose in poses.items():
        name = f"end_poses[{known_end(end)!r}]"
        if not isinstance(pose, Sequence) or len(pose) != 2:
            raise TypeError(
                f"{name}: needs (position, quaternion) as of end_pose, got {arguments.given(pose)}"
            )
        position = arguments.numbers(f"{name} position", pose[0], (3,), "m")
        checked[end] = position, given_quaternion(f"{name} quaternion", pose[1])
    return checked


def given_quaternion(name: str, value: object) -> Array:
    """A unit quaternion from one of any length but zero, shape (4,).

    Raises:
        TypeError, ValueError: not four finite numbers, or zero.
    """
    quaternion = arguments.numbers(name, value, (4,), "x, y, z, w")
    try:
        return rotations.normalized(quaternion)
    except ValueError as refusal:
        raise ValueError(f"{name}: {refusal}; give [0, 0, 0, 1] for no turn") from None


def _straight_direction(scene: Scene, start: Array, end: Array) -> Array:
    """Unit direction from start to end; along gravity or x where both ends coincide."""
    line = end - start
    if np.linalg.norm(line) < 1e-9 * scene.cable.length:
        line = np.asarray(scene.gravity, dtype=float)
    if not line.any():
        line = np.array([1.0, 0.0, 0.0])
    return line / np.linalg.norm(line)


def world_tangent(geometry: EndGeometry) -> Array:
    """Direction of the cable at an end, world frame."""
    return rotations.rotate(geometry.orientation, geometry.tangent)


def first_shape(scene: Scene, ends: Mapping[str, EndGeometry], knots: Array) -> Array:
    """Control points [m], shape (n, 3), before any relaxation.

    A free end continues the held one in a straight line of rest length. Two held ends closer than
    the length get a sagging arc of that length; at the length or beyond, a straight line.
    """
    length = scene.cable.length
    greville = bspline.greville(knots)
    start, end = ends["start"], ends["end"]
    held = {name: scene.ends[name].held for name in ENDS}
    if held["start"] and held["end"]:
        gap = float(np.linalg.norm(end.attachment - start.attachment))
        if gap >= length * (1.0 - 1e-9):
            share = (greville / length)[:, None]
            return (1.0 - share) * start.attachment + share * end.attachment
        return bspline.interpolate(knots, _arc(scene, start.attachment, end.attachment, greville))
    if held["end"]:
        direction = world_tangent(end)
        return end.attachment + (greville - length)[:, None] * direction
    direction = world_tangent(start)
    return start.attachment + greville[:, None] * direction


def _arc(scene: Scene, start: Array, end: Array, u: Array) -> Array:
    """Circular arc of length L over the chord start-end, on the side that gravity pulls to."""
    length = scene.cable.length
    chord = end - start
    gap = float(np.linalg.norm(chord))
    ratio = gap / length
    # sin(a) / a = ratio for the half angle a in (0, pi]
    low, high = 1e-9, np.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sin(middle) / middle > ratio else (low, middle)
    angle = 0.5 * (low + high)
    along = chord / gap if gap > 1e-9 * length else np.array([1.0, 0.0, 0.0])
    down = np.asarray(scene.gravity, dtype=float)
    down = down - along * (down @ along)
    if np.linalg.norm(down) < 1e-9:
        down = np.cross(along, [0.0, 1.0, 0.0])
        if np.linalg.norm(down) < 1e-6:
            down = np.cross(along, [1.0, 0.0, 0.0])
    down = down / np.linalg.norm(down)
    radius = length / (2.0 * angle)
    phase = angle * (2.0 * u / length - 1.0)
    middle_point = 0.5 * (start + end)
    return (
        middle_point
        + np.outer(radius * np.sin(phase), along)
        + np.outer(radius * (np.cos(phase) - np.cos(angle)), down)
    )
