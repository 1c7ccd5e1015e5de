"""Rotations in plain numbers against those of arrays."""

import math

import numpy as np
import pytest

from dlo_sim.core import one_rotation as one
from dlo_sim.core import rotations


def random_quaternions(count):
    q = np.random.default_rng(count).normal(size=(count, 4))
    return (q / np.linalg.norm(q, axis=1, keepdims=True)).tolist()


@pytest.mark.parametrize("angle", [0.0, 1e-9, 5e-5, 2e-4, 0.3, 3.0, math.pi])
def test_exponential_and_logarithm_undo_each_other_and_are_those_of_arrays(angle):
    axis = np.array([0.48, -0.6, 0.64])
    q = one.exponential(tuple(angle * axis))
    assert math.hypot(*q) == pytest.approx(1.0, abs=1e-15)
    assert np.allclose(q, rotations.from_rotation_vector([angle * axis])[0], rtol=0, atol=1e-16)
    back = one.logarithm(q)
    assert np.allclose(np.abs(back), np.abs(angle * axis), rtol=1e-14, atol=0)
    assert np.allclose(back, rotations.to_rotation_vector([q])[0], rtol=1e-14, atol=0)


def test_the_shorter_way_is_taken():
    x, y, z, w = one.exponential((0.1, 0.2, -0.3))
    assert np.allclose(one.logarithm((-x, -y, -z, -w)), (0.1, 0.2, -0.3), rtol=1e-14)


def test_turn_between_is_the_logarithm_of_the_way():
    for start, end in zip(random_quaternions(9), random_quaternions(10)[1:], strict=True):
        way = rotations.multiply(end, rotations.conjugate(start))
        expected = rotations.to_rotation_vector(way[None])[0]
        assert np.allclose(one.turn_between(start, end), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("size", [1e-6, 5e-3, 0.02, 1.0, 3.0, 6.0])
def test_angular_velocity_is_the_derivative_of_the_rotation(size):
    """Against central differences of R(t), R' = [omega x] R."""
    w, rate, h = size * np.array([0.6, 0.0, 0.8]), np.array([0.3, -0.5, 0.2]), 1e-6
    before, now, after = (
        rotations.to_matrix(one.exponential(tuple(w + s * h * rate))) for s in (-1, 0, 1)
    )
    spin = (after - before) / (2 * h) @ now.T
    omega = one.angular_velocity(tuple(w), tuple(rate))
    assert np.allclose([spin[2, 1], spin[0, 2], spin[1, 0]], omega, rtol=0.0, atol=1e-9)


def test_a_quaternion_becomes_a_unit_one_or_is_refused():
    assert np.allclose(one.normalized((0.0, 3.0, 0.0, -4.0)), (0.0, 0.6, 0.0, -0.8), rtol=1e-15)
    for nonsense in ((0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)):
        with pytest.raises(ValueError, match="zero or not finite"):
            one.normalized(nonsense)
