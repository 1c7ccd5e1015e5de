"""Random scenes of the stability study: the generator, a sample, and that a wrong one is seen."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from dlo_sim.simulation.report import Report, Status
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability import random_checks
from dlo_sim.studies.stability.random_checks import RAN, REFUSED, STOPPED, WRONG, run_case
from dlo_sim.studies.stability.random_scenes import KINDS, draw_case

SEEDS = range(40)
# Each kind and family of methods is a compiled step: few of them here, all in the study.
METHODS = ("velocity_verlet", "forest_ruth", "energy_momentum")
SAMPLE = tuple(
    replace(kind, methods=tuple(name for name in METHODS if name in kind.methods))
    for kind in KINDS
    if kind.name in ("plane springs", "free flight", "grippers")
)


def test_a_seed_gives_one_case_whatever_else_is_drawn():
    first = draw_case(7)
    draw_case(8)
    assert draw_case(7) == first
    assert draw_case(9).values != first.values


def test_the_ranges_are_drawn_out():
    cases = [draw_case(seed) for seed in range(1000)]
    for key, low, high in (
        ("cable.youngs_modulus", 1e4, 1e12),
        ("cable.diameter", 1e-5, 5e-2),
        ("cable.length", 1e-3, 1e3),
        ("discretization.control_points", 4, 200),
    ):
        drawn = np.array([case.values[key] for case in cases])
        assert low <= drawn.min() < 2.0 * low
        assert 0.5 * high < drawn.max() <= high
    kinds = Counter(case.kind.name for case in cases)
    assert set(kinds) == {kind.name for kind in KINDS}
    methods = {case.values["integrator.method"] for case in cases}
    assert methods == {"auto", *(name for kind in KINDS for name in kind.methods)}
    assert any(case.moves for case in cases)


def test_no_scene_of_a_sample_goes_wrong():
    outcomes = [run_case(draw_case(seed, SAMPLE)) for seed in SEEDS]
    assert not [one for one in outcomes if one.outcome == WRONG]
    counts = Counter(one.outcome for one in outcomes)
    assert counts[RAN] > len(SEEDS) // 2
    assert counts[REFUSED] > 2  # explicit steps beyond the limit, ends that are too far apart
    for one in outcomes:
        if one.outcome in (REFUSED, STOPPED):
            assert one.reason
            assert "\n" not in one.reason
        if one.outcome == RAN:
            assert one.steps >= 48
            assert one.energy_error <= one.tolerance


@pytest.fixture(scope="module")
def case():
    """A case of the sample that runs."""
    for seed in SEEDS:
        drawn = draw_case(seed, SAMPLE[:1])
        found = run_case(drawn)
        if found.outcome == RAN and found.closed > 0.0:
            return drawn
    raise AssertionError("no case of the sample runs")


def test_an_open_balance_is_wrong(case, monkeypatch):
    monkeypatch.setattr(Simulator, "energy_error", property(lambda simulator: 0.7))
    found = run_case(case)
    assert found.outcome == WRONG
    assert "energy balance open by 7.00e-01" in found.problem


def test_energy_that_the_account_does_not_know_is_wrong(case, monkeypatch):
    real = Simulator.energy

    def grows(simulator):
        energy = real(simulator)
        return replace(energy, gravity=energy.gravity + 1e6 * simulator.time)

    monkeypatch.setattr(Simulator, "energy", grows)
    found = run_case(case)
    assert found.outcome == WRONG
    assert "without the account" in found.problem


def test_a_number_that_is_not_finite_is_wrong(case, monkeypatch):
    monkeypatch.setattr(Simulator, "velocities", property(lambda simulator: np.full(4, np.nan)))
    assert run_case(case).problem == "a number that is not finite"


def test_an_exception_is_wrong(case, monkeypatch):
    def raises(simulator, end):
        raise FloatingPointError("oh")

    monkeypatch.setattr(Simulator, "reaction", raises)
    assert run_case(case).problem == "FloatingPointError: oh"


def test_a_stop_without_a_reason_is_wrong(case, monkeypatch):
    stopped = Report(Status.DIVERGED, "", 0, 0.0, 0)
    monkeypatch.setattr(Simulator, "advance_steps", lambda simulator, steps: stopped)
    assert "without a one-line reason" in run_case(case).problem


def test_a_stop_with_a_reason_is_not_wrong(case, monkeypatch):
    stopped = Report(Status.DIVERGED, "too fast", 0, 0.0, 0)
    monkeypatch.setattr(Simulator, "advance_steps", lambda simulator, steps: stopped)
    found = run_case(case)
    assert (found.outcome, found.reason) == (STOPPED, "too fast")
    monkeypatch.setattr(Simulator, "velocities", property(lambda simulator: np.full(4, np.nan)))
    assert run_case(case).outcome == WRONG


@pytest.mark.parametrize(
    ("seed", "outcome"),
    [
        (1508, STOPPED),  # every step took seconds
        pytest.param(
            *(1712, RAN),
            marks=pytest.mark.xfail(
                strict=True, reason="steps of 1 us, 115 m long: rounding shows in the momentum"
            ),
        ),
        pytest.param(
            *(1866, STOPPED),
            marks=pytest.mark.xfail(
                strict=True, reason="0.63 of the energy is off between two looks of the loop"
            ),
        ),
    ],
)
def test_scenes_that_went_wrong_once(seed, outcome):
    found = run_case(draw_case(seed))
    assert (found.outcome, found.problem) == (outcome, "")
    assert found.wall < 5.0  # s


def test_more_time_than_the_budget_is_wrong(case):
    assert "budget" in run_case(case, budget=0.0).problem


def test_lost_momentum_is_wrong(monkeypatch):
    monkeypatch.setattr(
        random_checks.truths, "momenta", lambda simulator: (np.full(3, 1e9), np.zeros(3))
    )
    flights = (draw_case(seed, SAMPLE[1:2]) for seed in SEEDS)
    found = [run_case(case) for case in list(flights)[:8]]
    assert any("momentum wrong" in one.problem for one in found)
