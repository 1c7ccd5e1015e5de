"""What subcommands refuse: in one line on stderr, before any work, and nothing is written."""

import os
import shlex

import pytest

from dlo_sim.cli.main import main
from dlo_sim.scene.loading import shipped_scene

SIMULATE = "simulate paper_wire --duration 1 --output run.npz"
TUNE = "tune paper_wire --tolerance 1e-3 --duration 0.3 --output tuned.yaml"
IDENTIFY = "identify missing.npz --scene two_grippers --output fitted.yaml"
REPLAY = "replay in.bag --params hanging_cable --output out.bag"
LONG = "n" * 300
REFUSED = {  # command line -> what its line says
    "": "required: SUBCOMMAND; see 'dlo_sim --help'",
    "simulat": "invalid choice: 'simulat'",
    "simulate": "required: SCENE, --duration; see 'dlo_sim simulate --help'",
    "parameters --wrong": "--wrong",
    "simulate nowhere --duration 1": "'nowhere' is not a shipped scene",
    f"{SIMULATE} --set cable.lenght=1": "did you mean cable.length?",
    f"{SIMULATE} --set cable.length": "is not an assignment",
    f"{SIMULATE} --set rate=1 --set rate=2": "--set rate is given twice",
    f"{SIMULATE} --set cable.length=nan": "cable.length: 'nan' is not a number",
    f"{SIMULATE} --set cable.length=.nan": "cable.length: nan is not finite",
    f"{SIMULATE} --every 0": "--every",
    f"{SIMULATE} --every 1e-9": "would record",
    **{
        f"simulate paper_wire --duration {one}": "give seconds"
        for one in ("0", "-1", "nan", "inf", "soon")
    },
    f"{SIMULATE} --set integrator.step=0.002": "integrator.step",
    f"{SIMULATE} --set integrator.method=eulr": "integrator.method",
    f"{SIMULATE} --set damping.stiffness=0.1": "damping.stiffness",
    f"{SIMULATE} --output no/run.npz": "no/run.npz: the folder ",
    f"{SIMULATE} --output file/run.npz": "does not exist; create it first",
    f"{SIMULATE} --output .": "is not a regular file",
    f"{SIMULATE} --output fifo": "is not a regular file",
    f"{SIMULATE} --output /proc/run.npz": "/proc/run.npz cannot be written",
    f"{SIMULATE} --output {LONG}.npz": "File name too long",
    "simulate mine.yaml --duration 1 --output mine.yaml": "would replace what is read; give",
    f"replay {LONG} --params hanging_cable": "File name too long",
    "replay in.bag": "required: --params",
    **{f"{REPLAY} --compare {one}": "--compare" for one in ("start", "start=", "=/x")},
    f"{REPLAY} --compare start=/a --compare start=/b": "--compare start is given twice",
    "study papers --output x": "papers",
    "study paper": "--output",
    "study paper --output file/below": "is not a folder",
    f"study paper --quick --output {LONG}": "File name too long",
    "doctor two_gripers": "did you mean two_grippers?",
    "doctor two_grippers --set cable.length=-1": "cable.length",
    "doctor --set cable.length=1": "give SCENE, too",
    "doctor --seconds 0": "--seconds",
    "view no.npz": "no.npz: cannot be read",
    "view run.npz --output look.avi": "end it with .html, .gif, .mp4 or .png",
    "view run.npz --output no/look.html": "does not exist; create it first",
    "view run.npz --set cable.length=2": "give --params SCENE, too",
    "view run.npz --params two_gripers": "did you mean two_grippers?",
    "view .": "bag",
    f"{TUNE} --tolerance 0": "above zero",
    f"{TUNE} --tolerance nan": "above zero",
    f"{TUNE} --tolerance tight": "give metres",
    f"{TUNE} --tolerance 2.5": "not below the cable's length",
    f"{TUNE} --duration -1": "above zero",
    f"{TUNE} --duration 1e300": "1e+09 at most",
    f"{TUNE} --set cable.lenght=1": "cable.length",
    f"{TUNE} --output /nowhere/at/all.yaml": "does not exist",
    "tune mine.yaml --tolerance 1e-3 --duration 1 --output mine.yaml": "would replace what is read",
    f"{IDENTIFY} --fit cable.length --set cable.length=1.0": "--fit cable.length: --set gives it",
    f"{IDENTIFY} --leave-out 1": "give 0 or more, below 1",
    f"{IDENTIFY} --topic here": "--topic 'here' is not NAME=TOPIC",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The present folder, with a file, a pipe and a scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "mine.yaml").write_bytes(shipped_scene("paper_wire").read_bytes())
    return tmp_path


@pytest.mark.parametrize("command", REFUSED)
def test_one_line_and_nothing_written(folder, capsys, command):
    assert main(shlex.split(command)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("dlo_sim: error: ") and err.count("\n") == 1
    assert REFUSED[command] in err
    assert {path.name for path in folder.iterdir()} == {"file", "fifo", "mine.yaml"}
    assert (folder / "mine.yaml").read_bytes() == shipped_scene("paper_wire").read_bytes()
