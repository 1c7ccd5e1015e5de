"""Bad input: refused with its reason, counted, no trace in the state, and the session goes on."""

import math

import numpy as np
import pytest
from session_bench import LOADED, MS, SECOND, T0, Bench

INF, NAN = math.inf, math.nan


def feed(bench, begin, end, bad=None, at=None):
    """Good messages at 50 Hz, ticks at 200 Hz from begin to end; `bad(now)` once, at `at`."""
    states = []
    for now in range(begin, end, 5 * MS):
        if now % (20 * MS) == 0:
            x = 0.05 * math.sin((now - T0) * 4e-9)
            bench.pose(now, (x, 0, 0))
            bench.wrench(now, (0.1, 0, 0.2))
        if bad is not None and now == at:
            bad(now)
        bench.session.tick(now)
        if bench.session.started:
            states.append(bench.simulator.control_points)
    return np.array(states)


def a_pose(position=(0, 0, 0), orientation=(0, 0, 0, 1), at=MS, **options):
    return "/gripper_pose", lambda bench, now: bench.pose(
        now + at, position, orientation, arrival=now, **options
    )


def a_wrench(force=(0, 0, 0), torque=(0, 0, 0), at=MS, **options):
    return "/wrench", lambda bench, now: bench.wrench(
        now + at, force, torque, arrival=now, **options
    )


def garbage(topic):
    raw = np.random.default_rng(1).integers(0, 256, 80, dtype=np.uint8).tobytes()
    return topic, lambda bench, now: bench.session.receive(topic, raw, now)


BAD = {
    "wrench nan": (a_wrench((NAN, 0, 0)), "not_finite"),
    "wrench inf": (a_wrench((0, INF, 0)), "not_finite"),
    "wrench -inf torque": (a_wrench(torque=(0, 0, -INF)), "not_finite"),
    "wrench of 1e9 N": (a_wrench((0, 0, 1e9)), "too_large"),
    "wrench of 2e3 Nm": (a_wrench(torque=(0, 2e3, 0)), "too_large"),
    "wrench in a frame": (a_wrench((1, 0, 0), frame="camera"), "unknown_frame"),
    "wrench again": (a_wrench((5, 5, 5), at=0), "out_of_order"),
    "wrench 0.9 s old": (a_wrench((5, 5, 5), at=-900 * MS), "out_of_order"),
    "wrench 5 s old": (a_wrench((5, 5, 5), at=-5 * SECOND), "too_old"),
    "wrench 0.6 s ahead": (a_wrench((5, 5, 5), at=600 * MS), "in_future"),
    "wrench of other bytes": (garbage("/wrench"), "undecodable"),
    "pose nan": (a_pose((NAN, 0, 0)), "not_finite"),
    "pose inf": (a_pose((0, 0, INF)), "not_finite"),
    "pose nan quaternion": (a_pose(orientation=(0, NAN, 0, 1)), "not_finite"),
    "pose of 1e300 m": (a_pose((0, 1e300, 0)), "too_large"),
    "pose that jumps": (a_pose((10, 0, 0)), "too_fast"),
    "pose of no turn": (a_pose(orientation=(0, 0, 0, 0)), "bad_quaternion"),
    "pose of a long quaternion": (a_pose(orientation=(0, 0, 0, 1.01)), "bad_quaternion"),
    "pose in a frame": (a_pose(frame="camera"), "unknown_frame"),
    "pose in its own frame": (a_pose(frame="tool"), "unknown_frame"),
    "pose again": (a_pose((0.1, 0.1, 0.1), at=0), "out_of_order"),
    "pose 5 s old": (a_pose((0.1, 0.1, 0.1), at=-5 * SECOND), "too_old"),
    "pose an hour ahead": (a_pose((0.1, 0.1, 0.1), at=3600 * SECOND), "in_future"),
    "pose of other bytes": (garbage("/gripper_pose"), "undecodable"),
}


@pytest.fixture(scope="module")
def expected():
    """The states of a run without a bad message."""
    clean = Bench(LOADED)
    states = feed(clean, T0, T0 + 2 * SECOND)
    assert len(states) > 300 and np.ptp(states[:, -1, 2]) > 0.01
    assert clean.session.journal.refused.total() == 0
    return states


