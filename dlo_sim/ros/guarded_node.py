"""A node whose user input cannot raise out of rclpy.

The time source and the parameter services that rclpy gives a node raise on some valid messages,
which would end the process. They subscribe and serve by the node's own methods, so this is where
their messages are checked.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from dlo_sim.ros.status import ClockWatch
from dlo_sim.scene.description import is_node_key
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.refusal import brief, one_line

_PARAMETER_TYPES = range(ParameterType.PARAMETER_NOT_SET, ParameterType.PARAMETER_STRING_ARRAY + 1)


class GuardedNode(Node):
    """A node that counts or refuses messages on which rclpy would raise.

    Attributes:
        clock_watch: the state of /clock.
        overrides: values of params files and -p by name, None for an empty list; none is declared.
    """

    def __init__(
        self, name: str, overrides: Mapping[str, Any] | None = None, **options: Any
    ) -> None:
        """Make the node.

        Args:
            name: unless a remap rule gives it another one.
            overrides: instead of those of params files and -p. options: for `rclpy.node.Node`.

        Raises:
            SceneError: rclpy refuses its name, its namespace or a parameter of its own.
        """
        self.clock_watch = ClockWatch()
        self.overrides: dict[str, Any] = {}
        self._noted = False
        options |= {"automatically_declare_parameters_from_overrides": True}
        values = overrides or {}
        try:
            for_rclpy = [Parameter(k, value=values[k]) for k in values if is_node_key(k)]
            super().__init__(name, parameter_overrides=for_rclpy, **options)
        except (RuntimeError, ParameterException, TypeError, ValueError) as error:
            raise SceneError(f"ROS refuses the node: {one_line(error)}; correct it") from None
        if overrides is not None:
            self.overrides = dict(overrides)

    def resolved(self, topic: str) -> str:
        """The resolved, remapped name of a topic; SceneError for one that ROS cannot have."""
        try:
            return str(self.resolve_topic_name(topic))
        except (RuntimeError, ValueError) as error:
            raise SceneError(f"{brief(topic)}: {one_line(error)}; give another name") from None

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Any]:
        """Declare as every node, but only note the overrides: rclpy cannot declare an empty list,
        and shows overrides nowhere else.
        """
        if ignore_override and not self._noted:
            self._noted = True
            self.overrides = {name: value for name, value, *_ in parameters}
            return []
        return list(super().declare_parameters(namespace, parameters, ignore_override))

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[[Any], None], *args: Any, **options: Any
    ) -> Any:
        """As of every node; a /clock that is no time is counted and goes no further."""
        if msg_type is Clock:
            callback = partial(self._pass_on_clock, callback)
        return super().create_subscription(msg_type, topic, callback, *args, **options)

    def create_service(
        self, srv_type: Any, name: str, callback: Callable[..., Any], *args: Any, **options: Any
    ) -> Any:
        """As of every node; a parameter of an unknown type is passed on without a value."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = partial(_pass_on_parameters, callback)
        return super().create_service(srv_type, name, callback, *args, **options)

    def _pass_on_clock(self, callback: Callable[[Clock], None], message: Clock) -> None:
        if self.clock_watch.accept(message.clock.sec, message.clock.nanosec):
            callback(message)


def _pass_on_parameters(callback: Callable[..., Any], request: Any, response: Any) -> Any:
    for parameter in request.parameters:
        if parameter.value.type not in _PARAMETER_TYPES:
            parameter.value.type = ParameterType.PARAMETER_NOT_SET
    return callback(request, response)
