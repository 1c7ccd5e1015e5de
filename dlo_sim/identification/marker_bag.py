"""Markers on a cable and poses of its grippers from a bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.identification.measurement import (
    MeasurementError,
    Recording,
    checked_points,
    shares_along,
)
from dlo_sim.replay.bags import Bag, BagError, topic_list
from dlo_sim.session import cdr, cdr_points

Array = NDArray[np.float64]
DECODERS = {
    cdr.POSE_ARRAY: cdr_points.decode_pose_positions,
    cdr.MARKER_ARRAY: cdr_points.decode_marker_array,
    cdr.POINT_CLOUD: cdr_points.decode_point_cloud,
}


def read_marker_bag(path: Path, topics: Mapping[str, str]) -> Recording:
    """The recording in a bag: PoseArray, MarkerArray or PointCloud2 of the markers in their order
    from start to end, and a PoseStamped topic for each end effector.

    Args:
        topics: `markers`, `start`, `end` -> topic; by default the only one of the markers' types,
            and the pose topics in whose names `start` and `end` stand, or the only one as start.

    Raises:
        MeasurementError: no bag, or topics that are not there or not the only ones.
    """
    try:
        bag = Bag(path)
    except BagError as trouble:
        raise MeasurementError(str(trouble)) from None
    chosen = _chosen(bag, topics)
    stamped: dict[str, list[tuple[int, Array]]] = {name: [] for name in chosen}
    names = {topic: name for name, (topic, _) in chosen.items()}
    for message in bag.messages(dict(chosen.values())):
        name = names[message.topic]
        try:
            if name == "markers":
                stamp, _, points = DECODERS[message.type](message.data)
                stamped[name].append((stamp, checked_points(f"{path}: {message.topic}", points)))
            else:
                pose = cdr.decode(message.type, message.data)
                values = np.array(pose.values)
                if not np.isfinite(values).all() or not values[3:].any():
                    raise MeasurementError(
                        f"{path}: {message.topic}: {pose.values} is no pose; repair the recording"
                    )
                stamped[name].append((pose.stamp_ns, values))
        except cdr.DecodeError as trouble:
            raise MeasurementError(f"{path}: a message on {message.topic}: {trouble}") from None
    return _recording(path, stamped)


def _chosen(bag: Bag, topics: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """`markers`, `start`, `end` -> topic and type."""
    kinds = {topic: types[0] for topic, types in bag.topics.items()}
    chosen = {}
    for name, topic in topics.items():
        wanted = tuple(DECODERS) if name == "markers" else (cdr.POSE_STAMPED,)
        if kinds.get(topic) not in wanted:
            raise MeasurementError(
                f"--topic {name}={topic}: the bag has no such topic of type {' or '.join(wanted)}; "
                f"it has {topic_list(bag.topics)}"
            )
        chosen[name] = topic, kinds[topic]
    if "markers" not in chosen:
        found = [topic for topic, kind in kinds.items() if kind in DECODERS]
        if len(found) != 1:
            raise MeasurementError(
                f"{bag.path}: {len(found)} topics hold markers; name one by --topic markers=TOPIC "
                f"of {topic_list(bag.topics)}"
            )
        chosen["markers"] = found[0], kinds[found[0]]
    if not {"start", "end"} & set(chosen):
        poses = [topic for topic, kind in kinds.items() if kind == cdr.POSE_STAMPED]
        for end in ("start", "end"):
            near = [topic for topic in poses if end in topic] or (poses if end == "start" else [])
            if len(near) == 1:
                chosen[end] = near[0], cdr.POSE_STAMPED
    if "start" not in chosen:
        raise MeasurementError(
            f"{bag.path}: no pose topic is the start's; name it by --topic start=TOPIC of "
            f"{topic_list(bag.topics)}"
        )
    return chosen


def _recording(path: Path, stamped: Mapping[str, list[tuple[int, Array]]]) -> Recording:
    """The markers' frames with the poses interpolated to their stamps, where all are known."""
    for name, messages in stamped.items():
        if len(messages) < 3:
            raise MeasurementError(f"{path}: {len(messages)} messages of {name}; record more")
    poses = {end: _rows(stamped[end]) for end in ("start", "end") if end in stamped}
    begin = max(stamps[0] for stamps, _ in poses.values())
    end = min(stamps[-1] for stamps, _ in poses.values())
    counts = [len(points) for _, points in stamped["markers"]]
    count = int(np.median(counts))
    frames = {
        stamp: points
        for stamp, points in stamped["markers"]
        if begin <= stamp <= end and len(points) == count
    }
    if len(frames) < 3 or count < 3:
        raise MeasurementError(
            f"{path}: {len(frames)} frames of {count} markers lie within the poses; needs 3 of 3"
        )
    stamps = np.array(sorted(frames))
    markers = np.stack([frames[stamp] for stamp in stamps])
    times = (stamps - stamps[0]) * 1e-9
    paths = {
        end: _interpolated((known - stamps[0]) * 1e-9, rows, times)
        for end, (known, rows) in poses.items()
    }
    held = [paths[end][:, None, :3] for end in ("start", "end") if end in paths]
    chain = np.concatenate([held[0], markers, *held[1:]], axis=1)
    try:
        length, shares = shares_along(chain)
    except MeasurementError as refusal:
        raise MeasurementError(f"{path}: markers: {refusal}") from None
    shares = shares[1 : 1 + count]
    known = {"cable.length": length, "start.position": paths["start"][0, :3].tolist()}
    if "end" in paths:
        known["end.position"] = paths["end"][0, :3].tolist()
    return Recording(path.name, times, markers, paths, shares, known)


def _rows(messages: list[tuple[int, Array]]) -> tuple[NDArray[np.int64], Array]:
    """Rising stamps [ns] and their rows."""
    by_stamp = dict(messages)
    stamps = np.array(sorted(by_stamp))
    return stamps, np.stack([by_stamp[stamp] for stamp in stamps])


def _interpolated(known: Array, rows: Array, times: Array) -> Array:
    """Poses at other times: positions evenly, orientations the shorter way."""
    k = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
    share = np.clip((times - known[k]) / (known[k + 1] - known[k]), 0.0, 1.0)
    position = rows[k, :3] + share[:, None] * (rows[k + 1, :3] - rows[k, :3])
    return np.hstack([position, rotations.slerp(rows[k, 3:], rows[k + 1, 3:], share)])
