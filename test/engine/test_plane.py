"""Planar scenes compute with two coordinates: same energies, forces, stiffness as in space."""

import numpy as np
import pytest
from cables import SOFT, Bench, wild

# Normal of the plane -> a direction in it. Both right-handed and left-handed pairs of axes occur.
PLANES = {0: [0.0, 0.8, 0.6], 1: [0.8, 0.0, 0.6], 2: [0.6, 0.8, 0.0]}


def values(normal):
    """A scene that is kept in a plane, with every term that a plane admits."""
    along = np.array(PLANES[normal])
    axis = np.eye(3)[normal]
    across = np.cross(axis, along)
    return SOFT | {
        "terms.out_of_plane": "off",
        "end.position": list(along),
        "end.spring": [0.0 if d == normal else 20.0 + d for d in range(3)],
        "gravity": list(-9.81 * across),
        "cable.rest_curvature": [0.5, -1.0, 2.0],
        "cable.rest_curvature_axis": list(axis),
        "loads.tip.position": 0.7,
        "loads.tip.signal": "constant",
        "loads.tip.force": list(0.4 * across - 0.3 * along),
        "loads.tip.torque": list(0.05 * axis),
    }


def in_plane(bench, normal, seed=0):
    points = wild(bench, seed)
    points[:, :3] = np.outer(bench.greville, PLANES[normal])
    points[:, :3] += 0.03 * np.random.default_rng(seed).normal(size=(bench.n, 3))
    points[:, normal] = points[:, 3] = 0.0
    return points


@pytest.fixture(scope="module", params=PLANES)
def pair(request):
    """The planar bench, the same scene in space, and the plane's normal."""
    scene = values(request.param)
    return Bench(scene, n=12), Bench(scene, {"terms.out_of_plane": "on"}, n=12), request.param


def test_energies_and_forces_equal_those_in_space(pair):
    planar, spatial, normal = pair
    points = in_plane(planar, normal)
    found, expected = planar.potentials(points), spatial.potentials(points)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert np.count_nonzero(list(expected.values())) == 4
    force = spatial.force(points)
    assert np.abs(force[:, normal]).max() < 1e-12
    assert np.abs(planar.force(points) - force).max() < 1e-12 * np.abs(force).max()


def test_stiffness_equals_that_in_space(pair):
    planar, spatial, normal = pair
    points = in_plane(planar, normal)
    full = spatial.stiffness(points).reshape(12, 3, 12, 3)
    axes = list(planar.axes)
    expected = full[:, axes][:, :, :, axes].reshape(24, 24)
    assert np.abs(planar.stiffness(points) - expected).max() < 1e-12 * np.abs(expected).max()
