"""The node in a process of its own, with peer processes that publish to it and record its outputs,
and measurements of its processor time, memory, files and threads.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import pickle
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import output_topics, resolved
from dlo_sim.studies.endurance.soak import LAP, gripper
from dlo_sim.studies.runs import shipped
from dlo_sim.tuning.scene_file import scene_text

CONTROL_POINTS = "/dlo_sim/control_points"
WRENCH = "/dlo_sim/hand/wrench"
ENVIRONMENT = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # a stopped process would keep shared memory locked
}
LATE = 2.5  # periods between two outputs


@dataclass(frozen=True)
class Case:
    """A run of the node with its inputs and disturbances. Times [s] count from the first message.

    Attributes:
        rate: of ticks [Hz]. n: control points. poses, wrenches: rates of the messages [Hz].
        seconds: duration. values: further parameters. task: further tasks of the publishing peer.
        stops: (begin, end, period, share): within each period the process is stopped for this share
            of it; a period of 0 is one stop.
        slow_reader: whether another process subscribes to all topics without reading.
    """

    rate: float
    n: int
    seconds: float
    poses: float = 100.0
    wrenches: float = 200.0
    values: Mapping[str, object] = field(default_factory=dict)
    task: Mapping[str, object] = field(default_factory=dict)
    stops: Sequence[tuple[float, float, float, float]] = ()
    slow_reader: bool = False

    @property
    def scene(self) -> Scene:
        """A cable between two moving grippers, with a force at its middle."""
        values: dict[str, object] = {
            "discretization.control_points": self.n,
            "rate": self.rate,
            "integrator.step": 1.0 / self.rate,
            "loads.names": ["hand"],
            "loads.hand.position": 0.5,
        }
        return shipped("two_grippers").with_values({**values, **self.values})

    @property
    def messages(self) -> list[tuple[str, str, float, bytes]]:
        """Topic, type, time [s] and data of the messages of one lap, in order."""
        pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
        wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
        found = []
        for k in range(round(LAP * self.poses)):
            t = k / self.poses
            for end in ("start", "end"):
                data = pose.encode(0, gripper(end, t))
                found.append((f"/dlo_sim/{end}/pose", cdr.POSE_STAMPED, t, data))
        for k in range(round(LAP * self.wrenches)):
            t = k / self.wrenches
            force = 0.02 * np.sin(2.0 * np.pi * t)
            data = wrench.encode(0, (0.0, force, 0.0, 0.0, 0.0, 0.0))
            found.append((WRENCH, cdr.WRENCH_STAMPED, t, data))
        return sorted(found, key=lambda one: one[2])


@dataclass(frozen=True)
class Played:
    """Records of a case.

    Attributes:
        source, reader: records of the peers (`ros.peer`).
        system: time [s], processor time [s], resident memory [B], open files, threads of the node.
        status: exit status of the node.
    """

    case: Case
    source: Mapping[str, Any]
    reader: Mapping[str, Any]
    system: NDArray[np.float64]
    status: int

    @property
    def share(self) -> float:
        """Processor time of the node as a share of a core."""
        spent = self.system[-1] - self.system[0]
        return float(spent[1] / spent[0])

    @property
    def age(self) -> tuple[float, float]:
        """Median and 99th percentile of arrival minus stamp of the control points [s], without the
        first second.
        """
        noted = self.reader[CONTROL_POINTS][round(self.case.rate) :]
        median, most = np.percentile((noted[:, 0] - noted[:, 1]) * 1e-9, [50.0, 99.0]).tolist()
        return median, most

    @property
    def gaps(self) -> NDArray[np.float64]:
        """Times between two arrivals of control points [s], without the first second."""
        return np.asarray(np.diff(self.reader[CONTROL_POINTS][round(self.case.rate) :, 0]) * 1e-9)

    @property
    def late(self) -> int:
        """Number of gaps of more than LATE periods."""
        return int(np.sum(self.gaps > LATE / self.case.rate))

    def said(self, status: str, key: str) -> list[tuple[float, str]]:
        """(time [s], value) of a key in /diagnostics."""
        lines = [json.loads(line) for line in self.source["log"]]
        name, begin = f"/dlo_sim: {status}", self.source["begin"]
        return [
            ((line["time"] - begin) * 1e-9, line[name][key])
            for line in lines
            if key in line.get(name, {})
        ]

    def count(self, status: str, key: str) -> int:
        """The last value of a counter in /diagnostics."""
        found = self.said(status, key)
        return int(found[-1][1]) if found else 0


def play(case: Case, folder: Path, domain: int, progress: Callable[[float], None]) -> Played:
    """Start node and peers, and wait for their end.

    Raises:
        RuntimeError: the node or a peer ended unexpectedly; with its output.
    """
    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(scene_text(case.scene, []), encoding="utf-8")
    topics = [t for t in output_topics(case.scene) if t not in ("/diagnostics", "/tf")]
    reads = {resolved(t): output_topics(case.scene)[t] for t in topics}
    messages = [(*head, data.hex()) for *head, data in case.messages]
    tasks: dict[str, dict[str, object]] = {
        "source": {"seconds": case.seconds, "messages": messages, "lap": LAP, **case.task},
        "reader": {"reads": reads, "kept": CONTROL_POINTS},
        **({"slow": {"reads": reads}} if case.slow_reader else {}),
    }
    log, peers = folder / "log.txt", {}
    with _starting(os.environ | ENVIRONMENT | {"ROS_DOMAIN_ID": str(domain)}, log) as start:
        node = start("dlo_sim", "node", "--ros-args", "--params-file", str(folder / "scene.yaml"))
        for name, task in tasks.items():
            told = {"seconds": 1e9, **task, "output": str(folder / name)}
            (folder / f"{name}.json").write_text(json.dumps(told), encoding="utf-8")
            peers[name] = start("dlo_sim.ros.peer", str(folder / f"{name}.json"))
        begin = int(_first_line(peers["source"], log)) * 1e-9
        if case.slow_reader:
            _first_line(peers["slow"], log)
            peers["slow"].send_signal(signal.SIGSTOP)
        system = _watch(case, node, begin, progress)
        ended = [peers["source"].wait(120.0)]
        _close(peers["reader"])
        ended.append(peers["reader"].wait(120.0))
        if any(ended) or node.poll() is not None:
            raise RuntimeError(f"a peer or the node ended: {log.read_text(errors='replace')}")
        node.send_signal(signal.SIGINT)
        status = node.wait(60.0)
    noted = {name: pickle.loads((folder / name).read_bytes()) for name in ("source", "reader")}
    return Played(case, **noted, system=system, status=status)


@contextlib.contextmanager
def _starting(
    environment: Mapping[str, str], log: Path
) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Function that starts modules as processes with stderr in a file; killed after the block."""
    with contextlib.ExitStack() as started:
        errors = started.enter_context(log.open("wb"))

        def start(*words: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", *words]
            pipe = subprocess.PIPE
            child = subprocess.Popen(
                command, env=environment, stdin=pipe, stdout=pipe, stderr=errors
            )
            started.callback(child.wait)
            started.callback(child.kill)
            return child

        yield start


def _close(peer: subprocess.Popen[bytes]) -> None:
    assert peer.stdin is not None
    peer.stdin.close()


def _first_line(peer: subprocess.Popen[bytes], log: Path) -> str:
    assert peer.stdout is not None
    line = peer.stdout.readline().decode()
    if not line:
        raise RuntimeError(f"no node: {log.read_text(errors='replace')[-2000:]}")
    return line


def _watch(
    case: Case,
    node: subprocess.Popen[bytes],
    begin: float,
    progress: Callable[[float], None],
) -> NDArray[np.float64]:
    """Stop and continue the node as the case says; measure it once a second."""
    looks: list[tuple[float, ...]] = []
    stops = sorted(itertools.chain.from_iterable(_pieces(*stop) for stop in case.stops))
    while (now := time.time() - begin) < case.seconds:
        if stops and now >= stops[0][0]:
            _, length = stops.pop(0)
            node.send_signal(signal.SIGSTOP)
            time.sleep(length)
            node.send_signal(signal.SIGCONT)
        if now > len(looks) + 1.0:
            looks.append(_look(node.pid, now))
            progress(now / case.seconds)
        until = min(stops[0][0] if stops else case.seconds, len(looks) + 1.0)
        time.sleep(min(max(until - (time.time() - begin), 0.0), 0.2))
    return np.array(looks)


def _pieces(begin: float, end: float, period: float, share: float) -> list[tuple[float, float]]:
    if not period:
        return [(begin, end - begin)]
    return [(begin + k * period, share * period) for k in range(int((end - begin) / period))]


def _look(pid: int, now: float) -> tuple[float, ...]:
    place = Path(f"/proc/{pid}")
    fields = (place / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
    spent = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    resident = int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    return now, spent, resident, len(os.listdir(place / "fd")), len(os.listdir(place / "task"))


def same_offline(played: Played) -> tuple[int, int]:
    """Compare the states after the last silence, which contains a ~/reset, with a session offline
    that gets the same messages. Returns how many are bitwise equal, and how many were compared.
    """
    made, sent = played.case.messages, list(played.source["sent"])
    times = np.array([time_ns for _, _, time_ns in sent])
    last = int(np.flatnonzero(np.diff(times) > SECOND)[-1]) + 1
    session, found = Session(played.case.scene), dict[int, bytes]()
    now, period = sent[last][2], round(SECOND / played.case.rate)
    for index, stamp_ns, time_ns in sent[last:]:
        while now < time_ns:
            now += period
            session.tick(now)
            found |= {m.stamp_ns: m.data for m in session.messages(["~/control_points"])}
        topic, _, _, raw = made[index]
        stamp = struct.pack("<iI", *divmod(stamp_ns, SECOND))
        session.receive(topic, raw[:4] + stamp + raw[12:], time_ns)
    live = {_stamp(raw): raw for raw in played.reader["kept"]}
    common = live.keys() & found.keys()
    return sum(live[stamp] == found[stamp] for stamp in common), len(common)


def _stamp(raw: bytes) -> int:
    seconds, nanoseconds = struct.unpack_from("<iI", raw, 4)
    return int(seconds) * SECOND + int(nanoseconds)
