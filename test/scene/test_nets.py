"""Nets of cables: what a scene says of them, cable by cable, and what is refused."""

import math
from typing import Any

import pytest

from dlo_sim.scene.description import parameters_of_scene
from dlo_sim.scene.loading import SceneError, load_scene, scene_from_values, scene_values
from dlo_sim.scene.needs import check_terms, mirrors, needs_of
from dlo_sim.scene.nets import Joint
from dlo_sim.scene.terms import EXPLICIT, restrictions_of
from dlo_sim.tuning.scene_file import scene_text

FREE = [False, False, False]
HELD = [True, True, True]
PLUG = {
    "connectors.names": ["plug"],
    "connectors.plug.mass": 0.1,
    "connectors.plug.inertia": [1e-5, 2e-5, 2e-5],
}
A = {"branches.names": ["a"]}
C = {
    "cables.names": ["c"],
    "cables.c.start.position": [0, 1, 0],
    "cables.c.end.position": [1, 1, 0],
}
HARNESS: dict[str, Any] = {
    "cable.length": 2.0,
    "cable.diameter": 0.008,
    "cable.youngs_modulus": 3e7,
    "discretization.control_points": 20,
    "branches.names": ["b", "far", "a"],  # b begins at a
    "branches.a.at": 0.25,
    "branches.a.direction": [0.0, 0.0, -1.0],
    "branches.a.cable.length": 0.5,
    "branches.a.cable.youngs_modulus": 2e7,
    "branches.a.discretization.control_points": 7,
    "branches.a.end.position": [1.0, 0.0, -0.3],
    "branches.a.end.fixed": HELD,
    "branches.a.end.clamped": True,
    "branches.b.from": "a",
    "branches.b.joint": "elastic",
    "branches.b.joint_stiffness": 0.3,
    "branches.b.cable.diameter": 0.004,
    "branches.far.from": "c",
    "branches.far.joint": "hinged",
    **C,
    "cables.c.end.joined": "b",
    "cables.c.end.joined_at": 1.0,
    **PLUG,
    "connectors.plug.on": "b",
    "grasps.names": ["hand", "other"],
    "grasps.hand.on": "a",
    "grasps.hand.at": 0.6,
    "loads.names": ["tip"],
    "loads.tip.on": "b",
}


@pytest.fixture(scope="module")
def harness():
    return scene_from_values(HARNESS)


def refused(values: dict) -> str:
    """The one line with which these values are refused, at the latest for their terms."""
    with pytest.raises(SceneError) as caught:
        scene = scene_from_values(values)
        check_terms(scene, needs_of(scene))
    message = str(caught.value)
    assert "\n" not in message
    return message


# -- single cables --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["two_grippers", "hanging_cable", "edge"])
def test_a_single_cable_is_no_net_and_its_own_only_strand(name):
    scene = load_scene(name)
    (strand,) = scene.strands
    assert not scene.is_net and scene.joints == () and not scene.passes_roll
    assert strand.name == "cable" and strand.scene is scene and scene.materials == (scene.cable,)
    grasps = {one.name: one for one in scene.grasps}
    assert scene.holders == {"start": scene.start, "end": scene.end, **grasps}


@pytest.mark.parametrize(
    "values", [A, C, PLUG, {"end.joined": "cable"}, {"start.joined": "cable", "start.fixed": FREE}]
)
def test_what_makes_a_net(values):
    joined = {"start.joined_at": 1.0} if "start.joined" in values else {}
    assert scene_from_values({**values, **joined}).is_net


# -- values ---------------------------------------------------------------------------------------


def test_what_a_branch_does_not_give_is_of_what_it_begins_at(harness):
    a, b, c = (next(s for s in harness.strands if s.name == name).scene for name in "abc")
    assert (a.cable.length, a.cable.diameter, a.cable.youngs_modulus) == (0.5, 0.008, 2e7)
    assert (b.cable.length, b.cable.diameter, b.cable.youngs_modulus) == (0.5, 0.004, 2e7)
    assert c.cable == harness.cable
    counts = [one.scene.discretization.control_points for one in harness.strands]
    assert counts == [20, 7, 0, 0, 0]


