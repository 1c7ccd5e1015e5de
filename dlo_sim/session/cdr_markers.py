"""Serialised markers: lines, optionally with a colour at each point, and chains of capsules."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.session.cdr import Encoder, Writer

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]

LINE_STRIP, LINE_LIST = 4, 5
_SPHERE, _CYLINDER = 2, 3
_ADD, _DELETE_ALL = 0, 3
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # viewers complain about a zero quaternion
_NO_COLOR: Color = (0.0, 0.0, 0.0, 0.0)
_NANO = 1_000_000_000


class _Offsets(NamedTuple):
    """Offsets of the numbers of one marker in a message."""

    stamp: int
    pose: int  # and scale behind it
    points: int
    colors: int


class LineEncoder(Encoder):
    """Encodes a Marker of lines with a constant number of points [m], shape (count, 3).

    Args:
        frame_id: frame of the points.
        namespace: by which a viewer identifies the marker.
        count: number of points.
        width: line width, scale.x [m].
        color: red, green, blue, alpha, 0..1.
        lifetime_ns: time without a new message after which the viewer removes the line.
        colored: whether every point has its own colour.
        kind: LINE_STRIP through all points, or LINE_LIST between the points of each pair.

    Attributes:
        colors: red, green, blue, alpha of each point, shape (count, 4), to be filled in; shape
            (0, 4) unless colored.
    """

    def __init__(
        self,
        frame_id: str,
        namespace: str,
        count: int,
        width: float,
        color: Color,
        lifetime_ns: int,
        colored: bool = False,
        kind: int = LINE_STRIP,
    ) -> None:
        writer, colors = Writer(), count if colored else 0
        offsets = _write_marker(
            *(writer, frame_id, namespace, 0, kind, (width, 0.0, 0.0), color, lifetime_ns),
            points=count,
            colors=colors,
        )
        super().__init__(writer, offsets.points, (count, 3))
        values = np.frombuffer(self._data, "<f4", 4 * colors, offsets.colors)
        self.colors = values.reshape(colors, 4)


class CapsuleEncoder:
    """Encodes a chain of capsules as a MarkerArray: one cylinder each, and a sphere at each joint.

    Args:
        frame_id, namespace, color, lifetime_ns: as for `LineEncoder`.
        count: number of capsules.
    """

    def __init__(
        self, frame_id: str, namespace: str, count: int, color: Color, lifetime_ns: int
    ) -> None:
        kinds = [_CYLINDER] * count + [_SPHERE] * (count + 1)
        writer = Writer()
        writer.numbers("I", len(kinds))
        offsets = [
            _write_marker(
                *(writer, frame_id, namespace, number, kind, (0.0, 0.0, 0.0), color, lifetime_ns)
            )
            for number, kind in enumerate(kinds)
        ]
        self._count = count
        self._data = bytearray(writer.data)
        # CDR aligns fields relative to byte 4.
        body = memoryview(self._data)[4:]
        self._doubles = np.frombuffer(body, "<f8", len(body) // 8)
        self._words = np.frombuffer(body, "<u4", len(body) // 4)
        self._stamps = _places([one.stamp for one in offsets], 4, 2)
        self._rows = _places([one.pose for one in offsets], 8, 10)  # poses and scales

    def encode(self, stamp_ns: int, joints: Array, radii: Array) -> bytes:
        """The chain through joints [m], shape (count + 1, 3).

        Args:
            radii: of the capsules [m], shape (count,); a joint has the larger one of its capsules.
        """
        count, ways = self._count, np.diff(joints, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        # A cylinder can be reversed, so its axis never has to turn by more than 90 degrees.
        upward = np.where(ways[:, 2:] < 0.0, -ways, ways)
        upward[lengths == 0.0] = 0.0, 0.0, 1.0
        thick = np.maximum(np.append(radii, 0.0), np.insert(radii, 0, 0.0))
        rows = np.tile((*_NO_POSE, 1.0, 1.0, 1.0), (2 * count + 1, 1))
        rows[:count, :3], rows[count:, :3] = 0.5 * (joints[1:] + joints[:-1]), joints
        rows[:count, 3:7] = rotations.minimal_rotation(np.array([0.0, 0.0, 1.0]), upward)
        rows[:, 7:] *= 2.0 * np.concatenate([radii, thick])[:, None]
        rows[:count, 9] = lengths
        self._words[self._stamps], self._doubles[self._rows] = divmod(stamp_ns, _NANO), rows
        return bytes(self._data)


def encode_marker_delete_all(frame_id: str, stamp_ns: int, array: bool = False) -> bytes:
    """A Marker (or a MarkerArray) with action DELETEALL, which removes all markers of its topic."""
    writer = Writer()
    if array:
        writer.numbers("I", 1)
    no_size = (0.0, 0.0, 0.0)
    _write_marker(
        *(writer, frame_id, "", 0, LINE_STRIP, no_size, _NO_COLOR, 0),
        stamp_ns=stamp_ns,
        action=_DELETE_ALL,
    )
    return bytes(writer.data)


def _places(offsets: list[int], size: int, count: int) -> NDArray[np.int64]:
    """Indices of `count` numbers from each offset on, in an array that begins at byte 4."""
    first = (np.array(offsets) - 4) // size
    return first[:, None] + np.arange(count)


def _write_marker(
    writer: Writer,
    frame_id: str,
    namespace: str,
    marker_id: int,
    kind: int,
    scale: tuple[float, float, float],
    color: Color,
    lifetime_ns: int,
    *,
    points: int = 0,
    colors: int = 0,
    stamp_ns: int = 0,
    action: int = _ADD,
) -> _Offsets:
    """Append a Marker with space for these numbers of points and colours."""
    stamp = writer.align(4)
    writer.header(frame_id, stamp_ns)
    writer.text(namespace)
    writer.numbers("i", marker_id, kind, action)
    pose = writer.numbers("d", *_NO_POSE)
    writer.numbers("d", *scale)
    writer.numbers("f", *color)
    writer.numbers("i", lifetime_ns // _NANO)
    writer.numbers("I", lifetime_ns % _NANO)
    writer.numbers("B", 0)  # frame_locked
    writer.numbers("I", points)
    begin = writer.zeros((points, 3))
    writer.numbers("I", colors)
    begin_colors = writer.zeros((colors, 4), "f")
    writer.text("")  # texture_resource
    writer.header("")  # texture
    writer.text("")
    writer.numbers("I", 0, 0)  # its data, uv_coordinates
    for _ in ("text", "mesh_resource", "mesh_file.filename"):
        writer.text("")
    writer.numbers("I", 0)  # mesh_file.data
    writer.numbers("B", 0)  # mesh_use_embedded_materials
    return _Offsets(stamp, pose, begin, begin_colors)
