"""Nets of cables: what a scene says of them, cable by cable, and what is refused."""

from typing import Any

import pytest

from dlo_sim.scene.description import parameters_of_scene
from dlo_sim.scene.loading import SceneError, load_scene, scene_from_values, scene_values
from dlo_sim.scene.needs import check_terms, mirrors, needs_of
from dlo_sim.scene.nets import Joint
from dlo_sim.scene.plain_yaml import parse_yaml
from dlo_sim.scene.terms import EXPLICIT, restrictions_of
from dlo_sim.tuning.scene_file import scene_text

# Names in `net`: their groups, and values that they have there by default.
BLOCKS: dict[str, tuple[str, dict[str, Any]]] = {
    **dict.fromkeys(("a", "b", "far"), ("branches", {})),
    "c": ("cables", {"start.position": [0, 1, 0], "end.position": [1, 1, 0]}),
    **dict.fromkeys(("plug", "q"), ("connectors", {"mass": 0.1, "inertia": [1e-5, 2e-5, 2e-5]})),
    **dict.fromkeys(("hand", "other"), ("grasps", {})),
    "tip": ("loads", {}),
}
TRUE, FALSE = "[true, true, true]", "[false, false, false]"


def net(text: str) -> dict[str, Any]:
    """The values of a scene in a short form: `a.at: 0.2` is `branches.a.at`; `a` only names it."""
    values: dict[str, Any] = {}
    short = parse_yaml(f"{{{text}}}")
    for name in dict.fromkeys(key.partition(".")[0] for key in short):
        if name in BLOCKS:
            group, default = BLOCKS[name]
            values[f"{group}.names"] = [*values.get(f"{group}.names", []), name]
            values |= {f"{group}.{name}.{key}": value for key, value in default.items()}
    for key, value in short.items():
        name = key.partition(".")[0]
        if key != name or name not in BLOCKS:
            values[f"{BLOCKS[name][0]}.{key}" if name in BLOCKS else key] = value
    return values


HARNESS = net(  # b begins at a
    f"""
    cable.length: 2.0, cable.diameter: 0.008, cable.youngs_modulus: 3e7,
    discretization.control_points: 20,
    b.from: a, b.joint: elastic, b.joint_stiffness: 0.3, b.cable.diameter: 0.004,
    far.from: c, far.joint: hinged,
    a.at: 0.25, a.direction: [0.0, 0.0, -1.0], a.cable.length: 0.5, a.cable.youngs_modulus: 2e7,
    a.discretization.control_points: 7,
    a.end.position: [1.0, 0.0, -0.3], a.end.fixed: {TRUE}, a.end.clamped: true,
    c.end.joined: b, c.end.joined_at: 1.0, plug.on: b, hand.on: a, hand.at: 0.6, other, tip.on: b
    """
)


@pytest.fixture(scope="module")
def harness():
    return scene_from_values(HARNESS)


def checked(text: str):
    """The scene of a short form, if nothing refuses it, and its terms."""
    scene = scene_from_values(net(text))
    needs = needs_of(scene)
    check_terms(scene, needs)
    return scene, needs


# -- values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["two_grippers", "hanging_cable", "edge"])
def test_a_single_cable_is_no_net_and_its_own_only_strand(name):
    scene = load_scene(name)
    (strand,) = scene.strands
    assert not scene.is_net and scene.joints == () and not scene.passes_roll
    assert strand.name == "cable" and strand.scene is scene and scene.materials == (scene.cable,)
    grasps = {one.name: one for one in scene.grasps}
    assert scene.holders == {"start": scene.start, "end": scene.end, **grasps}


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("a", "branches.names"),
        ("c", "cables.names"),
        ("plug", "connectors.names"),
        ("end.joined: cable", "joined"),
        (f"start.joined: cable, start.joined_at: 1, start.fixed: {FALSE}", "joined"),
    ],
)
def test_explicit_methods_do_not_know_what_makes_a_net(text, key):
    for method in ("auto", "rk4"):
        scene, _ = checked(f"{text}, integrator.method: {method}")
        assert scene.is_net
        asked = [one for one in restrictions_of(scene) if one.key == key]
        assert len(asked) == 1 and not set(EXPLICIT) & set(asked[0].methods)


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
    """Also where a branch has the diameter that the main cable has by default, but not here."""
    scene = harness.with_values({"branches.b.cable.diameter": 0.005})
    path = tmp_path / "net.yaml"
    path.write_text(scene_text(scene, []))
    assert load_scene(path) == scene
    rows = {row.key: row.default for row in parameters_of_scene(scene)}
    assert (rows["branches.b.cable.diameter"], rows["cables.c.cable.length"]) == (0.008, 2.0)


