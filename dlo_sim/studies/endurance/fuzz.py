"""Random bad input: messages, parameters, damaged bags, signals. Nothing may raise, no number that
is not finite may come out, and every refusal is one line.

Each function returns what became of its pieces, counted by outcome, and raises `Broken` on the
first that breaks a rule, with what it takes to repeat it.
"""

from __future__ import annotations

import contextlib
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.scene.parameter import Parameter
from dlo_sim.scene.parameters import PARAMETERS
from dlo_sim.session import cdr
from dlo_sim.session.cdr_points import PointCloudEncoder
from dlo_sim.session.plans import Plans
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import PLAN
from dlo_sim.tuning.scene_file import scene_text

Progress = Callable[[float], None]
T0 = 1000 * SECOND
TICK = 5_000_000
# Every kind of input. Clouds of points in one scene, arrays of poses in the other.
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
SMALL: dict[str, object] = {
    "cable.length": 0.4,
    "cable.diameter": 0.01,
    "damping.stiffness": 0.05,
    "discretization.control_points": 6,
    "start.clamped": True,
    "start.pose_topic": "/pose",
    "rate": 20.0,  # bit errors in times make gaps of minutes
}
REALS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e300, 1e7, 1e-320, -0.0, 1.0)
WHOLES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 10**9, 10**6, 65_536, 100)
_GOOD = ("/pose", "/points", "/wrench")
ENDINGS = {0, 129, 130, 143}
COMMANDS = ("simulate", "replay", "node")
ASKED_TO_END = (signal.SIGINT, signal.SIGTERM)


class Broken(Exception):
    """Something that may never happen."""


