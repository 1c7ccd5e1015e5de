"""Loads: order, timeout, sign, and that each acts until the next (zero-order hold)."""

import pytest
from session_bench import FREE, MS, T0, Bench


def forces(bench):
    """Step and force along x of each load that reached the simulator."""
    return [(call[1], round(call[3][0], 12)) for call in bench.simulator.calls if call[0] == "load"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_load_acts_from_the_first_step_at_its_stamp_until_the_next(sign):
    """With the sign that the scene gives it, force and torque."""
    bench = Bench(FREE, **{"loads.tip.sign": sign})
    for ms, fx in ((100, 1.0), (120, 2.0), (120.5, 3.0)):
        bench.wrench(T0 + round(ms * MS), (fx, 0, 0), (0, fx, 0), arrival=T0 + 125 * MS)
    bench.run(T0, T0 + 400 * MS)
    origin = bench.session._drive.grid.origin_ns
    first = (T0 + 100 * MS - origin) // MS
    assert forces(bench) == [(first, sign), (first + 20, 2 * sign), (first + 21, 3 * sign)]
    assert [call[4][1] for call in bench.simulator.calls if call[0] == "load"] == [
        *(sign, 2 * sign, 3 * sign)
    ]
    assert not bench.events


def test_a_load_that_is_not_renewed_is_removed_once_and_that_is_said():
    bench = Bench(FREE)
    bench.wrench(T0 + 100 * MS, (1, 0, 0))
    bench.run(T0, T0 + 1200 * MS)
    (first, _), (last, force) = forces(bench)
    assert (last - first, force) == (500, 0.0)
    assert bench.events == {"load_removed": 1}
    assert bench.session.journal.last_event == "load tip: no message for 0.5 s; removed"


def test_a_late_load_acts_from_now_on_and_that_is_said():
    bench = Bench(FREE)
    bench.run(T0, T0 + 500 * MS)
    bench.wrench(T0 + 300 * MS, (1, 0, 0), arrival=T0 + 500 * MS)
    bench.run(T0 + 500 * MS, T0 + 520 * MS)
    assert [force for _, force in forces(bench)] == [1.0]
    assert bench.events == {"late": 1}


def test_a_new_simulator_gets_what_is_held():
    bench = Bench(FREE)
    bench.wrench(T0 + 100 * MS, (1, 0, 0))
    bench.run(T0, T0 + 300 * MS)
    before = bench.simulator
    bench.session.reconfigure(bench.scene.with_values({"discretization.control_points": 6}))
    assert bench.simulator is not before
    assert [force for _, force in forces(bench)] == [1.0]