def test_overrides_come_before_inheritance():
    nested = {"branches": {"names": ["a"], "a": {"cable": {"length": 0.3}}}}
    scene = load_scene(nested, {"cable.youngs_modulus": 4e7})
    cable = scene.branches[0].cable
    assert (cable.length, cable.youngs_modulus) == (0.3, 4e7)
    assert not load_scene(nested, {"branches.names": []}).branches


def test_an_assumption_is_said_once_by_the_key_of_its_cable():
    scene, _ = checked("a, cable.bending_stiffness: 1e-3, cable.axial_stiffness: 1e4")
    (line,) = scene.assumptions
    assert line.startswith("cable.torsional_stiffness: not given")
    scene = scene.with_values({"branches.a.cable.bending_stiffness": 2e-3})
    assert [one.partition(":")[0] for one in scene.assumptions] == [
        "cable.torsional_stiffness",
        "branches.a.cable.torsional_stiffness",
    ]


# -- cable by cable -------------------------------------------------------------------------------


def test_strands_come_after_what_they_begin_at(harness):
    assert [(one.name, one.parent, one.key) for one in harness.strands] == [
        ("cable", "", ""),
        ("a", "cable", "branches.a"),
        ("b", "a", "branches.b"),
        ("c", "", "cables.c"),
        ("far", "c", "branches.far"),
    ]
    main, _, b, *_ = harness.strands
    assert (b.key_of("cable"), main.key_of("cable")) == ("branches.b.cable", "cable")
    assert (b.at, b.joint, b.joint_stiffness) == (0.5, "elastic", 0.3)
    assert (b.holder("end"), main.holder("end")) == ("b.end", "end")


def test_the_scene_of_a_strand_is_one_of_a_single_cable(harness):
    scenes = [strand.scene for strand in harness.strands]
    for own in scenes:
        assert not own.is_net
        assert scene_from_values(scene_values(own)).holders == own.holders, "it is possible alone"
        assert (own.gravity, own.terms) == (harness.gravity, harness.terms)
    names = [[one.name for one in own.grasps] for own in scenes]
    assert names == [["other"], ["hand"], [], [], []]
    assert [len(own.loads) for own in scenes] == [0, 0, 1, 0, 0]
    hose, _ = checked("a, hose.bore: 0.003")
    assert [cable.bore for cable in hose.materials] == [0.003, 0.003]


def test_straight_cables_are_laid_out_from_the_main_start(harness):
    """Free ends are where they are when all cables are straight, others where they are held."""
    places = {one.name: (one.scene.start, one.scene.end) for one in harness.strands}
    assert places["a"][0].position == (0.5, 0.0, 0.0)  # a quarter of 2 m along x
    assert places["a"][1] == harness.branches[2].end
    assert places["b"][0].position == pytest.approx((0.5, 0.0, -0.25))
    assert places["b"][1].position == pytest.approx((0.5, 0.0, -0.75))  # goes on along a
    assert places["far"][0].position == pytest.approx((1.0, 1.0, 0.0))
    assert not any(places[name][0].held for name in ("a", "b", "far"))


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


def test_joints_of_branches_then_of_joined_ends(harness):
    assert harness.joints == (
        Joint("branches.a", "a", 0.0, "cable", 0.25, "rigid", 0.0, False),
        Joint("branches.b", "b", 0.0, "a", 0.5, "elastic", 0.3, False),
        Joint("branches.far", "far", 0.0, "c", 0.5, "hinged", 0.0, False),
        Joint("cables.c.end", "c", 1.0, "b", 1.0, "rigid", 0.0, True),
    )


