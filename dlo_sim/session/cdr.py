"""Serialised ROS 2 messages (CDR) to numbers and back, without ROS.

Definitions, reading and writing are those of `rosbags.typesys`, but for three things that would
take too long within a tick of 5 ms, or in a replay at a hundred times real time:
- what is published at every tick is a `_Template`: serialised once, after which stamp and numbers
  are overwritten. A WrenchStamped takes 1.5 us instead of 5.7 from its objects, a PoseArray of 13
  poses 1.5 instead of 39, a line of 100 points 4 instead of 173;
- what comes with every tick is read as a header and the doubles behind it: a WrenchStamped takes 2
  us instead of 13, a PoseArray of 50 poses 6 instead of 150;
- the points of markers are read as arrays: four meshes of 900 triangles take 6 ms with their checks
  instead of 23.

Readers accept both byte orders and raise `DecodeError` on anything that is not a complete message.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

Array = NDArray[np.float64]
Bytes = bytes | bytearray | memoryview
Color = tuple[float, float, float, float]

WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"
VECTOR3_STAMPED = "geometry_msgs/msg/Vector3Stamped"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
BOOL = "std_msgs/msg/Bool"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"
MARKER = "visualization_msgs/msg/Marker"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TRAJECTORY = "trajectory_msgs/msg/MultiDOFJointTrajectory"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"

STORE = get_typestore(Stores.ROS2_JAZZY)
# The doubles behind the header of a message.
_NUMBERS = {WRENCH_STAMPED: 6, VECTOR3_STAMPED: 3, POSE_STAMPED: 7}
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # encapsulation -> byte order
transform_values = attrgetter(
    *(f"translation.{axis}" for axis in "xyz"), *(f"rotation.{axis}" for axis in "xyzw")
)
"""Position and quaternion x, y, z, w of a geometry_msgs/Transform."""

_NANO = 1_000_000_000
_LONGEST_NAME = 100_000  # of a frame, in characters
_MOST_PADDING = 7  # writers may pad a message to a multiple of eight bytes
# What a tick of some milliseconds can read; pixels of a cloud may be missing.
MOST_POINTS, _MOST_MARKERS, _MOST_PIXELS = 5_000, 500, 2_000_000
_MOST_BYTES = 1_000_000  # of a MarkerArray
_REALS = {7: "f4", 8: "f8"}  # datatypes of a PointField
# Coordinates beyond this [m] are written as doubles: floats would be off by more than 0.03 mm.
_FLOAT32_REACH = 1000.0


class DecodeError(ValueError):
    """Bytes that are not a complete message of the expected type; one line of text and a `reason`
    of `diagnostics.REASONS`.
    """

    reason = "undecodable"


class TooMany(DecodeError):
    """A message that holds more points than are used of anything."""

    reason = "too_many"


class Stamped(NamedTuple):
    """A header, its stamp in [ns], and the numbers that follow it; or the markers of an array."""

    stamp_ns: int
    frame_id: str
    values: tuple[Any, ...]


class Marker(NamedTuple):
    """The fields of a visualization_msgs/Marker that describe an obstacle: position and scale in m,
    lifetime in ns, and its points, shape (n, 3).
    """

    frame_id: str
    name: str
    kind: int
    action: int
    pose: tuple[float, ...]
    scale: tuple[float, ...]
    lifetime_ns: int
    points: Array


class Table(NamedTuple):
    """A header, and points x, y, z [m], shape (n, 3), or poses with quaternion x, y, z, w, shape
    (n, 7).
    """

    stamp_ns: int
    frame_id: str
    rows: Array


class DiagnosticStatus(NamedTuple):
    """One diagnostic_msgs/DiagnosticStatus; level 0 OK, 1 WARN, 2 ERROR, 3 STALE."""

    level: int
    name: str
    message: str
    values: tuple[tuple[str, str], ...]


# -- reading ------------------------------------------------------------------------------------


def read(kind: str, raw: Bytes) -> Any:
    """A message as an object of `rosbags.typesys`.

    Raises DecodeError: truncated or overlong bytes, an unknown encapsulation, an impossible text.
    """
    definition, little = STORE.get_msgdef(kind), _order(raw) == "<"
    load = definition.deserialize_cdr_le if little else definition.deserialize_cdr_be
    try:
        message, end = load(memoryview(raw)[4:], 0, definition.cls, STORE)
    except (SerdeError, struct.error, ValueError) as error:  # bytes that end, or are no text
        raise _incomplete(kind, raw) from error
    if not 0 <= len(raw) - 4 - end <= _MOST_PADDING:
        raise _incomplete(kind, raw)
    return message


def _order(raw: Bytes) -> str:
    """Byte order of a message, as of `struct`."""
    order = _ORDERS.get(bytes(raw[:2]))
    if order is None:
        raise DecodeError(f"encapsulation {bytes(raw[:2]).hex()} is not CDR (0000 or 0001)")
    return order


def _incomplete(kind: str, raw: Bytes) -> DecodeError:
    return DecodeError(f"{len(raw)} bytes are no complete {kind}")


def _read_head(kind: str, raw: Bytes, at: int = 4) -> tuple[int, str, int]:
    """Stamp [ns] and frame of a header at this byte, and the byte behind it."""
    order = _order(raw)
    try:
        sec, nanosec, size = struct.unpack_from(order + "iII", raw, at)
        end = at + 12 + size
        frame_id = bytes(raw[at + 12 : end - 1]).decode()
    except (struct.error, ValueError) as error:
        raise _incomplete(kind, raw) from error
    if end > len(raw):
        raise _incomplete(kind, raw)
    return _stamp(sec, nanosec, frame_id), frame_id, end


def _doubles_at(kind: str, raw: Bytes, end: int, count: int) -> int:
    """The byte at which so many doubles begin that are all that follows, aligned to byte 4."""
    at = end + (4 - end) % 8 if count else end
    if not 0 <= len(raw) - at - 8 * count <= _MOST_PADDING:
        raise _incomplete(kind, raw)
    return at


def learn(kind: str) -> None:
    """Generate the code that reads a kind of message, so that the first one does not wait 15 ms."""
    read(kind, write(kind, new(kind)))


def decode(
    kind: str, raw: Bytes, *, keep_missing: bool = True, most: int = _MOST_MARKERS
) -> Stamped:
    """Header and numbers of a message.

    They are those of a WrenchStamped (6), Vector3Stamped (3), PoseStamped (7) or Bool (1, without
    header: stamp 0, no frame), the positions (3 each) of a PoseArray or PointCloud2, or a `Marker`
    each of a MarkerArray, with stamp and frame of the first one.

    Args:
        keep_missing: also positions that have a NaN. most: number of markers that are used.

    Raises:
        DecodeError: as `read`, or an impossible stamp.
        TooMany: more than `MOST_POINTS`, or more markers.
    """
    if kind == MARKER_ARRAY:
        return _decode_markers(raw, most)
    if kind in (POSE_ARRAY, POINT_CLOUD):
        stamp_ns, frame_id, points = decode_points(kind, raw, keep_missing=keep_missing)
        return Stamped(stamp_ns, frame_id, tuple(points.ravel().tolist()))
    if kind == BOOL:
        return Stamped(0, "", (float(read(kind, raw).data),))
    stamp_ns, frame_id, end = _read_head(kind, raw)
    count = _NUMBERS[kind]
    at = _doubles_at(kind, raw, end, count)
    return Stamped(stamp_ns, frame_id, struct.unpack_from(f"{_order(raw)}{count}d", raw, at))


def _decode_markers(raw: Bytes, most: int) -> Stamped:
    count = int.from_bytes(raw[4:8], "little" if raw[1:2] == b"\1" else "big")
    if count > most or len(raw) > _MOST_BYTES:
        raise TooMany(f"{count} markers in {len(raw)} bytes, {most} at most are used")
    fields = _Fields(raw, 8)
    try:
        markers = [_marker_of(fields) for _ in range(count)]
    except (struct.error, ValueError) as error:  # bytes that end, or are no text
        raise _incomplete(MARKER_ARRAY, raw) from error
    if not 0 <= len(raw) - fields.at <= _MOST_PADDING:
        raise _incomplete(MARKER_ARRAY, raw)
    if not markers:
        raise DecodeError("the array holds no markers")
    for (sec, nanosec), marker in markers:
        _stamp(sec, nanosec, marker.frame_id)
    stamp, first = markers[0]
    return Stamped(_stamp(*stamp, first.frame_id), first.frame_id, tuple(m for _, m in markers))


def _marker_of(fields: _Fields) -> tuple[tuple[int, int], Marker]:
    """The next Marker, and its stamp in seconds and nanoseconds."""
    stamp = fields.numbers("i") + fields.numbers("I")
    frame_id, namespace = fields.text(), fields.text()
    number, kind, action = fields.numbers("i", 3)
    pose, scale = fields.numbers("d", 7), fields.numbers("d", 3)
    fields.numbers("f", 4)  # colour
    sec, nanosec = fields.numbers("i") + fields.numbers("I")
    fields.numbers("B")  # frame_locked
    points = fields.listed("f8", 3).astype(float)
    fields.listed("f4", 4)  # colours
    fields.text()  # texture_resource, then texture: header, format, data
    fields.numbers("I", 2)
    fields.text(), fields.text()
    fields.listed("u1")
    fields.listed("f4", 2)  # uv_coordinates
    fields.text(), fields.text()  # text, mesh_resource, then mesh_file: name, data
    fields.text()
    fields.listed("u1")
    fields.numbers("B")  # mesh_use_embedded_materials
    lifetime_ns = sec * _NANO + nanosec
    name = f"{namespace}/{number}"
    return stamp, Marker(frame_id, name, kind, action, pose, scale, lifetime_ns, points)


class _Fields:
    """The fields of a message one after the other; `at`: the byte of the next one.

    A Marker is read by them, as its 3,000 points would take 1.5 ms as objects, and take 10 us as an
    array. What reads beyond the end raises struct.error or ValueError.
    """

    def __init__(self, raw: Bytes, at: int) -> None:
        self._raw, self._order, self.at = memoryview(raw), _order(raw), at

    def _aligned(self, size: int) -> int:
        return self.at + (4 - self.at) % size

    def numbers(self, kind: str, count: int = 1) -> tuple[Any, ...]:
        """So many numbers, as `struct` names them."""
        form = f"{self._order}{count}{kind}"
        begin = self._aligned(struct.calcsize("=" + kind))
        self.at = begin + struct.calcsize(form)
        return struct.unpack_from(form, self._raw, begin)

    def text(self) -> str:
        """A text."""
        (size,) = self.numbers("I")
        begin, self.at = self.at, self.at + size
        if self._raw[begin : self.at][-1:] != b"\0":
            raise ValueError("a text that does not end")
        return bytes(self._raw[begin : self.at - 1]).decode()

    def listed(self, kind: str, columns: int = 1) -> Array:
        """A list of rows of numbers, as numpy names them, shape (n, columns)."""
        (count,) = self.numbers("I")
        form = np.dtype(self._order + kind)
        begin = self._aligned(form.itemsize) if count else self.at
        self.at = begin + form.itemsize * columns * count
        found = np.frombuffer(self._raw[begin : self.at], form)
        return found.reshape(count, columns)


def lists_nothing(raw: Bytes) -> bool:
    """Whether a message that is a list, as a MarkerArray, is empty."""
    return raw[4:8] == bytes(4)


def stamp_of(kind: str, raw: Bytes) -> int | None:
    """The stamp [ns] of a message, of the first one in a list of them; None if it has none."""
    listed = kind in (TF_MESSAGE, MARKER_ARRAY)
    try:
        if kind == BOOL or (listed and lists_nothing(raw)):
            return None
        return _read_head(kind, raw, 8 if listed else 4)[0]
    except DecodeError:
        return None


def decode_pose_array(raw: Bytes, most: int | None = None) -> Table:
    """Header and poses of a PoseArray; raises as `decode`, TooMany for more than `most`."""
    stamp_ns, frame_id, end = _read_head(POSE_ARRAY, raw)
    end += -end % 4 + 4
    count = int.from_bytes(raw[end - 4 : end], "little" if raw[1] else "big")
    if most is not None and count > most:
        raise TooMany(f"{count} poses, {most} at most are used")
    at = _doubles_at(POSE_ARRAY, raw, end, 7 * count)
    values = np.frombuffer(raw, _order(raw) + "f8", 7 * count, at)
    return Table(stamp_ns, frame_id, values.astype(float).reshape(count, 7))


def decode_points(kind: str, raw: Bytes, *, keep_missing: bool = True) -> Table:
    """Points of a PoseArray (its positions), PointCloud2 or MarkerArray (the points of each marker,
    or its position if it has none; header of the first one).

    Args:
        keep_missing: also points that have a NaN.

    Raises:
        DecodeError: as `decode`, or it holds no points. TooMany: more than `MOST_POINTS`.
    """
    if kind == POSE_ARRAY:
        table = decode_pose_array(raw, MOST_POINTS)
        kept = keep_missing | ~np.isnan(table.rows[:, :3]).any(axis=1)
        return table._replace(rows=table.rows[kept, :3])
    if kind == POINT_CLOUD:
        cloud = read(kind, raw)
        return Table(*head(cloud.header), _points_of_cloud(cloud, keep_missing))
    stamp_ns, frame_id, markers = _decode_markers(raw, _MOST_MARKERS)
    places = [one.points if len(one.points) else np.array([one.pose[:3]]) for one in markers]
    points = np.concatenate(places)
    if len(points) > MOST_POINTS:
        raise TooMany(f"{len(points)} points, {MOST_POINTS} at most are used")
    return Table(stamp_ns, frame_id, points)


def _points_of_cloud(cloud: Any, keep_missing: bool) -> Array:
    fields = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    if any(name not in fields or fields[name][1] not in _REALS for name in "xyz"):
        raise DecodeError(f"fields {', '.join(fields)} are not x, y, z as float32 or float64")
    rows, columns = cloud.height, cloud.width
    if len(cloud.data) < rows * cloud.row_step or cloud.row_step < columns * cloud.point_step:
        raise DecodeError(f"{len(cloud.data)} bytes of data do not hold {rows * columns} points")
    if rows * columns == 0:
        return np.zeros((0, 3))
    ends = [fields[name][0] + int(_REALS[fields[name][1]][1]) for name in "xyz"]
    if max(ends) > cloud.point_step:
        raise DecodeError(
            f"a point of {cloud.point_step} bytes does not hold fields that end at {ends}"
        )
    if rows * columns > _MOST_PIXELS:
        raise TooMany(f"{rows * columns} points, {MOST_POINTS} at most are used")
    order = ">" if cloud.is_bigendian else "<"
    layout: Any = {
        "names": list("xyz"),
        "formats": [order + _REALS[fields[name][1]] for name in "xyz"],
        "offsets": [fields[name][0] for name in "xyz"],
        "itemsize": cloud.point_step,
    }
    strides = (cloud.row_step, cloud.point_step)
    table = np.ndarray((rows, columns), np.dtype(layout), cloud.data, 0, strides)
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN like any other
        there = ~(np.isnan(table["x"]) | np.isnan(table["y"]) | np.isnan(table["z"]))
        if (count := int(np.count_nonzero(there))) > MOST_POINTS:
            raise TooMany(
                f"{count} points without a NaN, {MOST_POINTS} at most are used; crop the cloud to "
                "the cable or thin it out"
            )
        kept = table.ravel() if keep_missing else table[there]
        return np.stack([kept[name].astype(float) for name in "xyz"], axis=-1)


def decode_diagnostic_array(raw: Bytes) -> tuple[int, list[DiagnosticStatus]]:
    """Stamp [ns] and statuses of a DiagnosticArray, with full names; raises as `decode`."""
    message = read(DIAGNOSTIC_ARRAY, raw)
    return head(message.header)[0], [
        DiagnosticStatus(s.level, s.name, s.message, tuple((v.key, v.value) for v in s.values))
        for s in message.status
    ]


def shown(values: Sequence[float]) -> str:
    """Numbers as a list, for a line of text."""
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


def head(header: Any) -> tuple[int, str]:
    """Stamp [ns] and frame of a std_msgs/Header."""
    return _stamp(header.stamp.sec, header.stamp.nanosec, header.frame_id), header.frame_id


def _stamp(sec: int, nanosec: int, frame_id: str) -> int:
    """The stamp [ns] of a header that is checked."""
    if nanosec >= _NANO:
        raise DecodeError(f"stamp has {nanosec} nanoseconds, 1 s or more")
    if len(frame_id) > _LONGEST_NAME:
        most = f"{_LONGEST_NAME} at most are used"
        raise TooMany(f"{len(frame_id)} characters of frame_id, {most}")
    return sec * _NANO + nanosec


# -- writing ------------------------------------------------------------------------------------


def new(kind: str, **given: Any) -> Any:
    """A message object whose fields are zero or empty but for those given."""
    fields = STORE.get_msgdef(kind).fields
    return STORE.types[kind](
        **{name: given[name] if name in given else _zero(of) for name, of in fields}
    )


def _zero(of: Any) -> Any:
    form, detail = of
    if form == Nodetype.NAME:
        return new(detail)
    if form == Nodetype.BASE:
        return "" if detail[0] == "string" else False if detail[0] == "bool" else 0
    return np.zeros(0, np.uint8) if detail[0] == (Nodetype.BASE, ("uint8", 0)) else []


def write(kind: str, message: Any) -> bytes:
    """A message serialised, little endian."""
    return bytes(STORE.serialize_cdr(message, kind, little_endian=True))


def _time(kind: str, time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, _NANO)
    return STORE.types[f"builtin_interfaces/msg/{kind}"](seconds, nanoseconds)


def _new_header(frame_id: str, stamp_ns: int) -> Any:
    return STORE.types["std_msgs/msg/Header"](_time("Time", stamp_ns), frame_id)


def _vector(values: Sequence[float], kind: str = "Vector3") -> Any:
    return STORE.types[f"geometry_msgs/msg/{kind}"](*map(float, values))


def _pose(values: Sequence[float]) -> Any:
    position, orientation = _vector(values[:3], "Point"), _vector(values[3:], "Quaternion")
    return STORE.types["geometry_msgs/msg/Pose"](position, orientation)


def encode_transforms(stamp_ns: int, frame_id: str, frames: Mapping[str, Sequence[float]]) -> bytes:
    """A TFMessage; `frames`: child frame -> x, y, z [m], quaternion x, y, z, w in frame_id."""
    header = _new_header(frame_id, stamp_ns)
    transforms = []
    for child, pose in frames.items():
        moved = new(
            "geometry_msgs/msg/Transform",
            translation=_vector(pose[:3]),
            rotation=_vector(pose[3:], "Quaternion"),
        )
        transforms.append(STORE.types["geometry_msgs/msg/TransformStamped"](header, child, moved))
    return write(TF_MESSAGE, STORE.types[TF_MESSAGE](transforms))


def encode_diagnostic_array(
    stamp_ns: int, node: str, statuses: Sequence[DiagnosticStatus]
) -> bytes:
    """A DiagnosticArray of these statuses.

    The full name of the node is the hardware_id and the prefix of each name: `/left/dlo_sim:
    session`.
    """
    pair = STORE.types["diagnostic_msgs/msg/KeyValue"]
    made = [
        new(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=status.level,
            name=f"{node}: {status.name}",
            message=status.message,
            hardware_id=node,
            values=[pair(key, value) for key, value in status.values],
        )
        for status in statuses
    ]
    return write(DIAGNOSTIC_ARRAY, STORE.types[DIAGNOSTIC_ARRAY](_new_header("", stamp_ns), made))


def encode_point_cloud(stamp_ns: int, frame_id: str, fields: Sequence[str], rows: Array) -> bytes:
    """A PointCloud2 of points x, y, z, ... [m], shape (n, fields), as float32, or float64 if they
    are far from the origin.
    """
    doubles = bool(np.abs(rows[:, :3]).max(initial=0.0) > _FLOAT32_REACH)
    size, kind = (8, 8) if doubles else (4, 7)
    data = np.ascontiguousarray(rows, f"<f{size}")
    field = STORE.types["sensor_msgs/msg/PointField"]
    cloud = new(
        POINT_CLOUD,
        header=_new_header(frame_id, stamp_ns),
        height=1,
        width=len(rows),
        fields=[field(name, size * k, kind, 1) for k, name in enumerate(fields)],
        point_step=size * len(fields),
        row_step=data.nbytes,
        data=data.view(np.uint8).ravel(),
        is_dense=True,
    )
    return write(POINT_CLOUD, cloud)


# -- templates ----------------------------------------------------------------------------------

# These stand for what changes in the message that a template is made of.
_NUMBER, _SHADE = -1.2345678912345678e-251, float(np.float32(-7.654321e-31))

LINE_STRIP, LINE_LIST = 4, 5
CUBE, SPHERE, CYLINDER, MESH_RESOURCE, TRIANGLE_LIST = 1, 2, 3, 10, 11
ADD, DELETE, DELETE_ALL = 0, 2, 3  # actions of a Marker
NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # viewers complain about a zero quaternion


class _Template:
    """A message in which only the stamp, doubles behind each other and shades of colour change; all
    else is serialised once.

    It is made of a message that begins with a header, with `_NUMBER` and `_SHADE` in the places
    that change.
    """

    def __init__(self, kind: str, message: Any) -> None:
        self._data = bytearray(write(kind, message))
        self._numbers = self._of("<f8", _NUMBER)
        self._shades = self._of("<f4", _SHADE)

    def _of(self, code: str, value: float) -> NDArray[Any]:
        """The part of the message that consists of this value."""
        body = memoryview(self._data)[4:]  # to which CDR aligns all fields
        values = np.frombuffer(body, code, len(body) // int(code[2]))
        places = np.flatnonzero(values == value)
        return values[places[0] : places[-1] + 1] if len(places) else values[:0]

    def encode(self, stamp_ns: int, numbers: ArrayLike, shades: Array | None = None) -> bytes:
        """The message with these numbers in their order, and colours (count, 4) if every point of a
        line has its own.
        """
        sec, nanosec = divmod(stamp_ns, _NANO)
        struct.pack_into("<II", self._data, 4, sec % 2**32, nanosec)
        self._numbers[:] = np.asarray(numbers).ravel()
        if shades is not None:
            self._shades[:] = shades.ravel()
        return bytes(self._data)


class StampedEncoder(_Template):
    """Writes WrenchStamped (force, torque), Vector3Stamped or PoseStamped with a constant frame."""

    def __init__(self, kind: str, frame_id: str) -> None:
        body = _pose([_NUMBER] * 7) if kind == POSE_STAMPED else _vector([_NUMBER] * 3)
        if kind == WRENCH_STAMPED:
            body = STORE.types["geometry_msgs/msg/Wrench"](body, body)
        super().__init__(kind, STORE.types[kind](_new_header(frame_id, 0), body))


class PoseArrayEncoder(_Template):
    """Writes a PoseArray with a constant number of poses and a constant frame.

    Attributes:
        rows: x, y, z [m], quaternion x, y, z, w, shape (count, 7), to be filled in.
    """

    def __init__(self, frame_id: str, count: int) -> None:
        self.rows = np.zeros((count, 7))
        poses = [_pose([_NUMBER] * 7)] * count
        header = _new_header(frame_id, 0)
        super().__init__(POSE_ARRAY, STORE.types[POSE_ARRAY](header, poses))

    def encode(
        self, stamp_ns: int, numbers: ArrayLike | None = None, shades: Array | None = None
    ) -> bytes:
        """The message with this stamp [ns] and these rows, or the present ones."""
        return super().encode(stamp_ns, self.rows if numbers is None else numbers)


class LineEncoder(_Template):
    """Writes a Marker of lines with a constant number of points [m], shape (count, 3).

    Args:
        namespace: by which a viewer identifies the marker. count: number of points.
        width: line width, scale.x [m]. color: red, green, blue, alpha, 0..1.
        lifetime_ns: time without a new message after which the viewer removes the line.
        colored: whether every point has its own colour.
        kind: LINE_STRIP through all points, or LINE_LIST between the points of each pair.
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
        marker = _marker(frame_id, 0, namespace, 0, kind, color, lifetime_ns)
        marker.scale = _vector([width, 0.0, 0.0])
        marker.points = [_vector([_NUMBER] * 3, "Point")] * count
        marker.colors = [_shade([_SHADE] * 4)] * (count if colored else 0)
        super().__init__(MARKER, marker)


