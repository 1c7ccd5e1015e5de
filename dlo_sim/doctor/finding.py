"""One thing that was looked at."""

from __future__ import annotations

from typing import NamedTuple

OK, NOTE, PROBLEM = "ok", "note", "problem"


class Finding(NamedTuple):
    """What was found, and what to do about it; a problem keeps the node from doing its work."""

    level: str
    what: str
    cure: str = ""


def ok(what: str) -> Finding:
    """As it should be."""
    return Finding(OK, what)


def note(what: str, cure: str = "") -> Finding:
    """Good to know."""
    return Finding(NOTE, what, cure)


def problem(what: str, cure: str) -> Finding:
    """To be mended."""
    return Finding(PROBLEM, what, cure)
