"""Canonical momenta of the discretised cable and its Hamiltonian, in plain numpy.

The Lagrangian of the control points is L = 1/2 v^T M v - U(q) with the mass matrix M of the spline,
so the momenta that belong to the q_i are p = dL/dv = M v, and the Legendre transform
    H(q, p) = p.v - L = 1/2 p^T M^-1 p + U(q)
is the energy. Khalifa & Palli write p = J v with the density J (their eqs. 12-13), which is the
momentum per length of the continuous cable and not conjugate to a control point: with it Hamilton's
equations would be those of a cable whose mass matrix is J times the identity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass

Array = NDArray[np.float64]


def momenta(velocities: Array, bands: Array) -> Array:
    """p = M v [kg m/s, kg m^2/s], shape (n, rows), from velocities of the same shape.

    Args:
        bands: lower diagonals of the mass of every row, shape (rows, 4, n).
    """
    return np.stack(
        [mass.multiply(band, velocities[:, row]) for row, band in enumerate(bands)], axis=1
    )


def velocities(momenta: Array, bands: Array) -> Array:
    """v = M^-1 p, shape (n, rows): the inverse of `momenta`."""
    return np.stack(
        [np.linalg.solve(mass.dense(band), momenta[:, row]) for row, band in enumerate(bands)],
        axis=1,
    )


def lagrangian(rates: Array, bands: Array, potential: float) -> float:
    """L = 1/2 v^T M v - U [J]."""
    return float(0.5 * (rates * momenta(rates, bands)).sum() - potential)


def hamiltonian(p: Array, bands: Array, potential: float) -> float:
    """H = p.v - L [J] by the Legendre transform, with v eliminated in favour of p."""
    rates = velocities(p, bands)
    return float((p * rates).sum() - lagrangian(rates, bands, potential))
