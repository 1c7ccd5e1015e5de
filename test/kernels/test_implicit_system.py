"""The equations of an implicit step: the discrete gradient's identity, and Newton's matrix."""

import numpy as np
import pytest
from cables import BY_SPAN, FLAT, FULL, Bench, straight, wild
from differences import assert_limit

from dlo_sim.core import spectrum
from dlo_sim.kernels.elastic import tangent_coefficients
from dlo_sim.kernels.ends import copy_anchors
from dlo_sim.kernels.jit import entry
from dlo_sim.kernels.step_forces import momentum_residual, newton_matrix, step_force

QUIET = FULL | {"damping.mass": 1e-300, "damping.stiffness": 1e-300}
DAMPED = FULL | {"damping.mass": 0.8, "damping.stiffness": 5e-3, "damping.air_drag": 0.05}
TAU = 5e-3


@entry
def step_system(x, rates, terms, friction, viscosity, work, solver, tau, theta, rate, discrete):
    """Forces, residual and matrix of the step from solver.start to x, as the loop makes them.

    `rates` stands for the velocities and for the accelerations before the step.
    """
    n = terms.lattice.n
    dim = len(terms.axes)
    a = 2.0 / (tau * tau)
    tangent_coefficients(solver.start, terms.lattice, terms.axes, solver.p0)
    copy_anchors(terms.springs, work.anchors)
    lost = step_force(
        x,
        terms,
        friction,
        viscosity,
        work,
        solver,
        0.0,
        tau,
        theta,
        rate,
        discrete,
        True,
    )
    momentum_residual(terms, rates, work, solver, n, dim, a, a * tau, 0.3)
    newton_matrix(terms, friction, solver, n, dim, 0.0, tau, a, theta, rate)
    return lost


class Step:
    """The step's equations as functions of the new configuration."""

    def __init__(self, bench, discrete, start, theta=0.5, rate=1.0):
        self.bench, self.discrete, self.theta, self.rate = bench, discrete, theta, rate
        self.start = start
        self.rates = 0.3 * np.random.default_rng(9).normal(size=(bench.n, 4))

    def solve(self, points):
        bench = self.bench
        bench.solver.start[:] = bench.pack(self.start)
        bench.work.before[:] = bench.pack(points) - bench.solver.start
        bench.solver.start_w[:] = bench.pack(self.rates)
        midpoint = self.theta == 0.5
        offset = 0.0 if midpoint else (1.0 - self.rate) * TAU + 0.1 * TAU**2
        bench.solver.coast[:] = bench.pack(offset * self.rates)
        self.lost = step_system(
            bench.pack(points),
            bench.pack(0.0 * self.rates if midpoint else self.rates),
            bench.terms,
            bench.model.friction,
            bench.model.viscosity,
            bench.work,
            bench.solver,
            TAU,
            self.theta,
            self.rate,
            self.discrete,
        )

    def force(self, points):
        """Force of the step on x, y, z, shape (n, 3)."""
        self.solve(points)
        return self.bench.unpack(self.bench.work.force)[:, :3]

    def residual(self, xyz):
        """Residual of the momentum balance, shape (3 n,)."""
        self.solve(np.concatenate((xyz, self.start[:, 3:]), axis=1))
        return self.bench.solver.residual.copy()

    def matrix(self, points):
        """Newton's matrix, shape (3 n, 3 n)."""
        self.solve(points)
        return spectrum.dense(self.bench.solver.band)


BOTH = pytest.mark.parametrize("stretch", [{}, BY_SPAN], ids=["by_sample", "by_span"])


@pytest.fixture(scope="module", params=[{}, BY_SPAN], ids=["by_sample", "by_span"])
def quiet(request):
    bench = Bench(QUIET, request.param, n=12)
    assert (bench.terms.span_stretch is not None) == bool(request.param)
    return bench


def without_twist(bench, points):
    parts = bench.potentials(points)
    return parts.sum() - parts[2]


