"""Planned motions as messages: `~/plan` in, `~/forecast` and `~/forecast/ghosts` out.

A plan has to begin near the newest pose of its end effector. The forecast begins at the present
state, which is older by the latency, and moves from there to the plan. A plan of 20,000 points
takes 0.3 s to read, so a session only makes a `Request` of the message and of its state; `answer`,
which does everything else, runs in a process of its own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.gripper_path import Pose
from dlo_sim.session.intake import check_pose
from dlo_sim.session.outputs import OutgoingMessage
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import FORECAST, GHOSTS

if TYPE_CHECKING:
    from dlo_sim.session.session import Session
    from dlo_sim.simulation.forecast import Forecast, Plan
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
JUMP = 0.02, 0.2  # [m], [rad]: largest distance of a plan's first pose from the newest pose
LONGEST = 60.0  # [s]: longest plan, counted from the present state
MOST_POINTS = 20_000  # of a plan: 60 s at 333 Hz
_MOST_BYTES = 16_000_000  # of a plan that is handed to another process
_MOST_JOINTS = 1000
_CONTACT = {
    "total": "contact force [N]",
    "largest": "largest contact force [N]",
    "clearance": "clearance [m]",
    "to_itself": "clearance to itself [m]",
}
_GHOST_COLOR = (0.4, 0.8, 0.4, 0.3)


class Trajectory(NamedTuple):
    """A decoded trajectory.

    Attributes:
        joints: names of the J joints. times: of the points, counted from the stamp [s], shape (T,).
        poses: position [m] and quaternion x, y, z, w, shape (T, J, 7).
    """

    stamp_ns: int
    frame_id: str
    joints: tuple[str, ...]
    times: Array
    poses: Array


class Request(NamedTuple):
    """A serialised plan, and the state of a session from which it is checked and predicted.

    Attributes:
        arrival_ns: clock time at which the plan came [ns].
        now_ns: clock time of the simulator's state [ns]; None: the cable is not placed.
        newest: end or grasp -> its last pose received, which the simulation may not have reached.
    """

    raw: bytes
    arrival_ns: int
    simulator: Simulator
    now_ns: int | None
    newest: Mapping[str, Pose | None]


class Answer(NamedTuple):
    """The result of one plan.

    Attributes:
        messages: to be published. values: for the diagnostics. refused: reason and detail, if it
            was.
        problem: why the cable could not be predicted to the end of the plan, one line; or empty.
    """

    messages: tuple[OutgoingMessage, ...] = ()
    values: tuple[tuple[str, str], ...] = ()
    problem: str = ""
    refused: tuple[str, str] | None = None


def check_method(scene: Scene, method: str) -> None:
    """Raise SceneError for an explicit method, which cannot follow plans."""
    if scene.forecast.processes and METHODS[method].family != IMPLICIT:
        raise SceneError(
            f"forecast.processes: {method} follows no plans; set it to 0, or give "
            "integrator.method: energy_momentum"
        )


def request(session: Session, raw: bytes, arrival_ns: int) -> Request:
    """A received plan with the present state of the session; raises Refused if it is too long."""
    if len(raw) > _MOST_BYTES:
        raise Refused("too_many", f"{len(raw)} bytes; plan at most {MOST_POINTS} points")
    now_ns = session.stamp_ns if session.started else None
    return Request(raw, arrival_ns, session.simulator, now_ns, session.newest_poses)


def answer(asked: Request) -> Answer:
    """Judge a plan, predict the cable along it and serialise the result."""
    began = time.perf_counter()
    scene = asked.simulator.scene
    try:
        plan, stamp_ns, ahead = _planned(asked)
    except cdr.DecodeError as error:
        return Answer(refused=(error.reason, f"{error}; publish {cdr.TRAJECTORY}"))
    except Refused as refused:
        return Answer(refused=(refused.reason, refused.detail))
    end = float(np.max(plan.times))
    try:
        forecast = asked.simulator.forecast(plan, min(scene.forecast.every, end))
    except (TypeError, ValueError) as refusal:
        return Answer(problem=str(refusal))
    if not len(forecast.times):
        return Answer(problem=forecast.report.message)
    cloud = _cloud(scene, forecast, stamp_ns, ahead)
    ghosts = _ghosts(scene, forecast, stamp_ns, end - ahead)
    messages = (
        OutgoingMessage(FORECAST, cdr.POINT_CLOUD, stamp_ns, cloud),
        OutgoingMessage(GHOSTS, cdr.MARKER, stamp_ns, ghosts),
    )
    peak = forecast.peak_tension
    values = (
        ("peak tension [N]", "unknown" if peak is None else f"{peak:.4g}"),
        ("largest curvature [1/m]", f"{forecast.largest_curvature:.4g}"),
        *contact_values(forecast.contact),
        ("warnings", "; ".join(forecast.warnings)),
        ("forecast time [ms]", f"{1e3 * (time.perf_counter() - began):.1f}"),
    )
    return Answer(messages, values, forecast.report.message)


def contact_values(contact: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Keys and values for the diagnostics, of `Forecast.contact`."""
    for name, key in _CONTACT.items():
        if math.isfinite(contact.get(name, math.inf)):
            yield key, f"{contact[name]:.4g}"


