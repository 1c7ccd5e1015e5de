"""Equilibria of the simulator against the heavy elastica and the elastic catenary."""

import numpy as np
import pytest
from closed_forms import Rod, cantilever_tip, catenary, sag

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.work_precision import CLOSED, cantilever, soft_cable, wire


def rod_of(scene, deformed=False):
    """The cable's constants for `analytic`."""
    cable = scene.cable
    weight = cable.mu * float(np.linalg.norm(scene.gravity))
    return Rod(cable.EI, cable.EA, weight, deformed)


def at_rest(scene, n_u):
    """The scene at rest with this resolution."""
    return scene.with_values(
        {
            "discretization.control_points": n_u,
            "discretization.quadrature": "gauss",
            "discretization.samples": 3,
            "integrator.method": "energy_momentum",
            "integrator.step": 1e-3,
            "initial.shape": "equilibrium",
        }
    )


def known_shapes():
    """Static shapes with known solutions: name -> scene, u / L, x and z there [m], scale [m]."""
    cord, thin, gap = cantilever().scene, wire(1).scene, 1.0 - CLOSED
    soft = soft_cable().scene.with_values({"end.position": [gap, 0.0, 0.0]})
    tip = cantilever_tip(rod_of(cord, True), cord.cable.length)
    length = thin.cable.length
    low_wire = sag(rod_of(thin, True), length, length, thin.start.spring[0])
    low = sag(rod_of(soft, True), soft.cable.length, gap)
    limp = scene_from_values(
        {
            "cable.linear_density": 0.1,
            "cable.axial_stiffness": 1.0e4,
            "terms.bend": "off",
            "end.position": [gap, 0.0, 0.0],
            "end.fixed": [True] * 3,
        }
    )
    length = limp.cable.length
    (x,), (z,) = catenary(np.array([0.5 * length]), length, gap, 0.1 * 9.81, 1.0e4)
    return {
        "cantilever": (cord, 1.0, np.array(tip), cord.cable.length),
        "clamped": (soft, 0.5, np.array([0.5 * gap, -low]), soft.cable.length),
        "wire": (thin, 0.5, np.array([0.5 * thin.cable.length, -low_wire]), low_wire),
        "catenary": (limp, 0.5, np.array([x, z]), length),
    }


@pytest.mark.parametrize("name", ["cantilever", "clamped", "wire", "catenary"])
def test_equilibria_come_close_to_the_known_shape(name):
    scene, u, truth, scale = known_shapes()[name]
    errors = []
    for n_u in (7, 13):
        place = Simulator(at_rest(scene, n_u)).centerline([u * scene.cable.length])[0, [0, 2]]
        errors.append(float(np.abs(place - truth).max()) / scale)
    assert 0.0 < errors[1] < 0.3 * errors[0]
    assert name != "wire" or errors[1] < 1e-4


def test_elastica_meets_small_deflections_and_two_known_shapes():
    weak = Rod(bending=1.0, axial=1e9, weight=1e-3)
    x, z = cantilever_tip(weak, 1.0)
    assert z == pytest.approx(-1e-3 / 8.0, rel=1e-4)  # w L^4 / (8 EI)
    assert x == pytest.approx(1.0, abs=1e-6)
    # By a collocation method of another package, to eight digits.
    thin = wire(1)
    length, spring = thin.scene.cable.length, thin.scene.start.spring[0]
    static = sag(rod_of(thin.scene), length, length, spring)
    assert static == pytest.approx(0.018528137, abs=1e-9)
    assert thin.scale == pytest.approx(static, rel=1e-4)  # of the simulator, 41 control points
    soft = rod_of(soft_cable().scene)
    assert sag(soft, 1.0, 0.8) == pytest.approx(0.26940789, abs=1e-8)
    rubber = cantilever_tip(rod_of(cantilever().scene), 0.3)
    assert rubber == pytest.approx((0.08908223, -0.26705251), abs=1e-8)


def test_equilibrium_converges_to_the_elastica_of_its_own_curvature():
    """Curvature per rest length instead would move the tip by 7e-5 m, four times the error."""
    scene, _, truth, length = known_shapes()["cantilever"]
    tip = Simulator(at_rest(scene, 27)).centerline([length])[0][[0, 2]]
    assert np.abs(tip - truth).max() < 2.5e-5  # measured 1.6e-5
    per_rest_length = cantilever_tip(rod_of(scene), length)
    assert np.abs(truth - per_rest_length).max() == pytest.approx(6.9e-5, abs=2e-6)
