"""Scene files and values in, checked scenes out.

A scene file is a ROS 2 parameter file; this reads it without ROS, as YAML 1.2. Every key, type and
range is checked against the parameter table, then the scene as a whole (see `checking.py`).
"""

import dataclasses
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dlo_sim.scene.checking import (
    SceneError,
    brief,
    check_load_names,
    check_scene,
    check_value,
    nearest,
    unknown_key,
)
from dlo_sim.scene.description import (
    Accuracy,
    Cable,
    Damping,
    Discretization,
    End,
    Initial,
    Inputs,
    Integrator,
    Load,
    Outputs,
    Plasticity,
    Scene,
    Terms,
    Torsion,
)
from dlo_sim.scene.node_blocks import flat_keys, has_nodes, node_values
from dlo_sim.scene.parameter import Parameter, Value
from dlo_sim.scene.parameters import scene_parameters

__all__ = [
    "SceneError",
    "find_scene",
    "load_scene",
    "parse_assignment",
    "scene_from_values",
    "scene_values",
    "shipped_scene",
    "shipped_scenes",
]

_GROUPS: dict[str, type] = {
    "cable": Cable,
    "damping": Damping,
    "discretization": Discretization,
    "terms": Terms,
    "plasticity": Plasticity,
    "torsion": Torsion,
    "start": End,
    "end": End,
    "initial": Initial,
    "integrator": Integrator,
    "inputs": Inputs,
    "outputs": Outputs,
    "accuracy": Accuracy,
}
# Parameters that every ROS node has; a scene file may set them, the scene does not need them.
_ROS_KEYS = re.compile(r"(use_sim_time|start_type_description_service|qos_overrides\..*)")


def load_scene(
    source: str | os.PathLike[str] | Mapping[str, object],
    overrides: Mapping[str, object] | None = None,
) -> Scene:
    """Read a scene.

    Args:
        source: the name of a shipped scene, such as "two_grippers"; the path of a ROS 2 parameter
            file with a block for `/**`, `dlo_sim` or a single other node; or a mapping as in such a
            file, or of its keys alone, nested or dotted: `{"cable": {"length": 2.0}}`.
        overrides: dotted key -> value, applied over the source; naming `loads.names` here drops the
            blocks of the source's other loads.

    Raises:
        SceneError: one line that names the file, the key, the value and the cure. TypeError:
            neither a name nor a path nor a mapping.
    """
    wanted = _mapping("overrides", {} if overrides is None else overrides)
    if isinstance(source, Mapping):
        values = node_values(source) if has_nodes(source) else flat_keys(source)
        return scene_from_values(_overridden(values, wanted))
    path = find_scene(source)
    try:
        return scene_from_values(_overridden(node_values(_read_yaml(path)), wanted))
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def scene_from_values(values: Mapping[str, object]) -> Scene:
    """Build a scene from flat values; what is not given has its default.

    Args:
        values: dotted key -> value, as in `{"cable.length": 2.0, "start.fixed": [True] * 3}`.

    Raises:
        SceneError: unknown key, wrong type, out of range, or an impossible scene.
    """
    names = _load_names(_mapping("values", values))
    known = {row.key: row for row in scene_parameters(names)}
    checked: dict[str, Value] = {key: row.default for key, row in known.items()}
    for key, value in values.items():
        if not isinstance(key, str):
            raise SceneError(f"{brief(key)}: a key must be a string; give one like 'cable.length'")
        if key in known:
            checked[key] = check_value(known[key], value)
        elif not _ROS_KEYS.fullmatch(key):
            raise unknown_key(key, value, known)
    scene = _scene(checked, names)
    check_scene(scene)
    return scene


def scene_values(scene: Scene) -> dict[str, Any]:
    """All parameters of a scene, dotted key -> value; lists for arrays.

    `scene_from_values(scene_values(scene)) == scene`.
    """
    names = tuple(load.name for load in scene.loads)
    values = {row.key: _value(scene, row) for row in scene_parameters(names)}
    return {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}


def changed_values(scene: Scene, changes: Mapping[str, object]) -> dict[str, object]:
    """The values of a scene with changes; loads that `loads.names` no longer holds are dropped."""
    return _overridden(scene_values(scene), _mapping("values", changes))


def parse_assignment(text: str) -> tuple[str, object]:
    """Split `key=value`; the value is read as YAML, as in a scene file.

    Raises:
        SceneError: without `=`, or if the value is not YAML.
    """
    from dlo_sim.scene.plain_yaml import parse_yaml

    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise SceneError(f"{brief(text)} is not an assignment; give key=value, cable.length=2.0")
    try:
        return key.strip(), parse_yaml(value)
    except SceneError as error:
        raise SceneError(f"{key.strip()}: {brief(value)} {error}") from None


# ----------------------------------------------------------------------------------- scene files


def shipped_scenes() -> dict[str, Path]:
    """The scenes that come with the package, by name; empty if they were not installed."""
    folder = _config_folder()
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def shipped_scene(name: str) -> Path:
    """The file of a scene that comes with the package, for example `paper_wire`.

    Works from a checkout, from `pip install` (also editable) and from a colcon workspace.

    Raises:
        SceneError: if there is no such scene; the message lists those there are.
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
    """The file that a user means: a path, or the bare name of a shipped scene.

    Raises:
        SceneError: if it is neither. TypeError: no text and no path.
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
    """Where the scenes are: beside the checkout, else in share/ of the prefix we live in."""
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


# ----------------------------------------------------------------------------- values and scenes


def _load_names(values: Mapping[str, object]) -> tuple[str, ...]:
    row = next(row for row in scene_parameters() if row.key == "loads.names")
    names = check_value(row, values.get(row.key, row.default))
    texts = tuple(str(name) for name in names)  # type: ignore[union-attr]
    check_load_names(texts)
    return texts


def _mapping(name: str, values: object) -> dict[str, object]:
    """Values by key, as a dictionary of its own.

    Raises:
        TypeError: no mapping.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"{name}: needs a mapping, {{'cable.length': 2.0}}, got {brief(values)}")
    return dict(values)


def _overridden(values: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """The values with changes, without the blocks of loads that `loads.names` no longer holds."""
    if "loads.names" not in changes:
        return {**values, **changes}
    dropped = set(_load_names(values)) - set(_load_names(changes))
    left = {
        key: value
        for key, value in values.items()
        if not (key.startswith("loads.") and key.split(".")[1] in dropped)
    }
    return {**left, **changes}


def _scene(values: Mapping[str, Any], load_names: tuple[str, ...]) -> Scene:
    groups = {name: _fields(kind, name, values) for name, kind in _GROUPS.items()}
    loads = tuple(
        Load(
            name=name,
            **{
                field.name: values[f"loads.{name}.{field.name}"]
                for field in dataclasses.fields(Load)
                if field.name != "name"
            },
        )
        for name in load_names
    )
    return Scene(
        frame_id=values["frame_id"],
        rate=values["rate"],
        gravity=values["gravity"],
        loads=loads,
        **groups,
    )


def _fields(kind: type, prefix: str, values: Mapping[str, Any]) -> Any:
    names = [field.name for field in dataclasses.fields(kind)]
    return kind(**{name: values[f"{prefix}.{name}"] for name in names})


def _value(scene: Scene, row: Parameter) -> Any:
    if row.key == "loads.names":
        return tuple(load.name for load in scene.loads)
    parts = row.key.split(".")
    if parts[0] == "loads":
        return getattr(scene.load(parts[1]), parts[2])
    value: Any = scene
    for part in parts:
        value = getattr(value, part)
    return value
