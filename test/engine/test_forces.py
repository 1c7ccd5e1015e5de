"""Energies and forces: equal to the oracle, minus the gradient, unmoved by rigid motion."""

from dataclasses import replace

import elasticity
import numpy as np
import pytest
from cables import BENT, BY_SPAN, FLAT, SOFT, Bench, inflected, rotation, straight, wild
from differences import assert_limit

from dlo_sim.engine.arrays import SPAN_STRETCH

GAUSS = {"discretization.quadrature": "gauss", "discretization.samples": 3}
UNIFORM = {"discretization.quadrature": "uniform", "discretization.samples": 41}
NO_SPRINGS = {"end.spring": [1e-12, 0.0, 0.0]}
STRAIGHT_AT_REST = {"cable.rest_curvature": [1e-12]}
GRADED = {"grading": 0.6}
# 1, 2, 8, 9 and 17 spans: one lane, some lanes, all lanes, one lane of a second and a third block.
SIZES = [4, 5, 11, 12, 20]
SHAPES = {"wild": wild, "straight": straight, "inflected": inflected}
MESHES = {
    "gauss": (GAUSS, {}),
    "uniform": (UNIFORM, {}),
    "graded": (GAUSS, GRADED),
    "by_span": (BY_SPAN, {}),
    "graded_by_span": (BY_SPAN, GRADED),
}


def section_of(bench):
    """What the oracle multiplies the strains of a bench with."""
    cable = bench.scene.cable
    return elasticity.Section(
        cable.EA,
        cable.EI,
        cable.GJ if bench.model.twist else 0.0,
        cable.rest_curvature,
        cable.rest_curvature_axis,
        by_span=bench.model.has(SPAN_STRETCH),
    )


def oracle(bench, function, points, **changes):
    """Energies or gradient of the oracle."""
    section = replace(section_of(bench), **changes)
    return function(points, bench.model.knots, bench.model.rule, section)


@pytest.fixture(scope="module", params=[4, 8], ids=["n4", "n8"])
def bench(request):
    return Bench(BENT, n=request.param)


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("n", SIZES)
def test_energies_and_forces_equal_the_oracle(n, mesh):
    values, more = MESHES[mesh]
    n = max(n, 5) if "span" in mesh else n
    bench = Bench(BENT, FLAT, NO_SPRINGS, values, n=n, **more)
    assert bench.model.has(SPAN_STRETCH) == ("span" in mesh)
    natural = oracle(bench, elasticity.energies, straight(bench))[1]
    for seed in range(3):
        points = wild(bench, seed, size=0.2 * bench.greville[2])
        stretch, bend, twist = oracle(bench, elasticity.energies, points)
        found = bench.potentials(points)
        assert found["stretch"] == pytest.approx(stretch, rel=1e-11)
        assert found["bend"] == pytest.approx(bend - natural, rel=1e-11)
        assert found["twist"] == pytest.approx(twist, rel=1e-11)
        expected = -oracle(bench, elasticity.gradient, points)
        scale = np.abs(expected).max(axis=0)
        assert np.all(np.abs(bench.force(points) - expected) < 1e-11 * scale)
        # The natural curvature takes part: without it the forces are others.
        without = -oracle(bench, elasticity.gradient, points, rest_curvature=(0.0,))
        bends = oracle(bench, elasticity.gradient, points, EA=0.0)
        assert np.abs(without - expected).max() > 1e-5 * np.abs(bends).max()


@pytest.mark.parametrize("mesh", ["uniform", "by_span", "graded_by_span"])
@pytest.mark.parametrize("n", [5, 11, 20])
def test_the_span_guard_equals_the_oracle(n, mesh):
    values, more = MESHES[mesh]
    bench = Bench(BENT, FLAT, NO_SPRINGS, values, n=n, **more)
    for seed in range(3):
        points = wild(bench, seed, size=0.9 * bench.greville[2])
        points[:, :3] *= 0.5 if bench.model.has(SPAN_STRETCH) else 0.2
        stretch = oracle(bench, elasticity.energies, points)[0]
        guard = elasticity.guard(points, bench.model.knots, section_of(bench))[0]
        assert guard > 1e-3 * stretch
        assert bench.potentials(points)["stretch"] == pytest.approx(stretch, rel=1e-11)
        expected = -oracle(bench, elasticity.gradient, points)
        scale = np.abs(expected).max(axis=0)
        assert np.all(np.abs(bench.force(points) - expected) < 1e-11 * scale)


