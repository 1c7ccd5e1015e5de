"""Loads and end effectors from outside: what they do, and what is refused without a trace."""

import numpy as np
import pytest
from cables import FLAT, FREE, FULL, NATURAL, SOFT, simulator

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion

SPATIAL = {"terms.out_of_plane": "on"}
NAN = float("nan")


def soft(*values, method="velocity_verlet"):
    return simulator(SOFT, SPATIAL, *values, n=6, method=method, step=5e-4)


# ------------------------------------------------------------------------------------------ loads


@pytest.mark.parametrize("method", ["velocity_verlet", "energy_momentum"])
def test_a_load_that_is_set_equals_one_of_the_scene(method):
    force, torque = [0.1, -0.2, 0.3], [0.0, 0.01, 0.02]
    values = {"loads.tip.signal": "constant", "loads.tip.force": force, "loads.tip.torque": torque}
    scene, call = soft(values, method=method), soft(method=method)
    call.set_load("tip", force=force, torque=torque)
    scene.advance_steps(40)
    call.advance_steps(40)
    assert np.abs(scene.velocities).max() > 0.1
    assert np.array_equal(scene.control_points, call.control_points)


def test_a_load_holds_until_it_is_changed_and_its_parts_are_set_alone():
    both, parts = soft(), soft()
    both.set_load("tip", force=[0.1, 0.2, 0.3], torque=[0.0, 0.01, 0.0])
    parts.set_load("tip", force=[0.1, 0.2, 0.3])
    parts.set_load("tip", torque=[0.0, 0.01, 0.0])
    for sim in (both, parts):
        sim.advance_steps(20)
    assert np.array_equal(both.control_points, parts.control_points)
    both.set_load("tip", force=[0, 0, 0], torque=[0, 0, 0])
    before = both.velocities
    both.advance_steps(20)
    alone = soft(FLAT)
    assert not np.array_equal(both.velocities, before)
    alone.set_load("tip", force=[0.0, 0.0, 0.0])
    alone.advance_steps(20)
    assert np.abs(alone.velocities).max() < 1e-12


def test_a_constant_load_ends_the_swing_of_a_signal():
    values = {"loads.tip.signal": "sine", "loads.tip.force": [0.0, 0.0, 5.0]}
    sim = soft(FLAT, values)
    sim.set_load("tip", force=[0.0, 0.0, 0.0])
    sim.advance_steps(50)
    assert np.abs(sim.velocities).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "force", "torque", "error", "text"),
    [
        ("tap", [1, 0, 0], None, ValueError, "load: 'tap' is not known; give one of tip"),
        ("tip", [1, NAN, 0], None, ValueError, r"force of tip: needs 3 finite numbers \(N\)"),
        ("tip", [1, 0, 0], [0, float("inf"), 0], ValueError, "torque of tip: needs"),
        ("tip", [1, 0], None, ValueError, r"force of tip: .* got \[1, 0\]"),
        ("tip", 3.0, None, ValueError, "force of tip"),
        ("tip", "up", None, TypeError, "force of tip: .* got 'up'"),
    ],
)
def test_bad_loads_are_refused_whole(name, force, torque, error, text):
    sim, untouched = soft(), soft()
    with pytest.raises(error, match=text):
        sim.set_load(name, force=force, torque=torque)
    for each in (sim, untouched):
        each.advance_steps(10)
    assert np.array_equal(sim.control_points, untouched.control_points)


def test_a_scene_without_loads_says_so():
    sim = simulator(SOFT, {"loads.names": []}, n=6, method="velocity_verlet")
    with pytest.raises(ValueError, match="there are none"):
        sim.set_load("tip", force=[1, 0, 0])


# ------------------------------------------------------------------------------------------- ends

TILT = rotations.from_rotation_vector([0.2, -0.5, 0.3])


