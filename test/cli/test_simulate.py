"""`dlo_sim simulate`: files, report and exit status."""

import json
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from dlo_sim.cli.main import main

JSON_KEYS = {
    *("status", "simulated_s", "wall_s", "compile_s", "steps", "step_s", "method"),
    *("choice", "resolution", "force_evaluations", "real_time_factor", "energy_error_max"),
    *("error_estimate", "advice", "active_terms", "left_out"),
}


def test_a_run_from_the_command_to_the_file(tmp_path, capsys):
    """The wire for 20 ms, sampled at exactly the times asked for, as JSON and for people."""
    path = tmp_path / "run.data"
    arguments = ["simulate", "paper_wire", "--duration", "0.02", "--every", "0.005"]
    arguments += ["--set", "integrator.step=1e-5", "--output", str(path)]
    assert main([*arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == "", "no progress bar beside a terminal"
    values = json.loads(out.splitlines()[-1])
    assert set(values) >= JSON_KEYS
    assert values["status"] == "ok" and values["method"] == "forest_ruth"
    assert (values["steps"], values["step_s"], values["simulated_s"]) == (2000, 1e-5, 0.02)
    assert "gravity" in values["active_terms"] and "twist" in values["left_out"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.data"], "nothing else is left"
    with np.load(path) as run:
        np.testing.assert_allclose(run["time"], [0.0, 0.005, 0.01, 0.015, 0.02], atol=1e-15)
        assert run["control_points"].shape == (5, 9, 4)
        assert run["centerline"].shape == (5, 50, 3)
        assert (run["centerline_u"][0], run["centerline_u"][-1]) == (0.0, 2.0)
        assert run["tension"].shape == run["curvature"].shape == (5, 50)
        assert run["energy"].shape == (5,)
        # The middle falls freely, z = -g t^2 / 2, but for the bending waves from the ends (which
        # nine control points carry too fast): 0.15 mm when this was written.
        middle = run["control_points"][:, 4, 2]
        np.testing.assert_allclose(middle, -9.81 * run["time"] ** 2 / 2.0, atol=3e-4)
        assert middle[-1] < -1.5e-3
    assert main(arguments) == 0
    shown = capsys.readouterr().out
    for part in ("ok, 0.02 s", "forest_ruth, step 10 us", "x real", "gravity", "twist: nothing"):
        assert part in shown
    assert "run.data (5 times, 9 control points)" in shown


def test_disk_that_fills_up_keeps_the_old_file(capsys, tmp_path, monkeypatch):
    path = tmp_path / "run.npz"
    path.write_text("the run before")

    def full(stream, **arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    assert main(["simulate", "paper_wire", "--duration", "0.01", "--output", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "No space left on device" in err
    assert path.read_text() == "the run before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]


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
    output = ["--output", str(tmp_path / "run.npz")]
    command = ["simulate", str(path), "--duration", "0.02", *output, "--json"]
    assert main([*command, "--set", "gravity=[0, 0, -1e4]"]) == 3
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert values["status"] == "unresolved" and (tmp_path / "run.npz").is_file()
    assert values["simulated_s"] == pytest.approx(0.02, rel=0.05)
    assert values["message"].startswith("at u = 0")
    assert "a fold or cusp" in values["message"]
    assert "raise discretization.control_points from 13 to 23" in values["message"]
    assert main([*command[:-1], "--set", "gravity=[0, 0, -1e4]"]) == 3
    assert capsys.readouterr().out.splitlines()[1].strip() == values["message"]
    assert main([*command, "--set", "gravity=[0, 0, -9.81]"]) == 0
