"""A ROS domain of its own for every test module, the node in a process, a peer to talk to it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from itertools import count
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from node_harness import NodeProcess, Peer


# This host only, and no shared memory: a killed node would leave its segments behind.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"

NO_ROS = "needs rclpy: pip install 'dlo_sim[ros]', or source a ROS 2 Jazzy installation"
_DOMAINS = 100  # 1 to 100 are free of the ports that the system gives away
_modules = count()


@pytest.fixture(scope="module")
def domain() -> int:
    """A ROS domain for this module: another one in every process of this test run (pytest-xdist),
    and very likely in test runs beside it.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    run = os.getppid() if workers > 1 else os.getpid()
    own = worker + workers * next(_modules)
    return 1 + (7 * run + own) % _DOMAINS


@pytest.fixture(scope="module")
def peer(domain: int) -> Iterator[Peer]:
    pytest.importorskip("rclpy", reason=NO_ROS)
    from node_harness import Peer

    peer = Peer(domain)
    yield peer
    peer.close()


@pytest.fixture(scope="module")
def launch(
    domain: int, peer: Peer, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., NodeProcess]]:
    """`launch(values, *arguments)`: a node with these parameters; ended after the module, and
    before the peer, or it waits two seconds for a peer that is gone to hear its last words.
    """
    from node_harness import NodeProcess, write_params

    processes: list[NodeProcess] = []

    def start(values: dict[str, Any] | None, *arguments: str) -> NodeProcess:
        folder = tmp_path_factory.mktemp("node")
        params = [] if values is None else ["--params-file", str(write_params(folder, values))]
        command = ["--ros-args", *params] if params else []
        process = NodeProcess(domain, folder / "log.txt", [*command, *arguments])
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.end()


@pytest.fixture(scope="module")
def running(launch: Callable[..., NodeProcess], peer: Peer) -> Callable[..., NodeProcess]:
    """`running(values, *arguments, name=...)`: the same, up and running; it is watched."""
    from node_harness import START

    def start(
        values: dict[str, Any] | None, *arguments: str, name: str = "/dlo_sim"
    ) -> NodeProcess:
        peer.watched = node = launch(values, *arguments)
        peer.until(lambda: peer.node.count_services(f"{name}/reset"), "node", START)
        return node

    return start


@pytest.fixture
def started(
    running: Callable[..., NodeProcess], peer: Peer
) -> Iterator[Callable[..., NodeProcess]]:
    """`started(values, *arguments)`: the same; ended after the test."""
    processes: list[NodeProcess] = []

    def start(values: dict[str, Any] | None, *arguments: str) -> NodeProcess:
        processes.append(running(values, *arguments))
        return processes[-1]

    yield start
    peer.watched = None
    for process in processes:
        process.end()
    if processes:
        peer.until(lambda: not peer.node.count_services("/dlo_sim/reset"), "end of the node", 60.0)


@pytest.fixture
def refusal(
    domain: int,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Callable[..., str]:
    """`refusal(values, *arguments)`: the line that ends a node with these, run in this process."""
    pytest.importorskip("rclpy", reason=NO_ROS)
    from node_harness import write_params

    from dlo_sim.process import stopping
    from dlo_sim.ros import REFUSED
    from dlo_sim.ros.main import main

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setattr(stopping, "disable_forced_exit", lambda: None)
    # One that is not refused ends at its first look for a signal.
    monkeypatch.setattr(stopping, "requested", lambda: signal.SIGINT)

    def run(values: dict[str, Any] | None, *arguments: str) -> str:
        if values is not None:
            params = write_params(tmp_path_factory.mktemp("refused"), values)
            arguments = ("--ros-args", "--params-file", str(params), *arguments)
        status = main(arguments)
        said = capfd.readouterr().err
        assert status == REFUSED, said
        assert "Traceback" not in said
        (line,) = [line for line in said.splitlines() if line.startswith("dlo_sim: error:")]
        assert said.endswith(f"{line}\n")
        return line

    return run
