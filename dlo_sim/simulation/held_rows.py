"""Held points and constraint rows in the arrays of a model (`engine.rows`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def fill_rows(model: Model) -> None:
    """Write held points and constraint rows to the arrays of a model: basis values b of the points,
    M^-1 b, and their products.
    """
    each = [point.values(model.n) for point in model.holding.points]
    values = np.reshape(each, (-1, model.n))
    shifts = np.empty_like(values)
    for twist in range(1 + model.twist):
        of_kind = [point.twist == twist for point in model.holding.points]
        shifts[of_kind] = model.mass_solutions(values[of_kind], twist)
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
