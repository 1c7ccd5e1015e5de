"""The inextensible cable: gradients of its length constraints, reactions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.constant_length import constraint_gram
from dlo_sim.methods import rattle
from dlo_sim.simulation.cable import Cable

Array = NDArray[np.float64]


def gradients(cable: Cable) -> Array:
    """Gradients of the length constraints at the present configuration, times the cable length.

    Shape (n - 1, n dim), the spatial unknowns ordered by control point.
    """
    model = cable.model
    dim, n = len(model.axes), model.n
    rows = np.zeros((n - 1, n, dim))
    for j, gram in enumerate(constraint_gram(model.knots)):
        first = min(max(j - 1, 0), n - 4)
        here = slice(first, first + 4)
        rows[j, here] = model.knots[-1] * gram @ cable.x[:dim, here].T
    return rows.reshape(n - 1, n * dim)


def held_force(cable: Cable, t: float) -> Array:
    """Forces of the grasps on the constraint rows at time t, shape (rows,), where the forces of the
    length constraints act too.
    """
    force = cable.forces(t, cable.velocities(t))
    held = cable.held_force(t, force)
    model = cable.model
    acceleration = cable.free_acceleration(force, keep=False)
    shifts = cable.shifts
    for k, row in enumerate(model.holding.rows):
        shift = held[k] * shifts[row.point]
        if row.line >= 0:
            acceleration[row.line] += shift
        else:
            acceleration[: len(model.axes)] += np.outer(cable.directions[k], shift)
    lines = cable.padded(force)
    v = cable.padded(cable.velocities(t))
    cable.call(rattle.add_constraint_force, v, cable.padded(acceleration), lines)
    return cable.held_force(t, cable.shown(lines))
