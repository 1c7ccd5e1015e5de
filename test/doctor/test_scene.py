"""Whether a machine keeps up with a scene."""

import math
import re

import pytest

from dlo_sim.doctor.findings import keeping_up, of_scene
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
    computed, method, resolution, warning, _ = of_scene(simulator)
    assert computed.what.startswith("active terms: stretch, bend; inactive: ")
    assert f"of the stability limit {simulator.choice.limit:.3g} s" in method.what
    assert resolution.what == "7 control points as the scene asks"
    assert (warning.level, "terms.gravity: off" in warning.what) == ("note", True)


GIVEN = {"cable.bending_stiffness": 2.0e-4}
ROPE = {"cable.diameter": 0.02, "cable.youngs_modulus": 5.0e7, "cable.shear_modulus": 1.7e7}


@pytest.mark.parametrize(
    ("given", "assumed"),
    [
        ({}, []),
        (
            {"cable.bending_stiffness": 2.0e-4},
            ["torsional_stiffness: .* GJ = 2 G / E EI = 0.000136 N m", "axial_stiffness: .* EA"],
        ),
        ({"cable.bending_stiffness": 2.0e-4, "cable.torsional_stiffness": 1e-4}, ["axial_stiff"]),
        ({"cable.axial_stiffness": 500.0}, ["bending_stiffness: .* EI = E pi D"]),
        ({"cable.linear_density": 0.08}, ["polar inertia .* = 4e-06 kg m"]),
        (
            {
                "cable.axial_stiffness": 500.0,
                "cable.bending_stiffness": 2.0e-4,
                "cable.torsional_stiffness": 1e-4,
            },
            [],
        ),
    ],
)
def test_what_is_assumed_of_a_cable_that_is_given_in_part(given, assumed):
    coarse = {"discretization.control_points": 7}
    lines = [one.what for one in of_scene(Simulator(scene_from_values(ROPE | given | coarse)))][
        3:-1
    ]
    assert len(lines) == len(assumed)
    for line, pattern in zip(lines, assumed, strict=True):
        assert line.startswith("cable.") and re.search(pattern, line)


def test_torsional_stiffness_follows_bending_stiffness():
    """GJ = EI / (1 + nu) = 2 G / E EI of an isotropic section; that of the solid rod without EI."""
    rope, rod = (scene_from_values(ROPE | more).cable for more in (GIVEN, {}))
    assert pytest.approx(2.0e-4 * 2.0 * 1.7 / 5.0, rel=1e-12) == rope.GJ
    assert pytest.approx(1.7e7 * math.pi * 0.02**4 / 32.0, rel=1e-12) == rod.GJ
