"""Damping from outside, the same for every method: drag slows the centerline and never a spin."""

import numpy as np
import pytest
from cables import FLAT, FREE, FULL, SOFT, scene_of, set_state, simulator

from dlo_sim.core.methods import METHODS
from dlo_sim.simulation.selection import choose

DRAG = 0.05  # [N s/m^2], 0.5 1/s of the cable's 0.1 kg/m
ALPHA = 0.3  # [1/s]
METHOD_NAMES = [name for name, method in METHODS.items() if method.mass_damping]
IMPLICIT_NAMES = [name for name in METHOD_NAMES if METHODS[name].family == "implicit"]
# Everything of FULL, too weak to matter; so its machine code serves.
WEAK = {
    "start.pose_topic": "",
    "end.spring": [1e-12, 0.0, 0.0],
}
FLYING = FULL | FREE | FLAT | WEAK
DRAGGED = {"damping.air_drag": DRAG}
STEP = 5e-4
STEPS = 200


def thrown(method, mass="consistent", **damping):
    """After 0.1 s: share of the velocity and of the spin that is left, and the simulator."""
    values = {"discretization.mass": mass}
    values |= {"terms.twist": "bishop"} if method in IMPLICIT_NAMES else {}
    sim = simulator(FLYING, damping, values, n=6, method=method, step=STEP)
    spin = 5.0 if method in IMPLICIT_NAMES else 0.0
    set_state(sim, rates=np.tile([0.3, -1.0, 2.0, spin], (6, 1)))
    assert sim.advance_steps(STEPS).status.ok
    left = sim.velocities / [0.3, -1.0, 2.0, 5.0]
    return left[:, :3], left[:, 3], sim


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize("method", IMPLICIT_NAMES)
def test_drag_slows_the_centerline_and_not_the_spin(method, mass):
    way, spin, sim = thrown(method, mass, **DRAGGED)
    assert way == pytest.approx(np.full((6, 3), np.exp(-DRAG / 0.1 * sim.time)), rel=1e-6)
    assert spin == pytest.approx(np.ones(6), rel=1e-9)
    assert sim.energy_error < 1e-6  # what was lost is what is missing


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_mass_damping_slows_both(method):
    way, spin, sim = thrown(method, **DRAGGED, **{"damping.mass": ALPHA})
    spins = method in IMPLICIT_NAMES
    assert way == pytest.approx(np.full((6, 3), np.exp(-(ALPHA + DRAG / 0.1) * sim.time)), rel=1e-6)
    assert spin == pytest.approx(np.full(6, spins * np.exp(-ALPHA * sim.time)), rel=1e-6)
    assert sim.energy_error < 1e-6


def test_the_step_limit_knows_the_damping():
    frequency = 1e4
    for name in ("rk4", "zhai"):
        limits = [
            choose(scene_of(SOFT, damping, method=name), frequency).limit
            for damping in (
                {},
                {"damping.mass": 4000.0},
                {"damping.mass": 4000.0, "terms.damping": "off"},
            )
        ]
        alone, damped, off = limits
        assert damped != pytest.approx(alone, rel=1e-3)
        assert off == alone


SLIDING = SOFT | FREE | FLAT | {"loads.names": []}


@pytest.mark.parametrize("stretch", ["sample", "span"])
@pytest.mark.parametrize("method", IMPLICIT_NAMES)
def test_a_straight_rod_slides_further_along_itself_than_across(method, stretch):
    """v e^(-c_t t / mu) along and v e^(-c_n t / mu) across."""
    values = {"damping.air_drag_ratio": 0.3, "discretization.stretch": stretch}
    sim = simulator(SLIDING, DRAGGED, values, method=method, step=STEP)
    set_state(sim, rates=np.tile([0.3, -1.0, 2.0, 0.0], (8, 1)))
    assert sim.advance_steps(STEPS).status.ok
    across = np.exp(-DRAG / 0.1 * sim.time)
    along = np.exp(-0.3 * DRAG / 0.1 * sim.time)
    expected = np.tile([0.3 * along, -across, 2.0 * across], (8, 1))
    assert sim.velocities[:, :3] == pytest.approx(expected, rel=1e-6)
    assert sim.energy_error < 1e-6


def test_drag_by_direction_is_in_the_forces_of_an_instant():
    """Those from which reactions before the first step are made."""
    sim = simulator(SLIDING, DRAGGED, {"damping.air_drag_ratio": 0.3, "terms.out_of_plane": "on"})
    rates = np.tile([[1.0], [2.0], [3.0]], (1, 8))
    total = sim.cable.forces(0.0, rates).sum(axis=1)
    assert total == pytest.approx(-DRAG * np.array([0.3 * 1.0, 2.0, 3.0]), rel=1e-12)


@pytest.mark.parametrize("planar", [False, True])
def test_drag_by_direction_takes_energy_from_every_motion(planar):
    """Even where nothing resists motion along the cable; and what it takes is what is missing."""
    rng = np.random.default_rng(7)
    values = {"damping.air_drag": 300.0, "damping.air_drag_ratio": 0.0}
    values |= {"terms.out_of_plane": "off" if planar else "on", "start.fixed": [True] * 3}
    sim = simulator(SLIDING, values, method="energy_momentum", step=1e-3)
    assert len(sim.model.axes) == (2 if planar else 3)
    columns = np.isin(np.arange(4), sim.model.axes)
    rates = rng.normal(size=(8, 4)) * columns
    rates[0] = 0.0
    set_state(sim, rates=rates)
    begin = sim.energy().total
    report = sim.advance_steps(300)
    assert report.status.ok
    assert sim.energy().total < 0.5 * begin
    assert sim.energy_error < 1e-8 * begin
    assert report.force_evaluations < 4 * 300  # 3.0 a step; without its tangent 6.3


def test_damping_that_is_off_asks_for_no_method():
    values = DRAGGED | {"damping.air_drag_ratio": 0.5, "terms.damping": "off"}
    assert simulator(SLIDING, values).method == simulator(SLIDING, {"terms.damping": "off"}).method
    assert simulator(SLIDING, values).scene.drag_across == 0.0
