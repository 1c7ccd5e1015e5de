"""Signals, with real processes: nothing is raised where they come, and cleanup is done."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec

import pytest

SOON = 60.0  # [s]
SIGINT, SIGTERM, SIGHUP = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
BEGIN = """
import os, signal, sys, threading
from dlo_sim.process import stopping
"""
IN_A_CALLBACK = """
import ctypes
seen = []

def compare(one, other):
    os.kill(os.getpid(), int(sys.argv[1]))
    while not stopping.requested():
        pass
    seen.append(one)  # an exception before here would be lost in the library
    return 0

def work():
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    ctypes.CDLL(None).qsort((ctypes.c_int * 2)(2, 1), 2, 4, kind(compare))
    assert len(seen) == 1
    stopping.check()
"""
NEVER_LOOKS = """
from pathlib import Path
stopping.GRACE = 0.1

def work():
    with stopping.cleanup(Path(sys.argv[2]).unlink):
        os.kill(os.getpid(), int(sys.argv[1]))
        threading.Event().wait()
"""
ENDS_ITSELF = """
import time
stopping.GRACE = 0.01

def work():
    stopping.disable_forced_exit()
    os.kill(os.getpid(), int(sys.argv[1]))
    os.kill(os.getpid(), int(sys.argv[1]))  # as `timeout` does
    end = time.monotonic() + 50.0 * stopping.GRACE
    while time.monotonic() < end:
        pass
    assert stopping.requested()
    print("kept")
    return 7
"""
IS_ASKED_AGAIN = """
from pathlib import Path
stopping.GRACE = 0.01

def work():
    stopping.disable_forced_exit()
    with stopping.cleanup(Path(sys.argv[2]).unlink):
        os.kill(os.getpid(), int(sys.argv[1]))
        while True:
            os.kill(os.getpid(), int(sys.argv[1]))
"""
HANDLES_ANOTHER_SIGNAL = """
def work():
    signal.signal(signal.SIGUSR1, lambda number, frame: None)
    os.kill(os.getpid(), signal.SIGUSR1)
    os.kill(os.getpid(), int(sys.argv[1]))
    while not stopping.requested():
        pass
    return stopping.requested()
"""
FAILS_ON_THE_WAY = """
def work():
    os.kill(os.getpid(), int(sys.argv[1]))
    while not stopping.requested():
        pass
    raise BrokenPipeError("a process that ended before us")
"""
HAS_A_CHILD = """
import subprocess
LOOK = "import signal; print(*sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())))"

def work():
    subprocess.run([sys.executable, "-c", LOOK])
    return 0
"""
BREAKS_OFF_LATE = """
stopping.GRACE = 0.1
broken = threading.Event()

def work():
    os.kill(os.getpid(), int(sys.argv[1]))
    with stopping.cleanup(broken.set):
        broken.wait()
    raise RuntimeError

def status():
    broken.wait()
    threading.Event().wait(2.0)  # the other thread ends the process meanwhile
    return stopping.exit_status()

