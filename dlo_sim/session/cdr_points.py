"""Points from serialised PoseArray, MarkerArray and PointCloud2 messages, and clouds as bytes
(`cdr`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.session import cdr
from dlo_sim.session.cdr import DecodeError, Encoder, Reader, Writer

Array = NDArray[np.float64]
_REALS = {7: "f4", 8: "f8"}  # PointField datatypes of coordinates
_FLOAT32, _FLOAT_SIZE = 7, 4


def decode_pose_positions(raw: bytes) -> tuple[int, Array]:
    """Stamp [ns] and positions (n, 3) of a PoseArray."""
    message = cdr.decode_pose_array(raw)
    return message.stamp_ns, message.poses[:, :3]


def decode_marker_array(raw: bytes) -> tuple[int, Array]:
    """Stamp [ns] of the first marker and the points of all: those of a list, else the position.

    Raises:
        DecodeError: not such a message, or one without markers.
    """
    reader, points, stamp = Reader(raw), [], None
    for _ in range(reader.whole()):
        at, _ = reader.header()
        stamp = at if stamp is None else stamp
        reader.data()  # ns
        reader.numbers("i", 3)  # id, type, action
        pose = reader.numbers("d", 7)
        reader.numbers("d", 3)  # scale
        reader.numbers("f", 4)  # colour
        reader.numbers("i", 2)  # lifetime
        reader.numbers("B")  # frame_locked
        count = reader.whole()
        own = [reader.numbers("d", 3) for _ in range(count)]
        points += own or [pose[:3]]
        for _ in range(reader.whole()):
            reader.numbers("f", 4)
        reader.data()  # texture_resource
        reader.header()  # texture
        reader.data()
        reader.data()
        for _ in range(reader.whole()):
            reader.numbers("f", 2)
        reader.data()  # text
        reader.data()  # mesh_resource
        reader.data()  # mesh_file
        reader.data()
        reader.numbers("B")  # mesh_use_embedded_materials
    if stamp is None:
        raise DecodeError("the array holds no markers")
    return stamp, np.array(points)


def decode_point_cloud(raw: bytes) -> tuple[int, Array]:
    """Stamp [ns] and points (n, 3) of a PointCloud2 with fields x, y, z; NaN where missing.

    Raises:
        DecodeError: not such a message, or one without these fields.
    """
    reader = Reader(raw)
    stamp, _ = reader.header()
    rows, columns = reader.whole(), reader.whole()
    fields = {}
    for _ in range(reader.whole()):
        name = reader.text()
        offset, kind, _ = reader.whole(), reader.whole("B"), reader.whole()
        fields[name] = offset, kind
    big = reader.whole("B")
    point_step, row_step = reader.whole(), reader.whole()
    data = reader.data()
    if any(name not in fields or fields[name][1] not in _REALS for name in "xyz"):
        raise DecodeError(f"fields {', '.join(fields)} are not x, y, z as float32 or float64")
    if len(data) < rows * row_step or row_step < columns * point_step:
        raise DecodeError(f"{len(data)} bytes of data do not hold {rows * columns} points")
    order = ">" if big else "<"
    layout: Any = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + _REALS[fields[name][1]] for name in "xyz"],
            "offsets": [fields[name][0] for name in "xyz"],
            "itemsize": point_step,
        }
    )
    lines = [np.frombuffer(data, layout, columns, row * row_step) for row in range(rows)]
    cloud = np.concatenate(lines) if lines else np.zeros(0, layout)
    return stamp, np.stack([cloud[name].astype(float) for name in "xyz"], axis=-1)


class PointCloudEncoder(Encoder):
    """Encodes a PointCloud2 of a constant number of points with fields of float32, shape (count,
    fields).
    """

    def __init__(self, frame_id: str, fields: Sequence[str], count: int) -> None:
        writer, size = Writer(), _FLOAT_SIZE * len(fields)
        writer.header(frame_id)
        writer.numbers("I", 1, count, len(fields))  # rows, columns
        for number, name in enumerate(fields):
            writer.text(name)
            writer.numbers("I", _FLOAT_SIZE * number)
            writer.numbers("B", _FLOAT32)
            writer.numbers("I", 1)
        writer.numbers("B", 0)  # is_bigendian
        writer.numbers("I", size, size * count, size * count)  # of a point, a row, all
        begin = writer.zeros((count, len(fields)), "f")
        writer.numbers("B", 1)  # is_dense
        super().__init__(writer, begin, (count, len(fields)), "<f4")
