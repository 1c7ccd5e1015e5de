"""The picture of the demo; the only file of this room that knows matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dlo_sim.demo.prediction import Prediction

Array = NDArray[np.float64]

_EVERY = 0.1  # s between two cables drawn
_MAP = "viridis"
_NAMES = "xyz"


def draw_motion(
    prediction: Prediction, gripper: Array, hand: tuple[float, float], path: Path
) -> None:
    """Draw the cable from two sides with time as colour, and the force at the gripper.

    Args:
        gripper: path of the gripper [m], shape (n, 3).
        hand: when the hand pulls, from and to [s].
        path: PNG to write.
    """
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(2.3, 1.0))
    above, side = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    scale = Normalize(0.0, float(prediction.time[-1]))
    _draw_view(above, prediction, gripper, (0, 1), scale)
    above.set_title("from above")
    above.legend(loc="upper left", fontsize="small", framealpha=0.9)
    _draw_view(side, prediction, gripper, (1, 2), scale)
    side.set_title("from the front")
    colorbar = figure.colorbar(ScalarMappable(scale, _MAP), ax=[above, side], pad=0.01)
    colorbar.set_label("time [s]")
    _draw_reaction(figure.add_subplot(grid[1, :]), prediction, hand)
    figure.suptitle("Cable predicted from the gripper's poses and the hand's wrenches")
    figure.savefig(path, dpi=110)


def _draw_view(
    axes: Axes, prediction: Prediction, gripper: Array, plane: Sequence[int], scale: Normalize
) -> None:
    """Cables at equal time steps in one plane of the world."""
    step = max(1, round(_EVERY / float(np.median(np.diff(prediction.time)))))
    lines = LineCollection(
        list(prediction.centerline[::step][:, :, plane]),
        array=prediction.time[::step],
        cmap=_MAP,
        norm=scale,
        linewidths=1.1,
        alpha=0.75,
    )
    axes.add_collection(lines)
    axes.plot(*gripper[:, plane].T, color="black", linewidth=1.4, label="path of the gripper")
    axes.plot(
        *prediction.centerline[-1][:, plane].T, color="crimson", linewidth=2.5, label="cable, last"
    )
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.autoscale_view()
    axes.grid(alpha=0.3)
    axes.set_xlabel(f"{_NAMES[plane[0]]} [m]")
    axes.set_ylabel(f"{_NAMES[plane[1]]} [m]")


def _draw_reaction(axes: Axes, prediction: Prediction, hand: tuple[float, float]) -> None:
    """Force at the gripper over time."""
    axes.axvspan(*hand, color="0.85", label="the hand pulls")
    for k, name in enumerate(_NAMES):
        axes.plot(prediction.time, prediction.reaction[:, k], linewidth=1.2, label=f"F{name}")
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("force on the cable\nby the gripper [N]")
    axes.legend(loc="upper right", ncols=4, fontsize="small")