def test_values_are_those_that_result_and_give_the_same_scene(harness):
    values = scene_values(harness)
    assert values["branches.b.cable.youngs_modulus"] == 2e7
    assert scene_from_values(values) == harness
    changed = harness.with_values({"branches.b.cable.diameter": 0.002})
    assert changed.branches[0].cable.diameter == 0.002
    assert changed.with_values({"branches.b.cable.diameter": 0.004}) == harness


def test_a_written_scene_is_the_same_when_read_back(harness, tmp_path):
    """Also where a branch has a default of `cable` in a net whose main cable has another."""
    scene = harness.with_values({"branches.b.cable.diameter": 0.005})
    path = tmp_path / "net.yaml"
    path.write_text(scene_text(scene, []))
    assert load_scene(path) == scene
    assert "youngs_modulus: 2.0e+7" in path.read_text().replace("20000000.0", "2.0e+7")
    rows = {row.key: row.default for row in parameters_of_scene(scene)}
    assert rows["branches.b.cable.diameter"] == 0.008
    assert rows["cables.c.cable.length"] == 2.0


def test_overrides_come_before_inheritance():
    nested = {"branches": {"names": ["a"], "a": {"cable": {"length": 0.3}}}}
    scene = load_scene(nested, {"cable.youngs_modulus": 4e7})
    cable = scene.branches[0].cable
    assert (cable.length, cable.youngs_modulus) == (0.3, 4e7)
    assert not load_scene(nested, {"branches.names": []}).branches


def test_an_assumption_is_said_once_by_the_key_of_its_cable():
    stiff = {"cable.bending_stiffness": 1e-3, "cable.axial_stiffness": 1e4}
    scene = scene_from_values({**A, **stiff})
    (line,) = scene.assumptions
    assert line.startswith("cable.torsional_stiffness: not given")
    scene = scene.with_values({"branches.a.cable.bending_stiffness": 2e-3})
    assert [one.partition(":")[0] for one in scene.assumptions] == [
        "cable.torsional_stiffness",
        "branches.a.cable.torsional_stiffness",
    ]


def test_the_bore_of_a_hose_is_that_of_all():
    scene = scene_from_values({**A, "hose.bore": 0.003})
    assert [cable.bore for cable in scene.materials] == [0.003, 0.003]
    thin = {**A, "hose.bore": 0.003, "branches.a.cable.diameter": 0.002}
    assert "hose.bore: 0.003 m is too wide" in refused(thin)


# -- cable by cable -------------------------------------------------------------------------------


def test_strands_come_after_what_they_begin_at(harness):
    assert [one.name for one in harness.strands] == ["cable", "a", "b", "c", "far"]
    assert [one.parent for one in harness.strands] == ["", "cable", "a", "", "c"]
    assert [one.key for one in harness.strands] == [
        "",
        "branches.a",
        "branches.b",
        "cables.c",
        "branches.far",
    ]
    assert harness.strands[2].key_of("cable") == "branches.b.cable"
    assert (harness.strands[2].joint, harness.strands[2].joint_stiffness) == ("elastic", 0.3)


def test_the_scene_of_a_strand_is_one_of_a_single_cable(harness):
    for strand in harness.strands:
        own = strand.scene
        assert not own.is_net
        assert scene_from_values(scene_values(own)).holders == own.holders, "it is possible alone"
        assert (own.gravity, own.terms, own.contact) == (
            harness.gravity,
            harness.terms,
            harness.contact,
        )
    names = [[one.name for one in strand.scene.grasps] for strand in harness.strands]
    assert names == [["other"], ["hand"], [], [], []]
    assert [len(strand.scene.loads) for strand in harness.strands] == [0, 0, 1, 0, 0]


def test_straight_cables_are_laid_out_from_the_main_start(harness):
    """Free ends are where they are when all cables are straight, others where they are held."""
    places = {one.name: (one.scene.start, one.scene.end) for one in harness.strands}
    assert places["a"][0].position == (0.5, 0.0, 0.0)  # a quarter of 2 m along x
    assert places["a"][1] == harness.branches[2].end
    assert places["b"][0].position == pytest.approx((0.5, 0.0, -0.25))
    assert places["b"][1].position == pytest.approx((0.5, 0.0, -0.75))  # goes on along a
    assert places["far"][0].position == pytest.approx((1.0, 1.0, 0.0))
    for name in ("a", "b", "far"):
        assert not places[name][0].held


