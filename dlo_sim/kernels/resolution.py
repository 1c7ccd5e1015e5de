"""What numba's operators give for which types of operands, found once.

numba goes through all definitions of an operator, some ten for a sum, at every place where it is
used, once to infer types and up to four times more to write code; and it does not remember where
it found nothing. That was a sixth of the time that a scene took to compile.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.core.datamodel import models, register_default
from numba.core.errors import TypingError
from numba.core.typing import Context


class _Function(types.Function):
    """A builtin function that remembers the signature for each list of argument types."""

    def __init__(self, templates: Any) -> None:
        super().__init__(templates)
        self._found: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return super().get_call_type(context, args, kws)
        key = tuple(args)
        found = self._found.get(key)
        if found is None:
            try:
                found = super().get_call_type(context, args, kws)
            except TypingError as error:
                found = error.with_traceback(None)
            self._found[key] = found
        if isinstance(found, TypingError):
            raise found
        return found


register_default(_Function)(models.OpaqueModel)  # as numba's own class; no value is ever kept


class _Context(Context):
    """A typing context like another one, of which it shares all content, whose functions remember.

    Only kernels are compiled in it: what others compile in the same process is not affected.
    """

    def __init__(self, original: Any) -> None:
        self.__dict__.update(vars(original))
        self._original = original
        self._remembering: dict[Any, Any] = {}

    def refresh(self) -> None:
        self._original._load_builtins()

    def _lookup_global(self, gv: Any) -> Any:
        found = super()._lookup_global(gv)
        if type(found) is not types.Function:
            return found
        function = self._remembering.get(found)
        if function is None:
            function = self._remembering[found] = _Function(found.templates)
        return function


_contexts: dict[int, Any] = {}


def remembering(context: Any) -> Any:
    """The context in which kernels are compiled instead of `context`."""
    if isinstance(context, _Context) or type(context) is not Context:
        return context
    if id(context) not in _contexts:
        _contexts[id(context)] = _Context(context)
    return _contexts[id(context)]
