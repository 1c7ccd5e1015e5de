"""`dlo_sim study scaling --quick` with small sizes, run once; what it measures with; memory."""

import csv
import dataclasses

import numpy as np
import pytest

from dlo_sim.batch.workers import Here
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.core.spectrum import dense
from dlo_sim.studies.arithmetic import operations
from dlo_sim.studies.catalogue import STUDIES, Request
from dlo_sim.studies.scaling import memory, parts, steps
from dlo_sim.studies.scaling.wire import moving


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder and outcome of one quick study of small cables."""
    folder = tmp_path_factory.mktemp("scaling")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "SIZES", {True: (9, 13, 100, 400)})
        patch.setattr(steps, "REPEATS", {True: 2})
        patch.setattr(parts, "SIZES", {True: (9, 13)})
        patch.setattr(parts, "REPEATS", {True: 2})
        patch.setattr(memory, "STEPS", {True: {"forest_ruth": 20_000, "energy_momentum": 5_000}})
        outcome = STUDIES["scaling"].run(Request(folder, True, "dlo_sim study scaling", Here()))
    return folder, dataclasses.asdict(outcome)


def rows(study, name):
    """A table or a figure's data as dictionaries."""
    with (study[0] / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_tables_and_figures_are_there(study):
    folder, outcome = study
    methods = len(steps.METHODS_TIMED)
    sums = len((parts.WHOLE_STEP, parts.ITERATION))
    assert outcome["tables"] == {
        "steps": 4 * methods,
        "exponents": methods,
        "memory": 2,
        "parts": 2 * (1 + len(parts.IMPLICIT) + sums),
    }
    assert len(outcome["figures"]) == 3
    text = (folder / "report.md").read_text(encoding="utf-8")
    for name in outcome["figures"]:
        assert (folder / name).stat().st_size > 10_000
        assert f"({name})" in text
    assert len(outcome["verdicts"]) == methods + 4


@pytest.mark.slow
def test_every_run_is_timed_or_says_why_not(study):
    found = rows(study, "steps")
    assert {(row["method"], row["n_u"]) for row in found} == {
        (method, size) for method in steps.METHODS_TIMED for size in ("9", "13", "100", "400")
    }
    for row in found:
        assert not row["note"]
        assert 0.0 < float(row["time [us/step]"]) < 1e4
        implicit = METHODS[row["method"]].family == IMPLICIT
        assert bool(row["iterations per step"]) == implicit
    grown = {row["method"]: row for row in rows(study, "exponents")}
    # measured 0.6 to 1.4 on a busy machine; one more power of n_u made it 1.6 to 2.4
    for row in grown.values():
        assert 0.5 < float(row["step, all sizes"]) < 1.5, row["method"]


@pytest.mark.slow
def test_parts_add_up(study):
    found = [row for row in rows(study, "parts") if row["n_u"] == "13"]
    value = {row["part"]: row for row in found}
    for column in ("operations", "time [us]"):
        total = sum(float(value[name][column]) for name in parts.IMPLICIT)
        assert float(value[parts.ITERATION][column]) == pytest.approx(total)
    forces = 3 * float(value[parts.EXPLICIT]["operations"])
    assert float(value[parts.WHOLE_STEP]["operations"]) == forces


def test_slope_is_the_exponent():
    sizes = [9, 40, 100, 400]
    cubes = [2e-6 * size**3 for size in sizes]
    assert steps.slope(sizes, cubes) == pytest.approx(3.0)
    bent = [1.0, 1.0, *[float(size) for size in sizes[2:]]]
    assert steps.slope(sizes, bent, least=100) == pytest.approx(1.0)
    assert np.isnan(steps.slope(sizes, cubes, least=400))
    assert steps.slope(sizes, [*cubes[:3], float("nan")]) == pytest.approx(3.0)


def test_parts_do_what_they_are_named_after():
    prepared = parts.parts(11)
    x, terms, _, work, solver = prepared["implicit force"].arguments
    prepared[parts.EXPLICIT].loop(x, terms, work, 3)
    explicit = work.force[:, :11].copy()
    assert np.abs(explicit).max() > 0.1  # bent and stretched: there is a force
    solver.p0[:] = solver.p1
    prepared["implicit force"].loop(*prepared["implicit force"].arguments, 3)
    assert work.force[:, :11] == pytest.approx(explicit, rel=1e-9, abs=1e-7)
    prepared["factors"].loop(*prepared["factors"].arguments, 3)
    prepared["solution"].loop(*prepared["solution"].arguments, 3)
    _, matrix, factored = prepared["factors"].arguments
    left = dense(matrix) @ factored.residual
    assert np.abs(factored.rhs).max() > 0.1
    assert left == pytest.approx(factored.rhs, rel=1e-9, abs=1e-9)


def test_operations_of_the_factors_are_those_of_the_loops():
    size, half = 2 * 11, 7
    rows_below = [min(half, size - 1 - row) for row in range(size)]
    by_hand = sum(2 + below * (1 + 2 * (half + 1)) for below in rows_below)
    part = parts.parts(11)["factors"]
    assert operations(part.source, *part.arguments) == by_hand
    constant, each = parts.counted()["factors"]
    assert constant + 11 * each == by_hand
    assert each == 2 * (2 + half * (1 + 2 * (half + 1)))


def test_operations_grow_in_proportion_to_the_control_points():
    """Counts, not times: with 8, 16 and 32 spans, full vector lanes, every part is linear."""
    few, some, many = (
        {name: operations(part.source, *part.arguments) for name, part in parts.parts(n).items()}
        for n in (11, 19, 35)
    )
    assert set(few) == {parts.EXPLICIT, *parts.IMPLICIT}
    for name in few:
        assert some[name] > few[name] > 0
        assert many[name] - some[name] == 2 * (some[name] - few[name]), name


@pytest.mark.parametrize(
    "method, count", [("forest_ruth", 1_000_000), ("energy_momentum", 100_000)]
)
def test_memory_does_not_grow(method, count):
    simulator = moving(9, method)
    _, resident = memory.watched(simulator, count, looks=20)
    # A byte a step would be 90 KB or more; a page or two are the interpreter's. Measured: 0.
    assert resident[-1] - resident[2] < 64 * 1024
    assert resident[0] > 10e6
    # A block a call would be 1000; a score now and then is the test runner's own.
    assert memory.blocks_left(simulator, 1000) < 100
    assert memory.bytes_left(simulator, 200) < 200
    assert memory.peak_of_a_call(simulator, 20_000) < memory.peak_of_a_call(simulator, 1) + 1000


def test_what_is_left_behind_is_seen():
    simulator = moving(9, "forest_ruth")
    kept = []
    original = simulator.advance_steps

    def leaking(count):
        kept.append(np.zeros(64))
        return original(count)

    simulator.advance_steps = leaking
    assert memory.blocks_left(simulator, 200) >= 200
    assert memory.bytes_left(simulator, 200) > 200 * 512
