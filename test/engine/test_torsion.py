"""Compiled Frenet torsion: equal to the oracle, exact gradient, never NaN, samples counted."""

import frenet_torsion as torsion
import numpy as np
import pytest
from cables import FLAT, SOFT, Bench, inflected, scene_of, set_state, straight, wild
from differences import assert_limit

from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator

ALONE = SOFT | FLAT | {"terms.twist": "frenet", "terms.stretch": "off", "terms.bend": "off"}
FLOOR = {"torsion.curvature_floor": 0.5}


def twisted_inflected(bench):
    points = inflected(bench)
    points[:, 3] = 0.7 * bench.greville**2
    return points


def twisted_straight(bench):
    points = straight(bench)
    points[:, 3] = 0.7 * bench.greville**2
    return points


STEPS = (1e-4, 1e-5, 1e-6)  # short spans bend within less than 1e-3 m
SHAPES = {"bent": wild, "straight": twisted_straight, "inflected": twisted_inflected}


@pytest.fixture(scope="module", params=[(5, 0.0), (12, 0.0), (12, 0.5)], ids=str)
def bench(request):
    n, grading = request.param
    return Bench(ALONE, FLOOR, n=n, grading=grading)


def oracle(bench, function, points):
    scene, model = bench.scene, bench.model
    return function(points, model.knots, model.rule, scene.cable.GJ, scene.curvature_floor)


@pytest.mark.parametrize("shape", SHAPES)
def test_energy_and_force_equal_the_oracle(bench, shape):
    points = SHAPES[shape](bench)
    parts = bench.potentials(points)
    energy = parts["twist"] + parts["torsion"]
    assert energy == pytest.approx(oracle(bench, torsion.energy, points), rel=1e-12)
    expected = -oracle(bench, torsion.gradient, points)
    assert np.abs(bench.force(points) - expected).max() < 1e-11 * np.abs(expected).max()
    if shape == "bent":
        assert abs(parts["torsion"]) > 1e-3 * energy
        assert np.abs(expected[:, :3]).max() > 1e-3 * np.abs(expected[:, 3]).max()


@pytest.mark.parametrize("shape", SHAPES)
def test_force_is_minus_the_gradient_of_the_energy(bench, shape):
    points = SHAPES[shape](bench)
    assert_limit(-bench.force(points), bench.potential, points, bound=5e-6, steps=STEPS, tiny=1e-15)


def test_default_floor_is_a_hundredth_of_the_ring():
    assert scene_of(ALONE).curvature_floor == pytest.approx(0.01 * 2.0 * np.pi / 1.0)
    assert scene_of(ALONE, FLOOR).curvature_floor == 0.5


@pytest.mark.parametrize("floor", [1e-9, 0.0])
def test_straight_cable_gives_numbers_and_is_reported(floor):
    sim = Simulator(scene_of(SOFT, {"terms.twist": "frenet", "torsion.curvature_floor": floor}))
    assert sim.cable.account.torsion_last == 15
    assert np.isfinite(sim.reaction("start")[0]).all()
    sim.advance_steps(200)
    assert np.isfinite(sim.control_points).all()
    assert any("torsion" in note and "15 of 15 samples, 15.0" in note for note in sim.notes)


def test_inflection_gives_numbers_and_is_reported():
    """Undefined at the inflection and nowhere else: some samples, not all."""
    bench = Bench(SOFT, {"terms.twist": "frenet"}, FLOOR, n=12)
    sim = Simulator(bench.scene)
    points = inflected(bench)
    points[:, 1] = 0.05 * points[:, 0] ** 2  # out of the plane: the torsion is not zero
    set_state(sim, points)
    sim.advance_steps(20)
    assert np.isfinite(sim.control_points).all() and np.isfinite(sim.velocities).all()
    assert sim.energy().twist > 0.0
    account = sim.cable.account
    assert (
        0 < account.torsion_last <= account.torsion_worst < np.count_nonzero(sim.model.rule.weights)
    )
    assert any("torsion" in note for note in sim.notes)


def test_implicit_methods_and_equilibria_are_refused():
    frenet = {"terms.twist": "frenet"}
    with pytest.raises(SceneError, match="integrator.method: energy_momentum.*frenet"):
        Simulator(scene_of(SOFT, frenet, method="energy_momentum"))
    assert Simulator(scene_of(SOFT, frenet)).method == "velocity_verlet"
    with pytest.raises(SceneError, match="initial.shape"):
        Simulator(scene_of(SOFT, frenet, {"initial.shape": "equilibrium"}))


@pytest.mark.parametrize("method", ["forest_ruth", "velocity_verlet", "rk4", "zhai"])
def test_twisted_bent_cable_keeps_its_energy(method):
    """A bend and a twist that talk to each other, well above the floor."""
    values = {"terms.twist": "frenet", "torsion.curvature_floor": 2.0}
    errors = []
    for fraction in (0.5, 0.25):
        limit = Simulator(scene_of(SOFT, values, method=method)).choice.limit
        sim = Simulator(scene_of(SOFT, values, method=method, step=fraction * limit))
        sim.set_load("tip", torque=(4e-3, 3e-3, 2e-3))
        assert sim.advance(0.2).status.ok
        assert sim.energy().twist > 1e-6
        errors.append(sim.energy_error)
    assert errors[1] < 2e-3
    assert errors[1] < errors[0]
