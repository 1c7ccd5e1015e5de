"""What is written and read without objects against the bag library, and all against rclpy."""

import struct
from importlib import import_module

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from dlo_sim.core import rotations
from dlo_sim.session import cdr
from dlo_sim.session.outputs import capsules_of

FRAMES = ["", "a", "ab", "abc", "abcd", "world", "fr3_link0", "x" * 61, "größe"]
STAMP = 1_700_000_000_123_456_789
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def header(frame, stamp=STAMP):
    time = TYPES["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def numbers(message):
    """All numbers behind the header of a message object, in order."""
    if hasattr(message, "x"):
        return [message.x, message.y, message.z, *([message.w] if hasattr(message, "w") else [])]
    names = [n for n in ("wrench", "vector", "pose", "force", "torque") if hasattr(message, n)]
    names += [n for n in ("position", "orientation") if hasattr(message, n)]
    return [x for name in names for x in numbers(getattr(message, name))]


KINDS = [(cdr.WRENCH_STAMPED, 6), (cdr.VECTOR3_STAMPED, 3), (cdr.POSE_STAMPED, 7)]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("kind", "count"), KINDS)
def test_reference_decodes_what_we_write(kind, count, frame):
    encoder = cdr.StampedEncoder(kind, frame)
    encoder.encode(5, [9.0] * count)  # a template must not remember
    values = np.random.default_rng(1).normal(size=count).tolist()
    message = STORE.deserialize_cdr(encoder.encode(STAMP, values), kind)
    assert message.header == header(frame)
    assert numbers(message) == values


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("count", [0, 1, 13, 50])
def test_pose_array_both_ways(frame, count):
    rows = np.random.default_rng(count).normal(size=(count, 7))
    encoder = cdr.PoseArrayEncoder(frame, count)
    assert encoder.rows.flags.aligned
    encoder.rows[:] = 1.0
    encoder.encode(1)  # a template must not remember
    encoder.rows[:] = rows
    raw = encoder.encode(STAMP)
    message = STORE.deserialize_cdr(raw, cdr.POSE_ARRAY)
    assert message.header == header(frame)
    assert np.array_equal(np.reshape([numbers(p) for p in message.poses], (count, 7)), rows)
    for little_endian in (True, False):
        reference = bytes(STORE.serialize_cdr(message, cdr.POSE_ARRAY, little_endian=little_endian))
        back = cdr.decode_pose_array(reference)
        assert (back.stamp_ns, back.frame_id) == (STAMP, frame)
        assert np.array_equal(back.rows, rows)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("namespace", ["", "a", "ab", "centerline"])
def test_line_strip(frame, namespace):
    points = np.random.default_rng(2).normal(size=(17, 3))
    encoder = cdr.LineEncoder(frame, namespace, 17, 0.02, (0.25, 0.5, 0.75, 1.0), 1_500_000_000)
    encoder.encode(1, np.ones((17, 3)))
    marker = STORE.deserialize_cdr(encoder.encode(STAMP, points), cdr.MARKER)
    assert marker.header == header(frame)
    assert (marker.ns, marker.id, marker.type, marker.action) == (namespace, 0, 4, 0)
    assert numbers(marker.pose) == [0, 0, 0, 0, 0, 0, 1]
    color = marker.color
    assert (marker.scale.x, color.r, color.b, color.a) == (0.02, 0.25, 0.75, 1.0)
    assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 500_000_000)
    assert np.array_equal([[p.x, p.y, p.z] for p in marker.points], points)
    assert len(marker.colors) == 0
    assert marker.text == marker.mesh_resource == marker.texture_resource == ""
    assert not marker.mesh_use_embedded_materials


@pytest.mark.parametrize("frame", FRAMES)
def test_line_strip_with_a_color_at_each_point(frame):
    points = np.random.default_rng(2).normal(size=(5, 3))
    colors = np.random.default_rng(3).uniform(size=(5, 4)).astype(np.float32)
    encoder = cdr.LineEncoder(frame, "ns", 5, 0.02, (1.0, 0.0, 0.0, 1.0), 0, colored=True)
    marker = STORE.deserialize_cdr(encoder.encode(STAMP, points, colors), cdr.MARKER)
    assert np.array_equal([[p.x, p.y, p.z] for p in marker.points], points)
    found = np.array([[c.r, c.g, c.b, c.a] for c in marker.colors], dtype=np.float32)
    assert np.array_equal(found, colors)
    assert marker.text == marker.mesh_resource == ""


