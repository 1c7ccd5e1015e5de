"""Turns the ends and grasps of a scene into held points, constraint rows and springs.

At an end, each fixed axis is a row of the end's control point. A clamp adds the rows of the
neighbouring control point normal to the tangent (its distance along the tangent stays free), and
the twist. A grasp between control points has rows of the same kind with four basis values: fixed
axes hold sum_k b_k x_k, a clamp the components of r' = sum_k b'_k x_k normal to its tangent. A
spring holds such a position, r' or the twist through a stiffness. A grasp that slides is neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.engine.arrays import BORDERED, SLIDING, SPRUNG
from dlo_sim.engine.sliding import NEXT
from dlo_sim.scene.description import EARTH, Grasp, Holder, Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.geometry import Geometries, Geometry

Array = NDArray[np.float64]
RIGID = 1e4  # stiffness of a roll held without a spring, in torsional stiffnesses of a span
# Least singular value of the normalised rows of all held points: that of positions 3 % of a span
# apart, of clamps 60 %. What holds nearer places stretches whole spans by what it moves relative to
# each other: 1 mm apart on spans of 10 cm and moved apart by 3 mm, to three times their length.
LEAST_APART = 0.02
SLIDE_DEPTH = 0.01  # of the diameter


Weights = tuple[float, float, float, float]


@dataclass(frozen=True)
class Point:
    """A held point: four basis values from control point `first` on.

    Attributes:
        own: the control point if it is a single one, else -1. twist: on the twist line.
        other, other_weights: between two branches, control point and basis values on the other one,
            with the opposite sign.
    """

    first: int
    weights: Weights
    own: int = -1
    twist: bool = False
    other: int = -1
    other_weights: Weights = (0.0, 0.0, 0.0, 0.0)

    def values(self, n: int) -> Array:
        """Basis values at all control points, shape (n,)."""
        out = np.zeros(n)
        out[self.first : self.first + 4] = self.weights
        if self.other >= 0:
            out[self.other : self.other + 4] += self.other_weights
        return out


@dataclass(frozen=True)
class Row:
    """A constraint row: one direction of a point, that of a line, or `body` in the grasp's frame
    (line -1).

    Attributes:
        point: index in `Holding.points`. grasp: -1 between two branches.
        stiffness: of a spring [N/m], of r' or the twist [N m/rad]; infinite: the row is rigid.
        aims: whether a spring for r' aims at the direction of its grasp. xi: of the twist, local
            coordinate in its knot span, -1 to 1.
    """

    point: int
    grasp: int
    line: int
    body: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stiffness: float = np.inf
    aims: bool = False
    xi: float = 0.0


@dataclass(frozen=True)
class Slide:
    """A grasp that lets the cable slide (`engine.sliding`).

    Attributes:
        u: material coordinate that it holds first [m]. law: k, k_t, mu and grip. stops: material
            coordinates between which it slides [m], beyond the cable where an end is free.
    """

    grasp: int
    u: float
    law: tuple[float, float, float, float]
    stops: tuple[float, float] = (-np.inf, np.inf)


@dataclass
class Holding:
    """Held points and constraint rows: rigid ones, those between control points last; and springs,
    those between branches first; and what slides. Grasp g is the g-th of `Scene.holders`.
    """

    points: list[Point] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    springs: list[Row] = field(default_factory=list)
    slides: list[Slide] = field(default_factory=list)

    def hold(self, point: Point) -> int:
        """Add a point; returns its index."""
        self.points.append(point)
        return len(self.points) - 1

    @property
    def border(self) -> int:
        """Number of rigid rows at points between control points; they are the last ones."""
        return sum(self.points[row.point].own < 0 for row in self.rows)

    @property
    def joints(self) -> int:
        """Number of springs between branches; they are the first ones."""
        return sum(self.points[spring.point].other >= 0 for spring in self.springs)

    @property
    def terms(self) -> int:
        """Bits of what holds the cable: places between control points, springs, slides."""
        bordered = self.border > 0 or self.joints > 0
        present = {BORDERED: bordered, SPRUNG: bool(self.springs), SLIDING: bool(self.slides)}
        return sum(bit for bit, there in present.items() if there)

    @property
    def between(self) -> int:
        """Number of rows and springs between two places."""
        return sum(self.points[row.point].other >= 0 for row in [*self.rows, *self.springs])

    @property
    def rigid_points(self) -> list[Point]:
        """Points in space that rigid rows hold."""
        held = sorted({row.point for row in self.rows})
        return [self.points[k] for k in held if not self.points[k].twist]

    @property
    def roll_springs(self) -> list[Row]:
        """Springs on the twist line."""
        return [spring for spring in self.springs if self.points[spring.point].twist]

    def roll_stiffness(self, n: int) -> Array:
        """Stiffness matrix of the springs on the twist line, lower diagonals, shape (4, n)."""
        band = np.zeros((4, n))
        for spring in self.roll_springs:
            point = self.points[spring.point]
            weights, first = np.array(point.weights), point.first
            for k in range(4):
                here = slice(first, first + 4 - k)
                band[k, here] += spring.stiffness * weights[k:] * weights[: 4 - k]
        return band


def own_point(i: int, n: int) -> Point:
    """Control point i alone."""
    first = min(i, n - 4)
    a, b, c, d = np.eye(4)[i - first].tolist()
    return Point(first, (a, b, c, d), i)


def holding_of(
    scene: Scene, geometries: Geometries, knots: Array, axes: tuple[int, ...], twist: bool
) -> Holding:
    """What the ends and grasps hold, in the lines of these axes.

    Raises:
        SceneError: a grasp holds a point that is already held.
    """
    n = len(knots) - bspline.ACTIVE
    holding = Holding()
    for grasp, (name, holder) in enumerate(scene.holders.items()):
        geometry, is_end = geometries[name], name in scene.ends
        if geometry.u is None:
            continue
        if isinstance(holder, Grasp) and holder.slides:
            holding.slides.append(Slide(grasp, geometry.u, law_of_slide(holder, scene)))
            continue
        if is_end:
            spot, beside = (own_point(i if name == "start" else n - 1 - i, n) for i in (0, 1))
        else:
            spot, beside = _between(knots, geometry.u)
        fixed = [line for line, axis in enumerate(axes) if holder.fixed[axis]]
        if fixed:
            point = holding.hold(spot)
            holding.rows += [Row(point, grasp, line) for line in fixed]
        if holder.clamped:
            point = holding.hold(beside)
            for x, y, z in across(geometry, axes):
                holding.rows.append(Row(point, grasp, -1, (x, y, z)))
        if holder.clamped and is_end and twist:
            point, xi = holding.hold(replace(spot, twist=True)), -1.0 if name == "start" else 1.0
            holding.rows.append(Row(point, grasp, len(axes), xi=xi))
        holding.springs += _springs(holding, spot, grasp, holder.spring, axes)
        if fixed and not is_end:
            _check_independent(holding, name, geometry.u, n, scene)
        if holder.holds_direction:
            place, slope = _between(knots, geometry.u)
            stiffness = [holder.tangent_spring] * 3
            holding.springs += _springs(holding, slope, grasp, stiffness, axes, aims=True)
            roll = stiffness_of_roll(holder, scene)
            if twist and roll:
                point = holding.hold(replace(place, twist=True))
                xi = float(bspline.locate(knots, geometry.u)[1])
                holding.springs.append(Row(point, grasp, len(axes), stiffness=roll, xi=xi))
    held = [
        float(geometries[name].u or 0.0)
        for name, holder in scene.holders.items()
        if geometries[name].u is not None and (any(holder.fixed) or any(holder.spring))
        if not (isinstance(holder, Grasp) and holder.slides)
    ]
    holding.slides = [stopped(slide, held, scene.cable.length) for slide in holding.slides]
    return holding


def stopped(slide: Slide, held: Sequence[float], length: float) -> Slide:
    """A slide that stops beside what else holds the cable, at these material coordinates [m]; not
    at that where it begins, unless this is an end.
    """
    apart = NEXT * length
    below = [u for u in held if u < slide.u or u == slide.u == 0.0]
    above = [u for u in held if u > slide.u or u == slide.u == length]
    low, high = max(below, default=-2.0 * length) + apart, min(above, default=3.0 * length) - apart
    return replace(slide, u=min(max(slide.u, low), high), stops=(low, high))


def law_of_slide(grasp: Grasp, scene: Scene) -> tuple[float, float, float, float]:
    """k [N/m], k_t [N m/rad], mu and grip [N] of a grasp that slides (`engine.sliding`).

    k is such that neither the weight of the cable, nor a tension that stretches it by 0.1 %, moves
    it out of the gripper by more than 1 % of its diameter.
    """
    cable = scene.cable
    weight, pull = cable.mu * EARTH * cable.length, 1e-3 * cable.EA
    stiffness = max(weight, pull) / (SLIDE_DEPTH * cable.diameter)
    return stiffness, grasp.tangent_spring, scene.friction_of(grasp), grasp.grip


def stiffness_of_roll(holder: Holder, scene: Scene) -> float:
    """Stiffness [N m/rad] of the spring that holds the roll; 0 if there is none."""
    if not (isinstance(holder, Grasp) and holder.roll):
        return holder.roll_spring
    spans = scene.discretization.control_points - bspline.DEGREE
    return RIGID * scene.cable.GJ * spans / scene.cable.length


def _check_independent(holding: Holding, name: str, u: float, n: int, scene: Scene) -> None:
    """Check that the held points are linearly independent.

    Raises:
        SceneError: grasp `name`, added last, holds a point that is already held.
    """
    span = scene.cable.length / (n - bspline.DEGREE)
    spots = holding.rigid_points
    rows = np.array([point.values(n) for point in spots]).reshape(-1, n)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    if len(spots) > n or np.linalg.svd(rows, compute_uv=False)[-1] < LEAST_APART:
        raise SceneError(
            f"grasps.{name}.at: the cable is held at {u:.6g} m already, or nearer to it than knot "
            f"spans of {span:.2g} m can resolve, or in more places than {n} control points can "
            "follow; take it a span away, hold no direction, or raise discretization.control_points"
        )


def _springs(
    holding: Holding,
    point: Point,
    grasp: int,
    by_axis: Sequence[float],
    axes: tuple[int, ...],
    aims: bool = False,
) -> list[Row]:
    """Springs along the axes where the stiffness is not zero."""
    lines = [line for line, axis in enumerate(axes) if by_axis[axis]]
    if not lines:
        return []
    held = holding.hold(point)
    return [
        Row(held, grasp, line, stiffness=float(by_axis[axes[line]]), aims=aims) for line in lines
    ]


def _between(knots: Array, u: float) -> tuple[Point, Point]:
    """Basis values of the position and of r' at u [m], each as a held point."""
    first, values = bspline.active_basis(knots, [u])
    a, b, c, d = values[0].tolist()
    place = Point(int(first[0]), (a, b, c, d))
    a, b, c, _ = bspline.active_basis(knots, [u], 1)[1][0].tolist()
    # Derivatives of the basis sum to zero; a round-off error in that would pull on the whole cable.
    return place, replace(place, weights=(a, b, c, -a - b - c))


def across(end: Geometry, axes: tuple[int, ...]) -> list[Array]:
    """Unit directions normal to a clamp's tangent, gripper's frame: two, or one in a plane."""
    tangent = end.tangent
    if len(axes) == 2:
        (normal,) = (axis for axis in range(3) if axis not in axes)
        body_normal = rotations.rotate(rotations.conjugate(end.orientation), np.eye(3)[normal])
        side = np.cross(body_normal, tangent)
        return [side / math.hypot(*side)]
    helper = np.eye(3)[np.argmin(np.abs(tangent))]
    side = np.cross(tangent, helper)
    side /= math.hypot(*side)
    return [side, np.cross(tangent, side)]
