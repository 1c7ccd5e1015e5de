"""Plans as messages of a planner."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dlo_sim.session import cdr

SECOND = 1_000_000_000
AT_ORIGIN = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def trajectory(
    joints: Sequence[str],
    times_ns: Iterable[int],
    poses: ArrayLike,
    stamp_ns: int = 0,
    frame_id: str = "",
) -> bytes:
    """A serialised plan: poses (K, joints, 7) at these times; nobody reads its velocities."""
    types = cdr.STORE.types
    vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    twist = types["geometry_msgs/msg/Twist"](vector(1.0, 2.0, 3.0), vector(4.0, 5.0, 6.0))
    transform = types["geometry_msgs/msg/Transform"]
    duration, time_of = (types[f"builtin_interfaces/msg/{kind}"] for kind in ("Duration", "Time"))
    points = [
        types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
            [transform(vector(*row[:3]), turn(*row[3:])) for row in rows],
            [twist] * len(rows),
            [],
            duration(*divmod(time_ns, SECOND)),
        )
        for time_ns, rows in zip(times_ns, np.asarray(poses, dtype=float).tolist(), strict=True)
    ]
    header = types["std_msgs/msg/Header"](time_of(*divmod(stamp_ns, SECOND)), frame_id)
    return cdr.write(cdr.TRAJECTORY, types[cdr.TRAJECTORY](header, list(joints), points))


def still_plan(times_ns: Sequence[int], stamp_ns: int = 0, frame_id: str = "") -> bytes:
    """The start stays at the origin until each of these times."""
    poses = np.tile(AT_ORIGIN, (len(times_ns), 1, 1))
    return trajectory(["start"], times_ns, poses, stamp_ns, frame_id)
