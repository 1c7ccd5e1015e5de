"""Twist against the Frenet torsion, in plain numpy: the oracle for `engine.torsion`.

With t = r', k = r'', c = r''' and C = t x k the torsion of a curve is gamma = C.c / |C|^2 (Khalifa
& Palli, eq. 6), 0/0 where the curve is straight. Regularised with a curvature floor delta [1/m]:

    gamma = C.c / (|C|^2 + delta^2),       U = GJ/2 integral (theta' - gamma)^2 du.

For a cable of unit stretch |C| is the curvature, so gamma is the torsion times
kappa^2 / (kappa^2 + delta^2). On a cubic spline c is constant on every knot span and jumps between
them; on a knot the value of the span to the right counts.
"""

from __future__ import annotations

import numpy as np
from elasticity import samples
from numpy.typing import NDArray

from dlo_sim.core import bspline, quadrature

Array = NDArray[np.float64]


def torsion(control_points: Array, knots: Array, u: Array, floor: float) -> Array:
    """Regularised torsion gamma [1/m] at material coordinates u [m], shape (m,)."""
    t, k, c = (bspline.evaluate(control_points[:, :3], knots, u, d) for d in (1, 2, 3))
    binormal = np.cross(t, k)
    return np.asarray((binormal * c).sum(1) / ((binormal**2).sum(1) + floor**2))


def undefined(control_points: Array, knots: Array, u: Array, floor: float) -> NDArray[np.bool_]:
    """Where |C| is below the floor [1/m], so that torsion is suppressed by more than half, (m,)."""
    t, k = (bspline.evaluate(control_points[:, :3], knots, u, d) for d in (1, 2))
    return np.asarray((np.cross(t, k) ** 2).sum(1) < floor**2)


def energy(
    control_points: Array, knots: Array, rule: quadrature.Quadrature, GJ: float, floor: float
) -> float:
    """Twisting energy [J] of control points (x, y, z [m], theta [rad]), shape (n, 4)."""
    u, weights = samples(rule, knots)
    rate = bspline.evaluate(control_points, knots, u, 1)[:, 3]
    strain = rate - torsion(control_points, knots, u, floor)
    return float(0.5 * GJ * (weights * strain**2).sum())


def gradient(
    control_points: Array, knots: Array, rule: quadrature.Quadrature, GJ: float, floor: float
) -> Array:
    """dU/dq [N, N m], shape (n, 4): the exact gradient of `energy`.

    With D = |C|^2 + delta^2, d gamma = (C.dc + (c - 2 gamma C).dC) / D and dC = dt x k + t x dk.
    """
    u, weights = samples(rule, knots)
    first, slopes = bspline.active_basis(knots, u, 1)
    _, curls = bspline.active_basis(knots, u, 2)
    _, thirds = bspline.active_basis(knots, u, 3)
    result = np.zeros_like(control_points, dtype=float)
    for i in range(len(u)):
        active = slice(first[i], first[i] + bspline.ACTIVE)
        t = slopes[i] @ control_points[active, :3]
        k = curls[i] @ control_points[active, :3]
        c = thirds[i] @ control_points[active, :3]
        binormal = np.cross(t, k)
        size = binormal @ binormal + floor**2
        gamma = binormal @ c / size
        torque = weights[i] * GJ * (slopes[i] @ control_points[active, 3] - gamma)
        across = (c - 2.0 * gamma * binormal) / size
        result[active, :3] -= torque * np.outer(slopes[i], np.cross(k, across))
        result[active, :3] -= torque * np.outer(curls[i], np.cross(across, t))
        result[active, :3] -= torque * np.outer(thirds[i], binormal / size)
        result[active, 3] += torque * slopes[i]
    return result
