"""Static equilibrium of a scene, for its first shape."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels import layout
from dlo_sim.kernels.implicit import NOT_CONVERGED, advance_implicit
from dlo_sim.simulation.model import Model

MAX_STEPS = 400
MIDPOINT = layout.Alpha(0.5, 0.5, 0.25, 0.5, 2.0)
TOLERANCE = 1e-10  # of the cable's length, movement of a step that counts as rest


def relax(model: Model, state: layout.State, work: layout.Work, solver: layout.Solver) -> bool:
    """Move `state` to a nearby stable equilibrium at rest; true if it was reached.

    Pseudo-transient continuation: backward Euler steps from rest, q1 = q0 - (h^2/4) M^-1 grad
    U(q1), whose step h grows while Newton's method converges. It follows the descent of the energy
    at first and ends in Newton's method, so that it does not stop at unstable shapes on the way.
    A backward Euler step is half of an implicit midpoint step from rest.
    """
    n = model.n
    dim = len(model.axes)
    length = float(model.knots[-1])
    step = 1e-3
    for _ in range(MAX_STEPS):
        before = state.position.copy()
        state.w[:] = 0.0
        state.ledger[:] = 0.0
        state.ledger[layout.FLOOR] = 1e-30
        status, _, iterations = advance_implicit(
            state,
            model.terms,
            model.friction,
            model.viscosity,
            work,
            solver,
            0,
            1,
            step,
            False,
            MIDPOINT,
            1e-14,
            0,
            None,
        )
        if status == NOT_CONVERGED:
            step *= 0.25
            continue
        state.position[:] = 0.5 * (state.position + before)
        moved = float(np.abs(state.position[:dim, :n] - before[:dim, :n]).max())
        state.w[:] = 0.0
        if step > 1e3 and moved < TOLERANCE * length:
            return True
        step *= 4.0 if iterations <= 5 else 1.5 if iterations <= 9 else 0.8
        step = min(step, 1e6)
    return False
