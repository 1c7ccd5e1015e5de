"""SIGINT, SIGTERM and SIGHUP: recorded when they arrive, handled between pieces of work.

Signal handlers raise no exceptions: inside a callback that a library calls from C, as compilers do,
an exception is lost or ends in a crash. Instead
- the interpreter's own handler writes the signal's number to a pipe at any time;
- a thread reads it there and records it;
- the work checks the record between two pieces (`check`, `requested`) and ends itself;
- work that does not check in time, such as compiling, is ended by that thread after its cleanup
  (`cleanup`): temporary files removed, other processes ended. After `disable_forced_exit` only a
  second signal has this effect.

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
GRACE = 2.0  # [s] for the work to check the record, before it is ended from outside
_AFTERWARDS = 0.2  # [s] for the work to end itself after each cleanup

_requested = 0
_forced_exit_disabled = False
_cleanups: dict[object, Callable[[], object]] = {}
_said = threading.Lock()  # held once the message 'interrupted' has been printed


def request(number: int) -> None:
    """Ask the work to end because of a signal; the first one is recorded."""
    global _requested
    _requested = _requested or number


def requested() -> int:
    """The signal that asked the work to end, 0 if none did."""
    return _requested


def check() -> None:
    """End the work here if a signal asked for it.

    Raises:
        KeyboardInterrupt: raised here only.
    """
    if _requested:
        raise KeyboardInterrupt


def exit_status() -> int:
    """The exit status of a command that a signal ended, 128 + its number."""
    return 128 + (_requested or signal.SIGINT)


def disable_forced_exit() -> None:
    """Declare that the work checks often enough from now on and may take its time to finish: only a
    second signal, more than GRACE after the first, ends it from outside.
    """
    global _forced_exit_disabled
    _forced_exit_disabled = True


@contextlib.contextmanager
def cleanup(action: Callable[[], object]) -> Iterator[None]:
    """Run `action` at the end of the block, also if the process is ended inside it."""
    key = object()
    _cleanups[key] = action
    try:
        yield
    finally:
        if _cleanups.pop(key, None) is not None:
            action()


def supervised(work: Callable[[], int], status: Callable[[], int] = exit_status) -> int:
    """Run the work of a process under these rules; the process must exit with the result.

    Signals that arrive earlier are not lost if the launcher starts the process with them blocked.

    Args:
        work: returns the exit status.
        status: returns the exit status if a signal interrupted the work.
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
        _say_interrupted()  # errors on the way, such as a child that ended first, are not reported
        return status()
    finally:
        finished.set()
        for number in SIGNALS:  # the process ends, and the interpreter removes its handlers
            signal.signal(number, signal.SIG_IGN)


def _handler(number: int, frame: FrameType | None) -> None:
    """Do nothing: the interpreter has written the number to the pipe."""


def _watch(reading: int, finished: threading.Event, status: Callable[[], int]) -> None:
    """Record a signal, and end the process if its work does not end."""
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
        if finished.wait(_AFTERWARDS):  # e.g. it waited for a process that the cleanup has ended
            return
    _say_interrupted()
    os._exit(status())


def _next_signal(reading: int) -> int:
    """Wait for the next of SIGNALS; the pipe also gets signals that libraries handle."""
    while (number := os.read(reading, 1)[0]) not in SIGNALS:
        pass
    return number


def _say_interrupted() -> None:
    if not _said.acquire(blocking=False):
        return  # both threads get here if the work ends while it is ended from outside
    wipe = "\r\033[K" if sys.stderr.isatty() else ""  # clears a progress bar
    with contextlib.suppress(OSError):  # the terminal is closed
        os.write(2, f"{wipe}dlo_sim: interrupted\n".encode())
