"""An obstacle that poses on a topic move, through a session on the real simulator."""

import numpy as np
import pytest
from cables import LYING, weight
from rosbags.typesys import Stores, get_typestore
from session_bench import MS, SECOND, T0, FakeFrames, feed, poses

from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.intake import Transform
from dlo_sim.session.session import Session
from dlo_sim.simulation.simulator import Simulator

BELT = LYING | {
    "accuracy.estimate": "off",
    "start.position": [0.0, 0.0, 0.003],
    "end.position": [0.3, 0.0, 0.003],
    "obstacles.names": ["belt"],
    "obstacles.belt.pose_topic": "/belt_pose",
}
STORE = get_typestore(Stores.ROS2_JAZZY)
SPEED = 0.1  # [m/s]


def carried(seconds, estimate="off"):
    """A session in which the belt moves along x from half a second on; and its outputs."""
    session = Session(scene_from_values(BELT | {"accuracy.estimate": estimate}), Simulator)
    end = T0 + round(seconds * SECOND)
    told = poses("/belt_pose", lambda t: (SPEED * max(t - 0.5, 0.0), 0.0, 0.0), T0, end, 20 * MS)
    out = []
    for _ in feed(session, told, T0, end):
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
    assert float(values["contact force [N]"]) == pytest.approx(weight(simulator), rel=1e-2)
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


def test_an_obstacle_follows_the_frame_that_it_is_attached_to():
    """A plane 0.1 m below a frame that moves along x and turns about z; without it, the cable waits
    as for a pose.
    """
    values = {key: value for key, value in BELT.items() if key != "obstacles.belt.pose_topic"}
    values |= {"obstacles.belt.frame": "table", "obstacles.belt.position": [0.05, 0.0, -0.1]}
    table = FakeFrames()
    session = Session(scene_from_values(values), Simulator, transforms=table)
    assert session.tick(T0).message == "waiting for the first pose on table"
    for now in range(T0, T0 + SECOND, 5 * MS):
        turn = 0.1 * (now - T0) / SECOND
        place = (SPEED * (now - T0) / SECOND, 0.0, 0.1)
        table.found["table"] = Transform(now, place, (0.0, 0.0, np.sin(turn), np.cos(turn)))
        session.tick(now)
    simulator = session.simulator
    position, orientation = simulator.end_pose("belt")
    turn = np.arcsin(orientation[2])
    assert turn == pytest.approx(0.1, abs=0.01)
    x = SPEED * turn / 0.1
    expected = [x + 0.05 * np.cos(2 * turn), 0.05 * np.sin(2 * turn), 0.0]
    np.testing.assert_allclose(position, expected, atol=1e-6)
    assert simulator.contact("belt").force[2] == pytest.approx(weight(simulator), rel=1e-2)
    assert session.journal.topics["table"].refusals == 0


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"frame": "table"}, "'table' gives the pose; remove it or obstacles.belt.pose_topic"),
        ({"pose_topic": "", "frame": "/table"}, "is no frame of tf2; give table"),
        ({"pose_topic": "", "frame": "world"}, "is the world frame, frame_id, .*; remove it"),
        ({"pose_topic": "a b"}, "obstacles.belt.pose_topic: .* is not a topic name"),
    ],
)
def test_frames_and_topics_are_checked(changes, problem):
    given = {f"obstacles.belt.{key}": value for key, value in changes.items()}
    with pytest.raises(SceneError, match=problem):
        scene_from_values(BELT | given)
