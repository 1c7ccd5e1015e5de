"""Numbers as colours: dark blue to yellow, of evenly rising lightness (viridis, CC0). Cables by
colours of their own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TABLE = (
    (0.267, 0.005, 0.329),
    (0.278, 0.175, 0.479),
    (0.230, 0.322, 0.546),
    (0.173, 0.449, 0.558),
    (0.128, 0.567, 0.551),
    (0.157, 0.684, 0.502),
    (0.369, 0.789, 0.383),
    (0.678, 0.864, 0.190),
    (0.993, 0.906, 0.144),
)
"""Red, green, blue, 0 to 1, in equal steps from the lowest value to the highest."""

STRANDS = (
    (0.95, 0.55, 0.10),
    (0.12, 0.47, 0.71),
    (0.17, 0.63, 0.17),
    (0.58, 0.40, 0.74),
    (0.84, 0.15, 0.16),
    (0.09, 0.75, 0.81),
    (0.89, 0.47, 0.76),
    (0.55, 0.34, 0.29),
)
"""Red, green, blue, 0 to 1, of the cables of a net, the main one first; used again beyond."""
CONNECTOR = (0.25, 0.28, 0.35)
"""Of connectors."""


def colors(
    values: NDArray[np.float64], low: float | None = None, high: float | None = None
) -> NDArray[np.float64]:
    """Red, green, blue, alpha (n, 4) of values (n,); the range is by default that of the values."""
    low = float(values.min()) if low is None else low
    high = float(values.max()) if high is None else high
    fraction = (values - low) / (high - low) if high > low else np.zeros(len(values))
    steps = np.linspace(0.0, 1.0, len(TABLE))
    rgb = [np.interp(fraction, steps, channel) for channel in zip(*TABLE, strict=True)]
    return np.stack([*rgb, np.ones(len(values))], axis=-1)