def test_what_moves_or_turns_on_any_strand_counts():
    driven = f"a.end.fixed: {TRUE}, a.end.position: [0.5, 0, 0.5], a.end.tf_frame: tool0"
    scene, _ = checked(driven)
    assert scene.is_driven and list(scene.moved) == ["a.end"] and not scene.may_twist
    assert scene.followed_frames == {"branches.a.end.tf_frame": "tool0"}
    assert checked(f"{driven}, a.end.clamped: true")[0].may_twist
    assert checked("a.cable.rest_curvature: [1.0]")[0].shaped


# -- terms ----------------------------------------------------------------------------------------

HINGED = "a.joint: hinged, start.clamped: true"
FAR_END = f"a.end.fixed: {TRUE}, a.end.position: [1, 0, 0.5]"


@pytest.mark.parametrize(
    ("text", "model"),
    [
        ("a", ""),  # goes on along its parent
        ("a.direction: [0, 1, 0]", "bishop"),
        (f"start.clamped: true, {FAR_END}, a.end.clamped: true", "quasistatic"),
        (HINGED, ""),
        (f"{HINGED}, {FAR_END}, a.end.clamped: true", "quasistatic"),
        ("a.joint: hinged, terms.twist: off", ""),
        ("a.joint: elastic, a.joint_stiffness: 1.0, a.direction: [0, 1, 0]", "bishop"),
        (f"c, end.fixed: {TRUE}", ""),  # it would hang taut in a plane if it were alone
        ("plug", "bishop"),
        ("plug.joint: hinged", ""),
        ("end.joined: cable", "bishop"),
        ("end.joined: cable, end.joint: hinged", ""),
    ],
)
def test_a_net_is_in_space_with_twist_where_joints_carry_it_on(text, model):
    _, needs = checked(text)
    assert needs.axes == (0, 1, 2)
    assert "twist" in needs if model else "twist" not in needs
    assert ("quasistatic" in needs) == (model == "quasistatic")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.direction: [0.0, 0.0, -1.0]", [0.0, 1.0, 0.0]),
        ("a.direction: [0.0, 1.0, 0.0]", [0.0, 0.0, 0.0]),
        (f"{FAR_END}, a.direction: [0.0, 1.0, 0.0]", [0.0, 0.0, 0.0]),
        ("c", [0.0, 0.0, 0.0]),
        ("plug.center: [0.0, 0.01, 0.0]", [0.0, 0.0, 0.0]),
    ],
)
def test_planes_in_which_all_cables_lie(text, expected):
    assert mirrors(checked(text)[0]) == expected


# -- bad input ------------------------------------------------------------------------------------

