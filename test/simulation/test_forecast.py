"""The future of a cable along a plan: the same bits as driven so, and nothing disturbed."""

import pickle

import numpy as np
import pytest
from cables import SOFT, simulator

from dlo_sim import Plan
from dlo_sim.core import rotations
from dlo_sim.simulation.recorder import Recorder

TIMES = np.linspace(0.0, 0.6, 13)


def moving(**changes):
    """A cable in motion, its start moving on its own."""
    changes = {"terms.out_of_plane": "on", "loads.names": [], **changes}
    sim = simulator(SOFT, changes, method="energy_momentum", step=5e-3)
    position, _ = sim.end_pose("start")
    times = np.linspace(0.0, 0.3, 5)
    path = position + np.outer(np.sin(8.0 * times), [0.02, 0.03, 0.05])
    still = np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    sim.follow(times, {"start": np.hstack([path, still])}, [])
    return sim


def plan_of(sim, turn=(0.3, 0.4, -0.6)):
    position, orientation = sim.end_pose("start")
    path = position + np.outer(np.sin(5.0 * TIMES), [0.1, -0.05, 0.02])
    turns = rotations.from_rotation_vector(np.outer(TIMES, turn))
    return Plan(TIMES, {"start": np.hstack([path, rotations.multiply(turns, orientation)])})


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, 0.4, -0.6)])
def test_it_has_the_bits_of_a_cable_that_is_driven_so(turn):
    sim, driven = moving(), moving()
    plan = plan_of(sim, turn)
    found = sim.forecast(plan, every=0.05)
    now = driven.time
    _, points = driven.follow(now + TIMES, plan.poses, np.minimum(now + found.times, now + 0.6))
    assert len(points) == len(found.times) == 12
    assert np.array_equal(found.control_points, points)
    assert found.centerline[-1] == pytest.approx(driven.centerline(found.u), abs=1e-14)
    assert found.peak_tension == found.tension.max() >= driven.tension(found.u).max() - 1e-9
    assert found.largest_curvature == found.curvature.max() > 0.0
    assert np.abs(points[-1] - points[0]).max() > 0.02


def test_the_simulator_stays_as_it_is():
    sim, alone = moving(), moving()
    before = pickle.dumps(sim)
    sim.forecast(plan_of(sim))
    assert pickle.dumps(sim) == before
    for one in (sim, alone):
        position, orientation = one.end_pose("start")
        one.set_end("start", position + [0.0, 0.0, 1e-3], orientation)
        one.advance_steps(40)
    assert np.array_equal(sim.cable.state, alone.cable.state)
    assert np.array_equal(np.hstack(sim.end_pose("start")), np.hstack(alone.end_pose("start")))


def test_one_that_fails_before_its_first_shape_says_so_itself(monkeypatch):
    sim = moving()

    def failing(future, times, poses, samples):
        return future.advance_steps(0), Recorder(future.model, np.zeros(0))

    monkeypatch.setattr(type(sim), "record_along", failing)
    found = sim.forecast(plan_of(sim), 0.1)
    assert found.centerline.shape == (0, len(found.u), 3)
    assert found.largest_curvature == 0.0
    assert found.peak_tension == -np.inf


def test_shapes_without_tension():
    sim = moving(**{"cable.rest_curvature": [0.5]})
    found = sim.forecast(plan_of(sim))
    assert found.tension is None and found.peak_tension is None
    assert found.largest_curvature > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": "nowhere"}, "end: 'nowhere' is not known"),
        ({"shift": 0.1}, "begin 0.1 m and 0 rad away from the end effector; begin at end_pose"),
        ({"times": TIMES[::-1]}, "times: begin with .* a plan begins at 0 s"),
        ({"times": np.r_[0.0, 0.1, 0.1, TIMES[3:]]}, "times: needs two or more, each later"),
        ({"times": np.zeros(0)}, "times: begin with"),
        ({"nan": True}, "poses of start: needs finite"),
        ({"every": 0.0}, "every: 0 s; give one above 0 s"),
        ({"every": 1.0}, "every: 1 s; give one above 0 s, up to the 0.6 s"),
    ],
)
def test_bad_plans_are_refused_in_one_line(change, message):
    sim = moving()
    before = pickle.dumps(sim)
    times = change.get("times", TIMES)
    rows = plan_of(sim).poses["start"][: len(times)].copy()
    rows[:, 0] += change.get("shift", 0.0)
    if "nan" in change:
        rows[3, 1] = np.nan
    with pytest.raises(ValueError, match=message) as refused:
        sim.forecast(Plan(times, {change.get("start", "start"): rows}), change.get("every", 0.02))
    assert "\n" not in str(refused.value)
    assert pickle.dumps(sim) == before


def test_an_explicit_method_is_refused():
    sim = simulator(SOFT, method="velocity_verlet", step=1e-5)
    with pytest.raises(ValueError, match="follows no poses; give energy_momentum"):
        sim.forecast(plan_of(sim))
