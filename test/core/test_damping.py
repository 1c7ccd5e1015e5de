"""Rayleigh coefficients: the formula, its minimum, the way back, refusals."""

import numpy as np
import pytest

from dlo_sim.core.damping import damping_ratio, rayleigh_coefficients


def test_ratio_of_each_part():
    omega = np.array([0.5, 2.0, 10.0])
    assert np.allclose(damping_ratio(omega, 0.4, 0.0), [0.4, 0.1, 0.02])
    assert np.allclose(damping_ratio(omega, 0.0, 0.01), [0.0025, 0.01, 0.05])


def test_ratio_is_that_of_the_damped_oscillator():
    """Roots of x'' + (alpha + beta omega^2) x' + omega^2 x: real part -zeta omega."""
    alpha, beta, omega = 0.3, 0.02, 7.0
    roots = np.roots([1.0, alpha + beta * omega**2, omega**2])
    assert -roots.real[0] / omega == pytest.approx(float(damping_ratio(omega, alpha, beta)))


def test_least_damped_frequency():
    alpha, beta = 0.3, 0.02
    omega = np.geomspace(0.1, 1000, 4001)
    zeta = damping_ratio(omega, alpha, beta)
    assert zeta.min() == pytest.approx(np.sqrt(alpha * beta), rel=1e-5)
    assert omega[zeta.argmin()] == pytest.approx(np.sqrt(alpha / beta), rel=3e-3)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize(("zeta_1", "zeta_2"), [(0.02, 0.02), (0.05, 0.03), (0.01, 0.04), (0, 0)])
def test_coefficients_give_both_ratios_back(zeta_1, zeta_2, swap):
    modes = [(3.0, zeta_1), (40.0, zeta_2)][:: -1 if swap else 1]
    alpha, beta = rayleigh_coefficients(*modes[0], *modes[1])
    assert alpha >= 0
    assert beta >= 0
    for omega, zeta in modes:
        assert float(damping_ratio(omega, alpha, beta)) == pytest.approx(zeta, rel=1e-12)


def test_pure_damping_at_the_border_of_what_is_possible():
    alpha, beta = rayleigh_coefficients(2.0, 0.1, 4.0, 0.05)
    assert (alpha, beta) == (pytest.approx(0.4), pytest.approx(0.0, abs=1e-17))


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("zetas", [(0.01, 0.5), (0.5, 0.01), (0.01, float("nan")), (-0.1, -0.1)])
def test_ratios_that_need_a_negative_coefficient_are_refused(zetas, swap):
    modes = [(2.0, zetas[0]), (4.0, zetas[1])][:: -1 if swap else 1]
    with pytest.raises(ValueError, match="must lie between 0.5 and 2"):
        rayleigh_coefficients(*modes[0], *modes[1])


@pytest.mark.parametrize("omegas", [(2.0, 2.0), (0.0, 1.0), (3.0, -1.0)])
def test_frequencies_that_decide_nothing_are_refused(omegas):
    with pytest.raises(ValueError, match="two different positive frequencies"):
        rayleigh_coefficients(omegas[0], 0.1, omegas[1], 0.1)
    with pytest.raises(ValueError, match="is not positive"):
        damping_ratio([1.0, 0.0], 0.1, 0.1)