@pytest.mark.parametrize("name", BAD)
def test_a_bad_message_is_refused_and_leaves_no_bit_in_the_states(expected, name):
    """The run with it equals the run without it; it is counted, with one line of why."""
    (topic, send), reason = BAD[name]
    broken = Bench(LOADED)
    states = feed(broken, T0, T0 + 2 * SECOND, lambda now: send(broken, now), T0 + SECOND)
    assert np.array_equal(states, expected)
    assert broken.refused(topic) == {reason: 1} and not broken.events
    said = broken.session.journal.topics[topic].last_refusal
    assert said.startswith(f"{reason}: ") and "\n" not in said


@pytest.mark.parametrize("frame", ["a\nb", "\x1b[31m", "many " * 2000, "x" * 5_000_000])
def test_what_a_message_says_is_quoted_on_one_short_line(loaded, frame):
    loaded.wrench(T0, (1, 0, 0), frame=frame)
    said = loaded.session.journal.topics["/wrench"].last_refusal
    reason = "unknown_frame" if len(frame) < 10**6 else "too_many"
    assert said.startswith(f"{reason}: ") and "frame_id" in said
    assert said.isprintable() and len(said) < 2000


@pytest.mark.parametrize("back", [0, 200 * MS])
def test_the_cure_of_a_message_dated_by_its_arrival_is_another_mode(back):
    bench = Bench(LOADED, **{"inputs.time": "arrival"})
    bench.wrench(T0, (1, 0, 0), arrival=T0)
    bench.wrench(T0 + MS, (2, 0, 0), arrival=T0 - back)
    record = bench.session.journal.topics["/wrench"]
    assert record.refused == {"out_of_order": 1}
    assert "inputs.time: auto" in record.last_refusal
    assert "inputs.time: arrival" not in record.last_refusal


def test_slightly_long_quaternion_is_normalised(loaded):
    loaded.pose(T0, (0, 0, 0), (0, 0, 0, 1.0005))
    loaded.pose(T0 + 20 * MS, (0, 0, 0), (0, 0, 0, 0.9995))
    loaded.run(T0, T0 + 200 * MS)
    assert not loaded.refused("/gripper_pose")
    assert np.linalg.norm(loaded.simulator.motions["start"].orientation) == pytest.approx(
        1, abs=1e-12
    )


def test_persistent_jump_names_the_cure_and_reset_accepts_it(loaded):
    feed(loaded, T0, T0 + SECOND)
    for k in range(100):
        loaded.pose(T0 + SECOND + k * 20 * MS, (10, 0, 0))
    assert loaded.refused("/gripper_pose") == {"too_fast": 100}
    assert "~/reset" in loaded.session.journal.topics["/gripper_pose"].last_refusal
    loaded.session.reset()
    after = T0 + 3100 * MS
    for k in range(10):
        loaded.pose(after + k * 20 * MS, (10, 0, 0))
    loaded.run(after, after + 300 * MS)
    assert loaded.session.started
    assert loaded.simulator.control_points[0, 0] == 10.0


def test_fast_but_possible_motion_is_accepted(loaded):
    for k in range(20):
        loaded.pose(T0 + k * 20 * MS, (0.39 * k, 0, 0))  # 19.5 m/s
    assert not loaded.refused("/gripper_pose")
    loaded.pose(T0 + 20 * 20 * MS, (0.39 * 19 + 0.402, 0, 0))  # 20.1 m/s
    assert loaded.refused("/gripper_pose") == {"too_fast": 1}


class TestTimeBase:
    """Stamps from another epoch, unstamped messages, clocks and stamps that start over."""

    def test_old_recording_played_live(self, loaded):
        clock = 1_700_000_000 * SECOND
        for k in range(100):
            loaded.pose(T0 + k * 20 * MS, (0, 0, 0), arrival=clock + k * 20 * MS)
            loaded.session.tick(clock + k * 20 * MS)
        assert loaded.session.started
        assert loaded.events == {"other_epoch": 1}
        assert "1.7e+09 s behind the clock" in loaded.session.journal.last_event
        now = clock + 99 * 20 * MS
        assert 0 < now - loaded.session.stamp_ns < 100 * MS  # published on the clock
        assert loaded.session.offset_ns == clock - T0
