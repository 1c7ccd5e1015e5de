"""Names on the wire: those of a node that nothing renames, or what a node says."""

from __future__ import annotations

import pytest
from fake_simulator import FakeSimulator
from rosbags.typesys import Stores, get_typestore

from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.topics import Naming

STORE = get_typestore(Stores.ROS2_JAZZY)
HELD = {"start.pose_topic": "~/start/pose", "loads.names": ["tip"]}


def session_of(values: dict, node: str, remapped: dict[str, str]) -> Session:
    naming = Naming(node, lambda topic: remapped.get(topic, topic.replace("~", node, 1)))
    return Session(
        scene_from_values({"accuracy.estimate": "off", **values}), FakeSimulator, naming=naming
    )


def test_a_session_speaks_of_topics_as_they_are_listened_to() -> None:
    session = session_of(HELD, "/left/cable", {"~/start/pose": "/arm/pose"})
    assert [entry.topic for entry in session.inputs] == ["/arm/pose", "/left/cable/tip/wrench"]
    assert session.tick(10**9).message == "waiting for the first pose on /arm/pose"
    message = STORE.deserialize_cdr(session.diagnostics(10**9), cdr.DIAGNOSTIC_ARRAY)
    assert [status.name for status in message.status] == [
        "/left/cable: session",
        "/left/cable: input /arm/pose",
        "/left/cable: input /left/cable/tip/wrench",
    ]
    assert {status.hardware_id for status in message.status} == {"/left/cable"}


def test_two_inputs_remapped_to_one_topic_are_both_driven() -> None:
    values = {"start.pose_topic": "/a", "end.pose_topic": "/b", "end.fixed": [True] * 3}
    session = session_of(values, "/dlo_sim", {"/b": "/a"})
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world").encode(10**9, (0, 0, 0, 0, 0, 0, 1))
    session.receive("/a", pose, 10**9)
    assert session.journal.accepted == 1
    assert session.tick(10**9 + 10**8).message == "waiting for the next pose on /a"
    assert session.started


def test_one_topic_cannot_carry_two_types() -> None:
    with pytest.raises(SceneError, match=r"/x: stands for ~/start/pose .* and for ~/tip/wrench"):
        session_of(HELD, "/dlo_sim", {"~/start/pose": "/x", "~/tip/wrench": "/x"})


def test_nor_can_one_that_is_put_out_once_an_end_is_held() -> None:
    with pytest.raises(SceneError, match=r"/x: stands for ~/tip/wrench .* and for ~/centerline"):
        session_of(HELD, "/dlo_sim", {"~/tip/wrench": "/x", "~/centerline": "/x"})
    with pytest.raises(SceneError, match=r"stands for ~/end/reaction .* and for /diagnostics"):
        session_of(HELD, "/dlo_sim", {"~/end/reaction": "/diagnostics"})
