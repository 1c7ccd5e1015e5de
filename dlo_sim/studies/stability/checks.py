"""What is right for an extreme scene: each check takes a finished run and returns its error."""

from __future__ import annotations

import numpy as np

from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability import truths
from dlo_sim.studies.stability.extremes import Array, Run

PULSE = 0.01  # [s]
PULSES = {"left": (3.0, 1.0, -2.0), "right": (-1.0, 0.5, 2.5)}  # [N] at u = 0 and u = L
TURN = 2.0  # [rad]
BIG_PULSE = (1e6, 1e-3)  # [N], [s]


def energy_balance(run: Run) -> float:
    """How far the balance of energy is open."""
    return run.energy_error


def lasting(run: Run) -> float:
    """Largest move [share of the length] of a cable that should stay where it is."""
    moved = np.abs(run.simulator.control_points - run.first)[:, :3].max()
    return float(max(moved / run.simulator.scene.cable.length, run.energy_error))


def hangs_as_catenary(run: Run) -> float:
    """Largest distance [share of the length] from the elastic catenary."""
    scene = run.simulator.scene
    u = np.linspace(0.0, scene.cable.length, 201)
    span = scene.end.position[0] - scene.start.position[0]
    weight = scene.cable.mu * -scene.gravity[2]
    x, z = truths.catenary(u, scene.cable.length, span, weight, scene.cable.EA)
    shape = run.simulator.centerline(u) - np.asarray(scene.start.position)
    gap = np.hypot(shape[:, 0] - x, shape[:, 2] - z).max()
    return float(gap / scene.cable.length)


def sags_as_cantilever(run: Run) -> float:
    """Relative error of the tip's deflection under its own weight against q L^4 / 8 EI."""
    scene = run.simulator.scene
    load = scene.cable.mu * -scene.gravity[2]
    expected = load * scene.cable.length**4 / (8.0 * scene.cable.EI)
    return float(abs(-run.simulator.control_points[-1, 2] / expected - 1.0))


def pulls_as_string(run: Run) -> float:
    """Relative error of the middle's deflection against an elastic string."""
    scene = run.simulator.scene
    length = scene.cable.length
    middle = run.simulator.centerline([0.5 * length])[0]
    force = float(np.linalg.norm(scene.load("pull").force))
    expected = truths.string_deflection(force, scene.cable.EA, length, scene.cable.EI)
    return float(abs(abs(middle[1]) / expected - 1.0))


def swings_about_string(run: Run) -> float:
    """Energy balance of the pulled string, which also has to have moved by a percent of L."""
    moved = np.abs(run.simulator.control_points - run.first).max()
    return run.energy_error if moved > 1e-2 * run.simulator.scene.cable.length else np.inf


def follows_string(run: Run) -> float:
    """Relative error of the middle's deflection, averaged over a fast small swing, against the
    elastic string under the load's present force."""
    simulator = run.simulator
    scene = simulator.scene
    length, load = scene.cable.length, scene.load("pull")
    found, force = [], []
    for _ in range(20):
        simulator.advance_steps(1)
        found.append(abs(simulator.centerline([0.5 * length])[0, 1]))
        share = np.sin(2.0 * np.pi * load.frequency * simulator.time)
        force.append(np.linalg.norm(load.force) * abs(share))
    cable = scene.cable
    expected = truths.string_deflection(float(np.mean(force)), cable.EA, length, cable.EI)
    return float(max(abs(np.mean(found) / expected - 1.0), 1e3 * run.energy_error))


def weighs_its_weight(run: Run) -> float:
    """Relative error of the reaction at rest against the weight."""
    scene = run.simulator.scene
    force, _ = run.simulator.reaction("start")
    weight = scene.cable.mu * scene.cable.length * np.asarray(scene.gravity)
    return float(np.abs(force + weight).max() / np.linalg.norm(weight))