@pytest.mark.parametrize("size", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_discrete_gradient_gives_the_exact_change_of_energy(quiet, seed, size):
    """g . (q1 - q0) = U1 - U0 with stretching, bending, natural curvature, weight and springs."""
    first = wild(quiet, seed, size=0.02)
    second = wild(quiet, seed + 10, size=size)
    second[:, :3] = first[:, :3] + (second - straight(quiet) * [0.8, 1, 1, 1])[:, :3]
    work = -np.sum(Step(quiet, True, first).force(second) * (second - first)[:, :3])
    change = without_twist(quiet, second) - without_twist(quiet, first)
    scale = np.abs(quiet.potentials(first)).sum() + np.abs(quiet.potentials(second)).sum()
    assert abs(change) > 1e-3
    assert abs(work - change) < 1e-13 * scale
    # The force at the midpoint does not have the property: it is the gradient, not a difference.
    middle = -np.sum(Step(quiet, False, first).force(second) * (second - first)[:, :3])
    assert abs(middle - change) > 1e-9 * scale


def test_discrete_gradient_is_symmetric_and_tends_to_the_gradient(quiet):
    first, second = wild(quiet, 0), wild(quiet, 1)
    forward, backward = Step(quiet, True, first), Step(quiet, True, second)
    assert np.allclose(forward.force(second), backward.force(first), rtol=0, atol=1e-11)
    exact = quiet.force(first)[:, :3]
    at_rest = forward.force(first)
    assert np.abs(at_rest - exact).max() < 1e-12 * np.abs(exact).max()
    near = first + 1e-7 * (second - first)
    halfway = quiet.force(0.5 * (first + near))[:, :3]
    assert np.abs(forward.force(near) - halfway).max() < 1e-10 * np.abs(exact).max()


@BOTH
def test_discrete_gradient_has_no_resultant(stretch):
    """No force and no moment about the midpoint configuration: momenta are conserved."""
    alone = {"end.spring": [1e-12, 0, 0], "cable.rest_curvature": [1e-12]}
    bench = Bench(QUIET, FLAT, alone, stretch, n=12)
    first, second = wild(bench, 0), wild(bench, 1)
    force = Step(bench, True, first).force(second)
    scale = np.abs(force).sum()
    middle = 0.5 * (first + second)[:, :3]
    assert scale > 0.1
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
    assert np.abs(np.cross(middle, force).sum(axis=0)).max() < 1e-13 * scale


def test_midpoint_force_is_the_force_at_the_midpoint(quiet):
    first, second = wild(quiet, 0), wild(quiet, 1)
    expected = quiet.force(0.5 * (first + second))[:, :3]
    found = Step(quiet, False, first).force(second)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("discrete", "theta"),
    [(True, 0.5), (False, 0.5), (False, 0.7)],
    ids=["energy_momentum", "implicit_midpoint", "generalized_alpha"],
)
@pytest.mark.parametrize(
    ("stretch", "n"),
    [({}, 4), ({}, 12), (BY_SPAN, 5), (BY_SPAN, 12)],
    ids=["by_sample-4", "by_sample-12", "by_span-5", "by_span-12"],
)
def test_newtons_matrix_is_the_derivative_of_the_residual(stretch, n, discrete, theta):
    """With loads (a moment turns with the tangent), springs, weight and natural curvature."""
    bench = Bench(QUIET, stretch, n=n)
    bench.terms.loads.torque[0] = [0.05, -0.08, 0.03]
    bench.terms.loads.force[0] = [1.0, -2.0, 0.5]
    first = wild(bench, 0, size=0.1 / n)
    second = first + 0.3 * (wild(bench, 1, size=0.1 / n) - first)
    step = Step(bench, discrete, first, theta)
    free = bench.free[:, :3].ravel()
    found = (-step.matrix(second) * free[:, None]).reshape(3 * n, n, 3)
    inertia = 2.0 / TAU**2 * bench.mass().reshape(n, 4, n, 4)[:, :3, :, :3].reshape(found.shape)
    assert np.abs(found + inertia * free[:, None, None]).max() > 0.02 * np.abs(inertia).max()
    assert_limit(found, step.residual, second[:, :3].copy(), bound=1e-9, tiny=1e-12)


@pytest.mark.parametrize(
    ("discrete", "theta", "rate"),
    [(True, 0.5, 1.0), (False, 0.7, 1.6)],
    ids=["energy_momentum", "generalized_alpha"],
)
@BOTH
def test_newtons_matrix_with_damping_where_nothing_moves(stretch, discrete, theta, rate):
    """Viscosity is linearised about the geometry of the step, which is exact for no increment."""
    bench = Bench(DAMPED, stretch, n=9)
    points = wild(bench)
    free = bench.free[:, :3].ravel()[:, None]
    undamped = Step(Bench(QUIET, stretch, n=9), discrete, points, theta).matrix(points) * free
    step = Step(bench, discrete, points, theta, rate)
    step.rates *= 0.0
    found = step.matrix(points) * free
    assert np.abs(found - undamped).max() > 0.3 * np.abs(undamped).max()
    assert_limit(-found.reshape(27, 9, 3), step.residual, points[:, :3].copy(), bound=1e-7)


@BOTH
def test_energy_lost_to_damping_is_the_work_of_the_damping_force(stretch):
    """lost = -(damped - undamped force) . increment, and it is positive."""
    damped, quiet = Bench(DAMPED, stretch, n=9), Bench(QUIET, stretch, n=9)
    first, second = wild(damped, 0), wild(damped, 1)
    first[:, 3] = second[:, 3] = 0.0
    step = Step(damped, True, first)
    extra = step.force(second) - Step(quiet, True, first).force(second)
    taken = -np.sum(extra * (second - first)[:, :3])
    assert taken > 1e-3
    assert step.lost == pytest.approx(taken, rel=1e-10)
