"""Predicted against measured reactions: signs, lags and numbers made by hand."""

import math

import numpy as np
import pytest

from dlo_sim.replay.comparison import compare_reaction

TIMES = np.arange(0.0, 5.0, 0.005)
AT = np.arange(0.0, 5.0, 1 / 30)


def force(t):
    return np.stack([np.sin(4.0 * t), np.zeros_like(t), 5.0 + 0.5 * np.cos(7.0 * t)], axis=1)


def test_the_negative_of_the_prediction_is_a_perfect_measurement():
    x, y, z = compare_reaction(TIMES, force(TIMES), AT, -force(AT))
    assert (x.axis, y.axis, z.axis) == ("x", "y", "z")
    assert x.samples == len(AT) == 150
    assert x.correlation == pytest.approx(1.0, abs=1e-6)
    assert x.rms_error == pytest.approx(0.0, abs=1e-4)
    assert x.rms_measured == pytest.approx(math.sqrt(0.5), rel=0.02)
    assert math.isnan(y.correlation)
    assert math.isnan(y.lag)
    assert z.rms_measured == pytest.approx(math.sqrt(25 + 0.125), rel=0.01)
    assert z.spread_measured == pytest.approx(0.5 * math.sqrt(0.5), rel=0.02)


def test_the_opposite_sign_is_anticorrelated():
    (x, _, z) = compare_reaction(TIMES, force(TIMES), AT, force(AT))
    assert x.correlation == pytest.approx(-1.0, abs=1e-6)
    assert z.bias == pytest.approx(10.0, abs=0.05)
    (x, _, z) = compare_reaction(TIMES, force(TIMES), AT, force(AT), sign=1.0)
    assert x.correlation == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("lag", [-0.1, -0.02, 0.0, 0.05, 0.15])
def test_the_lag_of_a_measurement_is_found(lag):
    """Positive = the measurement comes later than predicted."""
    x, _, z = compare_reaction(TIMES, force(TIMES), AT, -force(AT - lag))
    assert x.lag == pytest.approx(lag, abs=1.5e-3)
    assert z.lag == pytest.approx(lag, abs=1.5e-3)
    assert x.lag_correlation == pytest.approx(1.0, abs=1e-4)
    assert x.lag_rms_error < 5e-3
    if lag:
        assert x.correlation < x.lag_correlation


def test_bias_and_rms_by_hand():
    measured = -force(AT) + np.array([0.3, 0.0, 0.0])
    x, _, _ = compare_reaction(TIMES, force(TIMES), AT, measured)
    assert x.bias == pytest.approx(0.3, abs=1e-4)  # predicted 0, -measured -0.3
    assert x.rms_error == pytest.approx(0.3, abs=1e-4)
    assert x.correlation == pytest.approx(1.0, abs=1e-6)


def test_no_overlap_is_an_error():
    with pytest.raises(ValueError, match=r"prediction \(0.000 to 4.995 s\).*do not overlap"):
        compare_reaction(TIMES, force(TIMES), AT + 1000.0, force(AT))
    with pytest.raises(ValueError, match="too few"):
        compare_reaction(TIMES[:1], force(TIMES[:1]), AT, force(AT))
