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
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from dlo_sim import __version__
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.studies import Outcome, Request

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("numpy", "numba", "llvmlite", "matplotlib")
SCALES = {"%": 1e2, "ppm": 1e6, "cm": 1e2, "mm": 1e3, "ms": 1e3, "us": 1e6, "ns": 1e9, "KB": 1e-3}


class Report:
    """Collects text, tables and figures in a folder, created if missing; `outcome` writes
    report.md. `figures`, `data` and `tables` list what has been written so far.
    """

    def __init__(self, request: Request, title: str, scenes: Mapping[str, Path]) -> None:
        self.folder = request.folder
        self.folder.mkdir(parents=True, exist_ok=True)
        self.figures: list[str] = []
        self.data: list[str] = []
        self.tables: dict[str, int] = {}
        self._began = time.perf_counter()
        self._title = title
        self._made_with = facts() | {f"scene {k}": _portable(path) for k, path in scenes.items()}
        self._made_with["command"] = f"`{request.command}`"
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
        rows: Iterable[Sequence[Any]],
        caption: str,
        form: str = "",
    ) -> None:
        """Add a table with its caption, also as `<name>.csv` with all digits.

        Args:
            header: columns `method | step [us] | spread [%] {:.0f}`, or a list of them; the last
                one has its own format.
            rows: one cell per column, in SI: shown in the unit of its column, of which the part
                before a slash counts (`us/step`). None is shown as a dash.
            form: format of columns without their own.
        """
        words = (header if isinstance(header, str) else " | ".join(header)).split(" | ")
        columns = [one.removesuffix("}").partition(" {:") for one in words]
        names, forms = [one[0] for one in columns], [one[2] or form for one in columns]
        units = [one.removesuffix("]").rpartition(" [")[2].partition("/")[0] for one in names]
        scales = [SCALES.get(u, 1.0) if n.endswith("]") else 1.0 for n, u in zip(names, units)]  # noqa: B905
        cells = [[_scaled(x, by) for x, by in zip(row, scales, strict=True)] for row in rows]
        texts = [[shown(x, form) for x, form in zip(row, forms, strict=True)] for row in cells]
        lines = [f"| {' | '.join(row)} |" for row in (names, *texts)]
        lines.insert(1, "|" + "---|" * len(names))
        self._body.append("\n".join([f"**{caption}** (`{name}.csv`)", "", *lines]))
        self.tables[name] = len(cells)
        self._write_csv(name, names, cells)

    def figure(
        self, name: str, figure: Figure, columns: Mapping[str, ArrayLike], caption: str
    ) -> None:
        """Add a figure `<name>.png`, its data `<name>.csv` (header -> values) and a caption."""
        path = self.folder / f"{name}.png"
        write_atomically(path, lambda partial: figure.savefig(partial, format="png", dpi=110))
        self.attach(path.name, columns, caption)

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
        self._made_with["the study took"] = f"{time.perf_counter() - self._began:.0f} s"
        made_with = "\n".join(f"| {key} | {value} |" for key, value in self._made_with.items())
        head = [f"# {self._title}", *(summary or [items]), "## Made with"]
        text = "\n\n".join([*head, f"| | |\n|---|---|\n{made_with}", *self._body]) + "\n"
        path = self.folder / "report.md"
        write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))
        return Outcome(str(path), self.figures, self.data, self.tables, dict(verdicts))

    def _write_csv(self, name: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        if f"{name}.csv" in self.data:
            raise ValueError(f"{name}.csv: is written already; give table and figure two names")
        self.data.append(f"{name}.csv")

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerows([_plain(cell) for cell in row] for row in (header, *rows))

        write_atomically(self.folder / f"{name}.csv", write)


def shown(cell: Any, form: str = "") -> str:
    """A cell as text: in the format, or with four digits; a dash for a missing value."""
    if cell is None:
        return "-"
    if isinstance(cell, str | int | np.integer):
        return str(cell)
    value = float(cell)
    if not math.isfinite(value):
        return "none" if value > 0 else str(value)
    if form:
        return format(value, form)
    if 1e-2 <= abs(value) < 1e4 or value == 0.0:
        return f"{value:.4g}"
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e6 else f"{value:.2e}"


def columns(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Rows as a figure's data: name -> column."""
    cells = zip(*rows, strict=True)
    return {name: list(column) for name, column in zip(header, cells, strict=True)}


def _scaled(cell: Any, scale: float) -> Any:
    """A cell in the unit of its column; text and missing values are unchanged."""
    return cell if scale == 1.0 or cell is None or isinstance(cell, str) else cell * scale


def _plain(cell: Any) -> Any:
    """A cell of a CSV file: all digits, text without markdown emphasis."""
    if isinstance(cell, float | np.floating):
        return repr(float(cell))
    return cell.replace("**", "").replace("`", "") if isinstance(cell, str) else cell


def _portable(path: Path) -> str:
    """A shipped scene by its path in the checkout, any other by its name."""
    path = path.resolve()
    return f"`{path.relative_to(ROOT) if path.is_relative_to(ROOT) else path.name}`"


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
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def commit() -> str:
    """Commit of this checkout, with a note on uncommitted changes; or why it is not known."""
    if not (ROOT / ".git").exists():
        return "not run from a checkout"
    git = ["git", "-C", str(ROOT), "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty"]
    try:
        done = subprocess.run(git, capture_output=True, check=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return "unknown (git did not answer, or does not know this checkout)"
    return done.stdout.strip().replace("-dirty", " with uncommitted changes")
