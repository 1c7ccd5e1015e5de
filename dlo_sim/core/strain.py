"""How far a cubic spline is stretched and bent along its length."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline

Array = NDArray[np.float64]

_KEPT = 16  # splines and places whose matrices are kept
_GAUSS_POINTS = 3  # of a span, for its mean stretch


class Strain:
    """Stretch and curvature of the splines on these knots [m], at material coordinates u [m]."""

    def __init__(self, knots: Array, u: Array) -> None:
        spline = np.eye(len(knots) - bspline.ACTIVE)
        self._slope = bspline.evaluate(spline, knots, u, 1)
        self._bend = bspline.evaluate(spline, knots, u, 2)
        ends = bspline.breaks(knots)
        xi, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
        inside = middle[:, None] + half[:, None] * xi
        self._sampled = bspline.evaluate(spline, knots, inside.ravel(), 1)
        self._weights = 0.5 * weights
        tent = [np.interp(u, middle, row) for row in np.eye(len(middle))]
        self._between = np.array(tent)

    def stretch(self, points: Array) -> Array:
        """|r'| - 1, shape (..., len(u)): the mean of each knot span, linear between their middles.

        Inside a span the stretch of a cable that is much stiffer in tension than in bending swings
        about its mean, which alone is accurate.

        Args:
            points: control points [m], shape (..., n, 3).
        """
        lengths = np.linalg.norm(self._sampled @ points, axis=-1)
        means = lengths.reshape(*lengths.shape[:-1], -1, _GAUSS_POINTS) @ self._weights
        return np.asarray((means - 1.0) @ self._between)

    def curvature(self, points: Array) -> Array:
        """|r' x r''| / |r'|^3 [1/m], shape (..., len(u)), of control points (..., n, 3)."""
        slope = self._slope @ points
        across = np.linalg.norm(np.cross(slope, self._bend @ points), axis=-1)
        return np.asarray(across / np.linalg.norm(slope, axis=-1) ** 3)


def strain(knots: Array, u: Array) -> Strain:
    """The same, kept for the next call with these knots and places."""
    return _strain(knots.tobytes(), u.tobytes())


@lru_cache(_KEPT)
def _strain(knots: bytes, u: bytes) -> Strain:
    return Strain(np.frombuffer(knots), np.frombuffer(u))
