"""Compilation to machine code, once per installation and independent of the scene.

A function with `inline` is compiled into the functions that call it, and not by itself.
A `Kernel` is a function of a fixed signature with machine code of its own, compiled once and cached
on disk. If its arguments contain groups or grids, compiled functions call it, by its address, so
that its code is not compiled again into each of them; else Python calls it. A kernel of a term is
loaded only for scenes with that term, and a call on arrays without it does nothing.

Settings: error_model numpy (a division by zero gives inf, which the divergence checks detect, not
an exception); fastmath {contract} (fused multiply-add only; NaN and the order of sums are kept).
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import inspect
import os
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numba import cfunc, config, njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder

from dlo_sim.compiling.directory import kept, many_kept, say_not_kept
from dlo_sim.compiling.groups import Grid, GroupKind

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}

ARRAY = types.Array(types.float64, 1, "C")  # a numpy array that Python passes
ARRAY_2D = types.Array(types.float64, 2, "C")
ARRAY_3D = types.Array(types.float64, 3, "C")
STRIDED = types.Array(types.float64, 2, "A")
STRIDED_WHOLES = types.Array(types.int64, 2, "A")
COUNTS = types.UniTuple(types.int64, 3)
YES, NO = np.bool_(True), np.bool_(False)  # literal True makes numba compile another specialisation


class _Inlined(JITCodeLibrary):
    """Code that is only inlined: by itself neither optimised nor made into machine code, which
    saves a fifth of all compilation. Numba has no public way to ask for this.
    """

    @property
    def codegen(self) -> Any:
        """Asked by numba for `set_env`."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Machine code would have an environment."""

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _InlineCompiler(CompilerBase):
    """Numba's compiler, with such a library."""

    def define_pipelines(self) -> list[Any]:
        """Numba's only pipeline."""
        state = self.state
        state.library = _Inlined(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return [DefaultPassBuilder.define_nopython_pipeline(state)]


# An inline function that is not inlined would be a function of every kernel that calls it,
# optimised apart in each; which of them runs would depend on the order of loading, and so would the
# bits. Nobody calls its wrappers for Python.
_INLINE: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inline: Callable[[F], F] = njit(**_INLINE, forceinline=True, pipeline_class=_InlineCompiler)


@ctypes.CFUNCTYPE(None)
def _not_loaded() -> None:
    """What is called in place of a kernel that was not loaded."""
    os.write(2, b"dlo_sim: a compiled function was called that is not loaded for its terms\n")
    os.abort()


_NOT_LOADED_AT = ctypes.cast(_not_loaded, ctypes.c_void_p).value
_called: list[Kernel] = []  # those that compiled functions call
_loaded: set[int] = set()  # terms for which all of these are


class Kernel:
    """A compiled function of a fixed signature.

    Attributes:
        terms: bits of the terms that need it; 0: every scene may. If its first argument is a group
            with a number `terms` that has none of these bits, a call does nothing and returns zero.
        family: bits of the methods, or of the functions that Python calls, that need it; 0: all
            may. Of a function that Python calls: bits of what it needs beyond its scene's terms.
    """

    def __init__(
        self, function: Callable[..., Any], signature: Any, terms: int, family: int
    ) -> None:
        self.__doc__ = function.__doc__
        self.function, self.terms, self.family = function, terms, family
        self._signature = signature
        fields = getattr(signature.args[0], "fields", {}) if signature.args else {}
        self.asks_for_terms = terms != 0 and "terms" in fields
        self._code: Callable[..., Any] | None = None
        self._native: Any = None  # keeps the machine code that `_address` points to
        self._address = np.full(1, _NOT_LOADED_AT, dtype=np.int64)
        if not config.DISABLE_JIT and any(isinstance(k, (Grid, GroupKind)) for k in signature.args):
            _make_callable(self, signature, self._address.ctypes.data)
            _called.append(self)
            _loaded.clear()

    @property
    def name(self) -> str:
        """Its name, with that of its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name: a copy in another process is the kernel of that name there."""
        return _named, (self.function.__module__, self.function.__qualname__)

    def code(self, terms: int = 0) -> Callable[..., Any]:
        """The function for Python; it and all that compiled functions may call for these terms are
        compiled or read from disk at the first use.
        """
        terms |= self.family
        if self._code is None or terms not in _loaded:
            if config.DISABLE_JIT:
                return self.function
            with _collector_waits(), many_kept():
                load(terms)
                self._code = self._code or self._compiled(njit, nogil=True, no_cfunc_wrapper=True)
        return self._code

    def is_needed(self, terms: int) -> bool:
        """Whether scenes with these terms, and methods of these families, may call it."""
        return all(not needs or needs & terms for needs in (self.terms, self.family))

    def load_native(self) -> None:
        """Let compiled functions call it."""
        if self._native is None:
            self._native = self._compiled(cfunc)
            self._address[0] = self._native.address

    def _compiled(self, compiler: Callable[..., Any], **more: Any) -> Any:
        try:
            with kept(self.name):
                return compiler(self._signature, cache=True, **_OPTIONS, **more)(self.function)
        except OSError as error:
            where = "" if error.filename is None else f"{error.filename} cannot be written: "
            say_not_kept(f"{where}{error.strerror or error}")
            return compiler(self._signature, **_OPTIONS, **more)(self.function)

    def __call__(self, *arguments: Any) -> Any:
        """Call it from Python; `code` for other terms than those of every scene."""
        if self.asks_for_terms and not arguments[0].terms & self.terms:
            result = self._signature.return_type
            return (0.0,) * len(result) if isinstance(result, types.BaseTuple) else 0
        return self.code()(*arguments)


def load(terms: int) -> None:
    """Compile or read from disk all that compiled functions may call for these terms."""
    if terms not in _loaded:
        for called in _called:
            if called.is_needed(terms):
                called.load_native()
        _loaded.add(terms)


@contextlib.contextmanager
def _collector_waits() -> Iterator[None]:
    """Context without the search for reference cycles, which would take a tenth of a compilation:
    numba makes many objects, and few cycles.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def kernel(
    result: Any, *arguments: Any, terms: int = 0, family: int = 0
) -> Callable[[Callable[..., Any]], Kernel]:
    """Decorator: make a function a kernel of this signature, which scenes with `terms` and methods
    of a `family` need.
    """
    found = types.Tuple(result) if isinstance(result, tuple) else result
    return lambda function: Kernel(function, found(*arguments), terms, family)


def _named(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


if config.DISABLE_JIT:

    def _make_callable(called: Kernel, signature: Any, cell: int) -> None:
        """Pieces are called as Python functions."""

else:
    from llvmlite import binding, ir
    from numba.core import cgutils
    from numba.extending import lower_builtin, type_callable

    from dlo_sim.compiling.groups import read_field

    def _make_callable(called: Kernel, signature: Any, cell: int) -> None:
        """Let compiled code call a kernel: at the address that the memory at `cell` contains.

        The code, which outlives the process on disk, finds the cell by the name of the kernel.
        """
        binding.add_symbol(called.name, cell)

        def typed(context: Any) -> Any:
            def resolve(*given: Any) -> Any:
                return signature

            resolve.__signature__ = inspect.signature(called.function)  # type: ignore[attr-defined]
            return resolve

        def code(context: Any, builder: Any, asked: Any, values: Any) -> Any:
            kinds = [context.get_value_type(kind) for kind in signature.args]
            kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
            at = builder.module.globals.get(called.name)
            if at is None:
                at = ir.GlobalVariable(builder.module, ir.IntType(64), called.name)
            void = signature.return_type == types.void
            result = None if void else cgutils.alloca_once(builder, kind.return_type)
            if result is not None:
                builder.store(ir.Constant(kind.return_type, None), result)
            present = ir.Constant(ir.IntType(1), 1)
            if called.asks_for_terms:
                terms = read_field(context, builder, signature.args[0], values[0], "terms")
                mask = ir.Constant(terms.type, called.terms)
                present = builder.icmp_signed("!=", builder.and_(terms, mask), mask.type(0))
            with builder.if_then(present):
                native = builder.inttoptr(builder.load(at), kind.as_pointer())
                found = builder.call(native, values)
                if result is not None:
                    builder.store(found, result)
            return context.get_dummy_value() if result is None else builder.load(result)

        type_callable(called)(typed)
        lower_builtin(called, *signature.args)(code)
