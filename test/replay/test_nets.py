"""A bag through a net: the bits of the session, and its reactions compared."""

import pytest
from bag_files import contents, write_bag
from harness import TOPICS, feed, harness, told

from dlo_sim.replay.replay import replay_bag
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.topics import resolved


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """A replay, with a wrist that feels the opposite of a reaction of 1 N."""
    folder = tmp_path_factory.mktemp("net")
    wrist = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    found = told()
    felt = [("/wrist", time, wrist.encode(time, (0, 0, 1.0, 0, 0, 0))) for _, time, _ in found[::3]]
    messages = sorted([*found, *felt], key=lambda one: one[1])
    bag = write_bag(folder / "recorded", messages, {**TOPICS, "/wrist": cdr.WRENCH_STAMPED})
    return replay_bag(bag, harness(), folder / "out", compare={"a.end": "/wrist"}), folder / "out"


def test_replay_has_the_bits_of_the_session(replayed):
    summary, out = replayed
    assert summary.ok and summary.messages_refused == 0
    found, messages = contents(out), feed(Session(harness()))
    topics = {one.topic for one in messages}
    assert {"~/branches/a/control_points", "~/connectors/plug/pose", "~/centerline"} <= topics
    for topic in topics:
        own = [one.data for one in messages if one.topic == topic]
        assert [data for _, data in found[resolved(topic)]][: len(own)] == own, topic
        assert len(own) > 10


def test_reaction_at_the_end_of_a_branch_is_compared(replayed):
    summary, out = replayed
    wrenches = contents(out)["/dlo_sim/branches/a/end/reaction"]
    pulls = [cdr.decode(cdr.WRENCH_STAMPED, data).values[2] for _, data in wrenches]
    (row,) = (one for one in summary.comparison["a.end"] if one.axis == "z")
    assert row.samples == 49  # what the robot feels is the opposite of what the cable feels
    assert row.bias == pytest.approx(sum(pulls) / len(pulls) + 1.0, abs=0.01)
