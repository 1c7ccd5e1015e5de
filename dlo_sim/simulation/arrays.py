"""The four arrays of a cable, and the table of integers that locates their fields
(`engine.layout`).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine import layout
from dlo_sim.engine.border import border_rooms
from dlo_sim.engine.grasps import MOTION_SIZE
from dlo_sim.methods.explicit_layout import CONSTRAINT_ENTRIES, CONSTRAINTS, explicit_rooms
from dlo_sim.methods.implicit_layout import band_room, implicit_rooms

Array = NDArray[np.float64]
Table = NDArray[np.int64]


@dataclass(frozen=True)
class Counts:
    """Sizes of one cable, or of `stride` interleaved cables; terms: bits of the active terms."""

    terms: int
    dim: int
    lines: int
    n: int
    samples: int
    points: int
    held: int
    springs: int
    grasps: int
    loads: int
    planes: int
    border: int
    constraints: int
    stride: int = 1

    @property
    def parts(self) -> int:
        """Vectors that cover the control points of a line."""
        return -(-self.n * self.stride // LANES)

    @property
    def blocks(self) -> int:
        """Vectors that cover the knot spans."""
        return -(-(self.n - 3) * self.stride // LANES)

    @property
    def line(self) -> int:
        """Entries of a line with its margins, rounded up to whole vectors."""
        return LANES * (self.parts + -(-2 * layout.MARGIN * self.stride // LANES))

    @property
    def size(self) -> int:
        """Entries of all lines."""
        return self.line * self.lines


@functools.lru_cache
def rooms(counts: Counts) -> dict[str, dict[int, int]]:
    """Sizes of all fields: name of the array -> index of the field in `shape` -> size."""
    c = counts
    samples = c.blocks * c.samples * LANES
    curved, plastic, bishop = (
        bool(c.terms & bit) for bit in (layout.CURVED, layout.PLASTICITY, layout.BISHOP)
    )
    return {
        "model": {
            layout.MESH: c.blocks * (layout.HEAD + layout.SAMPLE * c.samples) * LANES,
            layout.MASS: 14 * c.line,
            layout.FACTORS: 14 * c.line,
            layout.WEIGHT: c.dim * c.line,
            layout.TWIST: 7 * c.line,
            layout.VISCOUS: 14 * c.line,
            layout.BETA: 3 * LANES,
            layout.DECAY: c.lines * LANES,
            layout.HELD_WEIGHTS: c.points * layout.POINT_ROWS * LANES,
            layout.HELD_SHIFT: c.points * c.line,
            layout.HELD_PRODUCT: c.points * c.points * LANES,
            layout.HELD_BODY: c.held * layout.DIRECTION_ROWS * LANES,
            layout.SPRING: c.springs * layout.SPRING_ROWS * LANES,
            layout.LOAD_BASIS: c.loads * c.line,
            layout.LOAD_POINT: c.loads * layout.LOAD_POINT_ROWS * LANES,
            layout.SCALES: layout.SCALE_ROWS * LANES,
            layout.PLANE: c.planes * layout.PLANE_ROWS * LANES,
            layout.FRAME_FACTORS: 8 * c.line * bishop,
            CONSTRAINTS: c.constraints * CONSTRAINT_ENTRIES,
        },
        "inputs": {
            layout.MOTION: c.grasps * MOTION_SIZE,
            layout.LOAD: c.loads * layout.LOAD_ROWS * LANES,
        },
        "state": {
            layout.X: c.size,
            layout.W: c.size,
            layout.HISTORY: 3 * c.size,
            layout.LOADED: c.size,
            layout.BOOKED: c.size,
            layout.DIRECTION: c.held * layout.DIRECTION_ROWS * LANES,
            layout.INVERSE: c.held * c.held * LANES,
            **dict.fromkeys((layout.PULL, layout.MOVED), c.held * LANES),
            **dict.fromkeys((layout.REACTION, layout.RATES_BEFORE), c.held * LANES),
            **dict.fromkeys((layout.ANCHOR, layout.ANCHOR_BOOKED), c.springs * LANES),
            layout.REFERENCE: c.size * bishop,
            layout.FRAME_TURN: c.grasps * LANES * bishop,
            layout.LEDGER: layout.LEDGER_ROWS * LANES,
            layout.NATURAL: samples * layout.NATURAL_ROWS * curved,
            layout.PLASTIC: samples * layout.PLASTIC_ROWS * plastic,
            layout.MATRIX: band_room(c.n, c.dim) if c.stride == 1 else 0,
        },
        "scratch": {
            layout.FORCE: c.size,
            layout.NEW_LOAD: c.size,
            layout.V0: c.size,
            layout.V1: c.size,
            layout.BEFORE: c.size,
            **dict.fromkeys((layout.RATES, layout.TARGETS), c.held * LANES),
            layout.AHEAD: c.held * layout.DIRECTION_ROWS * LANES,
            layout.SYSTEM: c.held * max(c.held, 1) * LANES,
            layout.FRAME_SPARE: (c.line + layout.COUPLING_ROWS * samples) * bishop,
            layout.NOTES: layout.NOTE_ROWS * LANES,
            **border_rooms(c.n * c.dim, 4 * c.dim, c.border),
            **implicit_rooms(c.n, c.dim, c.samples, c.held, c.size),
            **explicit_rooms(c.n, c.dim, c.held, c.size, c.constraints, c.stride),
        },
    }


def new_shape(
    counts: Counts, axes: tuple[int, ...], tables: Mapping[int, Sequence[tuple[int, ...]]]
) -> tuple[Table, dict[str, int]]:
    """The array `shape` (counts, offsets, then integer tables) and the sizes of the four arrays.

    Args:
        axes: world axis of each spatial line. tables: index in `shape` of a table's offset -> rows.
    """
    c = counts
    shape = np.zeros(layout.TABLES_START, dtype=np.int64)
    dimension = {
        layout.DIM: c.dim,
        layout.LINES: c.lines,
        layout.N: c.n,
        layout.STRIDE: c.stride,
        layout.LINE: c.line,
        layout.SIZE: c.size,
        layout.BLOCKS: c.blocks,
        layout.PARTS: c.parts,
        layout.SAMPLES: c.samples,
        layout.TERMS: c.terms,
        layout.POINTS: c.points,
        layout.HELD: c.held,
        layout.SPRINGS: c.springs,
        layout.GRASPS: c.grasps,
        layout.LOADS: c.loads,
        layout.BORDER: c.border,
        layout.PLANES: c.planes,
    }
    for index, value in dimension.items():
        shape[index] = value
    shape[layout.AXES : layout.AXES + c.dim] = axes
    sizes = {}
    for name, fields in rooms(counts).items():
        at = 0
        for index, size in fields.items():
            shape[index] = at
            at += size
        # padding: loading a whole vector at the end of the last line stays within the array
        sizes[name] = at + LANES
    flat: list[int] = []
    for index, rows in tables.items():
        shape[index] = layout.TABLES_START + len(flat)
        flat += [entry for row in rows for entry in row]
    return np.concatenate((shape, np.array(flat, dtype=np.int64))), sizes


def aligned_zeros(size: int) -> Array:
    """Zeros from a multiple of 64 bytes on, so that rows and the lines of eight cables straddle no
    cache lines. Copies need not be aligned.
    """
    room = np.zeros(size + LANES - 1)
    begin = -(room.ctypes.data // room.itemsize) % LANES
    return room[begin : begin + size]


def line_view(shape: Table, array: Array, at: int, count: int) -> Array:
    """View of the lines of one cable without margins, shape (count, n)."""
    width, n = shape[layout.LINE], shape[layout.N]
    lines = array[at : at + count * width].reshape(count, width)
    return lines[:, layout.MARGIN : layout.MARGIN + n]


def to_blocks(spans: Array) -> Array:
    """Values of every span, shape (spans, count), as vectors of spans; flat, padded with zeros."""
    blocks = np.zeros((-(-len(spans) // LANES), LANES, spans.shape[1]))
    blocks.reshape(-1, spans.shape[1])[: len(spans)] = spans
    return blocks.transpose(0, 2, 1).ravel()


def from_blocks(blocks: Array, spans: int) -> Array:
    """The inverse of `to_blocks`; returns a copy. Further axes, as of several cables, are kept."""
    vectors = blocks.reshape(-(-spans // LANES), -1, LANES, *blocks.shape[1:])
    return vectors.swapaxes(1, 2).reshape(-1, vectors.shape[1], *blocks.shape[1:])[:spans]
