"""The report writer, charts, the facts of a machine, and the timing of steps."""

import csv
from pathlib import Path

import numpy as np
import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request
from dlo_sim.studies import report as report_module
from dlo_sim.studies.report import Report, draw, new_figure, shown
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
def test_cells_for_people(cell, text):
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
    wire = load_scene(shipped_scene("paper_wire"), {"integrator.method": "velocity_verlet"})
    simulator = Simulator(wire)
    cost = step_cost(simulator, 1e-4, 3)
    assert 0.0 < cost.best and 0.0 <= cost.spread
    assert simulator.steps == 0
    wild = Simulator(wire.with_values({"integrator.step": 1e-3}), unchecked_step=True)
    with pytest.raises(RuntimeError, match="timing a run that failed"):
        step_cost(wild)


def test_a_chart_has_a_panel_and_a_line_for_each_name(report, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        report_module, "draw", lambda axes, lines, *rest: drawn.append((lines, *rest))
    )
    rows = [["here", "rk4", 1.0, 0.1], ["here", "zhai", 2.0, 0.2], ["there", "rk4", 4.0, 0.4]]
    report.chart("errors", "where | method | time [s] | error [%]", rows, "Errors", "xy")
    assert [(lines, title) for lines, _, _, _, title, _ in drawn] == [
        ({"rk4": [[1.0, 10.0]], "zhai": [[2.0, 20.0]]}, "here"),
        ({"rk4": [[4.0, 40.0]]}, "there"),
    ]
    assert [rest[1:4] for rest in drawn] == [("time [s]", "error [%]", "xy")] * 2
    monkeypatch.undo()
    _, (axes,) = new_figure()
    draw(axes, drawn[0][0], "time [s]", "error [%]", "xy")
    assert [list(line.get_ydata()) for line in axes.lines] == [[10.0], [20.0]]
    assert (axes.get_xlabel(), axes.get_yscale()) == ("time [s]", "log")


def test_maps_and_bars_show_the_values_of_their_rows(report, monkeypatch):
    figures = []
    monkeypatch.setattr(report, "figure", lambda name, figure, caption: figures.append(figure))
    report.heat_map("map", "n | m | rms [mm] {:.1f}", [[2, 1, 1e-3], [1, 1, 0.0], [1, 3, 2e-3]], "")
    report.bars("bars", "method | step [us]", [["rk4", 2e-6], ["zhai", 5e-6]], "")
    heat, bars = (figure.axes[0] for figure in figures)
    # Rows ascend upwards; a missing cell and one of 0 have no number.
    assert heat.images[0].get_array().tolist() == [[0.0, 2.0], [1.0, 0.0]]
    assert [text.get_text() for text in heat.texts] == ["2.0", "1.0"]
    assert [bar.get_width() for bar in bars.patches] == [2.0, 5.0]


def test_nothing_is_written_over(report):
    report.table("soak", "a", [[1]], "A table")
    with pytest.raises(ValueError, match="soak.csv: is written already"):
        report.chart("soak", "a | x | y", [["b", 1.0, 2.0]], "A figure of the same name")
