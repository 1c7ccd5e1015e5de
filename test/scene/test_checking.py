"""Refusals: each is one line that names the key, the value and the cure."""

import math

import numpy as np
import pytest

from dlo_sim.scene.loading import SceneError, scene_from_values

HELD = {"end.fixed": [True, True, True]}
TIP = {"loads.names": ["tip"]}
UNIFORM = {"discretization.quadrature": "uniform", "discretization.samples": 20}


def refusal(values: dict) -> str:
    """The one line with which these values are refused."""
    with pytest.raises(SceneError) as caught:
        scene_from_values(values)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("cable.length", math.nan, "nan is not finite"),
        ("cable.length", math.inf, "inf is not finite"),
        ("cable.length", 0.0, "0.0 is out of range; give 0.0001 to 10000 m"),
        ("cable.length", -1, "-1 is out of range"),
        ("cable.length", 10**400, "is out of range"),
        ("inputs.latency", -0.5, "-0.5 is out of range; give auto (-1), or 0 to 10 s"),
        ("cable.length", "2 m", "'2 m' is not a number; give a number in m"),
        ("cable.length", True, "true is not a number"),
        ("cable.length", None, "no value given; give a number in m"),
        ("cable.length", [1.0], "[1.0] is not a number"),
        ("discretization.control_points", 13.0, "13.0 is not a whole number; write it without"),
        ("discretization.control_points", 3, "3 are too few for a cubic; give 4 or more, or 0"),
        ("start.clamped", 1, "1 is not a boolean; give true or false"),
        ("frame_id", 5, "5 is not a text"),
        ("frame_id", "a\nb", "is not a name"),
        ("frame_id", "x" * 300, "is not a name"),
        (
            "terms.twist",
            "frennet",
            "'frennet' is unknown; give one of auto, off, bishop, quasistatic, frenet",
        ),
        ("terms.twist", "frennet", "did you mean frenet?"),
        ("gravity", -9.81, "-9.81 is not a list; give a list of 3 values"),
        ("gravity", "down", "'down' is not a list"),
        ("gravity", [0.0, -9.81], "has 2 elements; give 3, like [0.0, 0.0, -9.81]"),
        ("gravity", [0.0, 0.0, math.nan], "gravity[2]: nan is not finite"),
        ("gravity", [0.0, "x", 0.0], "gravity[1]: 'x' is not a number; give a number in m/s^2"),
        ("start.fixed", [True, True, 1], "start.fixed[2]: 1 is not a boolean"),
        ("start.spring", [-1.0, 0.0, 0.0], "start.spring[0]: -1.0 is out of range; give 0 to"),
        ("loads.names", ["a", "a"], "'a' is there twice"),
        ("loads.names", ["a.b"], "'a.b' is not a name"),
        ("loads.names", ["names"], "'names' is not a name"),
        ("loads.names", [3], "loads.names[0]: 3 is not a text"),
        ("cable.rest_curvature", [], "[] is empty; give [0.0]"),
        ("integrator.step", 1e-10, "1e-10 s is below 1e-09 s, the resolution of stamps; give 0"),
        ("integrator.step", 1e-300, "1e-300 s is below 1e-09 s"),
        ("frame_id", list(range(100_000)), "...] is not a text"),
        ("cable.lenght", 1.0, "1.0 is for no known key; did you mean cable.length?"),
        ("cable", 1.0, "1.0 stands for a group of keys; give cable.length"),
        ("gravity.x", 1.0, "1.0 is for no known key; did you mean gravity?"),
        ("zzz", 1.0, "1.0 is for no known key"),
        ("loads.tip.force", 1.0, "1.0 belongs to a name that is not in loads.names; add 'tip' to"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_its_key(key, value, complaint):
    message = refusal({key: value})
    assert message.startswith(key)
    assert complaint in message and len(message) < 300


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"end.clamped": True}, "end.clamped: true needs end.fixed: [true, true, true]"),
        ({"start.clamped": True, "start.fixed": [True, False, True]}, "start.clamped: true needs"),
        ({"start.spring": [0, 5, 0]}, "start.spring[1]: 5.0 N/m would do nothing"),
        ({"end.pose_topic": "/pose"}, "end.pose_topic: '/pose' would move nothing"),
        ({"end.tf_frame": "tool0"}, "end.tf_frame: 'tool0' would move nothing"),
        ({"start.tf_frame": "world"}, "start.tf_frame: 'world' is the world frame, frame_id"),
        ({"start.tf_frame": "/tool0"}, "start.tf_frame: '/tool0' is no frame of tf2; give tool0"),
        (
            {"start.tf_frame": "tool0", "start.pose_topic": "/pose"},
            "start.tf_frame: 'tool0' gives the pose; remove start.pose_topic",
        ),
        (
            {"start.tf_frame": "tool0", "start.pose_type": "two_points"},
            "start.tf_frame: 'tool0' gives the pose; remove start.pose_topic and start.pose_type",
        ),
        ({"start.pose_topic": "a b"}, "start.pose_topic: 'a b' is not a topic name"),
        ({"end.position": [0, 0, 0]}, "end.position: [0.0, 0.0, 0.0] equals start.position"),
        (
            {**HELD, "end.position": [0, 0, 0], "initial.shape": "straight"},
            "equals start.position",
        ),
        (
            {**HELD, "end.position": [0, 0, 0], "end.clamped": True},
            "end.tangent: [0.0, 0.0, 0.0] gives no direction",
        ),
        ({**HELD, "end.position": [3, 0, 0]}, "is 3 m from start.position, but the cable is only"),
        (
            {"cable.linear_density": 1e-300},
            "next to no mass; give 1e-15 kg/m or more, or 0",
        ),
        ({"cable.rest_curvature_axis": [0, 0, 0]}, "is not a unit vector; give [0.0, 1.0, 0.0]"),
        ({"cable.rest_curvature_axis": [0.6, 0, 0]}, "give [1.0, 0.0, 0.0]"),
        ({"discretization.samples": 11}, "discretization.samples: 11 points per knot span"),
        ({"discretization.samples": 1}, "discretization.samples: 1 points per knot span"),
        (
            {"discretization.quadrature": "uniform"},
            "discretization.samples: 3 samples are too few",
        ),
        ({"outputs.color_range": [2.0, 1.0]}, "[2.0, 1.0] falls; give [1.0, 2.0]"),
        (
            {"outputs.color_by": "tension", "terms.stretch": "off"},
            "outputs.color_by: 'tension' is not known of a cable that does not stretch; give curv",
        ),
        (
            {"outputs.color_by": "tension", "plasticity.yield_curvature": 1.0},
            "is not known of a cable that is bent at rest or plastic",
        ),
        ({"inputs.catch_up": 0.004}, "is shorter than one timer period (0.005 s at rate 200 Hz)"),
        ({"start.frame": "world"}, "start.frame: 'world' is also frame_id"),
        ({"start.frame": "tcp", "end.frame": "tcp"}, "end.frame: 'tcp' is also start.frame"),
        ({**TIP, "loads.tip.force": [0, 0, 1]}, "loads.tip.force: [0.0, 0.0, 1.0] would be ign"),
        ({**TIP, "loads.tip.torque": [0, 0, 1]}, "loads.tip.torque"),
        (
            {**TIP, "loads.tip.signal": "sine", "loads.tip.topic": "/w"},
            "loads.tip.topic: '/w' cannot be used with loads.tip.signal sine",
        ),
        (
            {
                **TIP,
                "loads.tip.signal": "sine",
                "loads.tip.type": "force",
                "loads.tip.torque": [1, 0, 0],
            },
            "loads.tip.torque: [1.0, 0.0, 0.0] would be ignored; set loads.tip.type to wrench",
        ),
        ({**TIP, "loads.tip.forse": 1}, "did you mean loads.tip.force?"),
        ({**TIP, "loads.tip.sign": 0.5}, "loads.tip.sign: 0.5 is not possible; give one of 1.0"),
        (
            {**TIP, "loads.tip.topic": "/x", "start.pose_topic": "/x"},
            "loads.tip.topic: '/x' is read as wrench here and as pose by start.pose_topic",
        ),
    ],
)
def test_values_that_contradict_each_other_are_refused(values, complaint):
    assert complaint in refusal(values)


