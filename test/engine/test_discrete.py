"""The discrete gradient: exact change of the energy, no resultant, and its tangent."""

import elasticity
import numpy as np
import pytest
from cables import BENT, BY_SPAN, FLAT, Bench, wild
from differences import assert_limit, central
from numba import float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.engine.arrays import BETWEEN, CURVED, SPAN_STRETCH, cable_at
from dlo_sim.engine.assembly import discrete_gradient, discrete_jacobian
from dlo_sim.engine.band import clear_band
from dlo_sim.engine.tension import take_tension

LOOSE = {"end.spring": [0.0, 0.0, 0.0], "end.pose_topic": "", "damping.stiffness": 1.0}
ELASTIC = BENT | FLAT | LOOSE
STRAIGHT_AT_REST = {"cable.rest_curvature": [1e-12]}
BETA_OVER_TAU = 0.4


@kernel(float64, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, float64, ARRAY_2D, family=BETWEEN)
def forces_between(address, x0, x1, moved, viscous, out):
    ends = grid(x0), grid(x1), grid(moved)
    return discrete_gradient(cable_at(address), *ends, viscous, grid(out))


@kernel(void, int64, ARRAY_2D, ARRAY_2D, float64, family=BETWEEN)
def tangent_between(address, x0, x1, viscous):
    cable = cable_at(address)
    clear_band(cable.work.band)
    take_tension(cable, grid(x0), grid(x1))
    discrete_jacobian(cable, grid(x0), grid(x1), viscous, 0.5, 1.0, cable.work.band)


class Between(Bench):
    """What acts between two configurations."""

    def padded(self, points):
        """Control points as lines with margins."""
        return self.cable.padded(self.model.to_lines(points))

    def between(self, first, second, viscous=0.0):
        """Force on the axes of the scene, shape (n, dim), and the energy lost."""
        given = [self.padded(points) for points in (first, second, second - first)]
        out = np.zeros_like(given[0])
        lost = self.cable.call(forces_between, *given, viscous, out)
        return self.cable.shown(out)[: len(self.axes)].T.copy(), lost

    def tangent(self, first, second, viscous=0.0):
        """d (minus force) / d second, shape (n dim, n dim)."""
        ends = self.padded(first), self.padded(second)
        self.cable.call(tangent_between, *ends, viscous)
        return self.band_of_axes()

    def elastic(self, points):
        """Stretching and bending energy [J]."""
        parts = self.potentials(points)
        return parts["stretch"] + parts["bend"]


PLANE = FLAT | {
    "terms.out_of_plane": "off",
    "cable.length": 1.0,
    "cable.diameter": 0.02,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 60.0,
    "cable.bending_stiffness": 0.02,
    "cable.rest_curvature": [0.5, -1.0, 2.0],
}
KINDS = {
    "by_sample": (ELASTIC, {}),
    "graded_by_span": (ELASTIC | BY_SPAN, {"grading": 0.5}),
    "planar": (PLANE, {}),
    "planar_by_span": (PLANE | BY_SPAN, {}),
    "hose": (ELASTIC | BY_SPAN | {"hose.pressure": 1e6, "hose.bore": 3e-3}, {}),
}


@pytest.fixture(scope="module", params=KINDS)
def bench(request):
    values, more = KINDS[request.param]
    bench = Between(values, {"damping.stiffness": 1.0}, n=12, **more)
    assert len(bench.axes) == (2 if "planar" in request.param else 3)
    assert bench.model.has(CURVED)
    return bench


def pair(bench, seed=0, size=0.02):
    """Two configurations that a step of this size leads from one to the other."""
    first = wild(bench, seed, size=0.02)
    second = first + wild(bench, seed + 10, size=size) - wild(bench, seed, size=0.0)
    for points in (first, second):
        points[:, [d for d in range(3) if d not in bench.axes]] = 0.0
        points[:, 3] = 0.0
    return first, second


