"""The corpus of scenes: what it draws, that none goes wrong, and that the judge sees what is."""

import time
from collections import Counter
from dataclasses import replace

import closed_forms
import corpus
import judge
import numpy as np
import pytest
from corpus import ALUMINIUM, EXTREMES, KINDS, ONCE_WRONG, draw_random, wire
from judge import RAN, REFUSED, STOPPED, WRONG, Case, judged

from dlo_sim.core.methods import METHODS
from dlo_sim.simulation.report import Report, Status
from dlo_sim.simulation.simulator import Simulator

pytestmark = pytest.mark.slow
SEEDS = [seed for seed in range(26) if seed not in (1, 8, 22)]  # these take seconds each
# Three kinds and three families of methods here, all from the command line.
FEW = ("velocity_verlet", "forest_ruth", "energy_momentum")
SAMPLE = tuple(
    replace(kind, methods=tuple(name for name in FEW if name in kind.methods), damped=1.0)
    for kind in KINDS
    if kind.name in ("plane springs", "free flight", "grippers")
)
PULLED = tuple(
    replace(kind, methods=("energy_momentum",)) for kind in KINDS if kind.name == "pulled"
)


def test_a_seed_gives_one_case_and_all_ranges_are_drawn_out():
    """With methods that admit the damping that is drawn."""
    assert draw_random(7) == draw_random(7) != draw_random(9)
    cases = [draw_random(seed) for seed in range(2000)]
    for key, low, high in (
        ("cable.youngs_modulus", 1e4, 1e12),
        ("cable.diameter", 1e-5, 5e-2),
        ("cable.length", 1e-3, 1e3),
        ("discretization.control_points", 4, 200),
    ):
        drawn = np.array([case.values[key] for case in cases])
        assert low <= drawn.min() < 2.0 * low and 0.5 * high < drawn.max() <= high
    for kind in KINDS:
        mine = [case.values for case in cases if case.name == kind.name]
        assert {one["integrator.method"] for one in mine} <= {"auto", *kind.methods}
        for name in ("mass", "stiffness", "air_drag"):
            share = np.mean([f"damping.{name}" in one for one in mine])
            assert 0.4 < share < 0.65 if name in kind.damping else share == 0.0
    for values in (case.values for case in cases if case.values["integrator.method"] != "auto"):
        method = METHODS[values["integrator.method"]]
        assert method.stiffness_damping or "damping.stiffness" not in values
        assert method.mass_damping or not {"damping.mass", "damping.air_drag"} & set(values)


def test_no_random_scene_of_a_sample_goes_wrong():
    outcomes = [judged(draw_random(seed, SAMPLE)) for seed in SEEDS]
    assert not [one for one in outcomes if one.outcome == WRONG]
    counts = Counter(one.outcome for one in outcomes)
    assert counts[RAN] > len(SEEDS) // 2
    assert counts[REFUSED] > 1  # explicit steps beyond the limit, ends that are too far apart
    assert all(one.reason for one in outcomes if one.outcome in (REFUSED, STOPPED))
    ran = [one for one in outcomes if one.outcome == RAN]
    assert min(one.steps for one in ran) >= 48
    assert any("momentum" in one.errors for one in ran)
    for kind in SAMPLE:
        mine = [one for one in ran if one.name == kind.name]
        assert sum(one.moved for one in mine) >= 0.7 * len(mine) > 2.0


@pytest.mark.parametrize("name", ONCE_WRONG)
def test_scenes_that_went_wrong_once(name):
    found = judged(ONCE_WRONG[name])
    assert (found.problem, found.outcome) == ("", RAN if name == "long" else STOPPED)
    assert found.wall < 5.0  # s


def test_a_cable_of_many_short_spans_is_looked_at():
    """A look for where it is nearest to itself indexed the wrong matrices there."""
    found = judged(draw_random(53))
    assert (found.problem, found.outcome) == ("", RAN)


@pytest.mark.parametrize("seed", [*range(40), 154, 166, 174, 262])
def test_everyday_scenes_start_in_stable_shapes_at_rest(seed):
    """Among those beyond the first are natural shapes that twist the cable most."""
    assert judged(corpus.draw_at_rest(seed)).problem == ""


@pytest.mark.parametrize("seed", range(12))
def test_everyday_scenes_above_a_table_start_outside_of_it_and_of_themselves(seed):
    """Of 100, a nylon that is stiffer than its control points follow over an edge is not."""
    assert judged(corpus.draw_above_table(seed)).problem == ""


@pytest.mark.parametrize("name", EXTREMES)
def test_an_extreme_scene_is_right(name):
    assert judged(EXTREMES[name]).problem == ""


def test_steel_is_as_fast_as_aluminium():
    """Counted in iterations, which no other load of the machine changes."""
    steel, aluminium = (judged(EXTREMES[f"{metal} wire"]) for metal in ("steel", "aluminium"))
    assert (steel.method, steel.step, steel.steps) == (
        *(aluminium.method, aluminium.step, aluminium.steps),
    )
    assert steel.iterations <= 1.1 * aluminium.iterations


# -- the judge sees what is wrong -----------------------------------------------------------------


@pytest.fixture(scope="module")
def case():
    """A random case that runs, with an energy balance of its own."""
    for seed in SEEDS:
        drawn = draw_random(seed, SAMPLE[:1])
        found = judged(drawn)
        balanced = found.tolerance < 0.1 and found.errors.get("energy")
        if found.outcome == RAN and found.moved and balanced:
            return drawn
    raise AssertionError("no case of the sample runs")


@pytest.fixture(scope="module")
def flight():
    """A thrown cable of the sample, whose angular momentum is checked."""
    for seed in SEEDS:
        drawn = draw_random(seed, SAMPLE[1:2])
        found = judged(drawn)
        if found.outcome == RAN and found.moved and drawn.throw:
            return drawn
    raise AssertionError("no thrown cable is in the sample")


