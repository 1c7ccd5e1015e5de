"""Held points and constraint rows in the arrays of a model (`engine.rows`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def held_values(model: Model) -> Array:
    """Basis values b of the held points, shape (points, n)."""
    values = [point.values(model.n) for point in model.holding.points]
    return np.reshape(values, (-1, model.n))


def fill_rows(model: Model, values: Array, shifts: Array) -> None:
    """Write held points and constraint rows to the arrays of a model.

    Args:
        values: b of the points (`held_values`). shifts: M^-1 b, of the same shape.
    """
    holding, points, rows = model.holding, model.arrays.points, model.arrays.rows
    for p, point in enumerate(holding.points):
        points.first[p], points.own[p], points.twist[p] = point.first, point.own, point.twist
        points.other[p], points.other_weights[p] = point.other, point.other_weights
        points.weights[p] = point.weights
        points.sum[p] = sum(point.weights) if point.other < 0 else 0.0
    without_margins(points.shift, model.n)[:] = shifts
    points.product[:] = np.einsum("pn,qn->pq", values, shifts)
    rows.count = len(holding.rows)
    for k, row in enumerate([*holding.rows, *holding.springs]):
        rows.point[k], rows.grasp[k], rows.line[k] = row.point, row.grasp, row.line
        rows.body[k], rows.stiffness[k], rows.aims[k] = row.body, row.stiffness, row.aims
        rows.xi[k] = row.xi
