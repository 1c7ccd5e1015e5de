"""Parses points from PoseArray, MarkerArray and PointCloud2 messages, and serialises clouds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.session import cdr
from dlo_sim.session.cdr import Bytes, DecodeError, Encoder, Reader, Stamped, TooMany, Writer

Array = NDArray[np.float64]
_REALS = {7: "f4", 8: "f8"}  # PointField datatypes of coordinates
_FLOAT32, _FLOAT64, _FLOAT_SIZE = 7, 8, 4
# Coordinates beyond this [m] are written as doubles: floats would be off by more than 0.03 mm.
_FLOAT32_REACH = 1000.0

# Of a message that is used: a tick of some milliseconds has to decode it. Pixels may be missing.
MOST_POINTS, _MOST_MARKERS, _MOST_FIELDS, _MOST_PIXELS = 5_000, 500, 100, 2_000_000


class Cloud(NamedTuple):
    """Decoded points [m], shape (n, 3); NaN where missing."""

    stamp_ns: int
    frame_id: str
    points: Array


def decode_input(message_type: str, raw: Bytes) -> Stamped:
    """As `cdr.decode`, for PointCloud2 too; the values of clouds and PoseArrays are the coordinates
    of all points without a NaN.

    Raises:
        DecodeError: as `cdr.decode`.
    """
    if message_type not in (cdr.POSE_ARRAY, cdr.POINT_CLOUD):
        return cdr.decode(message_type, raw)
    if message_type == cdr.POINT_CLOUD:
        stamp_ns, frame_id, points = decode_point_cloud(raw, keep_missing=False)
    else:
        stamp_ns, frame_id, points = decode_pose_positions(raw)
        points = points[~np.isnan(points).any(axis=1)]
    return Stamped(stamp_ns, frame_id, tuple(points.ravel().tolist()))


def decode_pose_positions(raw: Bytes) -> Cloud:
    """The positions of a PoseArray.

    Raises:
        DecodeError: as `cdr.decode`, or more than `MOST_POINTS`.
    """
    message = cdr.decode_pose_array(raw, MOST_POINTS)
    return Cloud(message.stamp_ns, message.frame_id, message.poses[:, :3])


def decode_marker_array(raw: Bytes) -> Cloud:
    """Stamp and frame of the first marker, and the points of all markers: its list of points, or
    its position if that is empty.

    Raises:
        DecodeError: not such a message, or one without markers, or with more than 500, or more than
            `MOST_POINTS`.
    """
    reader, points, head = Reader(raw), list[Sequence[float]](), None
    for _ in range(reader.count("markers", _MOST_MARKERS)):
        own_head = reader.header()
        head = head or own_head
        reader.data()  # ns
        reader.numbers("i", 3)  # id, type, action
        pose = reader.numbers("d", 7)
        reader.numbers("d", 3)  # scale
        reader.numbers("f", 4)  # colour
        reader.numbers("i", 2)  # lifetime
        reader.numbers("B")  # frame_locked
        own = reader.table(3, f"points beside {len(points)} others", MOST_POINTS - len(points))
        points += own.tolist() or [pose[:3]]
        if len(points) > MOST_POINTS:
            raise TooMany(f"{len(points)} points, {MOST_POINTS} at most are used")
        reader.skip(16 * reader.whole(), 4)  # colours
        reader.data()  # texture_resource
        reader.header()  # texture
        reader.data()  # its format
        reader.view()  # its data, which may be long
        reader.skip(8 * reader.whole(), 4)  # of the texture
        reader.data()  # text
        reader.data()  # mesh_resource
        reader.data()  # name of mesh_file
        reader.view()  # its data, which may be long
        reader.numbers("B")  # mesh_use_embedded_materials
    if head is None:
        raise DecodeError("the array holds no markers")
    return Cloud(*head, np.array(points))


def decode_point_cloud(raw: Bytes, keep_missing: bool = True) -> Cloud:
    """The points of a PointCloud2 with fields x, y, z.

    Args:
        keep_missing: also those with a NaN.

    Raises:
        DecodeError: not such a message, or one without these fields, or with more than
            `MOST_POINTS` that are not missing.
    """
    reader = Reader(raw)
    stamp, frame_id = reader.header()
    rows, columns = reader.whole(), reader.whole()
    fields = {}
    for _ in range(reader.count("fields", _MOST_FIELDS)):
        name = reader.text()
        offset, kind, _ = reader.whole(), reader.whole("B"), reader.whole()
        fields[name] = offset, kind
    big = reader.whole("B")
    point_step, row_step = reader.whole(), reader.whole()
    data = reader.view()
    if any(name not in fields or fields[name][1] not in _REALS for name in "xyz"):
        raise DecodeError(f"fields {', '.join(fields)} are not x, y, z as float32 or float64")
    if len(data) < rows * row_step or row_step < columns * point_step:
        raise DecodeError(f"{len(data)} bytes of data do not hold {rows * columns} points")
    if rows * columns == 0:
        return Cloud(stamp, frame_id, np.zeros((0, 3)))
    ends = [fields[name][0] + int(_REALS[fields[name][1]][1]) for name in "xyz"]
    if max(ends) > point_step:
        raise DecodeError(f"a point of {point_step} bytes does not hold fields that end at {ends}")
    order = ">" if big else "<"
    layout: Any = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + _REALS[fields[name][1]] for name in "xyz"],
            "offsets": [fields[name][0] for name in "xyz"],
            "itemsize": point_step,
        }
    )
    if rows * columns > _MOST_PIXELS:
        raise TooMany(f"{rows * columns} points, {MOST_POINTS} at most are used")
    cloud = np.ndarray((rows, columns), layout, data, 0, (row_step, point_step))
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN like any other
        there = ~(np.isnan(cloud["x"]) | np.isnan(cloud["y"]) | np.isnan(cloud["z"]))
        if (count := int(np.count_nonzero(there))) > MOST_POINTS:
            raise TooMany(
                f"{count} points without a NaN, {MOST_POINTS} at most are used; crop the cloud to "
                "the cable or thin it out"
            )
        kept = cloud.ravel() if keep_missing else cloud[there]
        points = np.stack([kept[name].astype(float) for name in "xyz"], axis=-1)
    return Cloud(stamp, frame_id, points)


def needs_doubles(points: Array) -> bool:
    """Whether points [m] are so far from the origin that float32 would be too coarse for them."""
    return bool(np.abs(points).max(initial=0.0) > _FLOAT32_REACH)


class PointCloudEncoder(Encoder):
    """Encodes a PointCloud2 of a constant number of points; fields are float32, or float64 with
    `doubles`, shape (count, fields).
    """

    def __init__(
        self, frame_id: str, fields: Sequence[str], count: int, doubles: bool = False
    ) -> None:
        kind, floats = (_FLOAT64, 2) if doubles else (_FLOAT32, 1)
        writer, size = Writer(), floats * _FLOAT_SIZE * len(fields)
        writer.header(frame_id)
        writer.numbers("I", 1, count, len(fields))  # rows, columns
        for number, name in enumerate(fields):
            writer.text(name)
            writer.numbers("I", floats * _FLOAT_SIZE * number)
            writer.numbers("B", kind)
            writer.numbers("I", 1)
        writer.numbers("B", 0)  # is_bigendian
        writer.numbers("I", size, size * count, size * count)  # of a point, a row, all
        begin = writer.zeros((count, floats * len(fields)), "f")  # bytes: doubles are not aligned
        writer.numbers("B", 1)  # is_dense
        super().__init__(writer, begin, (count, len(fields)), f"<f{floats * _FLOAT_SIZE}")
