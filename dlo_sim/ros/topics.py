"""The node's publishers and subscriptions, all on serialised messages; their QoS is stated here."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from dlo_sim.ros.status import InputSources
from dlo_sim.scene.description import Scene
from dlo_sim.session.cdr import BOOL, MARKER_ARRAY, encode_marker_delete_all
from dlo_sim.session.outputs import OutgoingMessage
from dlo_sim.session.topics import (
    CENTERLINE,
    CONTROL_POLYGON,
    DIAGNOSTICS,
    FORECAST,
    MARKERS,
    TF,
    InputTopic,
    output_topics,
)

# What users may override. No keep_all for publishers: a slow reader would block the node.
INPUT_POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
OUTPUT_POLICIES = (QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)

_MOST_TAKEN = 1000  # messages of a topic at once
_GOODBYE = Duration(nanoseconds=300_000_000)  # longest wait for viewers to take the last marker


def message_class(kind: str) -> type:
    """The class of a ROS type, for example geometry_msgs/msg/PoseStamped."""
    package, _, name = kind.split("/")
    message: type = getattr(import_module(f"{package}.msg"), name)
    return message


# Each call makes a profile of its own: rclpy writes what the user overrides into it.


def input_qos(kind: str) -> QoSProfile:
    """How an input of a ROS type is subscribed.

    Best effort as sensors publish, so that every publisher matches, but a deeper queue than the
    usual 5: a tick that takes 20 ms must not lose a 500 Hz wrench. A Bool, or the markers of
    obstacles, are published once and must not be lost.
    """
    once = kind in (BOOL, MARKER_ARRAY)
    reliability = ReliabilityPolicy.RELIABLE if once else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=100, reliability=reliability)


def output_qos(topic: str, cables: int = 1) -> QoSProfile:
    """How an output is published: a late reader gets the newest state, a slow one never blocks the
    node. Lines of all cables are on one topic, a message each.
    """
    if topic in (DIAGNOSTICS, FORECAST, TF):
        return QoSProfile(depth=10)
    depth = cables if topic in (CENTERLINE, CONTROL_POLYGON) else 1
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Publishers:
    """Publishers of what a scene puts out."""

    def __init__(self, node: Node, scene: Scene) -> None:
        self._node = node
        self._publishers: dict[str, Publisher] = {}
        self._readers: dict[str, int] = {}
        self.follow(scene)

    def follow(self, scene: Scene) -> None:
        """Have the topics of this scene, a reaction for each end that is held, and no other."""
        self._frame_id = scene.frame_id
        wanted = output_topics(scene)
        for topic in self._publishers.keys() - wanted.keys():
            self._node.destroy_publisher(self._publishers.pop(topic))
            self._readers.pop(topic, None)
        for topic, kind in wanted.items():
            if topic not in self._publishers:
                self._publishers[topic] = self._node.create_publisher(
                    message_class(kind),
                    topic,
                    output_qos(topic, len(scene.strands)),
                    qos_overriding_options=QoSOverridingOptions(OUTPUT_POLICIES),
                )

    @property
    def topics(self) -> list[str]:
        """Names of the topics as they are on the wire, remapped."""
        return [publisher.topic_name for publisher in self._publishers.values()]

    @property
    def _markers(self) -> dict[str, str]:
        """The topics of markers that there are, and their types."""
        return {topic: kind for topic, kind in MARKERS.items() if topic in self._publishers}

    def readers(self) -> tuple[set[str], set[str]]:
        """The topics with subscribers, and those with new subscribers since the last call."""
        read, joined = set(), set()
        for topic, publisher in self._publishers.items():
            before = self._readers.get(topic, 0)
            count = self._readers[topic] = publisher.get_subscription_count()
            if count:
                read.add(topic)
            if count > before:
                joined.add(topic)
        return read, joined

    def publish(self, messages: Iterable[OutgoingMessage]) -> None:
        """Publish messages of the session."""
        for message in messages:
            publisher = self._publishers.get(message.topic)
            if publisher is not None:
                publisher.publish(message.data)

    def publish_diagnostics(self, data: bytes) -> None:
        """Publish a serialised DiagnosticArray."""
        self._publishers[DIAGNOSTICS].publish(data)

    def delete_markers(self, stamp_ns: int) -> None:
        """Remove all markers from every viewer."""
        for topic, kind in self._markers.items():
            data = encode_marker_delete_all(kind, self._frame_id, stamp_ns)
            self._publishers[topic].publish(data)

    def say_goodbye(self, stamp_ns: int) -> None:
        """Remove the markers; gives viewers a moment to hear it before the publishers end."""
        self.delete_markers(stamp_ns)
        for topic in self._markers:
            self._publishers[topic].wait_for_all_acked(_GOODBYE)

    def close(self) -> None:
        """End the publishers."""
        while self._publishers:
            self._node.destroy_publisher(self._publishers.popitem()[1])


class Subscriptions:
    """Subscriptions to what a session listens to."""

    def __init__(
        self, node: Node, inputs: Sequence[InputTopic], receive: Callable[[str, bytes], None]
    ) -> None:
        """Subscribe; `receive(topic, raw)` gets the topic by its name on the wire."""
        self._node = node
        self._types = {source.topic: source.type for source in inputs}
        self._subscriptions: dict[str, Subscription] = {}
        for topic, kind in self._types.items():
            self._subscriptions[topic] = node.create_subscription(
                message_class(kind),
                topic,
                partial(receive, topic),
                input_qos(kind),
                qos_overriding_options=QoSOverridingOptions(INPUT_POLICIES),
                raw=True,
            )

    def take_waiting(self) -> None:
        """Hand over what has come, from inside a callback, when the executor cannot."""
        for subscription in self._subscriptions.values():
            for _ in range(_MOST_TAKEN):  # of what comes faster than it is handled
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                subscription.callback(taken[0])

    def close(self) -> None:
        """End the subscriptions."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.popitem()[1])

    @property
    def topics(self) -> list[str]:
        """Names of the topics as they are on the wire, remapped."""
        return list(self._types)

    def sources(self) -> list[InputSources]:
        """Who publishes on each topic."""
        return [self._sources(topic, kind) for topic, kind in self._types.items()]

    def _sources(self, topic: str, kind: str) -> InputSources:
        sources = InputSources(topic, kind)
        for publisher in self._node.get_publishers_info_by_topic(topic):
            if publisher.topic_type == kind:
                sources.count += 1
            else:
                node = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
                sources.mismatched.append((node, publisher.topic_type))
        return sources
