"""A disk that fills up while a bag is written: what was good is kept, one line, exit status 3."""

import json
import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from dlo_sim.cli.main import main
from dlo_sim.replay.bags import Bag, BagError, BagWriter
from dlo_sim.session import cdr
from dlo_sim.tuning.scene_file import scene_text

STORAGES = ["mcap", "sqlite3"]


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Files may not grow beyond so many bytes; to programs it looks like a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("storage", STORAGES)
def test_what_was_written_is_kept(make_bag, long_recording, scene, tmp_path, capsys, storage):
    bag = make_bag(long_recording, storage=storage)
    file = tmp_path / "scene.yaml"
    file.write_text(scene_text(scene, []))
    arguments = ["replay", str(bag), "--params", str(file), "--output"]
    assert main([*arguments, str(tmp_path / "whole")]) == 0
    capsys.readouterr()
    with room_for(600_000):
        status = main([*arguments, str(tmp_path / "out"), "--json"])
    assert status == 3
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["status"] == "unwritten"
    assert "out is not whole" in summary["message"] and "\n" not in summary["message"]
    with Bag(tmp_path / "out") as kept_bag:
        assert summary["messages_written"] == kept_bag.count
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out", "recorded", "scene.yaml", "whole"]

    def states(path):
        with Bag(path) as found:
            return [m[2:] for m in found.messages({"/dlo_sim/control_points": cdr.POSE_ARRAY})]

    kept, whole = states(tmp_path / "out"), states(tmp_path / "whole")
    assert 200 < len(kept) < len(whole)
    assert kept == whole[: len(kept)]


def test_a_disk_that_is_full_from_the_start_is_refused(tmp_path):
    topics = {"/wrench": cdr.WRENCH_STAMPED}
    with pytest.raises(BagError, match="bag cannot be written"), room_for(0):
        BagWriter(tmp_path / "bag", topics, "sqlite3")
    assert not list(tmp_path.iterdir())
