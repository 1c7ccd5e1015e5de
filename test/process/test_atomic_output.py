"""Outputs that are whole or absent, and what killed processes leave."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dlo_sim.process.atomic_output import AtomicOutput, remove_leftovers

WRITER = """
import sys
from pathlib import Path
from dlo_sim.process.atomic_output import AtomicOutput
partial = AtomicOutput(Path(sys.argv[1]))
partial.path.write_text("half")
print("writing", flush=True)
sys.stdin.read()
"""


def entries(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def writer() -> Iterator[Callable[[Path], subprocess.Popen[str]]]:
    """Starts a process that is writing an output, and goes on with it."""
    processes = []

    def start(target: Path) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(target)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout is not None and process.stdout.readline() == "writing\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def test_a_file_appears_whole_and_replaces_the_one_before(tmp_path):
    target = tmp_path / "run.npz"
    target.write_text("before")
    partial = AtomicOutput(target)
    partial.path.write_text("after")
    assert target.read_text() == "before"
    partial.commit()
    assert target.read_text() == "after"
    assert entries(tmp_path) == ["run.npz"]


def test_the_next_run_removes_what_a_killed_one_left(tmp_path, writer):
    process = writer(tmp_path / "out [1]")  # a name that a pattern would read otherwise
    process.kill()
    process.wait()
    assert len(entries(tmp_path)) == 1, "a killed process leaves its part"
    AtomicOutput(tmp_path / "another").discard()
    AtomicOutput(tmp_path / "out").discard()
    assert len(entries(tmp_path)) == 1, "it is of another output"
    AtomicOutput(tmp_path / "out [1]").discard()
    assert entries(tmp_path) == []


def test_what_another_process_is_writing_stays(tmp_path, writer):
    first, second = writer(tmp_path / "out"), writer(tmp_path / "out")
    assert len(entries(tmp_path)) == 2
    remove_leftovers(tmp_path / "out")
    assert len(entries(tmp_path)) == 2
    first.kill()
    first.wait()
    remove_leftovers(tmp_path / "out")
    (left,) = tmp_path.iterdir()
    assert [path.read_text() for path in left.iterdir()] == ["half"]
    second.kill()
    second.wait()
    remove_leftovers(tmp_path / "out")
    assert entries(tmp_path) == []


def test_what_is_not_ours_stays(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / ".out.12345678.dlo_sim").mkdir()
    (tmp_path / ".out.12345678.dlo_sim" / "thesis.tex").write_text("years of work")
    (tmp_path / ".out.abcdefgh.dlo_sim").write_text("a file")
    (tmp_path / ".out.bcdefghi.dlo_sim").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".out.backup").mkdir()
    (tmp_path / ".out.too_long_to_be_ours.dlo_sim").mkdir()
    before = entries(tmp_path)
    remove_leftovers(tmp_path / "out")
    assert entries(tmp_path) == before
    assert entries(tmp_path / ".out.12345678.dlo_sim") == ["thesis.tex"]
