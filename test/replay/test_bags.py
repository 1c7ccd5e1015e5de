"""Reading and writing bags, whole and damaged."""

import numpy as np
import pytest
from bag_files import SECOND, STORAGES, TOPICS, cut, data_file, read

from dlo_sim.replay.bags import Bag, BagError, BagWriter


@pytest.mark.parametrize("storage", STORAGES)
def test_what_is_written_is_read(make_bag, recorded, storage):
    bag, found = read(make_bag(storage=storage))
    assert sorted(found) == sorted(recorded)
    assert [m[1] for m in found] == [m[1] for m in recorded]
    assert (bag.storage, bag.damage, bag.promised) == (storage, "", len(recorded))
    assert bag.topics == {topic: (kind,) for topic, kind in TOPICS.items()}


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", [0.35, 0.5, 0.777, 0.97])
def test_a_bag_cut_off_is_read_as_far_as_it_goes(make_bag, long_recording, storage, share):
    path = make_bag(long_recording, storage=storage)
    cut(path, share)
    bag, found = read(path)
    assert 0.3 * share * len(long_recording) < len(found) <= len(long_recording)
    assert found == sorted(found, key=lambda m: m[1])
    assert set(found) <= set(long_recording)  # whole messages only
    assert bag.damage
    assert "\n" not in bag.damage
    assert bag.promised == len(long_recording)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_of_which_nothing_is_left_is_refused(make_bag, storage):
    path = make_bag(storage=storage)
    cut(path, 0.01)
    with pytest.raises(BagError, match="cannot be read"):
        Bag(path)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_recorder_that_was_killed_leaves_no_metadata(make_bag, recorded, storage):
    path = make_bag(storage=storage)
    (path / "metadata.yaml").unlink()
    bag, found = read(path)
    assert len(found) == len(recorded)
    assert "metadata" in bag.damage


def at(*seconds):
    return [("/wrench", 1000 * SECOND + round(second * SECOND), b"load") for second in seconds]


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_written_a_little_late_are_sorted(make_bag, storage):
    bag, found = read(make_bag(at(*range(30), 20.5, *range(30, 40)), storage=storage))
    assert found == sorted(at(*range(40), 20.5))
    assert bag.damage == ""


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("lost", [at(-900), at(2.5), at(3600)])
def test_a_message_of_another_time_does_not_keep_all_others_waiting(make_bag, storage, lost):
    """All would have to be in memory before the first is known to be the first."""
    bag, found = read(make_bag([*at(*range(30)), *lost, *at(*range(30, 40))], storage=storage))
    assert [m for m in found if m not in lost] == at(*range(40))
    assert len(found) == 41
    assert found.index(lost[0]) == (40 if lost == at(3600) else 20)
    assert "s out of order, 10 s can be sorted" in bag.damage


def test_compressed_chunks_are_salvaged(tmp_path):
    random = np.random.default_rng(1)  # many blocks of the compressor in one chunk
    recorded = [("/wrench", 1000 + k, random.bytes(100)) for k in range(6000)]
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    path = tmp_path / "compressed"
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        connections = {t: writer.add_connection(t, k, typestore=store) for t, k in TOPICS.items()}
        for topic, time_ns, data in recorded:
            writer.write(connections[topic], time_ns, data)
    file = data_file(path)
    assert len(read(file)[1]) == len(recorded)
    cut(path, 0.5)
    found = read(file)[1]
    assert 2000 < len(found) < len(recorded)
    assert found == recorded[: len(found)]


@pytest.mark.parametrize("name", ["x.mcap", "x.db3"])
@pytest.mark.parametrize("content", [b"", b"nonsense" * 100, b"\x89MCAP0\r\n\x06\xff\xff"])
def test_files_that_are_no_bags(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match="cannot be read"):
        Bag(tmp_path / name)


def test_paths_that_are_no_bags(tmp_path):
    with pytest.raises(BagError, match="does not exist"):
        Bag(tmp_path / "missing")
    with pytest.raises(BagError, match="no .mcap or .db3 file in it"):
        Bag(tmp_path)
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(BagError, match="is not a bag"):
        Bag(tmp_path / "notes.txt")


class TestWriter:
    def test_refuses_a_place_that_is_taken(self, tmp_path):
        (tmp_path / "taken").mkdir()
        with pytest.raises(BagError, match="exists"):
            BagWriter(tmp_path / "taken", TOPICS, "mcap")
        assert [p.name for p in tmp_path.iterdir()] == ["taken"]

    @pytest.mark.parametrize("place", ["file/bag", "missing/bag"])
    def test_refuses_a_place_that_cannot_be_written(self, tmp_path, place):
        (tmp_path / "file").write_text("")
        with pytest.raises(BagError, match="does not exist; create it first"):
            BagWriter(tmp_path / place, TOPICS, "mcap")
        assert [p.name for p in tmp_path.iterdir()] == ["file"]