def decode_trajectory(raw: cdr.Bytes, known: Collection[str] | None = None) -> Trajectory:
    """Names, times and transforms of a message; velocities and accelerations are ignored.

    Args:
        known: names that the joints can have; None: any.

    Raises:
        DecodeError: not such a message, a point without one transform per joint, or more than
            `MOST_POINTS`. Refused: unknown joints.
    """
    message = cdr.read(cdr.TRAJECTORY, raw)
    joints, points = tuple(message.joint_names), message.points
    if len(joints) > _MOST_JOINTS:
        raise cdr.TooMany(f"{len(joints)} joints, {_MOST_JOINTS} at most are used")
    if known is not None:
        check_joints(known, joints)
    if len(points) > MOST_POINTS:
        raise cdr.TooMany(f"{len(points)} points, {MOST_POINTS} at most are used")
    for number, point in enumerate(points):
        if len(point.transforms) != len(joints):
            raise cdr.DecodeError(
                f"point {number} has {len(point.transforms)} transforms for {len(joints)} joints"
            )
    stamps = [point.time_from_start for point in points]
    rows = [cdr.transform_values(one) for point in points for one in point.transforms]
    return Trajectory(
        *cdr.head(message.header),
        joints,
        np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]),
        np.reshape(rows, (len(points), len(joints), 7)),
    )


def check_plan(scene: Scene, trajectory: Trajectory) -> None:
    """Raise Refused for a plan that is invalid for a scene in every state of its cable."""
    joints, times = trajectory.joints, trajectory.times
    if trajectory.frame_id not in ("", scene.frame_id):
        raise _bad_plan(f"is in frame '{trajectory.frame_id}'; transform it to '{scene.frame_id}'")
    check_joints(_known_joints(scene), joints)
    if not len(times) or times[0] < 0.0 or not np.all(np.diff(times) > 0.0):
        shown = ", ".join(f"{time:.6g}" for time in times[:4])
        raise _bad_plan(f"has the times {shown or 'none'} ... s; give rising ones from 0 s on")
    for row, joint in np.ndindex(trajectory.poses.shape[:2]):
        try:
            check_pose(trajectory.poses[row, joint].tolist())
        except Refused as refused:
            where = f"the plan's pose {row} of {joints[joint]}"
            raise Refused(refused.reason, f"{where}: {refused.detail}") from None


def check_joints(known: Collection[str], joints: Collection[str]) -> None:
    """Raise Refused for joints that are unknown, named twice or none."""
    if not joints or not set(joints) <= set(known) or len(set(joints)) < len(joints):
        raise _bad_plan(
            f"has the joints {', '.join(joints) or 'none'}; name what holds the cable, each once: "
            f"{', '.join(known) or 'nothing does'}"
        )


def check_speed(scene: Scene, name: str, times: Array, poses: Array, jump: float = 0.0) -> None:
    """Raise Refused for poses (T, 7) further apart than inputs.max_speed allows.

    Args:
        jump: additional distance allowed between the first two [m].
    """
    ways = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    ways[0] = max(ways[0] - jump, 0.0)
    speed, most = float((ways / np.diff(times)).max()), scene.inputs.max_speed
    if speed > most:
        raise _bad_plan(
            f"moves {name} at {speed:.3g} m/s, inputs.max_speed is {most:g} m/s; plan it slower"
        )


