"""The compiler settings shared by every kernel.

`kernel` and `entry` are numba's njit with
- error_model numpy: a division by zero gives inf, which the divergence checks see, not an
  exception;
- fastmath {contract}: fused multiply-add only. NaN and the order of sums keep their meaning;
- noalias: arrays passed to one kernel never overlap. Without it the inner loops over knot spans
  stay scalar, a factor of four to five at 17 samples per span. The flag exists in numba's compiler
  but not among its public options; where a numba release lacks it, kernels are only slower;
- _nrt False: no reference counting. Kernels allocate nothing; counting references to a scene's
  some forty arrays at every call took longer than the arithmetic (Forest-Ruth at 9 control points
  and 101 samples: 3.5 us per step with, 1.9 us without);
- cache (entries): machine code is kept per user in a directory named after everything it depends
  on (`cache`, `code_files`);
- pipeline_class: numba's compiler without what only others need (`compiler`, `lowering`,
  `resolution`). A hanging cable takes 16 s instead of 24 s to compile, and the machine code is as
  fast. It relies on numba's internals; with a release where these differ, numba's own compiler is
  used, with a warning.
"""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import config
from numba.core.compiler import Compiler, Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaPendingDeprecationWarning
from numba.core.options import TargetOptions

from dlo_sim.kernels.cache import LOGGER, cache_directory

_log = logging.getLogger(LOGGER)
F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract"},
    "nogil": True,
    "_nrt": False,
}
if hasattr(Flags, "noalias") and not hasattr(CPUTargetOptions, "noalias"):
    CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")
if hasattr(CPUTargetOptions, "noalias"):
    _OPTIONS["noalias"] = True


class _Pipeline(Compiler):
    """A kernel's way through `compiler`; from the first failure there on, through numba alone."""

    _shorter = "EntryCompiler"
    _works = True

    def __init__(self, *arguments: Any) -> None:
        self._arguments = arguments

    def compile_extra(self, func: Any) -> Any:
        failure = None
        if _Pipeline._works:
            try:
                from dlo_sim.kernels import compiler

                shorter = getattr(compiler, self._shorter)(*self._arguments)
                with warnings.catch_warnings():  # numba 0.58 gives advice on the failure
                    warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)
                    return shorter.compile_extra(func)
            except Exception as error:  # whatever another release of numba may do
                failure = error
        compiled = Compiler(*self._arguments).compile_extra(func)
        if failure is not None and _Pipeline._works:  # else it was the kernel that is wrong
            _Pipeline._works = False
            _log.warning(
                "the fast compile pipeline does not support numba %s (%s), so compiling takes "
                "several times as long; install numba 0.62 to 0.68",
                numba.__version__,
                type(failure).__name__,
            )
        return compiled


class _PartPipeline(_Pipeline):
    _shorter = "PartCompiler"


try:
    from dlo_sim.kernels.code_files import KeptCode
except (ImportError, AttributeError) as error:  # a numba release with other internals
    KeptCode = None  # type: ignore[assignment, misc]
    _log.warning(
        "numba %s cannot keep machine code on disk (%s), so it is compiled at every start; "
        "install numba 0.62 to 0.68",
        numba.__version__,
        type(error).__name__,
    )


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
    """A compiled function that only other kernels call, copied into each of them.

    It gets no wrapper for calls from Python: unpacking a scene's terms there costs more compile
    time than the function itself. Tests and tools reach it through `.py_func`.
    """
    return _part(function, forceinline=True)


def shared(function: F) -> F:
    """A kernel that exists once, for long ones with several callers and few arguments."""
    return _part(function, forceinline=False)


def _part(function: F, forceinline: bool) -> F:
    compiled: F = numba.njit(
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
        forceinline=forceinline,
        pipeline_class=_PartPipeline,
        **_OPTIONS,
    )(function)
    return compiled


def entry(function: F) -> F:
    """A kernel that Python calls. It is kept on disk with everything it calls."""
    compiled: F = numba.njit(no_cfunc_wrapper=True, pipeline_class=_Pipeline, **_OPTIONS)(function)
    if isinstance(compiled, Dispatcher):  # not where numba is switched off
        with _cached_under(cache_directory()):
            _keep(compiled)
    return compiled


def _keep(compiled: Any) -> None:
    """Have an entry look for its machine code on disk first, and leave it there."""
    if KeptCode is not None:
        with contextlib.suppress(RuntimeError):  # no file to go by: compiled every time
            compiled._cache = KeptCode(compiled.py_func)


_bound: dict[object, Callable[..., Any]] = {}


def bound(function: Callable[..., Any], *arguments: object) -> Callable[..., Any]:
    """The machine code of an entry for arguments of these types, compiled if need be.

    A call of the entry itself looks at the type of every array in a scene's terms first, 10 us in
    all. A call of what this returns does not look: its arguments must keep to the types. Where
    numba is switched off (NUMBA_DISABLE_JIT), it is the entry itself, in Python.
    """
    if not isinstance(function, Dispatcher):
        return function
    kind = function, tuple(_kind(argument) for argument in arguments)
    code = _bound.get(kind)
    if code is None:
        signature = tuple(numba.typeof(argument) for argument in arguments)
        entry_of_any_type: Any = function
        entry_of_any_type.compile(signature)
        code = _bound[kind] = entry_of_any_type.overloads[signature].entry_point
    return code


def _kind(value: object) -> object:
    """What numba's type of a value depends on, found in a hundredth of the time."""
    if isinstance(value, tuple):
        return (type(value), *map(_kind, value))
    if isinstance(value, np.ndarray):
        flags = value.flags
        order = flags.c_contiguous, flags.f_contiguous
        return value.dtype, value.ndim, order, flags.aligned, flags.writeable
    return type(value)
