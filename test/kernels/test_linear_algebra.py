"""Band solvers against dense algebra."""

import numpy as np
import pytest

from dlo_sim.core import bspline, mass
from dlo_sim.kernels.banded import solve_rows
from dlo_sim.kernels.jit import entry
from dlo_sim.kernels.matrix import eliminate, substitute


@entry
def solve_band(band, size, half, x):
    """Factorise and solve in place, as the implicit step does; false for a vanishing pivot."""
    if not eliminate(band, size, half):
        return False
    substitute(band, size, half, x)
    return True


@pytest.mark.parametrize("held", [(), (0,), (0, 1), (0, 1, -1)])
@pytest.mark.parametrize("n", [4, 5, 11, 20])
def test_mass_rows_are_solved_and_prescribed_entries_become_zero(n, held):
    rng = np.random.default_rng(n)
    width = n + 7
    factors, expected = [], np.zeros((3, width))
    x = rng.normal(size=(3, width))
    for d in range(3):
        prescribed = np.zeros(n, dtype=bool)
        prescribed[list(held)] = d < 2  # the third row is free everywhere
        band = (1.0 + d) * mass.gram(bspline.clamped_knots(n, 1.0))
        band[0, -1] += 0.3
        factors.append(mass.factorize(band, prescribed))
        free = ~prescribed
        matrix = mass.dense(band)[np.ix_(free, free)]
        expected[d, :n][free] = np.linalg.solve(matrix, x[d, :n][free])
    found = x.copy()
    lower, inverse = (np.stack(parts) for parts in zip(*factors, strict=True))
    solve_rows(lower, inverse, n, found)
    scale = np.abs(expected).max()
    assert np.abs(found[:, :n] - expected[:, :n]).max() < 1e-12 * scale
    assert np.array_equal(found[:, n:], x[:, n:])  # padding is left alone


@pytest.mark.parametrize(("size", "half"), [(12, 11), (27, 11), (60, 11), (24, 7)])
def test_unsymmetric_band_is_solved(size, half):
    rng = np.random.default_rng(size)
    full = np.zeros((size, size))
    band = np.zeros((size, 2 * half + 2))
    for r in range(size):
        for c in range(max(0, r - half), min(size, r + half + 1)):
            full[r, c] = rng.normal() + (3.0 * half if r == c else 0.0)
            band[r, c - r + half] = full[r, c]
    right = rng.normal(size=size)
    x = right.copy()
    assert solve_band(band, size, half, x)
    assert np.allclose(x, np.linalg.solve(full, right), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("pivot", [0.0, np.nan, np.inf])
def test_a_matrix_without_pivot_is_noticed(pivot):
    band = np.zeros((12, 23))
    band[:, 11] = 1.0
    band[5, 11] = pivot
    assert not solve_band(band, 12, 11, np.ones(12))
