"""The cables of a process: one on the node `dlo_sim`, or one node for each name in `cables`.

A cable begins at once and lives as long as its node; with the parameter `lifecycle`, the node has a
lifecycle: configure compiles, activate ticks, cleanup forgets. Until configure checks them, its
parameters can have any values.
"""

import gc
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import Executor
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as NodeParameter

from dlo_sim.process import stopping
from dlo_sim.ros import DONE, FAILED, REFUSED
from dlo_sim.ros.arguments import NodeArguments
from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.live_cable import LiveCable
from dlo_sim.scene.description import is_node_key, scene_parameters
from dlo_sim.scene.loading import NODE_NAME, overridden, scene_file_values
from dlo_sim.scene.parameter import Parameter, check_names, check_value
from dlo_sim.scene.refusal import SceneError, brief, one_line
from dlo_sim.session.cdr import DiagnosticStatus, encode_diagnostic_array
from dlo_sim.session.diagnostics import ERROR
from dlo_sim.session.topics import DIAGNOSTICS

_CABLES = Parameter("cables", "string_array", ())
_SCENE = Parameter("scene", "string", "")
_PERIOD = 1.0  # [s] between two diagnostics of a cable that is not there
_LIFECYCLE = Parameter("lifecycle", "bool", False)
# [s] for which a thread may keep the interpreter. A tick releases it at each compiled step and each
# publication, and would wait 5 ms, Python's default, while a changed scene is being prepared.
_SWITCH_INTERVAL = 1.0e-4
_LONGEST_SPIN = 0.2  # [s]; a signal is noticed after this long also when no timer fires
_Return = TransitionCallbackReturn


class CableNode(GuardedNode):
    """A node with a `cable`, which is None before the start and after the end."""

    cable: LiveCable | None = None

    @property
    def failure(self) -> str | None:
        """Why the cable must end, one line; None while all is well."""
        return None if self.cable is None else self.cable.failure

    def start(self) -> None:
        """Begin to predict, with an executor that spins the node; SceneError for its scene."""
        self.cable = LiveCable(self)
        self.cable.activate()

    def end(self) -> None:
        """Save the state, remove the markers from every viewer, and drop the cable."""
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
        """Do nothing: the lifecycle begins unconfigured."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the scene and compile; after a refusal it can be corrected and configured again."""
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
        """Declare the overrides with any type; what is set from now on changes the overrides."""
        for name, value in self.overrides.items():
            if value is not None and not self.has_parameter(name):
                self.set_parameters([NodeParameter(name, value=value)])
        self.add_on_set_parameters_callback(self._note)

    def _note(self, changes: list[NodeParameter]) -> SetParametersResult:
        changed = {c.name: c.value for c in changes if c.type_ is not NodeParameter.Type.NOT_SET}
        try:
            merged = overridden(self.overrides, changed)
        except SceneError as refusal:
            return SetParametersResult(successful=False, reason=str(refusal))
        deleted = {change.name for change in changes} - changed.keys()
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


class Makers(NamedTuple):
    """Functions that make the node of a cable, and one of its name that can report why it ended."""

    cable: Callable[[], CableNode]
    bare: Callable[[], GuardedNode]

    def keep_saying(self, reason: str, running: Sequence[str]) -> None:
        """Publish the reason for the end once a second, as long as other cables run."""
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
    """Functions that make the node of each cable, by its name in `cables`, or of the only one.

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
    listed = check_value(_CABLES, values.get(_CABLES.key, []))
    names = [str(name) for name in listed]  # type: ignore[union-attr]
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
    """The node of one of several cables: its scene, changed by shared and by its own parameters.

    Raises SceneError if there is no scene, it cannot be read, or ROS refuses the node.
    """
    prefix = f"{name}."
    own = {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}
    scene = check_value(_SCENE, own.pop(_SCENE.key, ""))
    scene_values = scene_file_values(str(scene)) if scene else {}
    merged = overridden(scene_values, {**shared, **own})
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


def run_cables(makers: dict[str, Makers]) -> int:
    """Run every cable in a thread of its own, so that none waits for another; the worst status."""
    running = list(makers)
    sys.setswitchinterval(_SWITCH_INTERVAL)
    with ThreadPoolExecutor(len(makers)) as pool:
        ends = [pool.submit(_run_cable, name, makers[name], running) for name in makers]
    return max(end.result() for end in ends)


def _run_cable(name: str, makers: Makers, running: list[str]) -> int:
    """Run a cable until a signal or its failure, which is in /diagnostics as long as others run.

    Args:
        name: for messages. running: the names of all that run; this one removes itself.
    """
    status, failure = FAILED, None
    node: CableNode | None = None
    try:
        node = makers.cable()
        node.start()
        _spin(node)
        failure = node.failure
    except SceneError as refusal:
        status, failure = REFUSED, one_line(refusal)
    except Exception:
        traceback.print_exc()
        failure = "an error of the program, see above"
    finally:
        running.remove(name)
        if not running:
            stopping.disable_forced_exit()
        if node is not None:
            node.end()
            node.destroy_node()
    if failure is None:
        return DONE
    # A single write, since several cables may end at once.
    label = f"{'error: ' if status == REFUSED else ''}{name}{': ' if name else ''}"
    sys.stderr.write(f"dlo_sim: {label}{failure}\n")
    makers.keep_saying(failure, running)
    return status


def _spin(node: CableNode) -> None:
    """Run callbacks until a signal or until the cable gives up."""
    executor = new_executor()
    executor.add_node(node)
    try:
        # Objects of the start-up stay; the collector need not visit them during a tick.
        gc.collect()
        gc.freeze()
        while not stopping.requested() and node.failure is None:
            executor.spin_once(timeout_sec=_LONGEST_SPIN)
    finally:
        executor.shutdown()


def new_executor() -> Executor:
    """The events executor, which needs a third of the processor time, or else the usual one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:  # an older rclpy of the same distribution
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor()
    return EventsExecutor()
