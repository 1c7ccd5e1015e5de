"""Outputs that are whole or absent: written beside their place, then put there.

What a killed process leaves is removed by the next one that writes the same output. Whether a
process is still writing shows by a lock, which ends with it, and not by its number, which another
process may have by now, or have in another container.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from dlo_sim.process.stopping import cleanup

_SUFFIX = ".dlo_sim"
# What is written has always the same name: bags hold theirs, and their bytes must not depend on it.
_NAME = "dlo_sim_0"


class AtomicOutput:
    """A place beside an output in which it is written.

    Args:
        target: file or directory that will be the output; its parent must exist.

    Attributes:
        path: where to write it meanwhile.

    Raises:
        OSError: the parent cannot be written.
    """

    def __init__(self, target: Path) -> None:
        self._target = target.parent.resolve() / target.name
        remove_leftovers(self._target)
        self._folder, self._lock = _locked_folder(self._target)
        self.path = self._folder / _NAME
        self._promise = contextlib.ExitStack()
        self._promise.enter_context(cleanup(self._remove))

    def commit(self) -> None:
        """Make what was written the output; a file that is there is replaced.

        Raises:
            OSError: the disk refuses, or a directory is there.
        """
        self.path.replace(self._target)
        self.discard()

    def discard(self) -> None:
        """Leave nothing behind."""
        self._promise.close()

    def _remove(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        os.close(self._lock)


def write_atomically(target: Path, write: Callable[[Path], object]) -> None:
    """Let `write` make a file at the path that it is given, and put it in the target's place.

    Raises:
        OSError: the disk refuses; what was there before is kept.
    """
    output = AtomicOutput(target)
    try:
        write(output.path)
        output.commit()
    finally:
        output.discard()


def remove_leftovers(target: Path) -> None:
    """Remove what killed processes have left of an output; never what is not ours, or in use."""
    pattern = re.compile(re.escape(f".{target.name}.") + r"[a-z0-9_]{8}" + re.escape(_SUFFIX))
    with contextlib.suppress(OSError):  # a parent that cannot be read
        for folder in target.parent.iterdir():
            if pattern.fullmatch(folder.name):
                with contextlib.suppress(OSError):  # in use, or gone meanwhile, or no locks here
                    _remove_leftover(folder)


def _remove_leftover(folder: Path) -> None:
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(lock).st_uid == os.geteuid() and {*os.listdir(folder)} <= {_NAME}:
            shutil.rmtree(folder)
    finally:
        os.close(lock)


def _locked_folder(target: Path) -> tuple[Path, int]:
    """A new folder beside the target, and the descriptor that holds its lock."""
    while True:
        folder = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.", suffix=_SUFFIX, dir=target.parent)
        )
        try:
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # taken for a leftover before it was locked
        with contextlib.suppress(OSError):  # no locks here: nobody will remove it
            fcntl.flock(lock, fcntl.LOCK_EX)
        if folder.exists():
            return folder, lock
        os.close(lock)
