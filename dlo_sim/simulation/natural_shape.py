"""The natural curvature of a scene at the samples of its model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline
from dlo_sim.engine import layout
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def natural_vectors(scene: Scene, model: Model, axis: Array) -> Array:
    """Weight EI kappa0 times the axis, of every sample, shape (blocks, samples, 3, LANES)."""
    values = np.asarray(scene.cable.rest_curvature, dtype=float)
    blocks, samples = int(model.shape[layout.BLOCKS]), int(model.shape[layout.SAMPLES])
    ends = bspline.breaks(model.knots)
    u = ends[:-1, None] + 0.5 * (model.rule.xi + 1.0) * np.diff(ends)[:, None]
    curvature = np.interp(u / ends[-1], np.linspace(0.0, 1.0, len(values)), values)
    moment = np.zeros((blocks * LANES, samples))
    moment[: len(u)] = scene.cable.EI * curvature * model.rule.weights
    by_lanes = moment.reshape(blocks, LANES, samples).transpose(0, 2, 1)
    return by_lanes[:, :, None, :] * local_axis(axis, model.axes)[:, None]


def local_axis(axis: Array, axes: tuple[int, ...]) -> Array:
    """An axis of rotation in the coordinates of the lines.

    In planar motion the third component is the one about the normal e_a x e_b of the two lines.
    """
    if len(axes) == 3:
        return axis
    normal = np.cross(np.eye(3)[axes[0]], np.eye(3)[axes[1]])
    return np.array([0.0, 0.0, axis @ normal])
