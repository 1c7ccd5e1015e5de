"""A gripper that is pushed by 0.7 m at 14 m/s, with knot spans too long for the bend that it makes:
the session goes on and says so, a replay is not ok.
"""

import pytest
from bag_files import write_bag

from dlo_sim import load_scene
from dlo_sim.cli.main import main
from dlo_sim.replay.replay import replay_bag
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import ERROR
from dlo_sim.session.session import Session, SessionStatus

MS = 1_000_000
T0 = 1_000_000 * MS
SPEED, WAY, BEFORE, AFTER = 14.0, 0.7, 0.2, 1.0  # m/s, m, s, s
CHANGES = {"discretization.control_points": 9, "accuracy.estimate": "off"}
START, END = "/dlo_sim/start/pose", "/dlo_sim/end/pose"
LINE = "of its rest length where its tension explains"
CURE = "raise discretization.control_points from 9 to 15"


@pytest.fixture(scope="module")
def scene():
    return load_scene("two_grippers", CHANGES)


def messages():
    """Poses of both grippers at 200 Hz as (topic, time, bytes), in order."""
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    found = []
    for since_ns in range(0, round((BEFORE + AFTER) * 1e9), 5 * MS):
        pushed = min(max(since_ns * 1e-9 - BEFORE, 0.0) * SPEED, WAY)
        for topic, x in ((START, 0.0), (END, 0.8 - pushed)):
            data = encoder.encode(T0 + since_ns, (x, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0))
            found.append((topic, T0 + since_ns, data))
    return found


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "pushed", messages(), dict.fromkeys((START, END), cdr.POSE_STAMPED))


def status_of(session, now_ns):
    """The diagnostics of the session itself."""
    (status, *_) = cdr.decode_diagnostic_array(session.diagnostics(now_ns))[1]
    return status


def test_the_session_goes_on_and_its_diagnostics_say_where_and_what_helps(scene):
    session = Session(scene)
    seen = []
    for topic, now, data in messages():
        session.receive(topic, data, now)
        if topic != END:
            continue
        report = session.tick(now)
        assert report.status is not SessionStatus.FAILED
        if session.started:
            seen.append((now, status_of(session, now), bool(session.unresolved)))
    wrong = [status for _, status, unresolved in seen if unresolved]
    assert wrong and len(wrong) < len(seen) / 2, "it comes back"
    for status in wrong:
        assert status.level == ERROR
        assert LINE in status.message and CURE in status.message and "\n" not in status.message
    assert [status.level for _, status, unresolved in seen if not unresolved].count(ERROR) == 0
    begun = sum(b and not a for (*_, a), (*_, b) in zip(seen, seen[1:], strict=False))
    assert session.journal.events["unresolved"] == begun > 0
    assert session.journal.skipped_ns == 0 and session.simulator.time > 1.0
    assert session.status is SessionStatus.RUNNING


def test_a_replay_of_it_is_not_ok(scene, bag, tmp_path, capsys):
    summary = replay_bag(bag, scene, tmp_path / "out")
    assert (summary.status, summary.ok) == ("unresolved", False)
    assert LINE in summary.message and CURE in summary.message and "\n" not in summary.message
    assert summary.simulated_s == pytest.approx(BEFORE + AFTER, abs=0.1), "all of it"
    sets = [part for key, value in CHANGES.items() for part in ("--set", f"{key}={value}")]
    assert main(["replay", str(bag), "--params", "two_grippers", *sets]) == 3
    assert "dlo_sim: unresolved: at u = " in capsys.readouterr().err


def test_with_spans_that_are_short_enough_all_is_well(bag, tmp_path):
    scene = load_scene("two_grippers", CHANGES | {"discretization.control_points": 21})
    summary = replay_bag(bag, scene, tmp_path / "out")
    assert (summary.status, summary.message) == ("done", "")
