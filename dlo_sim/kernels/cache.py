"""Where machine code is kept, and what happens when some is missing there."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import platform
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
    """The user's directory of compiled kernels of every version."""
    base = os.environ.get("DLO_SIM_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "dlo_sim"


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


def miss(name: str, kept: bool) -> None:
    """Machine code is not there: say once per process that it is compiled, or do not let it be.

    Args:
        name: of the entry.
        kept: whether it will be on disk afterwards.

    Raises:
        NotCompiledError: inside `only_loading`, if it could be kept.
    """
    if kept and getattr(_this_thread, "only_loads", False):
        raise NotCompiledError(f"{name} is not compiled")
    act = getattr(_this_thread, "on_miss", None)
    if kept and act is not None:
        _this_thread.on_miss = None
        act()
    told = f"kept in {base_directory()}"
    if not kept:
        told = f"at every start: {base_directory()} cannot be written; set DLO_SIM_CACHE"
    if told not in _said:
        _said.add(told)
        _log.info("compiling the step of this scene, some 10 to 30 s, %s", told)
