"""Runs read back from recordings and bags."""

import numpy as np
import pytest
from made_runs import BOX, EPOCH_NS, write_bag

from dlo_sim.view.page import write_page
from dlo_sim.view.run import CURVATURE, TENSION, Curve, RunError, read_bag, read_run


def test_recording_and_bag_show_the_same_cable(made):
    recorded, bagged = read_run(made.recording), read_run(made.bag, made.scene)
    np.testing.assert_allclose(bagged.time, recorded.time, atol=1e-9)
    for run in (recorded, bagged):
        np.testing.assert_allclose(run.centerline, made.centerline, atol=1e-12)
        np.testing.assert_allclose(run.colors[TENSION], made.tension, atol=1e-6)
    np.testing.assert_allclose(bagged.colors[CURVATURE], recorded.colors[CURVATURE], atol=1e-6)


def test_bag_has_frames_forces_energy_and_the_estimated_error(made):
    run = read_run(made.bag, made.scene)
    np.testing.assert_array_equal(run.frames, made.frames)
    assert run.reactions["start"].shape == (21, 3) and "end" not in run.reactions
    energy, error = run.curves
    assert energy.values["energy"] == pytest.approx(0.1 * np.arange(21))
    assert error.values["error"] == pytest.approx(1e-4 * np.arange(1, 21)), "not what is unknown"
    assert [curve.title for curve in run.plots] == [
        "end of the cable [m]",
        "force on the cable at its start [N]",
        "largest tension [N]",
        "largest curvature [1/m]",
        "energy [J]",
        "error estimate [m]",
    ]


def test_obstacles_and_contact_forces_of_a_recording(made):
    run = read_run(made.recording)
    (body,) = run.bodies
    np.testing.assert_allclose(body.at(7)[0], 0.1 * np.eye(3) + [0.07, 0.1, -0.2])
    assert [len(run.forces_at(k)) for k in (0, 4, 5, 9, 10, 20)] == [0, 0, 1, 1, 1, 0]
    (line,) = run.forces_at(12)
    extent = np.ptp(made.centerline.reshape(-1, 3), axis=0).max()
    np.testing.assert_allclose(line, [[0.0] * 3, [0.0, 0.15 * extent, 0.0]])
    total, clearance = run.curves[-2:]
    assert (total.title, clearance.title) == ("contact force [N]", "clearance [m]")
    assert total.values["total"] == pytest.approx([0.0, 2.0, 2.0, 0.0])
    assert clearance.time == pytest.approx(run.time[[5, 10, 20]]), "not where it is infinite"
    assert clearance.values["least"] == pytest.approx([-1e-3, -1e-3, 0.01])


def test_obstacles_and_contact_forces_of_a_bag(made):
    run = read_run(made.bag)
    boxes = {k: np.concatenate([body.at(k) for body in run.bodies]) for k in (0, 7, 10, 11, 12)}
    assert [len(boxes[k]) for k in boxes] == [12, 12, 12, 12, 0]
    corners = boxes[7].reshape(-1, 3)  # as published last, at the time before
    np.testing.assert_allclose(np.ptp(corners, axis=0), BOX)
    np.testing.assert_allclose(corners.mean(axis=0), [0.26, 0.0, -0.15], atol=1e-9)
    np.testing.assert_allclose(run.forces_at(20), [[[2.0, 0.0, 0.0], [2.0, 0.0, 0.05]]])


def test_a_constant_with_its_round_off_looks_constant():
    noise = 1e-15 * np.array([1.0, -1.0, 3.0])
    low, high = Curve("force [N]", np.arange(3.0), {"x": 0.2 + noise}).limits
    assert high - low > 1e8 * np.ptp(noise) and low < 0.2 < high
    assert Curve("force [N]", np.arange(3.0), {"x": np.zeros(3)}).limits == (-1.0, 1.0)
    huge = Curve("force [N]", np.arange(3.0), {"x": np.array([1e308, -1e308, np.nan])}).limits
    assert np.isfinite(huge).all()
    moving = Curve("end [m]", np.arange(3.0), {"x": np.arange(3.0), "y": -np.arange(3.0)})
    assert moving.limits == pytest.approx((-2.2, 2.2))


def test_bag_without_a_scene_has_no_tension(made):
    run = read_bag(made.bag, origin_ns=EPOCH_NS - 10**9)
    assert list(run.colors) == [CURVATURE]
    assert run.time[0] == pytest.approx(1.0)
    np.testing.assert_allclose(run.centerline, made.centerline, atol=1e-12)


def test_bag_of_another_node_by_its_name(made, tmp_path):
    state = np.cumsum(np.ones((7, 7)), axis=0)
    write_bag(tmp_path / "left", [state] * 2, [(0.0,) * 6] * 2, "/left/dlo_sim")
    assert len(read_run(tmp_path / "left", node="/left/dlo_sim").time) == 2
    with pytest.raises(RunError, match="/dlo_sim/control_points holds no message"):
        read_run(tmp_path / "left", node="/dlo_sim")


def test_scene_of_another_run_is_refused(made):
    other = made.scene.with_values({"discretization.control_points": 9})
    with pytest.raises(RunError, match="has 7 control points, the scene 9; give the scene of that"):
        read_run(made.bag, other)


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        (None, "cannot be read"),
        ({}, "has no time of a run"),
        ({"time": np.zeros(3)}, "has no control_points of a run"),
        ({"time": np.zeros(0), "control_points": np.zeros((0, 4, 4))}, "has no time of a run"),
        ("npy", "cannot be read"),
    ],
)
def test_file_that_holds_no_run_is_refused(tmp_path, arrays, complaint):
    path = tmp_path / "run.npz"
    if arrays is None:
        path.write_bytes(b"not an npz")
    elif arrays == "npy":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    else:
        np.savez(path, **arrays)
    with pytest.raises(RunError, match=complaint):
        read_run(path)


