"""Natural frequencies of a linearised cable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass

Array = NDArray[np.float64]


def dense(stiffness: Array, half: int) -> Array:
    """Row-stored band matrix, with entry (r, c) at [r, c - r + half], as a full matrix."""
    size = len(stiffness)
    full = np.zeros((size, size))
    for r in range(size):
        low, high = max(0, r - half), min(size, r + half + 1)
        full[r, low:high] = stiffness[r, low - r + half : high - r + half]
    return full


def largest_of_dense(stiffness: Array, inertia: Array, rows: Array) -> float:
    """Largest omega [rad/s] of K x = omega^2 M x among motions with rows x = 0.

    K (`stiffness`) is symmetric, M (`inertia`) positive definite; rows (m, size) of zeros do not
    count.
    """
    size = len(stiffness)
    rows = rows[np.abs(rows).max(axis=1, initial=0.0) > 0.0]
    basis = np.eye(size)
    if len(rows):
        _, values, vt = np.linalg.svd(rows)
        basis = vt[int((values > 1e-12 * values[0]).sum()) :].T
    if basis.shape[1] == 0:
        return 0.0
    factor = np.linalg.inv(np.linalg.cholesky(basis.T @ inertia @ basis))
    value = np.linalg.eigvalsh(factor @ (basis.T @ stiffness @ basis) @ factor.T).max()
    return float(np.sqrt(max(value, 0.0)))


def largest_of_line(stiffness: Array, inertia: Array, free: NDArray[np.bool_]) -> float:
    """The same for one line of control points; both matrices as lower diagonals, shape (4, n)."""
    rows = np.eye(len(free))[~free]
    return largest_of_dense(mass.dense(stiffness), mass.dense(inertia), rows)
