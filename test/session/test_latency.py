"""Slow, irregular and late poses: all states are published, or one line says what is needed."""

import re

import numpy as np
import pytest
from session_bench import GRIPPER, MS, SECOND, T0, Bench, motion

from dlo_sim.session import cdr
from dlo_sim.session.pacing import PoseTiming

TICK = 5 * MS
TWO = {**GRIPPER, "end.pose_topic": "/end_pose", "end.fixed": [True] * 3}


def play(stamps, delay=2 * MS, values=GRIPPER, other=None, jitter=0.0, every_ns=1, **changes):
    """Poses with these stamps [s], each so late and only at multiples of a time; returns bench and
    the stamps published [ns].
    """
    bench = Bench(values, **changes)
    rng = np.random.default_rng(1)
    topics = {"/gripper_pose": stamps} | ({"/end_pose": other} if other is not None else {})
    arrivals = sorted(
        (
            -(-(T0 + round(t * SECOND) + delay + int(rng.uniform(0, jitter) * SECOND)) // every_ns)
            * every_ns,
            topic,
            t,
        )
        for topic, times in topics.items()
        for t in times
    )
    published = []
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    for now in range(T0, arrivals[-1][0] + bench.session.latency_ns, TICK):
        while arrivals and arrivals[0][0] <= now:
            arrival, topic, t = arrivals.pop(0)
            stamp = T0 + round(t * SECOND)
            position = np.array(motion(stamp)) + [0.0, 0.0, topic == "/end_pose"]
            bench.session.receive(topic, encoder.encode(stamp, (*position, 0, 0, 0, 1)), arrival)
        bench.session.tick(now)
        published += [m.stamp_ns for m in bench.session.messages(["~/control_points"])]
    return bench, published


def share(published, begin=0.0, end=np.inf):
    """Published states of those due between two times [s] after the first."""
    first = published[0]
    last = min(published[-1], first + end * SECOND)
    own = [s for s in published if first + begin * SECOND <= s <= last]
    return len(own) / ((last - first - begin * SECOND) / TICK)


def every(interval, seconds=8.0, begin=0.0):
    return np.arange(begin, begin + max(seconds, 8 * interval), interval)


@pytest.mark.parametrize("rate", [1.0, 3.0, 8.0, 20.0, 30.0, 100.0])
def test_all_states_are_published_at_any_rate(rate):
    bench, published = play(every(1 / rate, 12.0), **{"start.pose_timeout": 1.001})
    assert set(np.diff(published)) == {TICK}
    seconds = max(12.0, 8 / rate)
    assert published[-1] - published[0] > (seconds - 2.6 / rate - 0.2) * SECOND
    latency = bench.session.latency_ns / SECOND
    assert max(0.06, 1.5 / rate) <= latency <= max(0.06, 1.5 / rate + 0.02)
    if latency == 0.06:
        assert not bench.events
    else:
        assert bench.events == {"slow_poses": 1}
        assert f"outputs are {latency:g} s late" in bench.session.journal.last_event
    assert f"{latency:.3f}".encode() in bench.session.diagnostics(T0 + 20 * SECOND)


@pytest.mark.parametrize("rate", [5.0, 30.0])
def test_irregular_poses_and_dropouts(rate):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.5, 1.5, size=round(20 * rate)) / rate)
    times = times[rng.uniform(size=len(times)) > 0.1]
    _, published = play(times - times[0])
    assert share(published) > 0.95


@pytest.mark.parametrize("delay", [0.05, 0.4])
@pytest.mark.parametrize("rate", [5.0, 30.0])
def test_poses_that_are_always_late(rate, delay):
    """A camera that thinks; at the beginning the delay is not known yet."""
    bench, published = play(every(1 / rate, 15.0), round(delay * SECOND), jitter=0.02)
    assert share(published, begin=3.0) > 0.99
    need = delay + 1.5 / rate
    assert need <= bench.session.latency_ns / SECOND <= need + 0.05


@pytest.mark.parametrize("burst", [0.1, 0.5])
def test_poses_that_always_come_in_bursts(burst):
    """A network that collects messages: the newest of each burst is hardly late."""
    bench, published = play(every(0.01, 20.0), every_ns=round(burst * SECOND))
    assert share(published, begin=10 * burst + 1.0) > 0.99
    assert burst <= bench.session.latency_ns / SECOND <= burst + 0.05
    assert bench.events == {"slow_poses": 1}
    assert "s late; to move between them" in bench.session.journal.last_event


