"""`dlo_sim study stability`, cut down to one cable and few methods: its numbers and its report."""

import math

import pytest
from study_tables import quick, rows_of

from dlo_sim.studies import stability as maps
from dlo_sim.studies.stability import FINISHED, REFUSED, SKIPPED, STOPPED, Point

SMALL = maps.EXTENTS[True]._replace(
    values={"n_u": (5, 9), "E": (1e8,), "diameter": (1e-2,)},
    steps=(1e-5, 1e-3, 1e-1),
    duration=0.1,
    trial=0.02,
)
STEPS, TOLERANCE = SMALL.steps, SMALL.tolerance


@pytest.fixture(autouse=True, scope="module")
def small():
    """What a quick study computes, cut down."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(maps.EXTENTS, True, SMALL)
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
        monkeypatch.setattr(maps, "survives", lambda point, step, limit=limit: step < limit)
        found, below = maps.observed(point("rk4"), 3e-5)
        assert found == pytest.approx(limit, rel=TOLERANCE)
        assert math.isnan(below)
    monkeypatch.setattr(maps, "survives", lambda point, step: True)
    assert maps.observed(point("rk4"), 3e-5)[0] == math.inf


@pytest.mark.parametrize("predicted", [3e-5, 3e-2])
def test_a_limit_is_looked_for_down_to_the_smallest_step(predicted, monkeypatch):
    monkeypatch.setattr(maps, "survives", lambda point, step: step < 1.2 * STEPS[0])
    found, below = maps.observed(point("rk4"), predicted)
    assert found == pytest.approx(1.2 * STEPS[0], rel=TOLERANCE)
    assert math.isnan(below)
    monkeypatch.setattr(maps, "survives", lambda point, step: False)
    found, below = maps.observed(point("rk4"), predicted)
    assert math.isnan(found)
    assert STEPS[0] / 10.0 < below < STEPS[0]


def test_an_implicit_method_without_a_limit_says_below_what():
    reached, below = maps.reached((1e-3, 1e-2), (FINISHED, STOPPED))
    assert reached == 1e-3 and math.isnan(below)
    reached, below = maps.reached((1e-4, 1e-3), (SKIPPED, STOPPED))
    assert math.isnan(reached) and below == 1e-3


def test_a_limit_that_is_not_found_is_shown():
    found = maps.Limits((STOPPED,) * 3, (math.nan,) * 3, predicted=1e-3, below=9e-6)
    assert maps.summary([found])[:5] == [1, None, None, 1, 9e-6]


def test_damping_with_negative_steps_is_refused():
    found = maps.examine(point("forest_ruth", "damped"))
    assert math.isnan(found.predicted) and math.isnan(found.observed)
    assert set(found.outcomes) == {REFUSED}


def test_energy_momentum_has_no_limit():
    found = maps.examine(point("energy_momentum"))
    assert found.outcomes == (SKIPPED, FINISHED, FINISHED)
    assert (found.predicted, found.observed) == (math.inf, 0.1)
    assert max(found.errors[1:]) < 1e-6


@pytest.fixture(scope="module")
def outcome(small, tmp_path_factory):
    """The study cut down, and the folder that it wrote."""
    folder = tmp_path_factory.mktemp("stability")
    seen = []
    result = quick(maps, folder, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    return folder, result


def test_every_run_of_a_map_is_in_its_data(outcome):
    folder, _ = outcome
    rows = rows_of(folder, "map_n_u_undamped")
    assert len(rows) == len(SMALL.methods) * len(maps.GRAVITY) * 2 * len(STEPS)
    assert {row["outcome"] for row in rows} == {FINISHED, STOPPED, SKIPPED}


def test_verdicts_compare_limits_or_say_that_there_is_none(outcome):
    folder, result = outcome
    assert len(rows_of(folder, "limits")) == len(result.verdicts) == len(SMALL.methods) * 4
    assert result.verdicts["forest_ruth, damped, large"] == "refused"
    assert "no limit, energy error" in result.verdicts["energy_momentum, undamped, large"]
    words = result.verdicts["velocity_verlet, undamped, linear"]
    assert words.startswith("observed / predicted limit ")
    least, largest = map(float, words.split()[-3::2])
    assert 0.95 < least <= largest < 1.05
    assert " nan" not in (folder / "report.md").read_text(encoding="utf-8")