@pytest.mark.parametrize("frame", FRAMES)
def test_marker_delete_all(frame):
    marker = STORE.deserialize_cdr(
        cdr.encode_marker_delete_all(cdr.MARKER, frame, STAMP), cdr.MARKER
    )
    assert (marker.header, marker.action, len(marker.points)) == (header(frame), 3, 0)

    raw = cdr.encode_marker_delete_all(cdr.MARKER_ARRAY, frame, STAMP)
    (marker,) = STORE.deserialize_cdr(raw, cdr.MARKER_ARRAY).markers
    assert (marker.header, marker.action, marker.text) == (header(frame), 3, "")


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("namespace", ["", "a", "ab", "capsules"])
def test_capsules(frame, namespace):
    joints = np.random.default_rng(5).normal(size=(4, 3))
    joints[1] = joints[0]  # one of no length
    bodies = capsules_of(joints, np.array([0.125, 0.25, 0.5]), (0.0, 0.0, 1.0, 1.0))
    raw = cdr.encode_bodies(frame, namespace, STAMP, 10**9, bodies)
    markers = STORE.deserialize_cdr(raw, cdr.MARKER_ARRAY).markers
    assert [marker.id for marker in markers] == list(range(7))
    assert all(m.header == header(frame) and m.ns == namespace for m in markers)
    assert [marker.type for marker in markers] == [3] * 3 + [2] * 4
    for k, marker in enumerate(markers[:3]):
        assert (marker.scale.x, marker.scale.y) == (0.25 * 2**k, 0.25 * 2**k)
        x, y, z, *turn = numbers(marker.pose)
        axis = 0.5 * marker.scale.z * rotations.rotate(np.array(turn), [0.0, 0.0, 1.0])
        ends = np.array([(x, y, z) - axis, (x, y, z) + axis])
        expected = joints[k : k + 2]
        assert np.allclose(ends, expected) or np.allclose(ends, expected[::-1])
    spheres = markers[3:]
    assert np.array_equal(cdr.decode_points(cdr.MARKER_ARRAY, raw).rows[3:], joints)
    assert [marker.scale.z for marker in spheres] == [0.25, 0.5, 1.0, 1.0]
    assert [numbers(marker.pose)[3:] for marker in spheres] == [[0.0, 0.0, 0.0, 1.0]] * 4


@pytest.mark.parametrize("frame", FRAMES)
def test_point_cloud(frame):
    rows = np.random.default_rng(6).normal(size=(5, 5)).astype(np.float32)
    fields = ["x", "y", "z", "u", "tension"]
    raw = cdr.encode_point_cloud(STAMP, frame, fields, rows)
    cloud = STORE.deserialize_cdr(raw, cdr.POINT_CLOUD)
    assert (cloud.header, cloud.height, cloud.width) == (header(frame), 1, 5)
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        (name, 4 * k, 7, 1) for k, name in enumerate(fields)
    ]
    assert (cloud.point_step, cloud.row_step, cloud.is_dense) == (20, 100, True)
    assert cloud.data.tobytes() == rows.tobytes()
    stamp, frame_id, points = cdr.decode_points(cdr.POINT_CLOUD, raw)
    assert (stamp, frame_id) == (STAMP, frame)
    assert np.array_equal(points, rows[:, :3])


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_a_nan_and_no_warning():
    rows = np.full((1, 3), 0x7FA00000, dtype="<u4").view("<f4")
    raw = bytearray(cdr.encode_point_cloud(STAMP, "world", "xyz", np.zeros((1, 3))))
    raw[-13:-1] = rows.tobytes()
    assert np.isnan(cdr.decode_points(cdr.POINT_CLOUD, raw, keep_missing=True).rows).all()


@pytest.mark.parametrize("frame", FRAMES[:6])
@pytest.mark.parametrize(("kind", "count"), KINDS)
def test_every_truncation_is_an_error(kind, count, frame):
    raw = cdr.StampedEncoder(kind, frame).encode(STAMP, [1.0] * count)
    for length in range(len(raw)):
        with pytest.raises(cdr.DecodeError):
            cdr.decode(kind, raw[:length])
    assert cdr.decode(kind, raw + bytes(7)).values == (1.0,) * count  # padding is none
    with pytest.raises(cdr.DecodeError, match="are no complete"):
        cdr.decode(kind, raw + bytes(8))


def test_pose_array_truncations():
    encoder = cdr.PoseArrayEncoder("world", 3)
    encoder.rows[:] = 1.0
    raw = encoder.encode(STAMP)
    for length in range(len(raw)):
        with pytest.raises(cdr.DecodeError):
            cdr.decode_pose_array(raw[:length])


def test_garbage_is_a_decode_error_or_a_message_and_nothing_else():
    rng = np.random.default_rng(6)
    refused = 0
    for _ in range(3000):
        raw = rng.integers(0, 256, size=int(rng.integers(0, 120)), dtype=np.uint8).tobytes()
        raw = (b"\x00\x01\x00\x00" + raw) if rng.random() < 0.5 else raw
        for kind, _count in KINDS:
            try:
                cdr.decode(kind, raw)
            except cdr.DecodeError:
                refused += 1
        try:
            cdr.decode_pose_array(raw)
        except cdr.DecodeError:
            refused += 1
    assert refused > 11_000


@pytest.mark.parametrize(
    ("patch", "text"),
    [
        ((1, b"\x07"), "encapsulation"),
        ((8, struct.pack("<I", 10**9)), "nanoseconds"),
        ((12, struct.pack("<I", 2**31)), "are no complete"),
        ((16, b"\xff"), "are no complete"),  # no UTF-8
    ],
)
def test_impossible_headers(patch, text):
    raw = bytearray(cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world").encode(STAMP, [1.0] * 6))
    raw[patch[0] : patch[0] + len(patch[1])] = patch[1]
    with pytest.raises(cdr.DecodeError, match=text):
        cdr.decode(cdr.WRENCH_STAMPED, bytes(raw))


def test_times_before_zero():
    raw = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "").encode(-60_000_000, [0.0] * 6)
    assert cdr.decode(cdr.WRENCH_STAMPED, raw).stamp_ns == -60_000_000


