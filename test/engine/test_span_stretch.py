"""Stretching by means over spans: what it refuses, and that a thin cable does not lock."""

import numpy as np
import pytest
from cables import SOFT, scene_of, simulator

from dlo_sim.scene.loading import SceneError


@pytest.mark.parametrize(
    ("values", "cure"),
    [
        (
            {"discretization.quadrature": "uniform", "discretization.samples": 101},
            "discretization.quadrature to gauss",
        ),
        ({"discretization.control_points": 4}, "5 control points"),
    ],
)
def test_where_it_cannot_be_is_one_line(values, cure):
    with pytest.raises(SceneError, match="discretization.stretch: 'span'.*" + cure):
        scene_of(SOFT, {"discretization.stretch": "span"}, values)


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
