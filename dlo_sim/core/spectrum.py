"""Natural frequencies of a linearised cable, and the step that an explicit method may take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass

Array = NDArray[np.float64]
DENSE_LIMIT = 700  # free DOFs up to which a dense solution is instant


def largest_frequency(
    stiffness: Array, mass_bands: Array, free: NDArray[np.bool_], *, iterations: int = 120
) -> float:
    """Largest natural frequency omega [rad/s] of K x = omega^2 M x on the free DOFs.

    Args:
        stiffness: row-stored band matrix of the spatial DOFs as `kernels.matrix` keeps it,
            shape (n dim, 2 K + 1).
        mass_bands: lower diagonals of the mass of every spatial row, shape (dim, 4, n).
        free: which DOFs move, shape (dim, n).

    Up to `DENSE_LIMIT` free DOFs by a dense eigenvalue solution, beyond by Lanczos iteration, whose
    estimate is from below and converges first at this end of the spectrum.
    """
    dim, n = free.shape
    moving = np.flatnonzero(free.T.ravel())
    if moving.size == 0:
        return 0.0
    if moving.size > DENSE_LIMIT:
        value = _lanczos(stiffness, mass_bands, free, iterations)
    else:
        full = dense(stiffness)[np.ix_(moving, moving)]
        inertia = np.zeros((n * dim, n * dim))
        for d in range(dim):
            inertia[d::dim, d::dim] = mass.dense(mass_bands[d])
        inertia = inertia[np.ix_(moving, moving)]
        factor = np.linalg.inv(np.linalg.cholesky(inertia))
        value = float(np.linalg.eigvalsh(factor @ full @ factor.T).max())
    return float(np.sqrt(max(value, 0.0)))


def dense(stiffness: Array) -> Array:
    """Row-stored band matrix as a full matrix, shape (size, size)."""
    size, columns = stiffness.shape
    half = (columns - 1) // 2  # a row may be filled up by a last zero
    full = np.zeros((size, size))
    for r in range(size):
        low, high = max(0, r - half), min(size, r + half + 1)
        full[r, low:high] = stiffness[r, low - r + half : high - r + half]
    return full


def _lanczos(stiffness: Array, bands: Array, free: NDArray[np.bool_], iterations: int) -> float:
    """Largest eigenvalue of M^-1 K by Lanczos in the M inner product, reorthogonalised."""
    dim, n = free.shape
    inverses = []
    for d in range(dim):
        inverse = np.zeros((n, n))
        inverse[np.ix_(free[d], free[d])] = np.linalg.inv(
            mass.dense(bands[d])[np.ix_(free[d], free[d])]
        )
        inverses.append(inverse)
    half = (stiffness.shape[1] - 1) // 2
    stiffness = stiffness[:, : 2 * half + 1]
    mask = free.T.ravel().astype(float)

    def apply(x: Array) -> Array:
        padded = np.concatenate((np.zeros(half), x * mask, np.zeros(half)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
        return np.einsum("rc,rc->r", stiffness, windows) * mask

    def weigh(x: Array) -> Array:
        return np.stack([mass.multiply(bands[d], x[d::dim]) for d in range(dim)], 1).ravel() * mask

    def solve(x: Array) -> Array:
        return np.stack([inverses[d] @ x[d::dim] for d in range(dim)], 1).ravel()

    x = np.random.default_rng(0).standard_normal(mask.size) * mask
    basis: list[Array] = []
    images: list[Array] = []
    diagonal: list[float] = []
    beside: list[float] = []
    image = weigh(x)
    norm = float(np.sqrt(x @ image))
    for _ in range(min(iterations, int(mask.sum()))):
        x, image = x / norm, image / norm
        basis.append(x)
        images.append(image)
        y = solve(apply(x))
        diagonal.append(float(y @ image))
        for old, old_image in zip(basis, images, strict=True):
            y = y - (y @ old_image) * old
        image = weigh(y)
        norm = float(np.sqrt(max(float(y @ image), 0.0)))
        if norm < 1e-12 * abs(diagonal[-1]):
            break
        beside.append(norm)
        x = y
    off = beside[: len(diagonal) - 1]
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)).max())
