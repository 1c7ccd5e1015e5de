"""The report writer, the machine's facts, the operation counter and the stopwatch."""

import csv

import numpy as np
import pytest

from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import arithmetic, machine, plotting
from dlo_sim.studies.arithmetic import Counting
from dlo_sim.studies.report import Report, shown
from dlo_sim.studies.stopwatch import step_cost


@pytest.fixture
def report(tmp_path):
    return Report(tmp_path / "new" / "folder", "A study", "dlo_sim study x", {})


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
    report.table("numbers", ["a", "**b**"], [[1, 0.1234567890123], [2, None]], "Some numbers")
    figure, (axes,) = plotting.new_figure()
    axes.plot([0, 1], [0, 1])
    report.figure("line", figure, {"x [m]": [0.0, 1.0], "y [m]": np.array([0.0, 1.0])}, "A line")
    path = report.write(["First page."])
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
        assert list(csv.reader(stream))[0] == ["x [m]", "y [m]"]


def test_columns_of_different_length_are_refused(report):
    figure, _ = plotting.new_figure()
    with pytest.raises(ValueError, match="lengths"):
        report.figure("bad", figure, {"x": [0.0], "y": [0.0, 1.0]}, "")


def test_animation_is_a_gif_of_its_frames(tmp_path):
    figure, (axes,) = plotting.new_figure(width=2.0, height=2.0)
    (line,) = axes.plot([0.0, 1.0], [0.0, 0.0])
    seen = []

    def draw(frame):
        seen.append(frame)
        line.set_ydata([0.0, frame])

    plotting.animate(tmp_path / "moving.gif", figure, draw, 3, 10)
    assert seen == [0, 1, 2]
    assert (tmp_path / "moving.gif").read_bytes().startswith(b"GIF8")


def test_machine_facts_name_versions_and_commit(monkeypatch, tmp_path):
    facts = machine.facts()
    assert facts["numpy"] == np.__version__
    assert facts["commit"]
    monkeypatch.setattr(machine, "ROOT", tmp_path)
    assert machine.commit() == "not run from a checkout"
    (tmp_path / ".git").mkdir()
    assert "unknown" in machine.commit()


def test_counting_numbers_count():
    Counting.operations = 0
    x, y = Counting(3.0), Counting(4.0)
    result = np.sqrt(np.array([x * x + y * y], dtype=object))[0]
    assert result.value == 5.0
    assert Counting.operations == 4
    assert (2.0 - (-x) / 2 - 1.0 / y).value == pytest.approx(3.25)
    assert Counting.operations == 8


def test_operations_of_a_sample_are_a_plausible_number():
    wire = load_scene(shipped_scene("paper_wire"), {"integrator.method": "forest_ruth"})
    plane = Simulator(wire)
    space = Simulator(wire.with_values({"terms.out_of_plane": "on"}))
    # r' and r'' alone take 9 operations per coordinate, the gradient's rows 10 more
    assert 2 * 19 < arithmetic.operations_per_sample(plane) < 120
    assert arithmetic.operations_per_sample(space) > arithmetic.operations_per_sample(plane) + 19
    stretch_only = Simulator(wire.with_values({"terms.bend": "off", "integrator.step": 1e-6}))
    assert arithmetic.operations_per_sample(stretch_only) < arithmetic.operations_per_sample(plane)


def test_step_cost_resets_and_refuses_a_failed_run():
    wire = load_scene(shipped_scene("paper_wire"), {"integrator.method": "velocity_verlet"})
    simulator = Simulator(wire)
    cost = step_cost(simulator, 1e-4, 3)
    assert 0.0 < cost.best <= cost.median
    assert simulator.steps == 0
    wild = Simulator(wire.with_values({"integrator.step": 1e-3}), unchecked_step=True)
    with pytest.raises(RuntimeError, match="timing a run that failed"):
        step_cost(wild)
