"""Plans for the forecast of a node or session."""

from __future__ import annotations

from collections.abc import Iterable

from dlo_sim.session import cdr

SECOND = 1_000_000_000


def still_plan(times_ns: Iterable[int], stamp_ns: int = 0, frame_id: str = "") -> bytes:
    """A serialised plan by which the start stays at the origin until each of these times."""
    types = cdr.STORE.types
    still = types["geometry_msgs/msg/Transform"](
        cdr.new("geometry_msgs/msg/Vector3"),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
    )
    points = [
        cdr.new(
            "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint",
            transforms=[still],
            time_from_start=types["builtin_interfaces/msg/Duration"](0, time_ns),
        )
        for time_ns in times_ns
    ]
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, SECOND))
    header = types["std_msgs/msg/Header"](stamp, frame_id)
    return cdr.write(cdr.TRAJECTORY, types[cdr.TRAJECTORY](header, ["start"], points))
