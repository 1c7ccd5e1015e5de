"""One step of an explicit method on a damped oscillator, as a matrix: stability without a cable.

The oscillator is x'' = -omega^2 x - decay x'. With the step as unit of time the state is (x, x'),
and for Zhai's two-step method (x, x', x''_before). A method is stable where the spectral radius of
this matrix is at most 1; a cable is stable where all its modes are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core.methods import RUNGE_KUTTA, SPLITTING, ZHAI, Method

Array = NDArray[np.float64]


def amplification(method: Method, omega: ArrayLike, decay: float = 0.0) -> Array:
    """Matrix of one step of an explicit method, shape omega.shape + (2, 2), or (3, 3) for Zhai's.

    Args:
        omega, decay: omega tau [-], of any shape, and decay tau [-].

    Raises:
        ValueError: for an implicit method, which has no limit.
    """
    omega = np.asarray(omega, dtype=float)
    if method.family == SPLITTING:
        return _splitting(method, omega, decay)
    if method.family == RUNGE_KUTTA:
        return _runge_kutta(method, omega, decay)
    if method.family == ZHAI:
        return _zhai(omega, decay)
    raise ValueError(f"{method.name} is implicit: any step is stable on an oscillator")


def _matrix(*rows: tuple[ArrayLike, ...]) -> Array:
    """Matrices from entries of any common shape."""
    shape = np.broadcast_shapes(*(np.shape(entry) for row in rows for entry in row))
    wide = [[np.broadcast_to(entry, shape) for entry in row] for row in rows]
    return np.stack([np.stack(row, axis=-1) for row in wide], axis=-2)


def _splitting(method: Method, omega: Array, decay: float) -> Array:
    half = np.diag([1.0, np.exp(-0.5 * decay)])
    step = half
    for drift, kick in zip(method.drift_weights, method.kick_weights, strict=True):
        step = np.array([[1.0, drift], [0.0, 1.0]]) @ step
        step = _matrix((1.0, 0.0), (-kick * omega * omega, 1.0)) @ step
    return np.asarray(half @ step)


def _runge_kutta(method: Method, omega: Array, decay: float) -> Array:
    system = _matrix((0.0, 1.0), (-omega * omega, -decay))
    slopes: list[Array] = []
    for row in method.stage_matrix:
        stage = np.eye(2)
        for weight, slope in zip(row, slopes, strict=True):
            stage = stage + weight * slope
        slopes.append(system @ stage)
    step = np.eye(2)
    for weight, slope in zip(method.stage_weights, slopes, strict=True):
        step = step + weight * slope
    return step


def _zhai(omega: Array, decay: float) -> Array:
    stiffness = omega * omega
    return _matrix(
        (1.0 - stiffness, 1.0 - decay, -0.5),
        (-1.5 * stiffness, 1.0 - 1.5 * decay, -0.5),
        (-stiffness, -decay, 0.0),
    )


def spectral_radius(matrix: Array) -> float:
    """Largest magnitude of the eigenvalues, over all matrices of a stack."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())
