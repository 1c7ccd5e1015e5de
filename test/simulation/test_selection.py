"""The method and the step that `auto` and 0 stand for."""

import numpy as np
import pytest
from cables import simulator

WIRE = {
    "cable.length": 1.0,
    "cable.diameter": 0.002,
    "cable.density": 2700.0,
    "cable.youngs_modulus": 6.9e10,
    "cable.shear_modulus": 2.6e10,
    "discretization.quadrature": "gauss",
    "discretization.samples": 3,
    "gravity": [0.0, 0.0, -9.81],
    "start.fixed": [True] * 3,
    "end.position": [1.0, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "initial.shape": "straight",
}


def chosen(*more, **values):
    return simulator(WIRE, *more, n=7, **{"method": "auto", "step": 0.0} | values)


def middle(sim, duration=1.0, every=0.005):
    found = []
    for _ in range(round(duration / every)):
        assert sim.advance_steps(round(every / sim.step)).status.ok
        found.append(sim.centerline([0.5])[0, 2])
    return np.array(found)


@pytest.mark.parametrize(
    ("target", "damping", "method"),
    [
        (1e-3, 0.0, "energy_momentum"),
        (1e-5, 0.0, "energy_momentum_4"),
        (1e-5, 0.1, "energy_momentum"),
    ],
)
def test_stiff_scenes_get_the_order_that_their_accuracy_pays_for(target, damping, method):
    sim = chosen({"accuracy.target": target, "damping.mass": damping})
    assert sim.method == method
    assert "stiff" in sim.choice.reason
    assert ("order 4" in sim.choice.reason) == (method == "energy_momentum_4")


@pytest.mark.parametrize("target", [1e-3, 1e-4, 1e-5])
def test_the_chosen_step_keeps_about_what_was_asked_for(target):
    """A wire let go at once is the hard case: all its modes err together."""
    sim = chosen({"accuracy.target": target})
    exact = middle(chosen(method="energy_momentum_4", step=2e-4))
    off = np.abs(middle(sim) - exact).max()
    assert off < 3 * target
    # A method that asks for far more than it needs would pass above and fail here.
    coarse = chosen(method=sim.method, step=min(16 * sim.step, 5e-3))
    assert np.abs(middle(coarse) - exact).max() > min(off, 1e-6)
