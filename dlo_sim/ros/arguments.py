"""Command line and environment of the node, before rclpy sees them.

rcl refuses a list that mixes integers and decimals ("[0, 0, -9.81]"), which is fine in a scene
file; such lists are written out as decimals for it. A params file that does not exist or is not
YAML is refused in one line. rcl silently ignores parameters that are for other nodes only; here
they are remembered until the node knows its name.
"""

import argparse
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML

from dlo_sim.process.stopping import cleanup
from dlo_sim.scene.loading import find_scene, is_for_node, nodes_with_parameters
from dlo_sim.scene.plain_yaml import parse_yaml, read_text
from dlo_sim.scene.refusal import SceneError, brief

_PARAMS_FILE = "--params-file"
_PARAMETER = ("-p", "--param")
_REMAP = ("-r", "--remap")
_RENAME = ("__node:=", "__name:=", "__ns:=")
_ROS_ARGUMENTS, _END = "--ros-args", "--"


@dataclass
class NodeArguments:
    """The command line of the node.

    Attributes:
        for_rcl: ROS arguments as rcl can read them.
        allow_unmatched: parameters that are for other nodes only are accepted.
        nodes: params file or -p argument -> full names or wildcards of the nodes that it is for.
    """

    for_rcl: list[str] = field(default_factory=list)
    allow_unmatched: bool = False
    nodes: dict[str, list[str]] = field(default_factory=dict)

    @property
    def remaps(self) -> list[str]:
        """ROS arguments with the remap rules alone, but for those that rename every node."""
        rules = [
            rule
            for flag, rule in pairwise(self.for_rcl)
            if flag in _REMAP and not rule.startswith(_RENAME)
        ]
        return [_ROS_ARGUMENTS, *(word for rule in rules for word in ("-r", rule))]

    def unmatched(self, node: str) -> list[str]:
        """One line for each params file and -p argument that holds nothing for this node."""
        return [
            f"{source}: holds parameters for {', '.join(names) or 'no node'}, none for this one, "
            f"{node}; put them under '/**:', or start all the same with --allow-unmatched"
            for source, names in self.nodes.items()
            if not any(is_for_node(name, node) for name in names)
        ]


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SceneError(f"{message}; see 'dlo_sim node --help'")


def parser() -> argparse.ArgumentParser:
    """What the node takes beside ROS arguments."""
    parser = _Parser(
        prog="dlo_sim node",
        usage="%(prog)s [--scene SCENE] [--allow-unmatched] "
        "[--ros-args [--params-file FILE] [-p KEY:=VALUE] [-r FROM:=TO] ...]",
        description="Predict a cable live. A scene file is a ROS parameter file; "
        "'dlo_sim parameters' lists the keys.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--scene",
        action="append",
        default=[],
        help="scene file, or a shipped scene's name; --params-file and -p change it",
    )
    parser.add_argument(
        "--allow-unmatched",
        action="store_true",
        help="start even if a parameter file or -p has no entry for this node",
    )
    return parser


@contextmanager
def read_arguments(arguments: Sequence[str]) -> Iterator[NodeArguments]:
    """Read the command line, without the program's name; rewritten files live as long as the
    context.

    Raises:
        SceneError: an argument that is neither for the node nor for ROS, no such scene, or a params
            file that cannot be read.
    """
    own, for_ros = _split(arguments)
    options, strange = parser().parse_known_args(own)
    if strange:
        raise SceneError(
            f"{strange[0]!r} is not an argument of the node; give a scene as --scene SCENE, and "
            f"what is for ROS after {_ROS_ARGUMENTS}"
        )
    if len(options.scene) > 1:
        raise SceneError(f"--scene {options.scene[1]} is the second one; keep one of them")
    for scene in options.scene:
        for_ros = [_ROS_ARGUMENTS, _PARAMS_FILE, str(find_scene(scene)), _END, *for_ros]
    given = NodeArguments(allow_unmatched=options.allow_unmatched)
    try:
        folder = tempfile.mkdtemp(prefix="dlo_sim_")
    except OSError as error:
        raise _no_room(error) from None
    with cleanup(lambda: shutil.rmtree(folder, ignore_errors=True)):
        previous = ""
        for argument in for_ros:
            prepared = argument
            if previous == _PARAMS_FILE:
                rewritten = Path(folder) / f"{len(given.for_rcl)}.yaml"
                prepared, given.nodes[argument] = _readable_file(argument, rewritten)
            elif previous in _PARAMETER:
                prepared = _readable_rule(argument)
                node, separator, _ = argument.partition(":=")[0].rpartition(":")
                if separator:
                    given.nodes[f"-p {argument}"] = [f"/{node}"]
            given.for_rcl.append(prepared)
            previous = argument
        yield given


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments of the node itself, and the sections for ROS."""
    own: list[str] = []
    for_ros: list[str] = []
    in_ros_section = False
    for argument in arguments:
        if argument in (_ROS_ARGUMENTS, _END):
            in_ros_section = argument == _ROS_ARGUMENTS
            for_ros.append(argument)
        else:
            (for_ros if in_ros_section else own).append(argument)
    return own, for_ros


def _readable_file(source: str, rewritten: Path) -> tuple[str, list[str]]:
    """The params file, or a copy of it in which rcl can read every list; and the nodes in it."""
    try:
        document = parse_yaml(read_text(Path(source)), "rt")
        nodes = nodes_with_parameters(document)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None
    if not _write_out_decimals(document):
        return source, nodes
    try:
        with rewritten.open("w", encoding="utf-8") as stream:
            YAML(typ="rt").dump(document, stream)
    except OSError as error:
        raise _no_room(error) from None
    return str(rewritten), nodes


def _no_room(error: OSError) -> SceneError:
    return SceneError(
        f"temporary files cannot be written ({error.strerror}); free space, or set TMPDIR to a "
        "folder that has some"
    )


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
    """Make decimals of the integers in lists with decimals, in place; return whether any was."""
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
