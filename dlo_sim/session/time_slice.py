"""How soon a thread gets a core that another one has: the shorter its time slice, the sooner."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys

# Linux from 6.12 on lets a thread that wakes up, and has not had more than its share, go before one
# with a longer slice; else it waits for the end of that slice (1 to 3 ms, and the next timer tick).
SHORT, LONG = 1.0e-4, 1.0e-1  # [s], the least and the most that Linux knows

# sched_setattr(2), which the C library has only from glibc 2.41 on.
_CALL = {"x86_64": 314, "aarch64": 274}
# size, policy, flags, nice, priority, runtime [ns], deadline, period
_ATTRIBUTES = "=IIQiIQQQ"


def ask_for_time_slice(duration: float) -> bool:
    """Set the time slice of the calling thread; threads and processes that it starts inherit it.

    A thread with a scheduling policy of its own, such as `chrt` gives it, keeps that.

    Args:
        duration: [s].

    Returns:
        Whether the system took it; kernels before 6.12 take it without effect.
    """
    call = _CALL.get(platform.machine())
    if sys.platform != "linux" or call is None:
        return False
    try:
        policy, nice = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    except OSError:  # not everybody may ask, and not every C library can
        return False
    if policy != os.SCHED_OTHER:
        return False
    attributes = struct.pack(
        _ATTRIBUTES,
        struct.calcsize(_ATTRIBUTES),
        policy,
        0,
        nice,
        0,
        round(duration * 1e9),
        0,
        0,
    )
    return ctypes.CDLL(None).syscall(call, 0, attributes, 0) == 0
