"""The scene as the parameters of a node: declared from the table, changed as a whole or not at all.

A change is checked by building the whole scene that results, so the node refuses at run time what
the offline commands refuse, with the same line.
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter as NodeParameter
from rclpy.qos import QoSPolicyKind

from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.topics import INPUT_POLICIES, OUTPUT_POLICIES
from dlo_sim.scene.description import Scene, parameters_of_scene, scene_parameters
from dlo_sim.scene.loading import SceneError, scene_from_values, scene_values
from dlo_sim.scene.parameter import Parameter, check_value, unknown_key
from dlo_sim.scene.refusal import nearest, one_line, shown
from dlo_sim.session.drive import Prepared

_TYPES = {
    "double": NodeParameter.Type.DOUBLE,
    "integer": NodeParameter.Type.INTEGER,
    "bool": NodeParameter.Type.BOOL,
    "string": NodeParameter.Type.STRING,
    "double_array": NodeParameter.Type.DOUBLE_ARRAY,
    "bool_array": NodeParameter.Type.BOOL_ARRAY,
    "string_array": NodeParameter.Type.STRING_ARRAY,
}
_LARGEST_INTEGER = 2**63 - 1
# What a user may override of a topic's QoS, and the values that every ROS middleware knows.
_QOS_POLICIES = {
    QoSPolicyKind.HISTORY: Parameter("", "string", "", choices=("keep_last", "keep_all")),
    QoSPolicyKind.DEPTH: Parameter("", "integer", 1, low=1, high=2**31 - 1),
    QoSPolicyKind.RELIABILITY: Parameter("", "string", "", choices=("best_effort", "reliable")),
    QoSPolicyKind.DURABILITY: Parameter("", "string", "", choices=("volatile", "transient_local")),
}


class ParameterRefused(ParameterNotDeclaredException):
    """A parameter that cannot be set, with a reason of our own.

    rclpy's parameter services answer with the text of exceptions of its base class only.
    """

    def __init__(self, reason: str) -> None:
        super().__init__([])
        self._reason = reason

    def __str__(self) -> str:
        return self._reason


class SceneParameters:
    """Declares the parameters of a scene on a node, and keeps the `scene` that they describe."""

    def __init__(self, node: GuardedNode, read_only: bool = True) -> None:
        """Read the node's overrides (params files, -p), check them, declare all parameters.

        Args:
            read_only: declare constant parameters so; rclpy cannot undeclare them.

        Raises:
            SceneError: an override that is unknown, of a wrong type, or an impossible scene.
        """
        self._node = node
        self.scene = scene_from_overrides(node)
        rows = parameters_of_scene(self.scene)
        self._fixed = set() if read_only else {row.key for row in rows if row.read_only}
        self._rows = {r.key: replace(r, read_only=r.read_only and read_only) for r in rows}
        values = scene_values(self.scene)
        for key, row in self._rows.items():
            _declare(node, row, values[key])
        self._prepared: tuple[Scene, Prepared] | None = None
        self._following = False

    def take_over(self, scene: Scene) -> None:
        """Show the values of a scene that has come about otherwise."""
        old, new = scene_values(self.scene), scene_values(scene)
        self.scene = scene  # so that nothing is prepared for it
        for key, value in new.items():
            if value != old[key]:
                kind = _TYPES[self._rows[key].kind]
                self._node.set_parameters([NodeParameter(key, kind, _node_value(value))])

    def follow(
        self,
        prepare: Callable[[Scene], Prepared],
        adopt: Callable[[Scene, Prepared], None],
    ) -> None:
        """Accept changes from now on.

        Args:
            prepare: builds what the new scene needs and changes nothing; a ValueError refuses the
                change.
            adopt: installs the result of `prepare` between two ticks; must not fail.
        """
        self._prepare = prepare
        self._adopt = adopt
        self._following = True
        self._node.add_pre_set_parameters_callback(self._convert)
        self._node.add_on_set_parameters_callback(self._judge)
        self._node.add_post_set_parameters_callback(self._apply)

    def close(self) -> None:
        """Return the present values to the node's overrides; undeclare those that are not
        read-only.
        """
        if self._following:
            self._node.remove_pre_set_parameters_callback(self._convert)
            self._node.remove_on_set_parameters_callback(self._judge)
            self._node.remove_post_set_parameters_callback(self._apply)
        overrides, values = self._node.overrides, scene_values(self.scene)
        for key, row in self._rows.items():
            if not row.read_only:
                self._node.undeclare_parameter(key)
            if key in overrides or values[key] != _node_value(row.default):
                overrides[key] = values[key]

    def _convert(self, changes: list[NodeParameter]) -> list[NodeParameter]:
        """Give each value the declared type: 5 for 5.0, `on` read as true, an empty list.

        Raises ParameterRefused for an unknown parameter or a value of another type.
        """
        return [self._converted(change) for change in changes]

    def _converted(self, change: NodeParameter) -> NodeParameter:
        row = self._rows.get(change.name)
        if row is None:
            if self._node.has_parameter(change.name):
                return change
            raise ParameterRefused(str(unknown_key(change.name, change.value, self._rows)))
        if change.name in self._fixed:
            raise ParameterRefused(
                f"{change.name}: cannot change while the node is configured; clean it up first"
            )
        try:
            value = check_value(row, _plain(change.value))
        except SceneError as error:
            raise ParameterRefused(str(error)) from None
        return NodeParameter(row.key, _TYPES[row.kind], _node_value(value))

    def _judge(self, changes: list[NodeParameter]) -> SetParametersResult:
        """Refuse a set of changes that does not lead to a possible scene, with the reason."""
        self._prepared = None
        values = {c.name: _plain(c.value) for c in changes if c.name in self._rows}
        if not values:
            return SetParametersResult(successful=True)
        try:
            scene = self.scene.with_values(values)
            if scene != self.scene:
                self._prepared = scene, self._prepare(scene)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=one_line(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[NodeParameter]) -> None:
        """Adopt the scene that was judged possible; rclpy has stored the values by now."""
        if self._prepared is not None:
            scene, prepared = self._prepared
            self._prepared = None
            self.scene = scene
            self._adopt(scene, prepared)


def scene_from_overrides(node: GuardedNode) -> Scene:
    """The scene of the node's params files and -p arguments, without the parameters of rclpy
    itself.

    Raises SceneError: one line with the key, the value and the cure.
    """
    table = {row.key: row for row in scene_parameters()}
    values: dict[str, object] = {}
    for name, override in node.overrides.items():
        if node.has_parameter(name) or name.startswith("qos_overrides."):
            continue
        value = _plain(override)
        # rcl keeps the name of a parameter given as [] but neither value nor type.
        empty_list = value is None and name in table and table[name].is_array
        values[name] = [] if empty_list else value
    return scene_from_values(values)


def check_qos_overrides(node: GuardedNode, inputs: Iterable[str], outputs: Iterable[str]) -> None:
    """Raise SceneError for `qos_overrides` that rclpy would ignore or raise on.

    Args:
        inputs, outputs: topics by their resolved names.
    """
    entities = [(topic, "subscription", INPUT_POLICIES) for topic in inputs]
    entities += [(topic, "publisher", OUTPUT_POLICIES) for topic in outputs]
    rows = {
        f"qos_overrides.{topic}.{entity}.{policy.name.lower()}": _QOS_POLICIES[policy]
        for topic, entity, policies in entities
        for policy in policies
    }
    for name, override in node.overrides.items():
        if not name.startswith("qos_overrides."):
            continue
        if name not in rows:
            raise SceneError(
                f"{name}: overrides nothing of this scene{nearest(name, rows)}; give history, "
                "depth or reliability of an input's subscription, or depth, reliability or "
                "durability of an output's publisher, by the topic's full name"
            )
        check_value(replace(rows[name], key=name), _plain(override))


def descriptor(row: Parameter) -> ParameterDescriptor:
    """What ROS tells people about a parameter: description with unit, range, choices, read-only."""
    unit = f" [{row.unit}]" if row.unit else ""
    described = ParameterDescriptor(
        name=row.key,
        description=row.description + unit,
        additional_constraints=_constraints(row),
        read_only=row.read_only,
    )
    if row.low is None and row.high is None:
        return described
    limit = _LARGEST_INTEGER if row.kind == "integer" else sys.float_info.max
    low = -limit if row.low is None else row.low
    low = low if row.auto is None else min(low, row.auto)  # a descriptor holds one range
    high = limit if row.high is None else row.high
    if row.kind == "double":
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif row.kind == "integer":
        described.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return described


def _constraints(row: Parameter) -> str:
    """What a range descriptor cannot hold: choices, element count, range of the elements."""
    parts = []
    if row.length is not None:
        parts.append(f"{row.length} values")
    if row.choices:
        parts.append(f"one of {row.allowed}")
    elif row.is_array and row.allowed:
        parts.append(f"each {row.allowed}")
    parts.append(f"default {shown(row.default)}")
    return "; ".join(parts)


def _declare(node: GuardedNode, row: Parameter, value: Any) -> None:
    """Declare one parameter with its checked value.

    The override has been read already: rclpy would refuse 5 for 5.0 here. An empty list has no type
    for rclpy, so it is set after a declaration by type, and made read-only last.
    """
    described = descriptor(row)
    if value != []:
        node.declare_parameter(row.key, value, described, ignore_override=True)
        return
    described.read_only = False
    kind = _TYPES[row.kind]
    node.declare_parameter(row.key, kind, described, ignore_override=True)
    node.set_parameters([NodeParameter(row.key, kind, [])])
    if row.read_only:
        described = descriptor(row)
        described.type = kind.value
        node.set_descriptor(row.key, described)


def _plain(value: Any) -> Any:
    """A parameter's value without array types: list, number, text or None."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value


def _node_value(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
