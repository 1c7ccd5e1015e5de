"""What a scene holds, as a list: the one place that turns ends into held points and rows.

Start and end are two grasps. A fixed axis is a row of the end's control point; a clamp is the rows
across its tangent of the neighbour, whose distance along the tangent stays free, and the twist; a
spring is a row held through a stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import inextensible
from dlo_sim.simulation.geometry import ENDS, EndGeometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """A held point: four basis values from control point `first` on, or a control point `own`."""

    first: int
    weights: tuple[float, float, float, float]
    own: int = -1
    twist: bool = False


@dataclass(frozen=True)
class Row:
    """One direction of a held point: along a line, or (line -1) fixed in its grasp's frame."""

    point: int
    grasp: int
    line: int
    body: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Spring:
    """A point held along a line through a stiffness [N/m]."""

    point: Point
    grasp: int
    line: int
    stiffness: float


@dataclass
class Holding:
    """All that is held. Grasp g is `ENDS[g]`."""

    points: list[Point] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)

    def hold(self, point: Point) -> int:
        """Add a point; its number."""
        self.points.append(point)
        return len(self.points) - 1


def own_point(i: int, n: int, twist: bool = False) -> Point:
    """Control point i alone."""
    first = min(i, n - 4)
    weights = np.eye(4)[i - first]
    return Point(first, (weights[0], weights[1], weights[2], weights[3]), i, twist)


def holding_of(
    scene: Scene, ends: Mapping[str, EndGeometry], axes: tuple[int, ...], twist: bool
) -> Holding:
    """What the scene's ends hold in the lines of these axes."""
    n = scene.discretization.control_points
    holding = Holding()
    for grasp, name in enumerate(ENDS):
        end, geometry = scene.ends[name], ends[name]
        outer, inner = (0, 1) if name == "start" else (n - 1, n - 2)
        if any(end.fixed[axis] for axis in axes):
            point = holding.hold(own_point(outer, n))
            holding.rows += [
                Row(point, grasp, line) for line, axis in enumerate(axes) if end.fixed[axis]
            ]
        if end.clamped:
            point = holding.hold(own_point(inner, n))
            for body in across(geometry, axes):
                x, y, z = body
                holding.rows.append(Row(point, grasp, -1, (x, y, z)))
            if twist:
                point = holding.hold(own_point(outer, n, twist=True))
                holding.rows.append(Row(point, grasp, len(axes)))
    for grasp, stiffness in enumerate(_spring_stiffness(scene, ends)):
        outer = 0 if grasp == 0 else n - 1
        holding.springs += [
            Spring(own_point(outer, n), grasp, line, float(stiffness[axis]))
            for line, axis in enumerate(axes)
            if stiffness[axis]
        ]
    return holding


def across(end: EndGeometry, axes: tuple[int, ...]) -> list[Array]:
    """Unit directions across a clamp's tangent, in the gripper's frame: two, in a plane one."""
    tangent = end.tangent
    if len(axes) == 2:
        (normal,) = (axis for axis in range(3) if axis not in axes)
        body_normal = rotations.rotate(rotations.conjugate(end.orientation), np.eye(3)[normal])
        side = np.cross(body_normal, tangent)
        return [side / np.linalg.norm(side)]
    helper = np.eye(3)[np.argmin(np.abs(tangent))]
    side = np.cross(tangent, helper)
    side /= np.linalg.norm(side)
    return [side, np.cross(tangent, side)]


def _spring_stiffness(scene: Scene, ends: Mapping[str, EndGeometry]) -> Array:
    """Stiffness [N/m] of both ends along x, y, z, shape (2, 3)."""
    stiffness = np.array([scene.ends[name].spring for name in ENDS], dtype=float)
    if inextensible(scene) and scene.cable.EA > 0.0:
        # An inextensible cable hands its own compliance along the line to its two end springs.
        line = ends["end"].attachment - ends["start"].attachment
        share = (line / max(float(np.linalg.norm(line)), 1e-300)) ** 2
        compliance = 0.5 * share * scene.cable.length / scene.cable.EA
        stiffness = stiffness / (1.0 + stiffness * compliance)
    return stiffness
