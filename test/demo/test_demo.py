"""The demo end to end: what it writes, what it refuses, what it does without matplotlib."""

import sys

import numpy as np
import pytest

from dlo_sim.cli.main import main
from dlo_sim.demo import scenario
from dlo_sim.demo.demo import DemoError, run_demo
from dlo_sim.replay.bags import Bag
from dlo_sim.scene.loading import load_scene
from dlo_sim.view.run import read_bag
from test.disks import mounted

RESULTS = ["input", "motion.html", "motion.png", "predicted", "scene.yaml"]
DURATION = 2.0


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A demo of two seconds and its summary."""
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    fractions: list[float] = []
    summary = run_demo(folder, duration=DURATION, progress=fractions.append)
    return folder, summary, fractions


def test_demo_leaves_a_bag_a_page_a_picture_and_a_scene(done):
    pytest.importorskip("matplotlib")
    folder, summary, fractions = done
    assert (summary.status, summary.message, summary.notes) == ("done", "", [])
    assert summary.ok
    assert sorted(path.name for path in folder.iterdir()) == RESULTS
    picture = (folder / "motion.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 20_000
    assert summary.picture == str(folder / "motion.png")
    assert summary.page == str(folder / "motion.html")
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_predicted_bag_holds_what_the_node_publishes(done):
    folder, summary, _ = done
    bag = Bag(folder / "predicted")
    assert set(bag.topics) == {
        *("/dlo_sim/control_points", "/dlo_sim/centerline", "/dlo_sim/control_polygon"),
        *("/dlo_sim/start/reaction", "/dlo_sim/contacts", "/diagnostics"),
    }
    assert bag.promised == summary.messages_written > 400
    assert summary.messages_used == 201 + 401
    assert summary.simulated_s == pytest.approx(DURATION, abs=0.05)


def test_prediction_starts_at_the_gripper_and_carries_the_weight(done):
    folder, summary, _ = done
    scene = load_scene(folder / "scene.yaml")
    found = read_bag(folder / "predicted", scene, origin_ns=scenario.EPOCH_NS)
    assert len(found.time) > 300
    assert (np.diff(found.time) > 0.0).all()
    gripper, _ = scenario.gripper_pose(found.time)
    assert np.ptp(gripper[:, 1]) > 0.05, "the gripper must have moved"
    np.testing.assert_allclose(found.centerline[:, 0], gripper, atol=1e-3)
    lengths = np.linalg.norm(np.diff(found.centerline, axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=0.01)
    weight = 0.09 * 9.81
    np.testing.assert_allclose(found.reactions["start"][0], [0.0, 0.0, weight], atol=0.05)
    assert summary.reaction_rest == pytest.approx(weight, abs=0.05)
    assert summary.reaction_max >= summary.reaction_rest
    assert 0.1 < summary.tip_speed_max < 10.0


def test_the_cable_is_drawn_over_the_edge_of_the_table(done):
    """The edge is at y = 0.1 m, z = 0.515 m. Nothing is in the table; it holds the cable back."""
    folder, _, _ = done
    scene = load_scene(folder / "scene.yaml")
    found = read_bag(folder / "predicted", scene, origin_ns=scenario.EPOCH_NS)
    assert len(found.bodies) == 1
    lines = np.concatenate([found.forces_at(frame) for frame in range(len(found.time))])
    assert len(lines) > 100
    np.testing.assert_allclose(lines[:, 0].mean(axis=0)[1:], [0.1, 0.515], atol=0.02)
    y, z = found.centerline[..., 1], found.centerline[..., 2]
    assert not ((y > 0.105) & (abs(z - 0.5) < 0.01)).any()
    assert found.reactions["start"][:, 1].max() > 0.2


def test_demo_again_replaces_its_own_results_with_the_same(done):
    folder, _, _ = done
    before = {name: (folder / name).read_bytes() for name in files(folder)}
    run_demo(folder, duration=DURATION)
    after = {name: (folder / name).read_bytes() for name in files(folder)}
    assert {name for name in before if name.startswith("predicted")}, "something is compared"
    assert before == after


def files(folder) -> list[str]:
    return [str(p.relative_to(folder)) for p in folder.rglob("*") if p.suffix in (".mcap", ".yaml")]


def test_commands_to_try_next_name_files_that_exist(done):
    folder, summary, _ = done
    command = summary.try_next["a stiffer cable"].split()
    assert command[:3] == ["dlo_sim", "replay", str(folder / "input")]
    assert (folder / "input" / "metadata.yaml").is_file()
    assert command[command.index("--params") + 1] == str(folder / "scene.yaml")
    assert summary.try_next["live"].endswith(str(folder / "scene.yaml"))


def test_without_matplotlib_the_bag_is_there_and_the_cure_is_named(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "dlo_sim.demo.picture", raising=False)
    for name in ("matplotlib", "matplotlib.axes"):
        monkeypatch.setitem(sys.modules, name, None)
    summary = run_demo(tmp_path, duration=0.3)
    assert summary.ok and summary.picture == ""
    assert summary.notes == ["no picture: matplotlib is missing; pip install matplotlib"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({*RESULTS} - {"motion.png"})


def test_a_picture_is_whole_or_absent(tmp_path, monkeypatch):
    def full(prediction, gripper, hand, path):
        path.write_bytes(b"\x89PNG")
        raise OSError(28, "No space left on device")

    pytest.importorskip("matplotlib")
    monkeypatch.setattr("dlo_sim.demo.picture.draw_motion", full)
    with pytest.raises(OSError, match="No space"):
        run_demo(tmp_path, duration=0.3)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({*RESULTS} - {"motion.png"})


def test_folder_with_something_else_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DemoError, match=r"holds thesis\.tex, .* give an empty or a new folder"):
        run_demo(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_folder_of_a_demo_to_which_something_was_added_is_refused(done):
    folder, _, _ = done
    extra = folder / "predicted_by_hand.csv"
    extra.write_text("0.0\n")
    try:
        with pytest.raises(DemoError, match="holds predicted_by_hand.csv"):
            run_demo(folder)
        assert (folder / "predicted" / "metadata.yaml").is_file()
    finally:
        extra.unlink()


def test_folder_with_names_of_a_demo_but_not_of_a_demo_is_refused(tmp_path):
    (tmp_path / "input").mkdir()
    (tmp_path / "scene.yaml").write_text("/**: {}\n")
    with pytest.raises(DemoError, match="holds input"):
        run_demo(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["input", "scene.yaml"]


def test_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "demo", "/proc/demo"):
        with pytest.raises(DemoError, match="cannot be written .*; choose another folder"):
            run_demo(folder)


@pytest.mark.parametrize(
    ("size", "refused", "left"),
    [
        (8_192, "input is incomplete (No space left on device) and was removed", []),
        (110_000, "predicted is incomplete (No space left on device) and was removed", ["input"]),
        (2100000, "motion.html: No space left on device", ["input", "predicted"]),
    ],
)
def test_full_disk_leaves_whole_files_and_one_line(
    tmp_path, monkeypatch, capsys, size, refused, left
):
    monkeypatch.setattr(scenario, "DURATION", DURATION)
    monkeypatch.setattr(run_demo, "__kwdefaults__", {"duration": DURATION, "progress": None})
    with mounted(tmp_path, size):
        assert main(["demo", "--output", str(tmp_path / "out")]) == 3
        assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [*left, "scene.yaml"]
        for bag in left:
            assert Bag(tmp_path / "out" / bag).damage == ""
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("dlo_sim: error: ") and refused in err and "; free space" in err
    assert err.count("\n") == 1
