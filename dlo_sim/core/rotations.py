"""Rotations as unit quaternions (x, y, z, w), vectorised over leading axes.

Convention: a quaternion q of shape (..., 4) is stored x, y, z, w (the order of ROS messages) and
rotates vectors from the body frame into the world frame. `multiply(a, b)` applies b first, then a.
Rotation vectors are axis times angle [rad]. Nothing here normalises silently: pass unit
quaternions, or call `normalized` first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import one_rotation

Array = NDArray[np.float64]

IDENTITY: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


def normalized(q: ArrayLike) -> Array:
    """q / |q|, shape (..., 4); ValueError if a quaternion is zero or not finite."""
    return _each(one_rotation.normalized, q)


def _each(function: Callable[..., tuple[float, ...]], rows: ArrayLike) -> Array:
    """A function of `one_rotation` for every vector along the last axis."""
    rows = np.asarray(rows, dtype=float)
    if rows.ndim == 1:
        return np.array(function(rows.tolist()))
    results = [function(row) for row in rows.reshape(-1, rows.shape[-1]).tolist()]
    return np.array(results).reshape(*rows.shape[:-1], -1)


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product a b, shape (..., 4): the rotation b followed by the rotation a."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return _together(a.ndim == b.ndim == 1, *one_rotation.product(_components(a), _components(b)))


def _components(v: Array) -> Any:
    """The components along the last axis: arrays, or plain numbers of a single vector."""
    return v.tolist() if v.ndim == 1 else np.moveaxis(v, -1, 0)


def _together(single: bool, *parts: Any) -> Array:
    """Components back into the last axis."""
    return np.array(parts) if single else np.stack(np.broadcast_arrays(*parts), axis=-1)


def conjugate(q: ArrayLike) -> Array:
    """Inverse of unit quaternions, shape (..., 4)."""
    return np.asarray(q, dtype=float) * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """R(q) v, shape (..., 3): v = body coordinates in, world coordinates out."""
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    return _together(q.ndim == v.ndim == 1, *one_rotation.rotated(_components(q), _components(v)))


def to_matrix(q: ArrayLike) -> Array:
    """Rotation matrices R(q), shape (..., 3, 3); columns are the body axes in world coordinates."""
    q = np.asarray(q, dtype=float)
    x, y, z, w = _components(q)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    if q.ndim == 1:
        return np.array(rows)
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternion of a rotation matrix (3, 3), shape (4,), with w >= 0.

    Takes the largest of the four squared components as divisor (Shepperd 1978), so no angle loses
    digits.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.asarray(matrix, dtype=float).tolist()
    # The four rows of q q^T times 4, each a valid quaternion up to its norm.
    rows = (
        (1 + xx - yy - zz, xy + yx, xz + zx, zy - yz),
        (xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx),
        (xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy),
        (zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz),
    )
    best = max(range(4), key=lambda k: rows[k][k])
    q = normalized(rows[best])
    return -q if q[3] < 0.0 else q


def from_rotation_vector(rotation: ArrayLike) -> Array:
    """exp(w) as quaternions, shape (..., 4), of rotation vectors (..., 3) [rad]."""
    return _each(one_rotation.exponential, rotation)


def to_rotation_vector(q: ArrayLike) -> Array:
    """log(q): the rotation vector of the shorter way, angle in [0, pi], shape (..., 3) [rad]."""
    return _each(one_rotation.logarithm, q)


def slerp(a: ArrayLike, b: ArrayLike, fraction: ArrayLike) -> Array:
    """Orientation a fraction of the shorter way from a (0) to b or -b (1), shape (..., 4)."""
    step = to_rotation_vector(multiply(b, conjugate(a)))
    return multiply(from_rotation_vector(np.asarray(fraction, dtype=float)[..., None] * step), a)


def minimal_rotation(u: ArrayLike, v: ArrayLike) -> Array:
    """The rotation of smallest angle that takes direction u to direction v, shape (..., 4).

    u and v, shape (..., 3), need not have unit length; ValueError if zero or not finite. For
    opposite directions see `one_rotation.minimal`.
    """
    u, v = np.broadcast_arrays(_direction(u), _direction(v))
    return _each(lambda row: one_rotation.minimal(row[:3], row[3:]), np.concatenate((u, v), -1))


def swung(frame: ArrayLike, direction: ArrayLike) -> Array:
    """A frame, as columns (3, 3), whose first axis is turned to a direction (3,) by the smallest
    rotation.
    """
    old = np.asarray(frame)
    return np.asarray(to_matrix(minimal_rotation(old[:, 0], direction)) @ old)


def _direction(v: ArrayLike) -> Array:
    v = np.asarray(v, dtype=float)
    norm = np.linalg.norm(v, axis=-1, keepdims=True)
    if not np.all(np.isfinite(norm)) or np.any(norm == 0.0):
        raise ValueError("direction is zero or not finite: it gives no rotation")
    return np.asarray(v / norm)
