"""The picture of the demo; the only file of `demo` that imports matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dlo_sim.view.run import Run

Array = NDArray[np.float64]

_EVERY = 0.1  # [s] between two drawn cables
_MAP = "plasma"
_NAMES = "xyz"
_COLORS = ("tab:blue", "tab:orange", "tab:green")


def draw_motion(prediction: Run, gripper: Array, hand: Array, path: Path) -> None:
    """Draw the cable in two views with time as colour, and curves of the inputs and the reaction.

    Args:
        gripper: time [s] and position of the gripper [m], shape (n, 4).
        hand: time [s] and force of the hand on the cable [N], shape (m, 4).
        path: PNG to write.
    """
    figure = Figure(figsize=(12.0, 6.9), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.5, 1.0))
    views, curves = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    front, above = views.subplots(2, 1, sharex=True, height_ratios=(2.1, 1.0))
    scale = Normalize(0.0, float(prediction.time[-1]), clip=True)
    _draw_view(front, prediction, gripper[:, 1:], (1, 2), scale)
    front.set_title("the cable from the front (gravity points down)")
    _draw_view(above, prediction, gripper[:, 1:], (1, 0), scale)
    above.set_title("from above")
    colorbar = views.colorbar(ScalarMappable(scale, _MAP), ax=[front, above], pad=0.02, aspect=35)
    colorbar.set_label("time [s]")
    views.legend(*front.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    rows = curves.subplots(3, 1, sharex=True)
    _draw_components(rows[0], gripper, "in: position\nof the gripper [m]")
    _draw_components(rows[1], hand, "in: force of the hand\non the cable [N]")
    reaction = np.column_stack((prediction.time, prediction.reactions["start"]))
    _draw_components(rows[2], reaction, "out: force of the gripper\non the cable [N]")
    rows[0].legend(loc="center right", ncols=3)
    rows[2].set_xlabel("time [s]")
    rows[2].set_xlim(0.0, float(prediction.time[-1]))
    figure.savefig(path, format="png", dpi=100)


def _draw_view(
    axes: Axes, prediction: Run, gripper: Array, plane: Sequence[int], scale: Normalize
) -> None:
    """Draw cables at equal time intervals in one plane of the world, the paths of both ends, and
    what the cable touches.
    """
    for body in prediction.bodies:
        faces = list(body.at(0)[:, :, plane])
        axes.add_collection(PolyCollection(faces, color="0.8", zorder=0))
    step = max(1, round(_EVERY / float(np.median(np.diff(prediction.time)))))
    cables = prediction.centerline[:, :, plane]
    _add_lines(axes, cables[::step], prediction.time[::step], scale, linewidths=1.0, alpha=0.55)
    tip = np.stack((cables[:-1, -1], cables[1:, -1]), axis=1)
    _add_lines(axes, tip, prediction.time[:-1], scale, linewidths=2.2)
    axes.plot(*gripper[:, plane].T, color="black", linewidth=1.8, label="path of the gripper")
    axes.plot([], [], color="0.5", linewidth=2.2, label="path of the free end")
    axes.plot([], [], color="0.5", linewidth=1.0, label=f"cable, every {_EVERY:g} s")
    axes.plot([], [], color="0.8", linewidth=8.0, label="table")
    axes.set_aspect("equal")
    axes.margins(0.04)
    axes.autoscale_view()
    axes.grid(alpha=0.3)
    axes.set_xlabel(f"{_NAMES[plane[0]]} [m]")
    axes.set_ylabel(f"{_NAMES[plane[1]]} [m]")


def _add_lines(axes: Axes, lines: Array, time: Array, scale: Normalize, **style: float) -> None:
    """Add lines, shape (k, points, 2), coloured by their time."""
    axes.add_collection(LineCollection(list(lines), array=time, cmap=_MAP, norm=scale, **style))


def _draw_components(axes: Axes, rows: Array, label: str) -> None:
    """Plot three components over time; rows are time, x, y, z."""
    for k, color in enumerate(_COLORS):
        axes.plot(rows[:, 0], rows[:, k + 1], color=color, linewidth=1.2, label=_NAMES[k])
    axes.grid(alpha=0.3)
    axes.set_ylabel(label)
