"""The parameter table for people: `dlo_sim parameters`, config/README.md."""

from dlo_sim.scene.description import placeholder_parameters, scene_parameters
from dlo_sim.scene.parameter import Parameter
from dlo_sim.scene.refusal import shown

__all__ = ["PARAMETERS", "markdown_table", "placeholder_parameters", "scene_parameters"]

PARAMETERS: tuple[Parameter, ...] = scene_parameters()
"""All parameters except those of loads, grasps and obstacles, whose keys contain their names."""


def markdown_table() -> str:
    """The parameter table as GitHub markdown, without a trailing newline."""
    lines = ["| parameter | type | default | unit | range | meaning |", "|---|---|---|---|---|---|"]
    lines += [_markdown_row(row) for row in placeholder_parameters()]
    return "\n".join(lines)


def _markdown_row(row: Parameter) -> str:
    kind = row.kind.replace("_array", "[]")
    if row.length is not None:
        kind = kind.replace("[]", f"[{row.length}]")
    meaning = row.description + (" *Read-only.*" if row.read_only else "")
    cells = (f"`{row.key}`", kind, f"`{shown(row.default)}`", row.unit, row.allowed, meaning)
    return "| " + " | ".join(cells) + " |"
