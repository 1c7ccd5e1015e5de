"""Internal (Kelvin-Voigt) damping at one instant."""

import numpy as np
import pytest
from cables import BENT, BY_SPAN, FLAT, FREE, SOFT, TWISTED, Bench, inflected, straight, wild
from elasticity import samples

from dlo_sim.core import bspline
from dlo_sim.engine.arrays import SPAN_STRETCH

BETA = 3e-3
STIFF = BENT | {"damping.mass": 1e-300, "damping.stiffness": BETA}
EVEN = 0.015  # [m] short of the span guard, whose forces would have larger round-off
PLAIN = FLAT | {"end.spring": [1e-12, 0.0, 0.0], "cable.rest_curvature": [1e-12]}


@pytest.fixture(scope="module", params=[({}, 0.0), (BY_SPAN, 0.5)], ids=["by_sample", "by_span"])
def bench(request):
    stretch, grading = request.param
    bench = Bench(STIFF, PLAIN, stretch, n=9, grading=grading)
    assert bench.model.has(SPAN_STRETCH) == bool(stretch)
    return bench


def viscous(bench, points, rates):
    return bench.force(points, rates) - bench.force(points)


def some_rates(seed):
    return np.random.default_rng(seed).normal(size=(9, 4))


def rigid(points, spin, drift):
    """Velocities of a rigid motion; the twist turns along."""
    rates = np.zeros((9, 4))
    rates[:, :3] = np.cross(spin, points[:, :3]) + drift
    rates[:, 3] = 0.7
    return rates


def test_a_bent_cable_that_moves_on_is_not_damped(bench):
    points = wild(bench, size=EVEN)
    scale = np.abs(viscous(bench, points, some_rates(0))).max()
    assert scale > 1e-2
    assert np.abs(viscous(bench, points, rigid(points, np.zeros(3), [1, -2, 3]))).max() < 1e-12


def test_a_plane_curve_that_turns_in_its_plane_is_not_damped(bench):
    points = inflected(bench)
    scale = np.abs(viscous(bench, points, some_rates(0))).max()
    found = viscous(bench, points, rigid(points, np.array([0.0, 2.0, 0.0]), np.zeros(3)))
    assert np.abs(found).max() < 1e-12 * scale


@pytest.mark.parametrize("spin", [[0.4, -1.3, 0.8], [0.0, 2.0, 0.0], [-3.0, 0.1, 0.2]])
def test_a_rigid_motion_is_damped_by_its_spin_about_the_tangent_alone(bench, spin):
    """Loss = beta integral EI kappa^2 w_t^2 du: the rate of the curvature does not follow w_t."""
    points, cable = wild(bench, size=EVEN), bench.scene.cable
    u, weights = samples(bench.model.rule, bench.model.knots)
    first, second = (bspline.evaluate(points[:, :3], bench.model.knots, u, d) for d in (1, 2))
    speed = np.linalg.norm(first, axis=1)
    curvature = np.linalg.norm(np.cross(first, second), axis=1) / speed**3
    along = first @ spin / speed
    expected = BETA * cable.EI * np.sum(weights * curvature**2 * along**2)
    rates = rigid(points, np.array(spin), [1.0, -2.0, 3.0])
    assert -np.sum(viscous(bench, points, rates) * rates) == pytest.approx(expected, rel=1e-9)


def test_motion_never_gains_energy(bench):
    """The matrix of the viscous forces is symmetric and has no negative eigenvalue."""
    points = wild(bench)
    matrix = np.zeros((36, 36))
    for column in range(36):
        rates = np.zeros(36)
        rates[column] = 1.0
        matrix[:, column] = -viscous(bench, points, rates.reshape(9, 4)).ravel()
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    assert values[0] > -1e-14 * values[-1]
    assert values[7] > 1e-8 * values[-1]  # only rigid motions (seven with the twist) may be free


def test_viscous_forces_have_no_resultant(bench):
    force = viscous(bench, wild(bench), some_rates(1))[:, :3]
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


