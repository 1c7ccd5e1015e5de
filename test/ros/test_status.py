"""The node's own diagnostic status."""

from dlo_sim.ros.status import ClockWatch, node_status
from dlo_sim.session.diagnostics import OK, WARN


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
    calm = node_status({}, 0, "", 0, {"/pose": 1, "/wrench": 0})
    assert calm.level == OK
    crowded = node_status({"ticks": "7"}, 0, "", 3, {"/pose": 1, "/wrench": 2})
    assert crowded.level == WARN
    assert "2 publishers on /wrench" in crowded.message
    values = dict(crowded.values)
    assert values["publishers on /wrench"] == "2"
    assert values["ticks"] == "7"
    assert values["clock jumps"] == "3"


def test_late_publications_are_a_warning() -> None:
    assert "4 publications" in node_status({}, 4, "", 0, {}).message
