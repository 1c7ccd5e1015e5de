"""The filter against what a Gaussian process says by hand."""

import numpy as np
import pytest

from dlo_sim.core.error_filter import ErrorFilter

U = np.linspace(0.0, 1.0, 9)


def made(held=(), **changes):
    given = {"error": 0.02, "length": 0.2, "time": 0.5, "noise": 0.005, **changes}
    return ErrorFilter(U, np.reshape(held, (-1, 9)), **given)


def test_one_point_after_a_long_silence():
    shift, speed = made().update(np.eye(9)[[4]], np.array([[0.0, 0.01, 0.0]]))
    gain = 0.02**2 / (0.02**2 + 0.005**2)
    assert shift[:, 1] == pytest.approx(0.01 * gain * np.exp(-12.5 * (U - 0.5) ** 2), rel=1e-5)
    assert not shift[:, [0, 2]].any() and not speed.any()


def test_what_is_held_stays():
    held = [np.eye(9)[0], 0.5 * np.eye(9)[7] + 0.5 * np.eye(9)[8]]
    shift, _ = made(held).update(np.eye(9)[[4]], np.array([[0.01, 0.0, 0.0]]))
    assert shift[0] == pytest.approx(0.0, abs=1e-12)
    assert shift[7] + shift[8] == pytest.approx(0.0, abs=1e-12)
    assert shift[4, 0] > 0.008


def test_a_growing_distance_moves_the_velocity_and_silence_forgets():
    seen, by = np.eye(9)[[4]], made()
    for _ in range(20):
        by.advance(0.01)
        shift, speed = by.update(seen, np.array([[0.001, 0.0, 0.0]]))
    assert shift[4, 0] < 0.5e-3  # many points in a short time: each counts for less
    assert speed[4, 0] > 1e-3
    by.advance(100.0)
    long_after = by.update(seen, np.array([[0.001, 0.0, 0.0]]))
    first = made().update(seen, np.array([[0.001, 0.0, 0.0]]))
    assert long_after[0] == pytest.approx(first[0], rel=1e-9)
    assert np.abs(long_after[1]).max() < 1e-12


def test_many_points_count_as_their_mean():
    """A thousand noisy points of one place as one with a thousandth of the variance."""
    seen = np.zeros((1, 9))
    seen[0, 4] = 1.0
    many, one = made(), made(noise=0.005 / np.sqrt(1000.0))
    several = many.update(np.repeat(seen, 1000, axis=0), np.full((1000, 3), 0.01))
    single = one.update(seen, np.full((1, 3), 0.01))
    for a, b in zip(several, single, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-15)


def test_gains_stay_what_they_are_however_many_updates():
    u = np.linspace(0.0, 0.8, 13)
    filter_ = ErrorFilter(u, np.eye(13)[:2], 0.02, 0.08, 0.25, 0.005)
    gains = []
    for _ in range(400):
        filter_.advance(0.03)
        gains.append(filter_.update(np.eye(13), np.full((13, 3), 1e-3))[0])
    np.testing.assert_allclose(gains[40], gains[-1], rtol=1e-9, atol=1e-12)