def raises(simulator, end):
    raise FloatingPointError("oh")


def growing(energy=Simulator.energy):
    def grows(simulator):
        now = energy(simulator)
        return replace(now, gravity=now.gravity + 1e6 * simulator.time)

    return grows


def stopped(message):
    return lambda simulator, steps: Report(Status.DIVERGED, message, 0, 0.0, 0)


NAN = property(lambda simulator: np.full(4, np.nan))
OPEN = property(lambda simulator: 0.7)


@pytest.mark.parametrize(
    ("patches", "problem"),
    [
        ({"energy_error": OPEN}, "energy balance open by 7.00e-01"),
        ({"energy": growing()}, "without the account"),
        ({"velocities": NAN}, "a number that is not finite"),
        ({"reaction": raises}, "FloatingPointError: oh"),
        ({"advance_steps": stopped("")}, "without a one-line reason"),
        ({"advance_steps": stopped("fast")}, ""),
        ({"advance_steps": stopped("fast"), "velocities": NAN}, "a number that is not finite"),
        (
            {"advance_steps": stopped("fast"), "energy_error": OPEN},
            "kept state: energy balance open by 7.00e-01",
        ),
    ],
)
def test_what_a_simulator_does_wrong_is_seen(case, monkeypatch, patches, problem):
    for name, value in patches.items():
        monkeypatch.setattr(Simulator, name, value)
    found = judged(case)
    assert problem in found.problem
    assert found.outcome == (WRONG if problem else STOPPED)


def test_lost_momentum_is_wrong(flight, monkeypatch):
    """And angular momentum, by a thousandth."""
    real = closed_forms.momenta

    def less(simulator):
        momentum, angular = real(simulator)
        return momentum, angular * (1.0 + 1e-3 * (simulator.steps > 0))

    def grows(simulator):
        return np.full(3, 1e9 * simulator.time), np.zeros(3)

    for other in (less, grows):
        monkeypatch.setattr(closed_forms, "momenta", other)
        assert "momentum open by" in judged(flight).problem


def test_a_wrong_reaction_is_wrong(monkeypatch):
    """Of a moved end: the energy is not that of its work any more."""
    drawn = [draw_random(seed, PULLED) for seed in SEEDS[:5]]
    cases = [case for case in drawn if case.values["integrator.method"] != "auto"]
    ran = [case for case in cases if judged(case).outcome == RAN]
    assert len(ran) > 1
    real = Simulator.reaction

    def other(simulator, end):
        force, moment = real(simulator, end)
        return -force, moment

    monkeypatch.setattr(Simulator, "reaction", other)
    assert any("work of the ends open by" in judged(case).problem for case in ran)


def test_a_scene_in_which_nothing_happens_has_not_moved():
    for gravity, moves in ((0.0, False), (-1.0, True)):
        values = wire(ALUMINIUM) | {"gravity": [0.0, 0.0, gravity]}
        found = judged(Case("wire", values, steps=200, balanced=True))
        assert (found.outcome, found.moved) == (RAN, moves)


def test_more_time_than_the_budget_is_wrong_but_the_compiler_may_take_its_time(case, monkeypatch):
    def slow(scene, compiled=0.0):
        until = time.process_time() + 0.8
        while time.process_time() < until:
            pass
        simulator = Simulator(scene)
        simulator.compile_seconds += compiled
        return simulator

    few = replace(case, steps=8)
    assert judged(few, budget=0.5).outcome == RAN
    monkeypatch.setattr(judge, "Simulator", slow)
    found = judged(few, budget=0.5)
    assert found.outcome == WRONG and "budget" in found.problem and found.wall > 0.5
    monkeypatch.setattr(judge, "Simulator", lambda scene: slow(scene, 0.8))
    assert judged(few, budget=0.5).outcome == RAN


@pytest.mark.parametrize(
    ("name", "changes", "problem"),
    [
        ("overhead line", {"gravity": [1.0, 0.0, -9.81]}, "hangs_as_catenary: off by"),
        ("glass fibre", {"end.mass": 1e-7}, "sags_as_cantilever: off by"),
        ("column above its buckling load", {"loads.side.force": [0.0, 0.0, 0.02]}, "off by"),
        ("suture at rest", {"end.position": [0.101, 0.0, 0.0]}, "pulls_as_string: off by"),
        ("straight under compression", {"loads.side.force": [0.0, 0.0, 1e-6]}, "off by"),
        ("aluminium wire", {"cable.length": -1.0}, "refused: cable.length"),
    ],
)
def test_a_wrong_cable_is_not_right(name, changes, problem):
    found = judged(replace(EXTREMES[name], values=EXTREMES[name].values | changes))
    assert found.outcome == WRONG and problem in found.problem


def test_an_unstable_shape_is_not_at_rest():
    """A hose between grippers, kept in its plane, in which it cannot stay."""
    values = EXTREMES["ring"].values | {"cable.rest_curvature": [0.0]}
    standing = values | {"gravity": [-30.0, 0.0, 0.0], "initial.shape": "straight"}
    found = judged(Case("standing", standing, check=judge.right_at_rest))
    assert found.problem.startswith(("unstable", "not at rest"))


def test_a_stopped_scene_keeps_its_state():
    """A step far beyond the limit of an explicit method, taken all the same."""
    values = wire(ALUMINIUM) | {"integrator.method": "velocity_verlet"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judge, "Simulator", lambda scene: Simulator(scene, unchecked_step=True))
        found = judged(Case("beyond the limit", values, 10.0, must_run=False))
    assert (found.outcome, found.problem) == (STOPPED, "")
    assert "energy" in found.reason
