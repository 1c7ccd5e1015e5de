"""Many plans at once: in their order, the same whoever computes them."""

import numpy as np
import pytest

from dlo_sim import Plan, Simulator, load_scene
from dlo_sim.batch import forecast_batch


@pytest.fixture(scope="module")
def cable():
    sim = Simulator(load_scene("hanging_cable"))
    sim.advance(0.1)
    return sim


def plans(sim, count):
    position, orientation = sim.end_pose("start")
    times = np.linspace(0.0, 0.2, 5)
    still = np.tile(orientation, (5, 1))
    ways = (position + np.outer(times, [0.1 * k, 0.0, 0.0]) for k in range(count))
    return [Plan(times, {"start": np.hstack([way, still])}) for way in ways]


def test_each_plan_by_itself_or_all_together(cable):
    """In worker processes: test_workers.py."""
    asked = plans(cable, 20)
    found = forecast_batch(cable, asked, 0.1, processes=1)
    assert len(found) == 20
    for plan, one in list(zip(asked, found, strict=True))[::6]:
        assert np.array_equal(one.control_points, cable.forecast(plan, 0.1).control_points)


def test_a_bad_plan_is_named(cable):
    asked = plans(cable, 18)
    asked[17] = Plan([0.0, 0.0], asked[17].poses)
    with pytest.raises(ValueError, match="plan 17: poses of start: needs"):
        forecast_batch(cable, asked, 0.1, processes=1)
