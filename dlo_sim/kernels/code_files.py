"""Machine code on disk that several processes may read and write at once.

numba numbers the data files of a function and keeps the numbers in an index. Two processes that
save different signatures at once can take the same number, and then the index of one names the
machine code of the other. Here there is no index: the name of a file is a digest of what its code
was compiled for, and the file says so itself. Files appear whole, so that nothing depends on locks,
which home directories on a network do not always have; where there are locks, one process compiles
and the others wait for its code.
"""

from __future__ import annotations

import contextlib
import hashlib
import pickle
from pathlib import Path
from typing import Any

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)

from dlo_sim.kernels.cache import miss
from dlo_sim.kernels.turns import Turn

# What unpickling raises on a file cut short, or with types that are not there any more.
_UNREADABLE = OSError, EOFError, ValueError, AttributeError, ImportError


class CodeFiles(IndexDataCacheFile):
    """The machine code of one function: a file for each key (signature, processor, bytecode)."""

    def save(self, key: object, data: object) -> None:
        """Put the code for a key in place, instead of what may be there.

        Raises:
            OSError: the disk refuses.
        """
        content = self._dump((self._source_stamp, key, data))
        with self._open_for_write(self._path(key)) as stream:
            stream.write(content)

    def load(self, key: object) -> Any:
        """The code for a key; None if there is none, or none of this source that can be read."""
        try:
            stamp, found, data = pickle.loads(self._path(key).read_bytes())
        except (*_UNREADABLE, pickle.UnpicklingError):
            return None
        return data if (stamp, found) == (self._source_stamp, key) else None

    def flush(self) -> None:
        """Remove the code for every key."""
        for path in Path(self._cache_path).glob(f"{Path(self._index_path).stem}.*"):
            path.unlink(missing_ok=True)

    def turn(self, key: object) -> Turn:
        """The right to compile for a key, waited for where another process has it."""
        return Turn(self._path(key).with_suffix(".lock"))

    def _path(self, key: object) -> Path:
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:32]
        return Path(self._index_path).with_suffix(f".{name}.nbc")


class _Directory(UserProvidedCacheLocator):
    """The user's directory, also one that can only be read, such as that of an image."""

    writable = False

    def ensure_cache_path(self) -> None:
        """Make the directory, where that is possible, and look whether it can be written."""
        with contextlib.suppress(OSError):
            super().ensure_cache_path()
            self.writable = True


class _UserDirectory(CompileResultCacheImpl):
    """Nowhere else: beside the sources, code of another version could be found after an upgrade."""

    _locator_classes = (_Directory,)


class KeptCode(FunctionCache):
    """What a compiled function asks for machine code, and gives it to.

    Raises:
        RuntimeError: the function has no source file.
    """

    _impl_class = _UserDirectory

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._function = function.__name__
        self._writable = self._impl.locator.writable
        self._cache_file = CodeFiles(
            self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
        )
        self._turns: dict[Any, Turn] = {}

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The code for a signature, None if it is to be compiled.

        Raises:
            NotCompiledError: it is not to be compiled here.
        """
        code = super().load_overload(signature, target)
        if code is None:
            miss(self._function, kept=self._writable)
            if signature not in self._turns:  # else compiling was broken off before
                self._turns[signature] = self._cache_file.turn(signature)
            code = super().load_overload(signature, target)  # it may have come meanwhile
            if code is not None:
                self._turns.pop(signature).give_back()
        return code

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep the code for a signature; a full disk is no reason not to run it."""
        try:
            with contextlib.suppress(OSError):
                super().save_overload(signature, code)
        finally:
            if signature in self._turns:
                self._turns.pop(signature).give_back()
