"""Where machine code is kept, who is trusted with it, and what happens when some is missing there.

Loading machine code means running it, so it is only loaded from where nobody but this user and root
could have put it (`trust_problem`).
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import platform
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import llvmlite
import numba

LOGGER = "dlo_sim.compiling"

_log = logging.getLogger(LOGGER)
_said: set[str] = set()
_this_thread = threading.local()


class NotCompiledError(RuntimeError):
    """Machine code is needed that is not on disk, inside `only_loading`."""


def base_directory() -> Path:
    """The user's directory of compiled kernels of every version, without symbolic links."""
    base = os.environ.get("DLO_SIM_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return (Path(base).expanduser() / "dlo_sim").resolve()


def cache_directory() -> Path:
    """The part of it for these kernels: named after their sources and the compiler.

    numba looks only at the file of the function itself; a kernel that calls another file's kernel
    would go stale after an upgrade. A digest over all kernel sources rules that out.
    """
    digest = hashlib.sha256()
    versions = numba.__version__, llvmlite.__version__, platform.python_version()
    for part in (*versions, platform.machine()):
        digest.update(f"{part}\n".encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(f"{source.name}\n".encode())
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    return base_directory() / digest.hexdigest()[:16]


def trust_problem(path: Path) -> str:
    """Why another user could have put machine code there; an empty string if none could.

    The path, which holds no symbolic links, and every directory above it must belong to root or to
    this user, and no other user may write to them. Hence a directory that root made is trusted,
    such as that of an image, and one of another user is not. Two exceptions:
    - a directory above may be writable by everyone if it is sticky, as /tmp is: nobody can replace
      another user's entries there;
    - a group may write if it is the owner's private group (`_private`), a common default.

    Access lists are not read. An entry that lets another user write appears in the mode as write
    permission of the group, so it goes unnoticed where the group is the owner's private one.
    """
    if not hasattr(os, "geteuid"):  # a system without modes: home directories are protected
        return ""
    holds_directory = False
    for place in (path, *path.parents):
        try:
            status = place.lstat()
        except OSError as error:
            return f"{place} cannot be inspected ({error.strerror})"
        mode = status.st_mode
        if status.st_uid not in (0, os.geteuid()):
            return f"{place} belongs to another user (uid {status.st_uid})"
        by_group = mode & stat.S_IWGRP and not _private(status.st_uid, status.st_gid)
        sticky = holds_directory and mode & stat.S_ISVTX
        if (by_group or mode & stat.S_IWOTH) and not sticky:
            return f"others may write to {place} (mode {stat.S_IMODE(mode):04o})"
        holds_directory = stat.S_ISDIR(mode)
    return ""


@functools.cache
def _private(user: int, group: int) -> bool:
    """Whether a group is a user's private one: it has the user's name, and the system lists no
    other user in it, nor one whose primary group it is."""
    import grp
    import pwd

    try:
        name, found = pwd.getpwuid(user).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    primary = {entry.pw_name for entry in pwd.getpwall() if entry.pw_gid == group}
    return found.gr_name == name and primary.union(found.gr_mem) <= {name}


@contextlib.contextmanager
def only_loading() -> Iterator[None]:
    """Inside, this thread compiles nothing that another process could leave on disk for it.

    Raises:
        NotCompiledError: from whatever needs such code.
    """
    before = getattr(_this_thread, "only_loads", False)
    _this_thread.only_loads = True
    try:
        yield
    finally:
        _this_thread.only_loads = before


@contextlib.contextmanager
def on_first_miss(act: Callable[[], object]) -> Iterator[None]:
    """Inside, `act` is called as soon as this thread begins to compile."""
    _this_thread.on_miss = act
    try:
        yield
    finally:
        _this_thread.on_miss = None


def miss(name: str, obstacle: str = "") -> None:
    """Machine code is not there: say once per process that it is compiled, or do not let it be.

    Args:
        name: of the entry.
        obstacle: why it will not be on disk afterwards; empty if it will.

    Raises:
        NotCompiledError: inside `only_loading`, if it could be kept.
    """
    act = getattr(_this_thread, "on_miss", None)
    if not obstacle:
        if getattr(_this_thread, "only_loads", False):
            raise NotCompiledError(f"{name} is not compiled")
        if act is not None:
            _this_thread.on_miss = None
            act()
    told = f"kept in {base_directory()}"
    if obstacle:
        told = f"at every start: {obstacle}; set DLO_SIM_CACHE to a directory of your own"
    if told not in _said:
        _said.add(told)
        level = logging.WARNING if obstacle else logging.INFO
        _log.log(level, "compiling the step of this scene, some 10 to 30 s, %s", told)
