"""Figures of the studies, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
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

Array = NDArray[np.float64]
Curves = Mapping[str, tuple[ArrayLike, ArrayLike]]  # label -> x and y, in the units of the axes

COLORS = {
    "forest_ruth": "tab:red",
    "rk4": "tab:blue",
    "velocity_verlet": "tab:green",
    "zhai": "tab:purple",
    "energy_momentum": "tab:orange",
    "energy_momentum_4": "tab:olive",
    "implicit_midpoint": "tab:brown",
    "rattle": "tab:gray",
}
MOST_INSIDE = 5  # lines whose legend fits inside the axes


def new_figure(
    rows: int = 1, columns: int = 1, width: float = 8.0, height: float = 4.2
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def curves(rows: Iterable[Sequence[Any]], name: int, x: int, y: int, scale: float = 1.0) -> Curves:
    """Rows of a table as curves: columns x and y, y times the scale, of the rows of each name."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for row in rows:
        xs, ys = found.setdefault(str(row[name]), ([], []))
        xs.append(row[x])
        ys.append(scale * row[y])
    return found


def draw(
    axes: Axes,
    lines: Curves,
    x: str,
    y: str,
    log: str = "",
    title: str = "",
    looks: Mapping[str, Mapping[str, Any]] | None = None,
    **look: Any,
) -> None:
    """Draw labelled lines with grid and legend.

    Args:
        x, y: labels of the axes. log: which axes are logarithmic: "", "x", "y" or "xy".
        look: keywords of matplotlib for all lines; looks: for single ones, by label. Lines with the
            name of a method have its colour.
    """
    spread = colormaps["turbo"](np.linspace(0.05, 0.95, max(len(lines), 2)))
    for (name, data), color in zip(lines.items(), spread, strict=False):
        own = {"color": COLORS.get(name, color), "label": name, "linewidth": 1.2, "markersize": 4.0}
        axes.plot(*map(np.asarray, data), **{**own, **look, **(looks or {}).get(name, {})})
    for axis in log:
        axes.set(**{f"{axis}scale": "log"})
        # Two minor ticks per decade have labels, and only on an axis of less than two decades.
        ticks = getattr(axes, f"{axis}axis")
        ticks.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        ticks.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2.0, 2.0)))
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3, which="both")
    if len(lines) > MOST_INSIDE:
        axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    elif len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(fontsize="small")


def draw_band(axes: Axes, x: Array, y: Array, color: str, windows: int = 250) -> None:
    """Draw fast oscillations as a band from least to largest, with their mean."""
    size = len(x) // windows
    if size < 8:
        axes.plot(x, y, linewidth=1.2, color=color)
        return
    whole = len(x) // size * size
    at, pieces = x[:whole].reshape(-1, size).mean(axis=1), y[:whole].reshape(-1, size)
    low, high = pieces.min(axis=1), pieces.max(axis=1)
    axes.fill_between(at, low, high, alpha=0.35, linewidth=0.0, color=color)
    axes.plot(at, pieces.mean(axis=1), linewidth=1.2, color=color)


def heat_map(rows: ArrayLike, columns: ArrayLike, table: Array, label: str, form: str) -> Figure:
    """A heat map with the number in each cell that is not 0, in this format.

    Args:
        rows, columns: coordinates, whose labels are set by the caller. label: of the values.
    """
    figure, (axes,) = new_figure(width=8.5, height=5.0)
    image = axes.imshow(table, aspect="auto", origin="lower")
    axes.set_xticks(range(table.shape[1]), [f"{value:g}" for value in np.asarray(columns)])
    axes.set_yticks(range(table.shape[0]), [f"{value:g}" for value in np.asarray(rows)])
    dark = table - table.min() < 0.6 * np.ptp(table)
    for i, j in np.argwhere(table).tolist():
        number, color = format(table[i, j], form), "white" if dark[i, j] else "black"
        axes.text(j, i, number, color=color, ha="center", va="center", fontsize=8)
    figure.colorbar(image, ax=axes, label=label)
    return figure


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