def test_holders_follow_the_strands_and_have_keys(harness):
    assert list(harness.holders) == [
        *("start", "end", "other"),
        *("a.start", "a.end", "hand", "b.start", "b.end"),
        *("c.start", "c.end", "far.start", "far.end"),
    ]
    keys = dict(harness.holder_keys())
    assert list(keys) == [
        *("start", "end", "grasps.other", "branches.a.end", "grasps.hand", "branches.b.end"),
        *("cables.c.start", "cables.c.end", "branches.far.end"),
    ]
    assert keys["branches.a.end"] is harness.holders["a.end"] is harness.branches[2].end
    assert list(harness.ends) == ["start", "end"]
    assert harness.strands[1].holder("end") == "a.end" and harness.strands[0].holder("end") == "end"


def test_joints_of_branches_then_of_joined_ends(harness):
    assert harness.joints == (
        Joint("branches.a", "a", 0.0, "cable", 0.25, "rigid", 0.0, False),
        Joint("branches.b", "b", 0.0, "a", 0.5, "elastic", 0.3, False),
        Joint("branches.far", "far", 0.0, "c", 0.5, "hinged", 0.0, False),
        Joint("cables.c.end", "c", 1.0, "b", 1.0, "rigid", 0.0, True),
    )


def test_what_moves_or_turns_on_any_strand_counts():
    driven = {**A, "branches.a.end.fixed": HELD, "branches.a.end.position": [0.5, 0, 0.5]}
    scene = scene_from_values({**driven, "branches.a.end.tf_frame": "tool0"})
    assert scene.is_driven and list(scene.moved) == ["a.end"] and not scene.may_twist
    assert scene.followed_frames == {"branches.a.end.tf_frame": "tool0"}
    turned = {"branches.a.end.tf_frame": "tool0", "branches.a.end.clamped": True}
    assert scene_from_values({**driven, **turned}).may_twist
    assert scene_from_values({**A, "branches.a.cable.rest_curvature": [1.0]}).shaped


# -- terms ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "model"),
    [
        (A, "bishop"),
        ({**A, "branches.a.joint": "hinged"}, ""),
        ({**A, "branches.a.joint": "hinged", "start.clamped": True}, ""),
        (
            {
                **A,
                "branches.a.joint": "hinged",
                "start.clamped": True,
                "branches.a.end.fixed": HELD,
                "branches.a.end.position": [1, 0, 0.5],
                "branches.a.end.clamped": True,
            },
            "quasistatic",
        ),
        ({**A, "branches.a.joint": "elastic", "branches.a.joint_stiffness": 1.0}, "bishop"),
        ({**A, "branches.a.joint": "hinged", "terms.twist": "off"}, ""),
        ({**A, "start.clamped": True, "end.fixed": HELD, "end.clamped": True}, "bishop"),
        ({**C, "end.fixed": HELD}, ""),  # it would hang taut in a plane if it were alone
        (PLUG, "bishop"),
        ({"end.joined": "cable"}, "bishop"),
        ({"end.joined": "cable", "end.joint": "hinged"}, ""),
    ],
)
def test_a_net_is_in_space_with_twist_where_joints_carry_it_on(values, model):
    scene = scene_from_values(values)
    needs = needs_of(scene)
    check_terms(scene, needs)
    assert needs.axes == (0, 1, 2)
    assert ("twist" in needs) == bool(model)
    assert ("bishop" in needs) == bool(model) and ("quasistatic" in needs) == (
        model == "quasistatic"
    )