@pytest.mark.parametrize("size", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_gives_the_exact_change_of_the_energy(bench, seed, size):
    """g . (q1 - q0) = U1 - U0 with stretching, bending and natural curvature."""
    first, second = pair(bench, seed, size)
    moved = (second - first)[:, list(bench.axes)]
    change = bench.elastic(second) - bench.elastic(first)
    scale = bench.elastic(first) + bench.elastic(second)
    assert abs(change) > 1e-4 * scale
    assert abs(np.sum(bench.between(first, second)[0] * moved) + change) < 1e-13 * scale
    # The force at the midpoint does not have the property: it is the gradient, not a difference.
    middle = 0.5 * (first + second)
    assert abs(np.sum(bench.between(middle, middle)[0] * moved) + change) > 1e-9 * scale


def test_it_is_symmetric_and_tends_to_the_gradient(bench):
    first, second = pair(bench)
    forward, backward = bench.between(first, second)[0], bench.between(second, first)[0]
    exact = bench.force(first)[:, list(bench.axes)]
    size = np.abs(exact).max()
    assert np.abs(forward - backward).max() < 1e-12 * size
    assert np.abs(bench.between(first, first)[0] - exact).max() < 1e-12 * size
    near = first + 1e-7 * (second - first)
    halfway = bench.force(0.5 * (first + near))[:, list(bench.axes)]
    assert np.abs(bench.between(first, near)[0] - halfway).max() < 1e-10 * size


def uneven_pair(bench, into):
    """Two configurations: into the guard, inside it, out of it, or beyond one another."""
    sizes = {"in": (0.02, 0.1), "inside": (0.1, 0.11), "out": (0.1, 0.02), "far": (0.08, 0.2)}[into]
    found = []
    for seed, size in enumerate(sizes):
        points = wild(bench, seed, size=size)
        points[:, [d for d in range(3) if d not in bench.axes]] = 0.0
        points[:, 3] = 0.0
        found.append(points)
    return found


@pytest.mark.parametrize("into", ["in", "inside", "out", "far"])
@pytest.mark.parametrize("kind", ["by_sample", "graded_by_span", "planar_by_span"])
def test_the_span_guard_is_a_discrete_gradient_with_its_tangent(kind, into):
    values, more = KINDS[kind]
    bench = Between(values, n=12, **more)
    first, second = uneven_pair(bench, into)
    by_span = bench.model.has(SPAN_STRETCH)
    stiff = elasticity.Section(EA=bench.scene.cable.EA, by_span=by_span)
    guards = [elasticity.guard(p, bench.model.knots, stiff)[0] for p in (first, second)]
    energies = [bench.elastic(p) for p in (first, second)]
    assert max(guards) > 0.01 * max(energies)
    axes = list(bench.axes)
    moved = (second - first)[:, axes]
    force = bench.between(first, second)[0]
    assert abs(np.sum(force * moved) + energies[1] - energies[0]) < 1e-13 * sum(energies)
    expected = -bench.force(second)[:, axes]
    assert (
        np.abs(bench.between(second, second)[0] + expected).max() < 1e-12 * np.abs(expected).max()
    )

    def after(points):
        ahead = second.copy()
        ahead[:, axes] = points
        return bench.between(first, ahead)[0].ravel()

    exact = -bench.tangent(first, second)
    shape = len(exact), bench.n, len(axes)
    assert_limit(exact.reshape(shape), after, second[:, axes].copy(), bound=1e-7)


@pytest.mark.parametrize("viscous", [0.0, BETA_OVER_TAU])
@pytest.mark.parametrize("stretch", [{}, BY_SPAN], ids=["by_sample", "by_span"])
def test_it_has_no_resultant(stretch, viscous):
    """No force and no moment about the midpoint configuration: momenta are conserved. (Viscosity
    damps the spin about the tangent, which is a moment.)"""
    bench = Between(ELASTIC, STRAIGHT_AT_REST, stretch, n=12)
    first, second = wild(bench, 0), wild(bench, 1)
    force = bench.between(first, second, viscous)[0]
    scale = np.abs(force).sum()
    middle = 0.5 * (first + second)[:, :3]
    assert scale > 0.1
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
    if not viscous:
        assert np.abs(np.cross(middle, force).sum(axis=0)).max() < 1e-12 * scale


def test_energy_lost_is_the_work_of_the_viscous_forces(bench):
    first, second = pair(bench)
    plain, nothing = bench.between(first, second)
    damped, lost = bench.between(first, second, BETA_OVER_TAU)
    assert nothing == 0.0
    taken = -np.sum((damped - plain) * (second - first)[:, list(bench.axes)])
    assert lost > 1e-6
    assert lost == pytest.approx(taken, rel=1e-10)


def test_its_tangent_is_its_derivative(bench):
    first, second = pair(bench, size=5e-3)
    axes = list(bench.axes)

    def force(moved):
        points = second.copy()
        points[:, axes] = moved
        return bench.between(first, points)[0].ravel()

    exact = -bench.tangent(first, second)
    assert np.abs(exact - exact.T).max() > 1e-6 * np.abs(exact).max()
    shape = len(exact), bench.n, len(axes)
    assert_limit(exact.reshape(shape), force, second[:, axes].copy(), bound=1e-7)


def test_its_tangent_with_viscosity_where_nothing_moves(bench):
    """Viscosity is linearised about the geometry of the step, which is exact for no increment."""
    points, _ = pair(bench)
    points[:, 1:] *= 0.1  # short of the span guard, which would be far stiffer
    points[:, 0] = bench.greville + 0.1 * (points[:, 0] - bench.greville)
    axes = list(bench.axes)

    def force(moved):
        second = points.copy()
        second[:, axes] = moved
        return bench.between(points, second, BETA_OVER_TAU)[0].ravel()

    exact, plain = -bench.tangent(points, points, BETA_OVER_TAU), -bench.tangent(points, points)
    assert np.abs(exact - plain).max() > 0.3 * np.abs(plain).max()
    shape = len(exact), bench.n, len(axes)
    assert_limit(exact.reshape(shape), force, points[:, axes].copy(), bound=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_of_damping_that_thins(kind):
    """For a motion fast enough, so small that the geometry stays."""
    values, more = KINDS[kind]
    damping = {"damping.stiffness": 0.0, "damping.bend": 1.0, "damping.thinning": 3e3}
    bench = Between(values, damping, n=12, **more)
    points, other = pair(bench)
    axes = list(bench.axes)
    way = 1e-4 * (other - points)[:, axes]

    def viscous(way):
        second = points.copy()
        second[:, axes] += way
        both = (bench.between(points, second, f)[0] for f in (BETA_OVER_TAU, 0.0))
        return np.subtract(*both).ravel()

    second = points.copy()
    second[:, axes] += way
    exact = bench.tangent(points, second) - bench.tangent(points, second, BETA_OVER_TAU)
    linear = bench.tangent(points, points) - bench.tangent(points, points, BETA_OVER_TAU)
    assert 0.05 < np.linalg.norm(exact) / np.linalg.norm(linear) < 0.8
    found = central(viscous, way, 1e-8).reshape(exact.shape)
    assert np.abs(found - exact).max() < 1e-3 * np.abs(exact).max()