JAW = "start.clamped: true, start.jaw: 0.1, a.cable.length: 0.5"
LOOP = "a.end.joined: cable, a.end.joined_at: 0.9"
TWICE = "end.joined: c, end.joined_at: 1, c.end.joined: cable, c.end.joined_at: 1"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        # names
        ("a.from: x", "branches.a.from: 'x' is no cable here; give one of cable"),
        ("a.from: a", "branches.a.from: 'a' is the branch itself; give cable"),
        ("a.from: b, b.from: b", "branches.b.from: 'b' is the branch itself"),
        ("far, a.from: b, b.from: a", "branches.a.from: 'b' makes a circle (a from b from a); let"),
        ("branches.names: [a, a]", "branches.names: 'a' is there twice"),
        ("branches.names: [cable]", "branches.names: 'cable' is not a name"),
        ("a, cables.names: [a]", "cables.names: 'a' is a name in branches.names too; rename one"),
        ("a, grasps.names: [a]", "branches.names: 'a' is a name in grasps.names too; rename one"),
        ("plug, obstacles.names: [plug]", "connectors.names: 'plug' is a name in obstacles.names"),
        ("branches.a.cable.length: 1", "branches.a.cable.length: 1 belongs to a name that is not"),
        ("a.cable.lenght: 1", "did you mean branches.a.cable.length?"),
        ("plug.on: x", "connectors.plug.on: 'x' is no cable here; give one of cable"),
        ("hand.on: x", "grasps.hand.on: 'x' is no cable here"),
        ("tip.on: x", "loads.tip.on: 'x' is no cable here"),
        ("end.joined: x", "end.joined: 'x' is no cable here; give one of cable"),
        # values of a cable
        ("a.at: 1.2", "branches.a.at: 1.2 is out of range; give 0 to 1"),
        ("a.direction: [0, 0, 2]", "branches.a.direction[2]: 2 is out of range"),
        ("a.direction: [0, 0, -0.5]", "branches.a.direction: [0.0, 0.0, -0.5] is not a unit vecto"),
        ("a.joint: elastic", "branches.a.joint_stiffness: 0.0 N m/rad is none for an elastic join"),
        ("a.joint_stiffness: 1.0", "joint_stiffness: 1.0 N m/rad does nothing in a joint that is"),
        ("a.cable.linear_density: 1e-99", "branches.a.cable.linear_density: 1e-99 is next to no m"),
        ("a.discretization.control_points: 3", "branches.a.discretization.control_points: 3 are t"),
        (
            "discretization.stretch: span, a.discretization.control_points: 4",
            "branches.a.discretization.control_points: 4 do not go with discretization.stretch, of",
        ),
        ("a.end.clamped: true", "branches.a.end.clamped: true needs branches.a.end.fixed: [true"),
        ("c.start.jaw: 3, c.start.clamped: true", "cables.c.start.jaw: 3.0 m is longer than the c"),
        ("c.end.position: [0, 1, 0]", "[0.0, 1.0, 0.0] equals cables.c.start.position, so a strai"),
        ("hose.bore: 0.003, a.cable.diameter: 0.002", "hose.bore: 0.003 m is too wide"),
        # joints in clamps and jaws
        (f"{JAW}, a.at: 0.05", "branches.a.at: 0.05 is 0.05 m from start, whose jaw of 0.1 m hold"),
        ("start.clamped: true, a.at: 0", "branches.a.at: 0.0 is 0 m from start, whose clamp holds"),
        ("a, hand.clamped: true", "branches.a.at: 0.5 is 0 m from grasps.hand, whose clamp"),
        (
            "a, hand.on: a, hand.at: 0, hand.clamped: true",
            "grasps.hand.at: 0.0 is 0 m from the joint of branches.a, inside a clamp; move one",
        ),
        (
            "a.end.joined: cable, start.clamped: true",
            "branches.a.end.joined_at: 0.0 is 0 m from start, whose clamp holds",
        ),
        # ends that are joined
        ("end.joined: cable, end.joined_at: -1", "end.joined_at: -1 is out of range; give 0 to 1"),
        ("end.joined: cable, end.joined_at: 1", "end.joined_at: 1.0 is this end itself; give anot"),
        (f"end.joined: cable, end.fixed: {TRUE}", "end.fixed: [true, true, true] is not possible"),
        (f"{LOOP}, a.end.spring: [0, 0, 1]", "branches.a.end.spring: [0.0, 0.0, 1.0] is not poss"),
        ("end.joined: cable, end.pose_topic: /p", "end.pose_topic: '/p' would move nothing"),
        ("end.joined_at: 0.5", "end.joined_at: 0.5 does nothing; name a cable in end.joined, or"),
        ("end.joint: hinged", "end.joint: 'hinged' does nothing; name a cable in end.joined"),
        ("end.joined: cable, end.joint: elastic", "end.joint_stiffness: 0.0 N m/rad is none for"),
        (TWICE, "cables.c.end.joined: 'cable' is the joint of end again; remove one of them"),
        # loops that do not meet
        (
            "end.joined: c, c.start.position: [0, 9, 0]",
            "end.joined: 'c' closes no loop: cables.c.start.position is 9 m from start.position, "
            "but only 1 m of cable lie between; move them together, or lengthen the cables",
        ),
        (
            f"{LOOP}, end.fixed: {TRUE}, a.at: 0.2, a.cable.length: 0.1",
            "branches.a.end.joined: 'cable' closes no loop: end.position is 1 m from start.position"
            ", but only 0.4 m of cable lie between",
        ),
        (
            f"a.end.position: [0, 0, 5], a.end.fixed: {TRUE}",
            "branches.a.end.position: [0.0, 0.0, 5.0] is 5 m from start.position, but only 1.5 m",
        ),
        # connectors
        ("plug.mass: 0", "connectors.plug.mass: 0.0 kg is no mass; give that of the connector"),
        ("plug.inertia: [0, 0, 0]", "[0.0, 0.0, 0.0] kg m^2 leaves an axis without inertia, about"),
        ("plug.inertia: [1, 1, 3]", "is of no body, since 3 exceeds the sum of the other two; giv"),
        ("plug.shape: box, plug.size: [1, 0, 1]", "[1.0, 0.0, 1.0] has a zero that a box needs"),
        ("plug.size: [1, 0, 1]", "connectors.plug.size: [1.0, 0.0, 1.0] m does nothing without a"),
        ("plug.frame: world", "connectors.plug.frame: 'world' is the world frame, frame_id; give"),
        ("plug.frame: tcp, start.frame: tcp", "connectors.plug.frame: 'tcp' is also start.frame"),
        ("plug, q", "connectors.q.at: 1.0 is where connectors.plug is; give another place"),
        # what nets do not support
        ("a, terms.stretch: off", "terms.stretch: 'off' is not available for a net of cables; set"),
        ("a, terms.out_of_plane: off", "terms.out_of_plane: 'off' is not available for a net"),
        (
            "a.direction: [0, 1, 0], terms.twist: off",
            "terms.twist: 'off' takes no roll from one cable to another",
        ),
        (
            "a.direction: [0, 1, 0], terms.twist: frenet",
            "terms.twist: 'frenet' takes no roll from one cable to another",
        ),
        ("plug, terms.twist: off", "terms.twist: 'off' takes no roll from one cable to another"),
        (
            "a.direction: [0, 1, 0], terms.bend: off",
            "terms.bend: 'off' takes no roll from one cable to another",
        ),
        ("a, plasticity.yield_curvature: 1", "yield_curvature: 1.0 is not available for a net"),
        ("a, hose.pressure: 1e5, hose.bore: 0.002", "hose.pressure: 100000.0 Pa is not available"),
        ("a, measured.type: point_cloud", "measured.type: 'point_cloud' corrects a single cable"),
        ("a, discretization.knots: graded", "knots: 'graded' is not available for a net of cables"),
        ("a, hand.slides: true", "grasps.hand.slides: true is not available for a net of cables"),
    ],
)
def test_what_is_no_net_is_refused_in_one_line(text, complaint):
    with pytest.raises(SceneError) as caught:
        checked(text)
    message = str(caught.value)
    assert complaint in message and "\n" not in message and len(message) < 300


@pytest.mark.parametrize(
    "text",
    [
        f"{JAW}, a.at: 0.1",  # at the edge of the jaw
        f"{JAW}, a.at: 0.05, a.joint: hinged",
        "a, hand.at: 0.4, hand.clamped: true, hand.jaw: 0.15",
        "a, hand.at: -1.0, hand.clamped: true",
        "end.joined: cable",  # a ring that the start holds
        f"end.joined: cable, start.fixed: {FALSE}, end.joint: hinged",
        "end.joined: c, c.start.position: [0, 1.9, 0]",  # stretched, but it meets
        f"{LOOP}, a.cable.length: 0.4",
        f"plug, end.fixed: {TRUE}, end.clamped: true",  # a gripper holds the plug
        "plug.inertia: [1.0, 1.0, 2.0]",  # a plate
        "plug.shape: sphere, plug.size: [0.1, 0, 0]",
        "a.direction: [0.7071068, 0.0, -0.7071068]",
    ],
)
def test_what_is_unusual_but_possible_is_taken(text):
    assert checked(text)[0].is_net
