"""`dlo_sim replay`: arguments, report and exit status, with a replay that is made up."""

import json
import math
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from bag_files import write_bag
from progress import rises, shown_progress

from dlo_sim.cli.main import main
from dlo_sim.demo import scenario
from dlo_sim.replay import replay
from dlo_sim.replay.comparison import AxisComparison

JSON_KEYS = {"status", "message", "messages_used", "messages_refused", "real_time_factor"}
ARGUMENTS = ["replay", "in.bag", "--params", "hanging_cable", "--output", "out.bag"]


MADE = replay.ReplaySummary(
    output="out.bag",
    messages_used=600,
    messages_refused=3,
    refused_by_reason={"not_finite": 2, "too_fast": 1},
    simulated_s=9.9,
    wall_s=0.1,
    real_time_factor=99.0,
)


@pytest.fixture
def replayed(monkeypatch, capsys):
    """`replayed(*options, **changes)`: exit status, both outputs and what the replay was asked for,
    where it makes MADE with these changes."""

    def run(*options, **changes):
        asked = []

        def made_up(bag, scene, output, *, compare=None, progress=None):
            asked.extend((bag, scene, output, compare))
            return replace(MADE, **changes)

        monkeypatch.setattr(replay, "replay_bag", made_up)
        status = main([*ARGUMENTS, *options])
        return status, *capsys.readouterr(), asked

    return run


def test_arguments_reach_the_replay(replayed):
    *_, asked = replayed("--set", "rate=100", "--compare", "start=/ft_compensated")
    bag, scene, output, compare = asked
    assert (bag, output) == (Path("in.bag"), Path("out.bag"))
    assert scene.rate == 100.0 and scene.start.pose_topic == "/gripper_pose"
    assert compare == {"start": "/ft_compensated"}


def test_report_for_people_with_the_comparison(replayed):
    numbers = dict.fromkeys(AxisComparison.__dataclass_fields__, 0.5)
    comparison = {"start": [AxisComparison(**{**numbers, "axis": "x"})]}
    status, shown, *_ = replayed(comparison=comparison, warnings=["a silence of 5.0 s"])
    assert status == 0
    for part in ("done, 9.900 s", "600 messages", "not_finite: 2", "99 x real", "silence of 5.0"):
        assert part in shown
    assert any(line.startswith("start ") for line in shown.splitlines())


def test_json_is_the_last_line_and_strict(replayed):
    status, shown, *_ = replayed("--json", real_time_factor=math.inf)
    values = json.loads(shown.splitlines()[-1])
    assert status == 0 and JSON_KEYS <= set(values)
    assert (values["messages_used"], values["messages_refused"]) == (600, 3)
    assert values["real_time_factor"] is None


@pytest.mark.parametrize("kind", ["diverged", "truncated", "refused"])
def test_part_of_a_replay_is_reported_with_its_reason(replayed, kind):
    status, out, err, _ = replayed(status=kind, message="only 3.2 s could be used")
    assert status == 3 and "only 3.2 s could be used" in out
    assert err == f"dlo_sim: {kind}: only 3.2 s could be used\n"


def test_a_refused_bag_is_one_line(tmp_path, capsys):
    write_bag(tmp_path / "bag", [], {})
    command = ["replay", str(tmp_path / "bag"), "--params", "hanging_cable", "--json"]
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("dlo_sim: error: ") and err.count("\n") == 1


def written(folder, duration):
    """A bag of the demo's motion, so long [s], and its scene."""
    bag, scene = folder / "bag", folder / "scene.yaml"
    scene.write_text(scenario.SCENE)
    return write_bag(bag, scenario.messages(duration), scenario.TOPICS), scene


def test_a_real_replay_shows_its_progress(tmp_path, monkeypatch):
    bag, scene = written(tmp_path, 4.0)
    shown = shown_progress(monkeypatch, "replay")
    assert main(["replay", str(bag), "--params", str(scene)]) == 0
    assert rises(shown), shown


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """A bag of five minutes, and its scene."""
    return written(tmp_path_factory.mktemp("long"), 300.0)


@pytest.fixture
def replaying(long, tmp_path):
    """Starts a real replay that takes long; returns it once it is writing."""
    bag, scene = long
    (tmp_path / "out").mkdir()
    command = [sys.executable, "-m", "dlo_sim", "replay", str(bag), "--params", str(scene)]
    command += ["--output", str(tmp_path / "out" / "predicted")]
    processes = []

    def start() -> subprocess.Popen:
        before = parts()
        processes.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        end = time.monotonic() + 60.0
        while parts() <= before and time.monotonic() < end:
            assert processes[-1].poll() is None
        assert len(parts()) == 1
        return processes[-1]

    def parts() -> set:
        return {path.name for path in (tmp_path / "out").iterdir()}

    yield start, parts
    for process in processes:
        process.kill()
        process.communicate()


def test_a_replay_that_is_ended_leaves_nothing(replaying):
    start, parts = replaying
    process = start()
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 128 + signal.SIGTERM
    assert [line for line in errors.splitlines() if "compiling" not in line] == [
        "dlo_sim: interrupted"
    ]
    assert parts() == set()
