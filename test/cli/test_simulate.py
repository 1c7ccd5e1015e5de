"""`dlo_sim simulate`: arguments, files, report and exit status, with a made-up recording."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import types
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from dlo_sim.cli.main import main
from dlo_sim.scene.loading import shipped_scene

JSON_KEYS = {
    *("status", "simulated_s", "wall_s", "compile_s", "steps", "step_s", "method"),
    *("choice", "resolution", "force_evaluations", "real_time_factor", "energy_error_max"),
    *("error_estimate", "advice", "active_terms", "left_out"),
}


@dataclass
class MadeUp:
    """What `record` returns, made up."""

    status: str = "ok"
    message: str = ""
    simulated_s: float = 0.5
    wall_s: float = 0.25
    compile_s: float = 1.5
    steps: int = 500
    step_s: float = 1e-3
    method: str = "forest_ruth"
    choice: str = "as the scene asks"
    resolution: str = "9 control points as the scene asks"
    advice: str = ""
    obstacles: dict = field(default_factory=dict)
    force_evaluations: int = 1500
    real_time_factor: float = 2.0
    energy_error_max: float | None = 1e-6
    error_estimate: dict | None = None
    active_terms: tuple = ("bend", "gravity")
    left_out: dict = field(default_factory=lambda: {"twist": "nothing twists"})
    contacts: dict = field(default_factory=dict)
    slides: dict = field(default_factory=dict)
    notes: tuple = ()
    ok: bool = True
    interrupted: bool = False
    time: Any = field(default_factory=lambda: np.linspace(0.0, 0.5, 6))
    control_points: Any = field(default_factory=lambda: np.ones((6, 9, 4)))
    centerline: Any = field(default_factory=lambda: np.ones((6, 50, 3)))
    centerline_u: Any = field(default_factory=lambda: np.linspace(0.0, 2.0, 50))
    tension: Any = None
    peak_tension: float | None = None
    curvature: Any = field(default_factory=lambda: np.zeros((6, 50)))
    energy: Any = field(default_factory=lambda: np.zeros(6))


@pytest.fixture
def recorder(monkeypatch):
    """Stands in for the simulation; `result` is returned, `calls` remembers what was asked."""
    stand_in = types.ModuleType("dlo_sim.simulation.recording")
    stand_in.calls = []
    stand_in.result = MadeUp()

    def record(scene, duration, every, progress, tell):
        stand_in.calls.append((scene, duration, every))
        for i in range(11):
            progress(i / 10.0)
        return stand_in.result

    stand_in.record = record
    monkeypatch.setitem(sys.modules, "dlo_sim.simulation.recording", stand_in)
    return stand_in


def refused(capsys, *arguments: str) -> str:
    """The one line with which these arguments are refused."""
    assert main(["simulate", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("dlo_sim: error: ") and err.count("\n") == 1
    return err


def test_scene_by_name_with_overrides(recorder):
    overrides = ["--set", "discretization.control_points=13", "--set", "integrator.step=1e-5"]
    assert main(["simulate", "paper_wire", "--duration", "0.5", *overrides]) == 0
    ((scene, duration, every),) = recorder.calls
    assert scene.discretization.control_points == 13
    assert scene.integrator.step == 1e-5
    assert (duration, every) == (0.5, 1e-3)


def test_output_holds_the_arrays_under_the_name_given(recorder, tmp_path, capsys):
    path = tmp_path / "run.data"
    assert main(["simulate", "paper_wire", "--duration", "0.5", "--output", str(path)]) == 0
    with np.load(path) as written:
        shapes = {"control_points", "centerline", "centerline_u", "curvature"}
        assert set(written) == {"time", "energy"} | shapes, "no tension that is not known"
        np.testing.assert_array_equal(written["time"], recorder.result.time)
        assert written["control_points"].shape == (6, 9, 4)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.data"], "nothing else is left"
    assert "run.data (6 times, 9 control points)" in capsys.readouterr().out


def test_report_for_people(recorder, capsys):
    assert main(["simulate", "paper_wire", "--duration", "0.5"]) == 0
    shown = capsys.readouterr().out
    for part in ("ok, 0.5 s", "forest_ruth, step 1000 us", "2 x real", "1.00e-06", "bend, gravity"):
        assert part in shown
    assert "twist: nothing twists" in shown


def test_json_is_the_last_line_and_complete(recorder, capsys):
    assert main(["simulate", "paper_wire", "--duration", "0.5", "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert JSON_KEYS <= set(values)
    assert values["active_terms"] == ["bend", "gravity"]
    assert values["left_out"] == {"twist": "nothing twists"}


def test_json_is_strict_where_numbers_are_not_finite(recorder, capsys):
    recorder.result = MadeUp(
        energy_error_max=math.nan,
        real_time_factor=math.inf,
        steps=np.int64(3),
        wall_s=np.float64(1),
    )

    def no_constant(text):
        raise AssertionError(f"{text} is not JSON")

    assert main(["simulate", "paper_wire", "--duration", "0.5", "--json"]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    values = json.loads(line, parse_constant=no_constant)
    assert values["energy_error_max"] is None
    assert values["real_time_factor"] is None
    assert (values["steps"], values["wall_s"]) == (3, 1.0)


def test_failed_run_keeps_what_was_good(recorder, tmp_path, capsys):
    recorder.result = MadeUp(status="diverged", message="energy grew at 0.3 s", ok=False)
    path = tmp_path / "run.npz"
    arguments = ["simulate", "paper_wire", "--duration", "0.5", "--output", str(path)]
    assert main(arguments) == 3
    assert path.is_file()
    assert "energy grew at 0.3 s" in capsys.readouterr().out
    assert main([*arguments, "--json"]) == 3
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (values["status"], values["message"]) == ("diverged", "energy grew at 0.3 s")


@pytest.mark.parametrize("duration", ["0", "-1", "nan", "inf", "soon"])
def test_impossible_duration(recorder, capsys, duration):
    message = refused(capsys, "paper_wire", "--duration", duration)
    assert "--duration" in message and "give seconds" in message
    assert recorder.calls == []


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere"], "'nowhere' is not a shipped scene"),
        (["paper_wire", "--set", "cable.lenght=1"], "did you mean cable.length?"),
        (["paper_wire", "--set", "cable.length"], "is not an assignment"),
        (["paper_wire", "--set", "rate=1", "--set", "rate=2"], "--set rate is given twice"),
        (["paper_wire", "--set", "cable.length=nan"], "cable.length: 'nan' is not a number"),
        (["paper_wire", "--set", "cable.length=.nan"], "cable.length: nan is not finite"),
        (["paper_wire", "--every", "0"], "--every"),
        (["paper_wire", "--every", "1e-9"], "would record"),
    ],
)
def test_refused_input(recorder, capsys, tmp_path, arguments, complaint):
    path = tmp_path / "run.npz"
    assert complaint in refused(capsys, *arguments, "--duration", "1", "--output", str(path))
    assert recorder.calls == []
    assert not path.exists()


def test_unwritable_output_is_refused_before_the_run(recorder, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "fifo")
    for output, complaint in [
        (tmp_path / "no" / "run.npz", "does not exist; create it first"),
        (tmp_path / "file" / "run.npz", "does not exist; create it first"),
        (tmp_path, "is not a regular file"),
        (tmp_path / "fifo", "is not a regular file"),
        ("/proc/run.npz", "cannot be written"),
    ]:
        message = refused(capsys, "paper_wire", "--duration", "1", "--output", str(output))
        assert complaint in message and str(output) in message
    assert recorder.calls == []


def test_output_never_replaces_the_scene(recorder, capsys, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(shipped_scene("paper_wire").read_text())
    before = scene.read_text()
    message = refused(capsys, str(scene), "--duration", "1", "--output", str(scene))
    assert "would replace what is read; give another name" in message
    assert recorder.calls == [] and scene.read_text() == before


def test_disk_that_fills_up_keeps_the_old_file(recorder, capsys, tmp_path, monkeypatch):
    path = tmp_path / "run.npz"
    path.write_text("the run before")

    def full(stream, **arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    message = refused(capsys, "paper_wire", "--duration", "1", "--output", str(path))
    assert "No space left on device" in message
    assert path.read_text() == "the run before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]


def test_no_progress_bar_beside_a_terminal(recorder, capsys):
    assert main(["simulate", "paper_wire", "--duration", "0.5"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_one_line_when_machine_code_is_missing(recorder, capsys, monkeypatch, terminal):
    """Between what goes to a terminal, or the only line of a service; never on stdout."""
    from dlo_sim.compiling import directory

    def record(*arguments, **options):
        for name in ("one", "another"):
            with directory.kept(name):
                pass
        return make_up(*arguments, **options)

    make_up = recorder.record
    recorder.record = record
    monkeypatch.setattr(directory, "_said", set())
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    assert main(["simulate", "paper_wire", "--duration", "0.5", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "ok" and out.count("\n") == 1
    kept = directory.base_directory()
    line = f"dlo_sim: compiling, once per installation, some 25 s, kept in {kept}\n"
    assert err.count("compiling") == 1 and line in err
    assert err == line or terminal
    assert main(["simulate", "paper_wire", "--duration", "0.5"]) == 0
    assert "compiling" not in capsys.readouterr().err, "a warm start"


def test_what_was_recorded_is_kept_when_interrupted(tmp_path):
    """Steps of a nanosecond take minutes: it says so, and Ctrl-C is no loss."""
    path = tmp_path / "run.npz"
    options = ["--duration", "0.02", "--every", "1e-6", "--set", "integrator.step=1e-9"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dlo_sim", "simulate", "paper_wire", *options, "--json"]
        + ["--output", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    lines = iter(process.stderr.readline, "")
    told = next(line for line in lines if "compiling" not in line)
    assert re.match("dlo_sim: 20000000 steps of 1 ns, about .* (s|min); ", told)
    assert "energy_momentum would take 8 steps of 2.5 ms (--set integrator.method=auto" in told
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60.0)
    assert (process.returncode, err) == (130, "")
    report = json.loads(out)
    assert report["status"] == "interrupted" and report["message"].startswith("interrupted at")
    with np.load(path) as run:
        assert 0 < len(run["time"]) == len(run["energy"]) == len(run["control_points"])
        assert run["time"][-1] <= report["simulated_s"] < run["time"][-1] + 1e-6
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("incomplete_machine_code")
def test_first_and_second_run_of_a_user(tmp_path):
    """One line where something has to be compiled, none where all of it was kept; and code that was
    just compiled gives the bits of code that was kept."""
    command = [sys.executable, "-m", "dlo_sim", "simulate", "paper_wire", "--duration", "0.01"]
    shapes = []

    def run() -> tuple[str, str]:
        path = tmp_path / f"{len(shapes)}.npz"
        more = ["--json", "--output", str(path)]
        done = subprocess.run([*command, *more], capture_output=True, text=True, check=True)
        with np.load(path) as made:
            shapes.append(made["control_points"].tobytes())
        return done.stdout, done.stderr

    out, err = run()
    assert json.loads(out)["status"] == "ok"
    assert err.startswith("dlo_sim: compiling") and err.count("\n") == 1
    out, err = run()
    assert json.loads(out)["status"] == "ok"
    assert err == ""
    assert shapes[0] == shapes[1]


def test_real_run_from_the_command_to_the_file(tmp_path, capsys):
    """Nothing made up: the paper's wire for 20 ms, sampled at exactly the times asked for."""
    path = tmp_path / "run.npz"
    arguments = ["simulate", "paper_wire", "--duration", "0.02", "--every", "0.005"]
    assert main([*arguments, "--output", str(path), "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert set(values) >= JSON_KEYS
    assert values["status"] == "ok" and values["method"] == "forest_ruth"
    assert values["steps"] * values["step_s"] == pytest.approx(values["simulated_s"])
    assert "gravity" in values["active_terms"] and "twist" in values["left_out"]
    with np.load(path) as run:
        np.testing.assert_allclose(run["time"], [0.0, 0.005, 0.01, 0.015, 0.02], atol=1e-15)
        assert run["control_points"].shape == (5, 9, 4)
        assert run["centerline"].shape == (5, 50, 3)
        assert (run["centerline_u"][0], run["centerline_u"][-1]) == (0.0, 2.0)
        assert run["energy"].shape == (5,)
        # The middle falls freely, z = -g t^2 / 2, but for the bending waves from the ends (which
        # nine control points carry too fast): 0.15 mm when this was written.
        middle = run["control_points"][:, 4, 2]
        np.testing.assert_allclose(middle, -9.81 * run["time"] ** 2 / 2.0, atol=3e-4)
        assert middle[-1] < -1.5e-3


def test_real_simulator_refuses_in_one_line(capsys, tmp_path):
    path = tmp_path / "run.npz"
    arguments = ["paper_wire", "--duration", "1", "--output", str(path)]
    for setting in ("integrator.step=0.002", "damping.stiffness=0.1", "integrator.method=eulr"):
        message = refused(capsys, *arguments, "--set", setting)
        assert setting.split("=")[0] in message
    assert not path.exists()


COLUMN = """
/**:
  ros__parameters:
    cable: {length: 0.5, diameter: 0.006, density: 1150.0, youngs_modulus: 2.0e+6}
    start: {clamped: true, tangent: [0.0, 0.0, 1.0]}
    damping: {stiffness: 0.01, air_drag: 0.005}
    discretization: {control_points: 13, stretch: span}
    initial: {shape: straight}
    accuracy: {estimate: "off"}
"""


def test_a_column_that_folds_ends_with_status_3_and_a_cure(tmp_path, capsys):
    """1e4 m/s^2 along a clamped cable, towards its clamp: it is simulated to the end, and folds."""
    path = tmp_path / "column.yaml"
    path.write_text(COLUMN, encoding="utf-8")
    command = ["simulate", str(path), "--duration", "0.02", "--json"]
    assert main([*command, "--set", "gravity=[0, 0, -1e4]"]) == 3
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert values["status"] == "unresolved"
    assert values["simulated_s"] == pytest.approx(0.02, rel=0.05)
    assert values["message"].startswith("at u = 0")
    assert "a fold or cusp" in values["message"]
    assert "raise discretization.control_points from 13 to 23" in values["message"]
    assert main([*command[:-1], "--set", "gravity=[0, 0, -1e4]"]) == 3
    assert capsys.readouterr().out.splitlines()[1].strip() == values["message"]
    assert main([*command, "--set", "gravity=[0, 0, -9.81]"]) == 0
