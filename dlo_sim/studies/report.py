"""The report of a study: markdown with tables and figures, and one CSV for each of them.

A figure is drawn from the rows of its table: a study gives rows and a header, no drawing code. All
values are in SI units; they are shown in the unit that the header names.
"""

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
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator
from numpy.typing import NDArray

from dlo_sim import __version__
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.studies import Outcome, Request

Array = NDArray[np.float64]
Rows = Iterable[Sequence[Any]]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("numpy", "numba", "llvmlite", "matplotlib")
SCALES = {"%": 1e2, "ppm": 1e6, "cm": 1e2, "mm": 1e3, "ms": 1e3, "us": 1e6, "ns": 1e9, "KB": 1e-3}
COLORS = {
    "forest_ruth": "tab:red",
    "rk4": "tab:blue",
    "velocity_verlet": "tab:green",
    "zhai": "tab:purple",
    "energy_momentum": "tab:orange",
    "energy_momentum_4": "tab:olive",
    "implicit_midpoint": "tab:brown",
}
MOST_INSIDE = 5  # lines whose legend fits inside the axes


class Column(NamedTuple):
    """A column of a table: its name with the unit, the factor from SI, and the format."""

    name: str
    scale: float
    form: str

    def cell(self, value: Any) -> Any:
        """A value in the unit of the column; text and missing values are unchanged."""
        return (
            value
            if self.scale == 1.0 or value is None or isinstance(value, str)
            else (value * self.scale)
        )


def columns(header: str, form: str = "") -> list[Column]:
    """Columns of a header such as `method | step [us] | cost [us/step] | spread [%] {:.0f}`. Of a
    unit, the part before a slash counts. `form`: format of columns that name none.
    """
    found = []
    for word in header.split(" | "):
        name, _, own = word.removesuffix("}").partition(" {:")
        unit = name.removesuffix("]").rpartition(" [")[2].partition("/")[0]
        found.append(
            Column(name, SCALES.get(unit, 1.0) if name.endswith("]") else 1.0, own or form)
        )
    return found


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

    def table(self, name: str, header: str, rows: Rows, caption: str, form: str = "") -> None:
        """Add a table with its caption, also as `<name>.csv` with all digits; see `columns`. None
        is shown as a dash.
        """
        names, cells = self._write_csv(name, header, rows)
        forms = [column.form for column in columns(header, form)]
        texts = [[shown(x, form) for x, form in zip(row, forms, strict=True)] for row in cells]
        lines = [f"| {' | '.join(row)} |" for row in (names, *texts)]
        lines.insert(1, "|" + "---|" * len(names))
        self._body.append("\n".join([f"**{caption}** (`{name}.csv`)", "", *lines]))
        self.tables[name] = len(cells)

    def chart(
        self,
        name: str,
        header: str,
        rows: Rows,
        caption: str,
        log: str = "",
        equal: bool = False,
        looks: Mapping[str, Mapping[str, Any]] | None = None,
        **look: Any,
    ) -> None:
        """Add a figure of lines, drawn from rows with the columns `[panel |] line | x | y`.

        Args:
            log: which axes are logarithmic: "", "x", "y" or "xy". equal: one scale for both axes.
            look: keywords of matplotlib for all lines; looks: for single ones, by label.
        """
        names, cells = self._write_csv(name, header, rows)
        if len(names) == 3:
            cells = [["", *row] for row in cells]
        panels = list(dict.fromkeys(str(row[0]) for row in cells))
        across = 1 if len(panels) == 1 else max(2, math.ceil(len(panels) / 2))
        down = math.ceil(len(panels) / across)
        figure, axes = new_figure(down, across, 4.0 + 4.5 * across, 0.6 + 4.0 * down)
        for panel, title in zip(axes, panels, strict=False):
            lines: dict[str, list[Sequence[Any]]] = {}
            for _, line, *place in (row for row in cells if str(row[0]) == title):
                lines.setdefault(str(line), []).append(place)
            x, y = names[-2:]
            draw(panel, lines, x, y, log, title, looks, **look)
            if equal:
                panel.set_aspect("equal")
        for panel in axes[len(panels) :]:
            panel.set_axis_off()
        self.figure(name, figure, caption)

    def heat_map(self, name: str, header: str, rows: Rows, caption: str) -> None:
        """Add a figure of the third column over the other two, `row | column | value`, with the
        number in each cell that is not 0 if the column has a format.
        """
        names, cells = self._write_csv(name, header, rows)
        down, across, values = (np.array(column) for column in zip(*cells, strict=True))
        (at_row, i), (at_column, j) = (
            np.unique(one, return_inverse=True) for one in (down, across)
        )
        table = np.zeros((len(at_row), len(at_column)))
        table[i, j] = values
        figure, (axes,) = new_figure(width=8.5, height=5.0)
        image = axes.imshow(table, aspect="auto", origin="lower")
        axes.set_xticks(range(len(at_column)), [f"{value:g}" for value in at_column], rotation=45)
        axes.set_yticks(range(len(at_row)), [f"{value:g}" for value in at_row])
        axes.set(ylabel=names[0], xlabel=names[1])
        dark = table - table.min() < 0.6 * np.ptp(table)
        form = columns(header)[2].form
        for y, x in np.argwhere(table).tolist() if form else ():
            color = "white" if dark[y, x] else "black"
            axes.text(x, y, format(table[y, x], form), color=color, ha="center", fontsize=8)
        figure.colorbar(image, ax=axes, label=names[2])
        self.figure(name, figure, caption)

    def bars(self, name: str, header: str, rows: Rows, caption: str) -> None:
        """Add a figure of horizontal bars: a label, and a bar for each of the other columns. The
        axis is logarithmic if they differ by more than a factor of ten.
        """
        names, cells = self._write_csv(name, header, rows)
        labels, *series = zip(*cells, strict=True)
        figure, (axes,) = new_figure(width=9.0, height=1.4 + 0.4 * len(cells))
        place, thick = np.arange(len(cells))[::-1], 0.8 / len(series)
        for k, (title, values) in enumerate(zip(names[1:], series, strict=True)):
            bars = axes.barh(place + 0.4 - (k + 0.5) * thick, values, 0.95 * thick, label=title)
            axes.bar_label(bars, fmt="%.3g", fontsize="small", padding=2)
        lengths = np.array(series, dtype=float)
        low, high = float(np.nanmin(lengths)), float(np.nanmax(lengths))
        if high > 10.0 * low > 0.0:
            axes.set(xscale="log", xlim=(low / 2.0, high * (high / low) ** 0.1))
        else:
            axes.set_xlim(0.0, 1.1 * high)  # room for the numbers
        axes.set_yticks(place, labels)
        axes.grid(alpha=0.3, axis="x")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(series))
        self.figure(name, figure, caption)

    def figure(
        self, name: str, figure: Figure, caption: str, header: str = "", rows: Rows = ()
    ) -> None:
        """Add a drawn figure as `<name>.png`; with a header also its data, as of a table."""
        if header:
            self._write_csv(name, header, rows)
        path = self.folder / f"{name}.png"
        write_atomically(path, lambda partial: figure.savefig(partial, format="png", dpi=110))
        self.figures.append(path.name)
        self._body.append(f"![{caption}]({path.name})\n\n*{caption}* (data: `{name}.csv`)")

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

    def _write_csv(self, name: str, header: str, rows: Rows) -> tuple[list[str], list[list[Any]]]:
        """Write `<name>.csv`; returns names of the columns, and rows in their units."""
        if f"{name}.csv" in self.data:
            raise ValueError(f"{name}.csv: is written already; give table and figure two names")
        self.data.append(f"{name}.csv")
        named = columns(header)
        names = [column.name for column in named]
        cells = [[c.cell(x) for c, x in zip(named, row, strict=True)] for row in rows]

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerows([_plain(cell) for cell in row] for row in (names, *cells))

        write_atomically(self.folder / f"{name}.csv", write)
        return names, cells


