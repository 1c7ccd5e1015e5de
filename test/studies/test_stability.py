"""`dlo_sim study stability`, cut down to one cable and few methods: its numbers and its report."""

import csv
import math
from dataclasses import replace

import pytest

from dlo_sim.batch.workers import Here
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import STUDIES, Request
from dlo_sim.studies.stability import map_figures, maps, stiff, study
from dlo_sim.studies.stability.maps import FINISHED, REFUSED, SKIPPED, STOPPED, Point
from dlo_sim.studies.stability.random_checks import WRONG, Outcome
from dlo_sim.studies.stability.scenes import EXTREMES

METHODS = {
    name: maps.METHODS[name] for name in ("forest_ruth", "velocity_verlet", "energy_momentum")
}
SMALL = replace(
    maps.QUICK,
    values={"n_u": (5, 9), "E": (1e8,), "diameter": (1e-2,)},
    steps=(1e-5, 1e-3, 1e-1),
    duration=0.1,
    trial=0.02,
)


def point(method: str, damping: str = "undamped", motion: str = "large") -> Point:
    return Point("n_u", 9, method, damping, motion, SMALL)


@pytest.mark.parametrize("motion", ["linear", "large"])
@pytest.mark.parametrize("damping", ["undamped", "damped"])
def test_observed_limit_is_the_predicted_one(damping, motion):
    found = maps.examine(point("velocity_verlet", damping, motion))
    assert found.observed == pytest.approx(found.predicted, rel=1.5 * SMALL.tolerance)
    # axial waves: 2 / omega of the shortest wave that nine control points hold, 2.3e-5 s or so
    assert 1e-5 < found.predicted < 4e-5
    assert found.outcomes == (FINISHED, STOPPED, STOPPED)
    assert found.errors[0] < 1e-4
    assert math.isinf(found.errors[1])


def test_observed_limit_is_found_wherever_it_is(monkeypatch):
    for limit in (3.3e-6, 2.9e-5, 2.2e-4):
        monkeypatch.setattr(maps, "_survives", lambda point, step, limit=limit: step < limit)
        found, below = maps._observed(point("rk4"), 3e-5)
        assert found == pytest.approx(limit, rel=SMALL.tolerance)
        assert below is None
    monkeypatch.setattr(maps, "_survives", lambda point, step: True)
    assert maps._observed(point("rk4"), 3e-5) == (math.inf, None)


@pytest.mark.parametrize("predicted", [3e-5, 3e-2])
def test_a_limit_is_looked_for_down_to_the_smallest_step(predicted, monkeypatch):
    monkeypatch.setattr(maps, "_survives", lambda point, step: step < 1.2 * SMALL.steps[0])
    found, below = maps._observed(point("rk4"), predicted)
    assert (found, below) == (pytest.approx(1.2 * SMALL.steps[0], rel=SMALL.tolerance), None)
    monkeypatch.setattr(maps, "_survives", lambda point, step: False)
    found, below = maps._observed(point("rk4"), predicted)
    assert found == 0.0
    assert SMALL.steps[0] / 10.0 < below < SMALL.steps[0]


def test_an_implicit_method_without_a_limit_says_below_what():
    assert maps._reached((1e-3, 1e-2), (FINISHED, STOPPED)) == (1e-3, None)
    assert maps._reached((1e-4, 1e-3), (SKIPPED, STOPPED)) == (0.0, 1e-3)


def test_a_limit_that_is_not_found_is_shown():
    found = maps.Limits(1e-3, 0.0, (STOPPED,) * 3, (math.inf,) * 3, 0.0, below=9e-6)
    results = {point("rk4"): found}
    assert "none found at 1 points: below 9e-06 s" in map_figures._summary([found])
    _, (axes,) = plotting.new_figure()
    map_figures._limits(axes, 0, found, SMALL.steps)
    assert [line.get_marker() for line in axes.get_lines()] == ["v"]
    columns = map_figures._columns(SMALL, results, "n_u", "undamped")
    assert columns["observed below [s]"] == [9e-6] * 3
    assert all(math.isnan(limit) for limit in columns["observed limit [s]"])


