"""The command line as rcl gets it: mixed lists written out, everything else untouched."""

import tempfile
from pathlib import Path

import pytest

from dlo_sim.ros.arguments import read_arguments
from dlo_sim.scene.loading import SceneError, load_scene
from test.disks import mounted

MIXED = """
/**:
  ros__parameters:
    gravity: [0, 0, -9.81]
    start.fixed: [true, true, true]
    start.spring: [1, 2, 3]
    cable:
      rest_curvature: [1, 2.5]
"""


def test_mixed_lists_are_written_out_and_mean_the_same(tmp_path: Path) -> None:
    source = tmp_path / "scene.yaml"
    source.write_text(MIXED, encoding="utf-8")
    with read_arguments(["--ros-args", "--params-file", str(source)]) as arguments:
        rewritten = Path(arguments.for_rcl[2])
        assert rewritten != source
        text = rewritten.read_text(encoding="utf-8")
        assert "[0.0, 0.0, -9.81]" in text
        assert "[1.0, 2.5]" in text
        assert "[1, 2, 3]" in text
        assert "[true, true, true]" in text
    assert not rewritten.exists()
    assert source.read_text(encoding="utf-8") == MIXED


def test_a_file_without_mixed_lists_is_passed_on_itself(checkout: Path) -> None:
    scene = checkout / "config" / "paper_wire.yaml"
    given = ["--ros-args", "-r", "__ns:=/left", "--params-file", str(scene), "--"]
    with read_arguments(given) as arguments:
        assert arguments.for_rcl == given


SHARED = """
/motors:
  ros__parameters:
    1: {gain: 2.0}
/dlo_sim:
  ros__parameters:
    rate: 100.0
"""


def test_keys_of_another_node_may_be_numbers(tmp_path: Path) -> None:
    source = tmp_path / "shared.yaml"
    source.write_text(SHARED, encoding="utf-8")
    given = ["--ros-args", "--params-file", str(source)]
    with read_arguments(given) as arguments:
        assert arguments.for_rcl == given
        assert arguments.nodes == {str(source): ["/motors", "/dlo_sim"]}
    source.write_text(SHARED + "    rate.x: 1\n    rate: {x: 2}\n".replace("rate", "cable"))
    with (
        pytest.raises(SceneError, match=r"shared.yaml: cable.x: 2 is given twice"),
        read_arguments(given),
    ):
        pass


def test_rules_on_the_command_line(tmp_path: Path) -> None:
    given = ["--ros-args", "-p", "gravity:=[0, 0, -9.81]", "--param", "cable.length:=2"]
    with read_arguments(given) as arguments:
        assert arguments.for_rcl[2] == "gravity:=[0.0, 0.0, -9.81]"
        assert arguments.for_rcl[4] == given[4]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["scene.yaml"], "scene.yaml"),
        (["--scene"], "--scene"),
        (["--scene", "hanging_cabel"], "did you mean hanging_cable"),
        (["--scene", "paper_wire", "--scene", "hanging_cable"], "hanging_cable is the second"),
        (["--ros-args", "--params-file", "/nowhere/scene.yaml"], "/nowhere/scene.yaml"),
    ],
)
def test_refused_in_one_line(given: list[str], named: str) -> None:
    with pytest.raises(SceneError, match=named) as refusal, read_arguments(given):
        pass
    assert "\n" not in str(refusal.value)


def test_broken_yaml_is_refused_with_its_line(tmp_path: Path) -> None:
    source = tmp_path / "scene.yaml"
    source.write_text("/**:\n  ros__parameters: [1, 2\n", encoding="utf-8")
    given = ["--ros-args", "--params-file", str(source)]
    with pytest.raises(SceneError, match=r"line \d"), read_arguments(given):
        pass
    with pytest.raises(SceneError):
        load_scene(source)


@pytest.mark.parametrize("scene", ["hanging_cable", "config/hanging_cable.yaml"])
def test_a_scene_comes_before_what_changes_it(
    scene: str, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(checkout)
    ros = ["--ros-args", "-p", "rate:=50.0", "-r", "__ns:=/left"]
    for given in (["--scene", scene, *ros], [*ros, "--", "--scene", scene]):
        with read_arguments(given) as arguments:
            section = arguments.for_rcl[: arguments.for_rcl.index("--")]
            assert section[:2] == ["--ros-args", "--params-file"]
            assert Path(section[2]).samefile(checkout / "config" / "hanging_cable.yaml")
            assert arguments.for_rcl[4:9] == ros
            assert arguments.unmatched("/left/dlo_sim") == []


OTHERS = """
/other:
  ros__parameters: {rate: 50.0}
left:
  dlo_sim:
    ros__parameters: {rate: 50.0}
/nothing:
  ros__parameters: {}
"""


@pytest.mark.parametrize(
    ("text", "node", "named"),
    [
        (OTHERS, "/left/dlo_sim", None),
        (OTHERS, "/dlo_sim", "/other, /left/dlo_sim, none for this one, /dlo_sim"),
        (OTHERS, "/nothing", "/other, /left/dlo_sim, none for this one, /nothing"),
        ("# nothing yet", "/dlo_sim", "no node, none for this one"),
        ("{}", "/dlo_sim", "no node, none for this one"),
    ],
)
def test_a_file_for_other_nodes_is_noticed(
    tmp_path: Path, text: str, node: str, named: str | None
) -> None:
    source = tmp_path / "scene.yaml"
    source.write_text(text, encoding="utf-8")
    with read_arguments(["--ros-args", "--params-file", str(source)]) as arguments:
        lines = arguments.unmatched(node)
    assert [line.startswith(f"{source}: ") for line in lines] == [True] * (named is not None)
    assert named is None or named in lines[0]


def test_a_parameter_for_another_node_is_noticed() -> None:
    given = ["--ros-args", "-p", "other:rate:=50.0", "-p", "dlo_sim:rate:=50.0", "-p", "a:=b:c"]
    with read_arguments(given) as arguments:
        (line,) = arguments.unmatched("/dlo_sim")
    assert line.startswith("-p other:rate:=50.0: holds parameters for /other, none")


def test_temporary_files_without_room_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    cable.rest_curvature: [0, 0.5]\n")
    folder = tmp_path / "full"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    with mounted(folder, 4096):
        (folder / "more").write_bytes(bytes(4096))
        with (
            pytest.raises(SceneError, match="No space left on device.; free space, or set TMPDIR"),
            read_arguments(["--ros-args", "--params-file", str(params)]),
        ):
            pass
