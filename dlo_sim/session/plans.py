"""Converts messages with planned motions of end effectors to plans for the simulator, or refuses
them.

A plan has to begin near the newest pose of its end effector. The forecast begins at the present
state, which is older by the latency, and moves from there to the plan.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session import cdr
from dlo_sim.session.content import MOST_DISTANT, NORM_TOLERANCE, Refused, check_pose
from dlo_sim.session.diagnostics import TopicRecord
from dlo_sim.session.session import Session

if TYPE_CHECKING:
    from dlo_sim.simulation.forecast import Plan
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
JUMP = 0.02, 0.2  # [m], [rad]: largest distance of a plan's first pose from the newest pose
LONGEST = 60.0  # [s]: longest plan, counted from the present state
MOST_POINTS = 20_000  # of a plan: 60 s at 333 Hz
_MOST_JOINTS = 1000
_TRANSFORM, _TWIST = 7, 6  # numbers of doubles


class Trajectory(NamedTuple):
    """A decoded trajectory.

    Attributes:
        joints: names of the J joints.
        times: of the points, counted from the stamp [s], shape (T,).
        poses: position [m] and quaternion x, y, z, w, shape (T, J, 7).
    """

    stamp_ns: int
    frame_id: str
    joints: tuple[str, ...]
    times: Array
    poses: Array


def decode_trajectory(raw: cdr.Bytes, known: Collection[str] | None = None) -> Trajectory:
    """Names, times and transforms of a message; velocities and accelerations are ignored.

    Args:
        known: names that the joints can have; others are refused before the points are read.

    Raises:
        DecodeError: not such a message, or a point whose number of transforms is not that of the
            joints, or more than `MOST_POINTS`.
        Refused: unknown joints.
    """
    reader = cdr.Reader(raw)
    stamp_ns, frame_id = reader.header()
    joints = tuple(reader.text() for _ in range(reader.count("joints", _MOST_JOINTS)))
    if known is not None:
        check_joints(known, joints)
    count = reader.count("points", MOST_POINTS)
    times, poses = np.empty(count), np.empty((count, len(joints), _TRANSFORM))
    done = 0
    while done < count:
        tables = [reader.table(width) for width in (_TRANSFORM, _TWIST, _TWIST)]
        if len(tables[0]) != len(joints):
            raise cdr.DecodeError(
                f"point {done} has {len(tables[0])} transforms for {len(joints)} joints"
            )
        poses[done] = tables[0]
        times[done] = reader.whole("i") + 1e-9 * reader.whole()
        done += 1
        # Those that follow have as many velocities and accelerations, as a rule.
        layout = _layout(reader, tables)
        rows = reader.records(layout, count - done)
        alike = np.ones(len(rows), dtype=bool)
        for number, table in enumerate(tables):
            alike &= rows[f"size {number}"] == len(table)
        same = len(rows) if alike.all() else int(np.argmin(alike))
        times[done : done + same] = rows["seconds"][:same] + 1e-9 * rows["nanoseconds"][:same]
        if joints:
            poses[done : done + same] = rows["table 0"][:same]
        reader.skip(same * layout.itemsize)
        done += same
    return Trajectory(stamp_ns, frame_id, joints, times, poses)


def _layout(reader: cdr.Reader, tables: Sequence[Array]) -> np.dtype[Any]:
    """Layout of the points that follow one with these transforms, velocities and accelerations.

    The first padding depends on where the point begins. After any table the rest of a point has a
    fixed length, so that all points but the first of a message begin alike.
    """
    fields: dict[str, tuple[str, Any, int]] = {}
    at = reader.at
    for number, table in enumerate(tables):
        fields[f"size {number}"] = "u4", (), at
        at += 4
        if len(table):
            at += -(at - 4) % 8
            fields[f"table {number}"] = "f8", table.shape, at
            at += 8 * table.size
    fields |= {"seconds": ("i4", (), at), "nanoseconds": ("u4", (), at + 4)}
    layout: Any = {
        "names": list(fields),
        "formats": [(reader.order + kind, shape) for kind, shape, _ in fields.values()],
        "offsets": [begin - reader.at for _, _, begin in fields.values()],
        "itemsize": at + 8 - reader.at,
    }
    return np.dtype(layout)


class Planned(NamedTuple):
    """A plan for a simulator in its present state.

    Attributes:
        stamp_ns: stamp of the answer: that of the plan, or its arrival if the plan has none.
        ahead: time from the present state to that stamp [s].
    """

    simulator: Simulator
    plan: Plan
    stamp_ns: int
    ahead: float


class Plans:
    """Checks plans for a session.

    Attributes:
        record: counts the plans.

    Raises:
        SceneError: the session's method cannot follow plans, as it is explicit.
    """

    def __init__(self, session: Session, topic: str) -> None:
        method = session.simulator.method
        if METHODS[method].family != IMPLICIT:
            raise SceneError(
                f"forecast.processes: {method} follows no plans; set it to 0, or give "
                "integrator.method: energy_momentum"
            )
        self._session = session
        self.record = TopicRecord(topic, occasional=True)

    def accept(self, raw: cdr.Bytes, arrival_ns: int) -> Planned | None:
        """Check one message; a bad one is refused and counted."""
        self.record.last_arrival_ns = arrival_ns
        try:
            trajectory = decode_trajectory(raw, known_joints(self._session.scene))
            planned = self._planned(trajectory, arrival_ns)
        except cdr.DecodeError as error:
            self.record.refuse(error.reason, f"{error}; publish {cdr.TRAJECTORY}")
            return None
        except Refused as refused:
            self.record.refuse(refused.reason, refused.detail)
            return None
        self.record.accepted += 1
        return planned

    def _planned(self, trajectory: Trajectory, arrival_ns: int) -> Planned:
        from dlo_sim.simulation.forecast import Plan

        session = self._session
        if not session.started:
            raise bad_plan("the cable has not been placed yet; plan once every end has a pose")
        check_plan(session.scene, trajectory)
        stamp_ns = trajectory.stamp_ns or arrival_ns
        ahead = (stamp_ns - session.stamp_ns) * 1e-9
        times = ahead + trajectory.times
        if not 0.0 < times[-1] <= LONGEST:
            raise bad_plan(
                f"ends {times[-1]:.3f} s after the present state; stamp it with the time of its "
                f"begin, or with 0 for now, and plan at most {LONGEST:g} s"
            )
        later = times > 0.0
        grid = np.concatenate([[0.0], times[later]])
        poses = {}
        for name, rows in zip(trajectory.joints, np.moveaxis(trajectory.poses, 1, 0), strict=True):
            self._check_begin(name, rows[0])
            present = np.concatenate(session.simulator.end_pose(name))
            poses[name] = np.vstack([present, rows[later]])
            check_speed(session.scene, name, grid, poses[name], JUMP[0])
        return Planned(session.simulator, Plan(grid, poses), stamp_ns, ahead)

    def _check_begin(self, name: str, pose: Array) -> None:
        """Refuse a plan that does not begin near the newest pose of the end effector."""
        newest = self._session.newest_poses.get(name)
        position, orientation = self._session.simulator.end_pose(name)
        if newest is not None:
            position, orientation = np.array(newest.position), np.array(newest.orientation)
        way = math.dist(pose[:3].tolist(), position.tolist())
        turned = rotations.multiply(pose[3:], rotations.conjugate(orientation))
        turn = float(np.linalg.norm(rotations.to_rotation_vector(turned)))
        if way > JUMP[0] or turn > JUMP[1]:
            raise bad_plan(
                f"begins {way:.3g} m and {turn:.3g} rad away from the newest pose of {name}; begin "
                f"there, within {JUMP[0]:g} m and {JUMP[1]:g} rad"
            )


def check_plan(scene: Scene, trajectory: Trajectory) -> None:
    """Refuse a plan that is invalid for a scene in every state of its cable.

    Raises:
        Refused: with the reason.
    """
    joints, times = trajectory.joints, trajectory.times
    if trajectory.frame_id not in ("", scene.frame_id):
        raise bad_plan(f"is in frame '{trajectory.frame_id}'; transform it to '{scene.frame_id}'")
    check_joints(known_joints(scene), joints)
    if not len(times) or times[0] < 0.0 or not np.all(np.diff(times) > 0.0):
        shown = ", ".join(f"{time:.6g}" for time in times[:4])
        raise bad_plan(f"has the times {shown or 'none'} ... s; give rising ones from 0 s on")
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.linalg.norm(trajectory.poses[..., :3], axis=-1)
        norm = np.linalg.norm(trajectory.poses[..., 3:], axis=-1)
        good = (distance <= MOST_DISTANT) & (np.abs(norm - 1.0) <= NORM_TOLERANCE)
    for row, joint in np.argwhere(~good).tolist():
        pose = tuple(trajectory.poses[row, joint].tolist())
        where = f"the plan's pose {row} of {joints[joint]}"
        if not math.isfinite(sum(pose)):
            raise Refused("not_finite", f"{where} is {list(pose)}; repair the planner")
        try:
            check_pose(pose)
        except Refused as refused:
            raise Refused(refused.reason, f"{where}: {refused.detail}") from None


def known_joints(scene: Scene) -> list[str]:
    """What a plan can move: the ends and grasps of a scene that are held."""
    return [name for name, holder in scene.holders.items() if holder.held]


def check_joints(known: Collection[str], joints: Collection[str]) -> None:
    """Refuse joints that are unknown, named twice or none.

    Raises:
        Refused: naming them.
    """
    if not joints or not set(joints) <= set(known) or len(set(joints)) < len(joints):
        raise bad_plan(
            f"has the joints {', '.join(joints) or 'none'}; name what holds the cable, each once: "
            f"{', '.join(known) or 'nothing does'}"
        )


def check_speed(scene: Scene, name: str, times: Array, poses: Array, jump: float = 0.0) -> None:
    """Refuse poses (T, 7) of an end effector that are further apart than inputs.max_speed allows.

    Args:
        jump: additional distance allowed between the first two [m].

    Raises:
        Refused: with the speed.
    """
    ways = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    ways[0] = max(ways[0] - jump, 0.0)
    speed, most = float((ways / np.diff(times)).max()), scene.inputs.max_speed
    if speed > most:
        raise bad_plan(
            f"moves {name} at {speed:.3g} m/s, inputs.max_speed is {most:g} m/s; plan it slower"
        )


def bad_plan(detail: str) -> Refused:
    """The refusal of a plan; `detail` completes "the plan ..."."""
    return Refused("bad_plan", f"the plan {detail}")
