"""Frames along the cable: orthonormal, x along the tangent, twist and clamp orientation visible."""

import numpy as np
from cables import FLAT, FULL, SOFT, set_state, simulator

from dlo_sim.core import bspline, rotations

TWISTED = FULL | FLAT | {"terms.twist": "bishop"}
U = np.linspace(0.0, 1.0, 129)


def axes(sim):
    """Columns x, y, z of the frames at U, shape (129, 3, 3)."""
    quaternions = sim.frames(U)
    assert np.allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-14)
    return rotations.to_matrix(quaternions)


def tangents(sim):
    slope = bspline.evaluate(sim.control_points[:, :3], sim.model.knots, U, 1)
    return slope / np.linalg.norm(slope, axis=1, keepdims=True)


def bent(*values):
    sim = simulator(TWISTED, *values, n=8, method="energy_momentum")
    points = sim.control_points
    points[2:, 1] += 0.3 * np.sin(3 * points[2:, 0])
    points[2:, 2] += 0.2 * points[2:, 0] ** 2
    set_state(sim, points)
    return sim


def test_x_is_the_tangent_of_a_bent_cable():
    sim = bent()
    assert np.abs(tangents(sim)[:, 1]).max() > 0.3
    assert np.allclose(axes(sim)[:, :, 0], tangents(sim), rtol=0, atol=1e-12)


def test_frames_are_right_handed_and_do_not_turn_about_the_tangent_without_twist():
    """Between neighbours the turn is across the tangent: rotation-minimising."""
    found = axes(bent())
    assert np.allclose(np.linalg.det(found), 1.0, atol=1e-12)
    for before, after in zip(found[:-1], found[1:], strict=True):
        turn = after @ before.T
        spin = (
            np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            / 2
        )
        middle = before[:, 0] + after[:, 0]
        assert abs(spin @ middle) < 1e-3 * np.linalg.norm(spin) + 1e-9


def test_twist_turns_the_frames_about_the_tangent():
    plain, twisted = bent(), bent(TWISTED)
    points = twisted.control_points
    points[:, 3] = 2.0 * twisted.greville
    set_state(twisted, points)
    before, after = axes(plain), axes(twisted)
    for k, u in enumerate(U):
        y = np.cos(2 * u) * before[k, :, 1] + np.sin(2 * u) * before[k, :, 2]
        assert np.allclose(after[k, :, 1], y, rtol=0, atol=1e-12)


def test_frames_turn_with_the_clamp_that_holds_the_start():
    sim = simulator(TWISTED, n=8, method="energy_momentum")
    before = axes(sim)[0]
    turn = rotations.from_rotation_vector([0.9, 0.0, 0.0])
    sim.set_end("start", orientation=turn)
    sim.advance_steps(1)
    assert np.allclose(axes(sim)[0], rotations.to_matrix(turn) @ before, atol=1e-12)


def test_a_planar_cable_keeps_one_axis_across_its_plane():
    flat = {"loads.names": [], "terms.out_of_plane": "off"}
    sim = simulator(SOFT, flat, n=8, method="velocity_verlet")
    assert "out_of_plane" in sim.left_out
    sim.advance(0.3)
    found = axes(sim)
    assert np.abs(found[:, 2, 0]).max() > 0.1
    across = np.abs(found[:, 1, :])
    assert np.allclose(across.max(axis=1), 1.0, atol=1e-12)
    assert np.ptp(found[:, 1, :], axis=0).max() < 1e-12


def test_frames_exist_at_the_very_ends_and_in_any_number():
    sim = bent()
    assert sim.frames([0.0]).shape == (1, 4)
    assert sim.frames([0.0, 1.0]).shape == (2, 4)
    assert np.allclose(sim.frames(sim.greville)[0], sim.frames([0.0])[0], atol=1e-15)
