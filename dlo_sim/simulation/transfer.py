"""A state and its inputs taken over into a model with other arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.kernels import layout
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def put_state(model: Model, state: layout.State, points: Array, rates: Array) -> None:
    """Write control points (n, 4) and their velocities, with those of driven ends, into a state.

    The momentum variable is w = v_f + shift v_p on free DOFs (`layout.State`).
    """
    n, mass, drive = model.n, model.terms.mass, model.terms.drive
    state.position[:, :n] = model.to_rows(points)
    rows = model.to_rows(rates)
    state.w[:, :n] = rows * mass.free
    if drive is not None:
        for j in range(4):
            column = j if j < 2 else n - 4 + j  # of the shift (`layout.Drive`)
            driven = rows[:, column] * (mass.free[:, column] == 0.0)
            state.w[:, :n] += drive.shift[:, j, :n] * driven[:, None] * mass.free
    state.history[:] = 0.0


def carry_inputs(old: layout.Terms, new: layout.Terms) -> None:
    """Loads and anchors of springs, in the coordinates that both have."""
    columns = [new.axes.index(axis) for axis in old.axes]
    if old.loads is not None and new.loads is not None:
        new.loads.force[:] = 0.0
        new.loads.force[:, columns] = old.loads.force
        new.loads.torque[:] = old.loads.torque
        new.loads.frequency[:] = old.loads.frequency
    if old.springs is not None and new.springs is not None:
        new.springs.anchor[:, columns] = old.springs.anchor


def resampled(values: Array, old: Model, new: Model, u: Array) -> Array:
    """Control points on the knots of another model, the same at its Greville points.

    `u` are those points [m] on the old cable.
    """
    return bspline.interpolate(new.knots, bspline.evaluate(values, old.knots, u))
