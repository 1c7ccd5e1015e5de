"""The cache directory of machine code, and its protection against other users.

Loading machine code means running it, so it is loaded only from files and directories that belong
to this user, and to which no other user may write (`trust_problem`).
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import pickle
import platform
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import llvmlite
import numba
from llvmlite.binding import get_host_cpu_name
from numba import config

LOGGER = "dlo_sim.compiling"
COMPILED_ROOMS = ("compiling", "engine", "methods", "terms")

_log = logging.getLogger(LOGGER)
_said: set[str] = set()
_shared: list[str] = []  # the directory of `many_kept`
_turn = threading.RLock()  # numba's cache setting is process-wide
_ROOM = 50_000_000  # bytes; a kernel takes up to a few megabytes
_SEAL = hashlib.sha256().digest_size


def base_directory() -> Path:
    """The user's cache directory, shared by all versions, with symbolic links resolved.

    Raises:
        OSError: there is none: an unknown user, no home directory, a loop of symbolic links.
    """
    base = os.environ.get("DLO_SIM_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    try:
        return (Path(base).expanduser() / "dlo_sim").resolve()
    except (OSError, RuntimeError) as error:  # pathlib raises both
        problem = _printable(str(error)).rstrip(".")
        raise OSError(f"{_printable(base)} is no directory ({problem})") from None


@functools.cache
def digest() -> str:
    """Hash of the sources of all compiled functions and their path, the compiler and the machine.

    numba's own check covers only the file of the function itself, so code that calls functions of
    other files would be stale after an upgrade. The path separates two installations, which would
    otherwise replace each other's code.
    """
    found = hashlib.sha256()
    root = Path(__file__).parents[1]
    versions = numba.__version__, llvmlite.__version__, platform.python_version()
    checked = os.environ.get("DLO_SIM_CHECK", "")
    for part in (*versions, platform.machine(), get_host_cpu_name(), config.OPT, checked, root):
        found.update(f"{part}\n".encode())
    for source in sorted(path for room in COMPILED_ROOMS for path in (root / room).glob("*.py")):
        found.update(f"{source.parent.name}/{source.name}\n".encode())
        found.update(hashlib.sha256(source.read_bytes()).digest())
    return found.hexdigest()[:16]


def trust_problem(path: Path) -> str:
    """Why another user could have written machine code there; an empty string if none could, or if
    there is nothing.

    The file, and the directories of this version and of all versions (`base_directory`), have to
    belong to this user, and nobody else may write to them. Access lists are not read.
    """
    if not hasattr(os, "geteuid"):  # a system without modes: home directories are protected
        return ""
    base = base_directory()
    for place in (one for one in (path, *path.parents) if one.is_relative_to(base)):
        try:
            status = place.lstat()
        except FileNotFoundError:
            continue
        except OSError as error:
            return f"{place} cannot be inspected ({error.strerror})"
        if status.st_uid != os.geteuid():
            return f"{place} belongs to another user (uid {status.st_uid})"
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return f"others may write to {place} (mode {stat.S_IMODE(status.st_mode):04o})"
    return ""


@contextlib.contextmanager
def kept(name: str) -> Iterator[None]:
    """Context in which numba finds the machine code cached under this name; new code is cached.

    numba itself uses a private directory. The cache entry is one file, written atomically and read
    only if it is trusted and its checksum agrees; otherwise the code is compiled again and the
    entry replaced. numba's process-wide cache setting is restored at the end.

    Raises:
        OSError: nothing can be cached, also not for a moment; `say_not_kept` tells why.
    """
    path = base_directory() / digest() / name
    with (
        _turn,
        contextlib.nullcontext(_shared[0]) if _shared else _private_directory() as place,
    ):
        folder = Path(place)
        for file in _files(folder):  # of the kernel before
            file.unlink()
        found = _read(path)
        for relative, content in found.items():
            (folder / relative).parent.mkdir(exist_ok=True)
            (folder / relative).write_bytes(content)
        if not found:
            _say(path.parent)
        before = config.CACHE_DIR
        config.CACHE_DIR = place
        try:
            yield
        except OSError as error:
            error.filename = str(folder.parent)  # rather than the name of a kernel of code
            raise
        finally:
            config.CACHE_DIR = before
        made = {str(file.relative_to(folder)): file.read_bytes() for file in _files(folder)}
        if made != found and not _obstacle(path.parent):
            try:
                _write(path, made)
            except OSError as error:  # the disk may have become full
                say_not_kept(f"{path.parent} cannot be written ({error.strerror})")


def _files(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file()]


@contextlib.contextmanager
def many_kept() -> Iterator[None]:
    """Context in which numba uses one private directory for all kernels. On a file system that
    discards what is deleted, removing one takes 7 ms, as long as loading a kernel.
    """
    with _turn, contextlib.ExitStack() as opened:
        with contextlib.suppress(OSError):  # each kernel tries it again
            if not _shared:
                _shared.append(opened.enter_context(_private_directory()))
                opened.callback(_shared.clear)
        yield


def _private_directory() -> tempfile.TemporaryDirectory[str]:
    """A new directory among the temporary files or, where these have no room, in the cache.

    Raises:
        OSError: there can be none.
    """
    cache = base_directory() / digest()
    with contextlib.suppress(OSError):
        if shutil.disk_usage(tempfile.gettempdir()).free >= _ROOM or _obstacle(cache):
            return tempfile.TemporaryDirectory(prefix="dlo_sim_")
    return tempfile.TemporaryDirectory(prefix="dlo_sim_", dir=cache)


class _Telling(logging.Handler):
    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__()
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


@contextlib.contextmanager
def compiling_told_to(tell: Callable[[str], object]) -> Iterator[None]:
    """Context in which `tell` also gets the log line that announces a compilation."""
    handler = _Telling(tell)
    level = _log.level
    _log.addHandler(handler)
    _log.setLevel(logging.INFO)
    try:
        yield
    finally:
        _log.removeHandler(handler)
        _log.setLevel(level)


def _read(path: Path) -> dict[str, bytes]:
    """The files in a cache entry; none if it is missing, damaged or not trusted."""
    try:
        if trust_problem(path):
            return {}
        content = path.read_bytes()
    except OSError:
        return {}
    seal, data = content[:_SEAL], content[_SEAL:]
    if hashlib.sha256(data).digest() != seal:
        return {}
    files: dict[str, bytes] = pickle.loads(data)
    return files


def _write(path: Path, files: dict[str, bytes]) -> None:
    """Write a cache entry atomically, writable by this user and readable by all.

    Raises:
        OSError: it cannot be written.
    """
    data = pickle.dumps(files)
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as partial:
        try:
            partial.write(hashlib.sha256(data).digest() + data)
            partial.flush()
            os.chmod(partial.name, 0o644)
            os.replace(partial.name, path)
        except BaseException:
            os.unlink(partial.name)
            raise


def _obstacle(directory: Path) -> str:
    """Why a directory cannot serve as cache, empty if it can; creates it if it is missing."""
    try:
        for place in (*reversed(directory.parents), directory):
            place.mkdir(mode=0o755, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        return f"{directory} cannot be written ({error.strerror})"
    return trust_problem(directory)


def _say(directory: Path) -> None:
    """Log, once per process, that code is compiled, and why it cannot be cached if so."""
    obstacle = _obstacle(directory)
    if obstacle:
        say_not_kept(obstacle)
    else:
        place = _printable(str(directory.parent))
        _log_once(logging.INFO, f"once per installation, some 25 s, kept in {place}")


def say_not_kept(obstacle: str) -> None:
    """Log, once per process, that code is compiled at every start, and why."""
    cure = "free space there, or set DLO_SIM_CACHE to a directory of your own"
    _log_once(logging.WARNING, f"at every start: {_printable(obstacle)}; {cure}")


def _log_once(level: int, told: str) -> None:
    if told not in _said:
        _said.add(told)
        _log.log(level, "compiling, %s", told)


def _printable(text: str) -> str:
    """On one line, and without bytes of a name that are not UTF-8."""
    return " ".join(text.encode("utf-8", "backslashreplace").decode().split())
