"""End motions: values, derivatives, rest outside, and what is refused."""

import dataclasses

import numpy as np
import pytest

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion


@pytest.fixture
def motion():
    return EndMotion(
        start=2.0,
        duration=0.5,
        position=[1.0, 2.0, 3.0],
        orientation=rotations.from_rotation_vector([0.3, 0.0, 0.1]),
        velocity=[0.4, 0.0, -1.0],
        acceleration=[0.2, 4.0, 0.0],
        angular_velocity=[0.0, 1.0, 0.5],
        angular_acceleration=[4.0, 0.0, 0.0],
    )


def test_position_is_the_parabola(motion):
    s = 0.2
    expected = [1 + 0.4 * s + 0.1 * s * s, 2 + 2 * s * s, 3 - s]
    assert np.allclose(motion.position_at(2.2), expected, atol=1e-14)


def test_named_values_are_the_derivatives_at_the_start(motion):
    """The acceleration is that of the position, not half of it as in the coefficients."""
    h = 1e-4
    places = motion.position_at(motion.start + h * np.arange(3))
    change = (places[2] - 2.0 * places[1] + places[0]) / h**2
    assert np.allclose(motion.acceleration, change, rtol=0, atol=1e-6)
    assert np.allclose(motion.velocity_at(motion.start), motion.velocity, rtol=0, atol=1e-15)
    spins = motion.angular_velocity_at(motion.start + h * np.arange(3))
    assert np.allclose(motion.angular_velocity, spins[0], rtol=0, atol=1e-15)
    first, second = np.diff(spins, axis=0) / h
    assert np.allclose(motion.angular_acceleration, 1.5 * first - 0.5 * second, atol=1e-5)
    rows = motion.position_coefficients, motion.rotation_coefficients
    again = EndMotion.from_coefficients(2.0, 0.5, rows[0], motion.orientation, rows[1])
    for name in ("position", "velocity", "acceleration", "angular_velocity"):
        assert np.array_equal(getattr(again, name), getattr(motion, name)), name
    assert np.array_equal(again.angular_acceleration, motion.angular_acceleration)


def test_a_turn_about_one_axis_has_constant_angular_acceleration():
    axis = np.array([0.6, 0.0, 0.8])
    pose = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
    spins = {"angular_velocity": 0.5 * axis, "angular_acceleration": -2.0 * axis}
    motion = EndMotion(start=1.0, duration=2.0, **pose, **spins)
    t = np.array([1.0, 1.7, 3.0])
    expected = (0.5 - 2.0 * (t - 1.0))[:, None] * axis
    assert np.allclose(motion.angular_velocity_at(t), expected, rtol=0, atol=1e-14)


def test_the_next_motion_continues(motion):
    on = motion.then(0.3, acceleration=[0.0, 0.0, 1.0])
    assert (on.start, on.duration) == (motion.end, 0.3)
    for quantity in ("position_at", "velocity_at", "angular_velocity_at", "orientation_at"):
        before, after = (getattr(one, quantity)(2.5) for one in (motion, on))
        assert np.allclose(after, before, rtol=0, atol=1e-14), quantity
    stopped = motion.then(0.3, velocity=[0, 0, 0], angular_velocity=[0, 0, 0])
    assert np.array_equal(stopped.position_at(2.8), motion.position_at(2.5))
    assert np.array_equal(stopped.orientation_at(2.8), motion.orientation_at(2.5))


def test_rests_before_and_after(motion):
    assert np.array_equal(motion.position_at(1.0), [1, 2, 3])
    assert np.array_equal(motion.position_at(99.0), motion.position_at(motion.end))
    assert np.array_equal(motion.orientation_at(99.0), motion.orientation_at(2.5))
    outside = np.array([1.9, 2.6])
    assert not motion.velocity_at(outside).any()
    assert not motion.angular_velocity_at(outside).any()
    assert motion.velocity_at(2.5).any()  # the limit from inside


@pytest.mark.parametrize("t", [2.05, 2.3, 2.49])
def test_velocities_are_derivatives(motion, t):
    h = 1e-5
    slope = (motion.position_at(t + h) - motion.position_at(t - h)) / (2 * h)
    assert np.allclose(motion.velocity_at(t), slope, atol=1e-9)
    turned = rotations.multiply(
        motion.orientation_at(t + h), rotations.conjugate(motion.orientation_at(t - h))
    )
    assert np.allclose(
        motion.angular_velocity_at(t), rotations.to_rotation_vector(turned) / (2 * h), atol=1e-8
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"position": np.zeros((3, 3))}, r"position: needs 3 finite numbers \(m\)"),
        ({"angular_velocity": np.zeros(4)}, r"angular_velocity: needs 3 finite .* \(rad/s\)"),
        ({"orientation": [0, 0, 0, 0.9]}, "norm 0.9"),
        ({"position": [1e300, 0, 0]}, r"beyond 1e\+08 m"),
        ({"duration": -0.1}, "negative"),
    ],
)
def test_a_motion_that_cannot_be_is_refused(change, text):
    values = {"start": 0.0, "duration": 1.0, "position": np.zeros(3), "orientation": [0, 0, 0, 1]}
    with pytest.raises(ValueError, match=text):
        EndMotion(**(values | change))


def test_a_motion_cannot_be_changed_behind_its_back():
    given = {name: np.zeros(3) for name in ("position", "velocity", "acceleration")}
    motion = EndMotion(start=0.0, duration=1.0, orientation=[0, 0, 0, 1], **given)
    for name, value in given.items():
        value[0] = 9.0
        assert not getattr(motion, name).any()
        with pytest.raises(ValueError, match="read-only"):
            getattr(motion, name)[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.duration = 2.0
    later = dataclasses.replace(motion, start=4.0, velocity=[1.0, 0.0, 0.0])
    assert (later.start, later.position_at(5.0).tolist()) == (4.0, [1.0, 0.0, 0.0])
