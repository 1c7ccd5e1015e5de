"""Three grippers whose poses come at 500 Hz: they hold the weight of the cable and its inertia."""

import math

import numpy as np
from session_bench import MS, T0

from dlo_sim.core import mass
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session

HANDS = ("left", "middle", "right")
STEP = 2e-3
VALUES = {
    "rate": 500.0,
    "initial.shape": "straight",
    "cable.diameter": 0.01,
    "cable.youngs_modulus": 1e6,
    "damping.stiffness": 0.02,
    "discretization.control_points": 20,
    "integrator.method": "energy_momentum",
    "integrator.step": STEP,
    "accuracy.estimate": "off",
    "start.fixed": [False] * 3,
    "end.fixed": [False] * 3,
    "grasps.names": list(HANDS),
    **{f"grasps.{name}.at": 0.15 + 0.35 * k for k, name in enumerate(HANDS)},
    **{f"grasps.{name}.pose_topic": f"/{name}" for name in HANDS},
    **{f"grasps.{name}.clamped": True for name in HANDS},
    **{f"grasps.{name}.tangent": [1.0, 0.0, 0.0] for name in HANDS},
}


def pose(hand, t):
    """Position and quaternion of a gripper that swings and turns."""
    s = t + 0.7 * hand
    half = 0.1 * math.sin(5.0 * s)
    place = (0.14 + 0.33 * hand, 0.05 * math.sin(4.0 * s), 0.06 * math.sin(6.0 * s))
    return (*place, 0.0, 0.0, math.sin(half), math.cos(half))


def test_reactions_balance_weight_and_inertia():
    """The mean of the reactions over two steps and the weight are the change of momentum. Measured
    9e-7 of the largest reaction.
    """
    session = Session(scene_from_values(VALUES))
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    momentum, force = [], []
    for now in range(T0, T0 + 500 * MS, 2 * MS):
        for hand, name in enumerate(HANDS):
            values = pose(hand, (now - T0) * 1e-9)
            session.receive(f"/{name}", encoder.encode(now, values), now)
        report = session.tick(now)
        assert report.advanced_steps <= 1
        if report.advanced_steps:
            reactions = {
                message.topic: np.frombuffer(message.data, "<f8", 3, len(message.data) - 48)
                for message in session.messages([f"~/{name}/reaction" for name in HANDS])
            }
            simulator = session.simulator
            cable = simulator.scene.cable
            share = mass.multiply(cable.mu * mass.gram(simulator.model.knots), np.ones(20))
            momentum.append(share @ simulator.velocities[:, :3])
            force.append(sum(reactions.values()))
    assert len(momentum) > 200
    weight = cable.mu * cable.length * np.array(simulator.scene.gravity)
    rate = (np.array(momentum)[2:] - np.array(momentum)[:-2]) / (2.0 * STEP)
    left = rate - weight - np.array(force)[2:]
    largest = np.abs(force).max()
    assert np.abs(np.diff(momentum, axis=0)).max() / STEP > np.abs(weight).max()
    assert np.abs(left).max() < 1e-4 * largest
