"""What is drawn of the obstacles of a run."""

import numpy as np
import pytest
from cables import LYING

from dlo_sim import EndMotion, Obstacle, Plan, Simulator
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.obstacles import surface
from dlo_sim.simulation.recording import record


def test_a_recording_has_the_obstacles_and_where_they_press():
    table = {"obstacles.names": ["table", "box"], "obstacles.table.position": [0.0, 0.0, -0.004]}
    table |= {"obstacles.box.shape": "box", "obstacles.box.position": [0.0, 0.5, 0.0]}
    scene = scene_from_values(LYING | table | {"accuracy.estimate": "off"})
    recorded = record(scene, 0.5, 0.01)
    found = recorded.obstacles
    assert recorded.peak_tension == recorded.tension.max()
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


def test_a_forecast_knows_obstacles_that_move_and_those_that_came():
    """A ball that came later moves against the held cable, stops, and moves on; the table is of the
    scene.
    """

    def begun():
        held = {"start.fixed": [True] * 3, "contact.friction": 0.0, "terms.out_of_plane": "on"}
        table = {"obstacles.names": ["table"], "obstacles.table.position": [0.0, 0.0, -0.004]}
        sim = Simulator(scene_from_values(LYING | held | table))
        sim.add_obstacles([Obstacle("ball", "sphere", (0.04,) * 3, (0.2, 0.05, 0.0))])
        for start, duration, y, speed in ((0.0, 0.3, 0.05, -0.2), (0.4, 0.1, -0.01, -0.05)):
            rest = EndMotion.resting([0.2, y, 0.0], start=start)
            sim.move_obstacle("ball", rest.then(duration, velocity=[0.0, speed, 0.0]))
        sim.advance(0.1)
        return sim

    sim, driven, advanced = begun(), begun(), begun()
    times = np.array([0.0, 0.5])
    poses = {"start": np.tile(np.concatenate(sim.end_pose("start")), (2, 1))}
    found = sim.forecast(Plan(times, poses), 0.05)
    _, points = driven.follow(0.1 + times, poses, np.minimum(0.1 + found.times, 0.6))
    assert np.array_equal(found.control_points, points)
    assert points[-1, 5:, 1].max() < -0.01, "it was pushed aside"
    balls = found.obstacles["obstacle_poses"][:, 1, 1]
    np.testing.assert_allclose(balls[[0, 2, 5, 9]], [0.02, 0.0, -0.01, -0.015], atol=1e-12)
    for k, pose in enumerate(found.obstacles["obstacle_poses"][:, 1]):
        advanced.advance(0.05)
        np.testing.assert_allclose(pose[:3], advanced.end_pose("ball")[0], atol=1e-12)
        clearance = min(one.clearance for one in advanced.contacts.values())
        assert found.obstacles["contact_clearance"][k] == pytest.approx(clearance, abs=1e-9)
    last = driven.contacts
    clearance = min(one.clearance for one in last.values())
    assert found.obstacles["contact_clearance"][-1] == pytest.approx(clearance, abs=1e-12)
    forces = [float(np.linalg.norm(one.force)) for one in last.values()]
    assert found.obstacles["contact_total"][-1] == pytest.approx(sum(forces), rel=1e-9)
    assert found.contact["total"] >= sum(forces) and found.contact["largest"] >= max(forces) > 0.0
    assert found.contact["clearance"] <= clearance < 0.0


def test_nothing_is_drawn_without_obstacles():
    scene = scene_from_values(LYING | {"accuracy.estimate": "off"})
    assert record(scene, 0.05, 0.01).obstacles == {}


@pytest.mark.parametrize(
    ("shape", "size", "volume", "within"),
    [
        ("box", (1.0, 2.0, 3.0), 6.0, 0.03),
        ("sphere", (2.0, 2.0, 2.0), 4.0 / 3.0 * np.pi, 0.03),
        ("cylinder", (2.0, 2.0, 3.0), 3.0 * np.pi, 0.03),
        ("capsule", (2.0, 2.0, 4.0), (2.0 + 4.0 / 3.0) * np.pi, 0.03),
        ("ring", (20.0, 6.0, 0.0), 2.0 * np.pi**2 * 13.0 * 3.0**2, 0.06),
        ("channel", (10.0, 2.0, 80.0), 2.0 * np.pi * 6.0 * (2.0 * 78.0 + np.pi), 0.06),
    ],
)
def test_surfaces_enclose_their_obstacles(shape, size, volume, within):
    """Triangles counter-clockwise as seen from outside: the volume is positive."""
    a, b, c = np.moveaxis(surface(Obstacle("a", shape, size)), 1, 0)
    assert np.sum(a * np.cross(b, c)) / 6.0 == pytest.approx(volume, rel=within)
    if shape not in ("ring", "channel"):
        np.testing.assert_allclose(np.ptp(np.concatenate([a, b, c]), axis=0), size, rtol=0.02)
