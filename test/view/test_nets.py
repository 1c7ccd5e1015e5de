"""Nets to look at: cables and connectors of a recording and of a bag, in colours of their own."""

import json

import numpy as np
import pytest
from harness import TOPICS, VALUES, feed, harness, told

from dlo_sim.cli.main import main
from dlo_sim.core.color_scale import STRANDS
from dlo_sim.replay.bags import BagWriter
from dlo_sim.replay.replay import replay_bag
from dlo_sim.session.session import Session
from dlo_sim.simulation.recording import record
from dlo_sim.view.film import write_film, write_plots, write_still
from dlo_sim.view.page import page_data
from dlo_sim.view.run import TENSION, RunError, read_run

NAMES = ["a", "b", "c"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording made by the command, and the same run."""
    folder = tmp_path_factory.mktemp("net")
    scene = folder / "net.yaml"
    scene.write_text(json.dumps({"/**": {"ros__parameters": VALUES}}))
    path = folder / "net.npz"
    options = ["--duration", "0.3", "--every", "0.05", "--output", str(path)]
    assert main(["simulate", str(scene), *options]) == 0
    return path, record(harness(), 0.3, 0.05)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The output of a replay."""
    folder = tmp_path_factory.mktemp("bags")
    writer = BagWriter(folder / "told", TOPICS, "mcap")
    for topic, time, raw in told(0.0, 1.3):  # with diagnostics, which come once a second
        writer.write(topic, time, raw)
    writer.finish()
    replay_bag(folder / "told", harness(), folder / "out")
    return folder / "out"


def test_recording_has_every_cable_and_connector(recorded):
    path, run = recorded
    shown = read_run(path)
    assert [one.name for one in shown.others] == NAMES
    for one in shown.others:
        assert one.centerline == pytest.approx(run.net[f"{one.name}.centerline"], abs=1e-12)
        assert one.colors[TENSION] == pytest.approx(run.net[f"{one.name}.tension"], abs=1e-9)
    root = shown.centerline[:, 0] * 0.0 + run.net["a.centerline"][:, 0]
    assert shown.others[0].centerline[:, 0] == pytest.approx(root)
    (plug,) = shown.connectors
    along = shown.others[1].centerline[:, -1] - shown.others[1].centerline[:, -2]
    middle = plug.at(-1).reshape(-1, 3).mean(axis=0)
    ahead = shown.others[1].centerline[-1, -1] + 0.01 * along[-1] / np.linalg.norm(along[-1])
    assert middle == pytest.approx(ahead, abs=1e-3)
    assert run.peak_tension == max(one.colors[TENSION].max() for one in shown.cables)


def test_bag_has_what_the_session_had(bag):
    session = Session(harness())
    feed(session, 0.0, 1.3)
    stamp = session.stamp_ns * 1e-9
    with_scene, without = read_run(bag, harness()), read_run(bag)
    assert [one.name for one in with_scene.others] == NAMES
    sample = int(np.argmin(np.abs(with_scene.time + 1000.0 - stamp)))
    for one, alike in zip(with_scene.cables, without.cables, strict=True):
        curve = session.simulator.strand(one.name)
        line = curve.points(np.linspace(0.0, curve.length, 60))
        assert one.centerline[sample] == pytest.approx(line, abs=1e-12)
        assert alike.centerline == pytest.approx(one.centerline, abs=1e-12)
        assert TENSION in one.colors and TENSION not in alike.colors
    assert len(with_scene.connectors) == 3  # a cylinder and two caps
    assert set(with_scene.reactions) >= {"branches/a/end", "cables/c/start", "clip"}


def test_bag_of_another_net_is_refused(bag):
    other = harness().with_values({"cables.names": []})
    with pytest.raises(RunError, match=r"has the cables cable, a, b, c, the scene cable, a, b;"):
        read_run(bag, other)


def test_recording_without_a_part_of_a_cable_is_refused(recorded, tmp_path):
    arrays = dict(np.load(recorded[0]))
    del arrays["b.control_points"]
    np.savez(tmp_path / "run.npz", **arrays)
    with pytest.raises(RunError, match="b: has no control_points; make it with dlo_sim simulate"):
        read_run(tmp_path / "run.npz")


def test_page_has_all_cables(recorded):
    data = page_data(read_run(recorded[0]))
    assert data["names"] == ["cable", *NAMES]
    assert [one["controls"] for one in data["others"]] == [7, 8, 5]
    assert [body["color"] is None for body in data["bodies"]] == [False]
    shown = read_run(recorded[0])
    values = np.concatenate([one.colors[TENSION].ravel() for one in shown.cables])
    assert (data["colors"][0]["low"], data["colors"][0]["high"]) == (values.min(), values.max())


def test_pictures_have_the_colours_of_all_cables(recorded, tmp_path):
    from matplotlib.image import imread

    run = read_run(recorded[0])
    for name, write in (("still", write_still), ("plots", write_plots)):
        write(run, tmp_path / name)
        pixels = imread(tmp_path / name, format="png")[..., :3].reshape(-1, 3)
        for k, color in enumerate(STRANDS[:4]):
            near = np.abs(pixels - color).max(axis=1) < 0.02
            assert near.sum() > 500, f"{name} shows cable {k}"
    write_film(run, tmp_path / "film", "gif")
    assert (tmp_path / "film").stat().st_size > 10_000