@pytest.mark.parametrize(
    ("key", "spoil", "complaint"),
    [
        ("time", lambda time: time.astype(str), "time: needs a list of finite numbers"),
        ("time", lambda time: time * np.nan, "time: needs a list of finite numbers"),
        ("time", lambda time: time[::-1], "time: needs to rise, got"),
        ("time", lambda time: time * 0.0, "time: needs to rise, got"),
        ("centerline", lambda line: line[..., :2], "centerline: needs finite numbers of shape"),
        ("centerline", lambda line: line * np.nan, "centerline: needs finite numbers of shape"),
        ("centerline", lambda line: line + 1j, "centerline: needs finite numbers of shape"),
        ("centerline", lambda line: line + 1e300, "centerline: needs numbers up to"),
        ("control_points", lambda points: points * np.nan, "control_points: needs finite numbers"),
        ("control_points", lambda points: points[:2], "control_points: needs finite numbers"),
        ("tension", lambda tension: tension * np.nan, "tension: needs finite numbers of shape"),
        ("tension", lambda tension: tension[:, :3], "tension: needs finite numbers of shape"),
        ("curvature", lambda curvature: curvature[:3], "curvature: needs finite numbers of shape"),
        ("energy", lambda energy: energy[:3], "energy: needs"),
        ("obstacle_of", lambda numbers: np.zeros(2), "obstacle_of: needs 1 finite numbers"),
        ("contact_points", lambda points: points[:1], "contact_forces: needs finite numbers"),
        ("contact_forces", lambda forces: forces[:1], "contact_forces: needs finite numbers"),
        ("contact_samples", lambda samples: samples[:1], "contact_samples: needs 2 finite numbers"),
        ("contact_samples", lambda samples: samples[:, None], "contact_samples: needs 2 finite"),
        ("contact_looks", lambda looks: looks[:0], "contact_total: needs 0 finite numbers"),
        ("contact_looks", lambda looks: looks[::-1], "contact_looks: needs rising numbers of the"),
        ("contact_looks", lambda looks: looks + 0.5, "contact_looks: needs rising numbers of the"),
        ("contact_looks", lambda looks: looks + 1.0, "contact_looks: needs rising numbers of the"),
        ("contact_total", lambda total: total[:2], "contact_total: needs 4 finite numbers"),
        ("contact_clearance", lambda gaps: gaps[:2], "contact_clearance: needs 4 finite numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_their_key(made, tmp_path, key, spoil, complaint):
    with np.load(made.recording) as file:
        arrays = dict(file)
    path = tmp_path / "run.npz"
    np.savez(path, **{**arrays, key: spoil(arrays[key])})
    with pytest.raises(RunError, match=f"^{path}: {complaint}.*; make it with dlo_sim simulate"):
        read_run(path)


def test_bag_of_a_state_that_is_not_finite_is_refused(tmp_path):
    states = [np.cumsum(np.ones((7, 7)), axis=0)] * 3
    states[1] = states[0] * np.nan
    write_bag(tmp_path / "bag", states, [(0.0,) * 6] * 3, "/dlo_sim")
    with pytest.raises(
        RunError, match="/dlo_sim/control_points: the message 0.02 s after the first"
    ):
        read_run(tmp_path / "bag")


def test_folder_that_is_no_bag_is_refused(tmp_path):
    with pytest.raises(RunError, match="bag"):
        read_run(tmp_path)


STRAIGHT = np.hstack([np.linspace(0.0, 0.4, 7)[:, None] * [1.0, 0.0, 0.0], np.zeros((7, 4))])


@pytest.mark.parametrize(
    ("state", "force", "complaint"),
    [
        (np.zeros((7, 7)), 0.0, r"curvature \[1/m\] is nan at 0 s, which cannot be shown"),
        (STRAIGHT[:0], 0.0, "holds 0 control points, a cable has 4 or more"),
        (STRAIGHT[:1], 0.0, "holds 1 control points, a cable has 4 or more"),
        (STRAIGHT[:3], 0.0, "holds 3 control points, a cable has 4 or more"),
        (STRAIGHT, 1e308, r"force at the start \[N\] is 1e\+308 at 0 s, which cannot be shown"),
        (STRAIGHT, -np.inf, r"force at the start \[N\] is -inf at 0 s, which cannot be shown"),
        (STRAIGHT * 1e-200, 0.0, r"curvature \[1/m\] is .* at 0 s, which cannot be shown"),
    ],
)
def test_bag_that_cannot_be_shown_is_refused_in_one_line(tmp_path, state, force, complaint):
    write_bag(tmp_path / "bag", [state] * 2, [(force,) * 6] * 2, "/dlo_sim")
    with pytest.raises(RunError, match=complaint) as refused:
        read_run(tmp_path / "bag")
    assert str(refused.value).startswith(str(tmp_path)) and "; give a bag of a run" in str(
        refused.value
    )


def test_tension_that_cannot_be_shown_is_refused(made, tmp_path):
    state = STRAIGHT * 1e38
    write_bag(tmp_path / "bag", [state] * 2, [(0.0,) * 6] * 2, "/dlo_sim")
    with pytest.raises(RunError, match=r"tension \[N\] is .* at 0 s, which cannot be shown"):
        read_run(tmp_path / "bag", made.scene)


def test_names_that_are_not_utf8_are_written_out(made, tmp_path):
    place = tmp_path / b"\xff.npz".decode("utf-8", "surrogateescape")
    place.write_bytes(made.recording.read_bytes())
    run = read_run(place)
    assert run.name == r"\udcff.npz"
    write_page(run, tmp_path / "page.html")
