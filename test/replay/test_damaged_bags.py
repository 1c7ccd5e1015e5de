"""Damaged and hostile bags: used as far as they can be read, one line each, within bounds."""

import os
import sqlite3
import struct
import sys
import zlib

import pytest
from bag_files import SECOND, STORAGES, TOPICS, data_file, read

from dlo_sim.cli.main import main
from dlo_sim.replay.bags import Bag, BagError
from dlo_sim.tuning.scene_file import scene_text

zstd = pytest.importorskip("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


# ------------------------------------------------------------------------- writing MCAP by hand


def record(kind, body):
    return struct.pack("<BQ", kind, len(body)) + body


def text(value):
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def message(channel, time_ns, data):
    return record(5, struct.pack("<HIQQ", channel, 0, time_ns, time_ns) + data)


def chunk(packed, compression, size, checksum=0):
    head = struct.pack("<QQQI", 0, 0, size, checksum) + text(compression)
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


NAMES = b"".join(
    record(3, struct.pack("<H", number) + text(kind) + text("ros2msg") + text(""))
    + record(4, struct.pack("<HH", number, number) + text(topic) + text("cdr") + text(""))
    for number, (topic, kind) in enumerate(TOPICS.items())
)
CHANNELS = {topic: number for number, topic in enumerate(TOPICS)}


def mcap(path, *parts):
    head, footer = record(1, text("ros2") + text("")), record(2, b"\0" * 20)
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + head + b"".join(parts) + record(15, b"\0" * 4) + footer + magic)
    return path


@pytest.fixture
def body(recorded):
    """The standard recording as records of MCAP."""
    return NAMES + b"".join(message(CHANNELS[t], time_ns, data) for t, time_ns, data in recorded)


# ------------------------------------------------------------------------------------- metadata


METADATA = {
    "is not a text file": (b"cdr", b"\xff\xfe"),
    "metadata.yaml is damaged: ValueError": (b"  message_count: 196", b"  message_count: soon"),
    "metadata.yaml is damaged: KeyError": (b"rosbag2_bagfile_information", b"something_else"),
    "version: 10 is newer": (b"version: 9", b"version: 10"),
    "compression_mode: 'folder' is not supported": (b"_mode: ''", b"_mode: folder"),
    "alias '*a;b' is not supported": (b"rosbag2_", b"a: &a;b 1\nb: *a;b\nrosbag2_"),
    "other.mcap is missing": (b"dlo_sim_0.mcap", b"other.mcap"),
    "metadata.yaml promises 197 messages, 196 were found": (b"count: 196", b"count: 197"),
    "holds more than 1000000 bytes": (b"rosbag2_", b"#" * 1_000_000 + b"\nrosbag2_"),
}


@pytest.mark.parametrize("complaint", METADATA)
def test_damaged_metadata_are_named_and_all_messages_read(make_bag, recorded, complaint):
    path = make_bag()
    file = path / "metadata.yaml"
    data = file.read_bytes()
    file.write_bytes(data.replace(*METADATA[complaint]))
    assert file.read_bytes() != data
    bag, found = read(path)
    assert complaint in bag.damage
    assert found == recorded


def test_metadata_that_are_a_pipe_are_not_waited_for(make_bag, recorded):
    path = make_bag()
    (path / "metadata.yaml").unlink()
    os.mkfifo(path / "metadata.yaml")
    bag, found = read(path)
    assert "metadata.yaml is not a regular file" in bag.damage
    assert found == recorded


def test_a_pipe_is_no_bag(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    for path in (tmp_path / "pipe.mcap", tmp_path):
        with pytest.raises(BagError, match="is not a bag"):
            Bag(path)


# ------------------------------------------------------------------------------------ data files


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("time_ns", [2**31 * SECOND, 2**62])
def test_a_time_of_recording_that_none_can_be(
    make_bag, recorded, scene, tmp_path, capsys, storage, time_ns
):
    late = [*recorded, ("/wrench", time_ns, recorded[0][2])]
    path = make_bag(late, storage=storage)
    bag, found = read(path)
    assert f"is recorded at {time_ns} ns" in bag.damage
    assert found == recorded
    file = tmp_path / "scene.yaml"
    file.write_text(scene_text(scene, []))
    assert main(["replay", str(path), "--params", str(file)]) == 3
    assert f"is recorded at {time_ns} ns); 196 of 197 messages" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "complaint", "left"),
    [
        ("UPDATE messages SET timestamp = 'soon' WHERE id = 9", "is recorded at 'soon' ns", 195),
        ("UPDATE messages SET data = 'text' WHERE id = 9", "data of another type", 195),
        ("UPDATE topics SET name = x'ff' WHERE id = 2", "is called b'\\xff'", 46),
        ("UPDATE topics SET name = '/a' || char(27) WHERE id = 2", "is called '/a\\x1b'", 46),
        ("UPDATE messages SET data = zeroblob(0) WHERE id = 9", "", 196),
    ],
)
def test_rows_of_other_types(make_bag, change, complaint, left):
    path = make_bag(storage="sqlite3")
    with sqlite3.connect(data_file(path)) as connection:
        connection.execute(change)
    connection.close()
    bag, found = read(path)
    assert complaint in bag.damage and bool(bag.damage) == bool(complaint)
    assert len(found) == left


def test_a_database_of_something_else(tmp_path):
    with sqlite3.connect(tmp_path / "photos.db3") as connection:
        connection.execute("CREATE TABLE photos (id)")
    connection.close()
    with pytest.raises(BagError, match="has no table of topics and messages"):
        Bag(tmp_path / "photos.db3")


def test_a_message_that_is_not_as_recorded(tmp_path, body, recorded):
    bag, found = read(mcap(tmp_path / "a.mcap", chunk(body, "", len(body), zlib.crc32(body))))
    assert (bag.damage, found) == ("", recorded)
    bag, found = read(mcap(tmp_path / "b.mcap", chunk(body, "", len(body), 1)))
    assert "does not have its checksum" in bag.damage
    assert found == recorded


def zeros():
    """4 GB in 131 kB."""
    return zstd.compress(b"\0" * (1 << 28)) * 16


def test_a_bomb_in_a_chunk_is_not_kept(tmp_path, body, recorded):
    packed = zstd.compress(body) + zeros()
    bag, found = read(mcap(tmp_path / "bomb.mcap", chunk(packed, "zstd", 1 << 32)))
    assert found == recorded
    assert bag.damage


@pytest.mark.parametrize("bad", [b"", b"rubbish", zeros()])  # zstd unpacks b"" to nothing
def test_messages_packed_one_by_one(make_bag, recorded, bad):
    packed = [(topic, time_ns, zstd.compress(data)) for topic, time_ns, data in recorded]
    path = make_bag(packed[:-1] + [("/wrench", recorded[-1][1], bad)])
    file = path / "metadata.yaml"
    mode = "compression_format: zstd\n  compression_mode: MESSAGE"
    file.write_text(file.read_text().replace("compression_mode: ''", mode, 1))
    file.write_text(file.read_text().replace("  compression_format: ''\n", "", 1))
    bag, found = read(path)
    assert found[: len(recorded) - 1] == recorded[:-1]
    assert bag.damage


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bomb_in_place_of_a_file(tmp_path, storage):
    path = tmp_path / ("bomb.mcap.zstd" if storage == "mcap" else "bomb.db3.zstd")
    path.write_bytes(zeros())
    with pytest.raises(BagError, match="unpacks to far more than a recording of its size can hold"):
        Bag(path)
