"""A small harness with all that a net may have, and messages that move it."""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr

MS = 1_000_000
SECOND = 1_000_000_000
T0 = 1000 * SECOND
VALUES = {
    "accuracy.estimate": "off",
    "integrator.step": 5e-3,
    "rate": 100.0,
    "cable.length": 1.0,
    "cable.diameter": 0.01,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 1000.0,
    "cable.bending_stiffness": 0.01,
    "cable.torsional_stiffness": 0.005,
    "damping.mass": 1.0,
    "damping.stiffness": 0.01,
    "discretization.control_points": 9,
    "start.clamped": True,
    "start.pose_topic": "/start",
    "end.position": [1.0, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "initial.shape": "straight",
    "branches.names": ["a", "b"],
    "branches.a.at": 0.3,
    "branches.a.direction": [0.0, 0.0, -1.0],
    "branches.a.cable.length": 0.3,
    "branches.a.discretization.control_points": 7,
    "branches.a.end.position": [0.3, 0.0, -0.3],
    "branches.a.end.fixed": [True] * 3,
    "branches.a.end.pose_topic": "/a",
    "branches.b.at": 0.6,
    "branches.b.direction": [0.0, 1.0, 0.0],
    "branches.b.joint": "hinged",
    "branches.b.cable.length": 0.4,
    "branches.b.discretization.control_points": 8,
    "cables.names": ["c"],
    "cables.c.cable.length": 0.2,
    "cables.c.discretization.control_points": 5,
    "cables.c.start.position": [0.0, -0.5, 0.0],
    "cables.c.end.position": [0.2, -0.5, 0.0],
    "connectors.names": ["plug"],
    "connectors.plug.on": "b",
    "connectors.plug.mass": 0.02,
    "connectors.plug.center": [0.01, 0.0, 0.0],
    "connectors.plug.inertia": [2e-6, 4e-6, 4e-6],
    "connectors.plug.shape": "capsule",
    "connectors.plug.size": [0.04, 0.02, 0.0],
    "connectors.plug.frame": "plug",
    "grasps.names": ["clip"],
    "grasps.clip.on": "b",
    "grasps.clip.at": 0.5,
    "grasps.clip.position": [0.6, 0.2, 0.0],
    "grasps.clip.taken_topic": "/taken",
    "loads.names": ["hand"],
    "loads.hand.on": "a",
    "loads.hand.type": "force",
    "loads.hand.position": 0.5,
    "loads.hand.topic": "/hand",
}
TOPICS = {"/start": cdr.POSE_STAMPED, "/a": cdr.POSE_STAMPED, "/hand": cdr.VECTOR3_STAMPED}


def harness(**changes: object) -> Scene:
    """The scene with other values."""
    return scene_from_values({**VALUES, **changes})


def told(begin: float = 0.0, end: float = 0.5) -> list[tuple[str, int, bytes]]:
    """Topics, times [ns] and messages: two grippers that swing, and a force on a branch."""
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    force = cdr.StampedEncoder(cdr.VECTOR3_STAMPED, "world")
    found = []
    for t in np.arange(round(100 * begin), round(100 * end)) * 0.01:
        stamp = T0 + round(t * SECOND)
        found += [
            ("/start", stamp, pose.encode(stamp, (0, 0, 0.02 * np.sin(6 * t), 0, 0, 0, 1))),
            ("/a", stamp, pose.encode(stamp, (0.3, 0.05 * np.sin(4 * t), -0.3, 0, 0, 0, 1))),
            ("/hand", stamp, force.encode(stamp, (0.0, 0.1 * np.sin(9 * t), 0.0))),
        ]
    return found


def feed(session: Any, begin: float = 0.0, end: float = 0.5) -> list[Any]:
    """Let a session hear that, tick at its rate, and give out what it publishes."""
    found, messages = [], told(begin, end)
    for now in sorted({stamp for _, stamp, _ in messages}):
        for topic, stamp, raw in messages:
            if stamp == now:
                session.receive(topic, raw, now)
        session.tick(now)
        found += session.messages()
    return found
