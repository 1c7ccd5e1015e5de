"""Smoothing of poses: what passes unchanged, what is taken out, and what is waited for."""

import numpy as np
import pytest

from dlo_sim.core import one_rotation, rotations
from dlo_sim.session.gripper_path import Pose, SmoothedPoses, weights_of_the_value_at_zero
from dlo_sim.session.time_base import SECOND

MS = 1_000_000
DT = 33 * MS
END = 10**19  # ns


def pose(stamp_ns, position=(0, 0, 0), turn=(0, 0, 0)):
    orientation = one_rotation.exponential(turn)
    return Pose(stamp_ns, tuple(map(float, position)), orientation)


def smoothed(poses, half=140 * MS):
    return handed_over(SmoothedPoses(half, SECOND), poses)


def handed_over(waiting, poses):
    """What comes out, if each pose is taken as soon as it is ready, and all at the end."""
    out = []
    for p in poses:
        waiting.add(p)
        out += waiting.due(END)
    waiting.settle()
    return out + list(waiting.due(END))


def test_parabolas_pass_unchanged_even_with_uneven_stamps():
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.integers(15 * MS, 50 * MS, size=60))
    t = times * 1e-9
    position = np.stack([1 + 0.3 * t - 0.2 * t * t, 0.5 * t, 0 * t], axis=1)
    poses = [pose(int(s), p, (0, 0.1 * x, 0)) for s, p, x in zip(times, position, t, strict=True)]
    out = smoothed(poses)
    assert [p.stamp_ns for p in out] == times.tolist()
    assert np.allclose([p.position for p in out], position, atol=1e-9)
    assert np.allclose([p.orientation for p in out], [p.orientation for p in poses], atol=1e-9)


@pytest.mark.parametrize("count", [4, 9, 30])
def test_weights_are_those_of_least_squares(count):
    t = np.sort(np.random.default_rng(count).uniform(-0.99, 0.99, size=count))
    y = np.random.default_rng(count + 1).normal(size=count)
    expected = np.polyfit(t, y, 2, w=np.sqrt(1 - t * t))[2]
    assert np.dot(weights_of_the_value_at_zero(t.tolist()), y) == pytest.approx(expected, abs=1e-11)


def test_white_noise_hardly_accelerates_any_more():
    """9 poses to a parabola: the noise of the second difference falls by a factor of nine."""
    rng = np.random.default_rng(2)
    noise = 1e-3 * rng.normal(size=(400, 3))
    out = smoothed([pose(k * DT, p) for k, p in enumerate(noise)])
    before = np.diff(noise, 2, axis=0)[10:-10].std()
    after = np.diff([p.position for p in out], 2, axis=0)[10:-10].std()
    assert before == pytest.approx(1e-3 * np.sqrt(6), rel=0.1)
    assert after < before / 8


def test_rotation_noise_too():
    rng = np.random.default_rng(3)
    noise = 1e-2 * rng.normal(size=(200, 3))
    out = smoothed([pose(k * DT, turn=[0, 1.5, 0] + w) for k, w in enumerate(noise)])
    middle = rotations.from_rotation_vector([0, 1.5, 0])
    away = [
        rotations.to_rotation_vector(rotations.multiply(p.orientation, rotations.conjugate(middle)))
        for p in out[10:-10]
    ]
    assert np.std(away) < 0.6e-2
    assert np.allclose(np.linalg.norm([p.orientation for p in out], axis=1), 1.0)


def test_a_pose_is_released_when_one_beyond_its_window_has_come():
    waiting = SmoothedPoses(100 * MS, SECOND)
    for k in range(4):
        waiting.add(pose(k * DT))
        assert waiting.next_change_ns() is None  # up to 99 ms
    waiting.add(pose(4 * DT))
    (first,) = waiting.due(END)
    assert first.stamp_ns == 0
    waiting.settle()
    assert [p.stamp_ns for p in waiting.due(END)] == [DT, 2 * DT, 3 * DT, 4 * DT]
    assert waiting.next_change_ns() is None


def test_poses_that_change_places_within_a_window_are_smoothed_in_order():
    rng = np.random.default_rng(6)
    poses = [pose(k * DT, rng.normal(size=3)) for k in range(60)]
    order = sorted(range(60), key=lambda k: k + rng.uniform(-2, 2))
    assert order != sorted(order)
    waiting, out = SmoothedPoses(140 * MS, SECOND), []
    for k in order:
        waiting.add(poses[k])
        out += waiting.due((k - 8) * DT)  # the latency: a window of 4 poses, and as much disorder
    waiting.settle()
    assert out + list(waiting.due(END)) == smoothed(poses)
    assert len(out) > 45


def test_windows_do_not_reach_across_a_silence():
    before = [pose(k * DT, (0, 0, 0)) for k in range(10)]
    after = [pose(2 * SECOND + k * DT, (1, 0, 0)) for k in range(10)]
    out = smoothed(before + after, half=3 * SECOND)
    assert [p.position[0] for p in out] == pytest.approx([0] * 10 + [1] * 10, abs=1e-12)
