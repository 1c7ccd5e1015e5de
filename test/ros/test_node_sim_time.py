"""Simulated time: the first /clock, a clock that stands still, one that is set back."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
from node_harness import CABLE, HELD, NodeProcess, Peer
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker


class PlayedClock:
    """A /clock that goes only when a test makes it."""

    def __init__(self, peer: Peer, seconds: int) -> None:
        self._peer = peer
        self.now_ns = seconds * 1_000_000_000
        self._publisher = peer.publisher(Clock, "/clock")

    def tick(self, step_ms: int = 10) -> None:
        self.now_ns += step_ms * 1_000_000
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self.now_ns, 1_000_000_000)
        self.publish(message)

    def publish(self, message: Clock) -> None:
        self._publisher.publish(message)

    def run_until(self, condition: Callable[[], object], what: str, step_ms: int = 10) -> None:
        """Let the time run, one step for every look at the condition."""

        def ticked() -> object:
            self.tick(step_ms)
            return condition()

        self._peer.until(ticked, what)

    def close(self) -> None:
        self._peer.node.destroy_publisher(self._publisher)


def stamp(message: PoseArray | DiagnosticArray) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_time_begins_stands_still_goes_on_jumps_back_and_ends(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = started({**CABLE, "use_sim_time": True})
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    markers = peer.collect(Marker, "/dlo_sim/centerline")
    name = "/dlo_sim: node"
    peer.status(
        name,
        lambda v, s: s.level == DiagnosticStatus.WARN and "no /clock" in s.message,
        "a warning that there is no clock",
    )
    assert not received

    clock = PlayedClock(peer, 1000)
    clock.run_until(lambda: len(received) > 20, "control points")
    # The first /clock is a jump of 1000 s that nobody simulates.
    assert stamp(received[0]) > 999 * 10**9
    clock.run_until(lambda: clock.now_ns - stamp(received[-1]) < 10**9, "the present")
    values = peer.status("/dlo_sim: session", lambda v, s: True, "the session")
    assert float(values["simulated time [s]"]) < 10.0
    assert float(values["skipped [s]"]) == 0.0

    values = peer.status(
        name,
        lambda v, s: s.level == DiagnosticStatus.WARN and "stood still" in s.message,
        "a warning that the clock stands still",
    )
    assert values["clock jumps"] == "0"
    assert peer.call(Trigger, "/dlo_sim/reset", Trigger.Request()).success
    received.clear()
    clock.run_until(lambda: len(received) > 20, "control points again")

    before = stamp(received[-1])
    clock.now_ns -= 100 * 10**9
    clock.run_until(lambda: stamp(received[-1]) < before - 50 * 10**9, "control points of before")
    assert received[-1].poses[-1].position.z == pytest.approx(0.0, abs=0.05)  # straight again
    peer.status(name, lambda v, s: v["clock jumps"] == "1", "one jump")
    values = peer.status("/dlo_sim: session", lambda v, s: True, "the session")
    assert (values["event time_jump"], values["event reset"]) == ("1", "1"), "counted as it was"
    clock.close()
    peer.watched = None
    assert node.stop() == 0, "while the clock stands still"
    peer.until(lambda: markers[-1].action == Marker.DELETEALL, "the end of the markers")
    assert "Traceback" not in node.output


def test_a_small_jump_back_is_waited_for_and_what_is_no_time_ignored_both_counted(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    """A /clock of two publishers, or of a simulator that corrects itself, or that is broken."""
    # Damped, so that it does not swing up again.
    node = started({**CABLE, "damping.mass": 5.0, "use_sim_time": True})
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    markers = peer.collect(Marker, "/dlo_sim/centerline")
    clock = PlayedClock(peer, 50)
    clock.run_until(
        lambda: received and received[-1].poses[-1].position.z < -0.1, "a cable that sags"
    )
    for jumps, back_ms in enumerate((50, 900), start=1):
        clock.run_until(lambda: clock.now_ns - stamp(received[-1]) < 100_000_000, "the present")
        received[:] = received[-1:]
        clock.tick(-back_ms)
        # Times that follow would replace this one before a node that is held up has seen it.
        peer.status("/dlo_sim: node", lambda v, s, n=jumps: v["clock jumps"] == str(n), "a count")
        clock.run_until(lambda: len(received) > 20, "control points of later")
        assert [stamp(m) for m in received] == sorted({stamp(m) for m in received})
        assert all(message.poses[-1].position.z < -0.05 for message in received)
    message = Clock()
    for count, (sec, nanosec) in enumerate([(-1, 0), (2**31 - 1, 2**32 - 1)], start=1):
        message.clock.sec, message.clock.nanosec = sec, nanosec
        clock.publish(message)
        values = peer.status(
            "/dlo_sim: node", lambda v, s, n=count: v["clock refused"] == str(n), "a count"
        )
        assert values["clock jumps"] == "2"
        received.clear()
        clock.run_until(lambda: len(received) > 5, "control points again")
    values = peer.status("/dlo_sim: session", lambda v, s: True, "the session")
    assert "event reset" not in values and "event time_jump" not in values
    assert markers and all(marker.action == Marker.ADD for marker in markers), "no view is cleared"
    assert "Traceback" not in node.output
    clock.close()


def test_a_pose_that_comes_before_the_clock_is_not_lost(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    started({**HELD, "use_sim_time": True, "end.position": [1.0, 2.0, 3.0]})
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    poses = peer.publisher(PoseStamped, "/gripper_pose")
    name = "/dlo_sim: node"
    peer.status(name, lambda v, s: v["publishers on /gripper_pose"] == "1", "the publisher")
    pose = PoseStamped()
    pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = 1.0, 2.0, 3.0
    pose.pose.orientation.w = 1.0
    poses.publish(pose)
    # Whatever follows on the same connection comes after it, also the end of this waiting.
    peer.status(name, lambda v, s: True, "a report")
    clock = PlayedClock(peer, 1000)
    clock.run_until(lambda: received, "control points")
    first = received[-1].poses[0].position
    assert (first.x, first.y, first.z) == (1.0, 2.0, 3.0)
    clock.close()
    peer.node.destroy_publisher(poses)
