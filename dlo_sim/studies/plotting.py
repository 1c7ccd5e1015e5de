"""Figures of the studies: lines from the columns of a data file, heat maps, animations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator
from numpy.typing import ArrayLike, NDArray

from dlo_sim.studies.report import Column, Report

Array = NDArray[np.float64]
Data = Mapping[str, ArrayLike]

COLORS = {
    "forest_ruth": "tab:red",
    "rk4": "tab:blue",
    "velocity_verlet": "tab:green",
    "zhai": "tab:purple",
    "energy_momentum": "tab:orange",
    "energy_momentum_4": "tab:olive",
    "implicit_midpoint": "tab:brown",
    "rattle": "tab:gray",
    "generalized_alpha": "tab:pink",
}
MOST_INSIDE = 5  # lines whose legend fits inside the axes


@dataclass(frozen=True)
class Panel:
    """Lines in one pair of axes, drawn from the columns of the figure's data.

    Attributes:
        x: column of the data. lines: columns, one line each, or one column with `by`.
        y: label and unit of the y axis, `error [mm]`; x_axis: of the x axis, by default the name of
            its column.
        by: column of names; the rows of each name are a line.
        where: rows to draw, column -> value. until: largest x that is drawn, in SI.
        log: which axes are logarithmic: "", "x", "y" or "xy".
        marker: of all lines. looks: line -> keywords of matplotlib; a line named after a method has
            its colour anyway.
        levels: label -> y in SI of a dotted horizontal line; uprights: x of a vertical line.
        band: draw fast oscillations as a band from least to largest, with their mean.
    """

    x: str
    y: str
    lines: Sequence[str]
    title: str = ""
    x_axis: str = ""
    by: str = ""
    where: Mapping[str, object] = field(default_factory=dict)
    until: float = np.inf
    log: str = ""
    marker: str = ""
    looks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    uprights: Mapping[str, float] = field(default_factory=dict)
    band: bool = False

    def curves(self, data: Data) -> dict[str, tuple[Array, Array]]:
        """Line -> its x and y in SI."""
        columns = {name: np.asarray(column) for name, column in data.items()}
        x = columns[self.x]
        rows = np.full(len(x), True) if self.until == np.inf else x <= self.until
        for name, value in self.where.items():
            rows &= columns[name] == value
        if not self.by:
            return {name: (x[rows], columns[name][rows]) for name in self.lines}
        y, names = columns[self.lines[0]], columns[self.by]
        own = {name: rows & (names == name) for name in dict.fromkeys(names[rows])}
        return {str(name): (x[row], y[row]) for name, row in own.items()}

    def draw(self, axes: Axes, data: Data) -> None:
        """Draw the lines with labels, grid and legend."""
        x_axis, y_axis = Column.of(self.x_axis or self.x), Column.of(self.y)
        curves = self.curves(data)
        spread = colormaps["turbo"](np.linspace(0.05, 0.95, max(len(curves), 2)))
        for (name, (x, y)), color in zip(curves.items(), spread, strict=False):
            label = name.partition(" [")[0]
            own: dict[str, Any] = {"color": COLORS.get(label, color), "label": label}
            look = {**own, "marker": self.marker, **self.looks.get(name, {})}
            draw = _band if self.band else _line
            draw(axes, x * x_axis.scale, y * y_axis.scale, look)
        for label, level in self.levels.items():
            axes.axhline(level * y_axis.scale, color="gray", linestyle=":", label=label)
        for label, place in self.uprights.items():
            axes.axvline(place * x_axis.scale, color="gray", linestyle=":", label=label)
        for axis in self.log:
            axes.set(**{f"{axis}scale": "log"})
            # Two minor ticks per decade have labels, and only on an axis of less than two decades.
            ticks = getattr(axes, f"{axis}axis")
            ticks.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            ticks.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2.0, 2.0)))
        axes.set(xlabel=x_axis.header, ylabel=y_axis.header, title=self.title)
        axes.grid(alpha=0.3, which="both")
        labels = axes.get_legend_handles_labels()[1]
        if len(labels) > MOST_INSIDE:
            axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
        elif len(labels) > 1:
            axes.legend(fontsize="small")


def chart(
    report: Report,
    name: str,
    data: Data,
    panels: Sequence[Panel],
    caption: str,
    size: tuple[float, float] = (8.5, 4.6),
    rows: int = 1,
) -> None:
    """Add to the report a figure of panels, in `rows` rows, with the data they are drawn from."""
    figure, all_axes = new_figure(rows, len(panels) // rows, *size)
    for axes, panel in zip(all_axes, panels, strict=True):
        panel.draw(axes, data)
    report.figure(name, figure, data, caption)


def new_figure(
    rows: int = 1, columns: int = 1, width: float = 8.0, height: float = 4.2
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _line(axes: Axes, x: Array, y: Array, look: Mapping[str, Any]) -> None:
    axes.plot(x, y, **{"linewidth": 1.2, "markersize": 4.0, **look})


def _band(axes: Axes, x: Array, y: Array, look: Mapping[str, Any], windows: int = 250) -> None:
    size = len(x) // windows
    if size < 8:
        _line(axes, x, y, look)
        return
    whole = len(x) // size * size
    at, pieces = x[:whole].reshape(-1, size).mean(axis=1), y[:whole].reshape(-1, size)
    axes.fill_between(
        at, pieces.min(axis=1), pieces.max(axis=1), alpha=0.35, linewidth=0.0, color=look["color"]
    )
    _line(axes, at, pieces.mean(axis=1), look)


def heat_map(
    report: Report, name: str, data: Mapping[str, Array], label: str, caption: str, form: str
) -> None:
    """Add to the report a heat map with the number in each cell that is not 0.

    Args:
        data: three columns: coordinate of the rows, coordinate of the columns, values in SI.
        label: of the values, with the unit they are shown in. form: format of the numbers.
    """
    (y_name, y), (x_name, x), (_, values) = data.items()
    rows, cols = np.unique(y), np.unique(x)
    table = values.reshape(len(rows), len(cols)) * Column.of(label).scale
    figure, (axes,) = new_figure(width=8.5, height=5.0)
    image = axes.imshow(table, aspect="auto", origin="lower")
    axes.set_xticks(range(len(cols)), [f"{value:g}" for value in cols])
    axes.set_yticks(range(len(rows)), [f"{value:g}" for value in rows])
    axes.set(xlabel=x_name, ylabel=y_name)
    dark = table - table.min() < 0.6 * np.ptp(table)
    for i, j in np.argwhere(table).tolist():
        number, color = format(table[i, j], form), "white" if dark[i, j] else "black"
        axes.text(j, i, number, color=color, ha="center", va="center", fontsize=8)
    figure.colorbar(image, ax=axes, label=label)
    report.figure(name, figure, data, caption)


def animate(
    path: Path, figure: Figure, draw: Callable[[int], None], frames: int, per_second: int
) -> None:
    """Write a GIF: `draw(k)` changes the figure for frame k."""
    FigureCanvasAgg(figure)
    writer = PillowWriter(fps=per_second)
    with writer.saving(figure, str(path), dpi=80):
        for frame in range(frames):
            draw(frame)
            if frame == 0:
                figure.draw_without_rendering()
                figure.set_layout_engine("none")  # all frames keep the layout of the first
            writer.grab_frame()
