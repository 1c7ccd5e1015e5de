"""Whom the node publishes for."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from node_harness import HELD

from dlo_sim.ros.topics import Publishers
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session.topics import CONTROL_POINTS, MARKERS

SCENE = scene_from_values(
    {**HELD, "outputs.capsules": 3, "forecast.processes": 1, "obstacles.names": ["floor"]}
)
REACTION = "~/start/reaction"


class FakePublisher:
    def __init__(self) -> None:
        self.listeners = 0

    def get_subscription_count(self) -> int:
        return self.listeners


class FakeNode:
    def __init__(self) -> None:
        self.publishers_of: dict[str, FakePublisher] = {}

    def create_publisher(self, message_type: type, topic: str, *_: Any, **__: Any) -> FakePublisher:
        return self.publishers_of.setdefault(topic, FakePublisher())


@pytest.fixture
def node() -> FakeNode:
    return FakeNode()


@pytest.fixture
def outputs(node: FakeNode) -> Publishers:
    return Publishers(node, SCENE)


def test_nobody_reads(outputs: Publishers) -> None:
    assert outputs.readers() == (set(), set())


@pytest.mark.parametrize("topic", [CONTROL_POINTS, REACTION, *MARKERS])
def test_who_reads_and_who_has_begun_to(outputs: Publishers, node: FakeNode, topic: str) -> None:
    publisher = node.publishers_of[topic]
    for count, joined in ((1, {topic}), (1, set()), (2, {topic}), (1, set())):
        publisher.listeners = count
        assert outputs.readers() == ({topic}, joined)
    publisher.listeners = 0
    assert outputs.readers() == (set(), set())
