"""Lines that a natural shape bends, against arcs and helices."""

import numpy as np
import pytest

from dlo_sim.core import rotations
from dlo_sim.core.bent_line import PARTS, bent_line

LENGTH = 0.7


@pytest.mark.parametrize("shape", [(3.0, 0.0, 0.0), (0.0, -2.0, 0.0), (1.0, 2.0, 5.0)])
def test_constant_curvature_and_twist_make_a_helix(shape):
    """r' turns with the material frame about a constant vector w in it: r' = exp(s w) x."""
    start = rotations.to_matrix(rotations.from_rotation_vector([0.3, -0.8, 0.5]))
    u = np.linspace(0.0, LENGTH, PARTS + 1)
    first, second, twist = shape
    s = np.linspace(0.0, LENGTH, 100 * PARTS + 1)
    turns = rotations.from_rotation_vector(np.outer(s, [twist, first, second]))
    slope = rotations.rotate(turns, np.array([1.0, 0.0, 0.0])) @ start.T
    steps = 0.5 * (slope[1:] + slope[:-1]) * (s[1] - s[0])
    exact = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])[::100]
    line = bent_line(start, [[value] * 2 for value in shape], LENGTH, u)
    assert line == pytest.approx(exact, abs=2e-3 * LENGTH)
    assert np.linalg.norm(line[-1] - LENGTH * start[:, 0]) > 0.1 * LENGTH