@pytest.mark.parametrize("method", ["velocity_verlet", "energy_momentum"])
def test_an_end_that_is_put_elsewhere_is_there_after_the_next_step(method):
    offset = {"start.offset": [0.02, 0.0, 0.01], "start.tangent": [0.6, 0.0, 0.8]}
    sim = soft(offset, method=method)
    sim.set_end("start", position=[0.01, -0.02, 0.005], orientation=TILT)
    assert sim.advance_steps(1).status.ok
    turn = rotations.to_matrix(TILT)
    points = sim.control_points
    attachment = np.array([0.01, -0.02, 0.005]) + turn @ [0.02, 0.0, 0.01]
    assert np.allclose(points[0, :3], attachment, atol=1e-15)
    arm = points[1, :3] - points[0, :3]
    assert np.allclose(np.cross(arm, turn @ [0.6, 0.0, 0.8]), 0.0, atol=1e-15)
    assert 0.5 / 9 < np.linalg.norm(arm) < 1.5 / 9  # its length is free
    position, orientation = sim.end_pose("start")
    assert np.array_equal(position, [0.01, -0.02, 0.005])
    assert np.allclose(orientation, TILT, atol=1e-15)
    assert not sim.velocities[0].any()


def test_a_tangent_may_be_given_instead_of_an_orientation():
    sim = soft()
    sim.set_end("start", tangent=[0.0, 3.0, 4.0])
    sim.advance_steps(1)
    arm = sim.control_points[1, :3] - sim.control_points[0, :3]
    assert np.allclose(np.cross(arm, [0.0, 0.6, 0.8]), 0.0, atol=1e-15)
    assert arm @ [0.0, 0.6, 0.8] == pytest.approx(1 / 9, rel=0.1)


@pytest.mark.parametrize("method", ["velocity_verlet", "forest_ruth", "rk4", "zhai"])
def test_a_jump_of_a_clamp_is_no_divergence(method):
    """Turned by a right angle in no time: its work is the change of the energy, not force times
    way."""
    sim = soft(method=method)
    sim.advance_steps(30)
    sim.set_end("start", tangent=[0.0, 3.0, 4.0])
    assert sim.advance_steps(400).status.advanced
    assert sim.energy().kinetic > 0.1
    assert sim.energy_error < 0.02


def test_a_quaternion_is_normalised():
    sim = soft()
    sim.set_end("start", orientation=3.0 * TILT)
    assert np.allclose(sim.end_pose("start")[1], TILT, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"end": "middle", "position": [0, 0, 0]}, ValueError),
        ({"end": "start", "position": [0, NAN, 0]}, ValueError),
        ({"end": "start", "position": [0, 0]}, ValueError),
        ({"end": "start", "orientation": [0, 0, 0, 0]}, ValueError),
        ({"end": "start", "orientation": [NAN, 0, 0, 1]}, ValueError),
        ({"end": "start", "orientation": [0, 0, 1]}, ValueError),
        ({"end": "start", "tangent": [0, 0, 0]}, ValueError),
        ({"end": "start", "tangent": [0, NAN, 1]}, ValueError),
        ({"end": "start", "tangent": [0, 0, 1], "orientation": [0, 0, 0, 1]}, ValueError),
        ({"end": "start", "position": [0, 0, 0.1], "orientation": [0, 0, 0, NAN]}, ValueError),
    ],
)
def test_bad_poses_are_refused_whole(arguments, error):
    sim, untouched = soft(), soft()
    with pytest.raises(error):
        sim.set_end(**arguments)
    for each in (sim, untouched):
        each.advance_steps(10)
    assert np.array_equal(sim.control_points, untouched.control_points)
    assert np.array_equal(sim.end_pose("start")[0], [0, 0, 0])


def test_an_unknown_end_has_no_pose_and_no_motion():
    sim = soft()
    for call in (
        sim.end_pose,
        sim.reaction,
        lambda end: sim.set_motion(end, EndMotion.resting([0, 0, 0])),
    ):
        with pytest.raises(ValueError, match="end: 'middle' is not known; give one of start, end"):
            call("middle")


