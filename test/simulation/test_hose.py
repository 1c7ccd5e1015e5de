"""A hose under pressure: it lengthens, pushes what holds it, and buckles."""

import numpy as np
import pytest
from cables import simulator, solve_held

LENGTH, BORE, PRESSURE = 1.0, 8e-3, 4e5
THRUST = PRESSURE * np.pi * BORE**2 / 4.0  # 20 N
HOSE = {
    "cable.length": LENGTH,
    "cable.diameter": 0.014,
    "cable.axial_stiffness": 2e3,
    "cable.bending_stiffness": 0.6,
    "cable.linear_density": 0.2,
    "hose.pressure": PRESSURE,
    "hose.bore": BORE,
    "gravity": [0.0, 0.0, 0.0],
    "start.clamped": True,
    "end.position": [LENGTH, 0.0, 0.0],
    "discretization.control_points": 13,
}
HELD = {"end.fixed": [True] * 3, "end.clamped": True, "initial.shape": "straight"}
LETTING_GO = {"end.fixed": [False] * 3, "initial.shape": "straight", "integrator.tolerance": 1e-9}


def test_a_free_hose_lengthens_until_its_wall_bears_the_pressure():
    """Let go without pressure in its wall, its end moves as a bar that is pulled suddenly: to twice
    the static extension p A L / EA, in the time of two waves along it.
    """
    extension = THRUST * LENGTH / 2e3
    resting = simulator(HOSE, {"initial.shape": "equilibrium"}, step=1e-4)
    assert resting.centerline([LENGTH])[0, 0] - LENGTH == pytest.approx(extension, rel=1e-9)
    sim = simulator(HOSE, LETTING_GO, method="energy_momentum", step=1e-4)
    assert "pressure" in sim.active_terms
    sim.advance(2.0 * LENGTH / np.sqrt(2e3 / 0.2))
    assert sim.centerline([LENGTH])[0, 0] - LENGTH == pytest.approx(2.0 * extension, rel=0.05)
    assert sim.energy_error < 1e-8


def test_a_held_hose_pushes_its_ends_apart():
    sim = simulator(HOSE, HELD, method="energy_momentum", step=2e-5)
    for _ in range(2):
        for end, sign in (("start", 1.0), ("end", -1.0)):
            force, _ = sim.reaction(end)
            np.testing.assert_allclose(force, [sign * THRUST, 0.0, 0.0], rtol=1e-9, atol=1e-9)
        assert sim.advance_steps(10).status.ok


@pytest.mark.parametrize(("share", "buckles"), [(0.999, False), (1.001, True)])
def test_it_buckles_at_the_load_of_euler(share, buckles):
    """Between clamps at 4 pi^2 EI / L^2."""
    pressure = share * PRESSURE / THRUST * 4.0 * np.pi**2 * 0.6 / LENGTH**2
    sim = simulator(HOSE, HELD, {"hose.pressure": pressure, "terms.out_of_plane": "off"}, step=1e-4)
    sim.cable.stiffness()
    assert solve_held(sim.cable, np.zeros(13 * 2)) == buckles


WALL = {
    "cable.diameter": 0.012,
    "cable.density": 1100.0,
    "cable.youngs_modulus": 5e6,
    "hose.bore": 0.008,
    "end.position": [0.8, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "discretization.control_points": 21,
}


def test_mass_and_stiffness_are_those_of_the_wall():
    """1100 kg/m^3 and 5 MPa on the annulus between 8 and 12 mm."""
    sim = simulator(WALL)
    cable = sim.scene.cable
    assert cable.mu == pytest.approx(0.069115, rel=1e-5)
    assert cable.EA == pytest.approx(314.159, rel=1e-5)
    assert cable.EI == pytest.approx(4.08407e-3, rel=1e-5)
    assert cable.GJ == pytest.approx(2.0 * 0.7 * 4.08407e-3, rel=1e-5)
    assert cable.polar_inertia == pytest.approx(1100.0 * np.pi * 1.664e-8 / 32.0, rel=1e-9)
    # Half of the weight hangs on each end; of a solid rod the tension is 0.678 N.
    force, _ = sim.reaction("start")
    assert force[2] == pytest.approx(0.5 * 0.069115 * 9.81, rel=1e-5)
    assert sim.tension([0.0])[0] == pytest.approx(0.377, rel=0.03)


def test_values_given_beside_a_bore_stay():
    given = {"linear_density": 0.3, "axial_stiffness": 70.0, "bending_stiffness": 0.02}
    cable = simulator(WALL, {f"cable.{key}": value for key, value in given.items()}).scene.cable
    assert (cable.mu, cable.EA, cable.EI) == tuple(given.values())
    assert cable.polar_inertia == pytest.approx(0.3 * (0.012**2 + 0.008**2) / 8.0)
    assert "(D^2 + d^2) / 8 = 7.8e-06 kg m, as of a hose's section" in cable.assumptions[-1]
