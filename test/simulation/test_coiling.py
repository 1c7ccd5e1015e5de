"""The warning that a twisted cable would coil, against Greenhill's moment."""

import numpy as np
import pytest
from cables import simulator

LENGTH, EI, GJ, EA = 0.8, 0.02, 0.015, 60.0
HELD = {
    "cable.length": LENGTH,
    "cable.bending_stiffness": EI,
    "cable.torsional_stiffness": GJ,
    "cable.axial_stiffness": EA,
    "terms.gravity": "off",
    "terms.twist": "on",
    "start.clamped": True,
    "end.fixed": [True] * 3,
    "end.position": [LENGTH, 0.0, 0.0],
}


def turned(angle, *more):
    """A straight cable whose free-to-turn end is turned by an angle."""
    sim = simulator(HELD, *more, n=8, method="energy_momentum", step=1e-3)
    points = sim.control_points
    points[:, 3] = angle * sim.greville / LENGTH
    sim.start_from(points)
    return sim


def coils(sim):
    return [line for line in sim.warnings if "coil" in line]


@pytest.mark.parametrize("stretch", [0.0, 0.05])
def test_it_comes_at_greenhills_moment(stretch):
    longer = {"end.position": [LENGTH * (1.0 + stretch), 0.0, 0.0]}
    moment = 2.0 * np.sqrt(EI * (EA * stretch + EI * (np.pi / LENGTH) ** 2))
    angle = moment * LENGTH / GJ
    assert not coils(turned(0.99 * angle, longer))
    (line,) = coils(turned(-1.01 * angle, longer))
    assert f"{moment:.3g} N m" in line
    assert "\n" not in line


def test_a_cable_without_twist_does_not_coil():
    assert not coils(turned(0.0, {"terms.twist": "off"}))