ROWS = np.arange(12, dtype=np.float32).reshape(3, 4)
STATUS = cdr.DiagnosticStatus(2, "name", "größe", (("a", "b"), ("abc", "ccc")))


def poses(frame):
    encoder = cdr.PoseArrayEncoder(frame, 3)
    encoder.rows[:] = np.arange(21.0).reshape(3, 7)
    return encoder.encode(STAMP)


OURS = {
    **{
        kind: lambda frame, kind=kind, count=count: cdr.StampedEncoder(kind, frame).encode(
            STAMP, [*map(float, range(count))]
        )
        for kind, count in KINDS
    },
    cdr.POSE_ARRAY: poses,
    cdr.MARKER: lambda frame: cdr.LineEncoder(frame, "ns", 3, 0.1, (1, 0, 0, 1), 10**9).encode(
        STAMP, ROWS[:, :3].astype(float)
    ),
    cdr.MARKER_ARRAY: lambda frame: cdr.encode_bodies(
        *(frame, "ns", STAMP, 10**9),
        capsules_of(ROWS[:, :3].astype(float), np.array([0.1, 0.2]), (1.0, 0.5, 0.0, 1.0)),
    ),
    cdr.POINT_CLOUD: lambda frame: cdr.encode_point_cloud(STAMP, frame, "xyzu", ROWS),
    cdr.DIAGNOSTIC_ARRAY: lambda frame: cdr.encode_diagnostic_array(STAMP, frame, [STATUS] * 2),
}


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("kind", OURS)
def test_rclpy_reads_the_message_that_the_bag_library_reads(kind, frame):
    """What we write passes through the classes of ROS unchanged; and we read what ROS writes."""
    pytest.importorskip("rclpy", reason="rclpy is not installed")
    from rclpy.serialization import deserialize_message, serialize_message

    package, _, name = kind.split("/")
    raw = OURS[kind](frame)
    message = deserialize_message(raw, getattr(import_module(f"{package}.msg"), name))
    back = serialize_message(message)
    assert cdr_of(back, kind) == cdr_of(raw, kind)
    if kind in dict(KINDS):
        assert cdr.decode(kind, back) == cdr.decode(kind, raw)


def cdr_of(raw, kind):
    """The bytes that the bag library makes of this message."""
    return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(raw, kind), kind))


@pytest.mark.parametrize("little_endian", [True, False])
def test_markers_are_read_as_rosbags_writes_them(little_endian):
    """Every field that may be of any length is of another one in each marker."""
    rng = np.random.default_rng(7)
    made = []
    for n in range(12):
        lengths = rng.integers(0, 9, 10)
        letters = ["é" * k for k in lengths[:6]]
        one = cdr.new(cdr.MARKER, ns=letters[0], id=-n, type=n, action=n, text=letters[1])
        one.header.frame_id, one.mesh_resource = letters[2], letters[3]
        one.texture_resource, one.texture.format = letters[4], letters[5]
        one.texture.header.frame_id = one.mesh_file.filename = letters[0]
        one.header.stamp.sec, one.header.stamp.nanosec = 5, n
        one.pose.position.y, one.pose.orientation.w, one.scale.z = rng.normal(size=3)
        one.lifetime.sec, one.lifetime.nanosec = -n, 5
        one.points = [cdr.new("geometry_msgs/msg/Point", z=z) for z in rng.normal(size=lengths[6])]
        one.colors = [cdr.new("std_msgs/msg/ColorRGBA")] * int(lengths[7])
        one.uv_coordinates = [cdr.new("visualization_msgs/msg/UVCoordinate")] * int(lengths[8])
        one.texture.data = one.mesh_file.data = np.zeros(lengths[9], np.uint8)
        made.append(one)
    array = cdr.new(cdr.MARKER_ARRAY, markers=made)
    raw = bytes(STORE.serialize_cdr(array, cdr.MARKER_ARRAY, little_endian=little_endian))
    stamp_ns, frame_id, found = cdr.decode(cdr.MARKER_ARRAY, raw)
    assert (stamp_ns, frame_id, len(found)) == (5 * 10**9, made[0].header.frame_id, 12)
    for n, (marker, one) in enumerate(zip(found, made, strict=True)):
        assert marker[:4] == (one.header.frame_id, f"{one.ns}/{-n}", n, n)
        assert [*marker.pose, *marker.scale] == [*numbers(one.pose), *numbers(one.scale)]
        assert marker.lifetime_ns == -n * 10**9 + 5
        assert marker.points.tolist() == [numbers(point) for point in one.points]
    for size in range(len(raw) - 8):
        with pytest.raises(cdr.DecodeError):
            cdr.decode(cdr.MARKER_ARRAY, raw[:size])
