"""Tension and curvature along a cubic spline."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline

Array = NDArray[np.float64]

_KEPT = 16  # splines and places whose matrices are kept
_GAUSS_POINTS = 3  # of a span, for its mean tension


class Strain:
    """Tension and curvature of the splines on these knots [m], at material coordinates u [m]."""

    def __init__(self, knots: Array, u: Array) -> None:
        ends = bspline.breaks(knots)
        xi, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
        inside = (middle[:, None] + half[:, None] * xi).ravel()
        self._there, self._inside = _derivatives(knots, u), _derivatives(knots, inside)
        self._weights = 0.5 * weights
        # Linear between the middles of the spans.
        self._between = np.array([np.interp(u, middle, row) for row in np.eye(len(middle))])

    def tension(self, points: Array, EA: float, EI: float) -> Array:
        """Axial force EA (|r'| - 1) - EI kappa^2 [N], shape (..., len(u)), of a cable that is
        straight at rest: the derivative of the energy of stretching and bending along the tangent.
        It is the mean of each knot span, linear between their middles: inside a span the stretch of
        a cable that is much stiffer in tension than in bending swings about its mean.

        Args:
            points: control points [m], shape (..., n, 3).
            EA, EI: axial [N] and bending stiffness [N m^2].
        """
        slope, kappa = _slope_and_curvature(self._inside, points)
        force = EA * (np.linalg.norm(slope, axis=-1) - 1.0) - EI * kappa**2
        spans = force.shape[-1] // _GAUSS_POINTS
        means = force.reshape(*force.shape[:-1], spans, _GAUSS_POINTS) @ self._weights
        return np.asarray(means @ self._between)

    def curvature(self, points: Array) -> Array:
        """kappa = |r' x r''| / |r'|^3 [1/m], shape (..., len(u)), of control points (..., n, 3)."""
        return _slope_and_curvature(self._there, points)[1]


def _derivatives(knots: Array, u: Array) -> tuple[Array, Array]:
    """Matrices from control points to r' and r'' at u."""
    spline = np.eye(len(knots) - bspline.ACTIVE)
    return bspline.evaluate(spline, knots, u, 1), bspline.evaluate(spline, knots, u, 2)


def _slope_and_curvature(derivatives: tuple[Array, Array], points: Array) -> tuple[Array, Array]:
    slope, bend = (matrix @ points for matrix in derivatives)
    across = np.linalg.norm(np.cross(slope, bend), axis=-1)
    return slope, across / np.linalg.norm(slope, axis=-1) ** 3


def strain(knots: Array, u: Array) -> Strain:
    """The same, kept for the next call with these knots and places."""
    return _strain(knots.tobytes(), u.tobytes())


@lru_cache(_KEPT)
def _strain(knots: bytes, u: bytes) -> Strain:
    return Strain(np.frombuffer(knots), np.frombuffer(u))
