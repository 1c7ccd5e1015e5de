"""The report writer, charts, the facts of a machine, and the timing of steps."""

import csv
from pathlib import Path

import numpy as np
import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request
from dlo_sim.studies import report as report_module
from dlo_sim.studies.report import Report, shown
from dlo_sim.studies.runs import bisected, step_cost


@pytest.fixture
def report(tmp_path):
    return Report(
        Request(tmp_path / "new" / "folder", True, "dlo_sim study x", HERE), "A study", {}
    )


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (None, "-"),
        ("word", "word"),
        (7, "7"),
        (0.0, "0"),
        (10.0, "10"),
        (473.18, "473.2"),
        (20678.4, "20678"),
        (1.2345e-7, "1.23e-07"),
        (float("inf"), "none"),
        (float("nan"), "nan"),
    ],
)
def test_numbers_in_cells_are_short_enough_for_people(cell, text):
    assert shown(cell) == text


def test_tables_and_figures_leave_markdown_and_data(report):
    report.section("Part")
    report.text("Two\n    lines.", "Second.")
    report.table("numbers", "a | **b**", [[1, 0.1234567890123], [2, None]], "Some numbers")
    report.chart("line", "what | x [mm] | y [m]", [["a", 0.0, 0.0], ["a", 1.0, 1.0]], "A line")
    path = Path(report.outcome({}, ["First page."]).report)
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# A study\n\nFirst page.")
    assert "## Part\n\nTwo lines.\n\nSecond." in text
    assert "| 1 | 0.1235 |\n| 2 | - |" in text
    assert "`dlo_sim study x`" in text
    assert "![A line](line.png)" in text
    assert report.tables == {"numbers": 2}
    assert report.figures == ["line.png"]
    with (path.parent / "numbers.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [["a", "b"], ["1", "0.1234567890123"], ["2", ""]]
    with (path.parent / "line.csv").open(newline="") as stream:
        assert list(csv.reader(stream))[::2] == [
            ["what", "x [mm]", "y [m]"],
            ["a", "1000.0", "1.0"],
        ]


def test_machine_facts_name_versions_and_commit(monkeypatch, tmp_path):
    facts = report_module.facts()
    assert facts["numpy"] == np.__version__
    assert facts["commit"]
    monkeypatch.setattr(report_module, "ROOT", tmp_path)
    assert report_module.commit() == "not run from a checkout"
    (tmp_path / ".git").mkdir()
    assert "unknown" in report_module.commit()


def test_values_in_si_are_shown_in_the_unit_of_their_column(report):
    header = "method | step [us] | off [%] {:.0f} | cost [us/step]"
    report.table("t", header, [["rk4", 2e-6, 0.123, 1e-6], ["none", None, float("inf"), "-"]], "T")
    with (report.folder / "t.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["method", "step [us]", "off [%]", "cost [us/step]"]
    assert rows[1] == ["rk4", "2.0", "12.3", "1.0"]
    text = Path(report.outcome({}).report).read_text(encoding="utf-8")
    assert "| rk4 | 2 | 12 | 1 |\n| none | - | none | - |" in text
    with pytest.raises(ValueError):
        report.table("short", header, [["rk4"]], "")


def test_the_largest_value_that_holds_is_bracketed():
    found = bisected(lambda x: x <= 3.0, 1.0, 10.0, 1e-3)
    assert 3.0 / 1.001 <= found <= 3.0


def test_step_cost_resets_and_refuses_a_failed_run():
    wire = load_scene("paper_wire", {"integrator.method": "velocity_verlet"})
    simulator = Simulator(wire)
    cost = step_cost(simulator, 1e-4, 3)
    assert 0.0 < cost.best and 0.0 <= cost.spread
    assert simulator.steps == 0
    wild = Simulator(wire.with_values({"integrator.step": 1e-3}), unchecked_step=True)
    with pytest.raises(RuntimeError, match="timing a run that failed"):
        step_cost(wild)


def test_nothing_is_written_over(report):
    report.table("soak", "a", [[1]], "A table")
    with pytest.raises(ValueError, match="soak.csv: is written already"):
        report.chart("soak", "a | x | y", [["b", 1.0, 2.0]], "A figure of the same name")