@pytest.mark.parametrize("values", [A, C, PLUG, {"end.joined": "cable"}])
def test_explicit_methods_do_not_know_nets(values):
    asked = [one for one in restrictions_of(scene_from_values(values)) if "names" in one.key]
    asked += [one for one in restrictions_of(scene_from_values(values)) if one.key == "joined"]
    assert len(asked) == 1 and not set(EXPLICIT) & set(asked[0].methods)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({**A, "branches.a.direction": [0.0, 0.0, -1.0]}, [0.0, 1.0, 0.0]),
        ({**A, "branches.a.direction": [0.0, 1.0, 0.0]}, [0.0, 0.0, 0.0]),
        (
            {
                **A,
                "branches.a.direction": [0.0, 1.0, 0.0],
                "branches.a.end.position": [1.0, 0.0, 0.1],
                "branches.a.end.fixed": HELD,
            },
            [0.0, 0.0, 0.0],
        ),
        (C, [0.0, 0.0, 0.0]),
        ({**PLUG, "connectors.plug.center": [0.0, 0.01, 0.0]}, [0.0, 0.0, 0.0]),
    ],
)
def test_planes_in_which_all_cables_lie(values, expected):
    assert mirrors(scene_from_values(values)) == expected


# -- bad input ------------------------------------------------------------------------------------

