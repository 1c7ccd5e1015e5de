"""Messages that come late, in another order, or again: the result is that of the right order."""

import numpy as np
import pytest
from session_bench import LOADED, MS, SECOND, T0, Bench, motion

LATENCY = 60 * MS


def stream(seconds=3.0):
    """(stamp, kind): poses at 100 Hz and wrenches at 250 Hz."""
    end = T0 + round(seconds * SECOND)
    found = [(stamp, "pose") for stamp in range(T0, end, 10 * MS)]
    return sorted(found + [(stamp, "wrench") for stamp in range(T0 + MS, end, 4 * MS)])


def play(arrivals, **changes):
    """Hand over (arrival, stamp, kind) and tick each 5 ms; returns bench and stamp -> state."""
    bench = Bench(LOADED, **changes)
    waiting = sorted(arrivals, key=lambda one: one[0])
    states = {}
    for now in range(T0, max(a for a, *_ in arrivals) + 200 * MS, 5 * MS):
        while waiting and waiting[0][0] <= now:
            arrival, stamp, kind = waiting.pop(0)
            if kind == "pose":
                bench.pose(stamp, motion(stamp), arrival=arrival)
            else:
                force = (0.1 * np.sin(stamp * 5e-9), 0, 0.02)
                bench.wrench(stamp, force, arrival=arrival)
        bench.session.tick(now)
        if bench.session.started:
            states[bench.session.stamp_ns] = bench.simulator.control_points.copy()
    return bench, states


def assert_same(one, two, least=500):
    shared = one.keys() & two.keys()
    assert len(shared) > least
    assert all(np.array_equal(one[stamp], two[stamp]) for stamp in shared)
    assert np.ptp([one[stamp][-1, 0] for stamp in shared]) > 0.01


@pytest.fixture(scope="module")
def in_order():
    return play([(stamp, stamp, kind) for stamp, kind in stream()])


def late_by(pose_ns, wrench_ns, seed):
    """Arrivals of all, each late by its own time; the first pose sets when the cable is placed."""
    rng, most = np.random.default_rng(seed), {"pose": pose_ns, "wrench": wrench_ns}
    late = [(stamp + int(rng.uniform(0, most[kind])), stamp, kind) for stamp, kind in stream()]
    return [(T0, T0, "pose"), *late[1:]]


def swapped():
    """Recorded one after the other, two of each fifty in the other order."""
    found = stream()
    for kind in ("pose", "wrench"):
        places = [k for k, one in enumerate(found) if one[1] == kind]
        for a, b in list(zip(places, places[1:], strict=False))[25::50]:
            found[a], found[b] = found[b], found[a]
    arrivals = sorted(stamp for stamp, _ in found)
    return [(a, stamp, kind) for a, (stamp, kind) in zip(arrivals, found, strict=True)]


SMOOTHED = {"start.pose_smoothing": 0.02, "inputs.latency": 0.1}
DISORDER = {  # arrivals, changes of the scene
    # 35 ms are the latency less 1.5 intervals of the poses
    "each late by its own time": (late_by(35 * MS, 35 * MS, 3), {}),
    "so are those that are smoothed": (late_by(35 * MS, 35 * MS, 3), SMOOTHED),
    "loads late by nearly the latency": (late_by(1, 54 * MS, 4), {}),
    "neighbours that change places": (swapped(), {}),
}


@pytest.mark.parametrize("name", DISORDER)
def test_disorder_below_the_latency_changes_no_bit(in_order, name):
    """The states are those of the right order, and nothing is refused or said."""
    arrivals, changes = DISORDER[name]
    expected = play([(s, s, kind) for s, kind in stream()], **changes) if changes else in_order
    bench, states = play(arrivals, **changes)
    assert bench.session.journal.refused.total() == 0 and not bench.events
    assert bench.session.journal.accepted == len(arrivals)
    assert_same(states, expected[1])


@pytest.mark.parametrize("recorders", [2, 3])
def test_several_recorders(in_order, recorders):
    """Copies come with the first, or between later messages."""
    rng = np.random.default_rng(5)
    copies = [
        (stamp + k * 3 * MS + int(rng.uniform(0, 15 * MS)), stamp, kind)
        for stamp, kind in stream()
        for k in range(recorders)
    ]
    copies[0] = (T0, T0, "pose")
    bench, states = play(copies)
    journal = bench.session.journal
    assert journal.refused.total() == 0 and not bench.events
    assert journal.accepted == len(stream())
    assert sum(r.copies for r in journal.topics.values()) == (recorders - 1) * len(stream())
    assert b"copies ignored" in bench.session.diagnostics(T0 + 4 * SECOND)
    assert_same(states, in_order[1])


def test_what_comes_after_the_simulation_has_used_a_later_one_says_how_to_keep_it():
    bench = Bench(LOADED)
    for now in range(T0, T0 + SECOND, 10 * MS):
        bench.pose(now)
        bench.session.tick(now)
    bench.pose(T0 + 805 * MS, arrival=T0 + 990 * MS)
    assert bench.refused("/gripper_pose") == {"out_of_order": 1}
    assert "raise inputs.latency" in bench.session.journal.topics["/gripper_pose"].last_refusal


def test_a_late_pose_is_checked_against_the_poses_around_it():
    bench = Bench(LOADED)
    bench.pose(T0, (0, 0, 0))
    bench.pose(T0 + 20 * MS, (0.3, 0, 0))
    bench.pose(T0 + 10 * MS, (0.15, 0, 0))  # 15 m/s on both sides
    assert not bench.refused("/gripper_pose")
    bench.pose(T0 + 5 * MS, (0.15, 0, 0))  # 30 m/s after T0
    bench.pose(T0 + 15 * MS, (0.15, 0, 0))  # 30 m/s before T0 + 20 ms
    assert bench.refused("/gripper_pose") == {"too_fast": 2}


@pytest.mark.parametrize("ahead", [0.03, 0.3])
def test_a_clock_that_is_a_little_ahead_is_named(ahead):
    """Its stamps are believed, as they fit; the topic is named, and its delay shown."""
    bench = Bench(LOADED)
    for k in range(100):
        now = T0 + k * 10 * MS
        bench.pose(now - 2 * MS, arrival=now)
        bench.wrench(now + round(ahead * SECOND), (1, 0, 0), arrival=now)
        bench.session.tick(now)
    assert bench.events == {"clock_ahead": 1}
    (line,) = bench.session.journal.advice
    assert line.startswith(f"/wrench: stamps are {ahead:.3f} s ahead of the clock")
    raw = bench.session.diagnostics(T0 + SECOND)
    assert f"-{ahead:.3f} to -{ahead:.3f}".encode() in raw and b"0.002 to 0.002" in raw
