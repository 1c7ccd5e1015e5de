"""Pictures of what a fit leaves: error by marker and over time, or the force over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_sim.cli.output import write_whole
from dlo_sim.studies.report import new_figure

if TYPE_CHECKING:
    from dlo_sim.identification.identify import Identified


def draw_residuals(folder: Path, found: Identified) -> None:
    """`residuals.png`: distance of each marker, and mean distance over time, piece by piece; the
    left-out pieces are dashed. Of forces: measured and predicted, axis by axis.
    """
    figure = _of_forces(found) if found.reactions else _of_markers(found)
    write_whole(folder / "residuals.png", lambda path: figure.savefig(path, format="png", dpi=110))


def _of_forces(found: Identified) -> Any:
    figure, panels = new_figure(3, 1, 11.0, 9.0)
    for piece, predicted in zip(found.recordings, found.predicted, strict=True):
        if piece.forces is None:
            continue
        for k, axes in enumerate(panels):
            axes.plot(piece.times, piece.forces[:, k], "k.-", lw=0.6, ms=3, label="measured")
            axes.plot(piece.times, predicted.forces[:, k], color="tab:red", label="predicted")
            axes.set(ylabel=f"{'xyz'[k]} [N]", xlabel="time [s]" if k == 2 else "")
            axes.grid(alpha=0.3)
    panels[0].legend(fontsize="small")
    return figure


def _of_markers(found: Identified) -> Any:
    figure, (by_marker, by_time) = new_figure(1, 2, 11.0, 4.6)
    for k, (piece, predicted) in enumerate(zip(found.recordings, found.predicted, strict=True)):
        distance = 1e3 * np.linalg.norm(predicted.markers - piece.markers, axis=-1)
        seen = k < len(found.recordings) - found.left_out
        look: dict[str, Any] = {
            "linestyle": "-" if seen else "--",
            "label": piece.name,
            "linewidth": 1.1,
        }
        by_marker.plot(piece.shares, np.nanmean(distance, axis=0), marker="o", ms=3, **look)
        by_time.plot(piece.times, np.nanmean(distance, axis=1), **look)
    by_marker.set(xlabel="material coordinate [lengths]", ylabel="mean distance [mm]")
    by_time.set(xlabel="time [s]", ylabel="mean distance of the markers [mm]")
    legend = by_time.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    for text in legend.get_texts():
        text.set_parse_math(False)  # names of files are no formulas
    for axes in (by_marker, by_time):
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    return figure
