"""A disk that fills up while a bag is written: what was good is kept, one line, exit status 3."""

import json

import pytest
from bag_files import STORAGES

from dlo_sim.cli.main import main
from dlo_sim.replay.bags import Bag, BagError, BagWriter
from dlo_sim.session import cdr
from dlo_sim.tuning.scene_file import scene_text
from test.disks import mounted, room_for

REASONS = {
    ("file", "mcap"): "File too large",
    ("file", "sqlite3"): "disk I/O error",
    ("disk", "mcap"): "No space left on device",
    ("disk", "sqlite3"): "database or disk is full",
}


@pytest.mark.parametrize("full", ["file", "disk"])
@pytest.mark.parametrize("storage", STORAGES)
def test_what_was_written_is_kept(make_bag, long_recording, scene, tmp_path, capsys, storage, full):
    bag = make_bag(long_recording, storage=storage)
    file = tmp_path / "scene.yaml"
    file.write_text(scene_text(scene, []))
    arguments = ["replay", str(bag), "--params", str(file), "--output"]
    assert main([*arguments, str(tmp_path / "whole")]) == 0
    capsys.readouterr()
    folder = tmp_path / "folder"
    folder.mkdir()

    def states(path):
        return [m[2:] for m in Bag(path).messages({"/dlo_sim/control_points": cdr.POSE_ARRAY})]

    with room_for(600_000) if full == "file" else mounted(folder, 600_000):
        status = main([*arguments, str(folder / "out"), "--json"])
        assert [p.name for p in folder.iterdir()] == ["out"]
        count, kept = Bag(folder / "out").count, states(folder / "out")
    assert status == 3
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["status"] == "output_incomplete"
    reason = REASONS[full, storage]
    assert f"out is incomplete ({reason}); free space and run again" in summary["message"]
    assert "\n" not in summary["message"]
    assert summary["messages_written"] == count
    whole = states(tmp_path / "whole")
    assert 200 < len(kept) < len(whole)
    assert kept == whole[: len(kept)]


def test_a_disk_that_is_full_from_the_start_is_refused(tmp_path):
    topics = {"/wrench": cdr.WRENCH_STAMPED}
    with pytest.raises(BagError, match="bag cannot be written"), room_for(0):
        BagWriter(tmp_path / "bag", topics, "sqlite3")
    assert not list(tmp_path.iterdir())
