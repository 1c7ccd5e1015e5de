"""A gripper that spins the cable about its axis: the energy account, and advice that helps."""

import math

import pytest
from cables import merged, move

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.report import balance_warning
from dlo_sim.simulation.simulator import Simulator


def spun(turns, duration, **values):
    """hanging_cable, whose gripper spins from rest at so many turns per second."""
    sim = Simulator(load_scene("hanging_cable", merged(**values)))
    move(sim, "start", duration, angular_velocity=[0.0, 0.0, -2.0 * math.pi * turns])
    return sim, sim.advance(duration)


@pytest.mark.parametrize("turns", [3.0, 10.0, 30.0, 100.0])
def test_a_straight_cable_spins_with_its_gripper(turns):
    """Nothing but its angle moves: with inertia left over, up to 15 % of the energy was open."""
    straight = {"cable__rest_curvature": [0.0], "terms__twist": "quasistatic"}
    sim, report = spun(turns, 1.0, **straight)
    assert report.status.ok and sim.energy_error < 1e-3 and sim.notes == ()
    angle = 2.0 * math.pi * turns
    assert sim.control_points[:, 3] == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize("turns", [10.0, 30.0])
def test_a_curved_cable_that_is_spun(turns):
    sim, report = spun(turns, 0.5)
    assert "quasistatic" in sim.active_terms
    assert report.status.ok and sim.energy_error < 1e-5 and sim.notes == ()


@pytest.mark.parametrize("step", [5e-3, 1e-3])
def test_whole_turns_do_not_make_the_angle_jump(step):
    """After 25 turns round-off decided the sign of half a turn: the angle was two turns off."""
    sim, report = spun(100.0, 0.3, integrator__step=step)
    assert report.status.ok, report.message
    assert sim.control_points[0, 3] == pytest.approx(60.0 * math.pi, abs=1e-6)


def test_an_open_energy_balance_is_said():
    conserving, other = METHODS["energy_momentum"], METHODS["implicit_midpoint"]
    assert balance_warning(conserving, 1e-6, 9e-6) == ""
    assert balance_warning(other, 1e-6, 0.1) == ""
    line = balance_warning(conserving, 1e-6, 0.018)
    assert line.startswith("energy balance: open by 0.018") and "smaller integrator.step" in line
    assert "\n" not in line
    explicit = METHODS["velocity_verlet"]
    assert balance_warning(explicit, 1e-6, 9e-4) == ""
    assert "integrator.step or energy_momentum" in balance_warning(explicit, 1e-6, 2e-3)
