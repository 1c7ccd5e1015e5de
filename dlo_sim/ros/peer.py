"""A node's peer in a process of its own, for studies: plays messages at their times, disturbs, and
notes when each output came.

`python -m dlo_sim.ros.peer FILE` reads a `Task` as JSON, says when the messages begin [ns], and at
the end, or that of stdin, writes what it noted to `Task.output`, pickled: arrays by topic, shape
(n, 2): arrival and header stamp [ns]; `begin` of the messages [ns]; `log`: what /diagnostics says,
as JSON; `sent`, `kept`: the last messages played and read; `changed`: how many changes of
parameters were taken and refused.
"""

import json
import pickle
import sys
import threading
import time
from array import array
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from std_srvs.srv import Trigger

from dlo_sim.ros.main import new_executor
from dlo_sim.ros.topics import message_class
from dlo_sim.session.time_base import SECOND

_MOST_KEPT = 2000
_LONGEST_WAIT = 300.0  # [s] for the node
_STAMP = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])  # of the header, after 4 bytes


@dataclass
class Task:
    """What a peer is to do.

    Times [s] count from when the messages begin.

    Attributes:
        seconds: how long.
        output: file to write.
        lap: [s]; the messages are played over and over.
        messages: topic, type, time in the lap [s], serialised message (hexadecimal).
        reads: topic -> type of what is read. kept: of these, one whose messages are kept whole.
        changes: values of parameters, set one after the other once a second.
        silences: (begin, end, topic): the publisher of a topic is gone, or all are for "".
        jumps: (begin, end, s): so much is added to the stamps.
        resets: when ~/reset is called.
    """

    seconds: float
    output: str
    lap: float = 1.0
    messages: list[tuple[str, str, float, str]] = field(default_factory=list)
    reads: dict[str, str] = field(default_factory=dict)
    kept: str = ""
    changes: list[dict[str, Any]] = field(default_factory=list)
    silences: list[tuple[float, float, str]] = field(default_factory=list)
    jumps: list[tuple[float, float, float]] = field(default_factory=list)
    resets: list[float] = field(default_factory=list)


