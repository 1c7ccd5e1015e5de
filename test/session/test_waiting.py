"""Zero-order hold, timeout and frames of loads."""

import numpy as np
import pytest

from dlo_sim.core import rotations
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.waiting import LoadMessage, LoadSchedule

MS = 1_000_000


class Target:
    def __init__(self):
        self.calls = []
        self.orientation = np.array([0, 0, 0, 1.0])

    def set_load(self, name, force=None, torque=None):
        self.calls.append((name, tuple(force), tuple(torque)))

    def end_pose(self, end):
        return np.zeros(3), self.orientation


def make(timeout=0.5):
    scene = scene_from_values({"loads.names": ["tip"], "loads.tip.timeout": timeout})
    notes = []
    return LoadSchedule(scene.loads[0], lambda *note: notes.append(note)), Target(), notes


def message(ms, fx=1.0, end=""):
    return LoadMessage(ms * MS, (fx, 0.0, 0.0), (0.0, fx, 0.0), end)


def test_a_load_acts_from_the_first_step_at_its_stamp_until_the_next():
    schedule, target, _ = make()
    schedule.add(message(10, 1.0))
    schedule.add(message(20, 2.0))
    assert schedule.next_change_ns() == 10 * MS
    schedule.apply(9 * MS, MS, target)
    assert not target.calls
    schedule.apply(10 * MS, MS, target)
    assert target.calls == [("tip", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    schedule.apply(19 * MS, MS, target)
    assert len(target.calls) == 1
    assert schedule.next_change_ns() == 20 * MS
    schedule.apply(20 * MS, MS, target)
    assert target.calls[-1][1] == (2.0, 0.0, 0.0)


def test_only_the_newest_of_several_due_counts():
    schedule, target, _ = make()
    for k in range(5):
        schedule.add(message(k, float(k)))
    schedule.apply(4 * MS, 5 * MS, target)
    assert target.calls == [("tip", (4.0, 0.0, 0.0), (0.0, 4.0, 0.0))]


def test_timeout_removes_the_load_once_and_says_so():
    schedule, target, notes = make(timeout=0.5)
    schedule.add(message(0))
    schedule.apply(0, MS, target)
    assert schedule.next_change_ns() == SECOND // 2
    schedule.apply(SECOND // 2 - MS, MS, target)
    assert len(target.calls) == 1
    schedule.apply(SECOND // 2, MS, target)
    schedule.apply(SECOND, MS, target)
    assert target.calls[1:] == [("tip", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    assert [n[0] for n in notes] == ["load_removed"]


def test_timeout_zero_is_never():
    schedule, target, notes = make(timeout=0.0)
    schedule.add(message(0))
    schedule.apply(0, MS, target)
    assert schedule.next_change_ns() is None
    schedule.apply(10_000 * SECOND, MS, target)
    assert len(target.calls) == 1
    assert not notes


def test_a_late_load_counts_from_now_on():
    schedule, target, notes = make()
    schedule.add(message(100))
    schedule.apply(150 * MS, MS, target)
    assert len(target.calls) == 1
    assert [n[0] for n in notes] == ["late"]


def test_a_load_in_the_end_effectors_frame_is_turned():
    schedule, target, _ = make()
    target.orientation = rotations.from_rotation_vector([0, 0, np.pi / 2])
    schedule.add(message(0, end="start"))
    schedule.apply(0, MS, target)
    _, force, torque = target.calls[0]
    assert force == pytest.approx((0.0, 1.0, 0.0))
    assert torque == pytest.approx((-1.0, 0.0, 0.0))


def test_resend_what_is_held():
    schedule, target, notes = make()
    schedule.add(message(0))
    schedule.apply(0, MS, target)
    other = Target()
    schedule.resend(other)
    assert other.calls == target.calls
    schedule.clear()
    schedule.resend(other)
    assert len(other.calls) == 1
    assert not notes


def test_relabelling_moves_pending_and_held():
    schedule, target, _ = make(timeout=0.5)
    schedule.add(message(0))
    schedule.apply(0, MS, target)
    schedule.add(message(10))
    schedule.shift_time(1000 * MS)
    assert schedule.next_change_ns() == 1010 * MS
    schedule.apply(1009 * MS, MS, target)
    assert len(target.calls) == 1
