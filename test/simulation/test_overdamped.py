"""Modes that damping makes much slower than a step: they come to rest, and so do the reactions."""

import numpy as np

from dlo_sim import Simulator, load_scene

CABLE = {
    "cable.length": 0.8,
    "cable.diameter": 0.008,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 5.0e7,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "end.position": [0.8, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.tangent": [1.0, 0.0, 0.0],
    "end.pose_topic": "/right/pose",
    "damping.mass": 3.0,
    "damping.stiffness": 0.01,
    "discretization.control_points": 33,
    "integrator.method": "energy_momentum",
}
TICK = 0.01  # s
CHORD = 0.55  # m, at the end of the motion


def brought_together() -> Simulator:
    """Two grippers brought together, the end set anew at each tick: every jump of its position
    excites axial modes, of which the damping is a hundred times critical.
    """
    sim = Simulator(load_scene(CABLE))
    for tick in range(1, 101):
        sim.set_end("end", position=(0.8 - (0.8 - CHORD) * tick / 100.0, 0.0, 0.0))
        assert sim.advance(TICK).status.ok
    return sim


def test_jumps_of_a_gripper_leave_no_alternating_velocities() -> None:
    sim = brought_together()
    assert sim.advance(0.1).status.ok
    assert np.abs(sim.velocities[:, :3]).max() < 0.2  # m/s; 0.05 as measured, 30 alternating


def test_reactions_at_rest_carry_the_weight() -> None:
    sim = brought_together()
    assert sim.advance(5.0).status.ok
    weight = sim.scene.cable.mu * sim.scene.cable.length * 9.81
    forces = [sim.reaction(end)[0] for end in ("start", "end")]
    for force in forces:
        assert abs(force[2] - 0.5 * weight) < 1e-3 * weight
    assert np.abs(np.add(*forces) - [0.0, 0.0, weight]).max() < 1e-4 * weight
    assert sim.energy().kinetic < 1e-9  # J; 0.5 J where velocities alternate


def test_their_energy_counts_as_dissipated() -> None:
    sim = brought_together()
    assert sim.energy_error < 1e-5


def test_a_swinging_cable_keeps_its_velocity() -> None:
    """The centripetal acceleration acts along the cable, its stiffest direction. A cord that hangs
    from a gripper and swings on after it: its motion converges with the square of the step.
    """
    scene = {
        "cable.length": 1.2,
        "cable.diameter": 0.006,
        "cable.density": 1100.0,
        "cable.youngs_modulus": 1.0e7,
        "start.clamped": True,
        "start.tangent": [0.0, 0.0, -1.0],
        "start.pose_topic": "/gripper/pose",
        "end.position": [0.0, 0.0, -1.2],
        "damping.stiffness": 0.02,
        "discretization.control_points": 17,
        "integrator.method": "energy_momentum",
    }
    times = np.linspace(0.0, 3.0, 301)
    share = np.clip(times / 1.2, 0.0, 1.0)
    path = np.zeros((len(times), 7))
    path[:, 0] = 0.3 * (16.0 * (share * (1.0 - share)) ** 2)
    path[:, 6] = 1.0
    shapes = []
    for step in (5e-3, 2.5e-3, 1.25e-3):
        sim = Simulator(load_scene(scene | {"integrator.step": step}))
        report, points = sim.follow(times, {"start": path}, times[20::20])
        assert report.status.ok, report.message
        shapes.append(points[:, :, :3])
    coarse, fine = (np.abs(a - b).max() for a, b in zip(shapes, shapes[1:], strict=False))
    assert fine < 3e-4  # m; 2e-3 m where all of the difference of velocities is damped
    assert coarse > 3.2 * fine
