"""What the state of a cable holds at its samples, span by span."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline
from dlo_sim.simulation.arrays import from_blocks, to_blocks
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def sample_coordinates(model: Model) -> Array:
    """Material coordinate of every sample as a share of the length, shape (spans, samples)."""
    ends = bspline.breaks(model.knots)
    u = ends[:-1, None] + 0.5 * (model.rule.xi + 1.0) * np.diff(ends)[:, None]
    return np.asarray(u / ends[-1])


def put_by_sample(cable: Cable, offset: int, values: Array) -> None:
    """Write rows of every sample, shape (spans, samples, rows)."""
    at, flat = int(cable.model.shape[offset]), to_blocks(values.reshape(len(values), -1))
    cable.state[at : at + flat.size] = flat


def by_sample(cable: Cable, offset: int, rows: int) -> Array:
    """Rows of every sample, a copy of shape (spans, samples, rows)."""
    at, counts = int(cable.model.shape[offset]), cable.model.counts
    values = cable.state[at : at + counts.blocks * counts.samples * rows * LANES]
    spans = from_blocks(values, counts.n - bspline.DEGREE)
    return spans.reshape(-1, counts.samples, rows)


def moment_weights(model: Model) -> Array:
    """Bending stiffness times quadrature weight [N m^3], shape (spans, samples, 1)."""
    return np.asarray((model.bending_stiffness[:, None] * model.rule.weights)[..., None])
