"""The table of methods; what its rows claim is measured on cables, in simulation."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_sim.core.methods import METHODS


def step(method, q, p, tau, slope):
    """One drift/kick step of q'' = -slope(q)."""
    for drift, kick in zip(method.drift_weights, method.kick_weights, strict=True):
        q = q + drift * tau * p
        p = p - kick * tau * slope(q)
    return q, p


def pendulum(method, steps, duration=2.0):
    """State of a pendulum released at 1 rad after `duration`, in `steps` steps."""
    state = np.array([1.0, 0.0])
    for _ in range(steps):
        state = np.array(step(method, *state, duration / steps, np.sin))
    return state


def test_a_wrong_row_cannot_be_built():
    verlet = METHODS["velocity_verlet"]
    with pytest.raises(ValueError, match="kick weights sum to 0.9"):
        replace(verlet, kick_weights=(0.5, 0.4))
    with pytest.raises(ValueError, match="2 drifts, other number of kicks"):
        replace(verlet, kick_weights=(1.0,))
    with pytest.raises(ValueError, match="negative sub-steps"):
        replace(METHODS["forest_ruth"], mass_damping=True)
