"""The linear system of an implicit step against dense algebra."""

import numpy as np
import pytest
from cables import BENT, CLAMPED, NATURAL, SOFT, TWISTED, Bench, solve_held
from cables import FREE as FREE_ENDS

from dlo_sim.core import spectrum

FREE = BENT | FREE_ENDS | {"start.pose_topic": ""}
SCENES = {
    "free, spatial": FREE,
    "pinned": BENT | {"start.clamped": False},
    "planar clamp": SOFT,
    "two clamps": CLAMPED | NATURAL | TWISTED,
}


def system(bench, seed=0):
    """A random unsymmetric matrix in the band of the cable, and the same dense."""
    rng, lines = np.random.default_rng(seed), bench.model.lines
    half, band = 4 * lines - 1, bench.cable.band
    band[:] = 0.0
    size = len(band)
    for r in range(size):
        for c in range(size):
            if abs(r // lines - c // lines) <= 3:
                band[r, c - r + half] = rng.normal() + (3.0 * half if r == c else 0.0)
    return spectrum.dense(band, half)


def kept(bench):
    """Orthonormal basis of the motions that leave what is held at rest, (n lines, free)."""
    if not bench.model.holding.rows:
        return np.eye(bench.n * bench.model.lines)
    rows, _ = bench.held(0.0)
    return np.linalg.svd(rows)[2][len(rows) :].T


@pytest.mark.parametrize("transposed", [False, True], ids=["", "transposed"])
@pytest.mark.parametrize("n", [4, 5, 11, 20])
@pytest.mark.parametrize("scene", SCENES)
def test_system_is_solved_with_what_is_held_kept(scene, n, transposed):
    """Z^T K Z y = Z^T r with the columns of Z that span what is free."""
    bench = Bench(SCENES[scene], n=n)
    full = system(bench)
    full = full.T if transposed else full
    right = np.random.default_rng(n).normal(size=len(full))
    x = right.copy()
    assert solve_held(bench.cable, x, transposed) == 0
    basis = kept(bench)
    expected = basis @ np.linalg.solve(basis.T @ full @ basis, basis.T @ right)
    assert np.abs(x - expected).max() < 1e-12 * np.abs(expected).max()


def test_negative_pivots_are_the_negative_eigenvalues():
    bench = Bench(FREE, n=7)
    full = system(bench)
    full = 0.5 * (full + full.T)
    full -= np.diag([55.0, 0.0, 0.0, 0.0] * 7)
    band, half = bench.cable.band, 15
    for r in range(len(full)):
        low, high = max(0, r - half), min(len(full), r + half + 1)
        band[r, low - r + half : high - r + half] = full[r, low:high]
    negative = int((np.linalg.eigvalsh(full) < 0.0).sum())
    assert 0 < negative < len(full)
    assert solve_held(bench.cable, np.ones(len(full))) == negative


@pytest.mark.parametrize("pivot", [0.0, np.nan, np.inf])
def test_a_matrix_without_pivot_is_noticed(pivot):
    bench = Bench(FREE, n=4)
    band = bench.cable.band
    band[:] = 0.0
    band[:, 15] = 1.0
    band[5, 15] = pivot
    assert solve_held(bench.cable, np.ones(16)) == -1
