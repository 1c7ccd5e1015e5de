"""The report of a study: markdown with tables and figures, and one CSV for every figure."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from dlo_sim.studies import machine

Cell = str | int | float | None


class Report:
    """Collects text, tables and figures in a folder; `write` puts report.md beside them.

    Attributes:
        folder: where everything goes; created if it is not there.
        figures, data, tables: names of the files written so far.
    """

    def __init__(self, folder: Path, title: str, command: str, scenes: Mapping[str, Path]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.figures: list[str] = []
        self.data: list[str] = []
        self.tables: dict[str, int] = {}
        self._began = time.perf_counter()
        self._title = title
        self._provenance = {
            **machine.facts(),
            **{f"scene {name}": _portable(path) for name, path in scenes.items()},
            "command": f"`{command}`",
        }
        self._body: list[str] = []

    def section(self, title: str, level: int = 2) -> None:
        """A heading."""
        self._body.append(f"{'#' * level} {title}")

    def text(self, *paragraphs: str) -> None:
        """Paragraphs of markdown."""
        self._body += [" ".join(paragraph.split()) for paragraph in paragraphs]

    def items(self, lines: Iterable[str]) -> None:
        """A list."""
        self._body.append("\n".join(f"- {' '.join(line.split())}" for line in lines))

    def table(
        self, name: str, header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str
    ) -> None:
        """A table with its caption above, also as `<name>.csv` with all digits."""
        self.tables[name] = len(rows)
        lines = [f"**{caption}** (`{name}.csv`)", ""]
        lines.append("| " + " | ".join(header) + " |")
        lines.append("|" + "|".join("---" for _ in header) + "|")
        lines += ["| " + " | ".join(shown(cell) for cell in row) + " |" for row in rows]
        self._body.append("\n".join(lines))
        self._write_csv(f"{name}.csv", header, rows)

    def figure(
        self, name: str, figure: Figure, columns: Mapping[str, ArrayLike], caption: str
    ) -> None:
        """A picture `<name>.png`, its data `<name>.csv` and a caption.

        Args:
            columns: what is drawn, column name with unit -> values; all of one length.
        """
        figure.savefig(self.folder / f"{name}.png", dpi=110)
        self.figures.append(f"{name}.png")
        self._figure_data(name, columns)
        self._body.append(f"![{caption}]({name}.png)\n\n*{caption}* (data: `{name}.csv`)")

    def attach(self, name: str, columns: Mapping[str, ArrayLike], caption: str) -> None:
        """An animation `<name>.gif` that is already in the folder, and its data."""
        self.figures.append(f"{name}.gif")
        self._figure_data(name, columns)
        self._body.append(f"![{caption}]({name}.gif)\n\n*{caption}* (data: `{name}.csv`)")

    def write(self, summary: Sequence[str]) -> Path:
        """Write report.md: title, summary, provenance, then the body; returns its path."""
        took = time.perf_counter() - self._began
        provenance = [*self._provenance.items(), ("the study took", f"{took:.0f} s")]
        lines = [f"# {self._title}", *summary, "## Made with", "| | |\n|---|---|"]
        lines[-1] += "".join(f"\n| {key} | {value} |" for key, value in provenance)
        path = self.folder / "report.md"
        path.write_text("\n\n".join([*lines, *self._body]) + "\n", encoding="utf-8")
        return path

    def _figure_data(self, name: str, columns: Mapping[str, ArrayLike]) -> None:
        values = [np.asarray(column).ravel() for column in columns.values()]
        lengths = {len(value) for value in values}
        if len(lengths) != 1:
            raise ValueError(f"{name}: the columns of a figure's data have lengths {lengths}")
        self._write_csv(f"{name}.csv", list(columns), list(zip(*values, strict=True)))

    def _write_csv(
        self, name: str, header: Sequence[str], rows: Iterable[Sequence[object]]
    ) -> None:
        self.data.append(name)
        with (self.folder / name).open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([_plain(cell) for cell in header])
            writer.writerows([[_exact(cell) for cell in row] for row in rows])


def shown(cell: Cell) -> str:
    """A cell for people: four digits, a dash for what is not there."""
    if cell is None:
        return "-"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int | np.integer):
        return str(cell)
    value = float(cell)
    if not math.isfinite(value):
        return "none" if value > 0 else str(value)
    size = abs(value)
    if 1e-2 <= size < 1e4 or value == 0.0:
        return f"{value:.4g}"
    return f"{value:.0f}" if 1e4 <= size < 1e6 else f"{value:.2e}"


def _exact(cell: object) -> object:
    if isinstance(cell, float | np.floating):
        return repr(float(cell))
    return _plain(cell) if isinstance(cell, str) else cell


def _plain(cell: object) -> object:
    """Text without markdown's emphasis."""
    return cell.replace("**", "").replace("`", "") if isinstance(cell, str) else cell


def _portable(path: Path) -> str:
    """A shipped scene by its place in the checkout, anything else by its name."""
    try:
        return f"`{path.resolve().relative_to(machine.ROOT)}`"
    except ValueError:
        return f"`{path.name}`"