def _planned(asked: Request) -> tuple[Plan, int, float]:
    """The plan from the present state on, the stamp of the answer [ns] (that of the plan, or its
    arrival), and the time from the present state to that stamp [s].

    Raises DecodeError or Refused if it cannot be used.
    """
    from dlo_sim.simulation.forecast import Plan  # imports the compiler

    scene = asked.simulator.scene
    trajectory = decode_trajectory(asked.raw, _known_joints(scene))
    if asked.now_ns is None:
        raise _bad_plan("came before the cable was placed; plan once every end has a pose")
    check_plan(scene, trajectory)
    stamp_ns = trajectory.stamp_ns or asked.arrival_ns
    ahead = (stamp_ns - asked.now_ns) * 1e-9
    times = ahead + trajectory.times
    if not 0.0 < times[-1] <= LONGEST:
        raise _bad_plan(
            f"ends {times[-1]:.3f} s after the present state; stamp it with the time of its "
            f"begin, or with 0 for now, and plan at most {LONGEST:g} s"
        )
    later = times > 0.0
    grid = np.concatenate([[0.0], times[later]])
    poses = {}
    for name, rows in zip(trajectory.joints, np.moveaxis(trajectory.poses, 1, 0), strict=True):
        position, orientation = asked.simulator.end_pose(name)
        _check_begin(name, rows[0], asked.newest.get(name), position, orientation)
        poses[name] = np.vstack([np.concatenate([position, orientation]), rows[later]])
        check_speed(scene, name, grid, poses[name], JUMP[0])
    return Plan(grid, poses), stamp_ns, ahead


def _check_begin(
    name: str, pose: Array, newest: Pose | None, position: Array, orientation: Array
) -> None:
    """Refuse a plan that does not begin near the newest (else the present) pose of the end
    effector.
    """
    if newest is not None:
        position, orientation = np.array(newest.position), np.array(newest.orientation)
    way = math.dist(pose[:3].tolist(), position.tolist())
    turned = rotations.multiply(pose[3:], rotations.conjugate(orientation))
    turn = float(np.linalg.norm(rotations.to_rotation_vector(turned)))
    if way > JUMP[0] or turn > JUMP[1]:
        raise _bad_plan(
            f"begins {way:.3g} m and {turn:.3g} rad away from the newest pose of {name}; begin "
            f"there, within {JUMP[0]:g} m and {JUMP[1]:g} rad"
        )


def _known_joints(scene: Scene) -> list[str]:
    """What a plan can move: the ends and grasps of a scene that are held."""
    return [name for name, holder in scene.holders.items() if holder.held]


def _bad_plan(detail: str) -> Refused:
    """The refusal of a plan; `detail` completes "the plan ..."."""
    return Refused("bad_plan", f"the plan {detail}")


def _cloud(scene: Scene, forecast: Forecast, stamp_ns: int, ahead: float) -> bytes:
    """A cloud of the points of all shapes; its field t counts from the plan's stamp [s], and that
    of a net has the number of the cable in its field `strand`.
    """
    net, fields = scene.is_net, ["x", "y", "z", "u", "t"]
    fields += ["tension"] * (forecast.tension is not None) + ["strand"] * net
    cables = list(forecast.cables(scene))
    shapes, points, _ = forecast.centerline.shape
    rows = np.empty((shapes, len(cables), points, len(fields)))
    rows[..., 4] = (forecast.times - ahead)[:, None, None]
    for k, cable in enumerate(cables):
        rows[:, k, :, :3], rows[:, k, :, 3] = cable.centerline, cable.u
        if cable.tension is not None:
            rows[:, k, :, 5] = cable.tension
        if net:
            rows[:, k, :, -1] = k
    return cdr.encode_point_cloud(stamp_ns, scene.frame_id, fields, rows.reshape(-1, len(fields)))


def _ghosts(scene: Scene, forecast: Forecast, stamp_ns: int, lifetime: float) -> bytes:
    """Lines of a few shapes including the last one, displayed for `lifetime` [s]."""
    count = len(forecast.times)
    chosen = np.unique(np.linspace(count - 1, -1, scene.forecast.ghosts, endpoint=False).round())
    shapes = (cable.centerline[chosen.astype(int)] for cable in forecast.cables(scene))
    # A list of lines: each point inside a shape ends one and begins the next.
    lines = np.concatenate([np.repeat(one, 2, axis=1)[:, 1:-1].reshape(-1, 3) for one in shapes])
    ghosts = cdr.LineEncoder(
        *(scene.frame_id, "forecast", len(lines), scene.cable.diameter, _GHOST_COLOR),
        round(max(lifetime, 0.1) * SECOND),
        kind=cdr.LINE_LIST,
    )
    return ghosts.encode(stamp_ns, lines)
