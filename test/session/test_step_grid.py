"""The grid of steps."""

import pytest

from dlo_sim.session.gripper_path import StepGrid


@pytest.mark.parametrize("step", [1e-3, 1 / 3000, 1.7e-5, 0.01])
@pytest.mark.parametrize("origin", [0, -17, 1_700_000_000_123_456_789])
def test_grid_searches_agree_with_its_times(step, origin):
    grid = StepGrid(origin, step)
    for index in (0, 1, 2, 3, 1000, 12345, 7_654_321):
        at = grid.time_of(index)
        assert grid.first_at_or_after(at) == grid.last_at_or_before(at) == index
        assert grid.first_at_or_after(at - 1) == index == grid.last_at_or_before(at + 1)
        assert grid.first_at_or_after(at + 1) == index + 1 == grid.last_at_or_before(at - 1) + 2
