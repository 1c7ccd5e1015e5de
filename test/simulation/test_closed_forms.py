"""Closed forms and conservation laws against values from elsewhere."""

import closed_forms
import numpy as np
import pytest
from corpus import SOFT, thrown

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator


def test_catenary_between_ends_ninety_percent_apart():
    # inextensible: sinh(a) / a = 1 / 0.9 with a = w span / 2 H, by hand: a = 0.80405
    u = np.linspace(0.0, 10.0, 1001)
    x, z = closed_forms.catenary(u, 10.0, 9.0, 2.0, 1e12)
    assert x[-1] == pytest.approx(9.0, abs=1e-9)
    assert z[-1] == pytest.approx(0.0, abs=1e-9)
    a = 0.5 * 2.0 * 9.0 / _horizontal(z[500], x[500])
    assert np.sinh(a) / a == pytest.approx(1.0 / 0.9, rel=1e-6)
    assert np.hypot(np.diff(x), np.diff(z)).sum() == pytest.approx(10.0, rel=1e-5)


def _horizontal(sag, half_span):
    """H of a catenary of weight 2 N/m from its sag, by bisection of H/w (cosh(w x / H) - 1)."""
    low, high = 1e-3, 1e3
    for _ in range(100):
        middle = 0.5 * (low + high)
        deep = middle / 2.0 * (np.cosh(2.0 * half_span / middle) - 1.0) > -sag
        low, high = (middle, high) if deep else (low, middle)
    return low


def test_elastic_catenary_is_longer():
    u = np.linspace(0.0, 10.0, 1001)
    x, z = closed_forms.catenary(u, 10.0, 9.0, 2.0, 1e3)
    # mean tension about 11 N: 1.1 percent
    assert np.hypot(np.diff(x), np.diff(z)).sum() == pytest.approx(10.1, abs=0.03)


def test_string_deflection_in_the_small():
    # P = EA a^3 for small slopes a
    assert closed_forms.string_deflection(1e-3, 100.0, 2.0) == pytest.approx(
        1e-5 ** (1 / 3), rel=1e-3
    )
    stiff = closed_forms.string_deflection(1.0, 100.0, 0.1, 1e-6)
    assert stiff < closed_forms.string_deflection(1.0, 100.0, 0.1)


@pytest.mark.parametrize(
    ("angle", "load", "gap"),
    # Timoshenko & Gere, table 2-4: slope at the ends, P / Pcr, 1 - shortening
    [(40.0, 1.063, 0.881), (60.0, 1.152, 0.741), (100.0, 1.518, 0.349)],
)
def test_a_buckled_elastica_has_the_gap_of_the_table(angle, load, gap):
    assert closed_forms.elastica_gap(load) == pytest.approx(gap, abs=2e-3)


@pytest.mark.parametrize(
    ("load", "x", "z"), [(1.0, 0.056, 0.302), (4.0, 0.329, 0.670), (10.0, 0.555, 0.811)]
)
def test_a_cantilever_under_a_tip_load(load, x, z):
    """1 - x and z at P L^2 / EI: table of Bisshopp & Drucker 1945."""
    found = closed_forms.cantilever_tip(closed_forms.Rod(1.0, 1e9, 0.0), 1.0, load=load)
    assert (1.0 - found[0], found[1]) == pytest.approx((x, z), abs=6e-4)


@pytest.mark.parametrize(("mass", "inertia"), [("consistent", 1.0 / 12.0), ("lumped", 0.08628)])
def test_momenta_of_a_turning_rod(mass, inertia):
    """m v and I omega about the middle; a lumped mass is at the control points, farther out."""
    values = thrown(SOFT, 1e-3) | {"discretization.mass": mass, "end.position": [1.0, 0.0, 0.0]}
    simulator = Simulator(scene_from_values(values))
    points, rates = simulator.control_points, np.zeros((13, 4))
    rates[:, 0], rates[:, 1] = 2.0, 3.0 * (points[:, 0] - points[:, 0].mean())
    simulator.start_from(points, rates)
    momentum, angular = closed_forms.momenta(simulator)
    weight = simulator.scene.cable.mu * simulator.scene.cable.length
    assert momentum == pytest.approx([2.0 * weight, 0.0, 0.0], abs=1e-12)
    assert angular[2] == pytest.approx(inertia * weight * 3.0, rel=1e-3)
