"""Scene files: the layouts of ROS parameter files, and files that are none."""

from pathlib import Path
from types import MappingProxyType

import pytest
from ruamel.yaml import YAML

from dlo_sim.scene.loading import (
    SceneError,
    find_scene,
    load_scene,
    parse_assignment,
    scene_from_values,
    scene_values,
    shipped_scene,
    shipped_scenes,
)

ENDLESS: dict[str, object] = {}
ENDLESS["a"] = ENDLESS
BLOCK = "ros__parameters: {cable: {length: 2.5}}"


@pytest.fixture
def write(tmp_path: Path):
    """Write a scene file, `BLOCK` standing for a usual block, and return its path."""

    def write_text(text: str | bytes) -> Path:
        path = tmp_path / "scene.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.replace("BLOCK", BLOCK).encode())
        return path

    return write_text


@pytest.mark.parametrize(
    "text",
    [
        "/**: {BLOCK}",
        "/*: {BLOCK}",
        "dlo_sim: {BLOCK}",
        "/dlo_sim: {BLOCK}",
        "/cell/left/dlo_sim: {BLOCK}",
        "cell: {left: {dlo_sim: {BLOCK}}}",
        "/**/dlo_sim: {BLOCK}",
        "left_cable: {BLOCK}",
        "/**: {ros__parameters: {cable.length: 2.5}}",
        "/**: {ros__parameters: {cable: {length: 9.0}}}\ndlo_sim: {BLOCK}",
        "dlo_sim: {BLOCK}\n/**: {ros__parameters: {cable: {length: 9.0}}}",
        "dlo_sim: {BLOCK}\ncamera: {ros__parameters: {exposure: 5}}",
        "/**: {ros__parameters: {use_sim_time: true, cable.length: 2.5}}",
        '/**: {ros__parameters: {"qos_overrides./clock.depth": 1, cable.length: 2.5}}',
    ],
)
def test_every_layout_of_ros_parameter_files_is_read(write, text):
    assert load_scene(write(text)).cable.length == 2.5


def test_numbers_of_yaml_1_2(write):
    path = write(
        "/**: {ros__parameters: {cable: {youngs_modulus: 2e9, length: 3, diameter: 1e-3}}}"
    )
    cable = load_scene(path).cable
    assert (cable.youngs_modulus, cable.length, cable.diameter) == (2e9, 3.0, 1e-3)


@pytest.mark.parametrize("value", ["off", '"off"', "false"])
def test_off_quoted_or_not(write, value):
    path = write(f"/**: {{ros__parameters: {{terms: {{twist: {value}}}}}}}")
    assert load_scene(path).terms.twist == "off"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is empty; start from a shipped scene"),
        ("# nothing\n", "holds None instead of nodes"),
        (b"\xff\xfe\x00\x01\x89PNG", "is not a text file"),
        (b"/**:\x00", "is not valid YAML"),
        ("just words", "holds 'just words' instead of nodes"),
        ("[1, 2]", "holds [1, 2] instead of nodes"),
        ("cable: {length: 2.0}", "holds 2.0 instead of nodes; put the keys under '/**:'"),
        ("/**: {}", "has no 'ros__parameters'"),
        ("/cell/*: {BLOCK}", "holds nothing for the node dlo_sim"),
        ("/**: {ros__parameters: }", "ros__parameters: None is not a mapping"),
        ("/**: {ros__parameters: {cable: }}", "stands for a group of keys; give cable.length"),
        ("a: {BLOCK}\nb: {BLOCK}", "holds several nodes (/a, /b)"),
        ("a/dlo_sim: {BLOCK}\nb/dlo_sim: {BLOCK}", "holds several nodes"),
        ("/**: {ros__parameters: {rate: 9, rate: 8}}", "line 1: key rate is there twice"),
        (
            "/**: {ros__parameters: {cable.length: 1, cable: {length: 2}}}",
            "cable.length: 2 is given twice",
        ),
        ("/**: {ros__parameters: {1: 2}}", "1: a key must be a string"),
        ("/**: {ros__parameters: {rate: [1, }}", "is not valid YAML, line 1"),
        ("/**:\n\tros__parameters: 3", "is not valid YAML, line 2"),
        ("a: 1\n---\nb: 2", "is not valid YAML, line 2"),
        ("/**: {ros__parameters: {rate: !!python/object:os.system x}}", "is not valid YAML"),
        ("/**: {ros__parameters: &x {cable: *x}}", "line 1: alias '*x' is not supported"),
        ('/**: {ros__parameters: {? "\\ud800\\e" : 1}}', "\\ud800\\x1b: 1 is for no known key"),
        ("/**: {ros__parameters: {? " + "k" * 99_999 + " : 1}}", "...kkk"),
        ("/**: {ros__parameters: {cable: {lenght: 2.0}}}", "cable.lenght: 2.0 is for no known key"),
        ("/**: {ros__parameters: {cable: {length: .nan}}}", "cable.length: nan is not finite"),
        ("/**: {ros__parameters: {rate: 2020-01-01}}", "is not a number"),
        ("x: " + "y" * 2_000_000, "holds more than 1000000 bytes"),
        ("[" * 5000, "is not valid YAML"),
    ],
)
def test_a_bad_file_is_refused_with_its_place_and_a_cure(write, text, complaint):
    path = write(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 500
    assert message.startswith(f"{path}: ")
    assert complaint in message


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(SceneError, match="nowhere.yaml: does not exist; give a scene file"):
        load_scene(tmp_path / "nowhere.yaml")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(tmp_path)


def test_overrides_win_and_are_checked(write):
    path = write("/**: {BLOCK}")
    assert load_scene(path, {"cable.length": 4}).cable.length == 4.0
    with pytest.raises(SceneError, match="did you mean cable.length"):
        load_scene(path, {"cable.lenth": 4})


def test_override_may_drop_a_load_of_the_file(write):
    path = write("/**: {ros__parameters: {loads: {names: [a, b], a: {position: 0.5}}}}")
    assert [load.name for load in load_scene(path, {"loads.names": ["b"]}).loads] == ["b"]


def test_values_and_scene_round_trip():
    values = {
        "cable.rest_curvature": [0.5, 1.0, 0.25],
        "loads.names": ["tip", "middle"],
        "loads.middle.position": 0.5,
        "loads.tip.signal": "constant",
        "loads.tip.force": [0.0, 0.0, -1.0],
        "end.mass": 0.25,
    }
    scene = scene_from_values(values)
    flat = scene_values(scene)
    assert scene_from_values(flat) == scene
    assert {key: flat[key] for key in values} == values


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("cable.length=2", "cable.length", 2),
        ("cable.length = 2.5e-1", "cable.length", 0.25),
        ("gravity=[0, 0, -1.5]", "gravity", [0, 0, -1.5]),
        ("terms.twist=off", "terms.twist", "off"),
        ("start.pose_topic=~/start/pose", "start.pose_topic", "~/start/pose"),
        ("start.frame=", "start.frame", ""),
        ("frame_id='a=b'", "frame_id", "a=b"),
    ],
)
def test_an_assignment_is_a_key_and_a_value_of_yaml(text, key, value):
    assert parse_assignment(text) == (key, value)


