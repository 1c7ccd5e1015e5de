"""Grasps: where a motion of the end effector puts what it holds, and how fast."""

import numpy as np
import pytest
from cables import CLAMPED, NATURAL, TWISTED, Bench, rotation, straight
from numba import float64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, kernel
from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine import grasps

OFFSET = [0.02, -0.01, 0.03]
TANGENTS = {end: CLAMPED[f"{end}.tangent"] for end in ("start", "end")}
BOTH = CLAMPED | NATURAL | TWISTED | {"start.offset": OFFSET, "end.offset": OFFSET}


@kernel(void, ARRAY, float64, ARRAY)
def turn(m, t, v):
    v[0], v[1], v[2] = grasps.turned(grid(m), t, v[0], v[1], v[2])


def motion(rotation=((0.0, 1.5, 2.0), (3.0, -1.0, -8.0)), duration=0.4):
    return EndMotion(
        start=0.1,
        duration=duration,
        position=[0.1, 0.2, 0.3],
        orientation=rotations.from_rotation_vector([0.3, -0.2, 0.5]),
        velocity=[0.4, -0.2, 1.0],
        acceleration=[4.0, 2.0, -6.0],
        angular_velocity=rotation[0],
        angular_acceleration=2.0 * np.asarray(rotation[1]),
    )


@pytest.fixture
def bench():
    return Bench(BOTH, n=8)


def follow(bench, end, path):
    """Let an end effector follow a motion, with the twist angle 0 at time 0."""
    bench.drive.follow(end, path)
    bench.cable.count_twists(0.0, enumerate([0.0, 0.0]))


def placed(bench, row, t):
    """Attachment point, tangent and twist angle."""
    end = ("start", "end")[row]
    place = bench.placed(row, t)
    tangent = np.array(TANGENTS[end])
    turn(bench.drive.motion[row].copy(), t, tangent)
    return np.array([*place[:3], *tangent, place[3]])


def rates(bench, row, t):
    """Velocity of the attachment point, and rate of the twist angle."""
    bench.drive.motion[:, 0] = 1.0
    cable = bench.cable
    cable.point_grasps(t)
    points = straight(bench)
    bench.drive.put(points, t, cable.held_twists(t))
    cable.put(points, 0.0 * points)
    return cable.velocities(t)[:, (0, -1)[row]]


@pytest.mark.parametrize(("row", "end"), [(0, "start"), (1, "end")])
@pytest.mark.parametrize("t", [0.0, 0.1, 0.23, 0.5, 0.9])
def test_attachment_and_tangent_follow_the_motion(bench, row, end, t):
    path = motion()
    follow(bench, end, path)
    s = min(max(t - 0.1, 0.0), 0.4)
    turn = rotation([0.3, -0.2, 0.5])
    if s > 0:
        turn = rotation(s * path.angular_velocity + s * s / 2 * path.angular_acceleration) @ turn
    place = path.position + s * path.velocity + s * s / 2 * path.acceleration
    found = placed(bench, row, t)
    assert np.allclose(found[:3], place + turn @ OFFSET, rtol=0, atol=1e-14)
    assert np.allclose(found[3:6], turn @ TANGENTS[end], rtol=0, atol=1e-14)


@pytest.mark.parametrize(("row", "end"), [(0, "start"), (1, "end")])
@pytest.mark.parametrize("t", [0.11, 0.3, 0.49])
def test_rates_are_the_derivatives_of_the_places(bench, row, end, t):
    follow(bench, end, motion())
    h = 1e-5
    slope = (placed(bench, row, t + h) - placed(bench, row, t - h)) / (2 * h)
    found = rates(bench, row, t)
    assert np.abs(found[:3]).max() > 0.5
    assert np.allclose(found[:3], slope[:3], rtol=0, atol=1e-8)
    assert found[3] == pytest.approx(slope[6], rel=1e-6)


def test_an_end_that_has_arrived_rests(bench):
    follow(bench, "start", motion())
    assert not rates(bench, 0, 0.05).any()
    assert not rates(bench, 0, 0.51).any()
    assert np.array_equal(placed(bench, 0, 0.5), placed(bench, 0, 7.0))


@pytest.mark.parametrize(("row", "end"), [(0, "start"), (1, "end")])
def test_turning_about_the_tangent_twists_by_the_same_angle(bench, row, end):
    """Positive about the direction from start to end, at both ends; the tangent stays."""
    tangent = rotation([0.3, -0.2, 0.5]) @ np.array(TANGENTS[end])
    follow(bench, end, motion(rotation=(2.0 * tangent, 1.5 * tangent)))
    start = placed(bench, row, 0.0)
    for t in (0.2, 0.5):
        s = t - 0.1
        found = placed(bench, row, t)
        assert found[6] - start[6] == pytest.approx(2.0 * s + 1.5 * s * s, rel=1e-12)
        assert np.allclose(found[3:6], start[3:6], rtol=0, atol=1e-15)
    assert rates(bench, row, 0.3)[3] == pytest.approx(2.0 + 3.0 * 0.2, rel=1e-12)


def test_swinging_the_tangent_does_not_twist(bench):
    tangent = rotation([0.3, -0.2, 0.5]) @ np.array(TANGENTS["start"])
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    follow(bench, "start", motion(rotation=(3.0 * across, across)))
    assert abs(placed(bench, 0, 0.4)[6]) < 1e-14
    assert abs(rates(bench, 0, 0.4)[3]) < 1e-14


def test_a_direction_that_jumps_to_its_opposite_twists_by_some_angle(bench):
    """The smallest rotation there is not unique."""
    tangent = rotation([0.3, -0.2, 0.5]) @ np.array(TANGENTS["start"])
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    across *= np.pi / np.linalg.norm(across)
    follow(bench, "start", motion())
    before = rotations.from_rotation_vector([0.3, -0.2, 0.5])
    opposite = rotations.multiply(rotations.from_rotation_vector(across), before)
    bench.drive.follow("start", EndMotion.resting([0, 0, 0], opposite))
    assert abs(placed(bench, 0, 0.0)[6]) <= np.pi


def test_twist_goes_on_from_motion_to_motion(bench):
    tangent = rotation([0.3, -0.2, 0.5]) @ np.array(TANGENTS["start"])
    follow(bench, "start", motion(rotation=(2.0 * tangent, 0.0 * tangent)))
    half = placed(bench, 0, 0.3)[6]
    later = EndMotion.resting([0, 0, 0], bench.drive.pose("start", 0.3)[1], start=0.3)
    bench.drive.follow("start", later)
    assert half == pytest.approx(0.4)
    assert placed(bench, 0, 0.3)[6] == pytest.approx(0.4)


def test_twist_counts_whole_turns(bench):
    tangent = rotation([0.3, -0.2, 0.5]) @ np.array(TANGENTS["start"])
    follow(bench, "start", motion(rotation=(40.0 * tangent, 0.0 * tangent)))
    assert placed(bench, 0, 0.5)[6] == pytest.approx(16.0)
