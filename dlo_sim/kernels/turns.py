"""Taking turns at compiling: of several processes that need the same code, one compiles it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # no such locks on this system: everybody compiles
    fcntl = None  # type: ignore[assignment]

PATIENCE = 60.0  # [s] to wait for another process; then its code is not waited for
_POLL = 0.02  # [s]


class Turn:
    """The right to compile what a lock file stands for. A process that ends gives it back.

    Attributes:
        waited: whether another process had it before, and so may have left its code.
    """

    def __init__(self, path: Path) -> None:
        self.waited = False
        self._path = path
        self._held: IO[bytes] | None = None
        if fcntl is not None:
            try:
                self._held = self._taken(path.open("ab"))
            except OSError:  # a directory that cannot be written, or without locks
                pass

    def _taken(self, lock: IO[bytes]) -> IO[bytes]:
        end = time.monotonic() + PATIENCE
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.waited = True
                if time.monotonic() > end:
                    return lock
                time.sleep(_POLL)
            else:
                return lock

    def give_back(self) -> None:
        """Let others know that the code is on disk, or will not be."""
        if self._held is not None:
            # Who opened the file before waits for this lock; who comes later finds the code.
            self._path.unlink(missing_ok=True)
            self._held.close()
            self._held = None
