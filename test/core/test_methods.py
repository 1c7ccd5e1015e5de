"""The table of methods: what each row claims, measured on one pendulum and one oscillator."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_sim.core.methods import METHODS, SPLITTING

SPLITTINGS = [method for method in METHODS.values() if method.family == SPLITTING]


def by_name(method):
    return method.name


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


@pytest.mark.parametrize("method", SPLITTINGS, ids=by_name)
def test_declared_order_on_a_pendulum(method):
    reference = pendulum(METHODS["forest_ruth"], 3000)
    counts = np.array([20, 40, 80, 160])
    errors = [np.abs(pendulum(method, n) - reference).max() for n in counts]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - method.order).max() < 0.15
    assert errors[0] < 0.1 ** (method.order / 2 + 1)


@pytest.mark.parametrize("method", SPLITTINGS, ids=by_name)
def test_declared_symmetry(method):
    """Step, turn the momentum round, step: back at the start, if the row says so."""
    q, p = step(method, 0.7, -0.4, 0.3, np.sin)
    q, p = step(method, q, -p, 0.3, np.sin)
    assert method.symmetric == (abs(q - 0.7) + abs(-p + 0.4) < 1e-15)


def test_symplectic_euler_would_not_pass_as_symmetric():
    euler = replace(METHODS["velocity_verlet"], drift_weights=(1.0,), kick_weights=(1.0,))
    q, p = step(euler, 0.7, -0.4, 0.3, np.sin)
    q, p = step(euler, q, -p, 0.3, np.sin)
    assert abs(q - 0.7) + abs(-p + 0.4) > 1e-3


def test_a_wrong_row_cannot_be_built():
    verlet = METHODS["velocity_verlet"]
    with pytest.raises(ValueError, match="kick weights sum to 0.9"):
        replace(verlet, kick_weights=(0.5, 0.4))
    with pytest.raises(ValueError, match="2 drifts, other number of kicks"):
        replace(verlet, kick_weights=(1.0,))
    with pytest.raises(ValueError, match="negative sub-steps"):
        replace(METHODS["forest_ruth"], mass_damping=True)
