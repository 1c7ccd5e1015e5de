"""Explicit methods on one oscillator: order and stability limit."""

import numpy as np
import pytest
from amplification import amplification, spectral_radius

from dlo_sim.core.methods import IMPLICIT, METHODS, Method

EXPLICIT = [method for method in METHODS.values() if method.family != IMPLICIT]


def exact(omega: float, decay: float) -> np.ndarray:
    """exp of the oscillator's matrix over one step, by eigenvalues."""
    values, vectors = np.linalg.eig(np.array([[0.0, 1.0], [-omega * omega, -decay]], dtype=complex))
    return (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real


def error_after(method: Method, steps: int, omega: float, decay: float) -> float:
    """Position error at time 1 of an oscillator that starts at (1, 0.3)."""
    matrix = amplification(method, omega / steps, decay / steps)
    scaled = np.array([1.0, 0.3 / steps, 0.0])[: len(matrix)]
    if len(matrix) == 3:
        # the first step takes the present acceleration for the one before
        scaled[2] = -((omega / steps) ** 2) * scaled[0] - decay / steps * scaled[1]
    state = np.linalg.matrix_power(matrix, steps) @ scaled
    return abs(state[0] - (exact(omega, decay) @ [1.0, 0.3])[0])


@pytest.mark.parametrize(
    ("method", "decay"),
    [(one, decay) for one in EXPLICIT for decay in (0.0, 0.7) if one.mass_damping or not decay],
    ids=lambda value: getattr(value, "name", value),
)
def test_order_on_an_oscillator(method: Method, decay: float) -> None:
    errors = [error_after(method, steps, 3.0, decay) for steps in (80, 160, 320, 640)]
    slopes = np.diff(np.log2(errors))
    np.testing.assert_allclose(-slopes, method.order, atol=0.15)


@pytest.mark.parametrize("method", EXPLICIT, ids=lambda m: m.name)
def test_recorded_limit_is_where_the_radius_leaves_one(method: Method) -> None:
    limit = method.stability_limit
    for share in (*np.linspace(0.01, 0.99, 60), 1.0 - 1e-4):
        assert spectral_radius(amplification(method, share * limit)) <= 1.0 + 1e-9
    assert spectral_radius(amplification(method, 1.01 * limit)) > 1.01


def test_splitting_methods_keep_area_and_rk4_does_not() -> None:
    for method in EXPLICIT:
        determinant = np.linalg.det(amplification(method, 1.1))
        if method.symplectic:
            assert determinant == pytest.approx(1.0, abs=1e-14)
        else:
            assert abs(determinant - 1.0) > 1e-3


def test_damping_is_solved_exactly_by_a_splitting() -> None:
    verlet = METHODS["velocity_verlet"]
    assert np.linalg.det(amplification(verlet, 1.0, 0.3)) == pytest.approx(np.exp(-0.3), rel=1e-14)


@pytest.mark.parametrize("name", ["rk4", "zhai"])
@pytest.mark.parametrize("decay", [0.0, 1e-4, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 1e3])
def test_a_decay_counts_as_a_frequency(name: str, decay: float) -> None:
    """At the step that this allows, all modes up to a frequency of 1 are stable. Without stiffness
    it is the longest; with a decay as fast as the modes it may be half of that."""
    method = METHODS[name]
    step = method.stability_limit / (1.0 + method.decay_weight * decay)
    modes = np.linspace(0.0, 1.0, 200)
    assert spectral_radius(amplification(method, step * modes, step * decay)) <= 1.0 + 1e-9
    if decay > 100.0 or decay < 1e-3:
        assert (
            spectral_radius(amplification(method, 1.02 * step * modes, 1.02 * step * decay)) > 1.0
        )


def test_implicit_methods_have_no_matrix() -> None:
    with pytest.raises(ValueError, match="implicit"):
        amplification(METHODS["implicit_midpoint"], 1.0)
