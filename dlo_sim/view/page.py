"""A run as one self-contained HTML page: 3D view, controls and plots."""

from __future__ import annotations

import base64
import json
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_sim.core.color_scale import TABLE
from dlo_sim.view.run import Curve, Run

_MOST_FRAMES = 600
_MOST_VALUES = 1000  # of a plotted curve


def write_page(run: Run, path: Path) -> None:
    """Write the page.

    Raises:
        OSError: the file cannot be written.
    """
    here = files(__package__)
    page = Template((here / "page.html").read_text(encoding="utf-8"))
    # Escaped so that no text in the data can close the script element.
    data = json.dumps(page_data(run), allow_nan=False).replace("<", "\\u003c")
    script = (here / "page.js").read_text(encoding="utf-8")
    text = page.substitute(title=escape(run.name), data=data, script=script)
    path.write_text(text, encoding="utf-8")


def page_data(run: Run) -> dict[str, Any]:
    """The input of page.js; arrays are base64 of little-endian 32-bit floats, frame by frame."""
    kept = thinned(len(run.time), _MOST_FRAMES)
    return {
        "time": _packed(run.time[kept]),
        "points": run.centerline.shape[1],
        "centerline": _packed(run.centerline[kept]),
        "controls": run.control_points.shape[1],
        "control_points": _packed(run.control_points[kept]),
        "frames": None if run.frames is None else _packed(run.frames[kept]),
        "colors": [
            {
                "title": title,
                "low": float(values.min()),
                "high": float(values.max()),
                "values": _packed(values[kept]),
            }
            for title, values in run.colors.items()
        ],
        "scale": TABLE,
        "plots": [_plot(curve) for curve in run.plots],
        "bodies": [
            {"triangles": _packed(body.triangles), "poses": _packed(body.poses[kept])}
            for body in run.bodies
        ],
        "forces": [_packed(lines) for lines in run.forces],
        "looks": [] if run.looks is None else run.looks[kept].tolist(),
    }


def thinned(count: int, most: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Evenly spaced indices of at most `most` of `count` entries, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _plot(curve: Curve) -> dict[str, Any]:
    kept = thinned(len(curve.time), _MOST_VALUES)
    values = [{"name": name, "values": _packed(v[kept])} for name, v in curve.values.items()]
    return {
        "title": escape(curve.title),
        "time": _packed(curve.time[kept]),
        "limits": curve.limits,
        "values": values,
    }


def _packed(values: ArrayLike) -> str:
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")
