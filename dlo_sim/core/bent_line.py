"""The line of a cable that nothing but its natural shape bends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations

Array = NDArray[np.float64]
PARTS = 30  # of equal length, in the middle of which each turns


def bent_line(
    frame: Array, shape: Sequence[Sequence[float] | Array], length: float, u: Array
) -> Array:
    """Points [m] at material coordinates u [m] of a cable that begins at the origin, shape
    (len(u), 3), by midpoints.

    Args:
        frame: material frame at the start as columns (3, 3): tangent, axis of the first curvature,
            axis of the second one.
        shape: first and second curvature [1/m] and twist [rad/m], each as values that are evenly
            spaced along the cable, linear between them (`Cable.natural_shape`).
        length: of the cable [m].
    """
    step, middles = length / PARTS, (np.arange(PARTS) + 0.5) / PARTS
    first, second, twist = (
        step * np.interp(middles, np.linspace(0.0, 1.0, len(one)), np.asarray(one)) for one in shape
    )
    turns = np.stack([twist, first, second], axis=1)
    line = np.zeros((PARTS + 1, 3))
    for k, half in enumerate(rotations.to_matrix(rotations.from_rotation_vector(0.5 * turns))):
        frame = frame @ half
        line[k + 1] = line[k] + step * frame[:, 0]
        frame = frame @ half
    grid = np.linspace(0.0, length, PARTS + 1)
    return np.stack([np.interp(u, grid, column) for column in line.T], axis=1)
