"""The node's own diagnostic status."""

from dlo_sim.ros.status import ClockWatch, InputSources, node_status
from dlo_sim.session.diagnostics import OK, WARN

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
    calm = node_status({}, 0, ClockWatch(), [InputSources("/pose", POSE, 1)])
    assert calm.level == OK
    sources = [InputSources("/pose", POSE, 1), InputSources("/wrench", WRENCH, 2)]
    watch = ClockWatch()
    watch.jumps = 3
    crowded = node_status({"ticks": "7"}, 0, watch, sources)
    assert crowded.level == WARN
    assert "2 publishers on /wrench" in crowded.message
    values = dict(crowded.values)
    assert values["publishers on /wrench"] == "2"
    assert values["ticks"] == "7"
    assert values["clock jumps"] == "3"


def test_a_publisher_of_another_type_is_told_with_both_types() -> None:
    source = InputSources("/pose", POSE, 1, [("/left/arm", WRENCH)])
    status = node_status({}, 0, ClockWatch(), [source])
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
    assert dict(node_status({}, 0, watch, []).values)["clock refused"] == "2"


def test_late_publications_are_a_warning() -> None:
    assert "4 publications" in node_status({}, 4, ClockWatch(), []).message
