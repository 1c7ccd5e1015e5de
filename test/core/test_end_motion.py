"""End motions: values, derivatives, rest outside, and what is refused."""

import numpy as np
import pytest

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion


@pytest.fixture
def motion():
    return EndMotion(
        start=2.0,
        duration=0.5,
        position=[[1.0, 2.0, 3.0], [0.4, 0.0, -1.0], [0.1, 2.0, 0.0]],
        orientation=rotations.from_rotation_vector([0.3, 0.0, 0.1]),
        rotation=[[0.0, 1.0, 0.5], [2.0, 0.0, 0.0]],
    )


def test_position_is_the_parabola(motion):
    s = 0.2
    expected = [1 + 0.4 * s + 0.1 * s * s, 2 + 2 * s * s, 3 - s]
    assert np.allclose(motion.position_at(2.2), expected, atol=1e-14)


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


def test_orientation_turns_in_the_world_frame(motion):
    expected = rotations.multiply(
        rotations.from_rotation_vector([0.08, 0.2, 0.1]), motion.orientation
    )
    assert np.allclose(motion.orientation_at(2.2), expected)


def test_evaluates_many_times_at_once(motion):
    t = np.linspace(1.9, 2.7, 7)
    assert np.array_equal(motion.position_at(t), [motion.position_at(x) for x in t])
    assert np.array_equal(motion.orientation_at(t), [motion.orientation_at(x) for x in t])


def test_resting():
    rest = EndMotion.resting([1, 2, 3], start=5.0)
    assert np.array_equal(rest.position_at(7.0), [1, 2, 3])
    assert np.array_equal(rest.orientation_at(7.0), [0, 0, 0, 1])
    assert not rest.velocity_at([5.0, 7.0]).any()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"position": np.zeros((2, 3))}, r"position: needs finite numbers of shape \(3, 3\)"),
        ({"rotation": np.zeros(3)}, r"rotation: needs finite numbers of shape \(2, 3\)"),
        ({"orientation": [0, 0, 0, 0.9]}, "norm 0.9"),
        ({"orientation": [np.nan, 0, 0, 1]}, "orientation: needs 4 finite"),
        ({"position": np.full((3, 3), np.inf)}, "position: needs finite"),
        ({"start": np.nan}, "start: needs a finite"),
        ({"duration": -0.1}, "negative"),
    ],
)
def test_refuses(change, text):
    values = {
        "start": 0.0,
        "duration": 1.0,
        "position": np.zeros((3, 3)),
        "orientation": [0, 0, 0, 1],
        "rotation": np.zeros((2, 3)),
    }
    with pytest.raises(ValueError, match=text):
        EndMotion(**(values | change))


def test_cannot_be_changed_behind_its_back():
    position = np.zeros((3, 3))
    motion = EndMotion(0.0, 1.0, position, [0, 0, 0, 1], np.zeros((2, 3)))
    position[0, 0] = 9.0
    assert motion.position[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        motion.position[0, 0] = 1.0


@pytest.mark.parametrize("now", [0.5, 1.3, 3.5])
def test_the_rest_of_a_motion_is_at_the_same_places_and_ends_alike(now):
    turned = [[0.3, -0.2, 0.5], [0.4, 0.1, -0.3]]
    position = [[1.0, 2.0, 3.0], [0.1, -0.2, 0.3], [0.5, 0.4, -0.6]]
    motion = EndMotion(0.5, 2.0, position, [0, 0, 0.6, 0.8], turned)
    rest = motion.rest(now)
    assert rest.end == pytest.approx(max(motion.end - now, 0.0))
    for s in (0.0, 0.4, 1.1, 5.0):
        np.testing.assert_allclose(rest.position_at(s), motion.position_at(now + s), atol=1e-12)
    for s in (0.0, 5.0):
        found, expected = rest.orientation_at(s), motion.orientation_at(now + s)
        assert abs(found @ expected) == pytest.approx(1.0, abs=1e-12)
