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

from dlo_sim.core.color_scale import CONNECTOR, STRANDS, TABLE
from dlo_sim.view.run import Cable, Curve, Run

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
                "low": run.range_of(title)[0],
                "high": run.range_of(title)[1],
                "values": _packed(values[kept]),
            }
            for title, values in run.colors.items()
        ],
        "others": [_further(one, list(run.colors), kept) for one in run.others],
        "names": [one.name for one in run.cables] if run.others else [],
        "shades": STRANDS,
        "scale": TABLE,
        "plots": [_plot(curve) for curve in run.plots],
        "bodies": [
            {"triangles": _packed(body.triangles), "poses": _packed(body.poses[kept]), "color": own}
            for bodies, own in ((run.bodies, None), (run.connectors, CONNECTOR))
            for body in bodies
        ],
        "forces": [_packed(lines) for lines in run.forces],
        "looks": [] if run.looks is None else run.looks[kept].tolist(),
    }


def _further(cable: Cable, titles: list[str], kept: Any) -> dict[str, Any]:
    """A cable beside the main one, with a table of values for each of these titles."""
    return {
        "points": cable.centerline.shape[1],
        "centerline": _packed(cable.centerline[kept]),
        "controls": cable.control_points.shape[1],
        "control_points": _packed(cable.control_points[kept]),
        "values": [_packed(cable.colors[title][kept]) for title in titles],
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