def new_figure(
    rows: int = 1, columns: int = 1, width: float = 8.0, height: float = 4.2
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def draw(
    axes: Axes,
    lines: Mapping[str, Sequence[Sequence[Any]]],
    x: str,
    y: str,
    log: str = "",
    title: str = "",
    looks: Mapping[str, Mapping[str, Any]] | None = None,
    **look: Any,
) -> None:
    """Draw labelled lines (points x, y) with grid and legend; see `Report.chart`. A line with the
    name of a method has the colour of the method.
    """
    spread = colormaps["turbo"](np.linspace(0.05, 0.95, max(len(lines), 2)))
    for (name, points), color in zip(lines.items(), spread, strict=False):
        own = {"color": COLORS.get(name, color), "label": name, "linewidth": 1.2, "markersize": 4.0}
        axes.plot(*np.array(points).T, **{**own, **look, **(looks or {}).get(name, {})})
    for axis in log:
        axes.set(**{f"{axis}scale": "log"})
        low, high = getattr(axes, f"get_{axis}lim")()
        if high < 10.0 * low:  # so that a power of ten is on the axis, and labels do not overlap
            middle = math.sqrt(low * high)
            axes.set(**{f"{axis}lim": (middle / math.sqrt(10.0), middle * math.sqrt(10.0))})
        # Two minor ticks per decade have labels, and only on an axis of less than two decades.
        ticks = getattr(axes, f"{axis}axis")
        ticks.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        ticks.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2.0, 2.0)))
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3, which="both")
    if len(lines) > MOST_INSIDE:
        axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    elif len(lines) > 1:
        axes.legend(fontsize="small")


def curves(x: Iterable[Any], lines: Mapping[str, Iterable[Any]], *panel: str) -> list[Any]:
    """Rows of a chart: the points of each line, to the end of the shorter one."""
    return [(*panel, name, *at) for name, y in lines.items() for at in zip(x, y, strict=False)]


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