@pytest.mark.parametrize("text", ["cable.length", "=2", "", "gravity=[1, 2", "a=&x [*x"])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(SceneError):
        parse_assignment(text)


def test_shipped_scene_by_name_or_path(tmp_path, monkeypatch):
    assert set(shipped_scenes()) == {
        "edge",
        "hanging_cable",
        "harness",
        "paper_wire",
        "paper_wire_force",
        "plug",
        "table",
        "two_grippers",
    }
    assert find_scene("paper_wire") == shipped_scene("paper_wire")
    assert find_scene("some/where.yaml") == Path("some/where.yaml")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper_wire").write_text("mine")
    assert find_scene("paper_wire") == Path("paper_wire")
    with pytest.raises(SceneError, match=r"'paper_wir' is not a shipped scene.*did you mean"):
        find_scene("paper_wir")


@pytest.mark.parametrize("name", ["paper_wire", Path("paper_wire")])
def test_a_scene_is_loaded_by_a_shipped_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_scene(name, {"rate": 50.0}) == load_scene(shipped_scene("paper_wire"), {"rate": 50})


def test_a_scene_is_loaded_from_a_mapping():
    """Nested as in a file, with its nodes or without, or flat."""
    text = shipped_scene("hanging_cable").read_text(encoding="utf-8")
    document = YAML(typ="safe").load(text)
    (node,) = document.values()
    scene = load_scene(shipped_scene("hanging_cable"))
    assert load_scene(document) == load_scene(node["ros__parameters"]) == scene
    assert load_scene(MappingProxyType(scene_values(scene))) == scene
    assert load_scene({"cable": {"length": 2}, "rate": 50.0}).cable.length == 2.0
    assert load_scene({"cable": {"length": 2}}, {"cable.length": 3}).cable.length == 3.0
    assert load_scene({}) == scene_from_values({})
    dropped = load_scene(document, {"loads.names": ["hand"]})
    assert dropped == load_scene("hanging_cable", {"loads.names": ["hand"]})


@pytest.mark.parametrize(
    ("source", "overrides", "complaint"),
    [
        (None, None, "scene: needs a shipped scene's name, a path or a mapping of keys, got None"),
        (b"paper_wire", None, "scene: needs a shipped"),
        (3, None, "scene: needs a shipped"),
        (["cable.length"], None, "scene: needs a shipped"),
        ("", None, "'' is not a shipped scene"),
        ("x" * 5000, None, "is not a shipped scene"),
        ("a\0b", None, "scene: needs a shipped"),
        ("/x" * 5000, None, "cannot be read"),
        ("paper_wire", ["rate"], "overrides: needs a mapping, {'cable.length': 2.0}, got ['rate']"),
        ("paper_wire", "rate=3", "overrides: needs a mapping"),
        ("paper_wire", {3: 4}, "3: a key must be a string"),
        ({3: 4}, None, "3: a key must be a string"),
        ({"cable": {"lenght": 2.0}}, None, "cable.lenght: 2.0 is for no known key; did you mean"),
        ({"cable": 2.0}, None, "cable: 2.0 stands for a group of keys; give cable.length"),
        ({"cable.length": 1, "cable": {"length": 2}}, None, "cable.length: 2 is given twice"),
        ({"cable": {"length": b"1"}}, None, "cable.length: b'1' is not a number"),
        ({"/**": {"ros__parameters": None}}, None, "ros__parameters: None is not a mapping"),
        (ENDLESS, None, "is not a mapping of keys; write key: value lines"),
    ],
)
def test_what_is_no_scene_is_refused_in_one_line(source, overrides, complaint):
    with pytest.raises((SceneError, TypeError)) as caught:
        load_scene(source, overrides)
    message = str(caught.value)
    assert complaint in message and "\n" not in message and len(message) < 11_000


def test_changes_of_a_scene_are_a_mapping():
    with pytest.raises(TypeError, match="values: needs a mapping"):
        scene_from_values({}).with_values(None)
