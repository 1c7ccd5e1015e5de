"""The session: determinism, waiting, silence, catching up, pause, reset, failure, changes."""

import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from session_bench import FREE, GRIPPER, LOADED, MS, SECOND, T0, motion, play

from dlo_sim.session import cdr
from dlo_sim.session.session import SessionStatus
from dlo_sim.session.topics import output_topics

STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize("gap", [(0.0, 0.0), (1.5, 3.7)])
@pytest.mark.parametrize("changes", [{}, {"start.pose_smoothing": 0.14, "inputs.latency": 0.25}])
def test_jitter_below_the_latency_and_other_ticks_change_no_byte(bench, gap, changes):
    """Neither around a silence, nor with poses that are smoothed."""
    first = play(bench(LOADED, **changes), 5.0, gap=gap)
    assert len(set(first.values())) > 700, "it moves"
    for variant in ({"jitter": 1}, {"jitter": 2}, {"tick": 7 * MS}):
        other = play(bench(LOADED, **changes), 5.0, gap=gap, **variant)
        shared = first.keys() & other.keys()  # while it waits, the last state may be due or not
        assert len(shared) > (150 if "tick" in variant else 1000)
        assert all(first[key] == other[key] for key in shared)
        assert gap[1] or "tick" in variant or first.keys() == other.keys()


class TestWaiting:
    def test_waits_for_the_first_pose_and_says_so(self, loaded):
        report = loaded.run(T0, T0 + SECOND)
        assert report.status is SessionStatus.WAITING
        assert report.message == "waiting for the first pose on /gripper_pose"
        assert loaded.session.messages() == []

    def test_needs_the_first_pose_of_every_driven_end(self, bench):
        two = bench(
            GRIPPER,
            **{"end.pose_topic": "/other", "end.fixed": [True] * 3, "end.position": [0.9, 0, 0]},
        )
        for k in range(50):
            two.pose(T0 + k * 20 * MS)
        report = two.run(T0, T0 + SECOND)
        assert report.message == "waiting for the first pose on /other"
        encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
        for k in range(50, 100):
            stamp = T0 + k * 20 * MS
            two.pose(stamp)
            two.session.receive("/other", encoder.encode(stamp, (0.9, 0, 0, 0, 0, 0, 1)), stamp)
            report = two.session.tick(stamp)
        assert report.status is SessionStatus.RUNNING
        assert two.session.simulator.steps > 900 - 80
        assert set(two.simulator.end_poses) == {"start", "end"}

    def test_begins_at_a_multiple_of_the_step_with_the_first_pose(self, loaded):
        loaded.pose(T0 + 123_456, (0.1, 0.2, 0.3))
        loaded.pose(T0 + 20 * MS, (0.1, 0.2, 0.3))
        loaded.pose(T0 + 40 * MS, (0.1, 0.2, 0.3))
        loaded.run(T0, T0 + 100 * MS)
        steps = loaded.simulator.steps
        assert loaded.session.stamp_ns == T0 + MS + steps * MS
        assert np.array_equal(loaded.simulator.control_points[0, :3], [0.1, 0.2, 0.3])

    def test_never_runs_ahead_of_its_poses(self, loaded):
        for k in range(10):
            loaded.pose(T0 + k * 20 * MS, motion(T0 + k * 20 * MS))
        report = loaded.run(T0, T0 + 900 * MS)
        # Known up to the middle of the last two poses, 170 ms.
        assert loaded.session.stamp_ns == T0 + 170 * MS
        assert report.message == "waiting for the next pose on /gripper_pose"
        assert report.lag_ns == (895 - 60 - 170) * MS


class TestSilence:
    def test_five_seconds_of_silence(self, loaded):
        """Held after pose_timeout, load removed, both said; everything goes on and comes back."""
        play(loaded, 2.0)
        tip = loaded.simulator.tip.copy()
        report = loaded.run(T0 + 2000 * MS, T0 + 7000 * MS)
        assert report.lag_ns < 2 * MS  # caught up after waiting
        assert loaded.events == {"silent": 1, "load_removed": 1}
        held = motion(T0 + 1_966_666_647)  # the last pose sent
        assert loaded.simulator.control_points[0, :3] == pytest.approx(held, abs=1e-12)
        assert not np.array_equal(loaded.simulator.tip, tip)
        for k in range(100):
            stamp = T0 + 7000 * MS + k * 20 * MS
            loaded.pose(stamp, (0.3, 0, 0))
            loaded.wrench(stamp, (0.1, 0, 0))
            loaded.session.tick(stamp)
        assert loaded.events == {"silent": 1, "load_removed": 1, "rejoined": 1}
        assert loaded.simulator.control_points[0, 0] == pytest.approx(0.3)
        assert loaded.session.journal.refused.total() == 0

    def test_diagnostics_call_it_stale(self, loaded):
        play(loaded, 1.0)
        loaded.run(T0 + SECOND, T0 + 6 * SECOND)
        raw = loaded.session.diagnostics(T0 + 6 * SECOND)
        levels = {s.name: s.level for s in STORE.deserialize_cdr(raw, cdr.DIAGNOSTIC_ARRAY).status}
        assert levels["/dlo_sim: input /gripper_pose"] == 3
        assert levels["/dlo_sim: input /wrench"] == 3