JAW = {
    **A,
    "start.clamped": True,
    "start.jaw": 0.1,
    "branches.a.at": 0.05,
    "branches.a.cable.length": 0.5,
}
ELASTIC = {**A, "branches.a.joint": "elastic"}
LOOP = {**A, "branches.a.end.joined": "cable", "branches.a.end.joined_at": 0.9}
HAND = {"grasps.names": ["hand"]}


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({**A, "branches.a.from": "x"}, "branches.a.from: 'x' is no cable here; give one of cable"),
        ({**A, "branches.a.from": "a"}, "branches.a.from: 'a' is the branch itself; give cable"),
        ({**A, "branches.a.at": 1.2}, "branches.a.at: 1.2 is out of range; give 0 to 1"),
        (
            {"branches.names": ["a", "b", "c"], "branches.b.from": "c", "branches.c.from": "b"},
            "branches.b.from: 'c' makes a circle (b from c from b); let one of them begin at cable",
        ),
        (
            {"branches.names": ["a", "b"], "branches.a.from": "b", "branches.b.from": "b"},
            "branches.b.from: 'b' is the branch itself",
        ),
        ({"branches.names": ["a", "a"]}, "branches.names: 'a' is there twice"),
        ({"branches.names": ["cable"]}, "branches.names: 'cable' is not a name"),
        ({**A, "cables.names": ["a"]}, "cables.names: 'a' is a name in branches.names too; ren"),
        (
            {**A, "grasps.names": ["a"]},
            "branches.names: 'a' is a name in grasps.names too; rename one",
        ),
        (
            {**PLUG, "obstacles.names": ["plug"]},
            "connectors.names: 'plug' is a name in obstacles.names too",
        ),
        ({"branches.a.cable.length": 1}, "branches.a.cable.length: 1 belongs to a name that is"),
        ({**A, "branches.a.cable.lenght": 1}, "did you mean branches.a.cable.length?"),
        ({**A, "branches.a.direction": [0, 0, 2]}, "branches.a.direction[2]: 2 is out of range"),
        (
            {**A, "branches.a.direction": [0, 0, -0.5]},
            "branches.a.direction: [0.0, 0.0, -0.5] is not a unit vector; give [0.0, 0.0, -1.0]",
        ),
        (ELASTIC, "branches.a.joint_stiffness: 0.0 N m/rad is none for an elastic joint; give"),
        (
            {**A, "branches.a.joint_stiffness": 1.0},
            "branches.a.joint_stiffness: 1.0 N m/rad does nothing in a joint that is rigid; set",
        ),
        (
            {**A, "branches.a.cable.linear_density": 1e-300},
            "branches.a.cable.linear_density: 1e-300 is next to no mass",
        ),
        (
            {**A, "branches.a.discretization.control_points": 3},
            "branches.a.discretization.control_points: 3 are too few for a cubic; give 4 or more",
        ),
        (
            {
                **A,
                "discretization.stretch": "span",
                "branches.a.discretization.control_points": 4,
            },
            "branches.a.discretization.control_points: 4 do not go with discretization.stretch, of",
        ),
        ({**A, "branches.a.end.clamped": True}, "branches.a.end.clamped: true needs branches.a.en"),
        (
            {**C, "cables.c.start.jaw": 3.0, "cables.c.start.clamped": True},
            "cables.c.start.jaw: 3.0 m is longer than the cable, 1 m",
        ),
        (
            {**C, "cables.c.end.position": [0, 1, 0]},
            "cables.c.end.position: [0.0, 1.0, 0.0] equals cables.c.start.position",
        ),
        # joints in clamps and jaws
        (JAW, "branches.a.at: 0.05 is 0.05 m from start, whose jaw of 0.1 m holds the direction"),
        (
            {**A, "start.clamped": True, "branches.a.at": 0.0},
            "branches.a.at: 0.0 is 0 m from start, whose clamp holds the direction there",
        ),
        (
            {**A, **HAND, "grasps.hand.clamped": True},
            "branches.a.at: 0.5 is 0 m from grasps.hand, whose clamp",
        ),
        (
            {
                **A,
                **HAND,
                "grasps.hand.on": "a",
                "grasps.hand.at": 0.0,
                "grasps.hand.clamped": True,
            },
            "grasps.hand.at: 0.0 is 0 m from the joint of branches.a, inside a clamp; move one",
        ),
        (
            {**LOOP, "start.clamped": True, "branches.a.end.joined_at": 0.0},
            "branches.a.end.joined_at: 0.0 is 0 m from start, whose clamp holds",
        ),
        # ends that are joined
        ({"end.joined": "x"}, "end.joined: 'x' is no cable here; give one of cable"),
        ({"end.joined": "cable", "end.joined_at": -1}, "end.joined_at: -1 is out of range; give"),
        (
            {"end.joined": "cable", "end.joined_at": 1.0},
            "end.joined_at: 1.0 is this end itself; give another place, 0 for a ring",
        ),
        (
            {"end.joined": "cable", "end.fixed": HELD},
            "end.fixed: [true, true, true] is not possible, since end.joined is cable; set it to",
        ),
        ({**LOOP, "branches.a.end.spring": [0, 0, 1]}, "branches.a.end.spring: [0.0, 0.0, 1.0] is"),
        (
            {"end.joined": "cable", "end.pose_topic": "/pose"},
            "end.pose_topic: '/pose' would move nothing",
        ),
        ({"end.joined_at": 0.5}, "end.joined_at: 0.5 does nothing; name a cable in end.joined"),
        ({"end.joint": "hinged"}, "end.joint: 'hinged' does nothing; name a cable in end.joined"),
        ({"end.joined": "cable", "end.joint": "elastic"}, "end.joint_stiffness: 0.0 N m/rad is no"),
        (
            {
                **C,
                "end.joined": "c",
                "end.joined_at": 1.0,
                "cables.c.end.joined": "cable",
                "cables.c.end.joined_at": 1.0,
            },
            "cables.c.end.joined: 'cable' is the joint of end again; remove one of them",
        ),
        # loops that do not meet
        (
            {**C, "end.joined": "c", "cables.c.start.position": [0, 9, 0]},
            "end.joined: 'c' closes no loop: cables.c.start.position is 9 m from start.position, "
            "but only 1 m of cable lie between; move them together, or lengthen the cables",
        ),
        (
            {
                **LOOP,
                "end.fixed": HELD,
                "branches.a.at": 0.2,
                "branches.a.cable.length": 0.1,
            },
            "branches.a.end.joined: 'cable' closes no loop: end.position is 1 m from start.position"
            ", but only 0.4 m of cable lie between",
        ),
        (
            {**A, "branches.a.end.position": [0, 0, 5], "branches.a.end.fixed": HELD},
            "branches.a.end.position: [0.0, 0.0, 5.0] is 5 m from start.position, but only 1.5 m",
        ),
        # connectors
        (
            {"connectors.names": ["plug"]},
            "connectors.plug.mass: 0.0 kg is no mass; give that of the connector",
        ),
        (
            {**PLUG, "connectors.plug.inertia": [0.0, 0.0, 0.0]},
            "connectors.plug.inertia: [0.0, 0.0, 0.0] kg m^2 leaves an axis without inertia",
        ),
        (
            {**PLUG, "connectors.plug.inertia": [1.0, 1.0, 3.0]},
            "kg m^2 is of no body, since 3 exceeds the sum of the other two; give each at most",
        ),
        ({**PLUG, "connectors.plug.on": "x"}, "connectors.plug.on: 'x' is no cable here"),
        (
            {**PLUG, "connectors.plug.shape": "box", "connectors.plug.size": [1, 0, 1]},
            "connectors.plug.size: [1.0, 0.0, 1.0] has a zero that a box needs",
        ),
        ({**PLUG, "connectors.plug.size": [1, 0, 1]}, "m does nothing without a shape; give"),
        ({**PLUG, "connectors.plug.frame": "world"}, "is the world frame, frame_id; give a frame"),
        (
            {**PLUG, "connectors.plug.frame": "tcp", "start.frame": "tcp"},
            "connectors.plug.frame: 'tcp' is also start.frame",
        ),
        (
            {
                "connectors.names": ["p", "q"],
                **{f"connectors.{one}.mass": 1.0 for one in "pq"},
                **{f"connectors.{one}.inertia": [1.0, 1.0, 1.0] for one in "pq"},
            },
            "connectors.q.at: 1.0 is where connectors.p is; give another place, or one body",
        ),
        ({**HAND, "grasps.hand.on": "x"}, "grasps.hand.on: 'x' is no cable here; give one of cabl"),
        ({"loads.names": ["tip"], "loads.tip.on": "x"}, "loads.tip.on: 'x' is no cable here"),
        # what nets do not support
        ({**A, "terms.stretch": "off"}, "terms.stretch: 'off' is not available for a net"),
        ({**A, "terms.out_of_plane": "off"}, "terms.out_of_plane: 'off' is not available"),
        ({**A, "terms.twist": "off"}, "terms.twist: 'off' takes no roll from one cable to another"),
        ({**A, "terms.twist": "frenet"}, "terms.twist: 'frenet' takes no roll from one cable to"),
        ({**PLUG, "terms.twist": "off"}, "terms.twist: 'off' takes no roll from one cable to"),
        ({**A, "terms.bend": "off"}, "terms.bend: 'off' takes no roll"),
        (
            {**A, "plasticity.yield_curvature": 1.0},
            "plasticity.yield_curvature: 1.0 is not available for a net of cables; set it to 0",
        ),
        (
            {**A, "hose.pressure": 1e5, "hose.bore": 0.002},
            "hose.pressure: 100000.0 Pa is not available for a net of cables; set it to 0",
        ),
        (
            {**A, **HAND, "grasps.hand.slides": True, "grasps.hand.at": 0.2},
            "grasps.hand.slides: true is not available for a net of cables; set it to false",
        ),
    ],
)
def test_what_is_no_net_is_refused_in_one_line(values, complaint):
    message = refused(values)
    assert complaint in message and len(message) < 300


