"""Sizes of the arrays of a cable (`engine.arrays`), and values by knot span as blocks of lanes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core.bspline import DEGREE
from dlo_sim.engine import arrays
from dlo_sim.engine.arrays import MARGIN, PADDING
from dlo_sim.simulation.holding import Holding

Array = NDArray[np.float64]
# Pairs of segments that touch each other, for every segment, and of spans, for every span.
PAIRS, NEAR = 12, 64
MOST_SKYLINE = 1 << 20  # entries of the factors with couplings between distant control points


def sizes_of(
    *,
    terms: int,
    dim: int,
    twist: bool,
    n: int,
    samples: int,
    holding: Holding,
    grasps: int,
    loads: int,
    obstacles: int,
    pieces: int,
    segments: int,
    field_values: int = 0,
    bodies: int = 0,
    strands: int = 1,
    rolls: tuple[int, int] = (0, 0),
    extras: int = 0,
    chain_joints: int = 0,
) -> dict[str, int]:
    """Sizes of all dimensions that `engine.arrays` names.

    Args:
        terms: bits of the active terms. pieces: groups of samples of a span that touch bodies, 0
            without obstacles. segments: of a span, that touch each other, or 0. field_values: of
            meshes that are obstacles. bodies: rigid ones. rolls: rows between twist angles and
            bodies, rigid ones and ones that give. extras: groups of samples beside the cable.
            chain_joints: of strands, near which they do not touch each other.
    """
    lines, unknowns = dim + twist, n * (dim + twist)
    spans = n - DEGREE
    blocks, columns = -(-spans // LANES), LANES * (-(-n // LANES) + 1)
    bishop, curved, plastic = (
        bool(terms & bit) for bit in (arrays.BISHOP, arrays.CURVED, arrays.PLASTICITY)
    )
    chain = bool(segments)
    between = sum(rolls) + holding.between
    bordered = holding.border + holding.joints + sum(rolls) + between
    pairs = PAIRS * segments * (n - DEGREE)
    return {
        "terms": terms,
        "dim": dim,
        "lines": lines,
        "n": n,
        "blocks": blocks,
        "samples": samples,
        "columns": columns,
        "points": len(holding.points),
        "rows": len(holding.rows) + len(holding.springs),
        "rigid": len(holding.rows),
        "border": holding.border,
        "springs": len(holding.springs),
        "joints": holding.joints,
        "slides": len(holding.slides),
        "bodies": bodies,
        "strands": strands,
        "kept_rows": holding.border + rolls[0],
        "bordered": bordered,
        "border_columns": LANES * -(-bordered // LANES),
        "rolls": sum(rolls),
        "rigid_rolls": rolls[0],
        "grasps": grasps,
        "loads": loads,
        "obstacles": obstacles,
        "groups": pieces * spans + extras,
        "field_values": field_values,
        "segments": segments,
        "corners": (segments + 1) * chain,
        "corner_rows": 3 * (segments + 1) * chain,
        "chain_blocks": blocks * chain,
        "chain_spans": LANES * blocks * chain,
        "chain_joints": chain_joints,
        "pairs": LANES * -(-pairs // LANES),
        "near_pairs": (n - DEGREE) * min(n - DEGREE, NEAR) * chain,
        "coupled": unknowns * chain,
        "skyline": min(unknowns * unknowns, MOST_SKYLINE) * chain,
        "seen": 4 * lines,
        "unknowns": unknowns,
        "pairings": lines * lines,
        "width": 16 if lines == 2 else 32,
        "padded": unknowns + 2 * PADDING,
        "bordered_padded": (unknowns + 2 * PADDING) * (bordered > 0),
        "twist_columns": columns * twist,
        "bishop_columns": columns * bishop,
        "bishop_lines": lines * bishop,
        "bishop_blocks": blocks * bishop,
        "curved_blocks": blocks * curved,
        "plastic_blocks": blocks * plastic,
    }


def without_margins(lines: Array, n: int) -> Array:
    """View of the columns of the control points of lines, shape (..., n)."""
    return lines[..., MARGIN : MARGIN + n]


def to_blocks(values: Array, beyond: float = 0.0) -> Array:
    """Values of every span, shape (spans, ...), as lanes of blocks, shape (blocks, ..., LANES).

    Args:
        beyond: value on the lanes beyond the last span.
    """
    blocks = -(-len(values) // LANES)
    padded = np.full((blocks * LANES, *values.shape[1:]), beyond)
    padded[: len(values)] = values
    by_lane = padded.reshape(blocks, LANES, *values.shape[1:])
    return np.ascontiguousarray(np.moveaxis(by_lane, 1, -1))


def resampled(
    groups: Array,
    pieces: tuple[int, int],
    counts: tuple[int, int],
    extras: tuple[int, int] = (0, 0),
) -> Array:
    """Values of samples, shape (groups, ..., LANES), with `pieces` groups of a span, of each of two
    sets, for `counts` groups of a span: each is that of the nearest sample, or 0 where there was
    none. Those of the `extras` between the two stay if their number does, else they are 0.
    """
    before, now = extras
    if pieces == counts and before == now:
        return groups
    inner, spans = groups.shape[1:-1], (len(groups) - before) // sum(pieces)
    parts: list[Array] = []
    at = 0
    for few, count in zip(pieces, counts, strict=True):
        if parts:
            kept = groups[at : at + before]
            parts.append(kept if before == now else np.zeros((now, *kept.shape[1:])))
            at += before
        by_span = groups[at : at + spans * few].reshape(spans, few, *inner, LANES)
        by_span = np.moveaxis(by_span, -1, 2).reshape(spans, few * LANES, *inner)
        at += spans * few
        nearest = ((np.arange(count * LANES) + 0.5) * (few / max(count, 1))).astype(int)
        values = by_span[:, nearest] if few else np.zeros((spans, count * LANES, *inner))
        parts.append(np.moveaxis(values.reshape(-1, LANES, *inner), 1, -1))
    return np.concatenate(parts)


def from_blocks(blocks: Array, spans: int) -> Array:
    """The inverse of `to_blocks`; returns a copy."""
    by_lane = np.moveaxis(np.array(blocks), -1, 1)
    return by_lane.reshape(-1, *by_lane.shape[2:])[:spans]
