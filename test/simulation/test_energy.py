"""Energy over long runs, the account of works and losses, momenta in free flight."""

from functools import cache

import numpy as np
import pytest
from cables import (
    FLAT,
    FREE,
    FULL,
    FULLY_DAMPED,
    MASS_DAMPED,
    MOTIONS,
    SINE_LOAD,
    SOFT,
    momenta,
    set_state,
    simulator,
)

from dlo_sim.core.methods import IMPLICIT, METHODS

ODD = 7  # steps between two looks, no divisor of anything


def by_name(method):
    return method.name


@cache
def energy_track(method, step, tolerance=1e-10, duration=10.0):
    """Time and energy change, in units of the kinetic peak, of a cable that swings by a quarter of
    its length; wilder motion would feed ever higher frequencies, and the error with them.
    """
    values = {
        "integrator.tolerance": tolerance,
        "cable.bending_stiffness": 0.3,
        "gravity": [0.0, 0.0, -3.0],
    }
    sim = simulator(SOFT, values, n=6, method=method, step=step)
    first = sim.energy()
    times, changes, kinetic = [], [], 0.0
    for _ in range(int(duration / step / ODD)):
        assert sim.advance_steps(ODD).status.ok
        now = sim.energy()
        times.append(sim.time)
        changes.append(now.total - first.total)
        kinetic = max(kinetic, now.kinetic)
    assert kinetic > 3e-3  # [J]; an energy that does not move proves nothing
    return np.array(times), np.array(changes) / kinetic


@pytest.mark.parametrize("name", ["forest_ruth", "velocity_verlet"])
def test_energy_error_of_a_symplectic_method_is_bounded_and_of_its_order(name):
    order = METHODS[name].order
    # Over 2 s: in the 20,000 steps of 10 s round-off grows to the error at the smallest step.
    errors = [
        np.abs(energy_track(name, step, duration=2.0)[1]).max() for step in (2e-3, 1e-3, 5e-4)
    ]
    long, short = np.log2(errors[:2]) - np.log2(errors[1:])
    # The order as the step goes to zero; half a step has a quarter of the deviation from it.
    assert (4.0 * short - long) / 3.0 == pytest.approx(order, abs=0.1)
    assert np.abs(energy_track(name, 1e-3)[1]).max() < {2: 2e-5, 4: 2e-8}[order]
    # As large in the first as in the last third, and no slope.
    times, coarse = energy_track(name, 2e-3)
    thirds = [np.abs(part).max() for part in np.array_split(coarse, 3)]
    assert thirds[2] < 1.05 * thirds[0]
    assert abs(np.polyfit(times, coarse, 1)[0]) * times[-1] < 0.05 * np.abs(coarse).max()


def test_energy_of_runge_kutta_drifts_away():
    """The measurement can see a drift."""
    times, track = energy_track("rk4", 5e-4)
    thirds = [np.abs(part).max() for part in np.array_split(track, 3)]
    assert thirds[2] > 2.5 * thirds[0]
    assert np.polyfit(times, track, 1)[0] * times[-1] < -0.9 * np.abs(track).max()


@pytest.mark.parametrize("step", [1e-3, 5e-3, 2e-2])
def test_energy_momentum_keeps_the_energy_at_any_step(step):
    """To the solver's tolerance per step; the implicit midpoint rule does not."""
    assert np.abs(energy_track("energy_momentum", step, 1e-12)[1]).max() < 1e-9
    assert np.abs(energy_track("implicit_midpoint", step, 1e-12)[1]).max() > 1e-7


# ------------------------------------------------------------------------------------ the account

SCENES = {"undamped": FULL, "mass": MASS_DAMPED, "all": FULLY_DAMPED}


def account_error(name, case, steps, end):
    """Energy that the account cannot explain, as a share of what was exchanged."""
    sim = simulator(SCENES[case], SINE_LOAD, n=6, method=name, step=0.2 / steps)
    sim.set_motion(end, MOTIONS[end])
    assert sim.advance_steps(steps).status.ok
    assert sim.energy().kinetic > 1e-2
    return sim.energy_error


