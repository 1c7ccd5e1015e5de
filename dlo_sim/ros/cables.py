"""The cables of a process: one on the node `dlo_sim`, or, by the parameter `cables`, one on a node
of its own for each name.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from dlo_sim.ros.arguments import NodeArguments
from dlo_sim.ros.cable_node import CableNode
from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.lifecycle import ManagedCableNode
from dlo_sim.scene.checking import check_names, check_value
from dlo_sim.scene.description import scene_parameters
from dlo_sim.scene.loading import overridden, scene_file_values
from dlo_sim.scene.node_blocks import NODE_NAME
from dlo_sim.scene.parameter import Parameter
from dlo_sim.scene.refusal import SceneError

_CABLES = Parameter("cables", "string_array", ())
_SCENE = Parameter("scene", "string", "")
_LIFECYCLE = Parameter("lifecycle", "bool", False)


def cables(given: NodeArguments) -> dict[str, Callable[[], CableNode]]:
    """What makes the node of each cable, by its name in `cables`; without that, of the only one.

    Raises:
        SceneError: the names, the node's own name, or parameters that are all for other nodes.
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
    check_names(_CABLES.key, names, sorted({r.key.split(".")[0] for r in scene_parameters()}))
    if not names:
        return {"": partial(_node, values, NODE_NAME)}
    shared = {k: v for k, v in values.items() if k.split(".")[0] not in (_CABLES.key, *names)}
    return {name: partial(_made, name, full_name, values, shared, given.remaps) for name in names}


def _made(
    name: str, parent: str, values: Mapping[str, Any], shared: Mapping[str, Any], remaps: list[str]
) -> CableNode:
    """The node of one of several cables: its scene, changed by what is for all and what is for it.

    Raises:
        SceneError: the scene file cannot be read, or ROS refuses the node.
    """
    prefix = f"{name}."
    own = {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}
    scene = check_value(_SCENE, own.pop(_SCENE.key, ""))
    found = scene_file_values(str(scene)) if scene else {}
    merged = overridden(found, {**shared, **own})
    return _node(
        merged, name, merged, namespace=parent, use_global_arguments=False, cli_args=remaps
    )


def _node(values: Mapping[str, Any], *given: Any, **options: Any) -> CableNode:
    """A plain node, or one with a lifecycle if the values ask for it."""
    managed = check_value(_LIFECYCLE, values.get(_LIFECYCLE.key, False))
    return (ManagedCableNode if managed else CableNode)(*given, **options)
