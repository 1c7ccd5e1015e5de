"""Damaged and hostile bags: used as far as they can be read, one line each, within bounds."""

import os
import random
import sqlite3
import struct
import subprocess
import sys
import zlib

import pytest
from damage import damage_bag
from fake_simulator import FakeSimulator

from dlo_sim.cli.main import main
from dlo_sim.replay.bags import Bag, BagError
from dlo_sim.replay.replay import ReplayError, replay_bag
from dlo_sim.session import cdr
from dlo_sim.tuning.scene_file import scene_text

zstd = pytest.importorskip("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
SECOND = 1_000_000_000
TOPICS = {"/gripper_pose": cdr.POSE_STAMPED, "/wrench": cdr.WRENCH_STAMPED}
STORAGES = ["mcap", "sqlite3"]


def data_file(bag):
    (file,) = (f for f in bag.iterdir() if f.suffix in (".mcap", ".db3"))
    return file


def read(path):
    bag = Bag(path)
    found = [(m.topic, m.time_ns, m.data) for m in bag.messages(TOPICS)]
    assert len(bag.damage) < 500 and "\n" not in bag.damage
    return bag, found


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
    "is not a text file": lambda data: data.replace(b"cdr", b"\xff\xfe"),
    "message_count: 'soon' is not a whole number": lambda data: data.replace(
        b"  message_count: 196", b"  message_count: soon"
    ),
    "duration.nanoseconds: True is not a whole": lambda data: data.replace(
        b"nanoseconds: ", b"nanoseconds: true #"
    ),
    "version: 10 is newer": lambda data: data.replace(b"version: 9", b"version: 10"),
    "compression_mode: 'folder' is not supported": lambda data: data.replace(
        b"compression_mode: ''", b"compression_mode: folder"
    ),
    "compression_format: 'rar' is not supported": lambda data: data.replace(
        b"compression_format: ''", b"compression_format: rar"
    ).replace(b"compression_mode: ''", b"compression_mode: FILE"),
    "alias '*a;b' is not supported": lambda data: b"a: &a;b 1\nb: *a;b\n" + data,
    "holds no rosbag2_bagfile_information": lambda data: b"[]",
    "other.mcap is missing": lambda data: data.replace(b"dlo_sim_0.mcap", b"other.mcap"),
    "metadata.yaml promises 197 messages, 196 were found": lambda data: data.replace(
        b"count: 196", b"count: 197"
    ),
    "holds more than 1000000 bytes": lambda data: data + b"#" * 1_000_000,
}


@pytest.mark.parametrize("complaint", METADATA)
def test_metadata(make_bag, recorded, complaint):
    path = make_bag()
    file = path / "metadata.yaml"
    data = file.read_bytes()
    file.write_bytes(METADATA[complaint](data))
    assert file.read_bytes() != data
    bag, found = read(path)
    assert complaint in bag.damage
    assert found == recorded


def test_metadata_that_is_a_pipe(make_bag, recorded):
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
        ("UPDATE messages SET timestamp = 1e300 WHERE id > 99", "is recorded at 1e+300 ns", 99),
        ("UPDATE messages SET data = 'text' WHERE id = 9", "data of another type", 195),
        ("UPDATE messages SET topic_id = 'x' WHERE id = 9", "without a topic", 195),
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


def test_a_row_that_is_larger_than_any_message(make_bag):
    path = make_bag(storage="sqlite3")
    with sqlite3.connect(data_file(path)) as connection:
        connection.execute("UPDATE messages SET data = zeroblob(90000000) WHERE id = 100")
    connection.close()
    bag, found = read(path)
    assert "too big" in bag.damage
    assert len(found) in (98, 99)


def test_a_table_that_computes_for_ever_is_none(make_bag):
    path = make_bag(storage="sqlite3")
    with sqlite3.connect(data_file(path)) as connection:
        connection.execute("ALTER TABLE messages RENAME TO old")
        connection.execute(
            "CREATE VIEW messages AS WITH RECURSIVE c(x) AS "
            "(SELECT 1 UNION ALL SELECT x + 1 FROM c) "
            "SELECT 1 AS topic_id, x AS timestamp, x'00' AS data FROM c"
        )
    connection.close()
    with pytest.raises(BagError, match="has no table of topics and messages"):
        Bag(path)


def test_chunks_within_chunks(tmp_path, body, recorded):
    nested = body
    for _ in range(1500):
        nested = chunk(nested, "", len(nested))
    bag, found = read(mcap(tmp_path / "nested.mcap", body, nested))
    assert "a chunk within a chunk is left out" in bag.damage
    assert found == recorded


