"""The report of a study: markdown with tables and figures, and one CSV for each of them."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from dlo_sim.studies import machine
from dlo_sim.studies.catalogue import Outcome

Cell = str | int | float | None
Header = list["str | Column"]
SCALES = {"%": 1e2, "ppm": 1e6, "cm": 1e2, "mm": 1e3, "ms": 1e3, "us": 1e6, "ns": 1e9, "KB": 1e-3}


@dataclass(frozen=True)
class Column:
    """A column of a table, or an axis of a figure: values in SI, shown in a unit.

    Attributes:
        name, unit: the header is `name [unit]`. Values are multiplied by the scale of the unit up
            to the first slash (`us/step` is that of `us`), which is 1 for units not in `SCALES`.
        form: format specification in the report of what is not a whole number, e.g. ".0f"; by
            default see `shown`. The CSV has all digits.
    """

    name: str
    unit: str = ""
    form: str = ""

    @classmethod
    def of(cls, header: str | Column, form: str = "") -> Column:
        """The column that has a header such as `step [us]`."""
        if isinstance(header, Column):
            return header
        name, _, unit = header.removesuffix("]").rpartition(" [")
        return cls(name, unit, form) if header.endswith("]") else cls(header, form=form)

    @property
    def header(self) -> str:
        """What stands above the column."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def scale(self) -> float:
        """Shown value / SI value."""
        return SCALES.get(self.unit.partition("/")[0], 1.0)

    def scaled(self, cell: Cell) -> Cell:
        """A cell in the unit; text and what is not there stay as they are."""
        return (
            cell
            if self.scale == 1.0 or cell is None or isinstance(cell, str)
            else (cell * self.scale)
        )

    def shown(self, cell: Cell) -> str:
        """A scaled cell for people."""
        plain = cell is None or isinstance(cell, str | int) or not math.isfinite(cell)
        return shown(cell) if plain or not self.form else format(cell, self.form)


class Report:
    """Collects text, tables and figures in a folder; `write` puts report.md beside them.

    Attributes:
        folder: where everything goes; created if it is not there.
        figures, data, tables: names of the files written so far; of tables the number of rows.
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
        self,
        name: str,
        header: str | Sequence[str | Column],
        rows: Iterable[Sequence[Cell]],
        caption: str,
        form: str = "",
    ) -> None:
        """A table with its caption above, also as `<name>.csv` with all digits.

        Args:
            header: as it will read, `method | step [us]`, or columns and parts of such a text.
            rows: one cell per column, in SI; None is shown as a dash.
            form: of columns without one of their own.
        """
        columns = [Column.of(one, form) for part in _parts(header) for one in part]
        cells = [[c.scaled(x) for c, x in zip(columns, row, strict=True)] for row in rows]
        lines = [f"**{caption}** (`{name}.csv`)", ""]
        lines.append("| " + " | ".join(column.header for column in columns) + " |")
        lines.append("|" + "---|" * len(columns))
        for row in cells:
            words = (column.shown(cell) for column, cell in zip(columns, row, strict=True))
            lines.append("| " + " | ".join(words) + " |")
        self._body.append("\n".join(lines))
        self.tables[name] = len(cells)
        self._write_csv(name, [column.header for column in columns], cells)

    def figure(
        self, name: str, figure: Figure, columns: Mapping[str, ArrayLike], caption: str
    ) -> None:
        """A picture `<name>.png`, its data `<name>.csv` and a caption.

        Args:
            columns: what is drawn, column name with unit -> values; all of one length.
        """
        figure.savefig(self.folder / f"{name}.png", dpi=110)
        self.attach(f"{name}.png", columns, caption)

    def attach(self, file: str, columns: Mapping[str, ArrayLike], caption: str) -> None:
        """A picture that is already in the folder, and its data; see `figure`."""
        name = file.rpartition(".")[0]
        values = [np.asarray(column).ravel() for column in columns.values()]
        lengths = {len(value) for value in values}
        if len(lengths) != 1:
            raise ValueError(f"{name}: the columns of a figure's data have lengths {lengths}")
        self.figures.append(file)
        self._write_csv(name, list(columns), zip(*values, strict=True))
        self._body.append(f"![{caption}]({file})\n\n*{caption}* (data: `{name}.csv`)")

    def write(self, summary: Sequence[str]) -> Path:
        """Write report.md: title, summary, provenance, then the body; returns its path."""
        took = time.perf_counter() - self._began
        provenance = [*self._provenance.items(), ("the study took", f"{took:.0f} s")]
        facts = "| | |\n|---|---|" + "".join(f"\n| {key} | {value} |" for key, value in provenance)
        lines = [f"# {self._title}", *summary, "## Made with", facts, *self._body]
        path = self.folder / "report.md"
        path.write_text("\n\n".join(lines) + "\n", encoding="utf-8")
        return path

    def outcome(self, verdicts: Mapping[str, str], summary: Sequence[str] = ()) -> Outcome:
        """Write the report; what the study returns.

        Args:
            summary: as of `write`; a line for each verdict by default.
        """
        lines = "\n".join(f"- {name}: **{verdict}**" for name, verdict in verdicts.items())
        path = str(self.write(summary or [lines]))
        return Outcome(path, self.figures, self.data, self.tables, dict(verdicts))

    def _write_csv(
        self, name: str, header: Sequence[str], rows: Iterable[Sequence[object]]
    ) -> None:
        if f"{name}.csv" in self.data:
            raise ValueError(f"{name}.csv: is written already; give table and figure two names")
        self.data.append(f"{name}.csv")
        with (self.folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([_plain(cell) for cell in header])
            writer.writerows([[_plain(cell) for cell in row] for row in rows])


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


def _parts(header: str | Sequence[str | Column]) -> Iterator[Sequence[str | Column]]:
    for part in [header] if isinstance(header, str) else header:
        yield part.split(" | ") if isinstance(part, str) else [part]


def columns(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Rows as a figure's data: name -> column."""
    cells = zip(*rows, strict=True)
    return {name: list(column) for name, column in zip(header, cells, strict=True)}


def _plain(cell: object) -> object:
    """A cell of a CSV: all digits, text without markdown's emphasis."""
    if isinstance(cell, float | np.floating):
        return repr(float(cell))
    return cell.replace("**", "").replace("`", "") if isinstance(cell, str) else cell


def _portable(path: Path) -> str:
    """A shipped scene by its place in the checkout, anything else by its name."""
    try:
        return f"`{path.resolve().relative_to(machine.ROOT)}`"
    except ValueError:
        return f"`{path.name}`"
