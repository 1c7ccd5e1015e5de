"""The report of a study: markdown with tables and figures, and one CSV for each of them."""

from __future__ import annotations

import csv
import importlib.metadata
import math
import os
import platform
import subprocess
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from dlo_sim import __version__
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.studies import Outcome

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("numpy", "numba", "llvmlite", "matplotlib")
Cell = str | int | float | None
SCALES = {"%": 1e2, "ppm": 1e6, "cm": 1e2, "mm": 1e3, "ms": 1e3, "us": 1e6, "ns": 1e9, "KB": 1e-3}


@dataclass(frozen=True)
class Column:
    """A column of a table, or an axis of a figure: values in SI, shown in a unit.

    Attributes:
        header: `name [unit]`. scale: factor from SI to the unit, of which only the part before the
            first slash counts (`us/step` as `us`); 1 for units not in `SCALES`.
        form: format of numbers that are not whole, in the report; default: `shown`.
    """

    header: str
    scale: float = 1.0
    form: str = ""

    @classmethod
    def of(cls, words: str, form: str = "") -> Column:
        """The column for a header `step [us]`, or `spread [%] {:.0f}` with its own format."""
        header, _, own = words.removesuffix("}").partition(" {:")
        unit = header.removesuffix("]").rpartition(" [")[2] if header.endswith("]") else ""
        return cls(header, SCALES.get(unit.partition("/")[0], 1.0), own or form)

    def scaled(self, cell: Cell) -> Cell:
        """A cell converted to the unit; text and missing values are unchanged."""
        if self.scale == 1.0 or cell is None or isinstance(cell, str):
            return cell
        return cell * self.scale

    def shown(self, cell: Cell) -> str:
        """A scaled cell as text."""
        plain = cell is None or isinstance(cell, str | int) or not math.isfinite(cell)
        return shown(cell) if plain or not self.form else format(cell, self.form)


class Report:
    """Collects text, tables and figures in a folder, created if missing; `outcome` writes
    report.md. `figures`, `data` and `tables` list what has been written so far.
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
            **facts(),
            **{f"scene {name}": _portable(path) for name, path in scenes.items()},
            "command": f"`{command}`",
        }
        self._body: list[str] = []

    def section(self, title: str, level: int = 2) -> None:
        """Add a heading."""
        self._body.append(f"{'#' * level} {title}")

    def text(self, *paragraphs: str) -> None:
        """Add paragraphs of markdown."""
        self._body += [" ".join(paragraph.split()) for paragraph in paragraphs]

    def table(
        self,
        name: str,
        header: str | Sequence[str],
        rows: Iterable[Sequence[Cell]],
        caption: str,
        form: str = "",
    ) -> None:
        """Add a table with its caption, also as `<name>.csv` with all digits.

        Args:
            header: columns as for `Column.of`, `method | step [us]`, or a list of them.
            rows: one cell per column, in SI; None is shown as a dash.
            form: format of columns without their own.
        """
        words = header if isinstance(header, str) else " | ".join(header)
        columns = [Column.of(one, form) for one in words.split(" | ")]
        cells = [[c.scaled(x) for c, x in zip(columns, row, strict=True)] for row in rows]
        headers = [column.header for column in columns]
        for_people = [[c.shown(x) for c, x in zip(columns, row, strict=True)] for row in cells]
        lines = [f"| {' | '.join(row)} |" for row in (headers, *for_people)]
        lines.insert(1, "|" + "---|" * len(columns))
        self._body.append("\n".join([f"**{caption}** (`{name}.csv`)", "", *lines]))
        self.tables[name] = len(cells)
        self._write_csv(name, headers, cells)

    def figure(
        self, name: str, figure: Figure, columns: Mapping[str, ArrayLike], caption: str
    ) -> None:
        """Add a figure `<name>.png`, its data `<name>.csv` (header -> values) and a caption."""
        write_atomically(
            self.folder / f"{name}.png", lambda path: figure.savefig(path, format="png", dpi=110)
        )
        self.attach(f"{name}.png", columns, caption)

    def attach(self, file: str, columns: Mapping[str, ArrayLike], caption: str) -> None:
        """Add a picture that is already in the folder, and its data; see `figure`."""
        name = file.rpartition(".")[0]
        values = [np.asarray(column).ravel() for column in columns.values()]
        lengths = {len(value) for value in values}
        if len(lengths) != 1:
            raise ValueError(f"{name}: the columns of a figure's data have lengths {lengths}")
        self.figures.append(file)
        self._write_csv(name, list(columns), zip(*values, strict=True))
        self._body.append(f"![{caption}]({file})\n\n*{caption}* (data: `{name}.csv`)")

    def outcome(self, verdicts: Mapping[str, str], summary: Sequence[str] = ()) -> Outcome:
        """Write report.md: title, summary (default: a line for each verdict), provenance, body."""
        items = "\n".join(f"- {name}: **{verdict}**" for name, verdict in verdicts.items())
        took = f"{time.perf_counter() - self._began:.0f} s"
        facts = {**self._provenance, "the study took": took}.items()
        made_with = ["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in facts)]
        head = [f"# {self._title}", *(summary or [items]), "## Made with", "\n".join(made_with)]
        path = self.folder / "report.md"
        text = "\n\n".join([*head, *self._body]) + "\n"
        write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))
        return Outcome(str(path), self.figures, self.data, self.tables, dict(verdicts))

    def _write_csv(
        self, name: str, header: Sequence[str], rows: Iterable[Sequence[object]]
    ) -> None:
        if f"{name}.csv" in self.data:
            raise ValueError(f"{name}.csv: is written already; give table and figure two names")
        self.data.append(f"{name}.csv")

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow([_plain(cell) for cell in header])
                writer.writerows([[_plain(cell) for cell in row] for row in rows])

        write_atomically(self.folder / f"{name}.csv", write)


def shown(cell: Cell) -> str:
    """A cell as text: four digits, a dash for a missing value."""
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


def columns(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Rows as a figure's data: name -> column."""
    cells = zip(*rows, strict=True)
    return {name: list(column) for name, column in zip(header, cells, strict=True)}


def _plain(cell: object) -> object:
    """A cell of a CSV file: all digits, text without markdown emphasis."""
    if isinstance(cell, float | np.floating):
        return repr(float(cell))
    return cell.replace("**", "").replace("`", "") if isinstance(cell, str) else cell


def _portable(path: Path) -> str:
    """A shipped scene by its path in the checkout, any other by its name."""
    try:
        return f"`{path.resolve().relative_to(ROOT)}`"
    except ValueError:
        return f"`{path.name}`"


def facts() -> dict[str, str]:
    """Machine, versions and commit, as lines of a table."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} logical cores",
        "system": platform.platform(),
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        **{name: importlib.metadata.version(name) for name in PACKAGES},
        "dlo_sim": __version__,
        "commit": commit(),
    }


def processor() -> str:
    """Name of the processor as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def commit() -> str:
    """Commit of this checkout, with a note on uncommitted changes; or why it is not known."""
    if not (ROOT / ".git").exists():
        return "not run from a checkout"
    git, words = ["git", "-C", str(ROOT)], ["status", "--porcelain", "--untracked-files=no"]
    try:
        name, changed = (
            subprocess.run([*git, *more], capture_output=True, check=True, text=True, timeout=10)
            for more in (["rev-parse", "--short=12", "HEAD"], words)
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown (git did not answer, or does not know this checkout)"
    return name.stdout.strip() + (" with uncommitted changes" if changed.stdout.strip() else "")
