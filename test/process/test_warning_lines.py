"""Warnings of commands and their workers are one line each; the Python API keeps Python's own."""

import subprocess
import sys
import textwrap

import pytest

CALL = """
import sys, warnings
from dlo_sim.batch.workers import open_workers

def work(*ignored):
    warnings.warn("cable.length: 1e9 m; \\n   shorten it")
    warnings.warn("overflow encountered in multiply", RuntimeWarning)
    with open_workers(processes=2) as workers:
        list(workers.map(warnings.warn, ["end.position: in a worker; move it"]))
    return 0
"""
AS_COMMAND = """
from dlo_sim import __main__
from dlo_sim.{room} import main
main.main = work
if __name__ == "__main__":
    sys.exit(__main__.{entry}())
"""
AS_LIBRARY = """
if __name__ == "__main__":
    work()
"""
LINES = [
    "dlo_sim: warning: cable.length: 1e9 m; shorten it",
    "dlo_sim: warning: RuntimeWarning: overflow encountered in multiply",
    "dlo_sim: warning: end.position: in a worker; move it",
]


def stderr_of(tmp_path, code, *options):
    """What a program prints on stderr; it must succeed."""
    path = tmp_path / "program.py"
    path.write_text(textwrap.dedent(code), encoding="utf-8")
    done = subprocess.run([sys.executable, *options, path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stderr.splitlines()


@pytest.mark.parametrize(
    ("room", "entry", "options", "lines"),
    [("cli", "main", (), LINES), ("ros", "node", (), LINES), ("cli", "main", ("-W", "ignore"), [])],
)
def test_commands_warn_in_lines_unless_filtered(tmp_path, room, entry, options, lines):
    command = CALL + AS_COMMAND.format(room=room, entry=entry)
    assert stderr_of(tmp_path, command, *options) == lines


def test_the_python_api_warns_as_python_does(tmp_path):
    said = "\n".join(stderr_of(tmp_path, CALL + AS_LIBRARY))
    assert "UserWarning: cable.length" in said and "program.py:6" in said
    assert "UserWarning: end.position" in said and "dlo_sim: warning" not in said
