"""`dlo_sim study paper --quick`, run once: everything is there, and its numbers make sense."""

import json
from pathlib import Path

import numpy as np
import pytest
from study_tables import rows_of

from dlo_sim.cli.main import main
from dlo_sim.studies.paper import published

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def study(tmp_path_factory, pytestconfig):
    """Folder and JSON of one quick study."""
    folder = tmp_path_factory.mktemp("study") / "paper"
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")
    capture.suspend_global_capture()
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("dlo_sim.cli.study.print_json", lambda values: lines.append(_dumps(values)))
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, path, **_: path.touch())
        status = main(["study", "paper", "--output", str(folder), "--quick", "--json"])
    capture.resume_global_capture()
    assert status == 0
    return folder, json.loads(lines[0])


def _dumps(values) -> str:
    return json.dumps(values, default=float)


def first(claim) -> float:
    """The number that decides a claim."""
    return next(iter(claim["measured"].values()))


def measured(folder: Path) -> dict[str, float]:
    return {row["what"]: float(row["value"]) for row in rows_of(folder, "measured")}


def test_every_claim_has_its_evidence_in_the_report(study):
    folder, outcome = study
    report = (folder / "report.md").read_text(encoding="utf-8")
    made = {*outcome["tables"], *(Path(name).stem for name in outcome["figures"])}
    for claim in outcome["claims"]:
        assert report.count(f"- {claim['name']}: **{claim['verdict']}**") == 1
        assert claim["measured"].items() <= measured(folder).items()
        assert not np.isnan(list(claim["measured"].values())).any()
        assert np.isfinite(first(claim))
        assert claim["shown"] and set(claim["shown"]) <= made
    for name in outcome["figures"]:
        assert f"]({name})" in report
        data = rows_of(folder, Path(name).stem)
        assert len(data) >= 4 and all(value != "" for row in data for value in row.values())
    assert " nan " not in report


def test_verdicts_that_do_not_depend_on_the_machine(study):
    claims = {claim["name"]: claim for claim in study[1]["claims"]}
    largest = claims["2 ms is the largest stable step"]
    assert largest["verdict"] == "does not hold"
    assert first(largest) == pytest.approx(135.5, rel=0.01)
    for name in (
        "the symplectic method is the most stable",
        "Runge-Kutta and Zhai are stuck in scenario 2",
        "Zhai is the slowest",
        "C++ is three times as fast as MATLAB",
    ):
        assert claims[name]["verdict"] == "does not hold"
    assert claims["no secular energy error"]["verdict"] == "holds"
    errors = claims["the error falls with n_u"]["measured"]
    assert errors["rms error, n_u = 13 [mm]"] < 0.2 * errors["rms error, n_u = 5 [mm]"]
    planar = claims["in scenario 1 y is zero and mirrored points coincide"]
    assert planar["verdict"] == "holds"


def test_tables_of_run_times_are_the_papers_beside_ours(study):
    for number, printed in enumerate(
        (published.MATLAB_1, published.MATLAB_2, published.CPP_1, published.CPP_2), start=1
    ):
        rows = rows_of(study[0], f"table_{number}")
        columns = [name for name in rows[0] if name.startswith("paper,")]
        for name, times in zip(columns, printed.values(), strict=False):
            assert [float(row[name]) for row in rows[:-1]] == times.tolist()
        ours = [name for name in rows[0] if name.startswith(("numpy", "compiled"))]
        for name in ours:
            times = [float(row[name]) for row in rows[:-1]]
            assert times == sorted(times)
            # 5000 steps of 2 ms instead of some hundred times as many
            assert 0.0 < float(rows[-1][name]) < 0.1 * times[-1]
        marks = [row["simulated [s]"] for row in rows if "CHANGED" in row["simulated [s]"]]
        assert len(marks) == 1 and "at 2 ms" in marks[0] and "EA and springs" in marks[0]


