"""Work that takes longer than a tick, while the ticks go on."""

import sys
import threading
import time
from collections.abc import Callable

# [s] for which a thread may keep the interpreter to itself. A tick gives it away at each compiled
# step and each publication, and would wait 5 ms, Python's own value, to get it back every time.
_SWITCH_INTERVAL = 1.0e-4
_turn = threading.Lock()
_usual: list[float] = []  # of the process, while one or more cables prepare


def in_background(
    work: Callable[[], None], meanwhile: Callable[[], None], period: Callable[[], float]
) -> None:
    """Call `meanwhile`, then run `work` in a thread and call `meanwhile` periodically until it is
    done.

    Args:
        work: must not touch what `meanwhile` changes.
        meanwhile: called in this thread.
        period: time between two calls [s], asked each time.

    Raises:
        Exception: whatever `work` or `meanwhile` raises; the thread has ended by then.
    """
    failures: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as failure:
            failures.append(failure)

    thread = threading.Thread(target=run, name="preparing")
    due = time.perf_counter()
    meanwhile()  # some of a period may have gone by since the last call
    with _turn:
        _usual.append(sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_INTERVAL)
    thread.start()
    try:
        while True:
            due = max(due + period(), time.perf_counter())
            thread.join(max(due - time.perf_counter(), 0.0))
            if not thread.is_alive():
                break
            meanwhile()
    finally:
        thread.join()
        with _turn:
            usual = _usual.pop()
            if not _usual:
                sys.setswitchinterval(usual)
    if failures:
        raise failures[0]
