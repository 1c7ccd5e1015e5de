"""The constant arrays of a cable (`engine.layout`), and access to their contents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import arguments, bspline, quadrature
from dlo_sim.engine import layout
from dlo_sim.simulation.arrays import (
    Counts,
    Table,
    aligned_zeros,
    from_blocks,
    line_view,
    to_blocks,
)
from dlo_sim.simulation.holding import Holding

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Model:
    """Constant arrays of a scene; never changed after building.

    Attributes:
        shape, values: arrays `shape` and `model` of the compiled functions.
        sizes: of the arrays inputs, state and scratch. counts: numbers of their parts.
        knots: clamped knot vector, shape (n + 4,). rule: quadrature.
        axes: world axis of every spatial line. twist: whether a twist line follows.
        holding: held points, rows and springs.
        axial_stiffness: EA [N]. bending_stiffness: EI of every span [N m^2], stiffened by jaws,
            shape (n - 3,).
        rest: constant coordinate of planar motion [m] in its component, zero in the others, shape
            (3,).
        origin: of the cable's coordinates in the world [m], shape (3,) (`geometry.origin_of`). All
            positions in the arrays are relative to it.
    """

    shape: Table
    values: Array
    sizes: Mapping[str, int]
    counts: Counts
    knots: Array
    rule: quadrature.Quadrature
    axes: tuple[int, ...]
    twist: bool
    holding: Holding
    axial_stiffness: float
    bending_stiffness: Array
    rest: Array
    origin: Array

    @property
    def n(self) -> int:
        """Number of control points."""
        return int(self.shape[layout.N])

    @property
    def lines(self) -> int:
        """Number of lines: the spatial ones, and the twist line if there is one."""
        return int(self.shape[layout.LINES])

    def has(self, bit: int) -> bool:
        """Whether the term with this bit is active."""
        return bool(self.shape[layout.TERMS] & bit)

    def new(self, name: str) -> Array:
        """A new array `inputs`, `state` or `scratch` of zeros."""
        return aligned_zeros(self.sizes[name])

    def view(self, array: Array, offset: int) -> Array:
        """View of the lines at an offset of state or scratch, without margins, shape (lines, n)."""
        return line_view(self.shape, array, int(self.shape[offset]), self.lines)

    def rows(self, array: Array, offset: int, count: int) -> Array:
        """View of rows at an offset of an array, shape (count, LANES)."""
        at = self.shape[offset]
        return array[at : at + count * LANES].reshape(count, LANES)

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
                f"set terms.out_of_plane or terms.twist to on"
            )
        return columns

    def band(self, offset: int, line: int) -> Array:
        """A symmetric matrix of one line (MASS, VISCOUS, TWIST), lower diagonals, shape (4, n)."""
        at = int(self.shape[offset])
        if offset != layout.TWIST and line >= len(self.axes):
            at += 7 * int(self.shape[layout.LINE])
        seven = line_view(self.shape, self.values, at, 7)
        return np.stack([seven[3 + k] for k in range(4)])

    @property
    def twisting_stiffness(self) -> Array:
        """Stiffness matrix of the twist line with its springs, lower diagonals, shape (4, n)."""
        return self.band(layout.TWIST, len(self.axes)) + self.holding.roll_stiffness(self.n)

    @property
    def sample_shares(self) -> Array:
        """Material coordinate / length of every quadrature point, shape (spans, samples)."""
        return self.rule.places(bspline.breaks(self.knots)) / self.knots[-1]

    @property
    def moment_weights(self) -> Array:
        """Bending stiffness times quadrature weight [N m^3], shape (spans, samples, 1)."""
        return np.asarray((self.bending_stiffness[:, None] * self.rule.weights)[..., None])

    @property
    def elastic_share(self) -> float:
        """Share of the bending stiffness with the natural curvature: 1, or with plasticity h."""
        if not self.has(layout.PLASTICITY):
            return 1.0
        ratio = self.rows(self.values, layout.SCALES, layout.SCALE_ROWS)[layout.HARDENING, 0]
        return float(ratio / (1.0 + ratio))

    def samples(self, state: Array, offset: int, rows: int) -> Array:
        """Rows of every quadrature point in a state, a copy of shape (spans, samples, rows)."""
        at, counts = int(self.shape[offset]), self.counts
        values = state[at : at + counts.blocks * counts.samples * rows * LANES]
        return from_blocks(values.copy(), len(self.rule.xi)).reshape(-1, counts.samples, rows)

    def put_samples(self, state: Array, offset: int, values: Array) -> None:
        """Write the rows of every quadrature point, shape (spans, samples, rows)."""
        at, flat = int(self.shape[offset]), to_blocks(values.reshape(len(values), -1))
        state[at : at + flat.size] = flat

    def held_mask(self) -> NDArray[np.bool_]:
        """Mask of the line entries held by rows at single control points, shape (lines, n)."""
        mask = np.zeros((self.lines, self.n), dtype=bool)
        for row in self.holding.rows:
            if row.line >= 0 and self.holding.points[row.point].own >= 0:
                mask[row.line, self.holding.points[row.point].own] = True
        return mask
