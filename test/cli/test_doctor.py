"""`dlo_sim doctor`: what it prints and how it ends."""

import json
import sys
from types import SimpleNamespace

import pytest

from dlo_sim.cli.main import main
from dlo_sim.doctor import findings
from dlo_sim.doctor.findings import note, ok, problem
from dlo_sim.scene.loading import scene_from_values


@pytest.mark.parametrize(
    ("found", "status"),
    [([ok("fine")], 0), ([ok("fine"), note("odd", "look")], 0), ([problem("bad", "mend")], 3)],
)
def test_status_says_whether_there_is_a_problem(monkeypatch, capsys, found, status):
    monkeypatch.setattr(findings, "examined", lambda scene, seconds, tell: iter(found))
    assert main(["doctor"]) == status
    shown = capsys.readouterr().out
    for level, what, cure in found:
        assert f"{level:<7}  {what}\n" in shown
        assert (f"-> {cure}\n" in shown) == bool(cure)
    assert main(["doctor", "--json"]) == status
    (line,) = capsys.readouterr().out.splitlines()
    assert [entry["level"] for entry in json.loads(line)["findings"]] == [f.level for f in found]


def test_a_scene_that_asks_for_tf2_where_there_is_none(monkeypatch):
    survey = pytest.importorskip("dlo_sim.ros.survey", reason="needs rclpy")
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    monkeypatch.setattr(survey, "survey", lambda session, seconds: survey.Survey("rmw"))

    def levels(values):
        session = SimpleNamespace(scene=scene_from_values(values))
        found = list(findings.of_ros(session, 0.1))
        return {finding.level: finding.cure for finding in found}

    found = levels({"start.tf_frame": "tool0"})
    assert found["problem"].startswith("start.tf_frame: needs tf2, which cannot be imported")
    assert found["note"].endswith("ros2 run tf2_ros tf2_echo world FRAME")
    assert levels({}) == {"ok": ""}
