"""The exception for invalid scenes and values, and the wording of its messages."""

import difflib
import reprlib
from collections.abc import Iterable, Iterator

Rules = Iterator[tuple[str, str]]  # names of a group's parameters, and the problems with them

_brief = reprlib.Repr()
_brief.maxstring = _brief.maxother = _brief.maxlong = 60
_brief.maxlist = _brief.maxtuple = 8
_LONGEST_LINE = 2000


class Refusal(Exception):
    """Input that is refused: one line that names it, what is wrong and the cure."""


class SceneError(Refusal, ValueError):
    """An invalid scene or value: one line with key, value and cure."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def refusal(key: str, value: object, problem: str) -> SceneError:
    """The refusal of a key's value; `problem` is what is wrong with it, and the cure."""
    text = shown(value) if isinstance(value, bool | float | tuple) else brief(value)
    return SceneError(f"{key}: {text} {problem}")


def one_line(message: object) -> str:
    """A message, or that of an error, as one printable line of limited length; it may quote files
    and other messages.
    """
    words = [w if len(w) <= 1000 else f"{w[:50]}...{w[-50:]}" for w in str(message).split()]
    line = printable(" ".join(words))
    return line if len(line) <= _LONGEST_LINE else f"{line[:600]} ... {line[-300:]}"


def printable(text: str) -> str:
    """A text with escapes for line breaks, control characters, and bytes that are not UTF-8."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def brief(value: object) -> str:
    """Any value for an error message, shortened to one line."""
    return _brief.repr(value)


def shown(value: object) -> str:
    """A value as it is written in a scene file: `true`, `[0.0, 1.0]`, `auto`, `''`."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(shown(item) for item in value) + "]"
    if isinstance(value, str):
        return value or "''"
    return repr(value)


def nearest(key: str, known: Iterable[str]) -> str:
    """`; did you mean ...?` with the closest known key, or empty when none is close."""
    close = difflib.get_close_matches(key, list(known), n=1, cutoff=0.6)
    return f"; did you mean {close[0]}?" if close else ""
