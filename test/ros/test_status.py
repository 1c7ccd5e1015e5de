"""The node's own diagnostic status; tick statistics on made-up clocks."""

import pytest

from dlo_sim.ros.status import ClockWatch, TickTimes, node_status

MS = 1_000_000


def test_late_publications_are_a_warning() -> None:
    assert "4 publications" in node_status(TickTimes(late=4), 0, 1e-3, ClockWatch(), []).message


def test_regular_ticks_are_counted_and_timed() -> None:
    times = TickTimes()
    for k in range(10):
        clock = k * 5 * MS
        times.record(clock, clock, clock + MS, clock + 2 * MS, 10, 5 * MS)
    values, _ = times.report(50 * MS, step=5e-4)
    assert (values["ticks"], values["dropped ticks"], values["late ticks"]) == ("10", "0", "0")
    assert float(values["tick time mean [ms]"]) == pytest.approx(2.0)
    assert float(values["tick time max [ms]"]) == pytest.approx(2.0)
    assert float(values["step time mean [us]"]) == pytest.approx(100.0)
    assert float(values["real-time factor"]) == pytest.approx(5.0)  # 5 ms simulated in 1 ms
    assert float(values["tick rate [Hz]"]) == pytest.approx(200.0)
    assert float(values["load"]) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("gap", "dropped", "late"), [(7, 0, 0), (10, 1, 0), (12, 1, 0), (13, 2, 1), (50, 9, 1)]
)
def test_a_gap_counts_as_dropped_and_late_ticks(gap: int, dropped: int, late: int) -> None:
    times = TickTimes()
    times.record(0, 0, 0, 0, 1, 5 * MS)
    times.record(gap * MS, 0, 0, 0, 1, 5 * MS)
    assert (times.dropped, times.late) == (dropped, late)
    assert [times.report(100 * MS, step=1e-3)[1] for _ in range(2)] == [late, 0]


def test_an_interruption_is_no_gap() -> None:
    times = TickTimes()
    times.record(0, 0, 0, 0, 1, 5 * MS)
    times.interrupt()
    times.record(1000 * MS, 0, 0, 0, 1, 5 * MS)
    assert (times.ticks, times.dropped, times.late) == (2, 0, 0)


def test_every_report_begins_a_new_interval() -> None:
    times = TickTimes()
    times.record(0, 0, 4 * MS, 4 * MS, 1, 5 * MS)
    times.report(5 * MS, step=1e-3)
    values, _ = times.report(10 * MS, step=1e-3)
    assert values["ticks"] == "1"
    assert float(values["tick time max [ms]"]) == 0.0
    assert float(values["real-time factor"]) == 0.0
