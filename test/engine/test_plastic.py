"""Plastic bending: equal to the law, exact gradient, a set in a whole run, energy account."""

import elasticity
import numpy as np
import pytest
from cables import FLAT, SOFT, Bench, simulator, straight, wild
from differences import assert_limit
from plasticity import Law, carried

from dlo_sim.core import bspline
from dlo_sim.core.methods import IMPLICIT, METHODS

YIELD = {"plasticity.yield_curvature": 1.5, "plasticity.hardening": 0.2}
ALONE = SOFT | FLAT | YIELD


def law_of(scene):
    return Law(scene.cable.EI, scene.plasticity.yield_curvature, scene.plasticity.hardening)


def plastic_of(cable):
    """Plastic curvature of every sample of a cable, from start to end, shape (m, 3)."""
    return cable.plastic[..., :3].reshape(-1, 3)


class Cable(Bench):
    """A bench whose plastic state can flow."""

    def __init__(self, *values, **more):
        super().__init__(*values, **more)
        self.u, self.weights = elasticity.samples(self.model.rule, self.model.knots)

    def flow(self, points):
        self.put(points)
        self.cable.flow()

    def bend(self, points):
        """Stored energy of bending [J]."""
        parts = self.potentials(points)
        return parts["bend"] + parts["plasticity"]

    @property
    def plastic(self):
        return plastic_of(self.cable)


@pytest.fixture(params=[(5, 0.0), (12, 0.0), (12, 0.5)], ids=str)
def cable(request):
    n, grading = request.param
    return Cable(ALONE, n=n, grading=grading)


def test_flow_equals_the_law_on_a_wild_path(cable):
    law = law_of(cable.scene)
    expected, lost, tangents = np.zeros((len(cable.u), 3)), 0.0, None
    for seed in range(4):
        points = wild(cable, seed, size=0.2 / cable.n)
        cable.flow(points)
        strain = elasticity.strains(points, cable.model.knots, cable.u)
        t = bspline.evaluate(points[:, :3], cable.model.knots, cable.u, 1)
        t /= np.linalg.norm(t, axis=1)[:, None]
        for i in range(len(cable.u)):
            if tangents is not None:
                moved = carried(expected[i], tangents[i], t[i])
                lost += cable.weights[i] * (
                    law.energy(strain.binormal[i], expected[i])
                    - law.energy(strain.binormal[i], moved)
                )
                expected[i] = moved
            expected[i], more = law.flow(strain.binormal[i], expected[i])
            lost += cable.weights[i] * more
        tangents = t
        assert np.abs(cable.plastic - expected).max() < 1e-11 * np.abs(expected).max()
        bend = cable.bend(points)
        stored = sum(
            w * law.energy(strain.binormal[i], expected[i]) for i, w in enumerate(cable.weights)
        )
        assert bend == pytest.approx(stored, rel=1e-11)
    assert cable.cable.account.dissipated == pytest.approx(lost, rel=1e-10)
    assert np.abs(expected).max() > 1.0


def test_force_is_minus_the_gradient_of_the_energy(cable):
    cable.flow(wild(cable, 1, size=0.2 / cable.n))
    points = wild(cable, 2, size=0.2 / cable.n) * [1, 1, 1, 0]
    plain = Bench(ALONE, {"terms.plasticity": "off"}, {"terms.out_of_plane": "on"}, n=cable.n)
    assert np.abs(cable.force(points) - plain.force(points)).max() > 1e-3
    assert_limit(-cable.force(points), cable.potential, points, bound=1e-7)


def test_straight_and_inflected_cables_feel_their_set(cable):
    """A straight cable with a set is pushed to bend: the gradient at zero curvature."""
    cable.flow(wild(cable, 1, size=0.2 / cable.n))
    points = straight(cable)
    assert_limit(-cable.force(points), cable.potential, points, bound=1e-7)
    points[:, 2] = 0.1 * np.sin(2 * np.pi * points[:, 0])
    assert_limit(-cable.force(points), cable.potential, points, bound=1e-7)


