"""Covariances against those known in closed form."""

import numpy as np
import pytest
from simulated_cables import TRUTH, recorded

from dlo_sim.identification.fit import covariance

ONE_PIECE = np.zeros(400, dtype=np.int64)
ONES = np.ones((400, 1, 1))
NOTHING = np.zeros((0, 1))  # is expected


def test_correlated_errors_count_once():
    """A mean of 400 frames: white noise, and noise that lasts ten frames."""
    rng = np.random.default_rng(5)
    white = rng.normal(0.0, 0.05, (400, 1))
    slow = np.repeat(white[:40], 10, axis=0)
    alone = covariance(white, ONES, ONE_PIECE, [], NOTHING)
    together = covariance(slow, ONES, ONE_PIECE, [], NOTHING)
    assert np.sqrt(alone[0, 0]) == pytest.approx(0.05 / 20.0, rel=0.1)
    assert np.sqrt(together[0, 0]) == pytest.approx(0.05 / np.sqrt(40.0), rel=0.35)


def test_noise_of_the_starts_counts_once_for_every_piece():
    """A start that shifts all frames of its piece shifts the mean: by c, by c / 2 each of two."""
    still = np.zeros((400, 1))
    shifts = [np.full((400, 1), sign * 0.1) for sign in (-1.0, 1.0, 1.0, -1.0)]
    two = np.repeat([0, 1], 200)
    assert covariance(still, ONES, ONE_PIECE, shifts, NOTHING)[0, 0] == pytest.approx(0.1**2)
    assert covariance(still, ONES, two, shifts, NOTHING)[0, 0] == pytest.approx(2.0 * 0.05**2)
    # Expected as strongly as measured: half the effect.
    strong = np.array([[np.sqrt(float(ONES.sum()))]])
    assert covariance(still, ONES, ONE_PIECE, shifts, strong)[0, 0] == pytest.approx(0.05**2)


def test_starts_are_disturbed_by_the_noise_of_the_markers():
    recording = recorded(TRUTH, duration=0.5, noise=1e-3)
    rng = np.random.default_rng(7)
    draws = [recording.disturbed(rng).markers - recording.markers for _ in range(20)]
    assert np.std([draw[:2] for draw in draws]) == pytest.approx(1e-3, rel=0.15)
    assert not np.any([draw[2:] for draw in draws])
