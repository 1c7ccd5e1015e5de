"""A run as a film, a still picture, or plots; the only file of `view` that imports matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from dlo_sim.core.color_scale import CONNECTOR, STRANDS, colors
from dlo_sim.view.run import Cable, Run

Array = NDArray[np.float64]
_Tint = Callable[[Cable, int], Any]

_RATES = {"gif": 10, "mp4": 30}  # frames per second of simulated time
_MOST_PICTURES = 900
_FILM_DPI = 70
_VIEWS = (-25.0, -65.0)  # azimuth [deg] for a run that is wider along y, along x
_STILLS = 9  # cables in a still
_LIGHT = np.array([0.35, -0.5, 0.8])  # direction to it
_SCALE = ListedColormap(colors(np.linspace(0.0, 1.0, 256)))
# A name in a bag may hold dollar signs, which are no formula.
_plain = rc_context({"text.parse_math": False})


class NoFilm(Exception):
    """A film cannot be made on this system: one line with the cure."""


@_plain
def write_film(
    run: Run, path: Path, kind: str, progress: Callable[[float], None] | None = None
) -> None:
    """Write the motion as a film in real time.

    Args:
        kind: gif or mp4.
        progress: called now and then with the fraction done.

    Raises:
        NoFilm: there is no ffmpeg for an mp4.
        OSError: the file cannot be written.
    """
    if kind == "mp4" and not FFMpegWriter.isAvailable():
        raise NoFilm("an mp4 needs ffmpeg, which is not installed; install it, or make a gif")
    span = float(run.time[-1] - run.time[0])
    count = int(np.clip(span * _RATES[kind], 2, _MOST_PICTURES))
    frames = np.searchsorted(run.time, np.linspace(run.time[0], run.time[-1], count))
    figure, axes, tint = _stage(run, (4.8, 3.6), _FILM_DPI)
    FigureCanvasAgg(figure)
    clock = figure.text(0.02, 0.94, "", family="monospace")
    writer: Any = {"gif": PillowWriter, "mp4": FFMpegWriter}[kind](fps=count / max(span, 1e-3))
    # The writers choose the format by the suffix, which a temporary name does not have.
    named = path.with_name(f"{path.name}.{kind}")
    with writer.saving(figure, str(named), _FILM_DPI):
        for k, frame in enumerate(frames):
            shown = [axes.add_collection3d(one) for one in _surroundings(run, frame, axes)]
            shown += [axes.add_collection3d(_line(one, frame, tint)) for one in run.cables]
            clock.set_text(f"{run.time[frame]:6.2f} s")
            writer.grab_frame()
            for one in shown:
                one.remove()
            if progress is not None:
                progress((k + 1) / count)
    named.replace(path)


@_plain
def write_still(run: Run, path: Path) -> None:
    """Write a PNG of the cable at equal time intervals, earlier ones paler, and its end's path.

    Raises:
        OSError: the file cannot be written.
    """
    figure, axes, tint = _stage(run, (8.0, 6.0), 100)
    for one in _surroundings(run, len(run.time) - 1, axes):
        axes.add_collection3d(one)
    wanted = np.linspace(run.time[0], run.time[-1], _STILLS)
    for k, frame in enumerate(np.searchsorted(run.time, wanted)):
        strength = 0.15 + 0.85 * k / (_STILLS - 1)
        for one in run.cables:
            axes.add_collection3d(_line(one, frame, tint)).set_alpha(strength)
    for one in run.cables:
        axes.plot(*one.centerline[:, -1].T, color="0.7", linewidth=1.0)
    figure.text(0.02, 0.03, f"{run.time[0]:g} to {run.time[-1]:g} s, the last one darkest")
    figure.savefig(path, format="png")


@_plain
def write_plots(run: Run, path: Path) -> None:
    """Write a PNG with all plots over time.

    Raises:
        OSError: the file cannot be written.
    """
    plots = run.plots
    figure = Figure(figsize=(10.0, 1.9 * len(plots) + 0.4), dpi=100, layout="constrained")
    rows = figure.subplots(len(plots), 1, sharex=True, squeeze=False)[:, 0]
    own = _own_colors(run)
    for axes, curve in zip(rows, plots, strict=True):
        for name, values in curve.values.items():
            axes.plot(curve.time, values, linewidth=1.2, label=name, color=own.get(name))
        axes.set_ylim(*curve.limits)
        axes.set_title(curve.title, loc="left", fontsize=10)
        axes.grid(alpha=0.3)
        if len(curve.values) > 1:
            axes.legend(loc="upper right", ncols=len(curve.values), fontsize=8)
    rows[-1].set_xlabel("time [s]")
    figure.savefig(path, format="png")


def _own_colors(run: Run) -> dict[str, tuple[float, float, float]]:
    """Colours of the cables of a net."""
    cables = run.cables if run.others else ()
    return {one.name: STRANDS[k % len(STRANDS)] for k, one in enumerate(cables)}


def _stage(run: Run, size: tuple[float, float], dpi: int) -> tuple[Figure, Any, _Tint]:
    """Figure, axes that contain the whole motion, and a function for the colours of a cable in a
    frame.
    """
    figure = Figure(figsize=size, dpi=dpi)
    wide = 0.94 if run.others or not run.colors else 0.7
    axes: Any = figure.add_axes((0.03, 0.02, wide, 0.96), projection="3d")
    low, high = run.extent
    half = 0.5 * np.maximum(high - low, 0.15 * float((high - low).max())) + 1e-6
    middle = 0.5 * (low + high)
    axes.set(**{f"{x}lim": (m - h, m + h) for x, m, h in zip("xyz", middle, half, strict=True)})
    axes.set_box_aspect(half)
    # Else the faces of an obstacle may cover the cable, and the cable the contact forces.
    axes.computed_zorder = not (run.bodies or run.forces or run.connectors)
    axes.view_init(elev=18.0, azim=_VIEWS[int(half[0] > half[1])])
    for axis, name, long in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", half, strict=True):
        axis.set_major_locator(MaxNLocator(4 if long > 0.4 * half.max() else 1))
        axis.set_label_text(f"{name} [m]", fontsize=8)
    axes.tick_params(labelsize=7, pad=0)
    if run.others:
        own = _own_colors(run)
        marks = [Line2D([], [], color=color, linewidth=4.0) for color in own.values()]
        figure.legend(marks, list(own), loc="upper right", fontsize=8)
        return figure, axes, lambda cable, frame: own[cable.name]
    if not run.colors:
        return figure, axes, lambda cable, frame: "tab:orange"
    title = next(iter(run.colors))
    scale = Normalize(*run.range_of(title))
    place = figure.add_axes((0.86, 0.2, 0.02, 0.6))
    bar = figure.colorbar(ScalarMappable(scale, _SCALE), cax=place)
    bar.set_label(title, fontsize=8)
    bar.ax.tick_params(labelsize=7)

    def tint(cable: Cable, frame: int) -> Array:
        values = cable.colors[title][frame]
        return _SCALE(scale(0.5 * (values[1:] + values[:-1])))

    return figure, axes, tint


def _surroundings(run: Run, frame: int, axes: Any) -> list[Any]:
    """Obstacles, cut off at the limits of the axes, and contact forces."""
    limits = np.sort([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    found: list[Any] = []
    for bodies, own in ((run.bodies, None), (run.connectors, CONNECTOR)):
        faces = [_cut(face, limits) for body in bodies for face in body.at(frame)]
        faces = [face for face in faces if len(face) > 2]
        if faces:
            sides = [np.cross(f[1] - f[0], f[2] - f[0]) for f in faces]
            light = [float(n @ _LIGHT) / max(float(np.linalg.norm(n)), 1e-300) for n in sides]
            shades = [_shade(own, one) for one in light]
            seen = {"alpha": 0.9, "zorder": 2.5} if own else {"alpha": 0.45, "zorder": 1}
            found.append(Poly3DCollection(faces, facecolors=shades, **seen))
    lines = run.forces_at(frame)
    if len(lines):
        found.append(Line3DCollection(lines, colors="tab:red", linewidths=0.6, zorder=3))
    return found


def _shade(color: tuple[float, float, float] | None, light: float) -> tuple[float, ...]:
    """Colour of a face, grey without one of its own; light: cosine of its angle to the light."""
    if color is None:
        return (0.65 + 0.2 * light,) * 3
    return tuple(one * (1.0 + 0.3 * light) for one in color)


def _cut(face: Array, limits: Array) -> Array:
    """The part of a convex polygon (k, 3) between lower and upper limits (3, 2)."""
    for axis in range(3):
        for bound, sign in zip(limits[axis], (1.0, -1.0), strict=True):
            inside = sign * (face[:, axis] - bound)
            if not len(face) or np.all(inside >= 0.0):
                continue
            corners = []
            for k, (here, after) in enumerate(zip(inside, np.roll(inside, -1), strict=True)):
                if here >= 0.0:
                    corners.append(face[k])
                if (here >= 0.0) != (after >= 0.0):
                    share = here / (here - after)
                    corners.append(face[k] + share * (face[(k + 1) % len(face)] - face[k]))
            face = np.reshape(corners, (-1, 3))
    return face


def _line(cable: Cable, frame: int, tint: _Tint) -> Line3DCollection:
    points = cable.centerline[frame]
    segments = np.stack((points[:-1], points[1:]), axis=1)
    return Line3DCollection(
        segments, colors=tint(cable, frame), linewidths=4.0, capstyle="round", zorder=2
    )
