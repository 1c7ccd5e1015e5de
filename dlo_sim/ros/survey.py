"""Listens to the topics of a scene for a while: publishers, messages, stamps."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.status import InputSources
from dlo_sim.ros.topics import Subscriptions, input_qos
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import TopicRecord
from dlo_sim.session.session import Session

_DISCOVERY = 2.0  # [s] at most until nodes know of each other
_MORE = 0.3  # [s] for the other topics of a node that has been found


@dataclass(frozen=True)
class Heard:
    """The observations on one input topic.

    Attributes:
        sources: its publishers. incompatible: why ROS does not connect a publisher, one line each.
        record: counters of its messages. rate: [Hz]. frames: in their headers.
    """

    sources: InputSources
    incompatible: tuple[str, ...]
    record: TopicRecord
    rate: float
    frames: tuple[str, ...]


@dataclass(frozen=True)
class Survey:
    """The observations on all topics.

    Attributes:
        rmw: the middleware. simulated_time: whether /clock is published.
        offset: clock minus stamps [s]; None without a message. heard: one for each input topic.
    """

    rmw: str
    simulated_time: bool = False
    offset: float | None = None
    heard: tuple[Heard, ...] = ()


@dataclass
class _Listening:
    """Counts messages on their way to the session."""

    session: Session
    now: Callable[[], int]
    arrivals: dict[str, list[float]] = field(default_factory=dict)
    frames: dict[str, set[str]] = field(default_factory=dict)

    def receive(self, topic: str, raw: bytes) -> None:
        self.arrivals.setdefault(topic, []).append(time.monotonic())
        if now := self.now():  # 0 until the first /clock
            self.session.receive(topic, raw, now)
        kind = next(entry.type for entry in self.session.inputs if entry.topic == topic)
        try:
            self.frames.setdefault(topic, set()).add(cdr.decode(kind, raw).frame_id)
        except cdr.DecodeError:
            pass  # the session has counted it

    def rate(self, topic: str) -> float:
        """Of the messages that came [Hz]; 0 unless there are two."""
        times = self.arrivals.get(topic, [0.0])
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0

    def tick(self) -> None:
        if now := self.now():
            self.session.tick(now)


def survey(session: Session | None, seconds: float) -> Survey:
    """Listen as the node of this session would, some seconds; RuntimeError if ROS cannot start."""
    rmw = get_rmw_implementation_identifier()
    if session is None:
        return Survey(rmw)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = GuardedNode("dlo_sim_doctor")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            return _listen(node, executor, session, seconds, rmw)
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _listen(node: Node, executor: Executor, session: Session, seconds: float, rmw: str) -> Survey:
    inputs = {entry.topic for entry in session.inputs}
    _spin(executor, _DISCOVERY, lambda: all(map(node.count_publishers, inputs)))
    _spin(executor, _MORE)
    simulated = node.count_publishers("/clock") > 0
    if simulated:
        node.set_parameters([Parameter("use_sim_time", value=True)])
    listening = _Listening(session, lambda: int(node.get_clock().now().nanoseconds))
    subscriptions = Subscriptions(node, session.inputs, listening.receive)
    node.create_timer(1.0 / session.scene.rate, listening.tick)
    _spin(executor, seconds)
    heard = tuple(
        Heard(
            source,
            tuple(_incompatible(node, source)),
            session.journal.topics[source.topic],
            listening.rate(source.topic),
            tuple(sorted(listening.frames.get(source.topic, ()))),
        )
        for source in subscriptions.sources()
    )
    offset = session.offset_ns * 1e-9 if session.journal.accepted else None
    return Survey(rmw, simulated, offset, heard)


def _spin(executor: Executor, seconds: float, enough: Callable[[], bool] = lambda: False) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0 and not enough():
        executor.spin_once(timeout_sec=min(left, 0.05))


def _incompatible(node: Node, source: InputSources) -> list[str]:
    lines = []
    for info in node.get_publishers_info_by_topic(source.topic):
        verdict, reason = qos_check_compatible(info.qos_profile, input_qos(source.type))
        if verdict == QoSCompatibility.ERROR:
            lines.append(f"{info.node_name} publishes {source.topic} with another QoS: {reason}")
    return lines
