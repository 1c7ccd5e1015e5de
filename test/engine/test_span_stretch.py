"""Stretching by means over spans: what it refuses, and that a thin cable does not lock."""

import numpy as np
import pytest
from cables import SOFT, move, simulator


@pytest.mark.parametrize("n", [7, 9, 13])
def test_a_thin_cantilever_bends(n):
    """A steel wire under its weight, against the elastica; at every sample it is off by 0.43,
    0.10 and 0.017 m."""
    values = {
        "cable.diameter": 1e-3,
        "cable.youngs_modulus": 2e11,
        "cable.density": 7800.0,
        "start.clamped": True,
        "initial.shape": "equilibrium",
        "discretization.stretch": "span",
    }
    # EI theta'' = q (L - s) cos theta, solved by collocation: tip at (0.7986259, -0.5602134)
    tip = simulator(values, n=n).control_points[-1, :3]
    off = np.linalg.norm(tip - [0.7986259, 0.0, -0.5602134])
    assert off < {7: 6e-3, 9: 1.6e-3, 13: 3e-4}[n]


@pytest.mark.parametrize("n", [7, 11])
def test_violent_compression_does_not_turn_the_first_span_over(n):
    """The other end comes at 10 m/s, 0.4 of the speed of sound, by half of the length. With Gauss
    points alone the first edge turns over, to -0.2 of its length."""
    ends = {"end.fixed": [True] * 3, "end.position": [1.0, 0.0, 0.0]}
    values = {"discretization.stretch": "span", "terms.out_of_plane": "on"}
    sim = simulator(SOFT, ends, values, n=n, method="energy_momentum", step=1e-3)
    move(sim, "end", 0.05, velocity=[-10.0, 0.0, 0.0])
    for _ in range(75):
        assert sim.advance_steps(1).status.advanced  # unresolved while it is compressed so
        edge = sim.control_points[1, 0] - sim.control_points[0, 0]
        assert edge > 0.05 / 3 / (n - 3)
