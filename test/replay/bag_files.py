"""Small bags and a small scene, and what is in bags."""

from __future__ import annotations

import math
from pathlib import Path

from dlo_sim.replay.bags import Bag, BagWriter
from dlo_sim.session import cdr

MS = 1_000_000
SECOND = 1_000_000_000
T0 = 1000 * SECOND

STORAGES = ["mcap", "sqlite3"]
TOPICS = {"/gripper_pose": cdr.POSE_STAMPED, "/wrench": cdr.WRENCH_STAMPED}

# A short soft cable on a gripper; few control points, so that these tests are quick.
VALUES = {
    "accuracy.estimate": "off",
    "cable.length": 0.4,
    "cable.diameter": 0.01,
    "cable.linear_density": 0.2,
    "cable.bending_stiffness": 0.02,
    "cable.axial_stiffness": 500.0,
    "damping.stiffness": 0.05,
    "damping.mass": 1.0,
    "discretization.control_points": 6,
    "start.position": [0.0, 0.0, 0.5],
    "start.clamped": True,
    "start.tangent": [0.0, 0.0, -1.0],
    "start.pose_topic": "/gripper_pose",
    "end.position": [0.0, 0.0, 0.1],
    "loads.names": ["tip"],
    "loads.tip.topic": "/wrench",
}


def messages(seconds: float = 1.5):
    """Poses at 30 Hz and wrenches at 100 Hz as (topic, time, bytes), in order."""
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    found = []
    for stamp in range(T0, T0 + round(seconds * SECOND), 33_333_333):
        x = 0.02 * (1 - math.cos((stamp - T0) * 6e-9))
        found.append(("/gripper_pose", stamp, pose.encode(stamp, (x, 0, 0.5, 0, 0, 0, 1))))
    for stamp in range(T0, T0 + round(seconds * SECOND), 10 * MS):
        force = 0.1 * math.sin((stamp - T0) * 9e-9)
        found.append(("/wrench", stamp, wrench.encode(stamp, (0, force, 0, 0, 0, 0))))
    return sorted(found, key=lambda m: m[1])


def write_bag(path: Path, found, topics=TOPICS, storage="mcap") -> Path:
    writer = BagWriter(path, topics, storage)
    for topic, time_ns, data in found:
        writer.write(topic, time_ns, data)
    writer.finish()
    return path


def data_file(bag: Path) -> Path:
    """Its only file of messages."""
    (file,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    return file


def cut(bag: Path, share: float) -> None:
    """Leave this share of its file."""
    file = data_file(bag)
    with file.open("r+b") as handle:
        handle.truncate(int(file.stat().st_size * share))


def read(path: Path):
    """The bag, and the messages of its inputs as (topic, time, bytes)."""
    bag = Bag(path)
    found = [(m.topic, m.time_ns, m.data) for m in bag.messages(TOPICS)]
    assert len(bag.damage) < 500 and "\n" not in bag.damage
    return bag, found


def contents(path: Path):
    """Topic -> list of (time, bytes)."""
    found: dict = {}
    bag = Bag(path)
    assert not bag.damage
    for message in bag.messages({t: k[0] for t, k in bag.topics.items()}):
        found.setdefault(message.topic, []).append((message.time_ns, message.data))
    return found
