"""`dlo_sim study scaling --quick` with small sizes, run once; what it measures with; memory."""

import csv
import tracemalloc

import numpy as np
import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.core.methods import METHODS
from dlo_sim.studies.catalogue import STUDIES, Request
from dlo_sim.studies.scaling import study as scaling
from dlo_sim.studies.scaling.study import moving

SIZES = (9, 13, 100, 400)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder and outcome of one quick study of small cables."""
    folder = tmp_path_factory.mktemp("scaling")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scaling, "SIZES", {True: SIZES})
        patch.setattr(scaling, "REPEATS", {True: 2})
        patch.setattr(scaling, "WATCHED", {True: {"forest_ruth": 20_000, "energy_momentum": 5_000}})
        outcome = STUDIES["scaling"].run(Request(folder, True, "dlo_sim study scaling", HERE))
    return folder, outcome


def rows(study, name):
    """A table or a figure's data as dictionaries."""
    with (study[0] / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_tables_and_figures_are_there(study):
    folder, outcome = study
    methods = len(scaling.METHODS_TIMED[True])
    assert outcome.tables == {"steps": 4 * methods, "exponents": methods, "memory": 2}
    assert outcome.figures == ["time_of_a_step.png", "resident_memory.png"]
    for name in outcome.figures:
        assert (folder / name).stat().st_size > 10_000
    assert len(outcome.verdicts) == methods + 2


@pytest.mark.slow
def test_every_run_is_timed(study):
    found = rows(study, "steps")
    assert {(row["method"], int(row["n_u"])) for row in found} == {
        (method, size) for method in scaling.METHODS_TIMED[True] for size in SIZES
    }
    for row in found:
        assert 0.0 < float(row["time [us/step]"]) < 1e4
        evaluations = float(row["evaluations per step"])
        exact = METHODS[row["method"]].force_evaluations
        assert evaluations == pytest.approx(exact, abs=0.1) if exact else evaluations > 1.0
        each = float(row["time [us/step]"]) / evaluations
        assert float(row["time [us/evaluation]"]) == pytest.approx(each)
    # measured 0.6 to 1.4 on a busy machine; one more power of n_u made it 1.6 to 2.4
    for row in rows(study, "exponents"):
        assert 0.5 < float(row["step, all sizes"]) < 1.5, row["method"]


def test_slope_is_the_exponent():
    sizes = [9, 40, 100, 400]
    cubes = [2e-6 * size**3 for size in sizes]
    assert scaling.slope(sizes, cubes) == pytest.approx(3.0)
    bent = [1.0, 1.0, *[float(size) for size in sizes[2:]]]
    assert scaling.slope(sizes, bent, least=100) == pytest.approx(1.0)
    assert np.isnan(scaling.slope(sizes, cubes, least=400))
    assert scaling.slope(sizes, [*cubes[:3], float("nan")]) == pytest.approx(3.0)


def bytes_left(simulator, calls):
    """Traced bytes (Python's and numpy's) that so many calls of `advance_steps` leave behind."""
    tracemalloc.start()
    try:
        for _ in range(calls):
            simulator.advance_steps(1)
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(calls):
            simulator.advance_steps(1)
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def peak_of_a_call(simulator, steps):
    """Most traced bytes in use during one call of `advance_steps` beyond those before it."""
    tracemalloc.start()
    try:
        simulator.advance_steps(steps)
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        simulator.advance_steps(steps)
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "method, count", [("forest_ruth", 1_000_000), ("energy_momentum", 100_000)]
)
def test_memory_does_not_grow(method, count):
    simulator = moving(9, method)
    _, resident = scaling.watched(simulator, count, looks=20)
    # A byte a step would be 90 KB or more; a page or two are the interpreter's. Measured: 0.
    assert resident[-1] - resident[2] < 64 * 1024
    assert resident[0] > 10e6
    # A block a call would be 1000; a score now and then is the test runner's own.
    assert scaling.blocks_left(simulator, 1000) < 100
    assert bytes_left(simulator, 200) < 200
    assert peak_of_a_call(simulator, 20_000) < peak_of_a_call(simulator, 1) + 1000


def test_what_is_left_behind_is_seen():
    simulator = moving(9, "forest_ruth")
    kept = []
    original = simulator.advance_steps

    def leaking(count):
        kept.append(np.zeros(64))
        return original(count)

    simulator.advance_steps = leaking
    assert scaling.blocks_left(simulator, 200) >= 200
    assert bytes_left(simulator, 200) > 200 * 512
