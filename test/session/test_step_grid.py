"""The grid of steps."""

import pytest

from dlo_sim.session.gripper_path import StepGrid, grid_multiple_at_or_after
from dlo_sim.session.pacing import OutputGrid


@pytest.mark.parametrize("step", [1e-3, 1 / 3000, 1.7e-5, 0.01])
@pytest.mark.parametrize("origin", [0, -17, 1_700_000_000_123_456_789])
def test_grid_searches_agree_with_its_times(step, origin):
    grid = StepGrid(origin, step)
    for index in (0, 1, 2, 3, 1000, 12345, 7_654_321):
        at = grid.time_of(index)
        assert grid.first_at_or_after(at) == grid.last_at_or_before(at) == index
        assert grid.first_at_or_after(at - 1) == index == grid.last_at_or_before(at + 1)
        assert grid.first_at_or_after(at + 1) == index + 1 == grid.last_at_or_before(at - 1) + 2


def test_simulations_begin_at_multiples_of_the_step():
    assert grid_multiple_at_or_after(10_000_000, 1e-3) == 10_000_000
    assert grid_multiple_at_or_after(10_000_001, 1e-3) == 11_000_000
    assert grid_multiple_at_or_after(-1, 1e-3) == 0


@pytest.mark.parametrize("rate", [30.0, 200.0, 1000.0])
@pytest.mark.parametrize("now", [0, 123_456_789, 1_700_000_000_999_999_999])
def test_a_tick_that_comes_when_it_should_finds_a_state_that_is_just_due(rate, now):
    grid, period = OutputGrid(rate), round(1e9 / rate)
    assert 0 <= grid.until_tick(now) < period
    due = now + grid.until_tick(now)
    assert due // period * period < due < due // period * period + 0.7e6
    assert grid.aim(due) == due // period * period
    # One that is late leaves nothing out, and those that follow are not behind because of it.
    assert grid.aim(due + period + period // 2) == (due // period + 1) * period
    assert grid.aim(due + 3 * period) == (due // period + 3) * period
    assert grid.aim(due + 4 * period) == (due // period + 4) * period


@pytest.mark.parametrize("jitter", [0.0, 0.2e6])
def test_ticks_that_jitter_about_a_state_take_all_one_by_one(jitter):
    grid, period = OutputGrid(200.0), 5_000_000
    aims = [grid.aim(k * period + int(jitter) * (-1) ** k) for k in range(1, 50)]
    assert [b - a for a, b in zip(aims, aims[1:], strict=False)] == [period] * 48
