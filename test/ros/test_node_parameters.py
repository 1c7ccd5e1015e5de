"""Parameters of the running node: described, changed as a whole, refused with a reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, WrenchStamped
from node_harness import CABLE, START, NodeProcess, Peer
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter

from dlo_sim.scene.description import scene_parameters
from dlo_sim.scene.loading import scene_from_values, scene_values
from dlo_sim.simulation.simulator import Simulator

ROWS = {row.key: row for row in scene_parameters(("tip", "force"))}
TYPES = {
    "double": ParameterType.PARAMETER_DOUBLE,
    "integer": ParameterType.PARAMETER_INTEGER,
    "bool": ParameterType.PARAMETER_BOOL,
    "string": ParameterType.PARAMETER_STRING,
    "double_array": ParameterType.PARAMETER_DOUBLE_ARRAY,
    "bool_array": ParameterType.PARAMETER_BOOL_ARRAY,
    "string_array": ParameterType.PARAMETER_STRING_ARRAY,
}


@pytest.fixture(scope="module", autouse=True)
def node(running: Callable[..., NodeProcess]) -> NodeProcess:
    return running(CABLE)


@pytest.fixture(autouse=True)
def same_afterwards(peer: Peer) -> Any:
    """Whatever a test changes is put back."""
    yield
    values = {k: v for k, v in scene_values(scene_from_values(CABLE)).items() if changeable(k, v)}
    assert peer.set(values).successful


def changeable(key: str, value: object) -> bool:
    return not ROWS[key].read_only


def count_of_points(peer: Peer) -> Callable[[], int]:
    received = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    return lambda: len(received[-1].poses) if received else 0


def test_a_type_that_there_is_not_is_refused(peer: Peer) -> None:
    value = ParameterValue(type=72, double_value=2.0)
    request = SetParametersAtomically.Request(
        parameters=[ParameterMessage(name="cable.length", value=value)]
    )
    name = "/dlo_sim/set_parameters_atomically"
    result = peer.call(SetParametersAtomically, name, request).result
    assert not result.successful
    assert "cable.length: no value given" in result.reason


def test_the_whole_table_is_declared_with_the_scene_s_values(peer: Peer) -> None:
    listed = peer.call(ListParameters, "/dlo_sim/list_parameters", ListParameters.Request())
    assert set(ROWS) <= set(listed.result.names)
    expected = scene_values(scene_from_values(CABLE))
    values = dict(zip(ROWS, peer.get(*ROWS), strict=True))
    assert values == expected


def test_every_parameter_is_described(peer: Peer) -> None:
    request = DescribeParameters.Request(names=list(ROWS))
    described = peer.call(DescribeParameters, "/dlo_sim/describe_parameters", request).descriptors
    assert len(described) == len(ROWS) > 50
    for row, found in zip(ROWS.values(), described, strict=True):
        assert found.name == row.key
        assert found.type == TYPES[row.kind]
        assert row.description in found.description
        assert row.unit in found.description
        assert found.read_only == row.read_only
        assert all(str(choice) in found.additional_constraints for choice in row.choices)
        if row.kind == "double":
            (limits,) = found.floating_point_range
            low = row.low if row.auto is None else min(row.low, row.auto)
            assert (limits.from_value, limits.to_value) == (low, row.high)
        if row.kind == "integer":
            (limits,) = found.integer_range
            assert (limits.from_value, limits.to_value) == (row.low, row.high)


def test_a_change_takes_effect(peer: Peer) -> None:
    points = count_of_points(peer)
    peer.until(lambda: points() == 7, "7 control points")
    assert peer.set({"discretization.control_points": 9}).successful
    peer.until(lambda: points() == 9, "9 control points")


def test_diagnostics_name_the_terms_that_the_simulator_has_and_warn_of_those_it_lacks(
    peer: Peer, node: NodeProcess
) -> None:
    for weight in ("auto", "off"):
        assert peer.set({"terms.gravity": weight}).successful
        expected = Simulator(scene_from_values({**CABLE, "terms.gravity": weight}))
        left_out = [f"{name}: {reason}" for name, reason in expected.left_out.items()]
        found = peer.status(
            "/dlo_sim: session",
            lambda values, status, lines=left_out: values["left out"] == "; ".join(lines),
            f"what is left out with terms.gravity {weight}",
        )
        assert found["active terms"] == ", ".join(expected.active_terms)
        assert found["warnings"] == "; ".join(expected.warnings)
    (warning,) = expected.warnings
    logged = [line for line in node.output.splitlines() if warning in line]
    assert len(logged) == 1 and "[WARN]" in logged[0]


def test_an_integer_is_a_number_and_on_is_a_text(peer: Peer) -> None:
    result = peer.set({"cable.density": 1300, "gravity": [0, 0, -5], "terms.bend": True})
    assert result.successful, result.reason
    assert peer.get("cable.density", "gravity", "terms.bend") == [1300.0, [0.0, 0.0, -5.0], "on"]


def test_several_parameters_are_judged_as_a_whole(peer: Peer) -> None:
    """Neither of these is possible alone with the other's old value."""
    both = {"discretization.quadrature": "uniform", "discretization.samples": 40}
    for key, value in both.items():
        result = peer.set({key: value})
        assert not result.successful
        assert "discretization.samples" in result.reason
    result = peer.set(both)
    assert result.successful, result.reason
    assert peer.get(*both) == list(both.values())


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"cable.density": float("nan")}, "cable.density"),
        ({"loads.names": ["tip"]}, "loads.names"),
        ({"frame_id": "map"}, "frame_id"),
        ({"integrator.method": "forest_ruth"}, "integrator.method"),
    ],
)
def test_a_bad_change_is_refused_and_changes_nothing(
    peer: Peer, bad: dict[str, Any], named: str
) -> None:
    good = {"cable.diameter": 0.009, "discretization.control_points": 11}
    before = peer.get(*good)
    result = peer.set({**good, **bad})
    assert not result.successful
    assert named in result.reason
    assert "\n" not in result.reason
    assert peer.get(*good) == before
    points = count_of_points(peer)
    assert peer.until(points, "control points") == 7