def messages(count: int, seed: int, progress: Progress = lambda share: None) -> Counter[str]:
    """Messages of every type, one in four as it should be, given to a session that ticks on."""
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
    """A session on a clock of its own, and messages for it."""

    def __init__(self, kind: str, rng: random.Random) -> None:
        self.rng, self.now = rng, T0
        self.session = Session(scene_from_values({**ALL_INPUTS, "measured.type": kind}), live=True)
        self.plans = Plans(self.session, PLAN)
        self.made = _templates(kind)

    def send(self) -> str:
        """One message and, now and then, a tick; what became of the message."""
        rng = self.rng
        topic = rng.choice(list(self.made))
        raw = self.made[topic](self.now - rng.choice((0, 0, TICK, -TICK)))
        bad = rng.random() < 0.75
        if bad:
            raw = damaged_message(rng, raw)
        records = self.session.journal.topics
        record = self.plans.record if topic == PLAN else records[topic]
        accepted, refused = record.accepted, record.refused.copy()
        with _repeatable(f"{topic}: {raw[:400].hex()}"):
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
        """After all that, good messages are used and the prediction goes on: once it is decided, by
        them, what becomes of those that wait.
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
    """Topic -> a good message with a stamp [ns]."""
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
    """Numbers that are none, lengths that lie, stamps from anywhere, bits flipped, cut, grown."""
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
        data[20 : 20 + rng.randrange(12)] = rng.randbytes(8)  # in the name of the frame
    return bytes(data)


def _real(rng: random.Random) -> float:
    return rng.choice((*REALS, rng.uniform(-2.0, 2.0), 10.0 ** rng.uniform(-9, 9)))


def parameters(count: int, seed: int, progress: Progress = lambda share: None) -> Counter[str]:
    """Sets of random values, some impossible, for a session that runs; every 25th of those that it
    takes is kept for a while.
    """
    rng, made = random.Random(seed), Counter[str]()
    first = scene_from_values({**SMALL, "start.pose_topic": ""})
    session, now = Session(first), T0
    for number in range(count):
        chosen = rng.sample(PARAMETERS, rng.choice((1, 1, 2, 4)))
        values = {row.key: _value(rng, row) for row in chosen}
        with _repeatable(str(values)[:2000]):
            try:
                scene = session.scene.with_values(values)
                session.reconfigure(scene)
            except ValueError as refusal:
                check_line(str(refusal))
                made["refused"] += 1
                continue
            for _ in range(5):
                now += TICK
                session.tick(now)
            status = session.status is SessionStatus.FAILED
            made["taken, and the run failed" if status else "taken"] += 1
            if status or number % 25 == 0:
                session = Session(first)
        progress(number / count)
    return made


def _value(rng: random.Random, row: Parameter) -> object:
    """A value for a parameter: possible, at a limit, beyond, of another type."""
    if rng.random() < 0.25:
        return rng.choice((*REALS, -1, 2**70, "", "x" * 999, True, [], [1.0] * 3, {}, None, "\n"))
    if row.is_array:
        length = row.length or rng.choice((0, 1, 3))
        return [_element(rng, row) for _ in range(length + (rng.random() < 0.1))]
    return _element(rng, row)


def _element(rng: random.Random, row: Parameter) -> object:
    if row.choices:
        return rng.choice(row.choices)
    if row.element_kind == "bool":
        return rng.random() < 0.5
    if row.element_kind == "string":
        return rng.choice(("", "start", "/x", "a b", "tip"))
    if row.element_kind == "integer":
        return rng.choice((row.low or 0, rng.randint(4, 40), -3))
    return rng.choice((row.low or 0.0, 10.0 ** rng.uniform(-6, 6), 10.0 ** rng.uniform(-2, 2)))


def bags(
    count: int, seed: int, folder: Path, progress: Progress = lambda share: None
) -> Counter[str]:
    """Damaged bags, replayed."""
    from dlo_sim.replay.bags import BagError  # here and below: rosbags is not always there
    from dlo_sim.replay.replay import ReplayError, replay_bag

    rng, made, scene = random.Random(seed), Counter[str](), scene_from_values(SMALL)
    good = {storage: write_bag(folder / storage, storage) for storage in ("mcap", "sqlite3")}
    for number in range(count):
        path = folder / "damaged"
        path.mkdir()
        for file in good["mcap" if number % 2 else "sqlite3"].iterdir():
            (path / file.name).write_bytes(file.read_bytes())
        for _ in range(rng.choice((1, 1, 3))):
            damage_bag(rng, path)
        with _repeatable(f"bag {number} of seed {seed}"):
            try:
                status = replay_bag(path, scene, None).status
                made[f"replayed, {status}"] += 1
            except (BagError, ReplayError) as refusal:
                check_line(str(refusal))
                made["refused"] += 1
        shutil.rmtree(path)
        progress(number / count)
    return made


def write_bag(path: Path, storage: str) -> Path:
    """Poses of a gripper at 30 Hz for 1.5 s."""
    from dlo_sim.replay.bags import BagWriter

    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    writer = BagWriter(
        path, {"/pose": cdr.POSE_STAMPED}, "mcap" if storage == "mcap" else "sqlite3"
    )
    for stamp in range(T0, T0 + 3 * SECOND // 2, SECOND // 30):
        x = 0.02 * (1.0 - np.cos((stamp - T0) * 6e-9))
        writer.write("/pose", stamp, pose.encode(stamp, (x, 0, 0, 0, 0, 0, 1)))
    writer.finish()
    return path


def damage_bag(rng: random.Random, path: Path) -> None:
    """Change bytes of one of the two files of a bag."""
    (recorded,) = (file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
    file = rng.choice([recorded] * 3 + [path / "metadata.yaml"])
    data = bytearray(file.read_bytes())
    at, length = rng.randrange(len(data)), rng.choice([1, 16, 512, 4096])
    kind = rng.randrange(5)
    if kind == 0:
        for _ in range(rng.choice([1, 5, 100])):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        data[at : at + length] = rng.choice([b"\0", b"\xff"]) * length
    elif kind == 3:
        del data[at : at + length]
    else:
        data[at:at] = rng.randbytes(length)
    file.write_bytes(data)


def signals(
    count: int, seed: int, folder: Path, progress: Progress = lambda share: None
) -> Counter[str]:
    """One signal to each of so many commands, at any time of its life, four at a time."""
    rng, made = random.Random(seed), Counter[str]()
    write_bag(folder / "bag", "mcap")
    scene = scene_text(scene_from_values(SMALL), [])
    (folder / "scene.yaml").write_text(scene, encoding="utf-8")
    cases = [
        (folder, k, rng.choice(COMMANDS), rng.choice(ASKED_TO_END), rng.uniform(0.0, 2.5))
        for k in range(count)
    ]
    with ThreadPoolExecutor(4) as threads:
        for done, outcome in enumerate(threads.map(_signalled, cases)):
            made[outcome] += 1
            progress(done / count)
    return made


def _signalled(case: tuple[Path, int, str, signal.Signals, float]) -> str:
    """What a command leaves behind that gets a signal after so many seconds."""
    folder, number, name, kind, delay = case
    output, scene = folder / f"out_{number}", str(folder / "scene.yaml")
    output.mkdir()
    words = {
        "simulate": [scene, "--duration", "1e5", "--every", "100", "--output", f"{output}/run.npz"],
        "replay": [f"{folder}/bag", "--params", scene, "--output", f"{output}/replayed"],
        "node": ["--ros-args", "--params-file", scene],
    }[name]
    with _repeatable(f"{name}, {kind.name} after {delay:.3f} s"):
        status, said = _ended([name, *words], kind, delay)
        left = {path.name for path in output.iterdir()}
        if status not in ENDINGS or "Traceback" in said or left - {"run.npz", "replayed"}:
            raise Broken(f"ends with {status}, leaves {left}, says {said[-500:]}")
        check_line("" if name == "node" else said.strip())  # the node has a log
        if (output / "run.npz").exists():
            np.load(output / "run.npz").close()
    shutil.rmtree(output)
    return f"{name}: exit status {status}{', output whole' if left else ''}"


def _ended(words: list[str], kind: signal.Signals, delay: float) -> tuple[int, str]:
    """Exit status and stderr of a command that gets a signal. Until it can handle one the signal is
    blocked, as a launcher can have it.
    """
    held = signal.pthread_sigmask(signal.SIG_BLOCK, ASKED_TO_END)
    try:
        command = [sys.executable, "-m", "dlo_sim", *words]
        child = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)
    time.sleep(delay)
    child.send_signal(kind)
    try:
        _, said = child.communicate(timeout=60.0)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        raise Broken("does not end within a minute") from None
    return child.returncode, said


@contextlib.contextmanager
def _repeatable(what: str) -> Iterator[None]:
    """Say what was given when something breaks."""
    try:
        yield
    except Exception as error:
        raise Broken(f"{type(error).__name__}: {error}; given {what}") from error


def check_line(text: str) -> None:
    """A refusal is one line that a terminal can show."""
    if len(text) > 2000 or not text.isprintable():
        raise Broken(f"not one line: {text[:500]!r}")
