"""Poses -> a continuous path: the B-spline it should be, and continuity whatever arrives."""

import numpy as np
import pytest

from dlo_sim.core import one_rotation, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.gripper_path import GripperPath, Pose, StepGrid
from dlo_sim.session.time_base import SECOND

STEP = 1e-3
GRID = StepGrid(0, STEP)


class Driver:
    """Plays the part of the simulation: asks for segments and keeps them."""

    def __init__(self, timeout=1.0, smoothing=0.0):
        self.journal = Journal(())
        values = {"start.pose_timeout": timeout, "start.pose_smoothing": smoothing}
        holder = scene_from_values({"start.pose_topic": "/pose", **values}).start
        self.path = GripperPath("start", holder, self.journal)
        self.index = 0
        self.segments = []

    def add(self, seconds, position=(0, 0, 0), turn=(0, 0, 0)):
        orientation = one_rotation.exponential(turn)
        self.path.add(Pose(round(seconds * SECOND), tuple(map(float, position)), orientation))

    def begin(self, seconds):
        self.path.begin(round(seconds * SECOND))
        self.index = GRID.first_at_or_after(round(seconds * SECOND))

    def drain(self, wanted):
        """Take segments until one is missing or `wanted` [s] is reached."""
        target = GRID.last_at_or_before(round(wanted * SECOND))
        while self.index < target:
            segment = self.path.next_segment(
                GRID, self.index, self.index * STEP, round(wanted * SECOND)
            )
            if segment is None:
                return False
            self.segments.append(segment)
            self.index = target if segment.last is None else segment.last
        return True

    def motion_at(self, t) -> EndMotion:
        return [s.motion for s in self.segments if s.motion.start <= t + 1e-12][-1]

    def positions(self, times):
        return np.array([self.motion_at(t).position_at(t) for t in times])

    def assert_continuous(self, velocity=True):
        for a, b in zip(self.segments, self.segments[1:], strict=False):
            t = b.motion.start
            assert np.allclose(a.motion.position_at(t), b.motion.position_at(t), atol=1e-12)
            same = np.dot(a.motion.orientation_at(t), b.motion.orientation_at(t))
            assert abs(same) == pytest.approx(1.0, abs=1e-12)
            if velocity and a.last is not None and b.last is not None:
                assert np.allclose(a.motion.velocity_at(t), b.motion.velocity_at(t), atol=1e-9)
                assert np.allclose(
                    a.motion.angular_velocity_at(t), b.motion.angular_velocity_at(t), atol=1e-9
                )


def test_uniform_poses_give_the_quadratic_b_spline():
    """At a stamp: p + (second difference)/8; half-way: the mean. Stamps lie on the grid."""
    rng = np.random.default_rng(1)
    poses = np.cumsum(rng.normal(size=(40, 3)), axis=0) * 1e-3
    poses[:4] = poses[3]  # from rest
    driver = Driver()
    for k, p in enumerate(poses):
        driver.add(0.02 * k, p)
    driver.begin(0.0)
    driver.drain(10.0)
    inner = np.arange(5, 35)
    smoothed = poses[inner] + (poses[inner - 1] - 2 * poses[inner] + poses[inner + 1]) / 8
    assert np.allclose(driver.positions(0.02 * inner), smoothed, atol=1e-12)
    assert np.allclose(
        driver.positions(0.02 * inner + 0.01), 0.5 * (poses[inner] + poses[inner + 1]), atol=1e-12
    )
    driver.assert_continuous()


def test_turning_poses_follow_the_turn():
    driver = Driver()
    for k in range(60):
        driver.add(0.02 * k, turn=[0, 0.8 * (1 - np.cos(0.1 * k)), 0.3 * np.sin(0.1 * k)])
    driver.begin(0.0)
    driver.drain(10.0)
    driver.assert_continuous()
    for k in range(20, 55):
        t = 0.02 * k
        wanted = rotations.from_rotation_vector(
            [0, 0.8 * (1 - np.cos(0.1 * k)), 0.3 * np.sin(0.1 * k)]
        )
        off = rotations.multiply(driver.motion_at(t).orientation_at(t), rotations.conjugate(wanted))
        # The second difference is 0.008 rad, an eighth of it 0.001.
        assert np.linalg.norm(rotations.to_rotation_vector(off)) < 1.2e-3


def test_constant_velocity_is_exact_whatever_the_stamps():
    """Jittered stamps of an even motion leave no trace: neither in position nor in velocity."""
    rng = np.random.default_rng(2)
    driver = Driver()
    velocity = np.array([0.3, -0.1, 0.2])
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.005, 0.06, size=80))])
    for t in times:
        driver.add(t, velocity * t)
    driver.begin(0.0)
    driver.drain(times[-1])
    driver.assert_continuous()
    late = np.linspace(0.5, driver.index * STEP - 1e-6, 300)
    assert len(late) == 300
    # Starting from rest needs a few segments to die out; stamps are rounded to nanoseconds.
    assert np.allclose(driver.positions(late), np.outer(late, velocity), atol=1e-8)


