"""The node's own diagnostic status; tick statistics on made-up clocks."""

import pytest

from dlo_sim.ros.status import ClockWatch, InputSources, TickTimes, node_status
from dlo_sim.session.diagnostics import OK, WARN

MS = 1_000_000
POSE, WRENCH = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/WrenchStamped"


def test_a_running_clock_is_no_problem() -> None:
    watch = ClockWatch()
    watch.look(1_000, 1.0)
    watch.look(2_000, 2.0)
    assert watch.problem == ""


def test_a_clock_that_has_not_begun() -> None:
    watch = ClockWatch()
    watch.look(0, 1.0)
    assert "no /clock has come" in watch.problem


def test_a_clock_that_stands_still_and_goes_on() -> None:
    watch = ClockWatch()
    watch.look(1_000, 1.0)
    watch.look(1_000, 4.0)
    assert "stood still for 3 s" in watch.problem
    watch.look(1_001, 5.0)
    assert watch.problem == ""


def test_two_publishers_are_a_warning() -> None:
    calm = node_status(TickTimes(), 0, 1e-3, ClockWatch(), [InputSources("/pose", POSE, 1)])
    assert calm.level == OK
    sources = [InputSources("/pose", POSE, 1), InputSources("/wrench", WRENCH, 2)]
    watch = ClockWatch()
    watch.jumps = 3
    crowded = node_status(TickTimes(ticks=7), 0, 1e-3, watch, sources)
    assert crowded.level == WARN
    assert "2 publishers on /wrench" in crowded.message
    values = dict(crowded.values)
    assert values["publishers on /wrench"] == "2"
    assert values["ticks"] == "7"
    assert values["clock jumps"] == "3"


def test_a_publisher_of_another_type_is_told_with_both_types() -> None:
    source = InputSources("/pose", POSE, 1, [("/left/arm", WRENCH)])
    status = node_status(TickTimes(), 0, 1e-3, ClockWatch(), [source])
    assert status.level == WARN
    assert f"/left/arm publishes {WRENCH} on /pose, the input takes {POSE}" in status.message
    assert "mix" not in status.message


def test_a_clock_that_is_no_time_is_counted() -> None:
    watch = ClockWatch()
    taken = [watch.accept(*time) for time in [(0, 0), (2**31 - 1, 10**9 - 1), (-1, 5), (1, 10**9)]]
    assert taken == [True, True, False, False]
    watch.look(1_000, 1.0)
    assert "2 times on /clock refused, last sec 1, nanosec 1000000000" in watch.problem
    watch.look(2_000, 2.0)
    assert watch.problem == ""
    assert dict(node_status(TickTimes(), 0, 1e-3, watch, []).values)["clock refused"] == "2"


def test_late_publications_are_a_warning() -> None:
    assert "4 publications" in node_status(TickTimes(late=4), 0, 1e-3, ClockWatch(), []).message


def test_regular_ticks() -> None:
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
def test_gaps(gap: int, dropped: int, late: int) -> None:
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
