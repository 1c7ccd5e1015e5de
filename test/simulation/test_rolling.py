"""Friction rolls a cable that twists about its axis, against rigid cylinders."""

import math

import numpy as np
import pytest
from cables import move

from dlo_sim import Simulator, load_scene

RADIUS, LENGTH, GRAVITY = 0.01, 0.5, 9.81
SHARE = 0.5  # I / (m a^2) of a solid cylinder


def lying(friction, slope=0.0, **keys):
    """A stiff cable along y on a plane that falls towards +x at an angle [rad]."""
    normal = np.array([math.sin(slope), 0.0, math.cos(slope)])
    x, _, z = (RADIUS * normal).tolist()
    ends = {
        f"{end}.{key}": value
        for end, y in (("start", -0.5 * LENGTH), ("end", 0.5 * LENGTH))
        for key, value in (("position", [x, y, z]), ("fixed", [False, False, False]))
    }
    scene = {
        "cable.length": LENGTH,
        "cable.diameter": 2.0 * RADIUS,
        "cable.density": 1000.0,
        "discretization.control_points": 8,
        "terms.twist": "bishop",
        "gravity": [0.0, 0.0, -GRAVITY],
        "contact.friction": friction,
        "initial.shape": "straight",
        "integrator.method": "energy_momentum",
        "integrator.tolerance": 1e-10,
        "obstacles.names": ["floor"],
        "obstacles.floor.shape": "plane",
        "obstacles.floor.orientation": [0.0, math.sin(0.5 * slope), 0.0, math.cos(0.5 * slope)],
    }
    return Simulator(load_scene(scene | ends | keys))


def set_moving(cable, **rates):
    """Let the floor move at these rates for a second."""
    move(cable, "floor", 1.0, **rates)


def motion(cable):
    """Mean speed [m/s] along x and mean spin [rad/s] about y."""
    speed = cable.velocities.mean(axis=0)
    return float(speed[0]), float(speed[3])


@pytest.mark.parametrize("friction", [0.5, 0.05])
def test_rolls_down_a_slope(friction):
    """Below tan(slope) = mu (1 + m a^2 / I) a cylinder rolls without sliding, with the acceleration
    g sin(slope) / (1 + I / (m a^2)); above it slides, and friction spins it up.
    """
    slope, time = math.radians(20.0), 0.2
    cable = lying(friction, slope)
    cable.advance(time)
    speed, spin = motion(cable)
    down, press = GRAVITY * math.sin(slope), GRAVITY * math.cos(slope)
    rolls = math.tan(slope) < friction * (1.0 + 1.0 / SHARE)
    held = down * SHARE / (1.0 + SHARE) if rolls else friction * press
    assert rolls == (friction == 0.5)
    assert speed / math.cos(slope) == pytest.approx((down - held) * cable.time, rel=2e-3)
    assert spin == pytest.approx(held / (SHARE * RADIUS) * cable.time, rel=2e-3)
    assert cable.energy_error < 1e-9


def test_slides_until_it_rolls():
    """A cylinder thrown without spin slides until it rolls at 1 / (1 + I / (m a^2)) of its speed;
    friction takes the share I / (m a^2) / (1 + I / (m a^2)) of its energy.
    """
    cable = lying(0.3)
    rates = np.zeros_like(cable.control_points)
    rates[:, 0] = 0.6
    cable.start_from(cable.control_points, rates)
    before = cable.energy().kinetic
    cable.advance(0.3)
    speed, spin = motion(cable)
    assert speed == pytest.approx(0.6 / (1.0 + SHARE), rel=1e-3)
    assert RADIUS * spin == pytest.approx(speed, rel=1e-3)
    assert cable.energy().kinetic == pytest.approx(before / (1.0 + SHARE), rel=2e-3)
    assert cable.energy_error < 1e-9


def test_a_belt_carries_it_along_at_a_third_of_its_speed():
    """A belt at the speed v below a cylinder that lies across it gives it v I / (I + m a^2)."""
    cable = lying(0.3)
    set_moving(cable, velocity=(0.6, 0.0, 0.0))
    cable.advance(0.4)
    speed, spin = motion(cable)
    assert speed == pytest.approx(0.6 * SHARE / (1.0 + SHARE), rel=2e-3)
    assert RADIUS * spin == pytest.approx(speed - 0.6, rel=2e-3)
    assert cable.energy_error < 1e-9


def test_a_turning_drum_spins_a_cable_that_lies_along_it():
    """Two cylinders that roll on each other turn at speeds in the inverse ratio of their radii."""
    drum, rate = 0.03, 2.0
    cable = lying(
        0.5,
        **{
            "integrator.tolerance": 1e-7,
            "start.position": [0.0, -0.5 * LENGTH, drum + RADIUS],
            "end.position": [0.0, 0.5 * LENGTH, drum + RADIUS],
            "start.fixed": [True, True, False],
            "end.fixed": [True, True, False],
            "obstacles.floor.shape": "cylinder",
            "obstacles.floor.size": [2.0 * drum, 2.0 * drum, 2.0],
            "obstacles.floor.orientation": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)],
        },
    )
    set_moving(cable, angular_velocity=(0.0, rate, 0.0))
    cable.advance(0.3)
    before = cable.control_points[:, 3].mean()
    cable.advance(0.2)  # the mean of a time in which the rod, which started at once, still trembles
    turned = cable.control_points[:, 3].mean() - before
    assert turned == pytest.approx(-0.2 * rate * drum / RADIUS, rel=2e-3)
    assert cable.energy_error < 1e-6


def test_quasistatic_twist_does_not_roll():
    """It has no rotary inertia, so friction holds the cable as if it could not turn."""
    cable = lying(0.5, math.radians(20.0), **{"terms.twist": "quasistatic"})
    cable.advance(0.1)
    assert abs(motion(cable)[0]) < 1e-3


@pytest.mark.parametrize(
    ("length", "diameter", "modulus", "damping", "points", "height", "speed", "spin"),
    [
        (0.4223278, 0.0030803377, 1335625.731, 0.01, 8, 0.0070685381, -0.76537533, 2.51974543),
        (1.2539996, 0.0026019363, 10255212.67, 0.001, 23, 0.0018705627, -0.53871848, 21.06265715),
    ],
)
def test_falls_with_a_spin_keep_the_energy_account(
    length, diameter, modulus, damping, points, height, speed, spin
):
    """Two of 2,400 random ones, in which the twist of a step converged slowly."""
    values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": 1200.0,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 3.0,
        "damping.stiffness": damping,
        "discretization.control_points": points,
        "start.position": [-0.5 * length, 0.0, height],
        "end.position": [0.5 * length, 0.0, height],
    }
    cable = lying(0.1, **values)
    rates = np.zeros_like(cable.control_points)
    rates[:, 1], rates[:, 3] = speed, spin
    cable.start_from(cable.control_points, rates)
    assert cable.advance(0.6).status.ok
    assert cable.energy_error < 1e-5
