"""The process around the node: signals while it starts, and a machine without ROS."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from threading import Event

import pytest

from dlo_sim.ros.main import DONE, REFUSED, Terminated, Termination, main

WITHOUT_ROS = """
import sys
for name in ("rclpy", "rcl_interfaces", "geometry_msgs"):
    sys.modules[name] = None
from dlo_sim.ros.main import main
sys.exit(main([]))
"""


def test_without_ros_one_line_names_the_cure() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == REFUSED
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "pip install 'dlo_sim[ros]'" in line


def test_help_names_the_params_file(capsys: pytest.CaptureFixture[str]) -> None:
    handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    assert main(["--help"]) == DONE
    assert "--params-file" in capsys.readouterr().out
    for number, handler in zip(
        (signal.SIGINT, signal.SIGTERM, signal.SIGALRM), handlers, strict=True
    ):
        signal.signal(number, handler)


@pytest.fixture
def termination() -> Iterator[Termination]:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = {number: signal.getsignal(number) for number in numbers}
    termination = Termination()
    termination.install()
    yield termination
    termination.only_note()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_starting_is_raised_until_it_is_heard(
    termination: Termination, number: int
) -> None:
    with pytest.raises(Terminated):
        signal.raise_signal(number)
    # As if a callback from C had swallowed it.
    with pytest.raises(Terminated):
        Event().wait(20.0)
    assert termination.requested


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_after_the_start_is_only_noted(termination: Termination, number: int) -> None:
    termination.only_note()
    assert not termination.requested
    signal.raise_signal(number)
    assert termination.requested
