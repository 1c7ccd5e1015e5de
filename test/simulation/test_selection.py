"""The method and the step that `auto` and 0 stand for."""

import numpy as np
import pytest
from cables import simulator
from corpus import draw_swing

from dlo_sim.core.methods import IMPLICIT, METHODS, RUNGE_KUTTA, SPLITTING, ZHAI
from dlo_sim.scene import terms
from dlo_sim.scene.loading import SceneError, load_scene, scene_from_values
from dlo_sim.simulation.selection import less_work
from dlo_sim.simulation.simulator import Simulator

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


@pytest.mark.parametrize("modulus", [1e4, 1e5, 1e6, 1e7])
def test_a_soft_cable_gets_an_implicit_method(modulus):
    """Let go at one end, it falls far. The softest ones fold at the clamp, which is said."""
    hanging = {"cable.youngs_modulus": modulus, "end.fixed": [False] * 3, "start.clamped": True}
    sim = chosen(hanging)
    assert (sim.method, sim.choice.limit) == ("energy_momentum", np.inf)
    assert sim.advance(5.0).status.advanced
    assert sim.energy_error < 1e-5


@pytest.mark.parametrize(
    ("seed", "duration", "status"),
    [(1, 10.0, "DIVERGED"), (9, 2.05, "UNRESOLVED"), (8, 10.0, "OK")],
)
def test_an_explicit_swing_is_right_or_said(seed, duration, status):
    """At the chosen share of the limit at rest these gain energy: 50 %, 4 % and 0.6 %."""
    sim = Simulator(scene_from_values(draw_swing(seed, "velocity_verlet").values))
    report = sim.advance(duration)
    assert report.status.name == status
    assert "or energy_momentum" in (report.message or sim.warnings[0])
    right = Simulator(scene_from_values(draw_swing(5, "velocity_verlet").values))
    assert right.advance(1.0).status.ok and not right.warnings


@pytest.mark.parametrize("method", ["auto", "velocity_verlet"])
def test_stiffness_damping_against_what_needs_an_explicit_method(method):
    """The cure is not an implicit method, which does not know Frenet torsion."""
    term = {"terms.twist": "frenet"}
    values = {"damping.stiffness": 0.01} | term
    with pytest.raises(SceneError, match="^terms.twist frenet needs an explicit method, damping"):
        chosen(values, method=method, step=1e-6)
    with pytest.raises(SceneError, match="velocity_verlet is not valid with damping.stiffness"):
        chosen({"damping.stiffness": 0.01}, method="velocity_verlet", step=1e-6)
    sim = chosen(term, {"damping.mass": 0.1})
    assert (sim.method, sim.choice.reason[:18]) == ("velocity_verlet", "terms.twist frenet")


def test_a_plastic_cable_has_explicit_and_implicit_methods():
    slipping = {"plasticity.yield_curvature": 2.0}
    assert chosen(slipping, {"damping.stiffness": 0.01}).method == "energy_momentum"
    assert chosen(slipping, method="velocity_verlet", step=1e-6).method == "velocity_verlet"


def test_scenes_and_methods_agree_on_which_methods_can_damp():
    """The scene names methods that the table of methods describes."""
    kinds = {
        terms.EXPLICIT: [
            one for one in METHODS.values() if one.family in (SPLITTING, RUNGE_KUTTA, ZHAI)
        ],
        terms.IMPLICIT: [one for one in METHODS.values() if one.family == IMPLICIT],
        terms.FORWARD: [one for one in METHODS.values() if one.stiffness_damping],
        terms.SINGLE: [one for one in METHODS.values() if one.mass_damping],
    }
    for names, methods in kinds.items():
        assert set(names) == {one.name for one in methods}


def test_damping_that_thins_has_one_method(method="implicit_midpoint"):
    values = {"damping.bend": 0.01, "damping.thinning": 3.0}
    assert chosen(values).method == "energy_momentum"
    with pytest.raises(SceneError, match=f"{method} is not valid with damping.thinning 3; "):
        chosen(values, method=method, step=1e-3)
    assert chosen({"damping.thinning": 3.0}, method=method, step=1e-3).method == method


def test_what_would_take_far_less_work_is_known():
    wire = load_scene("paper_wire")
    slow = wire.with_values({"integrator.method": "forest_ruth", "integrator.step": 1e-8})
    other = less_work(slow, Simulator(slow).choice)
    assert other is not None
    assert (other.method.name, other.step) == ("energy_momentum", 2.5e-3)
    free = wire.with_values({"integrator.method": "auto", "integrator.step": 0.0})
    assert less_work(free, Simulator(free).choice) is None
    # Frenet torsion leaves no choice of the method, only of the step.
    frenet = slow.with_values({"terms.twist": "frenet"})
    other = less_work(frenet, Simulator(frenet).choice)
    assert other is not None and other.method.name == "velocity_verlet"
