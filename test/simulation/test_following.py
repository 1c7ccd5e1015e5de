"""Whole trajectories of end effectors, `Simulator.follow`."""

import numpy as np
import pytest
from cables import SOFT, move, scene_of, simulator

from dlo_sim.core import rotations
from dlo_sim.simulation.following import on_grid
from dlo_sim.simulation.simulator import Simulator

STEP = 5e-3
GRASP = {
    "terms.out_of_plane": "on",
    "terms.twist": "quasistatic",
    "grasps.names": ["hand"],
    "grasps.hand.at": 0.6,
    "grasps.hand.position": [0.55, 0.05, -0.05],
    "cable.rest_curvature": [0.5, -1.0],
    "loads.names": [],
}


def held():
    return simulator(SOFT, GRASP, method="energy_momentum", step=STEP)


def poses(sim, times):
    """A start that moves and turns about all axes, a hand that moves."""
    turn = np.outer(np.sin(3.0 * times), [0.5, 0.4, -0.6])
    start = np.stack([0.1 * np.sin(5.0 * times), 0.0 * times, 0.05 * times], axis=1)
    hand = np.array([0.55, 0.05, -0.05]) + np.outer(np.sin(4.0 * times), [0.0, 0.1, 0.05])
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    return {
        "start": np.hstack([start, rotations.from_rotation_vector(turn)]),
        "hand": np.hstack([hand, still]),
    }


def test_it_is_what_single_motions_and_steps_are():
    times = STEP * np.arange(41)
    sim, other = held(), held()
    paths = poses(sim, times)
    report, points = sim.follow(times, paths, times[1:])
    assert report.status.ok and report.steps == 40 == sim.steps
    for k in range(40):
        for name, path in paths.items():
            (p0, q0), (p1, q1) = ((row[:3], row[3:]) for row in path[k : k + 2])
            turn = rotations.to_rotation_vector(rotations.multiply(q1, rotations.conjugate(q0)))
            move(other, name, STEP, velocity=(p1 - p0) / STEP, angular_velocity=turn / STEP)
        other.advance_steps(1)
        assert points[k] == pytest.approx(other.control_points, abs=1e-11)
    assert np.abs(points[-1] - points[0]).max() > 0.05
    assert max(sim.energy_error, other.energy_error) < 1e-9
    assert sim.end_pose("start")[0] == pytest.approx(paths["start"][-1, :3], abs=1e-12)


def test_a_path_that_leaves_the_plane_of_a_taut_cable_later_is_refused():
    taut = {"loads.names": [], "start.clamped": False, "end.fixed": [True] * 3}
    sim = simulator(SOFT, taut, method="energy_momentum", step=STEP)
    assert len(sim.model.axes) == 2
    before = sim.snapshot()
    times = STEP * np.arange(21)
    path = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (21, 1))
    path[5:, 1] = 0.02 * np.linspace(0.0, 1.0, 16)
    with pytest.raises(ValueError, match="terms.out_of_plane: auto .* set it to on"):
        sim.follow(times, {"start": path}, times[1:])
    assert np.array_equal(sim.snapshot().inputs, before.inputs)
    sim = simulator(SOFT, taut, {"terms.out_of_plane": "on"}, method="energy_momentum", step=STEP)
    _, points = sim.follow(times, {"start": path}, times[1:])
    assert points[-1, 0, :3] == pytest.approx([0.0, 0.02, 0.0], abs=1e-12)


def test_the_advance_ends_at_the_last_pose_even_between_steps():
    sim, times = held(), np.array([0.0, 0.008, 0.0176])
    report, points = sim.follow(times, poses(sim, times), times[1:])
    assert report.status.ok and len(points) == 2 and sim.time == pytest.approx(0.02)


def test_poses_between_the_steps_are_met_by_a_smooth_path():
    sim, times = held(), np.linspace(0.0, 0.2, 31)
    paths = poses(sim, times)
    _, points = sim.follow(times, paths, np.array([0.1, 0.2]))
    wanted = poses(sim, np.array([0.1, 0.2]))["start"][:, :3]
    assert points[:, 0, :3] == pytest.approx(wanted, abs=2e-6)


