"""Largest frequencies against numpy, with rows that are held."""

import numpy as np
import pytest

from dlo_sim.core import bspline, mass, spectrum

MU = 0.3


def axial_bar(n, dim, rigidity):
    """Stiffness (row-stored) and mass of `dim` uncoupled bars of unit length."""
    knots = bspline.clamped_knots(n, 1.0)
    half = 4 * dim - 1
    band = np.zeros((n * dim, 2 * half + 1))
    for d in range(dim):
        full = rigidity[d] * mass.dense(mass.gram(knots, 1))
        for i in range(n):
            for j in range(max(0, i - 3), min(n, i + 4)):
                band[i * dim + d, (j - i) * dim + half] = full[i, j]
    return spectrum.dense(band, half), MU * np.kron(mass.dense(mass.gram(knots)), np.eye(dim))


def expected(n, free, rigidity):
    """By numpy's general eigenvalues of M^-1 K."""
    knots = bspline.clamped_knots(n, 1.0)
    index = np.flatnonzero(free)
    full = mass.dense(mass.gram(knots, 1))[np.ix_(index, index)]
    inertia = MU * mass.dense(mass.gram(knots))[np.ix_(index, index)]
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, rigidity * full)).real.max())


@pytest.mark.parametrize("n", [4, 9, 20])
def test_largest_of_several_lines_with_held_ends(n):
    stiffness, inertia = axial_bar(n, 3, (1.0, 50.0, 3.0))
    held = np.eye(3 * n)[[1, 3 * (n - 1) + 1, 5]]
    free = np.ones(n, dtype=bool)
    free[[0, -1]] = False
    found = spectrum.largest_of_dense(stiffness, inertia, held)
    assert found == pytest.approx(expected(n, free, 50.0), rel=1e-9)
    bands = [f * mass.gram(bspline.clamped_knots(n, 1.0), k) for f, k in ((50.0, 1), (MU, 0))]
    assert spectrum.largest_of_line(*bands, free) == pytest.approx(found, rel=1e-9)
    # a row may mix lines; a softer line held as well changes nothing
    mixed = np.vstack((held, held[0] + np.eye(3 * n)[0]))
    assert spectrum.largest_of_dense(stiffness, inertia, mixed) == pytest.approx(found, rel=1e-9)


def test_nothing_free_has_no_frequency():
    stiffness, inertia = axial_bar(5, 1, (1.0,))
    assert spectrum.largest_of_dense(stiffness, inertia, np.eye(5)) == 0.0
