"""Bad input: refused with its reason, counted, no trace in the state, and the session goes on."""

import math

import numpy as np
import pytest
from session_bench import FREE, LOADED, Bench

from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import REASONS

MS = 1_000_000
SECOND = 1_000_000_000
T0 = 1000 * SECOND
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


WRENCHES = {
    "not_finite nan": ((NAN, 0, 0), (0, 0, 0), {}, "not_finite"),
    "not_finite inf": ((0, INF, 0), (0, 0, 0), {}, "not_finite"),
    "not_finite -inf torque": ((0, 0, 0), (0, 0, -INF), {}, "not_finite"),
    "not_finite inf-inf": ((INF, -INF, 0), (0, 0, 0), {}, "not_finite"),
    "too_large 1e9 N": ((0, 0, 1e9), (0, 0, 0), {}, "too_large"),
    "too_large torque": ((0, 0, 0), (0, 2e3, 0), {}, "too_large"),
    "unknown_frame": ((1, 0, 0), (0, 0, 0), {"frame": "camera"}, "unknown_frame"),
}
POSES = {
    "not_finite nan": ((NAN, 0, 0), (0, 0, 0, 1), {}, "not_finite"),
    "not_finite inf": ((0, 0, INF), (0, 0, 0, 1), {}, "not_finite"),
    "not_finite quaternion": ((0, 0, 0), (0, NAN, 0, 1), {}, "not_finite"),
    "too_fast 10 m": ((10, 0, 0), (0, 0, 0, 1), {}, "too_fast"),
    "too_large": ((0, 1e300, 0), (0, 0, 0, 1), {}, "too_large"),
    "bad_quaternion zero": ((0, 0, 0), (0, 0, 0, 0), {}, "bad_quaternion"),
    "bad_quaternion": ((0, 0, 0), (0, 0, 0, 1.01), {}, "bad_quaternion"),
    "unknown_frame": ((0, 0, 0), (0, 0, 0, 1), {"frame": "camera"}, "unknown_frame"),
    "unknown_frame own": ((0, 0, 0), (0, 0, 0, 1), {"frame": "tool"}, "unknown_frame"),
}
AT = T0 + 1000 * MS


def assert_refused_without_trace(bench, topic, reason, send):
    """The run with the bad message equals the run without it, bit for bit, and counts it."""
    broken, clean = bench()
    states = feed(broken, T0, T0 + 2 * SECOND, send(broken), AT)
    expected = feed(clean, T0, T0 + 2 * SECOND)
    assert len(states) > 300
    assert np.isfinite(states).all()
    assert np.ptp(states[:, -1, 2]) > 0.01  # something moves
    assert np.array_equal(states, expected)
    assert broken.refused(topic) == {reason: 1}
    assert broken.session.journal.topics[topic].last_refusal.startswith(f"{reason}: ")
    assert "\n" not in broken.session.journal.topics[topic].last_refusal
    assert not broken.events
    assert clean.session.journal.refused.total() == 0


@pytest.fixture
def pair(bench):
    return lambda: (bench(LOADED), bench(LOADED))


@pytest.mark.parametrize("name", WRENCHES)
def test_bad_wrench(pair, name):
    force, torque, options, reason = WRENCHES[name]
    assert_refused_without_trace(
        pair,
        "/wrench",
        reason,
        lambda b: lambda now: b.wrench(now + MS, force, torque, arrival=now, **options),
    )


@pytest.mark.parametrize("name", POSES)
def test_bad_pose(pair, name):
    position, orientation, options, reason = POSES[name]
    assert_refused_without_trace(
        pair,
        "/gripper_pose",
        reason,
        lambda b: lambda now: b.pose(now + MS, position, orientation, arrival=now, **options),
    )


@pytest.mark.parametrize(
    ("offset", "reason"),
    [
        (0, "out_of_order"),
        (-200 * MS, "out_of_order"),
        (-900 * MS, "out_of_order"),
        (-5 * SECOND, "too_old"),
        (600 * MS, "in_future"),
        (3600 * SECOND, "in_future"),
    ],
)
@pytest.mark.parametrize("topic", ["/wrench", "/gripper_pose"])
def test_bad_stamp(pair, topic, offset, reason):
    def send(bench):
        if topic == "/wrench":
            return lambda now: bench.wrench(now + offset, (5, 5, 5), arrival=now)
        return lambda now: bench.pose(now + offset, (0.1, 0.1, 0.1), arrival=now)

    assert_refused_without_trace(pair, topic, reason, send)


@pytest.mark.parametrize("topic", ["/wrench", "/gripper_pose"])
def test_garbage_bytes(pair, topic):
    garbage = np.random.default_rng(1).integers(0, 256, 80, dtype=np.uint8).tobytes()
    assert_refused_without_trace(
        pair, topic, "undecodable", lambda b: lambda now: b.session.receive(topic, garbage, now)
    )


@pytest.mark.parametrize("frame", ["a\nb", "\x1b[31m", "many " * 2000])
def test_what_a_message_says_is_quoted_on_one_short_line(loaded, frame):
    loaded.wrench(T0, (1, 0, 0), frame=frame)
    said = loaded.session.journal.topics["/wrench"].last_refusal
    assert said.startswith("unknown_frame: frame_id") and said.isprintable() and len(said) < 2000


