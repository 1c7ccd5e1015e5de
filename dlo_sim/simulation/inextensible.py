"""The inextensible cable: gradients of its length constraints, equilibrium, reactions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.constant_length import constraint_gram
from dlo_sim.engine import layout
from dlo_sim.methods import rattle, splitting
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder

Array = NDArray[np.float64]
MOST_STEPS = 40_000
REST = 1e-7  # of the length: largest movement between two restarts that counts as rest


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


def to_equilibrium(cable: Cable, step: float) -> bool:
    """Relax a configuration that satisfies the constraints to rest; returns whether it converged.

    Steps of RATTLE with kinetic damping: whenever the kinetic energy falls, the velocity is set to
    zero (Cundall's dynamic relaxation), until the cable hardly moves between restarts three times
    in a row.
    """
    length, dim = float(cable.model.knots[-1]), len(cable.model.axes)
    nothing = Recorder(cable.model, np.zeros(0))
    peak, still = 0.0, 0
    resting = cable.x.copy()
    for _ in range(MOST_STEPS):
        engine = splitting.engine_of(cable.terms).code
        status, _, _ = rattle.advance_rattle(
            cable.arrays, engine, 0, 1, step, MOST_STEPS, nothing.arrays
        )
        if status != layout.OK:
            return False
        kinetic = cable.kinetic()
        if kinetic < peak:
            cable.w[:] = 0.0
            moved = float(np.abs(cable.x[:dim] - resting[:dim]).max())
            still = still + 1 if moved < REST * length else 0
            if still >= 3:
                return True
            resting[:] = cable.x
            peak = 0.0
        else:
            peak = kinetic
    return False


def held_force(cable: Cable, t: float) -> Array:
    """Forces of the grasps on the held rows at time t, shape (held,), where the forces of the
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
    rattle.add_constraint_force(cable.arrays, v, cable.padded(acceleration), lines)
    return cable.held_force(t, cable.shown(lines))
