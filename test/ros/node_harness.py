"""The node in its own process, and a peer that talks to it from the test's process."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from ruamel.yaml import YAML

START = 600.0  # [s]; a first start compiles, a minute or two of processor time
SOON = 60.0  # [s]; it takes milliseconds where nothing else runs

# A soft cable that steps fast and compiles what most scenes need: clamped at the start, free end,
# a wrench on the tip and a force in the middle.
CABLE: dict[str, Any] = {
    "cable.length": 1,
    "start.clamped": True,
    "start.tangent": [1, 0, 0],
    "damping.stiffness": 0.01,
    "discretization.control_points": 7,
    "loads.names": ["tip", "force"],
    "loads.force.type": "force",
    "loads.force.position": 0.5,
}
# The same cable in the hand of a gripper.
HELD: dict[str, Any] = {
    **{key: value for key, value in CABLE.items() if not key.startswith("loads.")},
    "start.pose_topic": "/gripper_pose",
}
# An explicit method close to its stability limit: a push of 100 N at the tip makes it diverge.
UNSTABLE: dict[str, Any] = {
    **CABLE,
    "damping.stiffness": 0.0,
    "integrator.method": "forest_ruth",
    "integrator.on_failure": "stop",
}


def write_params(folder: Path, values: Mapping[str, Any]) -> Path:
    """A params file with these parameters for any node."""
    path = folder / "params.yaml"
    document = {"/**": {"ros__parameters": dict(values)}}
    with path.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(document, stream)
    return path


class NodeProcess:
    """`dlo_sim node` as a child process.

    Attributes:
        process: the child; its stderr goes to a file, so that it never blocks.
    """

    def __init__(self, domain: int, log: Path, arguments: Sequence[str] = ()) -> None:
        self._log = log
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "dlo_sim", "node", *arguments],
                env=environment,
                stdout=stream,
                stderr=stream,
            )

    @property
    def output(self) -> str:
        """Everything it has said so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    @property
    def waited(self) -> float:
        """Time [s] for which its threads could have run, but other processes had the core."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/schedstat")
        return sum(int(task.read_text().split()[1]) for task in tasks) * 1e-9

    def wait(self, timeout: float = SOON) -> int:
        """Its exit status.

        Raises:
            AssertionError: it does not end in time.
        """
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.end()
            raise AssertionError(f"the node does not end:\n{self.output}") from None

    def stop(self, number: int = signal.SIGINT, timeout: float = SOON) -> int:
        """Send a signal; returns the exit status."""
        self.process.send_signal(number)
        return self.wait(timeout)

    def end(self) -> None:
        """End of the test, whatever happened; a node that can still say goodbye does."""
        self.process.terminate()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Peer:
    """A ROS node in the test's process."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("peer", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.watched: NodeProcess | None = None
        self._diagnostics: list[DiagnosticArray] | None = None

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def until(self, condition: Callable[[], Any], what: str, timeout: float = SOON) -> Any:
        """Spin until the condition holds; returns its value.

        Raises:
            AssertionError: it does not in time, or the watched node has died.
        """
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < deadline, f"no {what} within {timeout} s\n{self._said()}"
            died = self.watched is not None and self.watched.process.poll() is not None
            assert not died, f"the node ended while waiting for {what}\n{self._said()}"
            self._executor.spin_once(timeout_sec=0.05)
        return value

    def _said(self) -> str:
        return self.watched.output if self.watched is not None else ""

    def collect(self, message_type: type, topic: str, depth: int = 100, **options: Any) -> list:
        """Everything that comes on a topic from now on."""
        received: list[Any] = []
        self.node.create_subscription(
            message_type, topic, received.append, QoSProfile(depth=depth), **options
        )
        return received

    def publisher(self, message_type: type, topic: str) -> Any:
        """A publisher that the node listens to already."""
        publisher = self.node.create_publisher(message_type, topic, 10)
        self.until(publisher.get_subscription_count, f"subscriber of {topic}")
        return publisher

    @contextlib.contextmanager
    def repeating(self, publisher: Any, message: Any) -> Iterator[None]:
        """Publish every 50 ms inside: one message alone is lost if the node's side of the
        connection is not complete. The publisher is destroyed afterwards, whatever happened."""
        timer = self.node.create_timer(0.05, lambda: publisher.publish(message))
        try:
            yield
        finally:
            self.node.destroy_timer(timer)
            self.node.destroy_publisher(publisher)

    def call(self, service_type: type, name: str, request: Any, timeout: float = SOON) -> Any:
        """The response of a service."""
        client = self.node.create_client(service_type, name)
        self.until(client.service_is_ready, f"service {name}", timeout)
        future = client.call_async(request)
        self.until(future.done, f"response of {name}", timeout)
        self.node.destroy_client(client)
        return future.result()

    def set(self, values: Mapping[str, Any], node: str = "/dlo_sim") -> SetParametersResult:
        """Set parameters of the node, all together."""
        messages = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        request = SetParametersAtomically.Request(parameters=messages)
        name = f"{node}/set_parameters_atomically"
        return self.call(SetParametersAtomically, name, request, START).result

    def get(self, *names: str, node: str = "/dlo_sim") -> list[Any]:
        """Values of parameters of the node."""
        request = GetParameters.Request(names=names)
        values = self.call(GetParameters, f"{node}/get_parameters", request).values
        return [parameter_value_to_python(value) for value in values]

    def status(
        self, name: str, condition: Callable[[dict[str, str], DiagnosticStatus], Any], what: str
    ) -> dict[str, str]:
        """The values of the diagnostic status of this name, once they fulfil the condition."""
        if self._diagnostics is None:
            self._diagnostics = self.collect(DiagnosticArray, "/diagnostics")
        diagnostics = self._diagnostics

        def found() -> dict[str, str] | None:
            for status in (s for array in diagnostics for s in array.status if s.name == name):
                values = {item.key: item.value for item in status.values}
                if condition(values, status):
                    return values
            return None

        diagnostics.clear()
        return self.until(found, f"{what} in diagnostics")


def push(peer: Peer, force: float, node: str = "/dlo_sim") -> contextlib.AbstractContextManager:
    """A force along y at the tip inside [N], published every 50 ms."""
    message = WrenchStamped()
    message.wrench.force.y = force
    return peer.repeating(peer.publisher(WrenchStamped, f"{node}/tip/wrench"), message)


class Metronomes:
    """A process on each core that only sleeps: its late wakings are the machine's own."""

    def __init__(self, folder: Path) -> None:
        self._logs = [folder / f"metronome_{core}.txt" for core in sorted(os.sched_getaffinity(0))]
        self._processes = []
        for core, log in zip(sorted(os.sched_getaffinity(0)), self._logs, strict=True):
            script = str(Path(__file__).with_name("metronome.py"))
            with log.open("wb") as stream:
                command = [sys.executable, script, str(core)]
                self._processes.append(subprocess.Popen(command, stdout=stream))

    def end(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def stood_still(self, begin_ns: int, end_ns: int) -> bool:
        """Whether a core did at some time in between."""
        lines = [line for log in self._logs for line in log.read_text().splitlines()]
        spans = [tuple(map(int, line.split())) for line in lines]
        return any(begin < end_ns and end > begin_ns for begin, end in spans)
