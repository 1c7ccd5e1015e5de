"""Compilation to machine code, once per installation and independent of the scene.

A `part` is compiled into the functions that call it, and not by itself. A `Piece` is a function of
a fixed signature with machine code of its own, compiled at its first use and cached on disk; other
compiled functions call it by its address, so that its code is not compiled again into each of them.
A piece of a term is loaded only for scenes with that term, and a call on arrays without it does
nothing.

Settings: error_model numpy (a division by zero gives inf, which the divergence checks detect, not
an exception); fastmath {contract} (fused multiply-add only; NaN and the order of sums are kept).
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import inspect
from collections.abc import Callable, Iterator
from types import FunctionType, ModuleType
from typing import Any, TypeVar

import numpy as np
from numba import cfunc, config, njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes, InlineOverloads, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables, WithLifting

from dlo_sim.compiling.directory import kept, many_kept, say_not_kept

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}

ARRAY = types.Array(types.float64, 1, "C")  # a numpy array that Python passes
ARRAY_2D = types.Array(types.float64, 2, "C")
ARRAY_3D = types.Array(types.float64, 3, "C")
STRIDED = types.Array(types.float64, 2, "A")
STRIDED_WHOLES = types.Array(types.int64, 2, "A")
COUNTS = types.UniTuple(types.int64, 3)
YES, NO = np.bool_(True), np.bool_(False)  # literal True makes numba compile another specialisation

# Passes for what compiled functions do not contain: closures, `with`, overloads, array expressions.
_NEEDLESS = (InlineClosureLikes, WithLifting, InlineInlinables, InlineOverloads, NopythonRewrites)


class _PieceCompiler(CompilerBase):
    """Numba's compiler, without passes that would find nothing to do."""

    def define_pipelines(self) -> list[Any]:
        """Passes of the only pipeline."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [one for one in passes.passes if one[0] not in _NEEDLESS]
        passes.finalize()
        return [passes]


class _Inlined(JITCodeLibrary):
    """Code that is only inlined: by itself neither optimised nor made into machine code."""

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


@register_pass(mutates_CFG=False, analysis_only=True)
class _Inlining(AnalysisPass):
    """Pass that makes the code of a function `_Inlined`."""

    _name = "dlo_sim_inlining"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Give the function its library, as the pass for lowering does if there is none."""
        state.library = _Inlined(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


class _PartCompiler(_PieceCompiler):
    """The same for functions that are only inlined."""

    def define_pipelines(self) -> list[Any]:
        """Passes of the only pipeline."""
        [passes] = super().define_pipelines()
        passes.add_pass_after(_Inlining, AnnotateTypes)
        passes.finalize()
        return [passes]


# A part that is not inlined would be a function of every piece that calls it, optimised apart in
# each; which of them runs would depend on the order of loading, and so would the bits. Nobody calls
# its wrappers for Python.
_PART: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
part: Callable[[F], F] = njit(**_PART, forceinline=True, pipeline_class=_PartCompiler)


class Piece:
    """A compiled function of a fixed signature, to be called from Python and from compiled code.

    Attributes:
        terms: bits of the terms that need it; 0: every scene may. If its first argument is a group
            with a number `terms` that has none of these bits, a call does nothing and returns zero.
    """

    def __init__(self, function: Callable[..., Any], signature: Any, terms: int) -> None:
        self.__doc__ = function.__doc__
        self.function, self.terms = function, terms
        self._signature = signature
        fields = getattr(signature.args[0], "fields", {}) if signature.args else {}
        self.asks_for_terms = terms != 0 and "terms" in fields
        self._code: Callable[..., Any] | None = None
        self._native: Any = None  # keeps the machine code that `_address` points to
        self._address = np.zeros(1, dtype=np.int64)
        self._ready: set[int] = set()
        if not config.DISABLE_JIT:
            _make_callable(self, signature, self._address.ctypes.data)

    @property
    def name(self) -> str:
        """Its name, with that of its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name: a copy in another process is the piece of that name there."""
        return _named, (self.function.__module__, self.function.__qualname__)

    def code(self, terms: int = 0) -> Callable[..., Any]:
        """The function for Python; it and what it calls for these terms are compiled or read from
        disk at the first use.
        """
        if config.DISABLE_JIT:
            return self.function
        if terms not in self._ready:
            with _collector_waits(), many_kept():
                self._load(terms)
                if self._code is None:
                    self._code = self._compiled(njit, nogil=True)
            self._ready.add(terms)
        assert self._code is not None
        return self._code

    def _load(self, terms: int) -> None:
        """Load whatever it calls for these terms, directly or through others."""
        wanted, known = [self], {self.name}
        while wanted:
            for callee in wanted.pop().calls():
                if callee.name not in known and (not callee.terms or callee.terms & terms):
                    known.add(callee.name)
                    wanted.append(callee)
                    callee._load_native()

    def calls(self) -> Iterator[Piece]:
        """Pieces that its code calls, itself or through parts."""
        seen: set[int] = set()
        waiting: list[Any] = [self.function]
        while waiting:
            function = waiting.pop()
            for found in _globals_of(function):
                if id(found) in seen:
                    continue
                seen.add(id(found))
                if isinstance(found, Piece):
                    yield found
                elif isinstance(found, CPUDispatcher):
                    waiting.append(found.py_func)

    def _load_native(self) -> None:
        if self._native is None:
            self._native = self._compiled(cfunc)
            self._address[0] = self._native.address

    def _compiled(self, compiler: Callable[..., Any], **more: Any) -> Any:
        more["pipeline_class"] = _PieceCompiler
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
            return 0
        return self.code()(*arguments)


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


def piece(result: Any, *arguments: Any, terms: int = 0) -> Callable[[Callable[..., Any]], Piece]:
    """Decorator: make a function a piece of this signature, which scenes with `terms` need."""
    found = types.Tuple(result) if isinstance(result, tuple) else result
    return lambda function: Piece(function, found(*arguments), terms)


def _named(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


def _globals_of(function: Callable[..., Any]) -> Iterator[Any]:
    """What the names in the code of a function stand for, attributes of modules included."""
    assert isinstance(function, FunctionType)
    names = function.__code__.co_names
    for name in names:
        found = function.__globals__.get(name)
        yield found
        if isinstance(found, ModuleType):
            yield from (getattr(found, one) for one in names if hasattr(found, one))


if config.DISABLE_JIT:

    def _make_callable(called: Piece, signature: Any, cell: int) -> None:
        """Pieces are called as Python functions."""

else:
    from llvmlite import binding, ir
    from numba.core import cgutils
    from numba.extending import lower_builtin, type_callable

    from dlo_sim.compiling.groups import read_field

    def _make_callable(called: Piece, signature: Any, cell: int) -> None:
        """Let compiled code call a piece: at the address that the memory at `cell` contains.

        The code, which outlives the process on disk, finds the cell by the name of the piece.
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
