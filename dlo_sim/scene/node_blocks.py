"""The structure of ROS 2 parameter files: names or wildcards of nodes, each with its keys."""

import re
from collections.abc import Iterator, Mapping

from dlo_sim.scene.refusal import SceneError, brief

NODE_NAME = "dlo_sim"
_DEEPEST = 12


def node_values(document: object) -> dict[str, object]:
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


def has_nodes(document: Mapping[str, object], depth: int = 0) -> bool:
    """Whether keys are grouped by nodes, as in a file."""
    return depth <= _DEEPEST and any(
        key == "ros__parameters" or (isinstance(value, Mapping) and has_nodes(value, depth + 1))
        for key, value in document.items()
    )


def flat_keys(
    block: object, prefix: str = "", depth: int = 0, *, strings: bool = True
) -> dict[str, object]:
    """Nested and dotted keys as one flat mapping.

    Args:
        strings: refuse keys that are not strings; no scene has such keys, other nodes may.

    Raises:
        SceneError: a key given both ways, a key that is not a string, or not a mapping.
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

    Raises:
        SceneError: the file contains something other than nodes, or a key both nested and dotted.
    """
    blocks = () if document is None else _node_blocks(document, ())
    return list(
        dict.fromkeys(node for node, block in blocks if block and flat_keys(block, strings=False))
    )


def is_for_node(block: str, node: str) -> bool:
    """Whether ROS applies a block of this name in a file to the node of this full name.

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