def test_one_by_one_each_has_its_own_answer(peer: Peer) -> None:
    """`ros2 param set` and `ros2 param load` use this service."""
    values = {"cable.lenght": 2.0, "cable.density": 1300, "terms.bend": 3.5, "cable.length": 1.1}
    request = SetParameters.Request(
        parameters=[Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
    )
    answers = peer.call(SetParameters, "/dlo_sim/set_parameters", request, START).results
    assert [answer.successful for answer in answers] == [False, True, False, True]
    assert "did you mean cable.length?" in answers[0].reason
    assert "terms.bend" in answers[2].reason
    assert peer.get("cable.density", "cable.length") == [1300.0, 1.1]


def test_an_end_that_is_let_go_has_no_reaction_topic(peer: Peer) -> None:
    def advertised() -> bool:
        return bool(peer.node.count_publishers("/dlo_sim/end/reaction"))

    assert not advertised()
    fixed = {"end.fixed": [True, True, True], "end.position": [0.9, 0.0, 0.0]}
    assert peer.set(fixed).successful
    peer.until(advertised, "a reaction topic of the end")
    received = peer.collect(WrenchStamped, "/dlo_sim/end/reaction")
    peer.until(lambda: received, "a reaction of the end")
    assert peer.set({"end.fixed": [False, False, False]}).successful
    peer.until(lambda: not advertised(), "the end of the topic")


def test_the_node_ticks_at_another_rate_once_it_is_set(peer: Peer) -> None:
    assert peer.set({"rate": 50.0}).successful
    peer.status(
        "/dlo_sim: node",
        lambda values, status: 30.0 < float(values["tick rate [Hz]"]) < 70.0,
        "about 50 ticks per second",
    )


def test_parameters_of_rclpy_are_left_alone(peer: Peer) -> None:
    assert peer.get("use_sim_time") == [False]
    change = Parameter("use_sim_time", Parameter.Type.BOOL, False)
    assert peer.set({change.name: change.value}).successful