def test_a_hold_up_is_no_delay():
    """Three seconds of messages that come at one instant are late as the newest of them is."""
    timing = PoseTiming()
    over = T0 + 3 * SECOND
    delays = []
    for k in range(300):
        timing.accept(T0 + k * 10 * MS, over)
    for now in range(over, over + 3 * SECOND, 10 * MS):
        timing.accept(now - MS, now)
        delays.append(timing.delay_ns)
    assert max(delays) <= 10 * MS


def test_one_gripper_slow_and_one_fast(slow=5.0):
    bench, published = play(every(0.01), values=TWO, other=every(1 / slow))
    assert set(np.diff(published)) == {TICK}
    assert bench.session.latency_ns >= 1.5 * SECOND / slow
    assert "poses of end come" in bench.session.journal.last_event


def test_a_rate_that_changes_while_it_runs():
    times = [every(0.01, 3.0), every(0.2, 20.0, begin=3.0), every(0.01, 20.0, begin=23.0)]
    bench, published = play(np.concatenate(times))
    assert share(published, 0.0, 2.9) > 0.99
    assert share(published, 3.8, 22.0) > 0.99
    assert share(published, 38.0) > 0.99
    assert bench.session.latency_ns == 60 * MS  # and back again
    assert bench.events == {"slow_poses": 1}


def test_one_dropout_is_no_rate():
    times = every(0.01, 20.0)
    bench, _ = play(times[(times < 5.0) | (times > 5.4)])
    assert bench.session.latency_ns == 60 * MS and not bench.events


@pytest.mark.parametrize("rate", [2.0, 20.0])
def test_a_given_latency_that_is_too_short_says_which_would_do_and_it_does(rate):
    bench, published = play(every(1 / rate), **{"inputs.latency": 0.06})
    assert bench.session.latency_ns == 60 * MS
    assert share(published) < 0.9
    assert bench.events == {"slow_poses": 1}
    (line,) = bench.session.journal.advice
    assert f"poses of start come {1 / rate:.3g} s apart; inputs.latency 0.06 s is too short" in line
    enough = float(re.search(r"set it to ([0-9.]+) or auto", line)[1])
    assert enough < 1.5 / rate + 0.05
    bench, published = play(every(1 / rate), **{"inputs.latency": enough})
    assert set(np.diff(published)) == {TICK} and not bench.events


@pytest.mark.parametrize("intervals", [(1.1, 1.4), (0.9, 1.2)])
def test_poses_slower_than_the_timeout_say_which_would_do_and_it_does(intervals):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(*intervals, size=12))
    bench, published = play(times)
    assert bench.events["silent"] >= 3
    (line,) = (a for a in bench.session.journal.advice if "pose_timeout" in a)
    assert "further apart than start.pose_timeout 1 s" in line
    enough = float(re.search(r"set it to ([0-9.]+) to move", line)[1])
    bench, published = play(times, **{"start.pose_timeout": enough})
    assert share(published) > 0.99
    assert set(bench.events) == {"slow_poses"}


def test_the_lag_is_the_longest_since_the_last_report():
    """At 10 Hz with a latency that is too short, the state is 0 to 0.09 s behind; not 0."""
    bench, _ = play(every(0.1), **{"inputs.latency": 0.06})
    raw = bench.session.diagnostics(T0 + 20 * SECOND)
    lag = re.search(rb"lag \[s\]\0.{1,8}?(0\.\d{3})\0", raw, re.DOTALL)
    assert 0.07 < float(lag[1]) < 0.2


@pytest.mark.parametrize("word", ["auto", -1.0, -1])
def test_auto_is_a_word_or_the_number_that_stands_for_it(word):
    bench, _ = play(every(0.2), **{"inputs.latency": word})
    assert bench.session.latency_ns >= 300 * MS


def test_the_latency_changes_no_bit_of_the_states():
    raw = {}
    for latency in ("auto", 0.5, 0.06):
        bench = Bench(GRIPPER, **{"inputs.latency": latency})
        for k in range(0, 5000, 5):
            if k % 100 == 0:
                bench.pose(T0 + k * MS, motion(T0 + k * MS))
            bench.session.tick(T0 + k * MS)
            for m in bench.session.messages(["~/control_points"]):
                raw.setdefault(m.stamp_ns, []).append(m.data)
    shared = [states for states in raw.values() if len(states) == 3]
    assert len(shared) > 100
    assert all(auto == given for auto, given, _ in shared)
    for one, _, hasty in shared:  # but for the last bit of where two motions of the fake meet
        states = (cdr.decode_pose_array(data).rows for data in (one, hasty))
        assert np.allclose(*states, rtol=0.0, atol=1e-15)
