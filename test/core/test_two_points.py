"""Poses from two measured points: midway, along them, without roll."""

import numpy as np
import pytest

from dlo_sim.core import rotations
from dlo_sim.core.one_rotation import aligned
from dlo_sim.core.two_points import X_AXIS, poses_of_two_points

IDENTITY = rotations.IDENTITY


def axes(poses):
    return rotations.to_matrix(poses[:, 3:])


def test_another_direction_of_the_end_effector_can_point_along_them():
    points = np.random.default_rng(6).normal(size=(3, 2, 3))
    poses = poses_of_two_points(points, IDENTITY, body=(0.0, 0.6, 0.8))
    apart = points[:, 1] - points[:, 0]
    along = rotations.rotate(poses[:, 3:], np.tile([0.0, 0.6, 0.8], (3, 1)))
    assert np.cross(along, apart) == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    assert np.all(np.sum(along * apart, axis=1) > 0.0)


def test_the_end_effector_does_not_roll():
    """On a cone the turn of the frame about its own axis is the solid angle that it encloses."""
    phase, tilt = np.linspace(0.0, 2.0 * np.pi, 4001), 0.3
    tip = np.stack(
        [
            np.full_like(phase, np.cos(tilt)),
            np.sin(tilt) * np.cos(phase),
            np.sin(tilt) * np.sin(phase),
        ],
        axis=1,
    )
    poses = poses_of_two_points(np.stack([-tip, tip], axis=1), IDENTITY)
    first, last = axes(poses)[[0, -1]]
    angle = np.arctan2(first[:, 2] @ last[:, 1], first[:, 1] @ last[:, 1])
    assert angle == pytest.approx(2.0 * np.pi * (1.0 - np.cos(tilt)), abs=1e-6)


@pytest.mark.parametrize("body", np.eye(3).tolist())
def test_half_a_turn_has_an_answer(body):
    turned = aligned(IDENTITY, tuple(body), tuple(-np.array(body)))
    assert rotations.rotate(turned, body) == pytest.approx(-np.array(body), abs=1e-15)
    assert np.linalg.norm(turned) == pytest.approx(1.0, abs=1e-15)
    assert X_AXIS == (1.0, 0.0, 0.0)
