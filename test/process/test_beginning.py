"""Commands whose standard streams are closed by whoever starts them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CLOSED = ["2>&-", ">&-", "<&- >&- 2>&-"]
SIMULATE = ["simulate", "paper_wire", "--duration", "0.001", "--set", "integrator.step=1e-5"]


def run(arguments: list[str], closed: str, folder: Path) -> subprocess.CompletedProcess[bytes]:
    command = ["bash", "-c", f'exec "$@" {closed}', "bash", sys.executable, "-m", "dlo_sim"]
    return subprocess.run([*command, *arguments], capture_output=True, cwd=folder, timeout=120)


def test_what_is_closed_changes_neither_status_nor_files(tmp_path: Path) -> None:
    done = run([*SIMULATE, "--output", "run.npz"], CLOSED[-1], tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    with np.load(tmp_path / "run.npz") as file:
        assert len(file["time"]) > 0
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.parametrize("closed", CLOSED)
def test_a_refusal_goes_to_stderr_or_nowhere(closed: str, tmp_path: Path) -> None:
    done = run(["simulate", "nowhere.yaml", "--duration", "1"], closed, tmp_path)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.count(b"\n") == (0 if "2>&-" in closed else 1)


def test_names_that_are_not_utf8(tmp_path: Path) -> None:
    name = b"\xff\n.npz"
    done = run([*SIMULATE, "--output", os.fsdecode(name)], "", tmp_path)
    assert (done.returncode, done.stderr) == (0, b"")
    assert os.listdir(os.fsencode(tmp_path)) == [name]
    done = run(["view", os.fsdecode(name)], "", tmp_path)
    assert (done.returncode, done.stderr) == (0, b"")
    done = run(["simulate", os.fsdecode(name), "--duration", "1"], "", tmp_path)
    assert done.returncode == 2 and done.stderr.count(b"\n") == 1


LOOK = """
import os, sys
from dlo_sim.process.beginning import begin
begin()
import numpy
numpy.ones((600, 600)) @ numpy.ones((600, 600))
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(os.cpu_count() == 1, reason="one core has one thread anyway")
@pytest.mark.parametrize(("given", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_linear_algebra_has_one_thread_unless_the_user_says_so(
    given: dict[str, str], threads: int
) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    look = [sys.executable, "-c", LOOK]
    done = subprocess.run(look, env=environment | given, capture_output=True, check=True)
    assert int(done.stdout) == threads
