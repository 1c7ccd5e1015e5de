"""The constants of a scene: the arrays that its cables share, and what they were made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, elimination, mass, quadrature, rotations
from dlo_sim.engine.arrays import PLASTICITY, CableArrays, Inputs, State
from dlo_sim.scene.description import EARTH, Obstacle, Scene
from dlo_sim.scene.needs import Needs
from dlo_sim.scene.nets import Connector
from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.geometry import Geometries
from dlo_sim.simulation.holding import Holding, Weights
from dlo_sim.simulation.meshes import Field

Array = NDArray[np.float64]
MAIN = "cable"  # name of the main strand


@dataclass(frozen=True)
class Model:
    """Constants of a scene; never changed after building.

    Attributes:
        scene, needs: what it was made of: a scene that leaves nothing open, with which terms.
        geometries: what holds the cable, grasps as they took it, relative to `origin`.
        arrays: those of its cables, without inputs, state and work.
        knots: clamped knot vector of the main cable, shape (n_u + 4,). rule: quadrature.
        axes: world axis of every spatial line. twist: whether a twist line follows.
        holding: held points, constraint rows and springs.
        axial_stiffness: EA [N]. bending_stiffness: EI of every span [N m^2], stiffened by jaws,
            shape (n - 3,).
        rest: constant coordinate of planar motion [m] in its component, zero in the others, shape
            (3,).
        origin: of the cable's coordinates in the world [m], shape (3,) (`geometry.origin_of`). All
            positions in the arrays are relative to it.
        obstacles: their places in the scene, as motions, shape (MOTION_SIZE,). fields: of those
            that are meshes, which are kept while a model needs them.
        layout: where the strands of a net are; None of a single cable.
    """

    scene: Scene
    needs: Needs
    geometries: Geometries
    arrays: CableArrays
    knots: Array
    rule: quadrature.Quadrature
    axes: tuple[int, ...]
    twist: bool
    holding: Holding
    axial_stiffness: float
    bending_stiffness: Array
    rest: Array
    origin: Array
    obstacles: dict[Obstacle, Array]
    fields: tuple[Field, ...]
    layout: Layout | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without the fields, which another process makes if it needs more than the arrays hold."""
        return self.__dict__ | {"fields": ()}

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        """Copies of a cable share the constants."""
        return self

    @property
    def n(self) -> int:
        """Number of control points."""
        return self.arrays.sizes["n"]

    @property
    def lines(self) -> int:
        """Number of lines: the spatial ones, and the twist line if there is one."""
        return self.arrays.sizes["lines"]

    @property
    def rooms(self) -> tuple[int, int]:
        """Numbers in the inputs and in the state of a cable."""
        return Inputs.room(self.arrays.sizes), State.room(self.arrays.sizes)

    @property
    def terms(self) -> int:
        """Bits of the active terms."""
        return self.arrays.sizes["terms"]

    def has(self, bit: int) -> bool:
        """Whether the term with this bit is active."""
        return bool(self.terms & bit)

    @property
    def spring_places(self) -> list[tuple[int, int, bool]]:
        """What each spring holds: grasp, column of x, y, z, theta, and whether r' there."""
        springs = self.holding.springs
        return [(one.grasp, self.columns[one.line], one.aims) for one in springs]

    @cached_property
    def blank(self) -> Array:
        """Columns x, y, z, theta, shape (n, 4), with the coordinates that have no line."""
        return np.tile(np.append(self.rest, 0.0), (self.n, 1))

    @property
    def columns(self) -> tuple[int, ...]:
        """Column of x, y, z, theta that belongs to each line."""
        return (*self.axes, 3) if self.twist else self.axes

    def to_columns(self, lines: Array, rest: bool = True) -> Array:
        """Lines (..., lines, n) as control points x, y, z, theta, shape (..., n, 4).

        Coordinates without a line are 0; with `rest`, the constant coordinate of planar motion is
        filled in (false for velocities).
        """
        out = np.zeros((*lines.shape[:-2], self.n, 4))
        if rest:
            out[:] = self.blank
        for line, column in enumerate(self.columns):
            out[..., column] = lines[..., line, :]
        return out

    def in_world(self, columns: Array) -> Array:
        """Control points (..., n, 4) of the cable's coordinates in the world, a copy."""
        out = columns.copy()
        out[..., :3] += self.origin
        return out

    def to_lines(self, columns: Array) -> Array:
        """Control points (n, 4) as lines (lines, n)."""
        return np.ascontiguousarray(columns[:, list(self.columns)].T)

    def own_columns(self, what: str, value: ArrayLike, rest: bool = True) -> Array:
        """Check control points (n, 4) from a caller, or with `rest` false their velocities.

        Raises:
            TypeError: not numbers. ValueError: another shape, not finite, or a coordinate differs
                that the scene does not simulate.
        """
        columns = arguments.numbers(what, value, (self.n, 4))
        own = self.to_columns(self.to_lines(columns), rest)
        if not np.allclose(own, columns, rtol=0.0, atol=1e-12):
            raise ValueError(
                f"{what}: leave the coordinates of the step, {self.columns} of x, y, z, theta; "
                f"set terms.out_of_plane: on or terms.twist: quasistatic"
            )
        return columns

    def mass(self, line: int) -> Array:
        """Mass matrix of one line, lower diagonals, shape (4, n)."""
        return self._lower(self.arrays.linear.mass[int(line >= len(self.axes))])

    def mass_solutions(self, values: Array, twist: int) -> Array:
        """M^-1 b for rows b, shape (m, n), with the mass matrix of space or of the twist line."""
        band = self._lower(self.arrays.linear.mass[twist])
        return elimination.solve(mass.dense(band), values.T, bspline.DEGREE)[0].T

    @property
    def twisting_stiffness(self) -> Array:
        """Stiffness matrix of the twist line with its springs, lower diagonals, shape (4, n)."""
        return self._lower(self.arrays.linear.twist) + self.holding.roll_stiffness(self.n)

    def _lower(self, matrix: Array) -> Array:
        return without_margins(matrix, self.n)[3:].copy()

    @property
    def parts(self) -> tuple[Part, ...]:
        """The strands: the main cable first."""
        if self.layout is None:
            return (Part(MAIN, self, 0, 0, np.eye(3)),)
        return tuple(self.layout.parts.values())

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The rigid bodies of a net."""
        return () if self.layout is None else self.layout.bodies

    @property
    def joins(self) -> tuple[Join, ...]:
        """What holds the strands of a net together."""
        return () if self.layout is None else self.layout.joins

    def part_held(self, grasp: int) -> Part:
        """The strand that the holder with this number may hold."""
        return next(part for part in reversed(self.parts) if part.grasp <= grasp)

    @property
    def length(self) -> float:
        """Rest length [m] of the longest strand."""
        return max(part.length for part in self.parts)

    @property
    def shares(self) -> Array:
        """Greville abscissa of each control point as a share of the length of its strand; 0 of
        those of bodies alone.
        """
        out = np.zeros(self.n)
        for part in self.parts:
            out[part.here] = bspline.greville(part.model.knots) / part.length
        return out

    def place_of(self, point: int) -> str:
        """Where a control point is, in words."""
        for part in self.parts:
            if part.here.start <= point < part.here.stop:
                u = bspline.greville(part.model.knots)[point - part.first]
                return f"u = {u:.3g} m" + f" of {part.name}" * (part.name != MAIN)
        return "a body"

    @property
    def sample_shares(self) -> Array:
        """Material coordinate / length of every quadrature point, shape (spans, samples)."""
        if self.layout is not None:
            return self.layout.by_span([part.model.sample_shares for part in self.parts])
        return self.rule.places(bspline.breaks(self.knots)) / self.knots[-1]

    @property
    def moment_weights(self) -> Array:
        """Bending stiffness times quadrature weight [N m^3], shape (spans, samples, 1)."""
        return np.asarray((self.bending_stiffness[:, None] * self.rule.weights)[..., None])

    @property
    def elastic_share(self) -> float:
        """Share of the bending stiffness with the natural curvature: 1, or with plasticity h."""
        if not self.has(PLASTICITY):
            return 1.0
        ratio = self.arrays.physics.hardening
        return float(ratio / (1.0 + ratio))

    def held_mask(self) -> NDArray[np.bool_]:
        """Mask of the line entries held by rows at single control points, shape (lines, n)."""
        mask = np.zeros((self.lines, self.n), dtype=bool)
        for row in self.holding.rows:
            if row.line >= 0 and self.holding.points[row.point].own >= 0:
                mask[row.line, self.holding.points[row.point].own] = True
        return mask


@dataclass(frozen=True)
class Part:
    """A strand in the arrays of a net.

    Attributes:
        name: of the strand. model: of the strand alone. first: its first control point.
        grasp: the first of its holders in the arrays. drawn: frame in which it is drawn.
    """

    name: str
    model: Model
    first: int
    grasp: int
    drawn: Array

    @property
    def here(self) -> slice:
        """Its control points."""
        return slice(self.first, self.first + self.model.n)

    @property
    def spans(self) -> slice:
        """Its knot spans."""
        return slice(self.first, self.first + self.model.n - bspline.DEGREE)

    @property
    def length(self) -> float:
        """Its rest length [m]."""
        return float(self.model.knots[-1])


class Join(NamedTuple):
    """What holds an end of a strand at a place of another one, or of itself.

    Attributes:
        strand, u: whose end, and where that is [m]. other, at: where it is held [m].
        rigid: whether direction and roll are held, too. stiffness: of these [N m/rad]; infinite:
            rigidly. in_line: whether both tangents are in line; 1, or -1 if the strands meet head
            to head, else 0.
    """

    strand: str
    u: float
    other: str
    at: float
    rigid: bool
    stiffness: float
    in_line: int


class Body(NamedTuple):
    """A rigid body.

    Attributes:
        strand, u: where it is [m]. connector: None for that of a joint.
        frame: its directors as columns, as those of `Layout.drawn`. length: of its directors [m].
        first: its first control point; points: origin, ends of e1, e2, e3. alone: whether none of
            them is of the strand. signs: -1 where a director points from there to the origin.
    """

    strand: str
    u: float
    connector: Connector | None
    frame: Array
    length: float
    first: int
    points: list[int]
    alone: bool
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def is_hinged(self) -> bool:
        """Whether it hangs on its origin."""
        return self.connector is not None and self.connector.joint == "hinged"

    @property
    def load(self) -> float:
        """Stiffness [J] that its weight suggests: a hundred times the moment [N m] of the weight on
        earth about the origin, at the radius of gyration.
        """
        if self.connector is None:
            return 0.0
        one = self.connector
        second = (np.array(one.center) ** 2).sum() + sum(one.inertia) / one.mass
        return 100.0 * EARTH * one.mass * math.sqrt(second)

    def pose(self, points: Array) -> Array:
        """Position [m] and quaternion x, y, z, w where its control points are (..., 4, 3), shape
        (..., 7).
        """
        origin = points[..., :1, :]
        rows = np.array(self.signs)[:, None] * (points[..., 1:, :] - origin) / self.length
        turned = [rotations.from_matrix(one.T) for one in rows.reshape(-1, 3, 3)]
        return np.concatenate([origin[..., 0, :], np.reshape(turned, (*rows.shape[:-2], 4))], -1)

    def taken(self, other: Body, points: Array) -> Array:
        """Its control points [m], shape (4, 3), where it lies as another body with directors of
        other lengths that has these, or their velocities [m/s].
        """
        ratio = np.array(self.signs) * self.length / (np.array(other.signs) * other.length)
        return points[0] + np.append(0.0, ratio)[:, None] * (points - points[0])

    def weights(self, arm: Array) -> Weights:
        """Weights of its control points, from `first` on, in the vector sum_i arm_i e_i."""
        out = np.zeros(4)
        for share, sign, point in zip(arm, self.signs, self.points[1:], strict=True):
            out[point - self.first] += share * sign / self.length
            out[self.points[0] - self.first] -= share * sign / self.length
        a, b, c, d = out.tolist()
        return a, b, c, d

    def inertia(self, light: float) -> Array:
        """Mass matrix of its control points, from `first` on, shape (4, 4) [kg]; light: mass [kg]
        on each control point of a joint's that is of no strand.
        """
        out = np.zeros((4, 4))
        if self.connector is None:
            own = np.array(self.points[2:]) - self.first
            out[own, own] = light
            return out
        one = self.connector
        center, J = np.array(one.center), np.array(one.inertia)
        second = np.diag(0.5 * J.sum() - J) + one.mass * np.outer(center, center)
        # r = o + sum_i a_i e_i has the integrals m, m c and `second` of 1, a and a a^T.
        moments = np.block(
            [
                [np.array([[one.mass]]), one.mass * center[None]],
                [one.mass * center[:, None], second],
            ]
        )
        columns = np.zeros((4, 4))
        columns[0, self.points[0] - self.first] = 1.0
        for k in range(3):
            columns[1 + k] = self.weights(np.eye(3)[k])
        return columns.T @ moments @ columns


class Layout(NamedTuple):
    """Where everything of a net is.

    Attributes:
        parts: the strands by name, the main one first. joins, bodies: see there.
        n: number of control points.
    """

    parts: dict[str, Part]
    joins: tuple[Join, ...]
    bodies: tuple[Body, ...]
    n: int

    def by_span(self, values: Sequence[Array], void: float = 0.0) -> Array:
        """Values of the spans of each strand, shape (spans, ...), in the net, with void spans."""
        out = np.full((self.n - bspline.DEGREE, *values[0].shape[1:]), void)
        for part, own in zip(self.parts.values(), values, strict=True):
            out[part.spans] = own
        return out

    def by_point(self, values: Sequence[Array]) -> Array:
        """Values of the control points of each strand, shape (..., n), in the net, 0 elsewhere."""
        out = np.zeros((*values[0].shape[:-1], self.n))
        for part, own in zip(self.parts.values(), values, strict=True):
            out[..., part.here] = own
        return out

    def is_seamless(self, join: Join) -> bool:
        """Whether the curvature goes on through a joint: of like cables in line, rigidly joined,
        with nothing else there.
        """
        both = {(join.strand, join.u), (join.other, join.at)}
        cables = [self.parts[name].model.scene.cable for name, _ in both]
        alike = all(
            (one.EI, one.natural_shape) == (cables[0].EI, cables[0].natural_shape) for one in cables
        )
        joins = [one for one in self.joins if both & {(one.strand, one.u), (one.other, one.at)}]
        bodies = [one for one in self.bodies if (one.strand, one.u) in both]
        held = join.at not in (0.0, self.parts[join.other].length)  # amid the other strand
        rigid = join.in_line == 1 and math.isinf(join.stiffness)
        return rigid and alike and len(joins) == 1 and not bodies and not held

    def root(self, strand: str) -> Body:
        """The body in which a strand begins."""
        return next(
            one for one in self.bodies if (one.strand, one.u, one.alone) == (strand, 0.0, False)
        )
