"""The axial tension as an unknown of its own: stiff cables cost no more, and the limit of an
infinite stiffness keeps the length."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator

# Let go from a straight line that points upwards: its free end whips.
SWING = {
    "cable.length": 1.0,
    "cable.diameter": 0.004,
    "cable.linear_density": 0.015,
    "cable.bending_stiffness": 6e-5,
    "end.position": [0.8, 0.0, 0.6],
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "integrator.method": "energy_momentum",
    "integrator.step": 0.002,
    "terms.twist": "off",
}
CONSTANT_LENGTH = {"terms.stretch": "off"}


def swung(n, values, steps=500):
    sim = Simulator(load_scene(SWING | {"discretization.control_points": n} | values))
    report = sim.advance_steps(steps)
    assert report.status.ok and report.steps == steps
    return sim, report.force_evaluations / steps


@pytest.mark.parametrize("n", [13, 41])
def test_iterations_do_not_grow_with_the_axial_stiffness(n):
    """3 to 5 a step; with the tension of the iterate in the tangent 6 at 1e3 N, 120 at 1e8 N."""
    for stiffness in (1e3, 1e5, 1e8):
        sim, iterations = swung(n, {"cable.axial_stiffness": stiffness})
        assert iterations < 6.0
        assert sim.energy_error < 1e-5


def test_a_cable_of_constant_length_is_the_limit_of_stiff_ones():
    """Of the same order as the time step's own error: the whip is chaotic later."""
    limit, iterations = swung(41, CONSTANT_LENGTH)
    assert iterations < 6.0 and limit.energy_error < 1e-6
    u = np.linspace(0.0, 1.0, 4001)
    length = np.linalg.norm(np.diff(limit.centerline(u), axis=0), axis=1).sum()
    assert length == pytest.approx(1.0, abs=3e-6)  # by the quadrature of the spans
    tips = [
        swung(41, {"cable.axial_stiffness": stiffness})[0].control_points[-1, :3]
        for stiffness in (1e2, 1e6)
    ]
    away = [math.dist(tip, limit.control_points[-1, :3]) for tip in tips]
    assert away[1] < 2e-3 < away[0]


def test_a_cable_of_constant_length_hangs_as_a_catenary_and_stays():
    """Sag and horizontal force of the catenary, from the start and after a second."""
    span, weight = 0.6, 0.05 * 9.81
    values = {
        "cable.length": 1.0,
        "cable.diameter": 0.004,
        "cable.linear_density": 0.05,
        "cable.bending_stiffness": 1e-7,
        "end.position": [span, 0.0, 0.0],
        "end.fixed": [True] * 3,
        "discretization.control_points": 41,
    }
    sim = Simulator(load_scene(values | CONSTANT_LENGTH))
    a = brentq(lambda a: 2.0 * a * math.sinh(0.5 * span / a) - 1.0, 0.01, 10.0)
    for duration in (0.0, 1.0):
        assert sim.advance(duration).status.ok
        sag = -sim.centerline([0.5])[0, 2]
        assert sag == pytest.approx(a * (math.cosh(0.5 * span / a) - 1.0), rel=1e-5)
        force = sim.reaction("start")[0]
        assert force[0] == pytest.approx(-weight * a, rel=1e-4)
        assert force[2] == pytest.approx(0.5 * weight, rel=1e-6)
    assert sim.left_out["stretch"] == "the cable keeps its rest length (terms.stretch is off)"
    assert "stretch" not in sim.active_terms


@pytest.mark.parametrize(
    "values",
    [
        {"discretization.stretch": "sample"},
        {"discretization.control_points": 8},
        {"damping.stretch": 0.01},
        {"integrator.method": "energy_momentum_4"},
    ],
    ids=lambda values: " ".join(values),
)
def test_the_length_is_kept_whatever_else_a_scene_says(values):
    """The strain counts by span, and what does not stretch dissipates nothing."""
    sim, iterations = swung(13, CONSTANT_LENGTH | values, steps=100)
    assert iterations < 6.0 * len(sim.choice.method.substeps)
    assert sim.energy().stretch < 1e-9 * sim.energy().kinetic
    assert sim.energy_error < 1e-5 and sim.cable.account.dissipated == 0.0


def test_what_would_change_the_length_is_refused_in_one_line():
    sim, _ = swung(13, CONSTANT_LENGTH, steps=20)
    points, shift = sim.control_points, np.zeros((13, 3))
    stretching = Simulator(load_scene(SWING))
    for refused in (
        lambda: sim.start_from(1.01 * points),
        lambda: sim.start_from_points(points[:, :3]),
        lambda: sim.correct(shift, shift),
        lambda: sim.reconfigured(sim.scene.with_values({"cable.length": 1.01})),
        lambda: stretching.reconfigured(sim.scene),
    ):
        with pytest.raises(ValueError, match="terms.stretch: off keeps the length.* to auto$"):
            refused()
    assert sim.reconfigured(sim.scene.with_values({"damping.mass": 1.0})).advance(0.1).status.ok


def test_an_upright_column_of_constant_length_falls_over():
    """Its compression shows in the multipliers alone; the column is straight to the last bit."""
    upright = {
        "cable.youngs_modulus": 1e6,
        "cable.bending_stiffness": 0.0,
        "start.clamped": True,
        "end.position": [0.0, 0.0, 1.0],
        "damping.mass": 0.2,
    }
    sim = Simulator(load_scene(SWING | CONSTANT_LENGTH | upright))
    assert sim.advance(0.5).status.ok
    assert sim.control_points[-1, 2] < 0.5
    assert any("the cable left at" in line for line in sim.notes)


def test_where_the_ends_pull_it_taut_the_length_is_not_kept():
    taut = {"end.position": [1.0, 0.0, 0.0], "end.fixed": [True] * 3}
    sim = Simulator(load_scene(SWING | CONSTANT_LENGTH | taut))
    assert any("its ends pull it taut" in line for line in sim.warnings)
    sim.advance_steps(50)
    assert sim.centerline([0.5])[0, 2] < -1e-3  # it hangs: nothing keeps its length


def test_the_retired_name_of_the_method_is_read_with_one_line():
    with pytest.warns(UserWarning, match="means energy_momentum with terms.stretch off"):
        scene = load_scene(SWING | {"integrator.method": "rattle"})
    assert scene == load_scene(SWING | CONSTANT_LENGTH)
