"""SIGINT, SIGTERM and SIGHUP: recorded when they arrive, handled between pieces of work.

Nothing is ever raised by a signal handler: an exception inside a callback that a library calls from
C, as compilers do, is lost or ends in a crash. Instead
- the interpreter's own handler writes the signal's number to a pipe, whatever the process is doing;
- a thread reads it there and records it;
- the work looks at the record between two pieces (`check`, `requested`) and ends itself;
- work that does not look in time, such as compiling, is ended from that thread after its cleanup
  (`cleanup`): temporary files removed, other processes ended. Work that is known to end itself
  (`disable_forced_exit`) is ended so by a second signal alone.

Child processes do not see the SIGINT and SIGHUP that a terminal sends to all: this process ends
them.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
GRACE = 2.0  # [s] for the work to look at the record, before it is ended from outside
_AFTERWARDS = 0.2  # [s] for the work to end itself after all, when some cleanup has been done

_requested = 0
_forced_exit_disabled = False
_cleanups: dict[object, Callable[[], object]] = {}
_said = threading.Lock()  # held once it has been said that the process is interrupted


def request(number: int) -> None:
    """Ask the work to end because of a signal; the first one counts."""
    global _requested
    _requested = _requested or number


def requested() -> int:
    """The signal that asked the work to end, 0 if none did."""
    return _requested


def check() -> None:
    """End the work here if a signal asked for it.

    Raises:
        KeyboardInterrupt: from here and nowhere else.
    """
    if _requested:
        raise KeyboardInterrupt


def exit_status() -> int:
    """The exit status of a command that a signal ended, 128 + its number."""
    return 128 + (_requested or signal.SIGINT)


def disable_forced_exit() -> None:
    """From now on the work looks often enough, and what it keeps takes the time that it takes: only
    a second signal, more than GRACE after the first, ends it from outside.
    """
    global _forced_exit_disabled
    _forced_exit_disabled = True


@contextlib.contextmanager
def cleanup(action: Callable[[], object]) -> Iterator[None]:
    """Do something at the end of the block, also when the process is ended inside it."""
    key = object()
    _cleanups[key] = action
    try:
        yield
    finally:
        if _cleanups.pop(key, None) is not None:
            action()


def supervised(work: Callable[[], int], status: Callable[[], int] = exit_status) -> int:
    """Do the work of a process under these rules; the process is to exit with the result.

    A launcher that starts the process with the signals blocked loses none that come earlier.

    Args:
        work: returns the exit status.
        status: the exit status where a signal broke the work off.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, _handler)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    finished = threading.Event()
    watcher = threading.Thread(target=_watch, args=(reading, finished, status), daemon=True)
    watcher.start()
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGHUP))
    try:
        return work()
    except BaseException as error:
        if not _requested or isinstance(error, SystemExit):
            raise
        _say_interrupted()  # and what fails on the way, such as a process that ended before us
        return status()
    finally:
        finished.set()
        for number in SIGNALS:  # it is ending; handlers would be taken away while it does
            signal.signal(number, signal.SIG_IGN)


def _handler(number: int, frame: FrameType | None) -> None:
    """Nothing: the interpreter has written the number to the pipe."""


def _watch(reading: int, finished: threading.Event, status: Callable[[], int]) -> None:
    """Record a signal, and end a process whose work does not."""
    request(_next_signal(reading))
    if not finished.wait(GRACE) and _forced_exit_disabled:
        if select.select([reading], (), (), 0.0)[0]:
            os.read(reading, 1 << 16)  # launchers send the same one twice
        _next_signal(reading)
    if finished.is_set():
        return
    while _cleanups:
        with contextlib.suppress(Exception):  # the other thread may be faster
            _cleanups.popitem()[1]()
        if finished.wait(_AFTERWARDS):  # what it waited for was, say, a process that has ended now
            return
    _say_interrupted()
    os._exit(status())


def _next_signal(reading: int) -> int:
    """Wait for the next of our signals; libraries may handle others, whose numbers come too."""
    while (number := os.read(reading, 1)[0]) not in SIGNALS:
        pass
    return number


def _say_interrupted() -> None:
    if not _said.acquire(blocking=False):
        return  # work that breaks off while it is ended from outside: both threads say so
    wipe = "\r\033[K" if sys.stderr.isatty() else ""  # what may be left of a progress bar
    with contextlib.suppress(OSError):  # a terminal that is gone
        os.write(2, f"{wipe}dlo_sim: interrupted\n".encode())
