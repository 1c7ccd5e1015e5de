"""Loading of scenes from files and values, with all checks.

A scene file is a ROS 2 parameter file, read here without ROS, as YAML 1.2. Every key, type and
range is checked against the parameter table (`checking`), then the scene as a whole
(`consistency`).
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from dlo_sim.scene.description import Scene, mapping, overridden, scene_from_values, scene_values
from dlo_sim.scene.node_blocks import flat_keys, has_nodes, node_values
from dlo_sim.scene.refusal import SceneError, brief, nearest

__all__ = [
    "SceneError",
    "find_scene",
    "load_scene",
    "overridden",
    "parse_assignment",
    "scene_file_values",
    "scene_from_values",
    "scene_values",
    "shipped_scene",
    "shipped_scenes",
]


def load_scene(
    source: str | os.PathLike[str] | Mapping[str, object],
    overrides: Mapping[str, object] | None = None,
) -> Scene:
    """Read a scene.

    Args:
        source: the name of a shipped scene, such as "two_grippers"; the path of a ROS 2 parameter
            file with a block for `/**`, `dlo_sim` or a single other node; or a mapping as in such a
            file, or of its keys alone, nested or dotted: `{"cable": {"length": 2.0}}`.
        overrides: dotted key -> value, replaces values of the source; `loads.names` here also
            drops the blocks of loads that it does not name.

    Raises:
        SceneError: one line that names the file, the key, the value and the cure.
        TypeError: neither a name nor a path nor a mapping.
    """
    wanted = mapping("overrides", {} if overrides is None else overrides)
    if isinstance(source, Mapping):
        values = node_values(source) if has_nodes(source) else flat_keys(source)
        return scene_from_values(overridden(values, wanted))
    values = scene_file_values(source)
    try:
        return scene_from_values(overridden(values, wanted))
    except SceneError as error:
        raise SceneError(f"{find_scene(source)}: {error}") from None


def scene_file_values(source: str | os.PathLike[str]) -> dict[str, object]:
    """The values of a scene file, dotted key -> value, before any check.

    Args:
        source: a name or a path, as for `load_scene`.

    Raises:
        SceneError: the file cannot be read or contains no scene.
    """
    path = find_scene(source)
    try:
        return node_values(_read_yaml(path))
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def parse_assignment(text: str) -> tuple[str, object]:
    """Split `key=value`; the value is parsed as YAML, as in a scene file. No value is the empty
    text: a shell removes the quotes of `start.pose_topic=""`.

    Raises:
        SceneError: `=` is missing, or the value is not YAML.
    """
    from dlo_sim.scene.plain_yaml import parse_yaml

    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise SceneError(f"{brief(text)} is not an assignment; give key=value, cable.length=2.0")
    try:
        return key.strip(), parse_yaml(value) if value.strip() else ""
    except SceneError as error:
        raise SceneError(f"{key.strip()}: {brief(value)} {error}") from None


# ----------------------------------------------------------------------------------- scene files


def shipped_scenes() -> dict[str, Path]:
    """Paths of the scenes shipped with the package, by name; empty if not installed."""
    folder = _config_folder()
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def shipped_scene(name: str) -> Path:
    """Path of a scene shipped with the package, for example `paper_wire`.

    Works from a checkout, from `pip install` (also editable) and from a colcon workspace.

    Raises:
        SceneError: if there is no such scene; the message lists all names.
    """
    scenes = shipped_scenes()
    if name in scenes:
        return scenes[name]
    there = ", ".join(scenes) or "none are installed"
    raise SceneError(
        f"{brief(name)} is not a shipped scene ({there}){nearest(name, scenes)}; "
        "give one of them or the path of a scene file"
    )


def find_scene(text: str | os.PathLike[str]) -> Path:
    """Path of a scene given as a path or as the bare name of a shipped scene.

    Raises:
        SceneError: a bare name that is neither a file nor a shipped scene.
        TypeError: neither text nor a path.
    """
    name = os.fspath(text) if isinstance(text, str | os.PathLike) else None
    if not isinstance(name, str) or "\0" in name:
        raise TypeError(
            f"scene: needs a shipped scene's name, a path or a mapping of keys, got {brief(text)}"
        )
    path = Path(name)
    bare = path.name == name and not path.suffix
    return shipped_scene(name) if bare and not os.path.isfile(path) else path


def _config_folder() -> Path | None:
    """The directory of the scenes: in a checkout, else in share/ of the installation prefix."""
    package = Path(__file__).resolve().parents[1]
    if (package.parent / "package.xml").is_file():
        return package.parent / "config"
    prefixes = [*package.parents, Path(sys.prefix)]
    prefixes += [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    for prefix in prefixes:
        folder = prefix / "share" / "dlo_sim" / "config"
        if folder.is_dir():
            return folder
    return None


def _read_yaml(source: Path) -> object:
    from dlo_sim.scene.plain_yaml import parse_yaml, read_text

    text = read_text(source)
    if not text.strip():
        raise SceneError("is empty; start from a shipped scene such as paper_wire")
    return parse_yaml(text)
