"""Nodes with a cable: one that begins at once and lives as long as the node, and one with a
lifecycle: configure compiles, activate ticks, cleanup forgets.

While that is not configured, its parameters are whatever it is given; configure judges them.
"""

import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from dlo_sim.ros.guarded_node import GuardedNode, one_line
from dlo_sim.ros.live_cable import LiveCable
from dlo_sim.scene.description import is_node_key
from dlo_sim.scene.loading import SceneError, overridden

_Return = TransitionCallbackReturn


class CableNode(GuardedNode):
    """A node with a cable.

    Attributes:
        cable: None before the start and after the end.
    """

    cable: LiveCable | None = None

    @property
    def failure(self) -> str | None:
        """Why the cable must end, one line; None while all is well."""
        return None if self.cable is None else self.cable.failure

    def start(self) -> None:
        """Predict from now on, with an executor that spins the node.

        Raises:
            SceneError: the scene is refused.
        """
        self.cable = LiveCable(self)
        self.cable.activate()

    def end(self) -> None:
        """Say goodbye: keep the state, remove the markers from every viewer."""
        if self.cable is not None:
            self.cable.close()
            self.cable = None


class ManagedCableNode(LifecycleNodeMixin, CableNode):
    """A node whose cable comes and goes with the transitions of its lifecycle."""

    def __init__(self, *given: Any, **options: Any) -> None:
        """Make the node; as of `CableNode`."""
        CableNode.__init__(self, *given, allow_undeclared_parameters=True, **options)
        LifecycleNodeMixin.__init__(self)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(self._change_state, service.callback)
        self._show_parameters()

    def start(self) -> None:
        """Nothing: the lifecycle begins unconfigured."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the scene and compile; a refused one can be mended and tried again."""
        return self._done(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen, tick and publish."""
        return self._done(self.cable.activate) if self.cable else _Return.ERROR

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop that and keep the state."""
        return self._done(self.cable.deactivate) if self.cable else _Return.ERROR

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drop the cable; its parameters stay."""
        return self._done(self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drop the cable for good."""
        return self._done(self.end)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be as before configure."""
        return self._done(self._clean_up)

    def _configure(self) -> None:
        self.remove_on_set_parameters_callback(self._note)
        for name in self.overrides:
            if self.has_parameter(name) and not is_node_key(name):
                self.undeclare_parameter(name)
        try:
            self.cable = LiveCable(self, read_only=False)
        except SceneError:
            self._show_parameters()
            raise

    def _clean_up(self) -> None:
        self.end()
        self._show_parameters()

    def _show_parameters(self) -> None:
        """Have the overrides as parameters of any type and take what is set for overrides."""
        for name, value in self.overrides.items():
            if value is not None and not self.has_parameter(name):
                self.set_parameters([Parameter(name, value=value)])
        self.add_on_set_parameters_callback(self._note)

    def _note(self, changes: list[Parameter]) -> SetParametersResult:
        given = {c.name: c.value for c in changes if c.type_ is not Parameter.Type.NOT_SET}
        try:
            merged = overridden(self.overrides, given)
        except SceneError as refusal:
            return SetParametersResult(successful=False, reason=str(refusal))
        deleted = {change.name for change in changes} - given.keys()
        self.overrides = {name: merged[name] for name in merged if name not in deleted}
        return SetParametersResult(successful=True)

    def _done(self, work: Callable[[], object]) -> TransitionCallbackReturn:
        """Do the work of a transition; rclpy would drop what is raised without a word."""
        try:
            work()
        except SceneError as refusal:
            self.get_logger().error(f"refused: {refusal}")
            return _Return.FAILURE
        except Exception:
            self.get_logger().error(traceback.format_exc())
            return _Return.ERROR
        return _Return.SUCCESS

    def _change_state(self, change: Callable[..., Any], request: Any, response: Any) -> Any:
        """~/change_state; rclpy raises on a transition that the present state does not have."""
        try:
            return change(request, response)
        except RuntimeError as error:
            self.get_logger().warning(f"no such transition from here: {one_line(error)}")
            response.success = False
            return response
