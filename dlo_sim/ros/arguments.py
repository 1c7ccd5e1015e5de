"""Command line and environment of the node, before rclpy sees them.

rcl refuses a list that mixes integers and decimals ("[0, 0, -9.81]"), which in a scene file is
fine everywhere else; such lists are written out as decimals for it. A params file that does not
exist or is not YAML is refused in one line.
"""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from dlo_sim.scene.checking import SceneError, brief
from dlo_sim.scene.plain_yaml import parse_yaml, read_text

_PARAMS_FILE = "--params-file"
_PARAMETER = ("-p", "--param")


@contextmanager
def arguments_for_rcl(arguments: Sequence[str]) -> Iterator[list[str]]:
    """The arguments as rcl can read them; rewritten files live as long as the context.

    Args:
        arguments: command line without the program's name, for example
            `--ros-args --params-file scene.yaml`.

    Raises:
        SceneError: an argument that is not for ROS, or a params file that cannot be read.
    """
    with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
        prepared: list[str] = []
        in_ros_section = False
        previous = ""
        for argument in arguments:
            if argument in ("--ros-args", "--"):
                in_ros_section = argument == "--ros-args"
            elif not in_ros_section:
                raise SceneError(
                    f"{argument!r} is not an argument of the node; give ROS arguments, as in "
                    "--ros-args --params-file scene.yaml"
                )
            elif previous == _PARAMS_FILE:
                argument = _readable_file(argument, Path(folder) / f"{len(prepared)}.yaml")
            elif previous in _PARAMETER:
                argument = _readable_rule(argument)
            prepared.append(argument)
            previous = argument
        yield prepared


def _readable_file(source: str, rewritten: Path) -> str:
    """The params file, or a copy of it in which rcl can read every list."""
    try:
        document = parse_yaml(read_text(Path(source)), "rt")
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None
    _refuse_doubles(document, source)
    if not _write_out_decimals(document):
        return source
    with rewritten.open("w", encoding="utf-8") as stream:
        YAML(typ="rt").dump(document, stream)
    return str(rewritten)


def _refuse_doubles(node: Any, source: str) -> None:
    """Refuse a parameter that is given nested and dotted as well; rcl would drop one of the two.

    Raises:
        SceneError: naming the file, the key and the value.
    """
    if not isinstance(node, dict):
        return
    if "ros__parameters" not in node:
        for item in node.values():
            _refuse_doubles(item, source)
        return
    seen: set[str] = set()
    for key, value in _leaves(node["ros__parameters"]):
        if key in seen:
            raise SceneError(f"{source}: {key}: {value} is given twice; keep one of them")
        seen.add(key)


def _leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values of everything in a block."""
    if not isinstance(node, dict):
        yield prefix, node
        return
    for key, value in node.items():
        yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))


def _readable_rule(rule: str) -> str:
    """`name:=value` with a mixed list written out; anything else is left for rcl to judge."""
    name, separator, text = rule.partition(":=")
    try:
        value = parse_yaml(text)
    except SceneError as error:
        raise SceneError(f"{brief(rule)} {error}") from None
    if separator and _write_out_decimals(value):
        return f"{name}:={value}"
    return rule


def _write_out_decimals(node: Any) -> bool:
    """Turn the integers of lists that also hold decimals into decimals, in place.

    Returns:
        Whether anything was changed.
    """
    if isinstance(node, dict):
        changed = [_write_out_decimals(item) for item in node.values()]
        return any(changed)
    if not isinstance(node, list):
        return False
    integers = [isinstance(item, int) and not isinstance(item, bool) for item in node]
    decimals = [isinstance(item, float) for item in node]
    mixed = any(integers) and any(decimals) and sum(integers) + sum(decimals) == len(node)
    if mixed:
        node[:] = [float(item) for item in node]
        return True
    changed = [_write_out_decimals(item) for item in node]
    return any(changed)
