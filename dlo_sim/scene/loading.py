"""Loading of scenes from files and values, with all checks.

A scene file is a ROS 2 parameter file, read here without ROS, as YAML 1.2: names or wildcards of
nodes, each with its keys. Every key, type and range is checked against the parameter table
(`parameter`), then the scene as a whole (`description`).
"""

import os
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from dlo_sim.scene.description import Scene, mapping, overridden, scene_from_values
from dlo_sim.scene.description import scene_values as scene_values  # for those who load scenes
from dlo_sim.scene.refusal import SceneError, brief, nearest

NODE_NAME = "dlo_sim"
_DEEPEST = 12  # levels of names and keys


def load_scene(
    source: str | os.PathLike[str] | Mapping[str, object],
    overrides: Mapping[str, object] | None = None,
) -> Scene:
    """Read a scene.

    Args:
        source: the name of a shipped scene, such as "two_grippers"; the path of a ROS 2 parameter
            file with a block for `/**`, `dlo_sim` or a single other node; or a mapping as in such a
            file, or of its keys alone, nested or dotted: `{"cable": {"length": 2.0}}`.
        overrides: dotted key -> value, replaces values of the source; `loads.names` here also drops
            the blocks of loads that it does not name.

    Raises:
        SceneError: one line that names the file, the key, the value and the cure.
        TypeError: neither a name nor a path nor a mapping.
    """
    wanted = mapping("overrides", {} if overrides is None else overrides)
    if isinstance(source, Mapping):
        values = _node_values(source) if _has_nodes(source) else flat_keys(source)
        return scene_from_values(overridden(values, wanted))
    values = scene_file_values(source)
    try:
        return scene_from_values(overridden(values, wanted))
    except SceneError as error:
        raise SceneError(f"{find_scene(source)}: {error}") from None


def scene_file_values(source: str | os.PathLike[str]) -> dict[str, object]:
    """The values of a scene file (name or path), dotted key -> value, before any check.

    Raises SceneError if it cannot be read or contains no scene.
    """
    path = find_scene(source)
    try:
        return _beside(path, _node_values(_read_yaml(path)))
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _beside(path: Path, values: dict[str, object]) -> dict[str, object]:
    """The values, with files of meshes as seen from the file that names them."""
    for key, value in values.items():
        if key.startswith("obstacles.") and key.endswith(".mesh") and isinstance(value, str):
            if value and "://" not in value:
                values[key] = str(path.parent / os.path.expanduser(value))
    return values


def parse_assignment(text: str) -> tuple[str, object]:
    """Split `key=value`; the value is YAML; nothing is the empty text, as in `start.pose_topic=""`.

    Raises SceneError if `=` is missing, or the value is not YAML.
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
    """Path of a shipped scene, such as `paper_wire`: from a checkout, pip or a colcon workspace.

    Raises SceneError, which lists all names, if there is no such scene.
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
    """Path of a scene, by a path or the bare name of a shipped scene.

    Raises SceneError for a bare name that is neither, TypeError for neither text nor a path.
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


# ------------------------------------------------------------------------------ blocks of nodes


def _node_values(document: object) -> dict[str, object]:
    """The values for this node: wildcard blocks first, then the block of its name."""
    blocks = list(_node_blocks(document, ()))
    if not blocks:
        raise SceneError(
            "has no 'ros__parameters'; put the keys under '/**:' and 'ros__parameters:'"
        )
    named = [node for node, _ in blocks if "*" not in node]
    mine = [node for node in named if node.rsplit("/", 1)[-1] == NODE_NAME] or named
    if len(mine) > 1:
        raise SceneError(f"holds several nodes ({', '.join(mine)}); keep one, or use '/**'")
    name = mine[0] if mine else f"/{NODE_NAME}"
    matching = [b for b in blocks if is_for_node(b[0], name)]
    if not matching:
        raise SceneError(f"holds nothing for the node {NODE_NAME}; use '/**:' for any node")
    values: dict[str, object] = {}
    for _, block in sorted(matching, key=lambda item: item[0] == name):
        values.update(flat_keys(block))
    return values


def _has_nodes(document: Mapping[str, object], depth: int = 0) -> bool:
    """Whether keys are grouped by nodes, as in a file."""
    return depth <= _DEEPEST and any(
        key == "ros__parameters" or (isinstance(value, Mapping) and _has_nodes(value, depth + 1))
        for key, value in document.items()
    )


def flat_keys(
    block: object, prefix: str = "", depth: int = 0, *, strings: bool = True
) -> dict[str, object]:
    """Nested and dotted keys as one flat mapping.

    `strings`: refuse keys that are not strings, which nodes other than ours may have. Raises
    SceneError also for a key in both forms, or what is no mapping.
    """
    if not isinstance(block, Mapping) or depth > _DEEPEST:
        key = prefix.rstrip(".") or "ros__parameters"
        raise SceneError(f"{key}: {brief(block)} is not a mapping of keys; write key: value lines")
    flat: dict[str, object] = {}
    for key, value in block.items():
        if strings and not isinstance(key, str):
            raise SceneError(f"{prefix}{brief(key)}: a key must be a string; correct or quote it")
        name = f"{prefix}{key}"
        parts = {name: value}
        if isinstance(value, Mapping):
            parts = flat_keys(value, f"{name}.", depth + 1, strings=strings)
        for part in parts:
            if part in flat:
                raise SceneError(f"{part}: {brief(parts[part])} is given twice; keep one of them")
        flat.update(parts)
    return flat


def nodes_with_parameters(document: object) -> list[str]:
    """Full names or wildcards of the nodes that have parameters in a parsed parameter file.

    Raises SceneError for anything other than nodes, or a key both nested and dotted.
    """
    blocks = () if document is None else _node_blocks(document, ())
    return list(
        dict.fromkeys(node for node, block in blocks if block and flat_keys(block, strings=False))
    )


def is_for_node(block: str, node: str) -> bool:
    """Whether ROS applies a block of a file to the node of this full name.

    `*` matches one part of the name and `/**` any number of parts, including none.
    """
    rules = {"/**": "(/.*)?", "*": "[^/]+"}
    parts = re.split(r"(/\*\*|\*)", block)
    pattern = "".join(rules.get(part, re.escape(part)) for part in parts)
    return re.fullmatch(pattern, node) is not None


def _node_blocks(document: object, path: tuple[str, ...]) -> Iterator[tuple[str, object]]:
    """Every `ros__parameters` block with the full name of its node; namespaces may nest."""
    if not isinstance(document, Mapping):
        where = f"'{'/'.join(path)}' " if path else ""
        raise SceneError(
            f"{where}holds {brief(document)} instead of nodes; put the keys under '/**:' and "
            "'ros__parameters:'"
        )
    if len(path) > _DEEPEST:
        raise SceneError("nests too deeply; put the keys under '/**:' and 'ros__parameters:'")
    for key, value in document.items():
        if key == "ros__parameters":
            yield "/" + "/".join(path), value
        else:
            yield from _node_blocks(value, (*path, str(key).strip("/")))
