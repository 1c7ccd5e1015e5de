"""Loads and end effectors from outside: what they do, and what is refused without a trace."""

import numpy as np
import pytest
from cables import FLAT, FREE, FULL, NATURAL, SOFT, move, simulator

from dlo_sim.core import rotations

SPATIAL = {"terms.out_of_plane": "on"}


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


def test_a_constant_load_ends_the_swing_of_a_signal():
    values = {"loads.tip.signal": "sine", "loads.tip.force": [0.0, 0.0, 5.0]}
    sim = soft(FLAT, values)
    sim.set_load("tip", force=[0.0, 0.0, 0.0])
    sim.advance_steps(50)
    assert np.abs(sim.velocities).max() < 1e-12


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


def test_moving_a_free_end_moves_nothing():
    """A free end has no end effector on the cable; its pose is remembered and that is all."""
    sim, untouched = soft(FREE), soft(FREE)
    sim.set_end("start", position=[0.5, 0.5, 0.5])
    for each in (sim, untouched):
        each.advance_steps(10)
    assert np.allclose(sim.control_points, untouched.control_points, rtol=0, atol=1e-14)


# ----------------------------------------------------------------------------------------- motion


def test_both_ends_can_move_and_springs_follow_theirs():
    sim = simulator(FULL, FLAT, n=6, method="velocity_verlet", step=2e-4)
    move(sim, "end", 0.1, velocity=[0.3, 0, 0])
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
        move(sim, "start", 0.02, angular_velocity=[2.0, 0.0, 0.0])
        sim.advance(0.02)
        given = rotations.rotate(pose, [0.6, 0.0, 0.8])
        assert np.allclose(natural_axis(sim), given, rtol=0, atol=1e-12)
    now = rotations.rotate(sim.end_pose("start")[1], [0.6, 0.0, 0.8])
    assert np.linalg.norm(natural_axis(sim) - now) < 2.0 * 0.02