@pytest.mark.parametrize("shape", SHAPES)
def test_force_is_minus_the_gradient_of_the_energy(bench, shape):
    """All terms at once: stretch, bend, natural curvature, twist, gravity, springs."""
    points = SHAPES[shape](bench)
    parts = bench.potentials(points)
    present = ("stretch", "bend", "twist", "gravity", "spring")
    assert shape != "wild" or all(parts[name] for name in present)
    rises = shape != "straight"  # no energy, no round-off
    assert_limit(-bench.force(points), bench.potential, points, bound=1e-8, rises=rises)


@pytest.mark.parametrize("shape", SHAPES)
def test_elastic_forces_of_a_cable_have_no_resultant(shape):
    """Sum of forces and moment about the origin vanish, of a cable straight at rest."""
    bench = Bench(BENT, FLAT, NO_SPRINGS, STRAIGHT_AT_REST, n=12, **GRADED)
    points = SHAPES[shape](bench)
    force = bench.force(points)[:, :3]
    if shape == "straight":
        assert np.abs(force).max() < 1e-10
        return
    scale = np.abs(force).sum()
    assert scale > 0.1
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
    assert np.abs(np.cross(points[:, :3], force).sum(axis=0)).max() < 1e-12 * scale
    assert abs(bench.force(points)[:, 3].sum()) < 1e-12


def test_rigid_motion_of_a_bent_cable_costs_no_energy_and_turns_the_force():
    bench = Bench(BENT, FLAT, NO_SPRINGS, STRAIGHT_AT_REST, n=12)
    points = wild(bench)
    turn = rotation([0.7, -1.1, 0.4])
    moved = points.copy()
    moved[:, :3] = points[:, :3] @ turn.T + [2.0, -1.0, 0.5]
    moved[:, 3] += 0.3
    before, after = bench.potentials(points), bench.potentials(moved)
    for name in ("stretch", "bend", "twist"):
        assert after[name] == pytest.approx(before[name], rel=1e-12)
    expected = bench.force(points)
    expected[:, :3] = expected[:, :3] @ turn.T
    assert np.abs(bench.force(moved) - expected).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("more", [{}, GRADED], ids=["uniform", "graded"])
def test_weight_of_cable_and_end_masses(more):
    masses = {"start.mass": 0.2, "end.mass": 0.3}
    bench = Bench(BENT, masses, {"gravity": [0.0, 3.0, -9.81]}, n=9, **more)
    weightless = Bench(BENT, FLAT, masses, n=9, **more)
    points = wild(bench)
    weight = bench.force(points) - weightless.force(points)
    assert np.allclose(weight.sum(axis=0), [0, 3.0 * 0.6, -9.81 * 0.6, 0], rtol=1e-11, atol=1e-12)
    # First moment along the cable: mu L^2 / 2 + m_end L.
    moment = bench.greville @ weight
    assert np.allclose(moment[1:3], np.array([3.0, -9.81]) * (0.1 / 2 + 0.3), rtol=1e-11)


def test_springs_pull_each_end_to_its_anchor():
    bench = Bench(BENT, n=8)
    loose = Bench(BENT, NO_SPRINGS, n=8)
    points = wild(bench)
    pull = bench.force(points) - loose.force(points)
    expected = -np.array([30.0, 20.0, 10.0]) * (points[-1, :3] - [1.0, 0.0, 0.0])
    assert np.allclose(pull[-1, :3], expected, rtol=1e-9)
    assert np.abs(pull[:-1]).max() < 1e-9


@pytest.mark.parametrize("strain", [0.01, 0.5, -0.45])
def test_an_even_stretch_by_span_is_exact(strain):
    bench = Bench(SOFT, BY_SPAN, FLAT, n=9)
    points = straight(bench) * [1.0 + strain, 1.0, 1.0, 1.0]
    exact = 0.5 * bench.scene.cable.EA * strain**2
    assert bench.potentials(points)["stretch"] == pytest.approx(exact, rel=1e-12)


def test_a_linear_stretch_by_span_gets_nothing_from_the_guard():
    """|r'| = 0.9 + 0.4 u: it varies by 7 % within a span."""
    bench = Bench(SOFT, BY_SPAN, FLAT, n=9)
    points = straight(bench)
    u = bench.greville
    inner = np.zeros(len(u))
    inner[1:] = np.cumsum(np.diff(u) * (0.9 + 0.2 * (u[1:] + u[:-1])))
    points[:, 0] = inner
    assert elasticity.guard(points, bench.model.knots, section_of(bench))[0] == 0.0
    stretch = oracle(bench, elasticity.energies, points)[0]
    assert stretch > 0.0
    assert bench.potentials(points)["stretch"] == pytest.approx(stretch, rel=1e-12)