class TestCatchingUp:
    def test_at_most_catch_up_per_tick(self, free):
        free.session.tick(T0)
        report = free.session.tick(T0 + 450 * MS)
        assert report.advanced_steps == 100
        assert report.lag_ns == pytest.approx(350 * MS, abs=MS)
        assert free.session.tick(T0 + 450 * MS).advanced_steps == 100

    def test_beyond_that_time_is_skipped_and_said(self, free):
        free.session.tick(T0)
        free.session.tick(T0 + 100 * SECOND)
        assert free.events == {"time_skipped": 1}
        assert free.session.journal.skipped_ns == pytest.approx(99.9 * SECOND, abs=2 * MS)
        report = free.session.tick(T0 + 100 * SECOND + 5 * MS)
        assert report.lag_ns < 2 * MS
        assert free.simulator.steps == pytest.approx(105, abs=2)

    def test_a_tick_is_never_capped_below_its_own_period(self, bench):
        slow = bench(FREE, **{"rate": 2.0, "inputs.catch_up": 0.5})
        slow.run(T0, T0 + 10 * SECOND, 500 * MS)
        assert slow.simulator.steps == pytest.approx(9500, abs=2)


class TestPause:
    def test_nothing_moves_and_the_time_is_left_out(self, loaded):
        play(loaded, 1.0)
        before = loaded.simulator.steps
        loaded.session.pause(True)
        for k in range(50, 150):
            stamp = T0 + k * 20 * MS
            loaded.pose(stamp, motion(stamp))
            report = loaded.session.tick(stamp)
        assert report.status is SessionStatus.PAUSED
        assert loaded.simulator.steps == before
        loaded.session.pause(False)
        for k in range(150, 250):
            stamp = T0 + k * 20 * MS
            loaded.pose(stamp, motion(stamp))
            loaded.session.tick(stamp)
        assert loaded.simulator.steps == pytest.approx(before + 2000, abs=60)
        assert loaded.session.journal.skipped_ns == 0
        now = loaded.session.stamp_ns
        assert now == T0 + 4980 * MS - 60 * MS
        assert loaded.simulator.control_points[0, :3] == pytest.approx(motion(now), abs=1e-4)

    def test_the_end_does_not_jump_on_the_way_back(self, bench):
        """Paused in the middle of a fast motion, resumed when the gripper is elsewhere."""
        loaded = bench(LOADED, rate=250.0)

        def fast(now):
            return 0.2 * math.sin((now - T0) * 9e-9), 0.0, 0.0

        places = []
        for k in range(300):
            stamp = T0 + k * 20 * MS
            loaded.pose(stamp, fast(stamp))
            if k in (55, 155):
                loaded.session.pause(k == 55)
            for now in range(stamp, stamp + 20 * MS, 4 * MS):
                if loaded.session.tick(now).advanced_steps:
                    places.append(loaded.simulator.control_points[0, 0])
        assert len(places) > 900
        # At most the gripper's 1.8 m/s and the 1.5 m/s of the return, in the 4 ms of a tick.
        assert np.abs(np.diff(places)).max() < 3.3 * 4e-3
        assert places[-1] == pytest.approx(fast(loaded.session.stamp_ns)[0], abs=2e-3)

    def test_a_paused_session_goes_on_in_single_steps(self, loaded):
        play(loaded, 1.0)
        assert loaded.session.step_once().advanced_steps == 0  # not paused
        loaded.session.pause(True)
        before = loaded.simulator.steps
        assert loaded.session.step_once().advanced_steps == 5  # 1/200 s of 1 ms steps
        for _ in range(400):  # far beyond the poses: the end stays at its last one
            loaded.session.step_once()
        assert loaded.simulator.steps == before + 401 * 5
        assert len(loaded.session.messages()) == 4


class TestReset:
    def test_places_the_cable_anew(self, loaded):
        play(loaded, 1.0)
        loaded.session.reset()
        assert loaded.session.messages() == []
        for k in range(50, 100):
            loaded.pose(T0 + k * 20 * MS, (0.5, 0, 0))
            loaded.session.tick(T0 + k * 20 * MS)
        assert not loaded.simulator.loads
        assert loaded.simulator.end_poses["start"][0] == pytest.approx([0.5, 0, 0])
        assert loaded.events == {"reset": 1}

    def test_at_once_without_a_driven_end(self, free):
        free.wrench(T0, (1, 0, 0))
        free.run(T0, T0 + SECOND)
        assert free.simulator.steps > 900 and free.simulator.loads
        free.session.reset()
        free.session.tick(T0 + SECOND)
        assert free.simulator.steps == 0 and not free.simulator.loads
        assert free.session.started


