"""Where an inextensible cable keeps its length: constraints on its control points.

Constraint j is g = (sum_d x_d^T A x_d - 1) / 2 = (|r'|^2 - 1) / 2, at an end or as a mean over a
knot span, quadratic in its four control points with a constant A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, quadrature

Array = NDArray[np.float64]
GAUSS_POINTS = 3


def constraint_slopes(knots: Array) -> Array:
    """Points of every constraint: four basis derivatives [1/m] and a weight, shape (n - 1, 3, 5).

    Constraint 0 is at u = 0, the last at u = L, those between are means over a knot span by three
    Gauss points (exact: |r'|^2 is of fourth degree).
    """
    ends = bspline.breaks(knots)
    lengths = np.diff(ends)
    rule = quadrature.gauss(ends, GAUSS_POINTS)
    u = rule.places(ends)
    result = np.zeros((len(lengths) + 2, GAUSS_POINTS, 5))
    _, slopes = bspline.active_basis(knots, u.ravel(), 1)
    result[1:-1, :, :4] = slopes.reshape(*u.shape, 4)
    result[1:-1, :, 4] = rule.weights / lengths[:, None]
    _, outer = bspline.active_basis(knots, ends[[0, -1]], 1)
    # Exact zeros at the ends, where only two control points count.
    outer[np.abs(outer) < 1e-9 * np.abs(outer).max()] = 0.0
    for row, slope in zip((0, -1), outer, strict=True):
        result[row, :, :4] = slope
        result[row, 0, 4] = 1.0
    return result


def constraint_gram(knots: Array) -> Array:
    """A of |r'|^2 = sum_d x_d^T A x_d over four control points of every constraint [1/m^2], shape
    (n - 1, 4, 4).
    """
    points = constraint_slopes(knots)
    return np.einsum("jqk,jqm,jq->jkm", points[..., :4], points[..., :4], points[..., 4])
