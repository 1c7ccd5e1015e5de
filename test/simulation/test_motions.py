"""Chained motions of end effectors: the path is that of the motions, whatever the step."""

import pickle

import numpy as np
import pytest
from cables import FULL, SOFT, move, simulator

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion

STEPS = {"energy_momentum": 2e-3, "velocity_verlet": 2e-4, "rk4": 2e-4}
METHODS = list(STEPS)
HELD = {"loads.names": [], "terms.twist": "auto"}


def cable(method="energy_momentum", scene=FULL):
    return simulator(scene, {"terms.out_of_plane": "on"}, n=6, method=method, step=STEPS[method])


def chain(sim, end="start"):
    """Four motions of odd durations, the third with a sudden velocity and shorter than a step."""
    rest = EndMotion.resting(*sim.end_pose(end), start=sim.time)
    rates = {"acceleration": [2.0, 1.0, -1.0], "angular_acceleration": [20.0, 5.0, 0.0]}
    first = rest.then(0.01237, **rates)
    second = first.then(0.0173, acceleration=[-1.0, 0.0, 2.0])
    third = second.then(7.1e-5, velocity=[0.05, 0.0, 0.02])
    fourth = third.then(0.0205, acceleration=[0.5, 0.0, 1.0], angular_acceleration=[-9.0, 0.0, 3.0])
    return [first, second, third, fourth]


def pose_of(motions, t):
    """Position and orientation on the path of a chain, evaluated one motion after the other."""
    motion = [one for one in motions if one.start <= t + 1e-12][-1]
    return motion.position_at(t), motion.orientation_at(t)


def assert_on_path(sim, motions):
    position, orientation = pose_of(motions, sim.time)
    assert sim.end_pose("start")[0] == pytest.approx(position, abs=1e-12)
    assert abs(sim.end_pose("start")[1] @ orientation) == pytest.approx(1.0, abs=1e-12)
    assert sim.control_points[0, :3] == pytest.approx(position, abs=1e-9)
    arm = sim.control_points[1, :3] - sim.control_points[0, :3]
    initial = rotations.rotate(orientation, sim.tangent)
    assert arm / np.linalg.norm(arm) == pytest.approx(initial, abs=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_motions_given_in_advance_are_followed_at_every_step(method):
    sim = cable(method)
    sim.tangent = sim.ends.tangent("start", 0.0)
    motions = chain(sim)
    for motion in motions:
        sim.set_motion("start", motion)
    while sim.time < motions[-1].end + 2 * sim.step:
        assert sim.advance_steps(1).status.ok
        assert_on_path(sim, motions)
    assert sim.end_pose("start")[0] == pytest.approx(motions[-1].position_at(9.0), abs=1e-12)
    assert sim.energy_error < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_each_motion_may_be_given_when_the_one_before_has_run(method):
    """As a person does it: give a motion, advance by its duration, give the next one."""
    sim, ahead = cable(method), cable(method)
    motions = chain(sim)
    for motion in motions:
        ahead.set_motion("start", motion)
    for motion in motions:
        sim.set_motion("start", motion)
        assert sim.advance(motion.duration).status.ok
    assert ahead.advance(motions[-1].end).status.ok
    assert sim.steps == ahead.steps
    assert np.array_equal(sim.control_points, ahead.control_points)
    assert np.array_equal(sim.velocities, ahead.velocities)


def test_pieces_snapshots_and_copies_give_the_same_bits():
    whole, pieces = cable(), cable()
    motions = chain(whole)
    for sim in (whole, pieces):
        for motion in motions:
            sim.set_motion("start", motion)
    whole.advance_steps(27)
    pieces.advance_steps(5)
    saved = pieces.snapshot()
    pieces.advance_steps(22)
    assert np.array_equal(pieces.control_points, whole.control_points)
    copy = pickle.loads(pickle.dumps(pieces))
    pieces.restore(saved)
    pieces.advance_steps(22)
    assert np.array_equal(pieces.control_points, whole.control_points)
    copy.restore(saved)
    copy.advance_steps(22)
    assert np.array_equal(copy.control_points, whole.control_points)
    pieces.reset()
    pieces.advance_steps(27)
    assert np.allclose(pieces.control_points[0, :3], 0.0, atol=1e-12), "reset drops what waits"


def test_a_new_motion_replaces_what_comes_after_its_start():
    sim = cable()
    first, second, *_ = chain(sim)
    for motion in (first, second, second.then(0.01)):
        sim.set_motion("start", motion)
    sim.advance(0.004)
    place = second.position_at(0.0207), second.orientation_at(0.0207)
    turn_back = EndMotion.resting(*place, start=0.0207).then(0.01, velocity=[-0.1, 0.0, 0.0])
    sim.set_motion("start", turn_back)
    sim.advance(0.05)
    assert sim.end_pose("start")[0] == pytest.approx(turn_back.position_at(1.0), abs=1e-12)
    later = EndMotion.resting(*sim.end_pose("start"), start=sim.time + 0.011)
    away = later.then(1.0, velocity=[0.3, 0.0, 0.0])
    sim.set_motion("start", away)
    sim.set_motion("start", away.then(1.0))
    before = sim.end_pose("start")[0]
    sim.set_motion("start", EndMotion.resting(*sim.end_pose("start"), start=sim.time))
    sim.advance(0.05)
    assert np.array_equal(sim.end_pose("start")[0], before)


def test_what_waits_is_checked_where_it_will_begin():
    sim = cable()
    first, second, *_ = chain(sim)
    sim.set_motion("start", first)
    elsewhere = EndMotion.resting([0.0, 0.0, 0.0], start=first.end).then(0.1)
    with pytest.raises(ValueError, match=r"starts .* away .* at 0.01237 s; start it .*then") as no:
        sim.set_motion("start", elsewhere)
    assert "\n" not in str(no.value)
    sim.set_motion("start", second)
    path = np.zeros((2, 7))
    path[:, :3], path[:, 6] = sim.end_pose("end")[0], 1.0
    with pytest.raises(
        ValueError, match="poses: none of start, whose next motion begins at 0.0123"
    ):
        sim.follow([0.0, 0.1], {"end": path}, [0.1])
    sim.set_end("start", position=first.position)  # a jump ends all motions
    assert sim.follow([0.0, 0.1], {"end": path}, [0.1])[0].status.ok


def test_twist_is_there_before_a_waiting_turn():
    """What a motion needs is there before its first step: no model is rebuilt within an advance."""
    both = {"end.clamped": True, "end.fixed": [True] * 3}  # one alone cannot twist the cable
    sim = simulator(SOFT, HELD, both, n=6, method="energy_momentum", step=2e-3)
    first = move(sim, "start", 0.0051, velocity=[0.1, 0.0, 0.0])
    second = first.then(0.02, angular_velocity=[3.0, 0.0, 0.0])
    sim.set_motion("start", second)
    sim.set_motion("start", second.then(0.0077, angular_velocity=[-1.0, 0.0, 0.0]))
    assert "twist" in sim.active_terms
    model = sim.model
    assert sim.advance(0.04).status.ok
    assert sim.model is model
    assert sim.control_points[0, 3] == pytest.approx(0.0523, abs=1e-12)