def admitted(name, case):
    method = METHODS[name]
    return case == "undamped" or (
        method.mass_damping if case == "mass" else method.stiffness_damping
    )


@pytest.mark.parametrize(
    ("name", "case", "end"),
    [(n, c, "start") for n in METHODS for c in SCENES if admitted(n, c)]
    + [(n, "undamped", "end") for n in ("velocity_verlet", "energy_momentum")],
)
def test_account_closes_with_load_damping_and_a_moved_clamp_or_spring(name, case, end):
    """Work in = energy change + losses: the rest is the method's own error, of second order."""
    coarse, fine = (account_error(name, case, steps, end) for steps in (400, 1600))
    assert coarse < 2e-2
    assert fine < coarse / 12 or fine < 1e-6


# ------------------------------------------------------------------------------------ free flight


@pytest.mark.parametrize("name", METHODS)
def test_free_flight_keeps_its_momenta(name):
    """A bent, spinning, vibrating cable without weight or ends that hold it."""
    sim = simulator(SOFT, FREE, FLAT, {"integrator.tolerance": 1e-12}, n=7, method=name, step=5e-4)
    points = sim.control_points
    points[:, 2] += 0.1 * np.sin(3 * points[:, 0])
    rates = np.zeros((7, 4))
    rates[:, :3] = np.cross([1.0, -2.0, 3.0], points[:, :3]) + [0.5, 0.3, -0.2]
    rates[:, 1] += np.sin(9 * points[:, 0])
    set_state(sim, points, rates)
    first, spin = momenta(sim)
    drift = turn = 0.0
    for _ in range(100):
        assert sim.advance_steps(ODD).status.ok
        now, now_spin = momenta(sim)
        drift = max(drift, np.abs(now - first).max())
        turn = max(turn, np.abs(now_spin - spin).max())
    assert np.abs(sim.control_points - points)[:, :3].max() > 0.2
    assert drift < 1e-12
    keeps_spin = METHODS[name].symplectic or METHODS[name].conserves_energy
    # Quadratic invariants: kept by symplectic methods of these kinds, not by the others.
    if keeps_spin:
        assert turn < (1e-9 if METHODS[name].family == IMPLICIT else 1e-12)
    else:
        assert turn > 1e-10


@pytest.mark.parametrize("name", ["energy_momentum", "energy_momentum_4"])
def test_a_short_step_of_a_long_cable_keeps_the_impulse(name):
    """It moves by less than the coordinates of 100 m can tell; w must not be their difference."""
    pushed = {
        "cable.length": 100.0,
        "loads.tip.signal": "constant",
        "loads.tip.force": [0.0, 0.01, 0.02],
        "terms.gravity": "off",
    }
    sim = simulator(SOFT, FREE, pushed, n=20, method=name, step=1e-6)
    assert sim.advance_steps(200).status.ok
    impulse = np.array([0.0, 0.01, 0.02]) * sim.time
    assert np.abs(momenta(sim)[0] - impulse).max() < 1e-9 * np.abs(impulse).max()


def test_a_stiff_cable_spun_up_about_itself_keeps_its_account():
    """Beside a torsional stiffness that waves cross 1e5 times a step, inertia has 6 digits left."""
    values = {
        **{"terms.twist": "bishop", "cable.torsional_stiffness": 1e6, "damping.mass": 0.01},
        **{"loads.tip.type": "wrench", "loads.tip.position": 1.0, "loads.tip.signal": "constant"},
        **{"loads.tip.torque": [1e-3, 0.0, 0.0], "discretization.control_points": 40},
    }
    sim = simulator(SOFT, FREE, FLAT, values, method="energy_momentum", step=2e-2)
    assert sim.advance_steps(200).status.ok
    inertia = sim.model.mass(3)
    whole = inertia[0].sum() + 2.0 * inertia[1:].sum()  # of a rigid spin
    decay = (1.0 - np.exp(-0.01 * sim.time)) / 0.01
    assert sim.velocities[:, 3] == pytest.approx(1e-3 / whole * decay, rel=1e-4)
    assert sim.energy_error < 1e-9
