"""Recordings from bags and files, and a real one."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_cables import TRUTH, bag_of, recorded

from dlo_sim.cli.main import main
from dlo_sim.identification.measurement import MeasurementError, poses_of_two_markers
from dlo_sim.identification.prediction import predict, score
from dlo_sim.identification.readers import read_recordings
from dlo_sim.scene.loading import load_scene
from dlo_sim.session import cdr

ROOT = Path(__file__).resolve().parents[2]
PLACE = Path(os.environ.get("DLO_SIM_DATA", ROOT.parent / "shared" / "data" / "real"))


@pytest.mark.parametrize("kind", [cdr.POSE_ARRAY, cdr.MARKER_ARRAY, cdr.POINT_CLOUD])
def test_a_bag_gives_the_recording(moving, tmp_path, kind):
    given = moving[0].pieces(0.25)[0]
    (found,) = read_recordings(bag_of(tmp_path / "bag", given, kind))
    assert np.abs(found.markers - given.markers).max() < 1e-6
    assert np.abs(found.times - given.times).max() < 1e-9
    for end in ("start", "end"):
        assert np.abs(found.poses[end] - given.poses[end]).max() < 1e-9
    assert np.abs(found.shares - given.shares).max() < 0.01
    assert found.known["cable.length"] == pytest.approx(1.0, rel=0.03)


def test_the_command_writes_a_scene_that_predicts(moving, tmp_path, capsys):
    bag = bag_of(tmp_path / "bag", moving[0], cdr.POSE_ARRAY)
    output = tmp_path / "fitted.yaml"
    words = [f"{key}={value}" for key, value in TRUTH.items() if "bending" not in key]
    words += ["start.clamped=true", "end.clamped=true", "end.fixed=[true, true, true]"]
    words += ["start.tangent=[-1.0, 0.0, 0.0]", "end.tangent=[-1.0, 0.0, 0.0]"]
    asked = [part for word in words for part in ("--set", word)]
    status = main(
        ["identify", str(bag), "--scene", "two_grippers", "--output", str(output), *asked]
        + ["--fit", "cable.bending_stiffness", "--leave-out", "0"]
    )
    assert status == 0, capsys.readouterr().err
    assert "cable.bending_stiffness" in capsys.readouterr().out
    assert " --fit cable.bending_stiffness --set " in output.read_text(encoding="utf-8")
    scene = load_scene(output)
    assert scene.cable.bending_stiffness == pytest.approx(2e-3, rel=0.1)


def test_plots_without_matplotlib_are_refused_before_the_fit(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name in ("dlo_sim.cli.residuals", "dlo_sim.studies.report"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    output = tmp_path / "fitted.yaml"
    words = ["identify", "missing.npz", "--scene", "two_grippers", "--output", str(output)]
    assert main([*words, "--plots", str(tmp_path)]) == 2
    assert "--plots needs matplotlib" in capsys.readouterr().err


LINE = np.zeros((1, 4, 6, 3))
LINE[..., 0] = np.linspace(0.0, 1e6, 6)
# The two frames and two markers that are missing where only the grippers are seen at first.
LATE = np.outer(np.arange(4) < 2, np.arange(6) % 4 > 1)[..., None]
GIVEN = {"pos_um": LINE, "rate_hz": 100, "clamped": [0, 1, -2, -1], "length_m": 0.8, "mass_g": 30}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"pos_um": np.full_like(LINE, np.nan)}, "pos_um: points 0 and 1 .* leave one"),
        ({"pos_um": np.zeros_like(LINE)}, "pos_um: points 0 and 1 .* leave one"),
        ({"pos_um": 1e200 * LINE}, r"pos_um: 1e\+200 m is no place of a marker; give at most"),
        ({"pos_um": LINE + [np.inf, 0, 0]}, "pos_um: inf m is no place of a marker; give"),
        ({"pos_um": LINE[:, :1]}, "pos_um: run piece 0: 1 frames; give 3 or more"),
        ({"pos_um": LINE[:, :2]}, "pos_um: run piece 0: 2 frames; give 3 or more"),
        ({"pos_um": LINE[:0]}, "pos_um: has shape .*; give numbers"),
        ({"pos_um": LINE.astype(str)}, "pos_um: holds <U32; give numbers"),
        ({"pos_um": LINE + 1j}, "pos_um: holds complex128; give numbers"),
        (
            {"pos_um": np.where(np.arange(4)[:, None, None] == 2, np.nan, LINE)},
            "pos_um: the markers on the gripper of the start are missing .* frame 2; give two",
        ),
        (
            {"pos_um": np.where(LATE, np.nan, LINE)},
            "pos_um: run piece 0: no marker is known in the first 2 frames",
        ),
        *(({"rate_hz": rate}, "rate_hz: ") for rate in (0, -5, np.nan, [1, 2, 3], "abc")),
        *(({"length_m": length}, "length_m: .* give 0.01 to 1000") for length in (0, -1, 1e9)),
        ({"length_m": 3.0}, "length_m: 3 m, but pos_um gives 0.8 m along the markers; correct"),
        *(({"mass_g": mass}, "mass_g: .* give 0.001 to 100000") for mass in (0, 1e30)),
        ({"clamped": [0, 1, 99, 100]}, r"clamped: \[0.0, 1.0, 99.0, 100.0\]; give"),
    ],
)  # fmt: skip
def test_data_that_cannot_be_are_refused_by_their_key(tmp_path, changes, words):
    path = tmp_path / "run.npz"
    np.savez(path, **GIVEN)
    assert read_recordings(path)[0].known["cable.length"] == pytest.approx(0.8)
    np.savez(path, **{**GIVEN, **changes})
    with pytest.raises(MeasurementError, match=f"^{path}: {words}"):
        read_recordings(path)


def test_pieces_keep_the_frames_that_a_start_needs(moving):
    assert min(len(part.times) for part in moving[0].pieces(0.01)) == 3


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("start", np.nan, "/start_pose: .* is not finite; repair"),
        ("markers", np.inf, "/markers: inf m is no place of a marker; give"),
        ("markers", 1e9, r"/markers: 1e\+09 m is no place of a marker; give"),
    ],
)
def test_bags_that_cannot_be_are_refused_by_their_topic(moving, tmp_path, part, value, words):
    given = moving[0].pieces(0.25)[0]
    markers, poses = given.markers.copy(), dict(given.poses)
    if part == "markers":
        markers[2:] = value
    else:
        poses[part] = value * poses[part]
    folder = bag_of(tmp_path / "bag", replace(given, markers=markers, poses=poses), cdr.POSE_ARRAY)
    with pytest.raises(MeasurementError, match=f"^{folder}: {words}"):
        read_recordings(folder)


def test_a_message_that_is_cut_is_refused_with_its_topic_and_a_cure(moving, tmp_path):
    given = moving[0].pieces(0.25)[0]
    folder = bag_of(tmp_path / "bag", given, cdr.POINT_CLOUD, cut=40)
    with pytest.raises(MeasurementError, match="a message on /markers: .*; repair the recording"):
        read_recordings(folder)


@pytest.mark.parametrize(
    ("fill", "words"),
    [
        (lambda file: Path(file.name).unlink(), "does not exist"),
        (lambda file: np.savez(file, pos_um=LINE), "has no rate_hz"),
        (lambda file: np.save(file, LINE), "cannot be read .*; give a .npz file"),
        (lambda file: None, "cannot be read .*; give a .npz file"),
        (lambda file: file.write(b"text"), "cannot be read .*; give a .npz file"),
    ],
)
def test_files_that_hold_no_recording_are_refused(tmp_path, fill, words):
    path = tmp_path / "run.npz"
    with path.open("wb") as file:
        fill(file)
    with pytest.raises(MeasurementError, match=words) as refused:
        read_recordings(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("way", [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.3, -0.5, 0.8]])
def test_the_cable_leaves_a_gripper_towards_the_next_marker(tmp_path, way):
    """And comes to the last one from the markers before: tangents point from start to end."""
    from dlo_sim.core import rotations

    way = np.array(way) / np.linalg.norm(way)
    line = LINE[..., :1] * way
    np.savez(tmp_path / "line.npz", **(GIVEN | {"pos_um": line}))
    (recording,) = read_recordings(tmp_path / "line.npz")
    for end in ("start", "end"):
        tangent = np.array(recording.known[f"{end}.tangent"])
        assert rotations.rotate(recording.poses[end][0, 3:], tangent) == pytest.approx(way)


def test_two_markers_turn_a_gripper_without_roll():
    angle = np.linspace(0.0, 1.0, 50)
    away = np.stack([np.sin(angle), 0.0 * angle, -np.cos(angle)], axis=-1)
    poses = poses_of_two_markers("start", np.zeros((50, 3)), 0.02 * away)
    assert np.abs(poses[:, :3] - 0.01 * away).max() < 1e-12
    # About y only: x and z of the quaternion's turn from the first frame vanish.
    from dlo_sim.core import rotations

    turn = rotations.multiply(poses[:, 3:], rotations.conjugate(poses[0, 3:]))
    assert np.abs(turn[:, [0, 2]]).max() < 1e-12


def test_pieces_of_a_long_recording():
    long = recorded(TRUTH, duration=2.5)
    parts = long.pieces(1.0)
    assert len(parts) == 2
    assert [part.times[0] for part in parts] == [0.0, 0.0]
    assert sum(len(part.times) for part in parts) == len(long.times)


@pytest.mark.skipif(
    not (PLACE / "deform_dlo").is_dir(),
    reason=f"no recordings in {PLACE}: set DLO_SIM_DATA to the folder that holds deform_dlo",
)
@pytest.mark.parametrize(
    ("cable", "most"), [("DLO1", 0.95), ("DLO2", 0.4), ("DLO3", 0.4), ("DLO4", 0.58)]
)
def test_fitted_scenes_predict_a_recorded_cable(cable, most):
    scene = load_scene(ROOT / "config" / "cables" / f"{cable}.yaml", {"initial.shape": "straight"})
    pieces = read_recordings(PLACE / "deform_dlo" / f"{cable}_calib.npz")[:4:2]
    errors = [1e2 * score(piece, predict(scene, piece).markers).l1 for piece in pieces]
    assert np.mean(errors) < most
