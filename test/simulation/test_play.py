"""The loop of all runs: where it stops, who may end it, and that stops change no bits."""

from __future__ import annotations

import numpy as np
import pytest

from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation import recording
from dlo_sim.simulation.play import play
from dlo_sim.simulation.recording import record
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator


class Every:
    """A watcher that looks every few steps, and ends the run at one of them."""

    def __init__(self, simulator, steps, ends_at=10**9):
        self.simulator, self.every, self.ends_at = simulator, steps, ends_at
        self.seen = []

    def next_look(self, steps):
        return steps + self.every - steps % self.every

    def look(self, report):
        self.seen.append((self.simulator.steps, report.steps))
        return "enough" if self.simulator.steps >= self.ends_at else ""


class Once:
    """A timeline of one change."""

    def __init__(self, simulator, at, change):
        self.simulator, self.at, self.change, self.made = simulator, at, change, False

    def apply(self, stop):
        if not self.made and self.simulator.steps >= self.at:
            self.change()
            self.made = True
        return stop if self.made else min(stop, self.at)


@pytest.fixture
def sim():
    return Simulator(load_scene("hanging_cable", {"start.pose_topic": ""}))


@pytest.mark.parametrize(
    ("every", "pushed_at", "stops"),
    [(7, 10, [7, 10, 14, 20]), (10, 10, [10, 20]), (100, 0, [20]), (100, 30, [20])],
)
def test_a_run_stops_where_its_timeline_and_its_watchers_say(sim, every, pushed_at, stops):
    asked, watcher = [], Every(sim, every)
    timeline = Once(sim, pushed_at, lambda: asked.append(sim.steps))
    report = play(sim, 20, timeline=timeline, watchers=[watcher])
    assert (report.status, report.steps, sim.steps) == (Status.OK, 20, 20)
    assert [at for at, _ in watcher.seen] == stops
    assert sum(steps for _, steps in watcher.seen) == 20
    assert asked == ([pushed_at] if pushed_at < 20 else [])


def test_stops_change_no_bits(sim):
    whole = Simulator(sim.scene)
    play(sim, 50, watchers=[Every(sim, 3)])
    report = whole.advance_steps(50)
    np.testing.assert_array_equal(sim.cable.state, whole.cable.state)
    assert report.status is Status.OK


def test_a_watcher_ends_a_run_but_not_one_that_is_done(sim):
    report = play(sim, 20, watchers=[Every(sim, 5, ends_at=10)])
    assert (report.status, report.message, report.steps) == (Status.INTERRUPTED, "enough", 10)
    report = play(sim, 20, watchers=[Every(sim, 10, ends_at=20)])
    assert (report.status, report.message, report.steps) == (Status.OK, "", 10)


def test_a_timeline_that_waits_ends_the_run_before_a_step(sim):
    class Waits:
        def apply(self, stop):
            return min(stop, 8)

    assert play(sim, 20, timeline=Waits()).steps == 8
    assert play(sim, 20, timeline=Waits()).steps == 0


@pytest.mark.parametrize("cores", [1, 2])
def test_what_an_estimate_costs_is_said_on_one_core(monkeypatch, cores):
    monkeypatch.setattr(recording, "_NOTABLE", 0.0)
    monkeypatch.setattr(recording, "_cores", lambda: cores)
    notes = record(load_scene("hanging_cable", {"start.pose_topic": ""}), 0.1, 0.05).notes
    assert any("accuracy.estimate: off" in line for line in notes) == (cores == 1)
