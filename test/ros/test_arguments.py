"""The command line as rcl gets it: mixed lists written out, everything else untouched."""

from pathlib import Path

import pytest

from dlo_sim.ros.arguments import arguments_for_rcl
from dlo_sim.scene.loading import SceneError, load_scene

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
    with arguments_for_rcl(["--ros-args", "--params-file", str(source)]) as arguments:
        rewritten = Path(arguments[2])
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
    with arguments_for_rcl(given) as arguments:
        assert arguments == given


def test_rules_on_the_command_line(tmp_path: Path) -> None:
    given = ["--ros-args", "-p", "gravity:=[0, 0, -9.81]", "--param", "cable.length:=2"]
    with arguments_for_rcl(given) as arguments:
        assert arguments[2] == "gravity:=[0.0, 0.0, -9.81]"
        assert arguments[4] == given[4]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["scene.yaml"], "scene.yaml"),
        (["--ros-args", "--params-file", "/nowhere/scene.yaml"], "/nowhere/scene.yaml"),
    ],
)
def test_refused_in_one_line(given: list[str], named: str) -> None:
    with pytest.raises(SceneError, match=named) as refusal, arguments_for_rcl(given):
        pass
    assert "\n" not in str(refusal.value)


def test_broken_yaml_is_refused_with_its_line(tmp_path: Path) -> None:
    source = tmp_path / "scene.yaml"
    source.write_text("/**:\n  ros__parameters: [1, 2\n", encoding="utf-8")
    given = ["--ros-args", "--params-file", str(source)]
    with pytest.raises(SceneError, match=r"line \d"), arguments_for_rcl(given):
        pass
    with pytest.raises(SceneError):
        load_scene(source)
