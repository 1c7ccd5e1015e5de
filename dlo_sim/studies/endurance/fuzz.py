"""Random invalid input: parameters, damaged bags, signals; messages are in `bad_messages`. Nothing
may raise, and every refusal must be one line.

Each function returns the number of cases by outcome, and raises `Broken` at the first violation,
with the input that reproduces it.
"""

from __future__ import annotations

import contextlib
import random
import shutil
import signal
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
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.time_base import SECOND
from dlo_sim.tuning.scene_file import scene_text

Progress = Callable[[float], None]
T0 = 1000 * SECOND
TICK = 5_000_000
SMALL: dict[str, object] = {
    "cable.length": 0.4,
    "cable.diameter": 0.01,
    "damping.stiffness": 0.05,
    "discretization.control_points": 6,
    "start.clamped": True,
    "start.pose_topic": "/pose",
    "rate": 20.0,  # low, because bit errors in stamps cause gaps of minutes
}
REALS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e300, 1e7, 1e-320, -0.0, 1.0)
ENDINGS = {0, 129, 130, 143}
COMMANDS = ("simulate", "replay", "node")
ASKED_TO_END = (signal.SIGINT, signal.SIGTERM)


class Broken(Exception):
    """A violated rule, with the input that reproduces it."""


def parameters(count: int, seed: int, progress: Progress = lambda share: None) -> Counter[str]:
    """Set random parameter values, some invalid, on a running session, which is replaced after a
    failed run and now and then.
    """
    rng, made = random.Random(seed), Counter[str]()
    first = scene_from_values({**SMALL, "start.pose_topic": ""})
    session, now = Session(first), T0
    for number in range(count):
        chosen = rng.sample(PARAMETERS, rng.choice((1, 1, 2, 4)))
        values = {row.key: _value(rng, row) for row in chosen}
        with repeatable(str(values)[:2000]):
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
    """A value for a parameter: valid, at a limit, out of range, or of another type."""
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
    """Replay damaged bags."""
    from dlo_sim.replay.bags import BagError  # here and below: rosbags may not be installed
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
        with repeatable(f"bag {number} of seed {seed}"):
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
    """Write a bag with poses of a gripper at 30 Hz for 1.5 s."""
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
    """Damage one of the two files of a bag."""
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
    """Send one signal to each of `count` commands at a random time, four commands in parallel."""
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
    """Run a command that gets a signal after a delay, check what it leaves; returns the outcome."""
    folder, number, name, kind, delay = case
    output, scene = folder / f"out_{number}", str(folder / "scene.yaml")
    output.mkdir()
    words = {
        "simulate": [scene, "--duration", "1e5", "--every", "100", "--output", f"{output}/run.npz"],
        "replay": [f"{folder}/bag", "--params", scene, "--output", f"{output}/replayed"],
        "node": ["--ros-args", "--params-file", scene],
    }[name]
    with repeatable(f"{name}, {kind.name} after {delay:.3f} s"):
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
    """Exit status and stderr of a command that gets a signal; it starts with signals blocked, as a
    launcher may start it.
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
def repeatable(what: str) -> Iterator[None]:
    """Turn any exception in the block into `Broken` with the input `what`."""
    try:
        yield
    except Exception as error:
        raise Broken(f"{type(error).__name__}: {error}; given {what}") from error


def check_line(text: str) -> None:
    """Check that a refusal is one printable line."""
    if len(text) > 2000 or not text.isprintable():
        raise Broken(f"not one line: {text[:500]!r}")