def test_swing_carries_the_set_along():
    """Rigid motion in small steps, about any axis normal to the cable's tangents."""
    cable = Cable(ALONE, n=8)
    angle = 2.0 * cable.greville  # a flat arc of curvature 2, beyond yield
    points = np.zeros((cable.n, 4))
    points[:, 0], points[:, 2] = np.sin(angle) / 2.0, (np.cos(angle) - 1.0) / 2.0
    cable.flow(points)
    before, energy = cable.plastic, cable.bend(points)
    assert np.abs(before).max() > 0.1
    lost = cable.cable.account.dissipated
    steps, turn = 400, 1.2  # turn about y, the arc's binormal
    for k in range(1, steps + 1):
        a = turn * k / steps
        moved = points.copy()
        moved[:, 0] = np.cos(a) * points[:, 0] + np.sin(a) * points[:, 2]
        moved[:, 2] = -np.sin(a) * points[:, 0] + np.cos(a) * points[:, 2]
        cable.flow(moved)
    assert cable.bend(moved) == pytest.approx(energy, rel=1e-9)
    assert cable.cable.account.dissipated - lost == pytest.approx(0.0, abs=1e-9 * energy)
    assert np.abs(cable.plastic - before).max() < 1e-9  # along y all the time


SETTLING = {
    "damping.mass": 3.0,
    "gravity": [0.0, 0.0, 0.0],
    "loads.tip.type": "wrench",
    "terms.twist": "off",
    "discretization.control_points": 8,
}


@pytest.mark.parametrize("method", ["velocity_verlet", "rk4", "zhai", "energy_momentum"])
def test_unloading_a_bent_cable_leaves_the_set_of_the_closed_form(method):
    """A moment at the tip bends the whole clamped cable evenly; taken off, the set remains."""
    step = 0.005 if METHODS[method].family == IMPLICIT else 0.0
    sim = simulator(SOFT, YIELD, SETTLING, method=method, step=step)
    law = law_of(sim.scene)
    curvature = 3.0
    moment = law.moment(curvature)
    for share in np.linspace(0.02, 1.0, 50):
        sim.set_load("tip", torque=(0.0, moment * share, 0.0))
        assert sim.advance(0.5).status.advanced
    assert sim.advance(15.0).status.advanced
    u = np.linspace(0.2, 0.8, 301)  # away from the ends; a cubic spline ripples about a circle
    loaded = elasticity.strains(sim.control_points, sim.model.knots, u).binormal
    assert loaded[:, 1].mean() == pytest.approx(curvature, rel=1e-2)
    assert loaded[:, 1] == pytest.approx(curvature, rel=0.05)
    for share in np.linspace(0.98, 0.0, 50):
        sim.set_load("tip", torque=(0.0, moment * share, 0.0))
        sim.advance(0.5)
    sim.advance(15.0)
    rest = elasticity.strains(sim.control_points, sim.model.knots, u).binormal
    assert law.set_after(curvature) == pytest.approx(1.2)
    assert rest[:, 1].mean() == pytest.approx(law.set_after(curvature), rel=1e-2)
    assert rest[:, 1] == pytest.approx(law.set_after(curvature), rel=0.05)
    assert sim.energy_error < 1e-2


@pytest.mark.parametrize("method", ["forest_ruth", "velocity_verlet", "rk4", "zhai"])
def test_energy_account_includes_the_plastic_work(method):
    errors = []
    for fraction in (0.4, 0.2):
        limit = simulator(SOFT, YIELD, method=method).choice.limit
        sim = simulator(SOFT, YIELD, method=method, step=fraction * limit)
        sim.advance(0.5)
        lost = sim.plastic_work
        assert lost > 1e-3
        assert lost == pytest.approx(sim.cable.account.dissipated, rel=1e-2)
        errors.append(sim.energy_error)
    assert max(errors) < 1e-3