sys.exit(stopping.supervised(work, status))
"""
END = "\nsys.exit(stopping.supervised(work))"


def terminal() -> None:
    """SIGHUP ends a process, also where the tests run under nohup."""
    signal.signal(SIGHUP, signal.SIG_DFL)


def run(
    code: str, *arguments: object, prepare: Callable[[], object] = terminal
) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of a supervised process that does `work`."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code + END, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=SOON,
        preexec_fn=prepare,
    )
    return done.returncode, done.stdout, done.stderr


SAID = "dlo_sim: interrupted\n"
ENDED = {  # how the work meets a signal -> its code, the signal, exit status, stdout and stderr
    **{
        f"in a callback of a library, where nothing is raised, {number.name}": (
            *(IN_A_CALLBACK, number),
            *(128 + number, "", SAID),
        )
        for number in (SIGINT, SIGTERM, SIGHUP)
    },
    "never checks: ended after its cleanup": (NEVER_LOOKS, SIGTERM, 143, "", SAID),
    "ends itself: gets the time that it takes": (ENDS_ITSELF, SIGINT, 7, "kept\n", ""),
    "would end itself: a second signal ends it": (IS_ASKED_AGAIN, SIGINT, 130, "", SAID),
    "a library handles another one": (HANDLES_ANOTHER_SIGNAL, SIGTERM, SIGTERM, "", ""),
    "fails because of it, which is no defect": (FAILS_ON_THE_WAY, SIGTERM, 143, "", SAID),
    "breaks off while it is ended: said once": (BREAKS_OFF_LATE, SIGTERM, 143, "", SAID),
}


@pytest.mark.parametrize("how", ENDED)
def test_work_that_gets_a_signal(how, tmp_path):
    """What `cleanup` promises to remove is removed."""
    code, number, *outcome = ENDED[how]
    half = tmp_path / "half"
    half.write_text("an output")
    assert run(code, int(number), half) == tuple(outcome)
    assert half.exists() == ("sys.argv[2]" not in code)


def test_children_are_not_interrupted_by_the_terminal_but_can_be_ended():
    status, blocked, _ = run(HAS_A_CHILD)
    assert (status, blocked.split()) == (0, ["1", "2"])


def test_what_nohup_ignores_stays_ignored():
    def nohup() -> None:
        signal.signal(SIGHUP, signal.SIG_IGN)

    code = "def work():\n    os.kill(os.getpid(), signal.SIGHUP)\n    return stopping.requested()\n"
    assert run(code, prepare=nohup) == (0, "", "")


# -- the commands themselves ------------------------------------------------------------------


SIMULATE = "simulate paper_wire --duration 1e6 --every 1e3"  # takes many minutes
NODE = "node --ros-args -p cable.length:=1.0"
needs_ros = pytest.mark.skipif(find_spec("rclpy") is None, reason="needs rclpy")
COMMANDS = [SIMULATE, pytest.param(NODE, marks=needs_ros)]


def ended(command: str, moment: float, number: int) -> tuple[int, str]:
    """Exit status and stderr of `dlo_sim` that gets a signal at a moment [s], or before it began
    (0). The launcher blocks signals: one that arrives before Python's first line would otherwise
    get Python's default handling, the one window that the project cannot close.
    """

    def prepare() -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, (SIGINT, SIGTERM))
        if moment == 0.0:
            os.kill(os.getpid(), number)

    process = subprocess.Popen(
        [sys.executable, "-m", "dlo_sim", *command.split()],
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=prepare,
    )
    try:
        _, errors = process.communicate(timeout=moment or SOON)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
        _, errors = process.communicate(timeout=SOON)
    return process.returncode, errors


@pytest.mark.parametrize(
    ("command", "number"), [(SIMULATE, SIGINT), pytest.param(NODE, SIGTERM, marks=needs_ros)]
)
def test_a_signal_that_came_before_the_process_began_is_not_lost(command, number):
    status, errors = ended(command, 0.0, number)
    assert status == (0 if command == NODE else 128 + number)
    assert "Traceback" not in errors


# DLO_SIM_SIGNALS=100 sends so many to each command.
MOMENTS = int(os.environ.get("DLO_SIM_SIGNALS", "1"))


@pytest.mark.parametrize("seed", range(MOMENTS))
@pytest.mark.parametrize("command", COMMANDS)
def test_a_signal_at_any_moment(command, seed):
    chance = random.Random(f"{command} {seed}")
    moment, number = chance.uniform(0.0, 4.0), chance.choice([SIGINT, SIGTERM])
    status, errors = ended(command, moment, number)
    said = f"{number} after {moment:.3f} s: {errors}"
    assert status == (0 if command == NODE else 128 + number), said
    assert not re.search("Traceback|Fatal|exception", errors), said