def test_moving_a_free_end_moves_nothing():
    """A free end has no end effector on the cable; its pose is remembered and that is all."""
    sim, untouched = soft(FREE), soft(FREE)
    sim.set_end("start", position=[0.5, 0.5, 0.5])
    for each in (sim, untouched):
        each.advance_steps(10)
    assert np.allclose(sim.control_points, untouched.control_points, rtol=0, atol=1e-14)


# ----------------------------------------------------------------------------------------- motion


@pytest.mark.parametrize("method", ["velocity_verlet", "forest_ruth", "rk4", "energy_momentum"])
def test_a_motion_is_followed_exactly_and_ends_at_rest(method):
    path = EndMotion(
        start=0.01,
        duration=0.05,
        position=[0, 0, 0],
        orientation=[0, 0, 0, 1],
        velocity=[0.2, -0.3, 0.5],
        acceleration=[6.0, 4.0, -8.0],
        angular_velocity=[0.5, 1.0, -2.0],
        angular_acceleration=[20.0, 10.0, 0.0],
    )
    sim = soft(method=method)
    sim.set_motion("start", path)
    for _ in range(70):
        sim.advance_steps(2)
        t = sim.time
        turn = rotations.to_matrix(path.orientation_at(t))
        points, rates = sim.control_points[:2, :3], sim.velocities[:2, :3]
        assert np.allclose(points[0], path.position_at(t), rtol=0, atol=1e-12)
        arm, tangent = points[1] - points[0], turn[:, 0]
        assert np.allclose(np.cross(arm, tangent), 0.0, rtol=0, atol=1e-12)
        assert arm @ tangent == pytest.approx(1 / 9, rel=0.2)
        if abs(t - path.end) > 1e-9 and abs(t - path.start) > 1e-9:
            spin = np.cross(path.angular_velocity_at(t), arm)
            assert np.allclose(rates[0], path.velocity_at(t), rtol=0, atol=1e-12)
            across = np.cross(rates[1] - rates[0] - spin, tangent)  # along it it is free
            assert np.allclose(across, 0.0, rtol=0, atol=1e-11)
    assert sim.time > path.end
    assert not sim.velocities[0].any()


def test_both_ends_can_move_and_springs_follow_theirs():
    sim = simulator(FULL, FLAT, n=6, method="velocity_verlet", step=2e-4)
    away = EndMotion(
        start=0.0,
        duration=0.1,
        position=[1.0, 0, 0],
        orientation=[0, 0, 0, 1],
        velocity=[0.3, 0, 0],
    )
    sim.set_motion("end", away)
    sim.set_end("start", position=[0.0, 0.0, 0.01])
    sim.advance_steps(100)
    anchor = np.array([1.006, 0, 0])
    pull = -np.array([30.0, 20.0, 10.0]) * (sim.control_points[-1, :3] - anchor)
    assert np.allclose(sim.reaction("end")[0], pull, rtol=0, atol=1e-12)
    assert sim.control_points[0, 2] == 0.01


def natural_axis(sim):
    """Unit axis of the natural curvature of the first sample."""
    vector = sim.cable.natural[0, 0, :3]
    return vector / np.linalg.norm(vector)


def test_the_axis_of_the_natural_curvature_follows_motion_by_motion():
    """It is where the clamp is when a motion is given and stays until the next one is."""
    sim = simulator(FULL, FLAT, NATURAL, n=6, method="energy_momentum", step=1e-3)
    for _ in range(10):
        pose = sim.end_pose("start")[1]
        sim.set_motion(
            "start",
            EndMotion(
                start=sim.time,
                duration=0.02,
                position=[0.0, 0.0, 0.0],
                orientation=pose,
                angular_velocity=[2.0, 0.0, 0.0],
            ),
        )
        sim.advance(0.02)
        given = rotations.rotate(pose, [0.6, 0.0, 0.8])
        assert np.allclose(natural_axis(sim), given, rtol=0, atol=1e-12)
    now = rotations.rotate(sim.end_pose("start")[1], [0.6, 0.0, 0.8])
    assert np.linalg.norm(natural_axis(sim) - now) < 2.0 * 0.02