class Body(NamedTuple):
    """A marker of one shape: CUBE, SPHERE or CYLINDER, with pose (7) and extents [m] (3); a
    TRIANGLE_LIST of points [m], shape (3 k, 3), in the frame of the pose, times the extents; a
    LINE_LIST between the points of each pair, whose width is the first extent; or a MESH_RESOURCE
    with the URL of a file.
    """

    kind: int
    color: Color
    pose: Sequence[float]
    extents: Sequence[float]
    points: Array = np.zeros((0, 3))
    resource: str = ""


def encode_bodies(
    frame_id: str, namespace: str, stamp_ns: int, lifetime_ns: int, bodies: Iterable[Body]
) -> bytes:
    """A MarkerArray of bodies, numbered from 0; arguments as for `LineEncoder`."""
    markers = []
    for number, body in enumerate(bodies):
        given = stamp_ns, namespace, number, body.kind, body.color, lifetime_ns
        marker = _marker(frame_id, *given)
        marker.pose, marker.scale = _pose(body.pose), _vector(body.extents)
        marker.points = [_vector(point, "Point") for point in body.points.tolist()]
        marker.mesh_resource = body.resource
        markers.append(marker)
    return write(MARKER_ARRAY, STORE.types[MARKER_ARRAY](markers))


def encode_marker_delete_all(kind: str, frame_id: str, stamp_ns: int) -> bytes:
    """A Marker or a MarkerArray with action DELETEALL, which removes all markers of its topic."""
    marker = _marker(frame_id, stamp_ns, "", 0, LINE_STRIP, (0.0, 0.0, 0.0, 0.0), 0)
    marker.action = DELETE_ALL
    return write(kind, STORE.types[MARKER_ARRAY]([marker]) if kind == MARKER_ARRAY else marker)


def _marker(
    frame_id: str,
    stamp_ns: int,
    namespace: str,
    number: int,
    kind: int,
    color: Color,
    lifetime_ns: int,
) -> Any:
    return new(
        MARKER,
        header=_new_header(frame_id, stamp_ns),
        ns=namespace,
        id=number,
        type=kind,
        pose=_pose(NO_POSE),
        color=_shade(color),
        lifetime=_time("Duration", lifetime_ns),
    )


def _shade(color: Sequence[float]) -> Any:
    return STORE.types["std_msgs/msg/ColorRGBA"](*color)
