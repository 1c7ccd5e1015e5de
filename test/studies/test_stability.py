"""`dlo_sim study stability`, cut down to one cable and few methods: its numbers and its report."""

import csv
import math
from dataclasses import replace

import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import Request, plotting
from dlo_sim.studies.stability import maps, stiff, study
from dlo_sim.studies.stability.maps import FINISHED, REFUSED, SKIPPED, STOPPED, Point
from dlo_sim.studies.stability.scenes import EXTREMES

SMALL = {
    "VALUES": {"n_u": (5, 9), "E": (1e8,), "diameter": (1e-2,)},
    "STEPS": (1e-5, 1e-3, 1e-1),
    "DURATION": 0.1,
    "TRIAL": 0.02,
}
STEPS, TOLERANCE, METHODS = SMALL["STEPS"], maps.TOLERANCE[True], maps.METHODS_COMPARED[True]


@pytest.fixture(autouse=True, scope="module")
def small():
    """What a quick study computes, cut down."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SMALL.items():
            patch.setattr(maps, name, {True: value})
        yield


def point(method: str, damping: str = "undamped", motion: str = "large") -> Point:
    return Point("n_u", 9, method, damping, motion, True)


@pytest.mark.parametrize("motion", ["linear", "large"])
@pytest.mark.parametrize("damping", ["undamped", "damped"])
def test_observed_limit_is_the_predicted_one(damping, motion):
    found = maps.examine(point("velocity_verlet", damping, motion))
    assert found.observed == pytest.approx(found.predicted, rel=1.5 * TOLERANCE)
    # axial waves: 2 / omega of the shortest wave that nine control points hold, 2.3e-5 s or so
    assert 1e-5 < found.predicted < 4e-5
    assert found.outcomes == (FINISHED, STOPPED, STOPPED)
    assert found.errors[0] < 1e-4
    assert math.isnan(found.errors[1])


def test_observed_limit_is_found_wherever_it_is(monkeypatch):
    for limit in (3.3e-6, 2.9e-5, 2.2e-4):
        monkeypatch.setattr(maps, "_survives", lambda point, step, limit=limit: step < limit)
        found, below = maps._observed(point("rk4"), 3e-5)
        assert found == pytest.approx(limit, rel=TOLERANCE)
        assert math.isnan(below)
    monkeypatch.setattr(maps, "_survives", lambda point, step: True)
    assert maps._observed(point("rk4"), 3e-5)[0] == math.inf


@pytest.mark.parametrize("predicted", [3e-5, 3e-2])
def test_a_limit_is_looked_for_down_to_the_smallest_step(predicted, monkeypatch):
    monkeypatch.setattr(maps, "_survives", lambda point, step: step < 1.2 * STEPS[0])
    found, below = maps._observed(point("rk4"), predicted)
    assert found == pytest.approx(1.2 * STEPS[0], rel=TOLERANCE)
    assert math.isnan(below)
    monkeypatch.setattr(maps, "_survives", lambda point, step: False)
    found, below = maps._observed(point("rk4"), predicted)
    assert math.isnan(found)
    assert STEPS[0] / 10.0 < below < STEPS[0]


def test_an_implicit_method_without_a_limit_says_below_what():
    reached, below = maps._reached((1e-3, 1e-2), (FINISHED, STOPPED))
    assert reached == 1e-3 and math.isnan(below)
    reached, below = maps._reached((1e-4, 1e-3), (SKIPPED, STOPPED))
    assert math.isnan(reached) and below == 1e-3


def test_a_limit_that_is_not_found_is_shown():
    found = maps.Limits((STOPPED,) * 3, (math.nan,) * 3, predicted=1e-3, below=9e-6)
    assert maps._summary([found])[:5] == [1, None, None, 1, 9e-6]
    _, (axes,) = plotting.new_figure()
    maps._mark(axes, 0, found, STEPS)
    assert [line.get_marker() for line in axes.get_lines()] == ["v"]


def test_damping_with_negative_steps_is_refused():
    found = maps.examine(point("forest_ruth", "damped"))
    assert math.isnan(found.predicted) and math.isnan(found.observed)
    assert set(found.outcomes) == {REFUSED}


def test_energy_momentum_has_no_limit():
    found = maps.examine(point("energy_momentum"))
    assert found.outcomes == (SKIPPED, FINISHED, FINISHED)
    assert (found.predicted, found.observed) == (math.inf, 0.1)
    assert max(found.errors[1:]) < 1e-6


KEPT = ("aluminium wire", "n_u = 4", "suture of 3 kg/m^3, sudden")


@pytest.fixture(scope="module")
def outcome(small, tmp_path_factory):
    """The whole study with few pieces, and the folder that it wrote."""
    folder = tmp_path_factory.mktemp("stability")
    seen = []
    kept = tuple(extreme for extreme in EXTREMES if extreme.name in KEPT)
    wrong = replace(kept[0], name="wrong", bound=1e-30)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "EXTREMES", (*kept, wrong))
        patch.setattr(stiff, "SIZES", {True: (9,)})
        patch.setattr(stiff, "CONVERGED", 1e-3)
        patch.setattr(stiff, "DURATION", 1.0)
        patch.setattr(stiff, "COMPARED", 0.1)
        request = Request(folder, True, "dlo_sim study stability", HERE, progress=seen.append)
        result = study.run_study(request)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    return folder, result


def rows_of(folder, name):
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_run_of_a_map_is_in_its_data(outcome):
    folder, _ = outcome
    rows = rows_of(folder, "map_n_u_undamped")
    assert len(rows) == len(METHODS) * len(maps.GRAVITY) * 2 * len(STEPS)
    assert {row["outcome"] for row in rows} == {FINISHED, STOPPED, SKIPPED}


def test_tables_of_the_report(outcome):
    folder, result = outcome
    assert result.tables["limits"] == len(METHODS) * 4
    rows = rows_of(folder, "stiff")
    assert len(rows) == sum(len(steps) for steps in stiff.KINDS.values())
    for row in rows:
        assert float(row["energy error"]) < 1e-6
        assert int(row["most in a step"]) >= float(row["iterations per step"]) > 1.0
        # a step of 100 ms fails at first and is done in pieces
        if float(row["step [ms]"]) == 100.0:
            assert int(row["most in a step"]) > 20
    assert 0.0 < float(rows[0]["error [mm]"]) < 50.0
    extremes = {row["scene"]: row for row in rows_of(folder, "extremes")}
    assert set(extremes) == {*KEPT, "wrong"}
    assert extremes["n_u = 4"]["error of"] == "energy balance, share of the energy exchanged"


def test_what_falls_short_is_said(outcome):
    folder, result = outcome
    report = (folder / "report.md").read_text(encoding="utf-8")
    assert result.verdicts["aluminium wire"].startswith("holds")
    assert result.verdicts["wrong"].startswith("falls short")
    assert report.count("**falls short") == report.count("**no**") == 1
    assert result.verdicts["energy, up to 10 ms"].endswith("0 of 12 runs stopped")
    assert " nan" not in report
