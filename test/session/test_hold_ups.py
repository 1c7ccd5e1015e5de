"""Hold-ups, clocks that are set and bags that loop are over after the latency and a second."""

import pytest
from disturbances import Case, World, random_case

# `python test/session/disturbances.py 2000` plays many more.
CASES = {
    "stopped for 5 s, a queue runs over": Case("node", 1.0, 5.0, tick_first=True, epoch=1e6),
    "stopped before the first message": Case("node", 0.0, 3.0),
    "stopped, /clock is heard last": Case("node", 1.0, 5.0, sim_time=True, clock_first=False),
    "one topic": Case("topic", 1.0, 4.0, difference=0.3),
    "one topic, from the beginning": Case("topic", 0.0, 3.0, difference=-0.3),
    "both topics": Case("both", 1.0, 2.0, difference=-0.3, epoch=1e6),
    "stopped before the second message of a topic": Case("node", 0.03, 2.0, unstamped=True),
    "a queue that empties": Case("drain", 1.0, 5.0, unstamped=True),
    "a queue that empties, from the beginning": Case("drain", 0.0, 5.0, epoch=1e6),
    "a queue that empties, mode stamp": Case("drain", 1.0, 5.0, mode="stamp"),
    "stopped, mode stamp": Case("node", 1.0, 5.0, mode="stamp"),
    "a queue that empties, mode arrival": Case("drain", 1.0, 5.0, mode="arrival", jitter=0.0),
    "all clocks an hour back": Case("clocks", 1.0, jump=-3600.0),
    "all clocks an hour forward": Case("clocks", 1.0, jump=3600.0, difference=0.3),
    "the node's clock an hour back": Case("node_clock", 1.0, jump=-3600.0),
    "the node's clock an hour forward": Case("node_clock", 1.0, jump=3600.0),
    "the node's clock an hour forward, loads unstamped": Case(
        "node_clock", 1.0, jump=3600.0, unstamped=True
    ),
    "all clocks an hour forward, mode arrival": Case(
        "clocks", 1.0, jump=3600.0, mode="arrival", jitter=0.0
    ),
    "the sources' clocks an hour forward": Case("source_clocks", 1.0, jump=3600.0),
    "the sources' clocks 0.7 s forward": Case("source_clocks", 1.0, jump=0.7, difference=0.3),
    "a bag loops": Case("loop", 2.0),
    "a bag loops with /clock": Case("loop", 2.0, sim_time=True, difference=-0.3),
    "a stamp of another century": Case("nonsense", 1.0, jump=4e8),
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_over_soon(name):
    world = World(CASES[name])
    world.play()
    assert world.problems() == []


@pytest.mark.parametrize("seed", range(6))
def test_a_random_disturbance_is_over_as_soon(seed):
    world = World(random_case(seed))
    world.play()
    assert world.problems() == [], world.case


def test_mode_stamp_shifts_nothing():
    """Clocks that come to differ: all is refused, nothing is guessed."""
    world = World(Case("node_clock", 1.0, jump=-3600.0, mode="stamp"))
    world.play()
    assert world.session.offset_ns == 0
    assert world.session.journal.refused["in_future"] > 500
    assert not world.session.started


@pytest.mark.parametrize("tick_first", [True, False])
def test_what_has_waited_is_simulated_and_not_skipped(tick_first):
    """The queues hold 2 s of poses: after 1.5 s nothing is missing, so nothing is left out."""
    world = World(Case("node", 1.0, 1.5, tick_first=tick_first, seed=3))
    world.play()
    journal = world.session.journal
    assert journal.skipped_ns == 0 and not journal.events
    assert world.problems() == []
