"""Machine code on disk that several processes may read and write at once.

numba numbers the data files of a function and keeps the numbers in an index. Two processes that
save different signatures at once can take the same number, and then the index of one names the
machine code of the other. Here there is no index: the name of a file is a digest of what its code
was compiled for, and the file says so itself. Files appear whole, so that nothing depends on locks,
which home directories on a network do not always have; where there are locks, one process compiles
and the others wait for its code.

A file is only opened as machine code if nobody else could have written it (`cache.trust_problem`)
and it is what was saved, to the bit: it begins with a digest of the rest.
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
)

from dlo_sim.kernels.cache import base_directory, miss, trust_problem
from dlo_sim.kernels.turns import Turn

try:
    from numba.core.caching import UserProvidedCacheLocator
except ImportError:  # its name up to numba 0.60
    from numba.core.caching import _UserProvidedCacheLocator as UserProvidedCacheLocator

_DIGEST = hashlib.sha256().digest_size


class CodeFiles(IndexDataCacheFile):
    """The machine code of one function: a file for each key (signature, processor, bytecode)."""

    def save(self, key: object, data: object) -> None:
        """Put the code for a key in place, instead of what may be there.

        Raises:
            OSError: the disk refuses.
        """
        content = self._dump((self._source_stamp, key, data))
        with self._open_for_write(self._path(key)) as stream:
            Path(stream.name).chmod(0o644)  # whatever the process lets others write otherwise
            stream.write(hashlib.sha256(content).digest() + content)

    def load(self, key: object) -> Any:
        """The code for a key; None if there is none, or none of this source that is as it was saved
        and that nobody else can have written."""
        path = self._path(key)
        try:
            saved = path.read_bytes()
        except OSError:
            return None
        content = saved[_DIGEST:]
        if trust_problem(path) or hashlib.sha256(content).digest() != saved[:_DIGEST]:
            return None
        try:
            stamp, found, data = pickle.loads(content)
        except (AttributeError, ImportError):  # types that are not there any more
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
    """The user's directory, also one that can only be read, such as that of an image.

    Attributes:
        obstacle: why no code is left there; empty if it is.
    """

    obstacle = ""

    def ensure_cache_path(self) -> None:
        """Make the directory, where that is possible, and look whether it can be used."""
        path = Path(self.get_cache_path())
        try:
            for place in (*reversed(path.parents), path):
                place.mkdir(mode=0o755, exist_ok=True)
            super().ensure_cache_path()
        except OSError as error:
            self.obstacle = f"{base_directory()} cannot be written ({error.strerror})"
        else:
            self.obstacle = trust_problem(path)


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
        self._obstacle = self._impl.locator.obstacle
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
            miss(self._function, self._obstacle)
            if self._obstacle:
                return None
            if signature not in self._turns:  # else compiling was broken off before
                self._turns[signature] = self._cache_file.turn(signature)
            code = super().load_overload(signature, target)  # it may have come meanwhile
            if code is not None:
                self._turns.pop(signature).give_back()
        return code

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep the code for a signature; a full disk is no reason not to run it."""
        if self._obstacle:
            return
        try:
            with contextlib.suppress(OSError):
                super().save_overload(signature, code)
        finally:
            if signature in self._turns:
                self._turns.pop(signature).give_back()
