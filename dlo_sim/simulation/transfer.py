"""A state and its inputs taken over into a model with other arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def carry_inputs(old: Cable, new: Cable) -> None:
    """Loads and anchors of springs."""
    if len(old.loads) and len(new.loads):
        new.loads[:] = old.loads
    places = {
        (spring.grasp, old.model.columns[spring.line], spring.tangent): k
        for k, spring in enumerate(old.model.holding.springs)
    }
    for k, spring in enumerate(new.model.holding.springs):
        known = places.get((spring.grasp, new.model.columns[spring.line], spring.tangent))
        if known is not None:
            new.anchors[k] = old.anchors[known]


def resampled(values: Array, old: Model, new: Model, u: Array) -> Array:
    """Control points on the knots of another model, the same at its Greville points.

    `u` are those points [m] on the old cable.
    """
    return bspline.interpolate(new.knots, bspline.evaluate(values, old.knots, u))
