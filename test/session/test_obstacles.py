"""An obstacle that poses on a topic move, through a session on the real simulator."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from session_bench import MS, SECOND, T0

from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.simulation.simulator import Simulator

BELT = {
    "cable.length": 0.3,
    "cable.diameter": 0.006,
    "cable.youngs_modulus": 2e6,
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.003],
    "end.position": [0.3, 0.0, 0.003],
    "discretization.control_points": 9,
    "damping.mass": 1.0,
    "integrator.step": 5e-3,
    "integrator.method": "energy_momentum",
    "accuracy.estimate": "off",
    "obstacles.names": ["belt"],
    "obstacles.belt.friction": 0.5,
    "obstacles.belt.pose_topic": "/belt_pose",
}
STORE = get_typestore(Stores.ROS2_JAZZY)
SPEED = 0.1  # [m/s]


def carried(seconds, estimate="off"):
    """A session in which the belt moves along x from half a second on; and its outputs."""
    session = Session(scene_from_values(BELT | {"accuracy.estimate": estimate}), Simulator)
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    out = []
    for now in range(T0, T0 + round(seconds * SECOND), 5 * MS):
        if (now - T0) % (20 * MS) == 0:
            x = SPEED * max((now - T0) / SECOND - 0.5, 0.0)
            raw = encoder.encode(now, (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            session.receive("/belt_pose", raw, now)
        session.tick(now)
        out += [m.data for m in session.messages((), ["~/control_points"])]
    return session, out


def shown(session, seconds):
    """Values of the first diagnostic status."""
    raw = session.diagnostics(T0 + round(seconds * SECOND))
    return dict(cdr.decode_diagnostic_array(raw)[1][0].values)


def test_a_belt_carries_the_cable_along():
    session, out = carried(3.0)
    simulator = session.simulator
    belt = simulator.end_pose("belt")[0]
    assert 0.2 < belt[0] < SPEED * 2.5
    moved = simulator.centerline([0.0, 0.3])[:, 0] - [0.0, 0.3]
    np.testing.assert_allclose(moved, belt[0], atol=2e-3)
    assert simulator.energy_error < 1e-4
    values = shown(session, 3.0)
    assert float(values["contact force [N]"]) == pytest.approx(
        simulator.scene.cable.mu * 0.3 * 9.81, rel=1e-2
    )
    assert float(values["clearance [m]"]) < 0.0
    again = carried(3.0)[1]
    assert out and out == again


def test_obstacles_and_forces_are_shown():
    """One marker for the belt where it is, and lines with the weight of the cable."""
    session, _ = carried(1.0)
    simulator = session.simulator
    (message,) = session.messages((), ["~/contacts"])
    lines, body = STORE.deserialize_cdr(message.data, message.type).markers
    assert (body.type, body.scale.x, body.scale.z) == (1, pytest.approx(1.2), 1e-3)
    place = simulator.end_pose("belt")[0]
    assert (body.pose.position.x, body.pose.position.z) == pytest.approx((place[0], -5e-4))
    points = np.array([[p.x, p.y, p.z] for p in lines.points]).reshape(-1, 2, 3)
    assert len(points) == len(simulator.contact("belt").u) > 4
    assert (points[:, 1] - points[:, 0])[:, 2].sum() == pytest.approx(0.03, rel=1e-2)


def test_the_error_estimate_moves_the_belt_too():
    session, _ = carried(1.5, "on")
    values = shown(session, 1.5)
    assert float(values["error estimate [m]"]) < 1e-3


def test_names_and_topics_are_checked():
    with pytest.raises(SceneError, match="obstacles.belt.pose_topic: .* is not a topic name"):
        scene_from_values(BELT | {"obstacles.belt.pose_topic": "a b"})
    with pytest.raises(SceneError, match="is the name of a grasp too"):
        scene_from_values(BELT | {"grasps.names": ["belt"]})