def test_constant_spin_is_exact_whatever_the_stamps():
    """The turning counterpart: about one axis, a jittered stamp leaves no trace either."""
    rng = np.random.default_rng(3)
    driver = Driver()
    spin = np.array([0.6, 0.0, -0.8])
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.005, 0.06, size=60))])
    for t in times:
        driver.add(t, turn=spin * t)
    driver.begin(0.0)
    driver.drain(times[-1])
    driver.assert_continuous()
    for t in np.linspace(0.5, driver.index * STEP - 1e-6, 100):
        motion = driver.motion_at(t)
        wanted = rotations.from_rotation_vector(spin * t)
        off = rotations.multiply(motion.orientation_at(t), rotations.conjugate(wanted))
        assert np.linalg.norm(rotations.to_rotation_vector(off)) < 1e-8
        assert np.allclose(motion.angular_velocity_at(t), spin, rtol=0, atol=1e-6)


def test_replanning_a_turn_from_its_start_gives_the_same_turn():
    """The rate of a rotation vector and the angular velocity differ where the axis changes."""
    driver = Driver()
    for k in range(12):
        driver.add(0.02 * k, turn=[0.2 * k, 0.3 * np.sin(0.5 * k), 0.1 * np.cos(0.7 * k)])
    driver.begin(0.0)
    driver.drain(1.0)
    motion = driver.segments[-1].motion
    steps = round(motion.duration / STEP)
    again = driver.path.replan(motion, motion.start, GRID, steps).motion
    turned = np.linalg.norm(motion.angular_velocity) * motion.duration
    assert turned > 0.15
    assert np.allclose(again.angular_velocity, motion.angular_velocity, rtol=0, atol=1e-9)
    change, size = motion.angular_acceleration, np.linalg.norm(motion.angular_acceleration)
    assert np.allclose(again.angular_acceleration, change, rtol=0, atol=1e-3 * size)


def test_uneven_stamps_do_not_ring():
    """Alternating intervals and an acceleration: the miss stays of the smoothing's order."""
    driver = Driver()
    times = np.cumsum(np.tile([0.01, 0.04], 60))
    for t in times:
        driver.add(t, (0.1 * np.sin(6.0 * t), 0, 0))
    driver.begin(times[0])
    driver.drain(times[-1])
    late = np.linspace(1.0, driver.index * STEP, 500)
    error = driver.positions(late)[:, 0] - 0.1 * np.sin(6.0 * late)
    assert (
        np.abs(error).max() < 0.1 * 36.0 * 0.04**2
    )  # acceleration times the longest interval squared
    driver.assert_continuous()


def test_waits_for_the_next_pose_and_goes_on_as_if_it_had_not_waited():
    one, many = Driver(), Driver()
    for k in range(20):
        one.add(0.03 * k, (0.01 * k**1.5, 0, 0))
    one.begin(0.0)
    one.drain(10.0)
    many.add(0.0)
    many.begin(0.0)
    for k in range(1, 20):
        assert not many.drain(0.03 * k + 0.5)
        many.add(0.03 * k, (0.01 * k**1.5, 0, 0))
    assert not many.drain(0.03 * 19 + 0.5)
    assert len(many.segments) > 15
    for a, b in zip(one.segments, many.segments, strict=False):
        assert (a.first, a.last) == (b.first, b.last)
        assert np.array_equal(a.motion.position_coefficients, b.motion.position_coefficients)


def test_silence_is_held_at_the_last_pose_and_found_at_the_same_stamp_either_way():
    live, late = Driver(timeout=0.5), Driver(timeout=0.5)
    for driver in (live, late):
        for k in range(10):
            driver.add(0.03 * k, (0.003 * k, 0, 0))
        driver.begin(0.0)
    assert not live.drain(0.7)  # last pose at 0.27: not yet silent
    assert live.drain(0.8)
    assert live.path.silent
    assert live.journal.events == {"silent": 1}
    live.assert_continuous()
    assert live.positions([0.75])[0] == pytest.approx([0.027, 0, 0], abs=1e-12)
    assert not live.motion_at(0.75).velocity_at(0.75).any()
    for driver in (live, late):  # the late one hears of the silence only by the next stamp
        for k in range(5):
            driver.add(2.0 + 0.03 * k, (0.1, 0, 0))
        driver.drain(2.05)
    one, other = (
        [s for s in d.segments if s.motion.position_coefficients[1:].any()] for d in (live, late)
    )
    assert [s.first for s in one] == [s.first for s in other]
    assert one[-1].first > 2000
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.motion.position_coefficients, b.motion.position_coefficients)
