"""Derived quantities of a scene, and changes of a scene."""

import math

import pytest

from dlo_sim.scene.loading import SceneError, scene_from_values

ALUMINIUM = {
    "cable.diameter": 0.002,
    "cable.density": 2700.0,
    "cable.youngs_modulus": 69e9,
    "cable.shear_modulus": 26e9,
}


def test_stiffness_and_mass_are_derived_from_the_material():
    cable = scene_from_values(ALUMINIUM).cable
    # Values of the paper's wire: EA = 2.17e5 N, EI = 0.0542 N m^2, mu = 8.48e-3 kg/m.
    assert cable.EA == pytest.approx(2.1677e5, rel=1e-4)
    assert cable.EI == pytest.approx(0.054192, rel=1e-4)
    assert cable.mu == pytest.approx(8.4823e-3, rel=1e-4)
    assert cable.GJ == pytest.approx(26e9 * math.pi * 0.002**4 / 32)
    assert cable.polar_inertia == pytest.approx(2700 * math.pi * 0.002**4 / 32)


def test_direct_values_replace_derived_ones():
    direct = {
        "cable.linear_density": 0.5,
        "cable.axial_stiffness": 11.0,
        "cable.bending_stiffness": 12.0,
        "cable.torsional_stiffness": 13.0,
    }
    cable = scene_from_values({**ALUMINIUM, **direct}).cable
    assert (cable.mu, cable.EA, cable.EI, cable.GJ) == (0.5, 11.0, 12.0, 13.0)
    assert cable.polar_inertia == pytest.approx(0.5 * 0.002**2 / 8)


@pytest.mark.parametrize(
    ("values", "topic"),
    [
        ({}, "~/tip/wrench"),
        ({"type": "force"}, "~/tip/force"),
        ({"topic": "/robot/wrench"}, "/robot/wrench"),
        ({"signal": "sine"}, ""),
    ],
)
def test_topic_of_a_load(values, topic):
    scene = scene_from_values(
        {"loads.names": ["tip"], **{f"loads.tip.{key}": value for key, value in values.items()}}
    )
    assert scene.load("tip").input_topic == topic


def test_force_load_named_force_has_the_short_topic():
    scene = scene_from_values({"loads.names": ["force"], "loads.force.type": "force"})
    assert scene.load("force").input_topic == "~/force"


def test_unknown_load_is_named_with_those_there_are():
    with pytest.raises(KeyError, match=r"no load 'tap'.*tip"):
        scene_from_values({"loads.names": ["tip"]}).load("tap")


def test_ends_know_whether_they_are_held_and_driven():
    scene = scene_from_values(
        {"start.pose_topic": "/pose", "end.spring": [0.0, 0.0, 5.0], "end.position": [1, 0, 0]}
    )
    assert (scene.start.held, scene.start.driven) == (True, True)
    assert (scene.end.held, scene.end.driven) == (True, False)
    assert not scene_from_values({}).end.held


def test_with_values_changes_a_copy():
    scene = scene_from_values({"cable.length": 2.0})
    changed = scene.with_values({"discretization.control_points": 20})
    assert changed.discretization.control_points == 20
    assert changed.cable.length == 2.0
    assert scene.discretization.control_points == 0


def test_with_values_checks_the_whole_scene_again():
    scene = scene_from_values({})
    with pytest.raises(SceneError, match="end.clamped: true needs end.fixed"):
        scene.with_values({"end.clamped": True})


def test_with_values_adds_and_drops_loads():
    scene = scene_from_values({"loads.names": ["a"], "loads.a.position": 0.25})
    both = scene.with_values({"loads.names": ["a", "b"], "loads.b.type": "force"})
    assert [load.name for load in both.loads] == ["a", "b"]
    assert both.load("a").position == 0.25
    assert [load.name for load in both.with_values({"loads.names": ["b"]}).loads] == ["b"]


def test_scenes_compare_and_hash_by_value():
    one, other = scene_from_values(ALUMINIUM), scene_from_values(dict(ALUMINIUM))
    assert one == other and hash(one) == hash(other)
    assert one != one.with_values({"rate": 100.0})
