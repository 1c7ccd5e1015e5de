"""Work that takes longer than a tick, while the ticks go on."""

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

# [s] for which a thread may keep the interpreter to itself. A tick gives it away at each compiled
# step and each publication, and would wait 5 ms, Python's own value, to get it back every time.
_SWITCH_INTERVAL = 1.0e-4
_turn = threading.Lock()
_usual: list[float] = []  # of the process, while one or more cables prepare

Result = TypeVar("Result")


def in_background(
    work: Callable[[], Result], meanwhile: Callable[[], None], period: Callable[[], float]
) -> Result:
    """Call `meanwhile`, then run `work` in a thread and call `meanwhile` periodically until it is
    done.

    Args:
        work: must not touch what `meanwhile` changes.
        meanwhile: called in this thread.
        period: time between two calls [s], asked each time.

    Returns:
        What `work` returns.

    Raises:
        Exception: whatever `work` or `meanwhile` raises; the thread has ended by then.
    """
    due = time.perf_counter()
    meanwhile()  # some of a period may have gone by since the last call
    with _turn:
        _usual.append(sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        with ThreadPoolExecutor(1, "preparing") as pool:
            future = pool.submit(work)
            while True:
                due = max(due + period(), time.perf_counter())
                wait([future], max(due - time.perf_counter(), 0.0))
                if future.done():
                    return future.result()
                meanwhile()
    finally:
        with _turn:
            usual = _usual.pop()
            if not _usual:
                sys.setswitchinterval(usual)
