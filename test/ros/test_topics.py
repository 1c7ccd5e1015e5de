"""What the node computes: only what somebody listens to, markers at their own rate."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from node_harness import HELD

from dlo_sim.ros.topics import CONTROL_POINTS, MARKERS, Outputs
from dlo_sim.scene.loading import scene_from_values

SECOND = 1_000_000_000
SCENE = scene_from_values(HELD | {"outputs.marker_rate": 10.0})
REACTION = "~/start/reaction"


class FakePublisher:
    def __init__(self) -> None:
        self.listeners = 0

    def get_subscription_count(self) -> int:
        return self.listeners


class FakeNode:
    def __init__(self) -> None:
        self.publishers_of: dict[str, FakePublisher] = {}

    def create_publisher(self, message_type: type, topic: str, qos: Any) -> FakePublisher:
        return self.publishers_of.setdefault(topic, FakePublisher())


@pytest.fixture
def node() -> FakeNode:
    return FakeNode()


@pytest.fixture
def outputs(node: FakeNode) -> Outputs:
    return Outputs(node, SCENE)


def test_nothing_is_wanted_while_nobody_listens(outputs: Outputs) -> None:
    assert outputs.wanted(0, True) == set()


@pytest.mark.parametrize("topic", [CONTROL_POINTS, REACTION, *MARKERS])
def test_what_somebody_listens_to_is_wanted_while_he_does(
    outputs: Outputs, node: FakeNode, topic: str
) -> None:
    assert outputs.wanted(0, True) == set()
    node.publishers_of[topic].listeners = 1
    assert outputs.wanted(1 * SECOND, True) == {topic}
    node.publishers_of[topic].listeners = 0
    assert outputs.wanted(2 * SECOND, True) == set()


@pytest.mark.parametrize("topic", [CONTROL_POINTS, REACTION])
def test_a_known_state_is_for_those_who_begin_to_listen(
    outputs: Outputs, node: FakeNode, topic: str
) -> None:
    publisher = node.publishers_of[topic]
    publisher.listeners = 1
    assert outputs.wanted(0, False) == {topic}
    assert outputs.wanted(1, False) == set()
    assert outputs.wanted(2, True) == {topic}
    publisher.listeners = 2
    assert outputs.wanted(3, False) == {topic}
    publisher.listeners = 1
    assert outputs.wanted(4, False) == set()


def test_markers_which_expire_are_renewed(outputs: Outputs, node: FakeNode) -> None:
    for topic in MARKERS:
        node.publishers_of[topic].listeners = 1
    wanted = [outputs.wanted(k * SECOND // 100, False) for k in range(100)]
    assert sum(topics == set(MARKERS) for topics in wanted) == 10


def test_markers_come_at_their_own_rate(outputs: Outputs, node: FakeNode) -> None:
    for topic in (CONTROL_POINTS, *MARKERS):
        node.publishers_of[topic].listeners = 2
    wanted = [outputs.wanted(SECOND + k * SECOND // 100, True) for k in range(100)]
    assert all(CONTROL_POINTS in topics for topics in wanted)
    assert [sum(marker in topics for topics in wanted) for marker in MARKERS] == [10, 10]
