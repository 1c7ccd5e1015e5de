"""The scenes in config/: loadable here and by ROS, and what they claim to be."""

import math

import numpy as np
import pytest
from ruamel.yaml import YAML

from dlo_sim.scene.description import NAMED, scene_parameters
from dlo_sim.scene.loading import load_scene, shipped_scene, shipped_scenes

NAMES = sorted(shipped_scenes())


def raw_values(name: str, version: tuple[int, int]) -> dict:
    """The flat values of a shipped scene as a plain YAML reader of this version sees them."""
    reader = YAML(typ="safe", pure=True)
    reader.version = version
    document = reader.load(shipped_scene(name).read_text())
    assert list(document) == ["/**"]
    flat = {}

    def flatten(block, prefix):
        for key, value in block.items():
            if isinstance(value, dict):
                flatten(value, f"{prefix}{key}.")
            else:
                flat[prefix + key] = value

    flatten(document["/**"]["ros__parameters"], "")
    return flat


@pytest.mark.parametrize("name", NAMES)
def test_doubles_are_written_as_doubles_because_ros_refuses_integers(name):
    values = raw_values(name, (1, 2))
    named = (tuple(values.get(f"{group}.names", ())) for group in NAMED)
    rows = {row.key: row for row in scene_parameters(*named)}
    checked = 0
    for key, value in values.items():
        if rows[key].element_kind == "double":
            numbers = value if isinstance(value, list) else [value]
            assert all(type(number) is float for number in numbers), f"{key}: {value}"
            checked += len(numbers)
    assert checked > 5


@pytest.mark.parametrize("name", NAMES)
def test_readers_of_yaml_1_1_see_the_same_values(name):
    assert raw_values(name, (1, 1)) == raw_values(name, (1, 2))


def test_paper_wire_is_the_scene_of_the_paper():
    scene = load_scene("paper_wire")
    assert (scene.cable.length, scene.cable.diameter, scene.cable.density) == (2.0, 0.002, 2700.0)
    assert (scene.cable.youngs_modulus, scene.cable.shear_modulus) == (69e9, 26e9)
    assert scene.discretization.control_points == 9
    assert (scene.discretization.quadrature, scene.discretization.samples) == ("uniform", 101)
    for end in scene.ends.values():
        assert end.fixed == (False, True, True)
        assert end.spring == (1e4, 0.0, 0.0)
        assert not end.clamped
    assert (scene.start.position, scene.end.position) == ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert (scene.damping.mass, scene.damping.stiffness, scene.damping.air_drag) == (0.0, 0.0, 0.0)
    assert (scene.integrator.method, scene.integrator.step) == ("forest_ruth", 0.0)
    assert scene.loads == ()


def test_second_scenario_adds_only_the_force():
    scene = load_scene("paper_wire_force")
    load = scene.load("centre")
    assert (load.type, load.position, load.signal) == ("force", 0.5, "sine")
    assert (load.force, load.frequency) == ((0.0, 0.1, 0.0), 1.0)
    assert scene.with_values({"loads.names": []}) == load_scene("paper_wire")


def test_hanging_cable_is_the_identified_cable():
    # The authors' record of `black_weighted`: mass of the cable and of the end, length, diameter,
    # k, Theta0, Theta1, beta.
    mass, end_mass, length, diameter, k, theta0, theta1, beta = (
        *(0.6, 0.23, 0.6, 0.02),
        *(0.1965, 0.1421, 1.2391, 0.0347224207914685),
    )
    scene = load_scene("hanging_cable")
    assert scene.cable.mu * scene.cable.length == pytest.approx(mass)
    assert (scene.end.mass, scene.cable.length, scene.cable.diameter) == (
        end_mass,
        length,
        diameter,
    )
    assert scene.cable.EI == pytest.approx(k * length, rel=1e-6)
    assert scene.cable.rest_curvature == pytest.approx(
        (theta0 / length, (theta0 + theta1) / length), rel=2e-4
    )
    assert scene.damping.stiffness == pytest.approx(beta / k, rel=1e-3)
    assert scene.start.mass == 0.08
    assert (scene.start.pose_topic, scene.frame_id) == ("/gripper_pose", "fr3_link0")
    assert not scene.end.held


def test_hanging_cable_bends_as_the_authors_draw_it():
    """Their shape, x = -L int sin(alpha), z = -L int cos(alpha), turns about +y from (0, 0, -1)."""
    scene = load_scene("hanging_cable")
    k0, k1 = scene.cable.rest_curvature
    s = (np.arange(4000) + 0.5) / 4000
    alpha = scene.cable.length * (k0 * s + (k1 - k0) * s**2 / 2.0)[:, None]
    tangent, axis = scene.start.tangent, scene.cable.rest_curvature_axis
    turned = np.cos(alpha) * tangent + np.sin(alpha) * np.cross(axis, tangent)
    authors = np.hstack([-np.sin(alpha), 0.0 * alpha, -np.cos(alpha)])
    assert np.abs(turned - authors).max() < 1e-6
    assert np.mean(turned, axis=0)[0] < -0.08, "the weighted cable bends towards -x, visibly"


def test_two_grippers_leave_the_cable_slack():
    scene = load_scene("two_grippers")
    assert math.dist(scene.start.position, scene.end.position) == pytest.approx(0.8)
    assert scene.cable.length == 1.0
    assert (scene.start.pose_topic, scene.end.pose_topic) == ("~/start/pose", "~/end/pose")
    assert scene.start.clamped and scene.end.clamped
    assert scene.initial.shape == "equilibrium"
