"""Largest frequencies: dense against Lanczos, against formulas, with prescribed DOFs."""

import numpy as np
import pytest

from dlo_sim.core import bspline, mass, spectrum

MU = 0.3


def axial_bar(n, dim, rigidity):
    """Stiffness (row-stored) and masses of `dim` uncoupled bars of unit length."""
    knots = bspline.clamped_knots(n, 1.0)
    half = 4 * dim - 1
    band = np.zeros((n * dim, 2 * half + 1))
    for d in range(dim):
        full = rigidity[d] * mass.dense(mass.gram(knots, 1))
        for i in range(n):
            for j in range(max(0, i - 3), min(n, i + 4)):
                band[i * dim + d, (j - i) * dim + half] = full[i, j]
    bands = np.stack([MU * mass.gram(knots)] * dim)
    return band, bands


def expected(n, free, rigidity):
    """By numpy's general eigenvalues of M^-1 K."""
    knots = bspline.clamped_knots(n, 1.0)
    index = np.flatnonzero(free)
    full = mass.dense(mass.gram(knots, 1))[np.ix_(index, index)]
    inertia = MU * mass.dense(mass.gram(knots))[np.ix_(index, index)]
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, rigidity * full)).real.max())


def test_dense_restores_the_rows():
    band, _ = axial_bar(6, 2, (1.0, 5.0))
    full = spectrum.dense(band)
    assert full.shape == (12, 12)
    assert np.allclose(full, full.T)
    assert np.allclose(full[1::2, 1::2], 5.0 * full[::2, ::2])
    assert not full[::2, 1::2].any()


@pytest.mark.parametrize("n", [4, 9, 20])
def test_largest_of_several_rows_with_held_ends(n):
    band, bands = axial_bar(n, 3, (1.0, 50.0, 3.0))
    free = np.ones((3, n), dtype=bool)
    free[1, 0] = free[1, -1] = free[2, 1] = False
    found = spectrum.largest_frequency(band, bands, free)
    assert found == pytest.approx(expected(n, free[1], 50.0), rel=1e-9)
    assert found > spectrum.largest_frequency(band, bands, free & np.eye(3, 1, -2, dtype=bool))


def test_nothing_free_has_no_frequency():
    band, bands = axial_bar(5, 1, (1.0,))
    assert spectrum.largest_frequency(band, bands, np.zeros((1, 5), dtype=bool)) == 0.0


def test_lanczos_agrees_with_the_dense_solution():
    """n = 260: 780 unknowns, beyond the dense limit; the rows are uncoupled, so each is checked."""
    n = 260
    assert 3 * n > spectrum.DENSE_LIMIT
    band, bands = axial_bar(n, 3, (1.0, 50.0, 3.0))
    free = np.ones((3, n), dtype=bool)
    free[:, 0] = False
    found = spectrum.largest_frequency(band, bands, free)
    exact = expected(n, free[1], 50.0)
    assert found == pytest.approx(exact, rel=1e-6)
    assert found <= exact * (1 + 1e-12)
