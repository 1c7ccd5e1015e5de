"""Plays a bag at real time: `bag_player.py BAG`; a program of its own, run by test_live_replay.py.

Waits until every topic has a listener, says `ready`, reads a line with a shift [ns] from stdin and
publishes each message at its recorded time plus the shift, with its header stamp shifted as well.
"""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rosbags.rosbag2 import Reader
from visualization_msgs.msg import MarkerArray

_STAMP = struct.Struct("<iI")
# Type, where its first stamp is, behind the encapsulation header and the length of a list, and how
# it is published.
_KINDS = {
    "geometry_msgs/msg/PoseStamped": (PoseStamped, 4, qos_profile_sensor_data),
    "geometry_msgs/msg/WrenchStamped": (WrenchStamped, 4, qos_profile_sensor_data),
    "visualization_msgs/msg/MarkerArray": (MarkerArray, 8, QoSProfile(depth=100)),
}


def main() -> None:
    """Play the bag named on the command line."""
    with Reader(Path(sys.argv[1])) as bag:
        types = {c.topic: c.msgtype for c in bag.connections}
        messages = [(c.topic, time_ns, bytearray(raw)) for c, time_ns, raw in bag.messages()]
    rclpy.init()
    node = Node("bag_player")
    publishers = {
        topic: node.create_publisher(_KINDS[kind][0], topic, _KINDS[kind][2])
        for topic, kind in types.items()
    }
    while not all(p.get_subscription_count() for p in publishers.values()):
        rclpy.spin_once(node, timeout_sec=0.05)
    print("ready", flush=True)
    shift = int(sys.stdin.readline())
    for topic, time_ns, raw in messages:
        stamp_at = _KINDS[types[topic]][1]
        seconds, nanoseconds = _STAMP.unpack_from(raw, stamp_at)
        moved = divmod(seconds * 1_000_000_000 + nanoseconds + shift, 1_000_000_000)
        _STAMP.pack_into(raw, stamp_at, *moved)
        wait = (time_ns + shift - time.time_ns()) * 1e-9
        if wait > 0.0:
            time.sleep(wait)
        publishers[topic].publish(bytes(raw))
    print("played", flush=True)
    sys.stdin.readline()  # until it is ended


if __name__ == "__main__":
    main()