def test_a_gripper_of_two_points_holds_the_cable_along_its_x_axis():
    turn = rotations.from_rotation_vector([0.2, 0.3, -0.4])
    values = {"start.pose_type": "two_points", "end.position": [0.0, 0.6, -0.8]}
    values |= {"terms.out_of_plane": "on", "loads.names": []}
    scene = scene_of(SOFT, values)
    for poses, tangent in (
        ({}, [0.0, 0.6, -0.8]),
        ({"start": (np.zeros(3), turn)}, rotations.rotate(turn, [1.0, 0.0, 0.0])),
    ):
        first, second, *_ = Simulator(scene, poses).control_points[:, :3]
        assert (second - first) / np.linalg.norm(second - first) == pytest.approx(tangent)


def test_two_points_are_poses_midway_and_along_them():
    times = STEP * np.arange(41)
    angle, sim = 3.0 * times, held()
    axis = 0.02 * np.stack([np.cos(angle), np.sin(angle), 0.2 * angle], axis=1)
    middle = np.stack([0.1 * np.sin(angle), 0.0 * times, 0.05 * times], axis=1)
    report, points = sim.follow(
        times, {"start": np.stack([middle - axis, middle + axis], 1)}, times[1:]
    )
    assert report.status.ok and points[:, 0, :3] == pytest.approx(middle[1:], abs=1e-12)
    tangents = np.diff(points[:, :2, :3], axis=1)[:, 0]
    assert np.cross(tangents, axis[1:]) == pytest.approx(np.zeros((40, 3)), abs=1e-12)
    assert np.all(np.sum(tangents * axis[1:], axis=1) > 0.0)
    assert np.ptp(points[:, 0, 3]) < 1e-3  # the end turns and does not twist the cable


@pytest.mark.parametrize(
    "times, path, text",
    [
        ([0.0, 0.0], {}, "times: needs two or more"),
        ([0.1, 0.2], {}, "times: needs a first time of 0.0 s"),
        ([0.0, 0.1], {"start": np.zeros((3, 7))}, "poses of start"),
        (
            [0.0, 0.1],
            {"foot": np.ones((2, 7))},
            "end: 'foot' is not known",
        ),
        ([0.0, 0.1], {"start": np.zeros((2, 2, 3))}, "points of start: row 0 has two points 0 m"),
        ([0.0, 0.1], {"start": np.ones((3, 2, 3))}, "poses of start: needs finite numbers of sha"),
        ([0.0, 0.1], {"start": np.full((2, 2, 3), np.nan)}, "poses of start: needs finite"),
        ([0.0, 0.1], {"start": [[1, 2], [1]]}, "poses of start: needs"),
        ([0.0, 0.1], [], "poses"),
        (
            [-0.2, -0.1],
            {},
            "times: end at -0.1 s, not after the present, 0 s; give a later last time",
        ),
        ([0.0, 0.1], {"start": np.zeros((2, 7))}, "poses of start: row 0 has a quaternion of zero"),
    ],
)
def test_times_and_poses_that_do_not_fit_are_refused(times, path, text):
    sim = held()
    before = sim.cable.state.copy()
    with pytest.raises((TypeError, ValueError), match="^" + text):
        sim.follow(times, path, [0.1])
    assert np.array_equal(sim.cable.state, before)


@pytest.mark.parametrize("samples", [[0.05, 0.02], [0.05, 0.05], [-0.1, 0.1], [0.0], [0.2]])
def test_samples_outside_the_advance_or_not_rising_are_refused(samples):
    sim = held()
    with pytest.raises(ValueError, match="^samples: .* do not rise from after the present, 0 s"):
        sim.follow([0.0, 0.1], {}, samples)
    assert sim.steps == 0


def test_explicit_methods_refuse():
    sim = simulator(SOFT, method="velocity_verlet", step=5e-4)
    with pytest.raises(ValueError, match="^integrator.method: velocity_verlet follows no poses"):
        sim.follow([0.0, 0.1], {}, [0.1])


def test_a_short_interval_does_not_swing_through_the_long_one():
    """5 mm in a tenth of a millisecond, then at rest: nowhere farther than that."""
    times = np.array([0.0, 1e-4, 0.1, 0.2])
    path = np.zeros((4, 7))
    path[:, 6] = 1.0
    path[1:, 0] = 5e-3
    grid = np.linspace(0.0, 0.2, 401)
    between = on_grid(grid, times, path)[:, 0]
    assert between.min() >= -1e-12 and between.max() <= 5e-3 + 1e-12
