"""Whether a machine keeps up with a scene."""

import pytest

from dlo_sim.doctor.scene import findings, keeping_up
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator


@pytest.mark.parametrize(
    ("load", "level"),
    [(0.1, "ok"), (0.49, "ok"), (0.7, "note"), (1.0, "problem"), (9.0, "problem")],
)
def test_steps_that_do_not_fit_into_the_timer_are_a_problem(load, level):
    found = keeping_up(200.0, load)
    assert found.level == level
    assert f"{load:.0%} of a timer period (5 ms" in found.what
    assert bool(found.cure) == (level != "ok")


def test_method_step_limit_and_warnings_of_a_scene():
    values = {"start.clamped": True, "start.tangent": [1, 0, 0], "terms.gravity": "off"}
    values |= {"discretization.control_points": 7, "integrator.method": "velocity_verlet"}
    simulator = Simulator(scene_from_values(values))
    computed, method, warning, _ = findings(simulator)
    assert computed.what.startswith("active terms: stretch, bend; inactive: ")
    assert f"of the stability limit {simulator.choice.limit:.3g} s" in method.what
    assert (warning.level, "terms.gravity: off" in warning.what) == ("note", True)
