"""Converts messages with planned motions of end effectors to plans for the simulator, or refuses
them.

A plan has to begin near the newest pose of its end effector. The forecast begins at the present
state, which is older by the latency, and moves from there to the plan.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session import cdr
from dlo_sim.session.content import Refused, check_pose
from dlo_sim.session.diagnostics import TopicRecord
from dlo_sim.session.session import Session

if TYPE_CHECKING:
    from dlo_sim.simulation.forecast import Plan
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
JUMP = 0.02, 0.2  # [m], [rad]: largest distance of a plan's first pose from the newest pose
LONGEST = 60.0  # [s]: longest plan, counted from the present state
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


def decode_trajectory(raw: cdr.Bytes) -> Trajectory:
    """Names, times and transforms of a message; velocities and accelerations are ignored.

    Raises:
        DecodeError: not such a message, or a point whose number of transforms is not that of the
            joints.
    """
    reader = cdr.Reader(raw)
    stamp_ns, frame_id = reader.header()
    joints = tuple(reader.text() for _ in range(reader.whole()))
    times, poses = [], []
    for number in range(reader.whole()):
        transforms = reader.table(_TRANSFORM)
        if len(transforms) != len(joints):
            raise cdr.DecodeError(
                f"point {number} has {len(transforms)} transforms for {len(joints)} joints"
            )
        reader.table(_TWIST)  # velocities
        reader.table(_TWIST)  # accelerations
        times.append(reader.whole("i") + 1e-9 * reader.whole())
        poses.append(transforms)
    shape = len(times), len(joints), _TRANSFORM
    return Trajectory(stamp_ns, frame_id, joints, np.array(times), np.reshape(poses, shape))


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
            planned = self._planned(decode_trajectory(raw), arrival_ns)
        except cdr.DecodeError as error:
            self.record.refuse("undecodable", f"{error}; publish {cdr.TRAJECTORY}")
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
    known = [name for name, holder in scene.holders.items() if holder.held]
    if not joints or not set(joints) <= set(known) or len(set(joints)) < len(joints):
        raise bad_plan(
            f"has the joints {', '.join(joints) or 'none'}; name what holds the cable, each once: "
            f"{', '.join(known) or 'nothing does'}"
        )
    if not len(times) or times[0] < 0.0 or not np.all(np.diff(times) > 0.0):
        shown = ", ".join(f"{time:.6g}" for time in times[:4])
        raise bad_plan(f"has the times {shown or 'none'} ... s; give rising ones from 0 s on")
    for row, poses in enumerate(trajectory.poses.tolist()):
        for name, pose in zip(joints, poses, strict=True):
            where = f"the plan's pose {row} of {name}"
            if not math.isfinite(sum(pose)):
                raise Refused("not_finite", f"{where} is {pose}; repair the planner")
            try:
                check_pose(tuple(pose))
            except Refused as refused:
                raise Refused(refused.reason, f"{where}: {refused.detail}") from None


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
