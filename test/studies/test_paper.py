"""`dlo_sim study paper --quick`, run once: everything is there, and its numbers make sense."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from dlo_sim.cli.main import main
from dlo_sim.studies.paper import published

pytestmark = pytest.mark.slow

FIGURES = {
    "scenario_1_x.png",
    "scenario_1_z.png",
    "scenario_2_x.png",
    "scenario_2_y.png",
    "scenario_2_z.png",
    "scenario_1_shapes.png",
    "scenario_2_shapes.png",
    "scenario_1_animation.gif",
    "scenario_2_animation.gif",
    "scenario_2_parting.png",
    "run_time.png",
    "stable_steps_chart.png",
    "zhai_map.png",
    "cost_over_size.png",
    "energy_real_chart.png",
    "energy_regular_chart.png",
    "error_growth.png",
    "work_precision.png",
    "error_over_time_and_length.png",
    "error_over_samples_and_points.png",
    "error_over_time.png",
    "error_over_length.png",
    "frenet_breakdown.png",
    "moment_curvature.png",
}
ROWS = {
    **{f"table_{k}": 19 for k in (1, 2, 3, 4)},
    **{f"table_{k}": 6 for k in (5, 6, 7, 8)},
    "arithmetic": 2,
    "cost_per_step": 8,
    "cost_fits": 16,
    "stable_sweep": 6,
    "stable_steps": 8,
    "limit_by_term": 6,
    "paper_step": 10,
    "orders": 4,
    "time_at_equal_error": 4,
    "energy_real": 8,
    "energy_regular": 4,
    "error_by_size": 7,
    "frenet_floor": 8,
    "claims": 13,
}


@pytest.fixture(scope="session")
def study(tmp_path_factory, pytestconfig):
    """Folder and JSON of one quick study."""
    folder = tmp_path_factory.mktemp("study") / "paper"
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")
    capture.suspend_global_capture()
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("dlo_sim.cli.study.print_json", lambda values: lines.append(_dumps(values)))
        status = main(["study", "paper", "--output", str(folder), "--quick", "--json"])
    capture.resume_global_capture()
    assert status == 0
    return folder, json.loads(lines[0])


def _dumps(values) -> str:
    return json.dumps(values, default=float)


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_figure_is_there_with_its_data(study):
    folder, outcome = study
    assert set(outcome["figures"]) == FIGURES
    for name in FIGURES:
        assert (folder / name).stat().st_size > 5_000
        data = rows_of(folder, name.rpartition(".")[0])
        assert len(data) >= 4
        assert all(value != "" for row in data for value in row.values())
    signatures = {(folder / name).read_bytes()[:4] for name in FIGURES}
    assert signatures == {b"\x89PNG", b"GIF8"}


def test_every_table_has_its_rows(study):
    folder, outcome = study
    assert outcome["tables"] == ROWS
    for name, count in ROWS.items():
        assert len(rows_of(folder, name)) == count


def test_report_stands_on_its_own(study):
    folder, outcome = study
    report = (folder / "report.md").read_text(encoding="utf-8")
    for claim in outcome["claims"]:
        assert report.count(f"- {claim['name']}: **{claim['verdict']}**") == 1
        assert np.isfinite(claim["number"])
        assert "nan" not in claim["evidence"]
    for name in FIGURES:
        assert f"]({name})" in report
    for word in ("processor", "numpy", "numba", "commit", "config/paper_wire.yaml", "--quick"):
        assert word in report
    # every table of the paper is beside ours, with the paper's own numbers
    for number in ("473.2", "2205", "182.5", "388", "455 / ", "2787 / "):
        assert number in report
    assert " nan " not in report


def test_verdicts_that_do_not_depend_on_the_machine(study):
    claims = {claim["name"]: claim for claim in study[1]["claims"]}
    assert claims["2 ms"]["verdict"] == "does not hold"
    assert claims["2 ms"]["number"] == pytest.approx(135.5, rel=0.01)
    assert claims["most stable"]["verdict"] == "does not hold"
    assert claims["RK4 and Zhai stuck in scenario 2"]["verdict"] == "does not hold"
    assert claims["no secular energy error"]["verdict"] == "holds"
    assert claims["y is zero, mirrored points coincide"]["verdict"] == "holds"


def test_observed_limits_are_the_predicted_ones(study):
    for row in rows_of(study[0], "stable_steps"):
        assert float(row["observed [us]"]) == pytest.approx(float(row["predicted [us]"]), rel=0.01)
        assert "stopped at" in row["the paper's step, 2 ms"]


def test_measured_orders(study):
    for row in rows_of(study[0], "orders"):
        assert float(row["measured"]) == pytest.approx(float(row["order"]), abs=0.15)


def test_interpreted_and_compiled_agree(study):
    report = (study[0] / "report.md").read_text(encoding="utf-8")
    sentence = report[report.index("steps it is within") :].split()
    assert float(sentence[4]) < 1e-13


def test_motion_of_the_figures_is_that_of_the_wire(study):
    data = rows_of(study[0], "scenario_1_z")
    middle = np.array([float(row["z of q5 [m]"]) for row in data])
    left, right = (np.array([float(row[f"z of q{k} [m]"]) for row in data]) for k in (3, 7))
    assert middle[0] == 0.0
    assert -0.05 < middle.min() < -0.02
    assert np.abs(left - right).max() < 1e-9


def test_error_map_falls_with_control_points(study):
    rows = {row["n_u \\ n_s"]: row for row in rows_of(study[0], "error_by_size")}
    assert float(rows["13"]["101"]) < 0.5 * float(rows["9"]["101"]) < float(rows["7"]["101"])
    assert float(rows["19"][str(published.REFERENCE[1])]) == 0.0


def test_plastic_strip_follows_the_closed_form(study):
    data = rows_of(study[0], "moment_curvature")
    simulated = np.array([float(row["simulated curvature [1/m]"]) for row in data])
    exact = np.array([float(row["closed form [1/m]"]) for row in data])
    assert np.abs(simulated - exact).max() < 0.03 * exact.max()
    assert exact[-1] == pytest.approx(2.0)
