"""`dlo_sim demo`: report and exit status, with a demo that is made up; the real one has tests."""

from dataclasses import replace
from pathlib import Path

import pytest

from dlo_sim.cli.main import main
from dlo_sim.demo import demo

MADE = demo.DemoSummary(
    scene="d/scene.yaml",
    input="d/input",
    predicted="d/predicted",
    messages_used=41,
    real_time_factor=88.0,
    notes=["no picture: matplotlib is missing; pip install matplotlib"],
    try_next={"live": "ros2 run dlo_sim node"},
)
PARTS = ("d/predicted", "41 messages used", "88 x real", "pip install matplotlib")
FAILED = {"status": "diverged", "message": "the energy grew at 1.2 s"}


@pytest.mark.parametrize(
    ("changes", "status", "parts"), [({}, 0, PARTS), (FAILED, 3, (FAILED["message"],))]
)
def test_report_says_what_was_made_and_what_to_try_next(
    monkeypatch, capsys, changes, status, parts
):
    folders = []

    def made_up(folder, *, progress=None):
        folders.append(folder)
        return replace(MADE, **changes)

    monkeypatch.setattr(demo, "run_demo", made_up)
    assert main(["demo"]) == status
    assert folders == [Path("dlo_sim_demo")]
    shown = capsys.readouterr().out
    assert all(part in shown for part in parts)
    assert shown.splitlines()[-1].split() == ["live", "ros2", "run", "dlo_sim", "node"]


def test_refused_folder_is_one_line(tmp_path, capsys):
    (tmp_path / "x").touch()
    assert main(["demo", "--output", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"dlo_sim: error: --output: {tmp_path} holds x")
