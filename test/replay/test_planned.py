"""Planned motions from files: bags of trajectories or poses, YAML, npz; what is refused."""

import json

import numpy as np
import pytest
from bag_files import MS, SECOND, T0
from plans import trajectory

from dlo_sim import Plan, Simulator
from dlo_sim.cli.main import main
from dlo_sim.replay.planned import PlanError, read_plan
from dlo_sim.scene.loading import load_scene
from dlo_sim.session import cdr
from dlo_sim.view.run import read_run

TIMES = 0.05 * np.arange(13)
PLANNED = {"/planner": cdr.TRAJECTORY}
CHANGES = {"end.pose_topic": "/end", "end.pose_type": "two_points", "end.fixed": [True] * 3}


def poses(side=1.0):
    """A gripper that swings, with times that are exact in nanoseconds."""
    rows = np.zeros((len(TIMES), 7))
    rows[:, 0] = side * 0.05 * np.sin(4.0 * TIMES)
    rows[:, 2], rows[:, 6] = 0.5, 1.0
    return rows


def planned(joints=("start",), shift=0.0):
    """A message as a planner sends it; each joint 0.3 m below the one before."""
    moved = [poses() + [shift, 0.0, -0.3 * k, 0.0, 0.0, 0.0, 0.0] for k in range(len(joints))]
    times_ns = [round(time * SECOND) for time in TIMES]
    return trajectory(joints, times_ns, np.stack(moved, axis=1), T0)


def recorded():
    """The same motion of the start, recorded, later than its stamps say."""
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    stamps = [T0 + round(time * SECOND) for time in TIMES]
    return [
        ("/gripper_pose", stamp + 30 * MS, encoder.encode(stamp, tuple(pose)))
        for stamp, pose in zip(stamps, poses(), strict=True)
    ]


@pytest.fixture
def given(scene, make_bag, tmp_path):
    """given(kind) -> a file with the motion of the start."""

    def make(kind):
        if kind == "trajectory":
            return make_bag([("/planner", T0, planned())], PLANNED)
        if kind == "poses":
            return make_bag(recorded(), {"/gripper_pose": cdr.POSE_STAMPED})
        path = tmp_path / f"plan.{kind}"
        if kind == "npz":
            np.savez(path, times=TIMES, start=poses())
        else:
            path.write_text(json.dumps({"times": TIMES.tolist(), "start": poses().tolist()}))
        return path

    return make


@pytest.mark.parametrize("kind", ["trajectory", "poses", "npz", "yaml"])
def test_each_kind_of_file_gives_the_bits_of_the_plan(given, scene, kind):
    plan = read_plan(given(kind), scene)
    assert np.allclose(plan.times, TIMES, rtol=0.0, atol=1e-12)
    assert list(plan.poses) == ["start"]
    assert np.array_equal(plan.poses["start"], poses())


def test_topics_that_do_not_begin_together(scene, make_bag):
    """Both are known where both are there, at the stamps of either."""
    points = cdr.PoseArrayEncoder("world", 2)
    found = recorded()
    for k in range(20):
        stamp = T0 + 110 * MS + k * 20 * MS
        points.rows[:, :3] = (0.01 * k, 0.0, 0.1), (0.01 * k + 0.02, 0.0, 0.1)
        found.append(("/end", stamp, points.encode(stamp)))
    kinds = {"/gripper_pose": cdr.POSE_STAMPED, "/end": cdr.POSE_ARRAY}
    bag = make_bag(sorted(found, key=lambda one: one[1]), kinds)
    plan = read_plan(bag, scene.with_values(CHANGES))
    # 110, 130, 150, 170 ... ms, and 150, 200, 250 ... ms, to the last of /end at 490 ms.
    assert np.allclose(1e3 * plan.times[:5], [0.0, 20.0, 40.0, 60.0, 80.0])
    assert (len(plan.times), plan.times[-1]) == (20 + 3, pytest.approx(0.38))
    own = np.searchsorted(plan.times, TIMES[3:10] - 0.11 - 1e-9)
    assert np.allclose(plan.poses["start"][own], poses()[3:10], atol=1e-12)
    along = 0.01 + 0.5 * plan.times
    assert plan.poses["end"][:, 0] == pytest.approx(along, abs=1e-9)


