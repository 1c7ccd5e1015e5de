"""Stretching by means over spans: energy, force and stiffness against plain numpy; no locking."""

import numpy as np
import pytest
from cables import FULLY_DAMPED, SOFT, Bench, inflected, scene_of, simulator, straight, wild

from dlo_sim.core import elasticity, quadrature
from dlo_sim.scene.loading import SceneError

STIFF = {"discretization.stretch": "span", "cable.axial_stiffness": 5e3, "terms.gravity": "off"}


def bench_of(n, *values):
    """A cable whose stretching counts by span."""
    bench = Bench(SOFT, STIFF, *values, n=n)
    assert bench.terms.stretch is None
    assert bench.terms.span_stretch is not None
    return bench


def twin(bench):
    """Knots, rule and section of the same cable in plain numpy."""
    scene = bench.scene
    rule = quadrature.gauss(bench.n - 3, scene.cable.length, scene.discretization.samples)
    section = elasticity.Section(scene.cable.EA, scene.cable.EI, by_span=True)
    return bench.model.knots, rule, section


@pytest.mark.parametrize("n", [5, 6, 8, 13])
def test_energy_and_force_are_those_of_plain_numpy(n):
    bench = bench_of(n)
    knots, rule, section = twin(bench)
    for points in (wild(bench, n), wild(bench, n + 1, size=0.01), inflected(bench)):
        points[:, 3] = 0.0
        stretch, bend, _ = elasticity.energies(points, knots, rule, section)
        assert bench.potentials(points)[:2] == pytest.approx([stretch, bend], rel=1e-12)
        expected = -elasticity.gradient(points, knots, rule, section)
        np.testing.assert_allclose(
            bench.force(points), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
        )


def test_stiffness_is_the_derivative_of_the_force():
    bench = bench_of(8)
    points = wild(bench, 3)
    points[:, 3] = 0.0
    stiffness = bench.stiffness(points)
    step = 1e-6
    for column in range(3 * bench.n):
        moved = np.zeros((bench.n, 4))
        moved[column // 3, column % 3] = step
        ahead, back = bench.force(points + moved), bench.force(points - moved)
        change = (ahead - back)[:, :3].ravel() / (2.0 * step)
        np.testing.assert_allclose(
            -stiffness[:, column], change, rtol=0.0, atol=1e-8 * np.abs(stiffness).max()
        )


def test_no_motion_but_a_rigid_one_is_free():
    """As many strains as the derivative has degrees of freedom: nothing moves without energy."""
    for n in (5, 6, 9, 20):
        bench = bench_of(n, {"cable.bending_stiffness": 1e-9})
        axial = bench.stiffness(straight(bench))[::3, ::3]
        values = np.linalg.eigvalsh(axial)
        assert values[0] == pytest.approx(0.0, abs=1e-9 * values[-1])
        assert values[1] > 1e-4 * values[-1]


def test_stretched_evenly_is_exact():
    bench = bench_of(9)
    points = straight(bench)
    points[:, 0] *= 1.01
    scene = bench.scene
    assert bench.potentials(points)[0] == pytest.approx(0.5 * scene.cable.EA * 1e-4, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "cure"),
    [
        (
            {"discretization.quadrature": "uniform", "discretization.samples": 101},
            "discretization.quadrature to gauss",
        ),
        ({"discretization.control_points": 4}, "5 control points"),
    ],
)
def test_where_it_cannot_be_is_one_line(values, cure):
    with pytest.raises(SceneError, match="discretization.stretch: 'span'.*" + cure):
        scene_of(SOFT, STIFF, values)


@pytest.mark.parametrize("n", [7, 9, 13])
def test_a_thin_cantilever_bends(n):
    """A steel wire under its weight, against the elastica; at every sample it is off by 0.43,
    0.10 and 0.017 m."""
    values = {
        "cable.diameter": 1e-3,
        "cable.youngs_modulus": 2e11,
        "cable.density": 7800.0,
        "start.clamped": True,
        "initial.shape": "equilibrium",
        "discretization.stretch": "span",
    }
    # EI theta'' = q (L - s) cos theta, solved by collocation: tip at (0.7986259, -0.5602134)
    tip = simulator(values, n=n).control_points[-1, :3]
    off = np.linalg.norm(tip - [0.7986259, 0.0, -0.5602134])
    assert off < {7: 6e-3, 9: 1.6e-3, 13: 3e-4}[n]


def test_energy_is_kept_with_damping_and_driven_ends():
    sim = simulator(FULLY_DAMPED, STIFF, method="energy_momentum", step=2e-3, n=9)
    assert sim.model.terms.span_stretch is not None
    sim.set_end("end", position=[0.9, 0.1, -0.1])
    report = sim.advance(0.5)
    assert report.status.ok
    assert sim.energy_error < 1e-9
