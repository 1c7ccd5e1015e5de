"""Compilation to machine code, once per installation and independent of the scene.

A `part` is compiled into the functions that call it. A `Piece` has a fixed signature, is compiled
at its first use and cached on disk; loops take pieces as arguments, so that the code of a piece is
not compiled again into each loop. Basic terms that a scene lacks are skipped at run time by the
bits `engine.layout.TERMS` or are factors of zero; for optional ones empty functions stand in.

Settings: error_model numpy (a division by zero gives inf, which the divergence checks detect, not
an exception); fastmath {contract} (fused multiply-add only; NaN and the order of sums are kept).
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
from numba import NumbaExperimentalFeatureWarning, config, njit, types
from numba.experimental import structref

from dlo_sim.compiling.directory import kept, say_not_kept

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True}

REALS = types.Array(types.float64, 1, "C")
WHOLES = types.Array(types.int64, 1, "C")
MATRIX = types.Array(types.float64, 2, "C")
MATRICES = types.Array(types.float64, 3, "C")
STRIDED = types.Array(types.float64, 2, "A")
STRIDED_WHOLES = types.Array(types.int64, 2, "A")
NUMBERS = types.CPointer(types.float64)
TABLE = types.CPointer(types.int64)
REAL = types.float64
WHOLE = types.int64
NOTHING = types.void
TRUTH = types.boolean
COUNTS = types.UniTuple(types.int64, 3)
YES, NO = np.bool_(True), np.bool_(False)  # literal True makes numba compile another specialisation

# Issued wherever functions of a fixed signature are arguments, at run time too; in colour where
# colorama is installed.
warnings.filterwarnings("ignore", ".*First-class function", NumbaExperimentalFeatureWarning)

part: Callable[[F], F] = njit(**_OPTIONS)


class Piece:
    """A compiled function of a fixed signature.

    Attributes:
        kind: its type, for signatures of functions that take it as an argument.
    """

    def __init__(self, function: Callable[..., Any], signature: Any) -> None:
        self.__doc__ = function.__doc__
        self.function = function
        self.kind = types.FunctionType(signature)
        self._signature = signature
        self._code: Callable[..., Any] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name: a copy in another process is the piece of that name there."""
        return _named, (self.function.__module__, self.function.__qualname__)

    @property
    def code(self) -> Callable[..., Any]:
        """The machine code, compiled or read from disk at its first use."""
        if self._code is None:
            if config.DISABLE_JIT:
                self._code = self.function
            else:
                self._code = self._compiled()
        return self._code

    def _compiled(self) -> Callable[..., Any]:
        function = self.function
        try:
            with kept(f"{function.__module__}.{function.__qualname__}"):
                return njit(self._signature, cache=True, **_OPTIONS)(function)
        except OSError as error:
            where = "" if error.filename is None else f"{error.filename} cannot be written: "
            say_not_kept(f"{where}{error.strerror or error}")
            return njit(self._signature, **_OPTIONS)(function)

    def load(self) -> None:
        """Compile it or read it from disk now, not at its first use."""
        _ = self.code

    def __call__(self, *arguments: Any) -> Any:
        """Call the machine code."""
        return self.code(*arguments)


def _named(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


def piece(result: Any, *arguments: Any) -> Callable[[Callable[..., Any]], Piece]:
    """Decorator: make a function a piece of this signature; pieces stand for their own types."""
    found = types.Tuple(result) if isinstance(result, tuple) else result
    return lambda function: Piece(function, found(*[_kind(given) for given in arguments]))


def bundle(*kinds: Any) -> Any:
    """Type of a tuple of arrays that are passed together."""
    return types.Tuple(kinds)


def _kind(given: Any) -> Any:
    if isinstance(given, tuple):
        # numba 0.58 would type a tuple that starts with a function as homogeneous.
        return types.Tuple([types.int64, *[_kind(one) for one in given]])
    return given.kind if isinstance(given, (Piece, Engine)) else given


def code_of(given: Any) -> Any:
    """Machine code of a piece; for a tuple of pieces its length, then the code of each."""
    if isinstance(given, tuple):
        return len(given), *[code_of(one) for one in given]
    return given.code


@structref.register
class _EngineType(types.StructRef):
    """Type of `Engine.code`."""


class _Handle(structref.StructRefProxy):
    """A tuple of machine code behind one pointer."""


structref.define_proxy(_Handle, _EngineType, ["pieces"])


def _handle(pieces: Any) -> Any:
    return _Handle(pieces)


class Engine:
    """The pieces, or nested tuples of pieces, that a loop calls. Compiled functions access them as
    `engine.pieces`, a tuple that starts with its length.

    Each function passed from Python costs a call some 25 us; one handle to all of them 1 us.
    """

    def __init__(self, *pieces: Any) -> None:
        self._pieces = pieces
        self.kind = _EngineType([("pieces", _kind(pieces))])

    def __getstate__(self) -> dict[str, Any]:
        """Copies and unpickled engines create their own handles."""
        return {name: value for name, value in vars(self).items() if name != "code"}

    @functools.cached_property
    def code(self) -> Any:
        """The handle to the machine code, compiled or read from disk at its first use."""
        pieces = code_of(self._pieces)
        if config.DISABLE_JIT:
            return SimpleNamespace(pieces=pieces)
        return Piece(_handle, self.kind(_kind(self._pieces))).code(pieces)