class Peer(Node):
    """See the module."""

    def __init__(self, task: Task) -> None:
        super().__init__("peer")
        self._task = task
        self.noted = {topic: array("q") for topic in task.reads}
        self.kept: deque[bytes] = deque(maxlen=_MOST_KEPT)
        # number of the message, stamp, time
        self.sent: deque[tuple[int, int, int]] = deque(maxlen=10 * _MOST_KEPT)
        self._turn = threading.Lock()  # of publishing and taking publishers away
        self.log: list[str] = []
        self.changed = [0, 0]  # taken, refused
        self._types = {topic: kind for topic, kind, _, _ in task.messages}
        self._made: dict[str, Publisher] = {}
        self._open()
        for topic, kind in task.reads.items():
            self._read(topic, message_class(kind))
        self.create_subscription(DiagnosticArray, "/diagnostics", self._note_diagnostics, 10)
        self._parameters = self.create_client(
            SetParametersAtomically, "/dlo_sim/set_parameters_atomically"
        )
        self._reset = self.create_client(Trigger, "/dlo_sim/reset")

    def _open(self) -> None:
        for topic, kind in self._types.items():
            if topic not in self._made:
                found = self.create_publisher(message_class(kind), topic, qos_profile_sensor_data)
                self._made[topic] = found

    def _read(self, topic: str, kind: type) -> None:
        noted, keep = self.noted[topic], topic == self._task.kept

        def note(raw: bytes) -> None:
            sec, nanosec = np.frombuffer(raw, _STAMP, 1, 4)[0].tolist()
            noted.extend((time.time_ns(), sec * SECOND + nanosec))
            if keep:
                self.kept.append(bytes(raw))

        self.create_subscription(kind, topic, note, QoSProfile(depth=1000), raw=True)

    def _note_diagnostics(self, array: DiagnosticArray) -> None:
        values = {s.name: {v.key: v.value for v in s.values} for s in array.status}
        self.log.append(json.dumps({"time": time.time_ns(), **values}))

    @property
    def ready(self) -> bool:
        """Whether the node is there and listens."""
        heard = all(publisher.get_subscription_count() for publisher in self._made.values())
        return heard and self._parameters.service_is_ready()

    def play(self, begin_ns: int) -> None:
        """Play until the end; in a thread of its own."""
        task, number = self._task, 0
        due = [round((at - task.lap) * SECOND) for _, _, at, _ in task.messages]
        raw = [bytearray.fromhex(data) for _, _, _, data in task.messages]
        seconds = 0.0
        while task.messages and seconds < task.seconds:
            index = number % len(raw)
            lap_ns = (1 + number // len(raw)) * round(task.lap * SECOND)
            stamp_ns = begin_ns + lap_ns + due[index]
            seconds = (stamp_ns - begin_ns) * 1e-9
            time.sleep(max(0.0, (stamp_ns - time.time_ns()) * 1e-9))
            shift = sum(round(by * SECOND) for a, b, by in task.jumps if a <= seconds < b)
            raw[index][4:12] = np.array(divmod(stamp_ns + shift, SECOND), "<u4").tobytes()
            with self._turn:
                publisher = self._made.get(task.messages[index][0])
                if publisher is not None:
                    publisher.publish(bytes(raw[index]))
                    self.sent.append((index, stamp_ns + shift, time.time_ns()))
            number += 1

    def disturb(self, seconds: float) -> None:
        """Once a second: set a parameter, reset, take publishers away or make them again."""
        task = self._task
        for begin, end, topic in task.silences:
            gone = [name for name in self._made if topic in ("", name)]
            if begin <= seconds < end:
                with self._turn:
                    for name in gone:
                        self.destroy_publisher(self._made.pop(name))
            elif end <= seconds < end + 1.5:
                self._open()
        if task.resets and task.resets[0] <= seconds:
            task.resets.pop(0)
            self._reset.call_async(Trigger.Request())
        elif int(seconds) < len(task.changes):
            values = task.changes[int(seconds)]
            parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
            request = SetParametersAtomically.Request(parameters=parameters)
            self._parameters.call_async(request).add_done_callback(self._note_change)

    def _note_change(self, future: Any) -> None:
        self.changed[not future.result().result.successful] += 1


def run(task: Task) -> None:
    """Do the task.

    Raises:
        TimeoutError: no node listens.
    """
    peer, executor = Peer(task), new_executor()
    executor.add_node(peer)
    deadline = time.monotonic() + _LONGEST_WAIT
    while not peer.ready:
        if time.monotonic() > deadline:
            raise TimeoutError("no node listens")
        executor.spin_once(timeout_sec=0.05)
    begin_ns = (time.time_ns() // SECOND + 2) * SECOND
    print(begin_ns, flush=True)
    player = threading.Thread(target=peer.play, args=(begin_ns,), daemon=True)
    player.start()
    last, seconds, enough = 0, 0.0, threading.Event()

    def listen() -> None:
        sys.stdin.read()
        enough.set()

    threading.Thread(target=listen, daemon=True).start()
    while seconds < task.seconds + 0.5 and not enough.is_set():
        executor.spin_once(timeout_sec=0.05)
        seconds = (time.time_ns() - begin_ns) * 1e-9
        if seconds >= last + 1:
            last = int(seconds)
            peer.disturb(seconds)
    player.join()
    found: dict[str, Any] = {
        "begin": begin_ns,
        "log": peer.log,
        "sent": peer.sent,
        "changed": peer.changed,
    }
    found |= {topic: np.reshape(noted, (-1, 2)) for topic, noted in peer.noted.items()}
    found["kept"] = list(peer.kept)
    with Path(task.output).open("wb") as stream:
        pickle.dump(found, stream)
    executor.shutdown()
    peer.destroy_node()


def main() -> int:
    """Read the task and do it; returns the exit status."""
    rclpy.init()
    try:
        run(Task(**json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))))
    except TimeoutError as error:
        print(error, file=sys.stderr)
        return 3
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
