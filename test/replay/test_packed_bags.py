"""Bags as recorders pack them, bags of ROS 1, and recordings without a time or with long pauses."""

import shlex
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_files import SECOND, STORAGES, T0, TOPICS, data_file, read
from fake_simulator import FakeSimulator
from rosbags import rosbag1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from dlo_sim.replay.bags import Bag, BagError
from dlo_sim.replay.replay import replay_bag
from dlo_sim.session import cdr

zstd = pytest.importorskip("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


@pytest.fixture(params=STORAGES)
def storage(request):
    return request.param


@pytest.fixture
def packed_bag(tmp_path, recorded, storage):
    """packed_bag(mode, messages) -> a bag (of the standard recording) packed by the bag library."""

    def make(mode, recorded=recorded):
        path = tmp_path / "packed"
        writer = Writer(path, version=9, storage_plugin=PLUGINS[storage])
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            types = get_typestore(Stores.ROS2_JAZZY)
            to = {t: writer.add_connection(t, kind, typestore=types) for t, kind in TOPICS.items()}
            for topic, time_ns, data in recorded:
                writer.write(to[topic], time_ns, data)
        return path

    return make


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_what_was_packed_is_read(packed_bag, recorded, storage, mode):
    path = packed_bag(mode)
    for place in (path, data_file(path)):  # a single file has no metadata that say how it is packed
        bag, found = read(place)
        assert (bag.damage, bag.storage, bag.count) == ("", storage, len(recorded))
        assert sorted(found) == sorted(recorded)


@pytest.mark.parametrize("keep", [True, False])
def test_a_file_unpacked_by_hand(packed_bag, recorded, keep):
    """`unzstd` keeps the packed file; its messages are not read twice."""
    path = packed_bag(CompressionMode.FILE)
    file = data_file(path)
    file.with_suffix("").write_bytes(zstd.decompress(file.read_bytes()))
    if not keep:
        file.unlink()
    bag, found = read(path)
    assert bag.damage == ""
    assert sorted(found) == sorted(recorded)


def test_a_packed_file_that_is_cut_off_is_read_as_far_as_it_goes(packed_bag):
    random = np.random.default_rng(1)  # many blocks of the compressor
    recorded = [("/wrench", T0 + k, random.bytes(100)) for k in range(6000)]
    path = packed_bag(CompressionMode.FILE, recorded)
    file = data_file(path)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 6 // 10])
    bag, found = read(path)
    assert "cannot be unpacked to its end" in bag.damage
    assert 2000 < len(found) < 4000
    assert set(found) <= set(recorded)


def test_a_bag_of_ros_1_names_a_command_that_makes_it_one_of_ros_2(tmp_path, recorded):
    old = tmp_path / "a recording.bag"
    types = get_typestore(Stores.ROS1_NOETIC)
    new = get_typestore(Stores.ROS2_JAZZY)
    with rosbag1.Writer(old) as writer:
        to = writer.add_connection("/gripper_pose", cdr.POSE_STAMPED, typestore=types)
        header = types.types["std_msgs/msg/Header"]
        poses = [m for m in recorded if m[0] == "/gripper_pose"]
        for seq, (_, time_ns, data) in enumerate(poses):
            pose = new.deserialize_cdr(data, cdr.POSE_STAMPED)
            pose.header = header(seq=seq, stamp=pose.header.stamp, frame_id="world")
            writer.write(to, time_ns, types.serialize_ros1(pose, cdr.POSE_STAMPED))
    with pytest.raises(BagError, match="is a bag of ROS 1; convert it: rosbags-convert") as refusal:
        Bag(old)
    command = shlex.split(str(refusal.value).partition("convert it: ")[2])
    command[0] = str(Path(sys.executable).with_name(command[0]))
    subprocess.run(command, check=True, timeout=60, capture_output=True)
    bag, found = read(tmp_path / "a recording")
    assert bag.damage == ""
    decoded = [cdr.decode(cdr.POSE_STAMPED, data) for _, _, data in found]
    assert decoded == [cdr.decode(cdr.POSE_STAMPED, data) for _, _, data in poses]


def stamps(path):
    found = Bag(path).messages({"/dlo_sim/control_points": cdr.POSE_ARRAY})
    return [cdr.decode_pose_array(message.data).stamp_ns for message in found]


def replayed(path, scene, out):
    return replay_bag(path, scene, out, simulator_factory=FakeSimulator)


@pytest.mark.parametrize("which", ["the first", "one topic", "here and there"])
def test_messages_recorded_at_zero(make_bag, recorded, scene, tmp_path, which):
    """As by a recorder on simulated time before /clock: the output is at the stamps of the input,
    and no more of it is missing than was recorded without a time.
    """
    undated = {
        "the first": lambda k, topic: k < 20,
        "one topic": lambda k, topic: topic == "/wrench",
        "here and there": lambda k, topic: k % 7 == 3,
    }[which]
    zeros = [(m[0], 0 if undated(k, m[0]) else m[1], m[2]) for k, m in enumerate(recorded)]
    path = make_bag(zeros)
    bag = Bag(path)
    assert bag.undated == sum(m[1] == 0 for m in zeros) > 10
    assert bag.span_ns[0] > T0 - 1 and bag.damage == ""
    summary = replayed(path, scene, tmp_path / "out")
    assert summary.ok and summary.messages_refused == 0
    assert f"{bag.undated} of {bag.count} messages were recorded at time 0" in summary.warnings[0]
    found = stamps(tmp_path / "out")
    whole = replayed(make_bag(name="dated"), scene, tmp_path / "whole")
    assert whole.warnings == []
    assert set(found) <= set(stamps(tmp_path / "whole"))
    assert len(found) > 240


def test_first_messages_without_any_time_are_left_out(make_bag, scene, tmp_path):
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    stamps_of = [0] * 60 + [T0 + k * 20_000_000 for k in range(60, 200)]
    found = [("/gripper_pose", t, pose.encode(t, (0, 0, 0.5, 0, 0, 0, 1))) for t in stamps_of]
    summary = replayed(make_bag(found), scene, tmp_path / "out")
    assert summary.ok and summary.messages_used == 140 and summary.messages_refused == 0
    assert min(stamps(tmp_path / "out")) == stamps_of[60]


def test_a_bag_without_any_time_of_recording(make_bag, recorded, scene, tmp_path):
    """The stamps are the time, so that the result is that of the same bag with times."""
    summary = replayed(make_bag([(m[0], 0, m[2]) for m in recorded]), scene, tmp_path / "out")
    assert summary.ok and summary.messages_refused == 0 and not summary.events
    assert summary.warnings[0].endswith("at time 0; they count as recorded at their stamps")
    replayed(make_bag(name="dated"), scene, tmp_path / "whole")
    assert stamps(tmp_path / "out") == stamps(tmp_path / "whole")


def at_zero(kind, stamp_ns):
    """A message of a type with this stamp, as far as its header."""
    seconds, rest = divmod(stamp_ns, SECOND)
    header = b"world\0"
    if kind == "big-endian":
        return b"\0\0\0\0" + struct.pack(">iII", seconds, rest, len(header)) + header
    begin = struct.pack("<I", 1) if kind in (cdr.TF_MESSAGE, cdr.MARKER_ARRAY) else b""
    return b"\0\1\0\0" + begin + struct.pack("<iII", seconds, rest, len(header)) + header


@pytest.mark.parametrize("kind", [cdr.POSE_STAMPED, cdr.TF_MESSAGE, cdr.MARKER_ARRAY, "big-endian"])
def test_stamps_are_read_as_their_types_say(make_bag, kind):
    name = cdr.POSE_STAMPED if kind == "big-endian" else kind
    data = [at_zero(kind, T0 + k * 20_000_000) for k in range(5)]
    bag = Bag(make_bag([("/said", 0, one) for one in data], topics={"/said": name}))
    assert bag.undated == bag.count == 5
    times = [message.time_ns for message in bag.messages({"/said": name})]
    assert times == [T0 + k * 20_000_000 for k in range(5)]


def test_pauses_of_hours_do_not_fill_diagnostics(make_bag, scene, tmp_path):
    """What was recorded before a pause is simulated to its end, as at the end of the bag."""
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    begins = [T0 + hour * 3600 * SECOND for hour in (0, 1, 5)]
    found = [
        ("/gripper_pose", stamp, pose.encode(stamp, (0, 0, 0.5, 0, 0, 0, 1)))
        for begin in begins
        for stamp in range(begin, begin + 2 * SECOND, SECOND // 50)
    ]
    summary = replayed(make_bag(found), scene, tmp_path / "out")
    assert summary.ok
    assert [w[:14] for w in summary.warnings] == ["a gap of 3598.", "a gap of 14398"]
    diagnostics = {"/diagnostics": cdr.DIAGNOSTIC_ARRAY}
    assert sum(1 for _ in Bag(tmp_path / "out").messages(diagnostics)) == 2 * len(begins)
    written = stamps(tmp_path / "out")
    for begin in begins:
        own = [stamp - begin for stamp in written if 0 <= stamp - begin < 60 * SECOND]
        assert min(own) == 0 and max(own) >= 1.96 * SECOND
        assert len(own) > 390
