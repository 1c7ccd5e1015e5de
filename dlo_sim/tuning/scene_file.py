"""A scene as a ROS 2 parameter file, with comments on top: what differs from the defaults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dlo_sim.scene.description import Scene, parameters_of_scene
from dlo_sim.scene.loading import scene_values
from dlo_sim.scene.refusal import printable

INDENT = "  "


def scene_text(scene: Scene, comments: Sequence[str]) -> str:
    """The file's text; `load_scene` of it gives the same scene, whatever the comments hold."""
    defaults = {
        row.key: list(row.default) if isinstance(row.default, tuple) else row.default
        for row in parameters_of_scene(scene)
    }
    tree: dict[str, object] = {}
    for key, value in scene_values(scene).items():
        if value != defaults[key]:
            *groups, leaf = key.split(".")
            branch = tree
            for group in groups:
                branch = branch.setdefault(group, {})  # type: ignore[assignment]
            branch[leaf] = value
    lines = [f"# {printable(line)}".rstrip() for line in comments]
    lines += ["/**:", f"{INDENT}ros__parameters:", *_lines(tree, 2)]
    return "\n".join(lines) + "\n"


def _lines(tree: Mapping[str, object], depth: int) -> list[str]:
    lines = []
    for key, value in tree.items():
        if isinstance(value, Mapping):
            lines += [f"{INDENT * depth}{key}:", *_lines(value, depth + 1)]
        else:
            lines.append(f"{INDENT * depth}{key}: {written(value)}")
    return lines


def written(value: object) -> str:
    """A value as ROS reads it: doubles with a decimal point, texts in quotes."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(written(item) for item in value) + "]"
    if isinstance(value, float):
        mantissa, mark, exponent = repr(value).partition("e")
        point = "" if "." in mantissa else ".0"
        return mantissa + point + mark + exponent
    if isinstance(value, int):
        return str(value)
    text = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{printable(text)}"'
