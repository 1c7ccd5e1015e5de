"""`dlo_sim forecast` says how many control points it took, its error, and what cures it."""

import json

import pytest

from dlo_sim.cli.main import main

PLAN = """times: [0.0, 0.5]
end: [[0.8, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0], [0.75, 0.05, 0.5, 0.0, 0.0, 0.0, 1.0]]
"""


@pytest.mark.parametrize(("number", "advised"), [(0, False), (11, True)])
def test_forecast_tells_its_error(tmp_path, capsys, number, advised):
    plan = tmp_path / "plan.yaml"
    plan.write_text(PLAN, encoding="utf-8")
    arguments = ["forecast", "two_grippers", "--plan", str(plan), "--json"]
    assert main([*arguments, "--set", f"discretization.control_points={number}"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["error_estimate"]["total"] > 0.0
    assert (facts["error_estimate"]["total"] > 1e-3) is advised
    assert ("raise discretization.control_points to " in facts["advice"]) is advised
    assert ("as the scene asks" in facts["resolution"]) is (number > 0)
    assert main([*arguments, "--set", "accuracy.estimate=off"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["error_estimate"] is None and not facts["advice"]