def is_taut(run: Run) -> float:
    """Relative error of the tension at rest against EA (gap / L - 1)."""
    scene = run.simulator.scene
    start, end = (run.simulator.end_pose(name)[0] for name in ("start", "end"))
    gap = float(np.linalg.norm(end - start))
    expected = scene.cable.EA * (gap / scene.cable.length - 1.0)
    force, _ = run.simulator.reaction("end")
    return float(abs(np.linalg.norm(force) / expected - 1.0))


def keeps_momentum(run: Run) -> float:
    """Momentum and angular momentum against those that the pulses gave, relative."""
    return truths.momentum_error(run.simulator, PULSES, PULSE)


def carries_impulse(run: Run) -> float:
    """Momentum against the impulse of the great pulse, relative."""
    momentum, _ = truths.momenta(run.simulator)
    impulse = BIG_PULSE[0] * BIG_PULSE[1]
    return float(np.linalg.norm(momentum - np.array([0.0, 0.0, impulse])) / impulse)


def turns_as_rod(run: Run) -> float:
    """Moment about the axis against GJ Theta / L, and the largest move off the axis."""
    scene = run.simulator.scene
    _, moment = run.simulator.reaction("end")
    expected = scene.cable.GJ * TURN / scene.cable.length
    off = np.abs(run.simulator.control_points[:, 1:3]).max() / scene.cable.length
    return float(max(abs(abs(moment[0]) / expected - 1.0), off))


def stays_straight(run: Run) -> float:
    """Largest move [share of the length] off the x axis, or the open balance of energy."""
    off = np.abs(run.simulator.control_points[:, 1:3]).max() / run.simulator.scene.cable.length
    return float(max(off, run.energy_error))


def amplifies_as_column(run: Run) -> float:
    """Buckling load from the amplified sag w0 / (1 - P / Pc), relative to EI pi^2 / L^2."""
    scene = run.simulator.scene
    force = abs(scene.load("press").force[0])
    side = scene.load("side").force[2]
    first_mode = 2.0 * side * scene.cable.length**3 / (np.pi**4 * scene.cable.EI)
    sag = run.simulator.centerline([0.5 * scene.cable.length])[0, 2]
    found = force / (1.0 - first_mode / sag)
    return float(abs(found / truths.euler_load(scene) - 1.0))


def buckles_as_elastica(run: Run) -> float:
    """Approach of the ends [share of the length] against the elastica's."""
    scene = run.simulator.scene
    force = abs(scene.load("press").force[0])
    gap = run.simulator.centerline([0.0, scene.cable.length])[:, 0]
    expected = truths.elastica_gap(force / truths.euler_load(scene))
    return float(abs((gap[1] - gap[0]) / scene.cable.length - expected))


def closes_ring(run: Run) -> float:
    """Distance [share of the length] of the two ends of a cable bent to a circle."""
    points = run.simulator.control_points
    return float(np.linalg.norm(points[-1, :3] - points[0, :3]) / run.simulator.scene.cable.length)


def mirrors(run: Run) -> float:
    """Asymmetry [share of the length] of a cable whose ends met, or its open energy balance."""
    shape = _shape(run.simulator)
    mirrored = shape[::-1] * np.array([-1.0, 1.0, 1.0])
    middle = np.array([shape[0, 0] + shape[-1, 0], 0.0, 0.0])
    gap = np.abs(shape - mirrored - middle).max() / run.simulator.scene.cable.length
    return float(max(gap, run.energy_error))


def rests_as_undamped(run: Run) -> float:
    """Largest distance [share of the length] from the same scene's equilibrium without damping."""
    scene = run.simulator.scene
    plain = dict.fromkeys(("damping.mass", "damping.stiffness", "damping.air_drag"), 0.0)
    still = Simulator(scene.with_values({**plain, "initial.shape": "equilibrium"}))
    gap = np.linalg.norm(_shape(run.simulator) - _shape(still), axis=1).max()
    return float(gap / scene.cable.length)


def _shape(simulator: Simulator) -> Array:
    """101 points of the centerline [m]."""
    return simulator.centerline(np.linspace(0.0, simulator.scene.cable.length, 101))
