"""Material frames: rotation-minimising transport and the turn by the twist angle."""

import numpy as np
import pytest
from numba import void

from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, STRIDED, STRIDED_WHOLES, kernel
from dlo_sim.core import rotations
from dlo_sim.engine.frames import transport


@kernel(void, ARRAY_2D, STRIDED_WHOLES, STRIDED, STRIDED, ARRAY, ARRAY_2D)
def transported(points, columns, values, slopes, reference, out):
    transport(points, columns, values, slopes, reference, out)


def frames(points, tangents, angles=None, reference=(0.0, 0.0, 1.0)):
    """Frames at samples given by themselves: the first of the four active points of a sample is its
    place and angle, the second its tangent."""
    count = len(points)
    table = np.zeros((2 * count, 4))
    table[:count, :3], table[count:, :3] = points, tangents
    if angles is not None:
        table[:count, 3] = angles
    columns = np.zeros((count, 4), dtype=np.int64)
    columns[:, 0], columns[:, 1] = np.arange(count), count + np.arange(count)
    values, slopes = np.zeros((count, 4)), np.zeros((count, 4))
    values[:, 0] = slopes[:, 1] = 1.0
    out = np.zeros((count, 7))
    transported(table, columns, values, slopes, np.array(reference, float), out)
    assert np.array_equal(out[:, :3], points)
    return out[:, 3:]


def helix(count, radius=0.3, pitch=0.5, turns=1.5):
    """Points and tangents of a helix about z, its arc length, torsion and angle."""
    angle = np.linspace(0.0, 2 * np.pi * turns, count)
    rise = pitch / (2 * np.pi)
    points = np.stack((radius * np.cos(angle), radius * np.sin(angle), rise * angle), axis=1)
    tangents = np.stack((-radius * np.sin(angle), radius * np.cos(angle), 0 * angle + rise), axis=1)
    speed = np.hypot(radius, rise)
    return points, tangents, angle * speed, rise / speed**2, angle


def test_x_axis_is_the_tangent_and_quaternions_are_unit():
    points, tangents, *_ = helix(40)
    found = frames(points, 3.7 * tangents, np.linspace(0, 5, 40))
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)
    x = rotations.to_matrix(found)[:, :, 0]
    unit = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    assert np.allclose(x, unit, atol=1e-13)


def test_second_axis_starts_at_the_reference_made_normal_to_the_tangent():
    points, tangents, *_ = helix(10)
    found = rotations.to_matrix(frames(points, tangents, reference=(0.3, 0.2, 0.9)))[0]
    unit = tangents[0] / np.linalg.norm(tangents[0])
    expected = np.array([0.3, 0.2, 0.9]) - unit * (unit @ [0.3, 0.2, 0.9])
    assert np.allclose(found[:, 1], expected / np.linalg.norm(expected), atol=1e-14)


def test_transport_along_a_helix_turns_against_its_torsion_to_fourth_order():
    """The frame lags behind the principal normal by the angle of the torsion, integral tau ds."""
    errors = []
    for count in (21, 41, 81, 161):
        points, tangents, length, torsion, angle = helix(count)
        normal = np.stack((-np.cos(angle), -np.sin(angle), 0 * angle), axis=1)
        found = rotations.to_matrix(frames(points, tangents, reference=normal[0]))[:, :, 1]
        unit = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
        across = np.sum(found * np.cross(unit, normal), axis=1)
        lag = np.arctan2(across, np.sum(found * normal, axis=1)) + torsion * length
        errors.append(np.abs(np.angle(np.exp(1j * lag))).max())
    assert np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 4.0).max() < 0.1
    assert errors[0] < 2e-5  # [rad], of a lag of some 4 rad


def test_twist_turns_about_the_tangent_from_the_first_frame_on():
    points = np.outer(np.arange(4.0), [0, 1, 0])
    tangents = np.tile([0.0, 2.0, 0.0], (4, 1))
    angles = np.array([0.7, 0.7, 1.7, 0.7 + np.pi])
    found = rotations.to_matrix(frames(points, tangents, angles))
    for matrix, turn in zip(found, angles - 0.7, strict=True):
        # about +y by `turn`: z goes towards x
        assert np.allclose(matrix[:, 1], [np.sin(turn), 0, np.cos(turn)], atol=1e-13)


def test_every_orientation_is_represented():
    """Tangents all over the sphere reach all branches of the matrix-to-quaternion formula."""
    rng = np.random.default_rng(0)
    for tangent in [*rng.normal(size=(200, 3)), *np.eye(3), *-np.eye(3)]:
        found = frames(np.zeros((1, 3)), tangent[None], reference=(0.3, -0.5, 0.8))[0]
        matrix = rotations.to_matrix(found)
        assert np.allclose(matrix[:, 0], tangent / np.linalg.norm(tangent), atol=1e-14)
        assert np.linalg.det(matrix) == pytest.approx(1.0)
