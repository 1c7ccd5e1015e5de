"""The curve of a cable at material coordinates: points, material frames, places of a gripper."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.core.strain import strain
from dlo_sim.engine.frames import curve_frames
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.geometry import NEAREST, Geometry
from dlo_sim.simulation.model import Body, Part

Array = NDArray[np.float64]
Basis = tuple[NDArray[np.int64], Array, Array]
MOST_BASES = 16  # sets of material coordinates whose basis values are kept


class Curve:
    """The curve of one strand of a cable in its present state.

    Attributes:
        greville: material coordinate [m] of each control point (Greville abscissa), shape (n_u,).

    Args:
        tangent: of the cable at its start, in the frame of the end effector there.
        number: of the strand, 0 for the main cable.
    """

    def __init__(self, cable: Cable, tangent: Array, number: int = 0) -> None:
        self._cable, self._number = cable, number
        self.greville = bspline.greville(self._part.model.knots)
        self._axis = np.eye(3)[np.argmin(np.abs(tangent))]
        self._bases: dict[bytes, Basis] = {}

    @property
    def _part(self) -> Part:
        return self._cable.model.parts[self._number]

    @property
    def name(self) -> str:
        """Name of the strand."""
        return self._part.name

    @property
    def length(self) -> float:
        """Rest length [m]."""
        return self._part.length

    @property
    def bending_stiffness(self) -> float:
        """EI [N m^2]."""
        return self._part.model.scene.cable.EI

    @property
    def control_points(self) -> Array:
        """Its control points x, y, z [m], theta [rad], world frame, shape (n_u, 4), a copy."""
        return self._part.model.in_world(self._own)

    @property
    def _own(self) -> Array:
        """Its control points in the cable's coordinates, shape (n_u, 4)."""
        return self._cable.points[self._part.here]

    def points(self, u: Array) -> Array:
        """Points [m] at u, world frame, shape (len(u), 3)."""
        columns, values, _ = self._basis(u)
        points = self._cable.points[:, :3].take(columns, axis=0)
        return np.einsum("mk,mkd->md", values, points) + self._cable.model.origin

    def tension(self, u: Array) -> Array:
        """`Simulator.tension` of this strand at u."""
        model = self._part.model
        if model.scene.without_tension:
            raise ValueError(f"tension: {model.scene.without_tension}")
        shape, cable = strain(model.knots, u), model.scene.cable
        return shape.tension(self._own[:, :3], cable.EA, cable.EI)

    def curvature(self, u: Array) -> Array:
        """Curvature [1/m] at u, shape (len(u),), 0 or more."""
        return strain(self._part.model.knots, u).curvature(self._own[:, :3])

    def frames(self, u: Array, time: float) -> Array:
        """Material frames at u at time [s] as quaternions x, y, z, w, shape (len(u), 4)."""
        # They are carried from the start.
        before = self.greville[self.greville < (u[0] if len(u) else 0.0)]
        poses = np.empty((len(before) + len(u), 7))
        self._write(np.concatenate([before, u]), time, False, poses)
        return poses[len(before) :, 3:]

    def control_poses(self, time: float, out: Array) -> None:
        """Write every control point [m], world frame, with the material frame at its material
        coordinate, into out, shape (n_u, 7).
        """
        self._write(self.greville, time, True, out)

    def taken(self, share: float, length: float, position: Array, orientation: Array) -> Geometry:
        """How a gripper at this pose, in the cable's coordinates, holds the cable if it takes it as
        it is, at a share of its length [m]; negative: where it is nearest to the gripper.

        Raises:
            ValueError: no such share.
        """
        if not -1.0 <= share <= 1.0:
            raise ValueError(f"at: needs a number from 0 to 1, or below for nearest, got {share!r}")
        u = share * length
        if share < 0.0:
            places = np.linspace(0.0, length, NEAREST)
            away = self.points(places) - self._cable.model.origin - position
            u = float(places[np.argmin(np.linalg.norm(away, axis=1))])
        columns, values, slopes = self._basis(np.array([u]))
        points = self._cable.points[columns[0], :3]
        tangent = (slopes[0, :, None] * points).sum(axis=0)
        tangent = rotations.rotate(rotations.conjugate(orientation), tangent)
        tangent /= math.hypot(*tangent)
        place = (values[0, :, None] * points).sum(axis=0)
        return Geometry(position, orientation, place, tangent, u)

    def twist_at(self, u: float, points: Array) -> float:
        """Twist angle [rad] of control points (n, 4) at u [m]."""
        columns, values, _ = self._basis(np.array([u]))
        return float((values[0] * points[columns[0], 3]).sum())

    def _write(self, u: Array, time: float, own: bool, out: Array) -> None:
        """Points of the curve, or its `own` control points, and material frames, whose second axis
        at the start is fixed in what holds the start, into out, shape (m, 7).
        """
        model, part = self._cable.model, self._part
        roots = (one for one in model.bodies if one.strand == part.name and one.u == 0.0)
        body = next((one for one in roots if not one.alone), None)
        grasp, axis = (part.grasp, self._axis) if body is None else (-1, self._side_of(body))
        given = model.blank.copy(), *self._basis(u), time, grasp, axis, model.origin
        self._cable.call(curve_frames, *given, part.first if own else -1, out)

    def _side_of(self, body: Body) -> Array:
        """Director e2 of a body, in the world."""
        points = self._cable.points[:, :3]
        return np.asarray((points[body.points[2]] - points[body.points[0]]) / body.length)

    def _basis(self, u: Array) -> Basis:
        """Indices of the active control points, basis values and derivatives at u, each (m, 4);
        cached.
        """
        key = u.tobytes()
        table = self._bases.get(key)
        if table is None:
            knots, begin = self._part.model.knots, self._part.first
            first, values = bspline.active_basis(knots, u)
            _, slopes = bspline.active_basis(knots, u, 1)
            table = (begin + first[:, None] + np.arange(bspline.ACTIVE), values, slopes)
            if len(self._bases) >= MOST_BASES:
                self._bases.clear()
            self._bases[key] = table
        return table
