"""Offsets between stamps and clock, and the grid of steps."""

import pytest

from dlo_sim.session.time_base import SECOND, StepGrid, TimeBase, grid_multiple_at_or_after


def test_stamps_near_the_clock_need_no_offset():
    base = TimeBase("auto")
    assert base.decide(100 * SECOND, 100 * SECOND + 900_000_000) == 0
    assert base.from_clock(5) == 5


def test_first_stamp_of_another_epoch_fixes_the_offset_for_good():
    base = TimeBase("auto")
    clock = 1_700_000_000 * SECOND
    assert base.decide(1000 * SECOND, clock) == clock - 1000 * SECOND
    assert base.decide(1000 * SECOND, 3 * clock) == 0
    assert base.from_clock(clock + 7) == 1000 * SECOND + 7
    assert base.to_clock(base.from_clock(clock + 7)) == clock + 7


@pytest.mark.parametrize("mode", ["stamp", "arrival"])
def test_other_modes_never_have_an_offset(mode):
    base = TimeBase(mode)
    assert base.decide(1000 * SECOND, 5000 * SECOND) == 0
    base.forget()
    assert base.decide(1000 * SECOND, 5000 * SECOND) == 0


def test_which_messages_are_placed_by_their_stamp():
    assert TimeBase("auto").uses_stamp(1)
    assert not TimeBase("auto").uses_stamp(0)
    assert TimeBase("stamp").uses_stamp(1)
    assert not TimeBase("arrival").uses_stamp(1)


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