def test_sweeps_are_the_papers_beside_ours(study):
    sweeps = (
        published.SWEEP_MATLAB_1,
        published.SWEEP_MATLAB_2,
        published.SWEEP_CPP_1,
        published.SWEEP_CPP_2,
    )
    for number, sweep in enumerate(sweeps, start=5):
        for row, printed in zip(rows_of(study[0], f"table_{number}"), sweep, strict=True):
            cells = list(row.values())[1:]
            assert [cell.partition(" / ")[0] for cell in cells] == [f"{t:.0f}" for t in printed]
            ours = [[float(word) for word in cell.split(" / ")[1:]] for cell in cells]
            assert {len(times) for times in ours} == {1}
            assert all(0.0 < min(times) for times in ours)


def test_rows_at_the_papers_own_steps_say_what_was_changed(study):
    rows = {row["n_u"]: row for row in rows_of(study[0], "paper_sweep_step")}
    assert all(float(row["0.8 ms / limit"]) > 20.0 for row in rows.values())
    # At 19 control points bending alone is too stiff; below, the axial term has to be softened.
    assert float(rows["19"]["limit of bending alone [us]"]) < 800.0
    assert "bending alone" in rows["19"]["0.8 ms would need"]
    for n in ("5", "7", "9", "11", "13"):
        assert rows[n]["0.8 ms would need"].startswith("EA and springs / ")
        assert rows[n]["run time of 10 s so changed"].endswith(" s")
    changed = [row["changed"] for row in rows_of(study[0], "paper_step")]
    assert changed.count("nothing") == 2
    assert all("EA" in text or "mass" in text for text in changed if text != "nothing")


def test_torsion_stops_scenario_2_at_the_papers_step_and_not_scenario_1(study):
    outcomes = {
        (row["model"], row["scenario"]): [row[m] for m in ("forest_ruth", "rk4", "zhai")]
        for row in rows_of(study[0], "torsion_at_paper_step")
    }
    for number in ("1", "2"):
        assert outcomes["no torsion", number] == ["finishes"] * 3
    torsion = "torsion theta' - gamma"
    assert outcomes[torsion, "1"] == ["finishes"] * 3
    assert all(text.startswith("stopped at step") for text in outcomes[torsion, "2"])


def test_position_errors_of_the_regular_wire_grow_linearly(study):
    rows = {row["method"]: row for row in rows_of(study[0], "energy_regular")}
    for method in ("forest_ruth", "velocity_verlet", "zhai"):
        assert float(rows[method]["exponent of its growth"]) == pytest.approx(1.0, abs=0.1)
        assert rows[method]["drifts?"] == "no"
    assert float(rows["rk4"]["exponent of its growth"]) > 1.15
    assert rows["rk4"]["drifts?"] == "yes" and float(rows["rk4"]["slope [1/s]"]) < 0.0


def test_observed_limits_are_the_predicted_ones(study):
    for row in rows_of(study[0], "stable_steps"):
        assert float(row["observed [us]"]) == pytest.approx(float(row["predicted [us]"]), rel=0.01)
        assert "stopped at" in row["the paper's step, 2 ms"]


def test_interpreted_and_compiled_agree(study):
    assert 0.0 < measured(study[0])["interpreted from compiled run after 20 steps [m]"] < 1e-13


def test_motion_of_the_figures_is_that_of_the_wire(study):
    data = [row for row in rows_of(study[0], "scenario_1_z") if row["shown"] == "whole run"]
    left, middle, right = (
        1e-3 * np.array([float(row["z [mm]"]) for row in data if row["control point"] == name])
        for name in ("q3", "q5", "q7")
    )
    assert middle[0] == 0.0
    assert -0.05 < middle.min() < -0.02
    assert np.abs(left - right).max() < 1e-9


def test_error_map_falls_with_control_points(study):
    rows = {row["n_u \\ n_s"]: row for row in rows_of(study[0], "error_by_size")}
    assert float(rows["13"]["101"]) < 0.5 * float(rows["9"]["101"]) < float(rows["7"]["101"])
    assert float(rows["19"][str(published.REFERENCE[1])]) == 0.0


def test_identities_behind_the_claims(study):
    found = measured(study[0])
    assert 0.0 < found["Zhai's positions from Verlet's [m]"] < 1e-9