def test_damping_with_negative_steps_is_refused():
    found = maps.examine(point("forest_ruth", "damped"))
    assert (found.predicted, found.observed) == (None, None)
    assert set(found.outcomes) == {REFUSED}
    assert "negative sub-steps" in found.reason


def test_energy_momentum_has_no_limit():
    found = maps.examine(point("energy_momentum"))
    assert found.outcomes == (SKIPPED, FINISHED, FINISHED)
    assert (found.predicted, found.observed) == (math.inf, 0.1)
    assert max(found.errors[1:]) < 1e-6


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """The whole study with few pieces, and the folder that it wrote."""
    folder = tmp_path_factory.mktemp("stability")
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(maps, "QUICK", SMALL)
        patch.setattr(maps, "METHODS", METHODS)
        patch.setattr(map_figures, "METHODS", METHODS)
        patch.setattr(study, "EXTREMES", tuple(e for e in EXTREMES if e.name in KEPT))
        patch.setattr(study, "RANDOM", {True: 3})
        patch.setattr(study, "run_seed", _random)
        patch.setattr(stiff, "ASKED_RATIO", {9: 20.0})
        patch.setattr(stiff, "CONVERGED", 1e-3)
        patch.setattr(stiff, "DURATION", 1.0)
        patch.setattr(stiff, "COMPARED", 0.1)
        request = Request(folder, True, "dlo_sim study stability", Here(), progress=seen.append)
        result = STUDIES["stability"].run(request)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    return folder, result


KEPT = ("aluminium wire", "n_u = 4", "suture of 3 kg/m^3, sudden")
OUTCOMES = (
    {"outcome": "ran", "steps": 50, "energy_error": 0.2, "floor_share": 3.0, "closed": 0.1},
    {"outcome": "refused", "reason": "integrator.step: 1 s exceeds (x); lower it"},
    {"outcome": WRONG, "problem": "energy balance open by 1", "steps": 3, "energy_error": 1.0},
)


def _random(seed):
    return Outcome(seed, "hanging", "rk4", 1e-3, 9, **OUTCOMES[seed])


def rows_of(folder, name):
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_figure_has_its_data(outcome):
    folder, result = outcome
    expected = {f"map_{axis}_{d}.png" for axis in maps.KEYS for d in maps.DAMPING}
    assert set(result.figures) == {*expected, "random_energy.png"}
    for name in expected:
        assert (folder / name).stat().st_size > 20_000
    rows = rows_of(folder, "map_n_u_undamped")
    assert len(rows) == len(METHODS) * len(maps.GRAVITY) * 2 * len(SMALL.steps)
    assert {row["outcome"] for row in rows} == {FINISHED, STOPPED, SKIPPED}


def test_tables_of_the_report(outcome):
    folder, result = outcome
    assert result.tables["limits"] == len(METHODS) * 4
    assert result.tables["stiff"] == len(stiff.STEPS) + len(stiff.HARD_STEPS)
    assert result.tables["extremes"] == len(KEPT)
    assert result.tables["random_wrong"] == 1
    random = rows_of(folder, "random")[0]
    assert (random["ran, not moved"], random["above 0.1"]) == ("1", "1 (100.0%)")
    assert float(rows_of(folder, "random_balances")[0]["energy: largest error"]) == 0.1
    for row in rows_of(folder, "stiff"):
        assert float(row["energy error"]) < 1e-6
        retried = int(row["steps retried smaller"])
        assert retried > 0 if float(row["step [ms]"]) == 100.0 else retried >= 0
    assert float(rows_of(folder, "stiff")[0]["error [m]"]) < 0.05


def test_what_falls_short_is_said(outcome):
    folder, result = outcome
    report = (folder / "report.md").read_text(encoding="utf-8")
    verdicts = result.verdicts
    assert verdicts["3 random scenes"].startswith("falls short (1 wrong")
    assert verdicts["aluminium wire"].startswith("holds")
    assert verdicts["energy at 2, 5 and 10 ms"].startswith("holds")
    short = sum(answer.startswith("falls short") for answer in verdicts.values())
    assert report.count("**falls short**") == short >= 1
    assert f"{len(verdicts) - short} of {len(verdicts)} hold" in report
    assert " nan" not in report
