"""A planned motion of end effectors from a file, as a plan for a cable that begins at rest."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import arguments
from dlo_sim.core.npz import NpzRefused, read_npz
from dlo_sim.core.rotations import IDENTITY
from dlo_sim.core.two_points import poses_of_two_points
from dlo_sim.replay.bags import Bag, BagError, is_bag, topic_list
from dlo_sim.scene.description import Scene
from dlo_sim.scene.plain_yaml import FileRefused, parse_yaml, read_text
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.intake import ContentCheck
from dlo_sim.session.plans import Trajectory, check_plan, check_speed, decode_trajectory
from dlo_sim.session.topics import InputTopic, input_topics, resolved

if TYPE_CHECKING:
    from dlo_sim.simulation.forecast import Plan

Array = NDArray[np.float64]
_FILE = "give a bag, or times and the poses of start, end or grasps as YAML or npz"


class PlanError(Exception):
    """A file that is refused: one line that names it, what is wrong and the cure."""


def read_plan(path: Path, scene: Scene, number: int | None = None) -> Plan:
    """The planned motion in a file, from time 0 on.

    In a bag that is the only MultiDOFJointTrajectory (or its `number`, from 1), or the poses on the
    pose topics of the scene at all their stamps that all topics cover. A YAML or npz file holds
    `times` [s] and for each end or grasp that moves poses x, y, z [m] and quaternion x, y, z, w,
    shape (T, 7).

    Raises:
        PlanError: there is no such motion in it, or one that the scene cannot make.
    """
    from dlo_sim.simulation.forecast import Plan

    try:
        trajectory = _in_bag(Bag(path), scene, number) if is_bag(path) else _in_file(path)
        check_plan(scene, trajectory)
        times = trajectory.times - trajectory.times[0]
        poses = dict(zip(trajectory.joints, np.moveaxis(trajectory.poses, 1, 0), strict=True))
        if len(times) < 2:
            raise PlanError(f"{path}: the plan has one pose; give two or more")
        for name, rows in poses.items():
            check_speed(scene, name, times, rows)
    except BagError as trouble:
        raise PlanError(str(trouble)) from None
    except Refused as refused:
        raise PlanError(f"{path}: {refused.detail}") from None
    return Plan(times, poses)


def _in_file(path: Path) -> Trajectory:
    try:
        if path.suffix == ".npz":
            values: object = read_npz(path)
        else:
            values = parse_yaml(read_text(path))
        if not isinstance(values, dict) or "times" not in values:
            raise PlanError(f"{path}: has no times; {_FILE}")
        times = arguments.numbers("times", values.pop("times"), (None,), "s")
        shape = len(times), 7
        rows = [arguments.numbers(f"poses of {name}", one, shape) for name, one in values.items()]
    except FileRefused as refusal:
        raise PlanError(f"{path}: {refusal.problem}; {_FILE}") from None
    except (NpzRefused, TypeError, ValueError) as refusal:
        raise PlanError(f"{path}: {refusal}; {_FILE}") from None
    poses = np.moveaxis(np.reshape(rows, (len(rows), *shape)), 0, 1)
    return Trajectory(0, "", tuple(map(str, values)), times, poses)


def _in_bag(bag: Bag, scene: Scene, number: int | None) -> Trajectory:
    """The plan in a bag; raises PlanError or Refused if there is none, several, or an unreadable
    one.
    """
    planned = {
        topic: cdr.TRAJECTORY for topic, kinds in bag.topics.items() if cdr.TRAJECTORY in kinds
    }
    plans = [message.data for message in bag.messages(planned)]
    if bag.damage:
        raise PlanError(f"{bag.path}: is damaged ({bag.damage}); record the plan again")
    if not plans:
        return _recorded(bag, scene)
    if number is None and len(plans) > 1 or not 1 <= (number or 1) <= len(plans):
        raise PlanError(f"{bag.path}: holds {len(plans)} plans; give --number with one of them")
    try:
        return decode_trajectory(plans[(number or 1) - 1])
    except cdr.DecodeError as trouble:
        raise PlanError(
            f"{bag.path}: its plan cannot be read ({trouble}); record it again"
        ) from None


def _recorded(bag: Bag, scene: Scene) -> Trajectory:
    """What the pose topics of a scene say."""
    from dlo_sim.simulation.following import on_grid

    entries = [
        entry
        for entry in input_topics(scene)
        if entry.target in scene.holders  # obstacles rest along a plan
        and entry.is_pose
        and entry.type in bag.topics.get(resolved(entry.topic), ())
    ]
    if not entries:
        raise PlanError(
            f"{bag.path}: holds neither a {cdr.TRAJECTORY} nor poses for the scene; it has "
            f"{topic_list(bag.topics)}"
        )
    rows = _poses(bag, scene, entries)
    stamps = [np.array(sorted(by_stamp)) for by_stamp in rows.values()]
    begin, end = max(one[0] for one in stamps), min(one[-1] for one in stamps)
    common = np.unique(np.concatenate(stamps))
    common = common[(common >= begin) & (common <= end)]
    if len(common) < 2 or min(map(len, stamps)) < 2:
        raise PlanError(
            f"{bag.path}: its pose topics are not there at the same time; record them together"
        )
    times = (common - begin) * 1e-9
    poses = [
        on_grid(times, (own - begin) * 1e-9, np.array([by_stamp[stamp] for stamp in own]))
        for own, by_stamp in zip(stamps, rows.values(), strict=True)
    ]
    return Trajectory(0, "", tuple(rows), times, np.stack(poses, axis=1))


def _poses(
    bag: Bag, scene: Scene, entries: list[InputTopic]
) -> Mapping[str, dict[int, tuple[float, ...]]]:
    """End or grasp -> stamp [ns] -> pose, checked like messages to the node."""
    check, rows = ContentCheck(scene), defaultdict[str, dict[int, tuple[float, ...]]](dict)
    orientation = dict.fromkeys((entry.target for entry in entries), IDENTITY)
    for message in bag.messages({resolved(entry.topic): entry.type for entry in entries}):
        for entry in (one for one in entries if resolved(one.topic) == message.topic):
            spacing = scene.holders[entry.target].pose_spacing
            try:
                stamped = cdr.decode(entry.type, message.data)
                values = check.check(stamped, entry.kind, spacing).values
            except cdr.DecodeError as trouble:
                raise PlanError(f"{bag.path}: {message.topic}: {trouble}; record again") from None
            except Refused as refused:
                raise PlanError(f"{bag.path}: {message.topic}: {refused.detail}") from None
            if entry.kind == "two_points":
                points = np.reshape(values, (1, 2, 3))
                values = tuple(poses_of_two_points(points, orientation[entry.target])[0].tolist())
                x, y, z, w = values[3:]
                orientation[entry.target] = x, y, z, w
            rows[entry.target][stamped.stamp_ns or message.time_ns] = values
    return rows