@pytest.mark.parametrize(
    "values",
    [
        {**JAW, "branches.a.at": 0.1},  # at the edge of the jaw
        {**JAW, "branches.a.joint": "hinged"},
        {**A, **HAND, "grasps.hand.at": 0.4, "grasps.hand.clamped": True, "grasps.hand.jaw": 0.15},
        {**A, **HAND, "grasps.hand.at": -1.0, "grasps.hand.clamped": True},
        {"end.joined": "cable"},  # a ring that the start holds
        {"end.joined": "cable", "start.fixed": FREE, "end.joint": "hinged"},
        {**C, "end.joined": "c", "cables.c.start.position": [0, 1.9, 0]},  # stretched, but it meets
        {**LOOP, "branches.a.cable.length": 0.4},
        {**PLUG, "end.fixed": HELD, "end.clamped": True},  # a gripper holds the plug
        {**PLUG, "connectors.plug.inertia": [1.0, 1.0, 2.0]},  # a plate
        {**PLUG, "connectors.plug.shape": "sphere", "connectors.plug.size": [0.1, 0, 0]},
        {**A, "branches.a.direction": [math.sqrt(0.5), 0.0, -math.sqrt(0.5)]},
    ],
)
def test_what_is_unusual_but_possible_is_taken(values):
    scene = scene_from_values(values)
    check_terms(scene, needs_of(scene))
