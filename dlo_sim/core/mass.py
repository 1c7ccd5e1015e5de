"""Mass of the spline cable as symmetric band matrices.

A symmetric matrix of half bandwidth 3 is stored by its lower diagonals: band[k, j] = A[j + k, j].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, quadrature

Array = NDArray[np.float64]
HALF_BAND = bspline.DEGREE


def gram(knots: Array, derivative: int = 0, rule: quadrature.Quadrature | None = None) -> Array:
    """Gram matrix G_ij = integral b_i^(d) b_j^(d) du as lower diagonals, shape (4, n).

    Exact unless a quadrature rule is given (then it is that rule's sum). Unit m^(1 - 2 derivative).
    """
    n = len(knots) - bspline.DEGREE - 1
    n_spans = n - bspline.DEGREE
    rule = rule or quadrature.gauss(bspline.breaks(knots), 4)
    coefficients = bspline.span_polynomials(knots, derivative)
    powers = rule.xi[..., None] ** np.arange(coefficients.shape[-1])
    values = np.einsum("skp,smp->smk", coefficients, powers)
    blocks = np.einsum("smi,sm,smj->sij", values, rule.weights, values)
    band = np.zeros((HALF_BAND + 1, n))
    for i in range(bspline.ACTIVE):
        for j in range(i + 1):
            np.add.at(band[i - j], np.arange(n_spans) + j, blocks[:, i, j])
    return band


def lumped(band: Array) -> Array:
    """Row sums on the diagonal: same total mass, no coupling, order of accuracy lost."""
    result = np.zeros_like(band)
    result[0] = dense(band).sum(axis=1)
    return result


def dense(band: Array) -> Array:
    """Full symmetric matrix of a band, shape (n, n)."""
    n = band.shape[1]
    full = np.zeros((n, n))
    for k in range(band.shape[0]):
        rows = np.arange(n - k)
        full[rows + k, rows] = full[rows, rows + k] = band[k, : n - k]
    return full


def multiply(band: Array, x: Array) -> Array:
    """Band matrix times x, shape (n,) or (n, m)."""
    n = band.shape[1]
    scale = band.reshape(band.shape[0], n, *([1] * (x.ndim - 1)))
    result = scale[0] * x
    for k in range(1, band.shape[0]):
        result[k:] += scale[k, : n - k] * x[: n - k]
        result[: n - k] += scale[k, : n - k] * x[k:]
    return result


def factorize(band: Array, prescribed: NDArray[np.bool_]) -> tuple[Array, Array]:
    """LDL^T factors of the free part of a band matrix; prescribed rows become the identity.

    Args:
        band: lower diagonals, shape (4, n), positive definite on the free part.
        prescribed: shape (n,), true where the value is not solved for.

    Returns:
        Unit lower factor, shape (3, n): lower[k - 1, i] = L[i, i - k]; and 1 / D, shape (n,), zero
            on prescribed rows, so that a solve returns 0.
    """
    n = band.shape[1]
    lower = np.zeros((HALF_BAND, n))
    diagonal = np.zeros(n)
    for i in range(n):
        if prescribed[i]:
            diagonal[i] = np.inf
            continue
        for k in range(min(HALF_BAND, i), 0, -1):
            j = i - k
            if prescribed[j]:
                continue
            value = band[k, j]
            for m in range(k + 1, min(HALF_BAND, i) + 1):
                if not prescribed[i - m]:
                    value -= lower[m - 1, i] * diagonal[i - m] * lower[m - k - 1, j]
            lower[k - 1, i] = value / diagonal[j]
        value = band[0, i]
        for k in range(1, min(HALF_BAND, i) + 1):
            if not prescribed[i - k]:
                value -= lower[k - 1, i] ** 2 * diagonal[i - k]
        if not value > 0.0:
            raise ValueError(f"mass matrix is not positive definite at control point {i}")
        diagonal[i] = value
    return lower, 1.0 / diagonal