def test_a_slow_newton_iteration_is_counted_and_said(loaded):
    play(loaded, 1.0)
    loaded.simulator.note = "Newton's method took 40 iterations per step"
    loaded.run(T0 + SECOND, T0 + 1010 * MS)
    assert loaded.events == {"slow_newton": 2}
    assert loaded.session.journal.last_event == "Newton's method took 40 iterations per step"


class TestFailure:
    def test_hold_keeps_the_last_good_state_until_reset(self, loaded):
        play(loaded, 1.0)
        loaded.simulator.fail_at = loaded.simulator.steps + 7
        report = loaded.run(T0 + SECOND, T0 + 1200 * MS)
        assert report.status is SessionStatus.FAILED
        assert not report.stop
        assert "diverged: fake (at 0.9" in report.message
        steps = loaded.simulator.steps
        (points, *_) = loaded.session.messages()
        assert np.isfinite(cdr.decode_pose_array(points.data).rows).all()
        loaded.run(T0 + 1200 * MS, T0 + 1300 * MS)
        assert loaded.simulator.steps == steps
        status = STORE.deserialize_cdr(loaded.session.diagnostics(T0), cdr.DIAGNOSTIC_ARRAY).status[
            0
        ]
        assert (status.level, status.message) == (2, report.message)
        assert loaded.events == {"failed": 1}
        loaded.session.reset()
        loaded.pose(T0 + 1300 * MS)
        loaded.pose(T0 + 1320 * MS)
        report = loaded.run(T0 + 1300 * MS, T0 + 1400 * MS)
        assert report.status is SessionStatus.RUNNING

    def test_stop_asks_the_shell_to_end(self, bench):
        free = bench(FREE, **{"integrator.on_failure": "stop"})
        free.session.tick(T0)
        free.simulator.fail_at = 10
        assert free.run(T0, T0 + 200 * MS).stop

    def test_numbers_that_are_not_finite_are_not_published(self, loaded):
        play(loaded, 1.0)
        loaded.simulator.tip[1] = math.nan
        topics = {m.topic for m in loaded.session.messages(again=output_topics(loaded.scene))}
        assert topics == {"~/start/reaction"}
        assert loaded.events == {"not_published": 1}


def test_diagnostics_name_every_refusal_with_its_reason(loaded):
    play(loaded, 1.0)
    for k in range(3):
        loaded.wrench(T0 + SECOND + k * MS, (math.nan, 0, 0))
    loaded.wrench(T0 + SECOND, (1e9, 0, 0))
    raw = loaded.session.diagnostics(T0 + SECOND)
    session, pose, wrench = STORE.deserialize_cdr(raw, cdr.DIAGNOSTIC_ARRAY).status
    values = {v.key: v.value for v in wrench.values}
    assert wrench.level == 1
    assert values["refused"] == "4"
    assert values["refused not_finite"] == "3"
    assert values["refused too_large"] == "1"
    assert values["last refusal"].startswith("too_large: force 1e+09 N exceeds inputs.max_force")
    assert pose.level == 0
    values = {v.key: v.value for v in session.values}
    assert values["method"] == "fake"
    assert values["messages refused"] == "4"
    # The next report has no news.
    raw = loaded.session.diagnostics(T0 + SECOND)
    assert STORE.deserialize_cdr(raw, cdr.DIAGNOSTIC_ARRAY).status[2].level == 0


class TestSmoothing:
    """`pose_smoothing` in the whole session."""

    def test_a_single_pose_is_enough_after_the_timeout(self, bench):
        still = bench(LOADED, **{"start.pose_smoothing": 0.14})
        still.pose(T0, (0.1, 0, 0))
        report = still.run(T0, T0 + 3 * SECOND)
        assert report.status is SessionStatus.RUNNING
        assert still.simulator.control_points[0, 0] == 0.1
        assert still.events == {"silent": 1}


def test_a_live_tick_is_bounded_however_short_the_step(bench):
    changes = {"integrator.step": 1e-7, "accuracy.estimate": "off"}
    tiny = bench(FREE, live=True, **changes)
    tiny.session.tick(T0)
    assert tiny.session.tick(T0 + 100 * MS).advanced_steps == 20_000


def test_no_code_that_reads_or_writes_messages_is_generated_in_a_tick(monkeypatch, bench):
    monkeypatch.setattr(cdr.STORE, "cache", {})
    one = bench({**LOADED, "outputs.points": True, "outputs.tf": True, "outputs.capsules": 3})
    known = set(cdr.STORE.cache)
    play(one, 0.5)
    one.session.messages(again=output_topics(one.scene))
    one.session.diagnostics(T0 + SECOND)
    assert one.session.started and set(cdr.STORE.cache) == known