@pytest.mark.parametrize(
    "values",
    [
        {**HELD, "end.position": [0, 0, 0]},  # a loop: both ends in one place
        {"start.fixed": [False] * 3},  # free flight
        {**HELD, "end.position": [3, 0, 0], "end.pose_topic": "/pose"},  # the pose decides
        {**HELD, "start.pose_topic": "/pose", "end.pose_topic": "/pose"},  # one gripper, two ends
        {"inputs.catch_up": 0.005},
        UNIFORM,
        {"discretization.knots": "uniform"},
        {
            "start.position": [0, 0, 0.0],
            "start.fixed": [False, True, True],
            "start.spring": [9, 0, 0],
        },
    ],
)
def test_what_is_unusual_but_possible_is_taken(values):
    scene_from_values(values)


def test_integers_become_floats_where_a_double_is_meant():
    scene = scene_from_values({"cable.length": 2, "gravity": [0, 0, -9]})
    assert type(scene.cable.length) is float
    assert all(type(g) is float for g in scene.gravity)


def test_arrays_of_numpy_are_lists():
    scene = scene_from_values({"gravity": np.array([0.0, 0.0, -1.5]), "rate": np.float64(50.0)})
    assert scene.gravity == (0.0, 0.0, -1.5)
    assert type(scene.rate) is float and scene.rate == 50.0


@pytest.mark.parametrize("term", ["gravity", "twist"])
def test_unquoted_on_and_off_of_yaml_1_1_mean_themselves(term):
    assert getattr(scene_from_values({f"terms.{term}": False}).terms, term) == "off"
    assert scene_from_values({"terms.gravity": True}).terms.gravity == "on"


@pytest.mark.parametrize(
    ("key", "value", "said", "changed"),
    [
        ("integrator.zhai_psi", 0.6, "0.6 is ignored; remove it: zhai has", {}),
        ("integrator.zhai_phi", [1], "[1] is ignored", {}),
        ("discretization.mass", "selective", "selective is ignored", {}),
        ("terms.twist", "on", "on means quasistatic", {"terms.twist": "quasistatic"}),
        ("terms.twist", True, "on means quasistatic", {"terms.twist": "quasistatic"}),
        ("contact.self", "on", "on is now contact.self_contact", {"contact.self_contact": "on"}),
        ("contact.self", False, "off is now contact", {"contact.self_contact": "off"}),
    ],
)
def test_what_scenes_once_had_is_read_with_one_line(key, value, said, changed):
    with pytest.warns(UserWarning) as caught:
        scene = scene_from_values({key: value})
    assert [str(one.message)[: len(key) + 2 + len(said)] for one in caught] == [f"{key}: {said}"]
    with pytest.warns(UserWarning):
        later = scene_from_values({}).with_values({key: value})
    assert scene == later == scene_from_values(changed)
