"""Shapes of connectors as balls that touch obstacles: a sphere is one ball, a capsule a row of
balls along its axis, a box small balls over its surface, which round its edges and corners.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.scene.nets import Connector
from dlo_sim.simulation.model import Body
from dlo_sim.simulation.obstacles import NONE_BESIDE, Beside

Array = NDArray[np.float64]
CLOSE = 0.5  # radii of a capsule between its balls
ROUND = 0.1  # least extent of a box, that is the radius of its edges
MOST = 9  # balls along an edge of a box
EDGE = 4  # about so many along its least extent


class Balls(NamedTuple):
    """Balls of one radius [m] at places in the axes of a connector [m], shape (k, 3)."""

    places: Array
    radius: float


def balls_of(connector: Connector) -> Balls:
    """The shape of a connector; no balls without one."""
    center, (x, y, z) = np.array(connector.center), connector.size
    if connector.shape == "sphere":
        return Balls(center[None], 0.5 * x)
    if connector.shape == "capsule":
        radius, half = 0.5 * min(x, y), 0.5 * max(x - y, 0.0)
        along = np.linspace(-half, half, 1 + math.ceil(2.0 * half / (CLOSE * radius)))
        return Balls(center + np.outer(along, [1.0, 0.0, 0.0]), radius)
    if connector.shape == "box":
        radius, spacing = ROUND * min(x, y, z), min(x, y, z) / EDGE
        ticks = [
            np.linspace(-1.0, 1.0, min(1 + math.ceil(size / spacing), MOST)) * (0.5 * size - radius)
            for size in (x, y, z)
        ]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
        outside = np.any([np.abs(grid[:, k]) >= ticks[k][-1] for k in range(3)], axis=0)
        return Balls(center + grid[outside], radius)
    return Balls(np.zeros((0, 3)), 0.0)


def thickest(connectors: Sequence[Connector]) -> float:
    """Largest radius of the balls [m]."""
    return max((balls_of(one).radius for one in connectors), default=0.0)


def groups_of(connectors: Sequence[Connector]) -> int:
    """Groups of LANES balls of all connectors."""
    return sum(-(-len(balls_of(one).places) // LANES) for one in connectors)


def beside(bodies: Sequence[Body], density: float, thick: float) -> Beside:
    """The balls of all bodies as samples. Each stands for a length of its diameter.

    Args:
        density: mass per length of the main cable [kg/m]. thick: radius [m] from which samples
            count how much wider they are.
    """
    first, values = [NONE_BESIDE.first], [NONE_BESIDE.values]
    for body in bodies:
        balls = balls_of(body.connector) if body.connector else Balls(np.zeros((0, 3)), 0.0)
        count = -(-len(balls.places) // LANES)
        if body.connector is None or not count:
            continue
        rows = np.zeros((count * LANES, 12))
        own = rows[: len(balls.places)]
        origin = np.zeros(4)
        origin[body.points[0] - body.first] = 1.0
        own[:, :4] = [origin + body.weights(place) for place in balls.places]
        own[:, 4] = 2.0 * balls.radius
        own[:, 5:9] = body.weights(np.array([body.length, 0.0, 0.0]))
        own[:, 9] = body.u
        own[:, 10] = balls.radius - thick
        own[:, 11] = body.connector.mass / (own[:, 4].sum() * density)
        first.append(np.full(count, body.first))
        values.append(rows.reshape(count, LANES, 12))
    return Beside(np.concatenate(first), np.concatenate(values))
