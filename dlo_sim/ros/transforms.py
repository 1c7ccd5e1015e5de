"""tf2, which few scenes need and not every installation has: the only file that imports it."""

import math
from contextlib import ExitStack
from typing import Any

from rclpy.node import Node
from rclpy.time import Time

from dlo_sim.core.one_rotation import normalized
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError, one_line
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.intake import Transform, Transforms


def tf2_for(scene: Scene) -> Any:
    """The package tf2_ros if a scene needs it, else None; SceneError if it cannot be imported."""
    if not scene.tf_keys:
        return None
    try:
        import tf2_ros
    except ImportError as error:
        keys = ", ".join(scene.tf_keys)
        raise SceneError(
            f"{keys}: needs tf2, which cannot be imported ({one_line(error)}); install it with: "
            "apt install ros-jazzy-tf2-ros-py, or remove what asks for it"
        ) from None
    return tf2_ros


def transforms_of(node: Node, scene: Scene, opened: ExitStack) -> Transforms | None:
    """The transforms of tf2, if a scene uses any, received until `opened` is closed.

    Raises SceneError as `tf2_for`.
    """
    tf2_ros = tf2_for(scene)
    if not (scene.inputs.tf or scene.followed_frames):
        return None
    listener = _Listener(tf2_ros, node, scene.frame_id)
    opened.callback(listener.close)
    return listener


class _Listener:
    """What tf2 has heard on /tf and /tf_static, in the callbacks of the node."""

    def __init__(self, tf2_ros: Any, node: Node, world: str) -> None:
        self._world = world
        self._problem = tf2_ros.TransformException
        # Without the node's clock, whose jumps it is told of.
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)

    def lookup(self, frame: str, stamp_ns: int | None) -> Transform:
        """As `Transforms.lookup`; at a given time tf2 interpolates and never extrapolates."""
        # tf2 takes time 0 for the newest transform.
        at = Time() if stamp_ns is None else Time(nanoseconds=max(stamp_ns, 1))
        try:
            stamped = self._buffer.lookup_transform(self._world, frame, at)
        except self._problem as problem:
            reason = one_line(problem).rstrip(".")
            cure = f"publish where it is in {self._world}, or raise inputs.latency"
            raise Refused("no_transform", f"frame_id '{frame}': {reason}; {cure}") from None
        p, q = stamped.transform.translation, stamped.transform.rotation
        values = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        if not math.isfinite(sum(values)):
            raise Refused("no_transform", f"frame_id '{frame}': its transform is not finite")
        stamp = stamped.header.stamp
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        return Transform(stamp_ns, values[:3], normalized(values[3:]))

    def close(self) -> None:
        """Hear no more."""
        self._listener.unregister()

    def clear(self) -> None:
        """As `Transforms.clear`; what stands still stays known."""
        self._buffer.clear()
