"""Regularised Frenet torsion: exact values, exact gradient, what the floor does."""

import frenet_torsion as torsion
import numpy as np
import pytest
from differences import assert_limit

from dlo_sim.core import bspline, quadrature

N, LENGTH, GJ, FLOOR = 9, 2.0, 0.04, 0.3
KNOTS = bspline.clamped_knots(N, LENGTH)
RULE = quadrature.gauss(np.linspace(0.0, LENGTH, N - 2), 3)
GREVILLE = bspline.greville(KNOTS)


def bent() -> np.ndarray:
    rng = np.random.default_rng(3)
    points = np.zeros((N, 4))
    points[:, 0] = GREVILLE
    return points + 0.1 * rng.normal(size=(N, 4))


def straight() -> np.ndarray:
    points = np.zeros((N, 4))
    points[:, :3] = np.outer(GREVILLE, [0.6, 0.0, 0.8])
    points[:, 3] = 0.4 * GREVILLE**2
    return points


def inflected() -> np.ndarray:
    points = np.zeros((N, 4))
    points[:, 0] = GREVILLE
    points[:, 2] = 0.1 * np.sin(np.pi * GREVILLE)
    points[:, 3] = 0.2 * GREVILLE**2
    return points


def helix(radius: float, pitch: float, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Control points and knots of a helix of unit speed: kappa = r / (r^2 + p^2), torsion p /
    (...)."""
    knots = bspline.clamped_knots(n, LENGTH)
    u = bspline.greville(knots) / np.hypot(radius, pitch)
    curve = np.stack([radius * np.cos(u), radius * np.sin(u), pitch * u, 0.0 * u], axis=1)
    return bspline.interpolate(knots, curve), knots


@pytest.mark.parametrize("shape", [bent, straight, inflected])
def test_gradient_is_exact(shape) -> None:
    points = shape()
    exact = torsion.gradient(points, KNOTS, RULE, GJ, FLOOR)
    assert_limit(exact, lambda x: torsion.energy(x, KNOTS, RULE, GJ, FLOOR), points, bound=1e-8)
    assert np.abs(exact[:, :3]).max() > 0.0 or shape is straight


def test_helix_has_its_torsion_and_the_floor_suppresses_it() -> None:
    radius, pitch = 0.2, 0.1
    points, knots = helix(radius, pitch)
    size = radius**2 + pitch**2
    kappa, exact = radius / size, pitch / size
    u = np.linspace(0.3, 1.7, 200)  # away from the ends, where interpolation is rough
    gamma = torsion.torsion(points, knots, u, 0.0)
    assert gamma.mean() == pytest.approx(exact, rel=2e-3)
    for floor in (0.5 * kappa, kappa, 2.0 * kappa):
        share = kappa**2 / (kappa**2 + floor**2)
        assert torsion.torsion(points, knots, u, floor).mean() == pytest.approx(
            share * exact, rel=5e-3
        )
    assert not torsion.undefined(points, knots, u, 0.9 * kappa).any()
    assert torsion.undefined(points, knots, u, 1.1 * kappa).all()


def test_straight_cable_has_none_and_says_so() -> None:
    points, u = straight(), np.linspace(0.0, LENGTH, 50)
    assert np.array_equal(torsion.torsion(points, KNOTS, u, FLOOR), np.zeros(50))
    assert torsion.undefined(points, KNOTS, u, FLOOR).all()
    assert np.isfinite(torsion.gradient(points, KNOTS, RULE, GJ, 1e-12)).all()