def changed(**arrays):
    return {"times": TIMES, "start": poses(), **arrays}


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        ({"start": poses()}, "has no times; give a bag, or times"),
        ({"times": TIMES}, "has the joints none; name what holds the cable, each once: start"),
        (changed(elbow=poses()), "has the joints start, elbow; name"),
        (changed(start=poses()[1:]), "poses of start: needs finite numbers of shape"),
        (changed(times=TIMES[::-1]), "has the times 0.6, 0.55"),
        (changed(start=np.nan * poses()), "poses of start: needs finite"),
        (changed(start=2.0 * poses()), "has norm 2, needs 1"),
        (changed(times=TIMES / 1e3), "moves start at 199 m/s, inputs.max_speed is 20 m/s; plan"),
        ({"times": TIMES[:1], "start": poses()[:1]}, "has one pose; give two or more"),
    ],
)
def test_bad_arrays_are_refused_in_one_line(scene, tmp_path, arrays, complaint):
    path = tmp_path / "plan.npz"
    np.savez(path, **arrays)
    with pytest.raises(PlanError) as refused:
        read_plan(path, scene)
    assert complaint in str(refused.value) and "\n" not in str(refused.value)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("messages", "topics", "complaint"),
    [
        ([("/planner", T0, planned())] * 2, PLANNED, "holds 2 plans; give --number"),
        ([("/planner", T0, planned(["tcp"]))], PLANNED, "has the joints tcp"),
        ([("/planner", T0, planned()[:-9])], PLANNED, "plan cannot be read (1"),
        ([("/other", T0, recorded()[0][2])], {"/other": cdr.POSE_STAMPED}, "nor poses for the"),
        (recorded()[:1], {"/gripper_pose": cdr.POSE_STAMPED}, "not there at the same time"),
        ([("/gripper_pose", T0, b"\0\1\0\0")], {"/gripper_pose": cdr.POSE_STAMPED}, "record again"),
    ],
)
def test_bad_bags_are_refused_in_one_line(scene, make_bag, messages, topics, complaint):
    bag = make_bag(messages, topics)
    with pytest.raises(PlanError) as refused:
        read_plan(bag, scene)
    assert complaint in str(refused.value) and "\n" not in str(refused.value)
    assert str(bag) in str(refused.value)


def test_files_that_are_none(scene, tmp_path):
    for name, content in {"a.yaml": "times: [", "b.npz": "PK", "c.yaml": "7"}.items():
        (tmp_path / name).write_text(content)
    for name in ("a.yaml", "b.npz", "c.yaml", "d.yaml", "e.npz", "f.mcap"):
        with pytest.raises(PlanError, match=name) as refused:
            read_plan(tmp_path / name, scene)
        assert "\n" not in str(refused.value)


def test_one_of_several_plans(scene, make_bag):
    found = [("/planner", T0 + k, planned(shift=0.1 * k)) for k in range(3)]
    plan = read_plan(make_bag(found, PLANNED), scene, 2)
    assert plan.poses["start"][0, 0] == pytest.approx(0.1)


def test_the_command_gives_the_bits_of_the_simulator(given, tmp_path, capsys):
    output = tmp_path / "run.npz"
    words = ["forecast", "hanging_cable", "--plan", str(given("trajectory")), "--every", "0.1"]
    words += ["--set", "cable.rest_curvature=[0.0]"]
    assert main([*words, "--output", str(output), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    begin = {"start": (poses()[0, :3], poses()[0, 3:])}
    simulator = Simulator(load_scene("hanging_cable", {"cable.rest_curvature": [0.0]}), begin)
    expected = simulator.forecast(Plan(TIMES, {"start": poses()}), 0.1)
    written = np.load(output)
    assert np.array_equal(written["control_points"], expected.control_points)
    assert np.array_equal(written["tension"], expected.tension)
    assert said["peak_tension"] == expected.peak_tension
    assert said["largest_curvature"] == expected.largest_curvature
    assert said["end_shape"] == expected.centerline[-1].tolist()
    assert (said["planned"], said["shapes"]) == (["start"], 6)
    assert read_run(output).time.tolist() == expected.times.tolist()
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "peak tension" in shown and "shape at 0.6 s" in shown
    assert f"u = {expected.u[-1]:.3f} m: {expected.centerline[-1, -1].round(4).tolist()}" in shown


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["hanging_cable", "--every", "9"], "every: 9 s; give one above 0 s, up to the 0.6 s"),
        (["paper_wire"], "forest_ruth follows no poses; give energy_momentum"),
        (["hanging_cable", "--number", "2"], "holds 1 plans; give --number"),
    ],
)
def test_the_command_refuses_in_one_line(given, tmp_path, capsys, words, complaint):
    output = tmp_path / "run.npz"
    plan = str(given("trajectory"))
    assert main(["forecast", *words, "--plan", plan, "--output", str(output)]) == 2
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and complaint in err
    assert not output.exists()
