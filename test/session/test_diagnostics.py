"""Every event that the code reports is one that the diagnostics know."""

import ast
from pathlib import Path

import dlo_sim.session.diagnostics as diagnostics

PACKAGE = Path(diagnostics.__file__).parents[1]


def noted(source: str) -> set[str]:
    """First arguments of the calls of `note` and `_note` that are written out."""
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    notes = [call for call in calls if getattr(call.func, "attr", "") in ("note", "_note")]
    first = [call.args[0] for call in notes if call.args]
    return {one.value for one in first if isinstance(one, ast.Constant)}


def test_events_are_known():
    sources = [*PACKAGE.glob("session/*.py"), *PACKAGE.glob("ros/*.py")]
    found = set().union(*(noted(path.read_text(encoding="utf-8")) for path in sources))
    assert len(found) > 5
    assert found <= diagnostics.EVENTS.keys()
