"""The scenes in config/: loadable here and by ROS, and what they claim to be."""

import math

import pytest
from ruamel.yaml import YAML

from dlo_sim.scene.description import scene_parameters
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
    groups = ("loads", "grasps", "obstacles")
    named = (tuple(values.get(f"{group}.names", ())) for group in groups)
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
    scene = load_scene(shipped_scene("paper_wire"))
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
    scene = load_scene(shipped_scene("paper_wire_force"))
    load = scene.load("centre")
    assert (load.type, load.position, load.signal) == ("force", 0.5, "sine")
    assert (load.force, load.frequency) == ((0.0, 0.1, 0.0), 1.0)
    assert scene.with_values({"loads.names": []}) == load_scene(shipped_scene("paper_wire"))


def test_hanging_cable_is_the_identified_cable():
    # The authors' record of `black_weighted`: mass of the cable and of the end, length, diameter,
    # k, Theta0, Theta1, beta.
    mass, end_mass, length, diameter, k, theta0, theta1, beta = (
        *(0.6, 0.23, 0.6, 0.02),
        *(0.1965, 0.1421, 1.2391, 0.0347224207914685),
    )
    scene = load_scene(shipped_scene("hanging_cable"))
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
    scene = load_scene(shipped_scene("hanging_cable"))
    length, (k0, k1) = scene.cable.length, scene.cable.rest_curvature
    steps = 4000
    x = z = 0.0
    tangent = scene.start.tangent
    for i in range(steps):
        s = (i + 0.5) / steps
        alpha = length * (k0 * s + (k1 - k0) * s**2 / 2.0)
        x -= math.sin(alpha) * length / steps
        z -= math.cos(alpha) * length / steps
    # The same by turning the tangent about the scene's axis.
    axis = scene.cable.rest_curvature_axis
    position = [0.0, 0.0, 0.0]
    for i in range(steps):
        s = (i + 0.5) / steps
        turn = (k0 + (k1 - k0) * s) * length / steps
        half = _rotated(tangent, axis, turn / 2.0)
        position = [p + t * length / steps for p, t in zip(position, half, strict=True)]
        tangent = _rotated(tangent, axis, turn)
    assert position == pytest.approx([x, 0.0, z], abs=1e-6)
    assert x < -0.05, "the weighted cable bends towards -x, visibly"


def _rotated(vector, axis, angle):
    """Rodrigues' rotation of a vector about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    dot = sum(a * v for a, v in zip(axis, vector, strict=True))
    cross = (
        axis[1] * vector[2] - axis[2] * vector[1],
        axis[2] * vector[0] - axis[0] * vector[2],
        axis[0] * vector[1] - axis[1] * vector[0],
    )
    return tuple(
        c * v + s * x + (1.0 - c) * dot * a for v, x, a in zip(vector, cross, axis, strict=True)
    )


def test_two_grippers_leave_the_cable_slack():
    scene = load_scene(shipped_scene("two_grippers"))
    assert math.dist(scene.start.position, scene.end.position) == pytest.approx(0.8)
    assert scene.cable.length == 1.0
    assert (scene.start.pose_topic, scene.end.pose_topic) == ("~/start/pose", "~/end/pose")
    assert scene.start.clamped and scene.end.clamped
    assert scene.initial.shape == "equilibrium"
