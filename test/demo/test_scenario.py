"""The demo's own input: seeded, in order, at the rates it promises, from rest to rest."""

import numpy as np
import pytest

from dlo_sim.demo import scenario
from dlo_sim.scene.loading import load_scene
from dlo_sim.session import cdr
from dlo_sim.session.topics import input_topics


@pytest.fixture(scope="module")
def found() -> list[scenario.Message]:
    return list(scenario.messages(2.0))


def stamps(found, topic: str) -> np.ndarray:
    kind = scenario.TOPICS[topic]
    return np.array([cdr.decode(kind, m.data).stamp_ns for m in found if m.topic == topic])


def test_same_seed_same_bytes_other_seed_others(found):
    assert list(scenario.messages(2.0)) == found
    assert list(scenario.messages(2.0, seed=1)) != found


@pytest.mark.parametrize(("topic", "rate"), [("/gripper_pose", 100), ("/hand_wrench", 200)])
def test_stamps_keep_their_rate(found, topic, rate):
    times = stamps(found, topic)
    assert len(times) == 2 * rate + 1
    assert times[0] == scenario.EPOCH_NS
    assert set(np.diff(times)) == {1_000_000_000 // rate}


def test_messages_arrive_in_order_and_late(found):
    arrivals = [message.time_ns for message in found]
    assert arrivals == sorted(arrivals)
    for topic in scenario.TOPICS:
        mine = np.array([m.time_ns for m in found if m.topic == topic])
        delays = mine - stamps(found, topic)
        assert delays.min() > 0
        assert 1e6 < delays.mean() < 5e6 and delays.max() < 5e7, "milliseconds, below the latency"


def test_gripper_moves_and_turns_from_rest_to_rest():
    t = np.linspace(0.0, scenario.DURATION, 801)
    position, orientation = scenario.gripper_pose(t)
    np.testing.assert_allclose(np.linalg.norm(orientation, axis=1), 1.0, atol=1e-12)
    for rows in (position, orientation):
        assert np.ptp(rows, axis=0).max() > 0.3
        bends = np.diff(rows, 2, axis=0) / (t[1] - t[0]) ** 2
        assert np.abs(bends).max() < 10.0, "no jump of the velocity, m/s^2"
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / (t[1] - t[0])
    assert 0.3 < speed.max() < 2.0


def test_hand_pulls_only_for_a_while():
    t = np.linspace(0.0, scenario.DURATION, 801)
    force = np.linalg.norm(scenario.hand_wrench(t)[:, :3], axis=1)
    begin, end = scenario.PULL
    assert force[(t <= begin) | (t >= end)].max() < 1e-12
    assert 0.1 < force.max() < 2.0


def test_scene_listens_to_what_the_demo_publishes(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(scenario.SCENE)
    found = {entry.topic: entry.type for entry in input_topics(load_scene(path))}
    assert found == scenario.TOPICS
