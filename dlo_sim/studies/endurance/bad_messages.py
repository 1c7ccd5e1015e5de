"""Random invalid messages for a session: nothing may raise, all outputs must be finite, and every
refusal must be one line.
"""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable

import numpy as np

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.cdr_points import PointCloudEncoder
from dlo_sim.session.plans import Plans
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import PLAN
from dlo_sim.studies.endurance.fuzz import REALS, T0, TICK, Broken, Progress, check_line, repeatable

# All kinds of input; measured points are a point cloud in one scene, a pose array in the other.
ALL_INPUTS: dict[str, object] = {
    "cable.diameter": 0.01,
    "cable.youngs_modulus": 1e6,
    "damping.stiffness": 0.02,
    "discretization.control_points": 8,
    "integrator.step": 0.005,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "start.pose_topic": "/pose",
    "start.frame": "tool",
    "end.pose_topic": "/points",
    "end.pose_type": "two_points",
    "end.fixed": [True, True, True],
    "grasps.names": ["hand"],
    "grasps.hand.taken": False,
    "grasps.hand.at": 0.5,
    "grasps.hand.taken_topic": "/taken",
    "loads.names": ["tool", "force"],
    "loads.tool.topic": "/wrench",
    "loads.force.topic": "/force",
    "loads.force.type": "force",
    "loads.force.position": 0.5,
    "measured.type": "point_cloud",
    "outputs.points": True,
    "outputs.capsules": 5,
    "outputs.tf": True,
    "forecast.processes": 1,
}
WHOLES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 10**9, 10**6, 65_536, 100)
_GOOD = ("/pose", "/points", "/wrench")


