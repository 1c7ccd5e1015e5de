"""Time slices: what the system says of them afterwards."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

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


def in_a_thread(work):
    """What `work` returns, from a thread of its own."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


def says(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", SAYS + code], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize("duration", [SHORT, LONG])
def test_the_thread_has_it_and_those_that_it_starts(duration: float) -> None:
    def work() -> tuple:
        assert ask_for_time_slice(duration)
        return attributes(), in_a_thread(attributes)

    if attributes()[4] == 0:
        pytest.skip("Linux before 6.12 does not say what the time slice is")
    for policy, _, nice, _, runtime, _, _ in in_a_thread(work):
        assert policy == os.SCHED_OTHER
        assert nice == os.getpriority(os.PRIO_PROCESS, 0)
        assert runtime == round(duration * 1e9)
    assert attributes()[4] != round(duration * 1e9), "the calling thread alone"


def test_priority_stays() -> None:
    code = "before = os.nice(7); print(ask_for_time_slice(SHORT), os.nice(0) == before)"
    assert says(code) == "True True"


def test_a_thread_with_a_policy_of_its_own_keeps_it() -> None:
    code = (
        "os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0)); "
        "print(ask_for_time_slice(SHORT), os.sched_getscheduler(0) == os.SCHED_BATCH)"
    )
    assert says(code) == "False True"


def test_who_may_not_ask_goes_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(pid: int) -> int:
        raise PermissionError

    monkeypatch.setattr(os, "sched_getscheduler", refuse)
    assert not ask_for_time_slice(SHORT)
