"""Time slices: what the system says of them afterwards."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import subprocess
import sys
import threading

import pytest

from dlo_sim.session.time_slice import LONG, SHORT, ask_for_time_slice

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="asks Linux on x86-64"
)

ASKED = 48  # bytes of struct sched_attr that every kernel knows
SAYS = "from dlo_sim.session.time_slice import *; import os; "


def attributes() -> tuple[int, ...]:
    """policy, flags, nice, priority, runtime [ns], deadline, period of the calling thread."""
    buffer = ctypes.create_string_buffer(ASKED)
    assert ctypes.CDLL(None).syscall(315, 0, buffer, ASKED, 0) == 0
    return struct.unpack("=IIQiIQQQ", buffer.raw)[1:]


def in_a_thread(work) -> list:
    """What `work` returns, from a thread of its own."""
    results: list = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    thread.join()
    return results[0]


def says(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", SAYS + code], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.skipif(
    tuple(map(int, platform.release().split(".")[:2])) < (6, 12), reason="Linux before 6.12"
)
@pytest.mark.parametrize("duration", [SHORT, LONG])
def test_the_thread_has_it_and_those_that_it_starts(duration: float) -> None:
    def work() -> tuple:
        assert ask_for_time_slice(duration)
        return attributes(), in_a_thread(attributes)

    for policy, _, nice, _, runtime, _, _ in in_a_thread(work):
        assert policy == os.SCHED_OTHER
        assert nice == os.getpriority(os.PRIO_PROCESS, 0)
        assert runtime == round(duration * 1e9)
    assert attributes()[4] != round(duration * 1e9), "the calling thread alone"


def test_priority_stays() -> None:
    assert says("os.nice(7); print(ask_for_time_slice(SHORT), os.nice(0))") == "True 7"


def test_a_thread_with_a_policy_of_its_own_keeps_it() -> None:
    code = (
        "os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0)); "
        "print(ask_for_time_slice(SHORT), os.sched_getscheduler(0) == os.SCHED_BATCH)"
    )
    assert says(code) == "False True"
