"""Momenta and the Legendre transform."""

import numpy as np
import pytest

from dlo_sim.core import bspline, hamiltonian, mass

KNOTS = bspline.clamped_knots(8, 2.0)
BANDS = np.stack([mu * mass.gram(KNOTS) for mu in (0.3, 0.3, 0.3, 1e-4)])
V = np.random.default_rng(0).normal(size=(8, 4))


def test_momentum_is_the_slope_of_the_lagrangian():
    p = hamiltonian.momenta(V, BANDS)
    for index in np.ndindex(V.shape):
        step = np.zeros_like(V)
        step[index] = 1e-3
        slope = hamiltonian.lagrangian(V + step, BANDS, 0.0) - hamiltonian.lagrangian(
            V - step, BANDS, 0.0
        )
        assert slope / 2e-3 == pytest.approx(p[index], rel=1e-9, abs=1e-12)


def test_total_momentum_is_that_of_the_mass():
    p = hamiltonian.momenta(np.ones((8, 4)), BANDS)
    assert p.sum(axis=0) == pytest.approx([0.6, 0.6, 0.6, 2e-4])


def test_hamiltonian_is_the_energy():
    p = hamiltonian.momenta(V, BANDS)
    kinetic = 0.5 * (V * p).sum()
    assert kinetic > 0.1
    assert hamiltonian.hamiltonian(p, BANDS, 0.7) == pytest.approx(kinetic + 0.7, rel=1e-13)
    assert hamiltonian.velocities(p, BANDS) == pytest.approx(V, rel=1e-9)


def test_velocity_is_the_slope_of_the_hamiltonian():
    p = hamiltonian.momenta(V, BANDS)
    for index in [(0, 0), (3, 1), (7, 3)]:
        step = np.zeros_like(p)
        step[index] = 1e-4 * np.abs(p).max()
        slope = hamiltonian.hamiltonian(p + step, BANDS, 0.0) - hamiltonian.hamiltonian(
            p - step, BANDS, 0.0
        )
        assert slope / (2 * step[index]) == pytest.approx(V[index], rel=1e-6)
