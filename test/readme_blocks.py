"""The parts of the pages that are made from the code, and the picture of the rooms.

    python test/readme_blocks.py

writes them anew; test/test_readme.py fails while they are not what the code says.
"""

from __future__ import annotations

import importlib
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "resource" / "rooms.svg"


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


PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "config/README.md": {"parameters": parameters},
    "config/NODE.md": {"refusals": refusals, "events": events},
    "config/METHODS.md": {"methods": methods},
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


# ------------------------------------------------------------------------------ the rooms' picture

# Room -> (column, row, what it holds). Who imports whom is read from the code.
PLACES: dict[str, tuple[float, int, str]] = {
    "cli": (1.0, 0, "the command dlo_sim"),
    "ros": (0.0, 2, "the node; knows rclpy"),
    "doctor": (0.0, 1, "findings, what to do"),
    "demo": (1.0, 1, "generated bag, its prediction"),
    "studies": (2.0, 1, "measurements, reports"),
    "view": (1.0, 2, "pages, films, pictures"),
    "identification": (2.0, 2, "numbers from recordings"),
    "replay": (1.0, 3, "bag in, bag out; knows rosbags"),
    "tuning": (2.0, 3, "settings tried, the fastest found"),
    "batch": (2.0, 4, "workers, many cables"),
    "session": (1.1, 4, "messages in, time, messages out"),
    "simulation": (1.0, 5, "a scene, stepped"),
    "methods": (1.0, 6, "time loops"),
    "engine": (1.0, 7, "forces, tangents, energies"),
    "terms": (1.0, 8, "energy densities"),
    "scene": (0.0, 6, "parameters, checks, file"),
    "compiling": (1.0, 9, "machine code, vector lanes"),
    "core": (2.0, 6, "splines, methods, rotations"),
    "process": (0.0, 5, "signals, whole files"),
}
COLORS = (
    dict.fromkeys(range(4), "#dbe7f5") | {4: "#dff0d8"} | dict.fromkeys(range(5, 10), "#fbe6cf")
)
WIDTH, HEIGHT, GAP_X, GAP_Y, EDGE = 230, 52, 40, 46, 14


def imports() -> dict[str, set[str]]:
    """Room -> rooms that its modules import."""
    code = importlib.import_module("test_layering")  # which reads the imports

    found: dict[str, set[str]] = {}
    for module in code.MODULES:
        room = code.room(module)
        used = {code.room(name) for name in code.imported(module) if name.startswith("dlo_sim.")}
        found.setdefault(room, set()).update(used - {room, ""})
    found.pop("")
    return found


def direct(arrows: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The arrows that no path over another room replaces."""

    def reached(room: str) -> set[str]:
        return arrows[room].union(*(reached(below) for below in arrows[room]))

    return {
        room: {to for to in below if not any(to in reached(other) for other in below - {to})}
        for room, below in arrows.items()
    }


def box(room: str) -> tuple[float, float]:
    """Upper left corner of a room."""
    column, row, _ = PLACES[room]
    return EDGE + column * (WIDTH + GAP_X), EDGE + row * (HEIGHT + GAP_Y)


def rooms() -> str:
    """The picture as SVG: rooms as boxes, an arrow from each room to those that it imports."""
    arrows = direct(imports())
    missing = set(arrows) - set(PLACES)
    assert not missing, f"give {', '.join(sorted(missing))} a place in {Path(__file__).name}"
    columns = max(column for column, _, _ in PLACES.values())
    rows = max(row for _, row, _ in PLACES.values())
    size = (
        2 * EDGE + columns * (WIDTH + GAP_X) + WIDTH,
        2 * EDGE + rows * (HEIGHT + GAP_Y) + HEIGHT,
    )
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" '
        f'width="{size[0]:g}" height="{size[1]:g}" font-family="sans-serif">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for room in sorted(arrows):
        parts += [line(room, below) for below in sorted(arrows[room])]
    for room in sorted(arrows):
        x, y = box(room)
        _, row, text = PLACES[room]
        middle = x + WIDTH / 2
        parts += [
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="7" '
            f'fill="{COLORS[row]}" stroke="#555"/>',
            f'<text x="{middle:g}" y="{y + 21:g}" font-size="16" font-weight="bold" '
            f'text-anchor="middle">{room}</text>',
            f'<text x="{middle:g}" y="{y + 41:g}" font-size="13" text-anchor="middle">'
            f"{escape(text)}</text>",
        ]
    return "\n".join([*parts, "</svg>", ""])


def line(room: str, below: str) -> str:
    """An arrow from the lower edge of a room to the upper edge of one below it."""
    (x0, y0), (x1, y1) = box(room), box(below)
    shift = (x1 - x0) / 6  # lines to one side leave and arrive on that side
    start = (x0 + WIDTH / 2 + shift, y0 + HEIGHT)
    end = (x1 + WIDTH / 2 - shift, y1)
    length = math.dist(start, end)
    dx, dy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    left = (end[0] - 10 * dx - 4 * dy, end[1] - 10 * dy + 4 * dx)
    right = (end[0] - 10 * dx + 4 * dy, end[1] - 10 * dy - 4 * dx)
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (end, left, right))
    return (
        f'<path d="M{start[0]:.1f} {start[1]:.1f} L{end[0]:.1f} {end[1]:.1f}" stroke="#555" '
        f'stroke-width="1.4"/><polygon points="{head}" fill="#555"/>'
    )


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for page in PAGES:
        (ROOT / page).write_text(renewed(page), encoding="utf-8")
    PICTURE.write_text(rooms(), encoding="utf-8")
