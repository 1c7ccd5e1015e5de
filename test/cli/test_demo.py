"""`dlo_sim demo`: report and exit status, with a demo that is made up; the real one has tests."""

from pathlib import Path

import pytest

from dlo_sim.cli.main import main
from dlo_sim.demo import demo


@pytest.fixture
def runner(monkeypatch):
    """Stands in for the demo; `result` is returned or raised, `folders` remembers where."""

    class StandIn:
        def __init__(self):
            self.folders = []
            self.result = demo.DemoSummary(
                scene="d/scene.yaml",
                input="d/input",
                predicted="d/predicted",
                messages_used=41,
                real_time_factor=88.0,
                notes=["no picture: matplotlib is missing; pip install matplotlib"],
                try_next={"live": "ros2 run dlo_sim node"},
            )

        def __call__(self, output_dir, *, progress=None):
            self.folders.append(output_dir)
            if isinstance(self.result, Exception):
                raise self.result
            return self.result

    stand_in = StandIn()
    monkeypatch.setattr(demo, "run_demo", stand_in)
    return stand_in


def test_report_says_what_was_made_and_what_to_try_next(runner, capsys):
    assert main(["demo"]) == 0
    assert runner.folders == [Path("dlo_sim_demo")]
    shown = capsys.readouterr().out
    for part in ("d/predicted", "41 messages used", "88 x real", "pip install matplotlib"):
        assert part in shown
    assert shown.splitlines()[-1].split() == ["live", "ros2", "run", "dlo_sim", "node"]


def test_failed_demo_is_reported(runner, capsys):
    runner.result.status, runner.result.message = "diverged", "the energy grew at 1.2 s"
    assert main(["demo"]) == 3
    assert "the energy grew at 1.2 s" in capsys.readouterr().out


def test_refused_folder_is_one_line(runner, capsys):
    runner.result = demo.DemoError("d holds x, which is not of a demo; give an empty folder")
    assert main(["demo", "--output", "d"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("dlo_sim: error: --output: d holds x")
