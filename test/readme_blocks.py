"""The parts of the pages that are made from the code, and the diagram of the rooms.

    python test/readme_blocks.py

writes them anew; test/test_readme.py fails while they are not what the code says.
"""

from __future__ import annotations

import importlib
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A markdown table without a trailing newline."""
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def parameters() -> str:
    """The parameter table."""
    from dlo_sim.scene.description import markdown_table

    return markdown_table()


def methods() -> str:
    """The methods that `integrator.method` takes."""
    from dlo_sim.core.methods import METHODS, ZHAI

    rows = []
    for name, method in METHODS.items():
        kept = [
            word
            for word, holds in (
                ("symmetric", method.symmetric),
                ("symplectic", method.symplectic),
                ("conserves energy", method.conserves_energy),
            )
            if holds
        ]
        damping = [
            word
            for word, valid in (
                ("mass", method.mass_damping),
                ("stiffness", method.stiffness_damping),
            )
            if valid
        ]
        limit = method.stability_limit
        rows.append(
            (
                f"`{name}`",
                "two-step" if method.family == ZHAI else method.family.replace("_", "-"),
                str(method.order),
                ", ".join(kept) or "-",
                "none" if math.isinf(limit) else f"{limit:.4g}",
                ", ".join(damping) or "none",
                method.source,
            )
        )
    header = ("method", "kind", "order", "properties", "largest stable omega tau", "damping")
    return table((*header, "source"), rows)


def refusals() -> str:
    """Why a message can be refused."""
    from dlo_sim.session.diagnostics import REASONS

    return table(("refused as", "what it was"), [(f"`{k}`", v) for k, v in REASONS.items()])


def events() -> str:
    """What else is counted."""
    from dlo_sim.session.diagnostics import EVENTS

    return table(("counted as", "what happened"), [(f"`{k}`", v) for k, v in EVENTS.items()])


def rooms() -> str:
    """The rooms, with an arrow to each that is imported and that no other path leads to."""
    code = importlib.import_module("test_layering")  # which reads the imports
    arrows: dict[str, set[str]] = {}
    for module in code.MODULES:
        used = {code.room(name) for name in code.imported(module) if name.startswith("dlo_sim.")}
        arrows.setdefault(code.room(module), set()).update(used - {code.room(module), ""})
    arrows.pop("")

    def reached(room: str) -> set[str]:
        return arrows[room].union(*map(reached, arrows[room]))

    lines = []
    for room, below in sorted(arrows.items()):
        direct = sorted(to for to in below if not any(to in reached(one) for one in below - {to}))
        lines += [f"  {room} --> {' & '.join(direct)}"] if direct else []
    return "\n".join(["```mermaid", "flowchart TD", *lines, "```"])


PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "config/README.md": {"parameters": parameters},
    "config/NODE.md": {"refusals": refusals, "events": events},
    "config/METHODS.md": {"methods": methods},
    "CONTRIBUTING.md": {"rooms": rooms},
}
"""Page -> block -> what makes it."""


def found_blocks(text: str) -> dict[str, str]:
    """The blocks that a page holds."""
    pattern = r"<!-- ([a-z]+):begin[^\n]*-->\n(.*?)\n<!-- \1:end -->"
    return {name: body.strip() for name, body in re.findall(pattern, text, re.DOTALL)}


def renewed(page: str) -> str:
    """The text of a page with its blocks made anew."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, make in PAGES[page].items():
        begin, end = re.search(rf"<!-- {name}:begin[^\n]*-->\n", text), f"\n<!-- {name}:end -->"
        assert begin is not None, f"{page} has no place for {name}"
        text = text[: begin.end()] + make() + text[text.index(end, begin.end() - 1) :]
    return text


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for page in PAGES:
        (ROOT / page).write_text(renewed(page), encoding="utf-8")
