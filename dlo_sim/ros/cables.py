"""The cables of a process: one on the node `dlo_sim`, or, by the parameter `cables`, one on a node
of its own for each name.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray

from dlo_sim.process import stopping
from dlo_sim.ros.arguments import NodeArguments
from dlo_sim.ros.cable_node import CableNode, ManagedCableNode
from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.scene.description import is_node_key, scene_parameters
from dlo_sim.scene.loading import NODE_NAME, overridden, scene_file_values
from dlo_sim.scene.parameter import Parameter, check_names, check_value
from dlo_sim.scene.refusal import SceneError, brief
from dlo_sim.session.cdr import DiagnosticStatus, encode_diagnostic_array
from dlo_sim.session.diagnostics import ERROR
from dlo_sim.session.topics import DIAGNOSTICS

_CABLES = Parameter("cables", "string_array", ())
_SCENE = Parameter("scene", "string", "")
_PERIOD = 1.0  # [s] between two diagnostics of a cable that is not there
_LIFECYCLE = Parameter("lifecycle", "bool", False)


class Makers(NamedTuple):
    """What makes the node of a cable, and one of its name to say why there is no cable."""

    cable: Callable[[], CableNode]
    bare: Callable[[], GuardedNode]

    def keep_saying(self, reason: str, running: Sequence[str]) -> None:
        """Publish once a second why there is no cable, as long as others run."""
        if not running:
            return
        try:
            node = self.bare()
        except SceneError:  # what ROS refuses is the name
            return
        publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        name = node.get_fully_qualified_name()
        while running and not stopping.requested():
            values = (("cables running", ", ".join(running)),)
            status = DiagnosticStatus(ERROR, "node", reason, values)
            now = node.get_clock().now().nanoseconds
            publisher.publish(encode_diagnostic_array(now, name, [status]))
            time.sleep(_PERIOD)
        node.destroy_node()


def cables(given: NodeArguments) -> dict[str, Makers]:
    """What makes the node of each cable, by its name in `cables`; without that, of the only one.

    Raises:
        SceneError: the names, the node's own name, or parameters that are all for other nodes, or
            for a cable that is not named.
    """
    # Only ROS knows which name and which parameters the command line gives the node.
    asked = GuardedNode(NODE_NAME, enable_rosout=False, start_parameter_services=False)
    try:
        full_name = asked.get_fully_qualified_name()
        for line in given.unmatched(full_name):
            if not given.allow_unmatched:
                raise SceneError(line)
            asked.get_logger().warning(line)
        values = {k: [] if v is None else v for k, v in asked.overrides.items()}
    finally:
        asked.destroy_node()
    found = check_value(_CABLES, values.get(_CABLES.key, []))
    names = [str(name) for name in found]  # type: ignore[union-attr]
    first_words = {row.key.split(".")[0] for row in scene_parameters()}
    check_names(_CABLES.key, names, sorted(first_words))
    if not names:
        return {"": Makers(partial(_node, values, NODE_NAME), partial(_bare, NODE_NAME))}
    for key, value in values.items():
        of, _, rest = key.partition(".")
        meant = rest.split(".")[0] in first_words | {_SCENE.key, _LIFECYCLE.key}
        if meant and of not in first_words | set(names) and not is_node_key(key):
            raise SceneError(
                f"{key}: {brief(value)} is for a cable '{of}'; cables names {', '.join(names)}: "
                "name it there, or correct the key"
            )
    shared = {k: v for k, v in values.items() if k.split(".")[0] not in (_CABLES.key, *names)}
    options = {"namespace": full_name, "use_global_arguments": False, "cli_args": given.remaps}
    return {
        name: Makers(partial(_made, name, values, shared, options), partial(_bare, name, **options))
        for name in names
    }


def _bare(name: str, **options: Any) -> GuardedNode:
    return GuardedNode(name, {}, enable_rosout=False, start_parameter_services=False, **options)


def _made(
    name: str, values: Mapping[str, Any], shared: Mapping[str, Any], options: Mapping[str, Any]
) -> CableNode:
    """The node of one of several cables: its scene, changed by what is for all and what is for it.

    Raises:
        SceneError: the scene file cannot be read, there is none and no parameter of a scene, or
            ROS refuses the node.
    """
    prefix = f"{name}."
    own = {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}
    scene = check_value(_SCENE, own.pop(_SCENE.key, ""))
    found = scene_file_values(str(scene)) if scene else {}
    merged = overridden(found, {**shared, **own})
    if not scene and all(map(is_node_key, merged)):
        raise SceneError(
            f"{prefix}{_SCENE.key}: is not given; name a shipped scene or a scene file, or say what"
            f" cable it is by parameters such as {prefix}cable.length"
        )
    return _node(merged, name, merged, **options)


def _node(values: Mapping[str, Any], *given: Any, **options: Any) -> CableNode:
    """A plain node, or one with a lifecycle if the values ask for it."""
    managed = check_value(_LIFECYCLE, values.get(_LIFECYCLE.key, False))
    return (ManagedCableNode if managed else CableNode)(*given, **options)
