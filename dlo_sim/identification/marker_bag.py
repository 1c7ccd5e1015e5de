"""Markers on a cable, the force it exerts, and poses of its grippers from a bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.identification.measurement import (
    Measurement,
    MeasurementError,
    checked_points,
    shares_along,
)
from dlo_sim.replay.bags import Bag, BagError, topic_list
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.intake import check_finite, check_pose

Array = NDArray[np.float64]
MARKERS = (cdr.POSE_ARRAY, cdr.MARKER_ARRAY, cdr.POINT_CLOUD)


def read_marker_bag(path: Path, topics: Mapping[str, str]) -> Measurement:
    """The recording in a bag: markers in order from start to end (PoseArray, MarkerArray,
    PointCloud2), or WrenchStamped of the load on the start, and a PoseStamped topic for each end
    effector.

    Args:
        topics: `markers` or `force`, `start`, `end` -> topic; by default the only one of markers,
            else the only wrench, and the pose topics with `start` and `end` in their names, or the
            only one.

    Raises:
        MeasurementError: no bag, or topics that are missing or not the only ones.
    """
    try:
        bag = Bag(path)
    except BagError as trouble:
        raise MeasurementError(str(trouble)) from None
    chosen = _chosen(bag, topics)
    stamped: dict[str, list[tuple[int, Array]]] = {name: [] for name in chosen}
    names = {topic: name for name, (topic, _) in chosen.items()}
    frames: dict[str, str] = {}
    for message in bag.messages(dict(chosen.values())):
        name = names[message.topic]
        try:
            if name == "markers":
                stamp, _, points = cdr.decode_points(message.type, message.data)
                stamped[name].append((stamp, checked_points(f"{path}: {message.topic}", points)))
            else:
                decoded = cdr.decode(message.type, message.data)
                frames.setdefault(name, decoded.frame_id)
                (check_finite if name == "force" else check_pose)(decoded.values)
                values = np.array(decoded.values[:3] if name == "force" else decoded.values)
                stamped[name].append((decoded.stamp_ns, values))
        except Refused as refused:
            raise MeasurementError(f"{path}: {message.topic}: {refused.detail}") from None
        except cdr.DecodeError as trouble:
            raise MeasurementError(
                f"{path}: a message on {message.topic}: {trouble}; repair the recording, or name "
                "another topic by --topic"
            ) from None
    own = frames.get("force", "")
    if own and own not in {frame for name, frame in frames.items() if name != "force"}:
        raise MeasurementError(
            f"{path}: {chosen['force'][0]}: stamped in frame '{own}', which is none of the poses; "
            "rotate the forces into the frame of the poses"
        )
    return _recording(path, stamped)


def _chosen(bag: Bag, topics: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """`markers` or `force`, `start`, `end` -> topic and type."""
    kinds = {topic: types[0] for topic, types in bag.topics.items()}
    chosen = {}
    for name, topic in topics.items():
        wanted = {"markers": MARKERS, "force": (cdr.WRENCH_STAMPED,)}.get(name, (cdr.POSE_STAMPED,))
        if kinds.get(topic) not in wanted:
            raise MeasurementError(
                f"--topic {name}={topic}: the bag has no such topic of type {' or '.join(wanted)}; "
                f"it has {topic_list(bag.topics)}"
            )
        chosen[name] = topic, kinds[topic]
    if {"markers", "force"} <= set(chosen):
        raise MeasurementError("--topic markers and --topic force: name one of them")
    if not {"markers", "force"} & set(chosen):
        markers = [topic for topic, kind in kinds.items() if kind in MARKERS]
        forces = [topic for topic, kind in kinds.items() if kind == cdr.WRENCH_STAMPED]
        name, topics_of_kind = ("markers", markers) if markers else ("force", forces)
        if len(topics_of_kind) != 1:
            raise MeasurementError(
                f"{bag.path}: {len(markers)} topics hold markers, {len(forces)} a force; name one "
                f"by --topic markers=TOPIC or --topic force=TOPIC of {topic_list(bag.topics)}"
            )
        chosen[name] = topics_of_kind[0], kinds[topics_of_kind[0]]
    if not {"start", "end"} & set(chosen):
        poses = [topic for topic, kind in kinds.items() if kind == cdr.POSE_STAMPED]
        for end in ("start", "end") if len(poses) > 1 else ("start",):
            near = [topic for topic in poses if end in topic] or (poses if end == "start" else [])
            if len(near) == 1:
                chosen[end] = near[0], cdr.POSE_STAMPED
    if "start" not in chosen:
        raise MeasurementError(
            f"{bag.path}: no pose topic is the start's; name it by --topic start=TOPIC of "
            f"{topic_list(bag.topics)}"
        )
    return chosen


def _recording(path: Path, stamped: Mapping[str, list[tuple[int, Array]]]) -> Measurement:
    """Frames of the markers or forces, with the poses interpolated to their stamps where known."""
    for name, messages in stamped.items():
        if len(messages) < 3:
            raise MeasurementError(f"{path}: {len(messages)} messages of {name}; record more")
    poses = {end: _rows(stamped[end]) for end in ("start", "end") if end in stamped}
    begin = max(stamps[0] for stamps, _ in poses.values())
    end = min(stamps[-1] for stamps, _ in poses.values())
    measured = stamped["force"] if "force" in stamped else stamped["markers"]
    count = int(np.median([len(points) for _, points in measured]))
    frames = {
        stamp: points
        for stamp, points in measured
        if begin <= stamp <= end and len(points) == count
    }
    if len(frames) < 3 or count < 3:
        raise MeasurementError(
            f"{path}: {len(frames)} frames of {count} markers or forces lie within the poses; "
            "needs 3 of 3"
        )
    stamps = np.array(sorted(frames))
    rows = np.stack([frames[stamp] for stamp in stamps])
    times = (stamps - stamps[0]) * 1e-9
    paths = {
        end: _interpolated((known - stamps[0]) * 1e-9, poses_there, times)
        for end, (known, poses_there) in poses.items()
    }
    if "force" in stamped:
        none = np.zeros((len(times), 0, 3))
        return Measurement(path.name, times, none, paths, np.zeros(0), forces=rows)
    held = [paths[end][:, None, :3] for end in ("start", "end") if end in paths]
    chain = np.concatenate([held[0], rows, *held[1:]], axis=1)
    try:
        length, shares = shares_along(chain)
    except MeasurementError as refusal:
        raise MeasurementError(f"{path}: markers: {refusal}") from None
    shares = shares[1 : 1 + count]
    known = {"cable.length": length, "start.position": paths["start"][0, :3].tolist()}
    if "end" in paths:
        known["end.position"] = paths["end"][0, :3].tolist()
    return Measurement(path.name, times, rows, paths, shares, known)


def _rows(messages: list[tuple[int, Array]]) -> tuple[NDArray[np.int64], Array]:
    """Rising stamps [ns] and their rows."""
    by_stamp = dict(messages)
    stamps = np.array(sorted(by_stamp))
    return stamps, np.stack([by_stamp[stamp] for stamp in stamps])


def _interpolated(known: Array, rows: Array, times: Array) -> Array:
    """Poses at other times: positions evenly, orientations the shorter way."""
    k = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
    fraction = np.clip((times - known[k]) / (known[k + 1] - known[k]), 0.0, 1.0)
    position = rows[k, :3] + fraction[:, None] * (rows[k + 1, :3] - rows[k, :3])
    return np.hstack([position, rotations.slerp(rows[k, 3:], rows[k + 1, 3:], fraction)])
