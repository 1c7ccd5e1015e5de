"""`dlo_sim view`: formats, where it writes, what it refuses."""

import json
import sys

import numpy as np
import pytest

from dlo_sim.cli.main import main


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A recording of five times in a folder that is the present one."""
    monkeypatch.chdir(tmp_path)
    line = np.cumsum(np.ones((5, 20, 3)), axis=1) * 0.01
    arrays = {"time": 0.1 * np.arange(5), "control_points": np.ones((5, 6, 4)), "centerline": line}
    np.savez("run.npz", **arrays)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "name", "begin"),
    [
        ((), "run.html", b"<!DOCTYPE html>"),
        (("--output", "look.html"), "look.html", b"<!DOCTYPE html>"),
        (("--output", "look.GIF"), "look.GIF", b"GIF8"),
        (("--output", "look.png"), "look.png", b"\x89PNG"),
        (("--format", "plots"), "run_plots.png", b"\x89PNG"),
        (("--format", "png", "--output", "look"), "look", b"\x89PNG"),
    ],
)
def test_format_by_ending_or_by_name(run, capsys, arguments, name, begin):
    if not name.endswith(".html"):
        pytest.importorskip("matplotlib")
    assert main(["view", "run.npz", *arguments, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["output"] == name
    assert (report["times"], report["duration_s"]) == (5, pytest.approx(0.4))
    assert (run / name).read_bytes().startswith(begin)
    assert {path.name for path in run.iterdir()} == {"run.npz", name}


def test_without_matplotlib_the_cure_is_named(run, capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "dlo_sim.view.film", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.animation", None)
    assert main(["view", "run.npz", "--format", "gif"]) == 2
    assert "needs matplotlib; pip install matplotlib, or make html" in capsys.readouterr().err
    assert main(["view", "run.npz"]) == 0