def test_a_message_that_is_not_as_recorded(tmp_path, body, recorded):
    bag, found = read(mcap(tmp_path / "a.mcap", chunk(body, "", len(body), zlib.crc32(body))))
    assert (bag.damage, found) == ("", recorded)
    bag, found = read(mcap(tmp_path / "b.mcap", chunk(body, "", len(body), 1)))
    assert "does not have its checksum" in bag.damage
    assert found == recorded


def zeros():
    """4 GB in 131 kB."""
    return zstd.compress(b"\0" * (1 << 28)) * 16


BOMBS = {
    "record with opcode 0": lambda body: body,
    "unpacks to far more": lambda body: body + struct.pack("<BQ", 9, 1 << 32),
}
READ_ALL = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000, 2_000_000_000))
from dlo_sim.replay.bags import Bag
bag = Bag(sys.argv[1])
print(sum(1 for _ in bag.messages({t: k[0] for t, k in bag.topics.items()})), bag.count)
print(bag.damage)
"""


@pytest.mark.parametrize("complaint", BOMBS)
def test_a_bomb_is_neither_unpacked_nor_kept(tmp_path, body, recorded, complaint):
    packed = zstd.compress(BOMBS[complaint](body)) + zeros()
    path = mcap(tmp_path / "bomb.mcap", chunk(packed, "zstd", 1 << 32))
    assert path.stat().st_size < 200_000
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, str(path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    counts, damage = done.stdout.splitlines()
    assert counts == f"{len(recorded)} {len(recorded)}"
    assert complaint in damage


def test_the_same_message_a_million_times(tmp_path, body, recorded):
    """Nothing in it is wrong, except that no recording packs like this."""
    again = message(CHANNELS["/wrench"], recorded[-1][1], recorded[1][2]) * 10_000
    packed = zstd.compress(body) + zstd.compress(again) * 100
    path = mcap(tmp_path / "bomb.mcap", chunk(packed, "zstd", len(body) + 100 * len(again)))
    bag, found = read(path)
    assert "unpacks to far more than a recording of its size can hold" in bag.damage
    assert found[: len(recorded)] == recorded
    assert bag.count == len(found) < 200_000


@pytest.mark.parametrize("bad", [b"", b"rubbish", zeros()])
def test_messages_packed_one_by_one(make_bag, recorded, bad):
    packed = [(topic, time_ns, zstd.compress(data)) for topic, time_ns, data in recorded]
    path = make_bag(packed[:-1] + [("/wrench", recorded[-1][1], bad)])
    file = path / "metadata.yaml"
    mode = "compression_format: zstd\n  compression_mode: MESSAGE"
    file.write_text(file.read_text().replace("compression_mode: ''", mode, 1))
    file.write_text(file.read_text().replace("  compression_format: ''\n", "", 1))
    bag, found = read(path)
    assert found[: len(recorded) - 1] == recorded[:-1]
    assert all(len(data) <= 1 << 20 for _, _, data in found)
    assert bool(bag.damage) == (len(bad) < 10)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bomb_in_place_of_a_file(tmp_path, storage):
    path = tmp_path / ("bomb.mcap.zstd" if storage == "mcap" else "bomb.db3.zstd")
    path.write_bytes(zeros())
    with pytest.raises(BagError, match="unpacks to far more than a recording of its size can hold"):
        Bag(path)


# ---------------------------------------------------------------------------------------- at random


@pytest.mark.parametrize("storage", STORAGES)
def test_whatever_is_damaged(make_bag, scene, tmp_path, storage):
    rng = random.Random(13)
    good = [f.read_bytes() for f in sorted(make_bag(storage=storage, name="good").iterdir())]
    slow = scene.with_values({"rate": 20.0})  # bit errors make gaps of minutes
    refused = damaged = replayed = 0
    for number in range(40):
        path = make_bag([], storage=storage, name=f"bag_{number}")
        for file, data in zip(sorted(path.iterdir()), good, strict=True):
            file.write_bytes(data)
        for _ in range(rng.choice([1, 1, 3])):
            damage_bag(rng, path)
        try:
            bag, _ = read(path)
            damaged += bool(bag.damage)
            replay_bag(path, slow, None, simulator_factory=FakeSimulator)
            replayed += 1
        except (BagError, ReplayError) as refusal:
            assert str(refusal).isprintable()
            refused += 1
    assert refused + replayed == 40 and replayed > 15 and damaged > 10
