"""Atomic outputs: written to a temporary folder beside the target, then moved into place.

Leftovers of a killed process are removed by the next one that writes the same output. A lock, which
ends with its process, shows whether a folder is in use; a process id may have been reused, or may
belong to another container.
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
# Always the same name: a bag contains its name, and its bytes must not depend on chance.
_NAME = "dlo_sim_0"


class AtomicOutput:
    """A temporary folder beside an output, removed also when the process is ended.

    Args:
        target: file or directory that will be the output; its parent must exist.

    Attributes:
        path: temporary path to write to.

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
        """Move the written file or directory to the target; an existing file is replaced.

        Raises:
            OSError: it cannot be moved, or the target is an existing directory.
        """
        self.path.replace(self._target)
        self.discard()

    def discard(self) -> None:
        """Remove the temporary folder."""
        self._promise.close()

    def _remove(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        os.close(self._lock)


def write_atomically(target: Path, write: Callable[[Path], object]) -> None:
    """Let `write` create a file at a temporary path, then move it to the target.

    Raises:
        OSError: it cannot be written; an existing file is kept.
    """
    output = AtomicOutput(target)
    try:
        write(output.path)
        output.commit()
    except OSError as error:
        error.filename = str(target)  # not the temporary name, or none
        raise
    finally:
        output.discard()


def remove_leftovers(target: Path) -> None:
    """Remove leftovers of killed processes, except folders of others and folders in use."""
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
    """A new folder beside the target, and the descriptor with its lock."""
    while True:
        folder = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.", suffix=_SUFFIX, dir=target.parent)
        )
        try:
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # removed as a leftover before it was locked
        with contextlib.suppress(OSError):  # no locks on this file system: nobody removes it
            fcntl.flock(lock, fcntl.LOCK_EX)
        if folder.exists():
            return folder, lock
        os.close(lock)
