"""What is drawn of the obstacles of a run."""

import numpy as np
import pytest
from test_contact_added import LYING

from dlo_sim import Obstacle
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.obstacles import surface
from dlo_sim.simulation.recording import record


def test_a_recording_has_the_obstacles_and_where_they_press():
    table = {"obstacles.names": ["table", "box"], "obstacles.table.position": [0.0, 0.0, -0.004]}
    table |= {"obstacles.box.shape": "box", "obstacles.box.position": [0.0, 0.5, 0.0]}
    scene = scene_from_values(LYING | table | {"accuracy.estimate": "off"})
    found = record(scene, 0.5, 0.01).obstacles
    triangles, poses = found["obstacle_triangles"], found["obstacle_poses"]
    assert poses.shape == (51, 2, 7)
    np.testing.assert_array_equal(poses[[0, 50], 0, 2], -0.004)
    number = found["obstacle_of"]
    assert (np.sum(number == 0.0), np.sum(number == 1.0)) == (2, 12)
    plate = triangles[number == 0.0].reshape(-1, 3)  # of the plane below the cable
    assert np.ptp(plate[:, 0]) > 0.3 and plate[:, 0].mean() == pytest.approx(0.15, abs=0.01)
    last = found["contact_samples"] == 50.0
    weight = scene.cable.mu * 0.3 * 9.81
    total = found["contact_forces"][last].sum(axis=0)
    np.testing.assert_allclose(total, [0.0, 0.0, weight], atol=1e-3 * weight)
    np.testing.assert_allclose(found["contact_points"][last][:, 2], -0.001, atol=1e-4)


def test_nothing_is_drawn_without_obstacles():
    assert (
        record(scene_from_values(LYING | {"accuracy.estimate": "off"}), 0.05, 0.01).obstacles == {}
    )


@pytest.mark.parametrize(
    ("shape", "size", "volume"),
    [
        ("box", (1.0, 2.0, 3.0), 6.0),
        ("sphere", (2.0, 2.0, 2.0), 4.0 / 3.0 * np.pi),
        ("cylinder", (2.0, 2.0, 3.0), 3.0 * np.pi),
        ("capsule", (2.0, 2.0, 4.0), (2.0 + 4.0 / 3.0) * np.pi),
    ],
)
def test_surfaces_enclose_their_obstacles(shape, size, volume):
    a, b, c = np.moveaxis(surface(Obstacle("a", shape, size)), 1, 0)
    assert np.sum(a * np.cross(b, c)) / 6.0 == pytest.approx(volume, rel=0.03)
    np.testing.assert_allclose(np.ptp(np.concatenate([a, b, c]), axis=0), size, rtol=0.02)