def messages(count: int, seed: int, progress: Progress = lambda share: None) -> Counter[str]:
    """Send messages of every type, one in four valid, to a running session; count the outcomes."""
    made, done = Counter[str](), 0
    for kind in ("point_cloud", "pose_array"):
        world = _World(kind, random.Random(f"{seed} {kind}"))
        for _ in range(count // 2):
            made[world.send()] += 1
            done += 1
            if done % 500 == 0:
                progress(done / count)
        world.recover()
    return made


class _World:
    """A session with a simulated clock, and messages for it."""

    def __init__(self, kind: str, rng: random.Random) -> None:
        self.rng, self.now = rng, T0
        self.session = Session(scene_from_values({**ALL_INPUTS, "measured.type": kind}), live=True)
        self.plans = Plans(self.session, PLAN)
        self.made = _templates(kind)

    def send(self) -> str:
        """Send one message, sometimes followed by a tick; returns the outcome."""
        rng = self.rng
        topic = rng.choice(list(self.made))
        raw = self.made[topic](self.now - rng.choice((0, 0, TICK, -TICK)))
        bad = rng.random() < 0.75
        if bad:
            raw = damaged_message(rng, raw)
        records = self.session.journal.topics
        record = self.plans.record if topic == PLAN else records[topic]
        accepted, refused = record.accepted, record.refused.copy()
        with repeatable(f"{topic}: {raw[:400].hex()}"):
            if topic == PLAN:
                self.plans.accept(raw, self.now)
            else:
                self.session.receive(topic, raw, self.now)
            if rng.random() < 0.2:
                self._tick()
        new = record.refused - refused
        if new:
            check_line(record.last_refusal)
            return f"refused: {next(iter(new))}"
        if record.accepted > accepted:
            return "used, though damaged" if bad else "used"
        return "waits for its time"

    def recover(self) -> None:
        """Check that the session then accepts valid messages and runs; the first second is not
        checked, because earlier messages may still be waiting.
        """
        self.session.reset()
        records = {topic: self.session.journal.topics[topic] for topic in _GOOD}
        for number in range(500):
            if number == 200:
                before = {topic: record.refusals for topic, record in records.items()}
            self._tick()
            for topic in _GOOD:
                self.session.receive(topic, self.made[topic](self.now), self.now)
        if self.session.status is not SessionStatus.RUNNING:
            raise Broken(f"good messages do not help: {self.session.status.value}")
        for topic, record in records.items():
            if record.refusals > before[topic]:
                raise Broken(f"good messages are refused on {topic}: {record.last_refusal}")

    def _tick(self) -> None:
        self.now += TICK
        self.session.tick(self.now)
        if self.session.status is SessionStatus.FAILED:
            self.session.reset()
        for message in self.session.messages():
            numbers = {cdr.POSE_ARRAY: 56 * 8, cdr.WRENCH_STAMPED: 48}.get(message.type, 0)
            tail = message.data[len(message.data) - numbers :]
            if not np.isfinite(np.frombuffer(tail, "<f8")).all():
                raise Broken(f"{message.topic} is not finite")
        if self.now % SECOND == 0:
            self.session.diagnostics(self.now)


def _templates(kind: str) -> dict[str, Callable[[int], bytes]]:
    """Topic -> function that makes a valid message with a stamp [ns]."""
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "tool")
    force = cdr.StampedEncoder(cdr.VECTOR3_STAMPED, "world")
    points = cdr.PoseArrayEncoder("world", 2)
    points.rows[:, :3] = (0.79, 0.0, 0.0), (0.81, 0.0, 0.0)
    seen: cdr.Encoder = cdr.PoseArrayEncoder("world", 9)
    if kind == "point_cloud":
        seen = PointCloudEncoder("world", ["x", "y", "z"], 9)
    seen.rows[:, 0] = np.linspace(0.0, 0.8, 9)

    def plan(stamp_ns: int) -> bytes:
        writer = cdr.Writer()
        writer.header("world", stamp_ns)
        writer.numbers("I", 1)
        writer.text("start")
        writer.numbers("I", 2)
        for nanoseconds in (100_000_000, 500_000_000):
            writer.numbers("I", 1)
            writer.numbers("d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
            writer.numbers("I", 0, 0)
            writer.numbers("i", 0)
            writer.numbers("I", nanoseconds)
        return bytes(writer.data)

    return {
        "/pose": lambda t: pose.encode(t, (0.0, 0.02 * np.sin(t * 3e-9), 0.0, 0, 0, 0, 1)),
        "/points": lambda t: points.encode(t),
        "/wrench": lambda t: wrench.encode(t, (0.01, 0.0, 0.02, 0.0, 0.0, 0.0)),
        "/force": lambda t: force.encode(t, (0.0, 0.01, 0.0)),
        "/taken": lambda t: b"\0\1\0\0" + bytes([t // TICK % 2]),
        "/dlo_sim/measured": lambda t: seen.encode(t),
        PLAN: plan,
    }


def damaged_message(rng: random.Random, raw: bytes) -> bytes:
    """Damage a message: invalid numbers, wrong lengths or stamps, flipped bits, cut, extended."""
    data = bytearray(raw)
    kind, at = rng.randrange(8), rng.randrange(len(data))
    if kind == 0 and len(data) > 16:
        struct.pack_into("<d", data, len(data) - 8 * rng.randint(1, len(data) // 8 - 1), _real(rng))
    elif kind == 1 and len(data) > 8:
        struct.pack_into("<I", data, 4 * rng.randrange(1, len(data) // 4), rng.choice(WHOLES))
    elif kind == 2 and len(data) > 12:
        struct.pack_into("<iI", data, 4, rng.randint(-(2**31), 2**31 - 1), rng.getrandbits(32))
    elif kind == 3:
        (seconds,) = struct.unpack_from("<i", data.ljust(12, b"\0"), 4)
        later = seconds + rng.choice((-3600, -2, -1, 1, 2, 3600))
        data[4:8] = struct.pack("<i", max(-(2**31), min(later, 2**31 - 1)))
    elif kind == 4:
        for _ in range(rng.choice((1, 3, 30))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 5:
        del data[at:]
    elif kind == 6:
        data[at:at] = rng.randbytes(rng.choice((1, 8, 100, 100_000)))
    else:
        data[20 : 20 + rng.randrange(12)] = rng.randbytes(8)  # in the frame id
    return bytes(data)


def _real(rng: random.Random) -> float:
    return rng.choice((*REALS, rng.uniform(-2.0, 2.0), 10.0 ** rng.uniform(-9, 9)))