def test_unstressed_cable_has_beta_times_its_stiffness(bench):
    points = straight(bench)
    rates = some_rates(2)
    found = viscous(bench, points, rates)
    expected = -BETA * bench.stiffness(points) @ rates[:, :3].ravel()
    assert np.abs(found[:, :3].ravel() - expected).max() < 1e-11 * np.abs(expected).max()
    turned = np.zeros((9, 4))
    turned[:, 3] = rates[:, 3]
    assert np.allclose(found[:, 3], BETA * bench.force(turned + points)[:, 3], rtol=1e-11)


@pytest.mark.parametrize("rate", [0.01, 2.0, 500.0])
@pytest.mark.parametrize("dim", ["off", "on"])
def test_damping_of_bending_thins_with_its_rate(dim, rate):
    """A straight cable of which every point bends at the rate a: the loss is EI beta L a^2 /
    sqrt(1 + (lambda a)^2), nearly EI beta L a / lambda in fast motion."""
    values = SOFT | FREE | FLAT | {"loads.names": [], "terms.out_of_plane": dim}
    damping = {"damping.bend": 0.01, "damping.thinning": 0.5}
    bench = Bench(values | damping, n=9)
    motion = np.zeros((9, 4))
    a, b, c = (bench.model.knots[k : k + 9] for k in (1, 2, 3))
    motion[:, 2] = 0.5 * rate * (a * b + b * c + c * a) / 3.0  # the control points of rate u^2 / 2
    lost = -np.sum(viscous(bench, straight(bench), motion) * motion)
    cable = bench.scene.cable
    expected = 0.01 * cable.EI * cable.length * rate**2 / np.hypot(1.0, rate / 2.0)
    assert lost == pytest.approx(expected, rel=1e-9)


def test_external_damping_slows_rigid_motion_too():
    """alpha on the momentum (twist included), drag on the velocity along the cable."""
    values = {"damping.mass": 0.8, "damping.air_drag": 0.05, "end.mass": 0.4}
    bench = Bench(STIFF, PLAIN, values, n=9)
    rates = np.tile([0.3, -1.0, 2.0, 5.0], (9, 1))
    found = viscous(bench, wild(bench), rates).sum(axis=0)
    expected = -np.array([0.3, -1.0, 2.0]) * (0.8 * (0.1 + 0.4) + 0.05 * 1.0)
    assert np.allclose(found[:3], expected, rtol=1e-10)
    inertia = 0.1 * 0.02**2 / 8
    assert found[3] == pytest.approx(-5.0 * 0.8 * inertia, rel=1e-9)


@pytest.mark.parametrize("way", ["sample", "span"])
def test_each_strain_has_its_own_damping(way):
    """The three parts add up to damping.stiffness, and each leaves the others' motions alone."""
    values = {"discretization.stretch": way, "terms.out_of_plane": "on", **TWISTED}
    cable, n = SOFT | FREE | FLAT | values | {"loads.names": []}, 9
    rng = np.random.default_rng(8)

    def lost(name, motion):
        bench = Bench(cable | {f"damping.{name}": 0.01}, n=n)
        points = np.zeros((bench.n, 4))
        points[:, 0], points[:, 2] = bench.greville, 0.1 * bench.greville**2
        plain = Bench(cable, n=n).force(points, np.zeros((n, 4)))
        return -np.sum((bench.force(points, motion) - plain) * motion)

    motion = rng.standard_normal((n, 4))
    parts = [lost(name, motion) for name in ("stretch", "bend", "twist")]
    assert min(parts) > 0.0
    assert sum(parts) == pytest.approx(lost("stiffness", motion), rel=1e-10)
    spin = np.zeros((n, 4))
    spin[:, 3] = rng.standard_normal(n)
    assert lost("twist", spin) == pytest.approx(lost("stiffness", spin), rel=1e-12)
    assert abs(lost("stretch", spin)) + abs(lost("bend", spin)) < 1e-12
