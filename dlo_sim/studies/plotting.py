"""How the figures of studies look: size, colours of methods, heat maps, animations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
MARKERS = {"forest_ruth": "o", "rk4": "s", "velocity_verlet": "^", "zhai": "x"}
TIME_MAP = "viridis"


def new_figure(
    rows: int = 1,
    columns: int = 1,
    width: float = 8.0,
    height: float = 4.2,
    share_x: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share_x)
    return figure, list(axes.ravel())


def lines(axes: Axes, x: Array, values: Array, labels: list[str], colormap: str = "turbo") -> None:
    """One line per column of `values`, coloured along a map, with a grid and a legend."""
    from matplotlib import colormaps

    colors = colormaps[colormap](np.linspace(0.05, 0.95, max(values.shape[1], 2)))
    for column, label in enumerate(labels):
        axes.plot(x, values[:, column], color=colors[column], label=label, linewidth=1.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", ncols=1, loc="center left", bbox_to_anchor=(1.01, 0.5))


def trace(axes: Axes, x: Array, y: Array, color: str, windows: int = 250) -> None:
    """A curve; one of many oscillations as a band from least to largest with its mean."""
    size = len(x) // windows
    if size < 8:
        axes.plot(x, y, color=color, linewidth=0.6)
        return
    whole = len(x) // size * size
    at, pieces = x[:whole].reshape(-1, size).mean(axis=1), y[:whole].reshape(-1, size)
    low, high = pieces.min(axis=1), pieces.max(axis=1)
    axes.fill_between(at, low, high, color=color, alpha=0.35, linewidth=0.0, label="range")
    axes.plot(at, pieces.mean(axis=1), color=color, linewidth=1.2, label="mean")
    axes.legend(fontsize="small", loc="best")


def heat_map(
    axes: Axes,
    values: Array,
    x: list[str],
    y: list[str],
    label: str,
    form: str = "{:.3g}",
    colormap: str = "viridis",
) -> None:
    """Values (len(y), len(x)) as coloured cells with their numbers."""
    image = axes.imshow(values, aspect="auto", origin="lower", cmap=colormap)
    axes.set_xticks(range(len(x)), x)
    axes.set_yticks(range(len(y)), y)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    for i in range(len(y)):
        for j in range(len(x)):
            dark = (values[i, j] - low) < 0.6 * (high - low)
            axes.text(
                j,
                i,
                form.format(values[i, j]),
                ha="center",
                va="center",
                fontsize="small",
                color="white" if dark else "black",
            )
    axes.figure.colorbar(image, ax=axes, label=label)


def animate(
    path: Path, figure: Figure, draw: Callable[[int], None], frames: int, per_second: int
) -> None:
    """Write a GIF: `draw(k)` changes the figure for frame k."""
    FigureCanvasAgg(figure)
    writer = PillowWriter(fps=per_second)
    with writer.saving(figure, str(path), dpi=80):
        for frame in range(frames):
            draw(frame)
            writer.grab_frame()
