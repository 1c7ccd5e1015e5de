"""The compiler settings shared by every kernel.

`kernel` is numba's njit with
- error_model numpy: a division by zero gives inf, which the divergence checks see, not an exception;
- fastmath {contract}: fused multiply-add only. NaN and the order of sums keep their meaning;
- noalias: arrays passed to one kernel never overlap. Without it the inner loops over knot spans
  stay scalar, a factor of four to five at 17 samples per span. The flag exists in numba's compiler
  but not among its public options; where a numba release lacks it, kernels are only slower.
- cache: machine code is kept per user in a directory named after everything it depends on.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config
from numba.core.compiler import Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True}
if hasattr(Flags, "noalias") and not hasattr(CPUTargetOptions, "noalias"):
    CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")  # type: ignore[attr-defined]
if hasattr(CPUTargetOptions, "noalias"):
    _OPTIONS["noalias"] = True


def cache_directory() -> Path:
    """Per-user directory of compiled kernels, keyed by the kernels' sources and the compiler.

    numba looks only at the file of the function itself; a kernel that calls another file's kernel
    would go stale after an upgrade. A digest over all kernel sources rules that out.
    """
    digest = hashlib.sha256()
    for part in (numba.__version__, platform.python_version(), platform.machine()):
        digest.update(part.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    base = os.environ.get("DLO_SIM_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "dlo_sim" / digest.hexdigest()[:16]


@contextlib.contextmanager
def _cached_under(directory: Path) -> Iterator[None]:
    """Let functions decorated inside keep their machine code in `directory` (numba's own setting
    is process-wide and belongs to the user, so it is put back)."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(directory)
    try:
        yield
    finally:
        config.CACHE_DIR = before


def kernel(function: F) -> F:
    """Compile `function` on first call, separately for each combination of present terms."""
    directory = cache_directory()
    with _cached_under(directory):
        try:
            compiled: F = numba.njit(cache=True, **_OPTIONS)(function)
        except RuntimeError:  # no writable cache anywhere: compile in memory, every time
            compiled = numba.njit(**_OPTIONS)(function)
    return compiled