@pytest.mark.parametrize("back", [0, 200 * MS])
def test_the_cure_of_a_message_dated_by_its_arrival_is_another_mode(back):
    bench = Bench(LOADED, **{"inputs.time": "arrival"})
    bench.wrench(T0, (1, 0, 0), arrival=T0)
    bench.wrench(T0 + MS, (2, 0, 0), arrival=T0 - back)
    record = bench.session.journal.topics["/wrench"]
    assert record.refused == {"out_of_order": 1}
    assert "inputs.time: auto" in record.last_refusal
    assert "inputs.time: arrival" not in record.last_refusal


def test_a_name_that_is_endless_is_refused_at_once(loaded):
    loaded.wrench(T0, (1, 0, 0), frame="x" * 5_000_000)
    record = loaded.session.journal.topics["/wrench"]
    assert record.last_refusal.startswith(
        "too_many: 5000000 characters of frame_id, 100000 at most"
    )


def test_every_reason_has_a_test_here():
    """All but none: the reasons above are all that exist."""
    tested = {reason for *_, reason in (*WRENCHES.values(), *POSES.values())}
    tested |= {"out_of_order", "too_old", "in_future", "undecodable"}
    tested |= {"bad_points", "no_transform"}  # test_two_points, test_transforms
    tested |= {"bad_plan", "too_many", "bad_marker"}  # test_plans, test_markers, ...
    assert tested == set(REASONS)


def test_many_future_stamps_change_nothing(pair):
    broken, clean = pair()
    clean_states = feed(clean, T0, T0 + 2 * SECOND)
    states = list(feed(broken, T0, T0 + SECOND))
    for k in range(50):
        broken.wrench(T0 + 5000 * SECOND + k * MS, (9, 9, 9), arrival=T0 + SECOND - 5 * MS)
        broken.pose(T0 + 5000 * SECOND + k * MS, (0.1, 0, 0), arrival=T0 + SECOND - 5 * MS)
    states += list(feed(broken, T0 + SECOND, T0 + 2 * SECOND))
    assert np.array_equal(states, clean_states)
    assert broken.refused("/wrench") == broken.refused("/gripper_pose") == {"in_future": 50}


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


def test_force_topic_takes_a_vector(bench):
    values = {k: v for k, v in FREE.items() if not k.startswith("loads")}
    force = bench(values, **{"loads.names": ["force"], "loads.force.type": "force"})
    assert [(i.topic, i.kind, i.type) for i in force.session.inputs] == [
        ("/dlo_sim/force", "force", cdr.VECTOR3_STAMPED)
    ]
    raw = cdr.StampedEncoder(cdr.VECTOR3_STAMPED, "world").encode(T0, (1, 2, 3))
    force.session.receive("/dlo_sim/force", raw, T0)
    force.run(T0, T0 + 100 * MS)
    (call,) = (c for c in force.simulator.calls if c[0] == "load")
    assert (call[3], call[4]) == ((1, 2, 3), (0, 0, 0))


def test_one_topic_may_drive_two_loads(bench):
    values = {k: v for k, v in FREE.items() if not k.startswith("loads")}
    loads = {"loads.names": ["a", "b"], "loads.a.topic": "/wrench", "loads.b.topic": "/wrench"}
    both = bench(values, **loads)
    both.wrench(T0, (1, 0, 0))
    both.run(T0, T0 + 100 * MS)
    assert {c[2] for c in both.simulator.calls if c[0] == "load"} == {"a", "b"}
    assert both.session.journal.accepted == 1


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

    def test_mode_stamp_refuses_another_epoch(self, bench):
        strict = bench(LOADED, **{"inputs.time": "stamp"})
        for k in range(10):
            strict.pose(T0 + k * 20 * MS, arrival=1_700_000_000 * SECOND + k * 20 * MS)
        assert strict.refused("/gripper_pose") == {"too_old": 10}
        assert "inputs.time" in strict.session.journal.topics["/gripper_pose"].last_refusal

    @pytest.mark.parametrize(("mode", "stamp"), [("arrival", 7), ("auto", 0)])
    def test_what_is_dated_by_its_arrival(self, mode, stamp):
        bench = Bench(LOADED, **{"inputs.time": mode})
        for k in range(20):
            bench.pose(stamp, (0.001 * k, 0, 0), arrival=T0 + k * 20 * MS)
        bench.run(T0, T0 + 300 * MS)
        assert bench.session.started and not bench.events
        assert bench.session.journal.accepted == 20

    def test_stamps_of_another_epoch_after_the_simulation_began(self, free):
        clock = 1_700_000_000 * SECOND
        free.run(clock, clock + SECOND)
        assert free.session.started
        steps = free.simulator.steps
        free.wrench(T0, (1, 0, 0), arrival=clock + SECOND)
        free.run(clock + SECOND, clock + 2 * SECOND)
        assert free.events == {"other_epoch": 1, "load_removed": 1}
        assert free.simulator.steps == pytest.approx(steps + 1000, abs=2)  # went on, not back
        (on, _) = (c for c in free.simulator.calls if c[0] == "load")
        assert on[1] == pytest.approx(steps + 60, abs=6)  # inputs.latency later
