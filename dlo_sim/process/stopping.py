"""SIGINT, SIGTERM and SIGHUP: noted when they come, heeded between two pieces of work.

Nothing is ever raised by a signal handler: an exception inside a callback that a library calls from
C, as compilers do, is lost or ends in a crash. Instead
- the interpreter's own handler writes the signal's number to a pipe, whatever the process is doing;
- a thread reads it there and notes it;
- the work looks at the note between two pieces (`check`, `requested`) and ends itself;
- work that does not look in time, such as compiling, is ended from that thread, after what is owed
  to others has been done (`owed`): temporary files removed, other processes ended.

Child processes do not see the SIGINT and SIGHUP that a terminal sends to all: this process ends
them.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
GRACE = 2.0  # [s] for the work to look at the note, before it is ended from outside
_AFTERWARDS = 0.2  # [s] for the work to end itself after all, when something owed has been done

_requested = 0
_ends_itself = False
_owed: dict[object, Callable[[], object]] = {}


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


def ends_itself() -> None:
    """From now on the work looks often enough, and what it keeps takes the time that it takes."""
    global _ends_itself
    _ends_itself = True


@contextlib.contextmanager
def owed(action: Callable[[], object]) -> Iterator[None]:
    """Do something at the end of the block, also when the process is ended inside it."""
    key = object()
    _owed[key] = action
    try:
        yield
    finally:
        if _owed.pop(key, None) is not None:
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
    """Note a signal, and end a process whose work does not."""
    request(os.read(reading, 1)[0])
    if finished.wait(GRACE) or _ends_itself:
        return
    while _owed:
        with contextlib.suppress(Exception):  # the other thread may be faster
            _owed.popitem()[1]()
        if finished.wait(_AFTERWARDS):  # what it waited for was, say, a process that has ended now
            return
    _say_interrupted()
    os._exit(status())


def _say_interrupted() -> None:
    wipe = "\r\033[K" if sys.stderr.isatty() else ""  # what may be left of a progress bar
    with contextlib.suppress(OSError):  # a terminal that is gone
        os.write(2, f"{wipe}dlo_sim: interrupted\n".encode())
