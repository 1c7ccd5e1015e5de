"""Compiled energies and forces: equal to the oracle, equal to minus the gradient, rigid motion."""

from dataclasses import replace

import numpy as np
import pytest
from cables import FLAT, FULL, SOFT, Bench, inflected, rotation, straight, wild
from differences import assert_limit

from dlo_sim.core import bspline, elasticity
from dlo_sim.simulation.model import _quadrature

GAUSS = {"discretization.quadrature": "gauss", "discretization.samples": 3}
UNIFORM = {"discretization.quadrature": "uniform", "discretization.samples": 41}
NO_SPRINGS = {"end.spring": [1e-12, 0.0, 0.0]}
# 1, 2, 8, 9 and 17 spans: one lane, some lanes, all lanes, one lane of a second and a third block.
SIZES = [4, 5, 11, 12, 20]
SHAPES = {"wild": wild, "straight": straight, "inflected": inflected}


def oracle(bench):
    """Arguments of the oracle that belong to a bench: knots, rule, section."""
    scene = bench.scene
    knots = bspline.clamped_knots(bench.n, scene.cable.length)
    cable = scene.cable
    twist = bench.rows == 4
    curvature = cable.rest_curvature
    section = elasticity.Section(
        cable.EA,
        cable.EI,
        cable.GJ if twist else 0.0,
        curvature,
        cable.rest_curvature_axis,
        by_span=bench.terms.span_stretch is not None,
    )
    return knots, _quadrature(scene, bench.n - 3), section


@pytest.fixture(scope="module", params=[4, 8], ids=["n4", "n8"])
def bench(request):
    return Bench(FULL, n=request.param)


@pytest.mark.parametrize("rule", [GAUSS, UNIFORM], ids=["gauss", "uniform"])
@pytest.mark.parametrize("n", SIZES)
def test_energies_and_forces_equal_the_oracle(n, rule):
    bench = Bench(FULL, FLAT, NO_SPRINGS, rule, n=n)
    knots, quadrature, section = oracle(bench)
    flat = replace(section, rest_curvature=(0.0,))
    natural = elasticity.energies(straight(bench), knots, quadrature, section)[1]
    for seed in range(3):
        points = wild(bench, seed, size=0.3 / n)
        stretch, bend, twist = elasticity.energies(points, knots, quadrature, section)
        found = bench.potentials(points)
        assert np.allclose(found[:3], [stretch, bend - natural, twist], rtol=1e-11)
        expected = -elasticity.gradient(points, knots, quadrature, section)
        scale = np.abs(expected).max(axis=0)
        assert np.all(np.abs(bench.force(points) - expected) < 1e-11 * scale)
        # The natural curvature takes part: without it the forces are others.
        without = -elasticity.gradient(points, knots, quadrature, flat)
        assert np.abs(without - expected).max() > 1e-3 * np.abs(expected).max()


def test_samples_on_knots_equal_the_oracle():
    """Uniform samples that fall on every knot, with padded lanes: 9 spans, 19 samples."""
    rule = {"discretization.quadrature": "uniform", "discretization.samples": 19}
    bench = Bench(SOFT, FLAT, rule, n=12)
    knots, quadrature, section = oracle(bench)
    points = wild(bench, 5) * [1, 1, 1, 0]
    expected = -elasticity.gradient(points, knots, quadrature, section)
    assert np.abs(bench.force(points) - expected).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("shape", SHAPES)
def test_force_is_minus_the_gradient_of_the_energy(bench, shape):
    """All terms at once: stretch, bend, natural curvature, twist, gravity, springs."""
    points = SHAPES[shape](bench)
    assert shape != "wild" or bench.potentials(points).all()
    rises = shape != "straight"  # no energy, no round-off
    assert_limit(-bench.force(points), bench.potential, points, bound=1e-8, rises=rises)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("part", ["stretch", "bend", "twist", "gravity", "spring"])
def test_each_term_alone_is_a_gradient(bench, part, shape):
    """A term is isolated by taking the force difference that its stiffness makes."""
    keys = {
        "stretch": ("cable.axial_stiffness", 120.0),
        "bend": ("cable.bending_stiffness", 0.05),
        "twist": ("cable.torsional_stiffness", 0.04),
        "gravity": ("gravity", [1.0, 2.0, -3.0]),
        "spring": ("end.spring", [3.0, 70.0, 5.0]),
    }
    key, value = keys[part]
    other = Bench(FULL, {key: value}, n=bench.n)
    points = SHAPES[shape](bench)
    points[:, :3] *= 1.02  # a straight cable is stretched and twisted as well
    points[:, 3] += 0.7 * bench.greville**2
    change = other.force(points) - bench.force(points)
    assert_limit(
        -change, lambda p: other.potential(p) - bench.potential(p), points, bound=3e-8, tiny=1e-12
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_elastic_forces_of_a_cable_have_no_resultant(shape):
    """Sum of forces and moment about the origin vanish, with the natural curvature turned along."""
    bench = Bench(FULL, FLAT, NO_SPRINGS, {"cable.rest_curvature": [1e-12]}, n=12)
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
    bench = Bench(FULL, FLAT, NO_SPRINGS, {"cable.rest_curvature": [1e-12]}, n=12)
    points = wild(bench)
    turn = rotation([0.7, -1.1, 0.4])
    moved = points.copy()
    moved[:, :3] = points[:, :3] @ turn.T + [2.0, -1.0, 0.5]
    moved[:, 3] += 0.3
    assert np.allclose(bench.potentials(moved)[:3], bench.potentials(points)[:3], rtol=1e-12)
    expected = bench.force(points)
    expected[:, :3] = expected[:, :3] @ turn.T
    assert np.abs(bench.force(moved) - expected).max() < 1e-11 * np.abs(expected).max()


def test_weight_of_cable_and_end_masses():
    bench = Bench(FULL, {"start.mass": 0.2, "end.mass": 0.3, "gravity": [0.0, 3.0, -9.81]}, n=9)
    weightless = Bench(FULL, FLAT, {"start.mass": 0.2, "end.mass": 0.3}, n=9)
    points = wild(bench)
    weight = bench.force(points) - weightless.force(points)
    assert np.allclose(weight.sum(axis=0), [0, 3.0 * 0.6, -9.81 * 0.6, 0], rtol=1e-11, atol=1e-12)
    # First moment along the cable: mu L^2 / 2 + m_end L.
    moment = bench.greville @ weight
    assert np.allclose(moment[1:3], np.array([3.0, -9.81]) * (0.1 / 2 + 0.3), rtol=1e-11)


def test_springs_pull_each_end_to_its_anchor():
    bench = Bench(FULL, n=8)
    loose = Bench(FULL, NO_SPRINGS, n=8)
    points = wild(bench)
    pull = bench.force(points) - loose.force(points)
    expected = -np.array([30.0, 20.0, 10.0]) * (points[-1, :3] - [1.0, 0.0, 0.0])
    assert np.allclose(pull[-1, :3], expected, rtol=1e-9)
    assert np.abs(pull[:-1]).max() < 1e-9
