"""A session that goes on from a file, with the real simulator."""

import dataclasses
import json

import numpy as np
import pytest
from session_bench import MS, SECOND, T0, feed, poses

from dlo_sim.scene.description import Obstacle
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import cdr, saved_state
from dlo_sim.session.saved_state import load_state, save_state
from dlo_sim.session.session import Session
from dlo_sim.simulation.simulator import Simulator

VALUES = {
    "cable.length": 0.4,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "start.pose_topic": "/pose",
    "damping.stiffness": 0.01,
    "discretization.control_points": 7,
    "loads.names": ["tip"],
    "loads.tip.topic": "/wrench",
    "accuracy.estimate": "off",
}
SCENE = scene_from_values(VALUES)


def swinging(t):
    """Where the gripper is after so many seconds."""
    return 0.0, 0.0, 0.05 * np.sin(6.0 * t)


def move(session, begin_ns, end_ns, force=0.0):
    """Poses of a gripper that swings, at 100 Hz, and a tick after each."""
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    told = list(poses("/pose", swinging, begin_ns, end_ns))
    if force:
        values = (0.0, force, 0.0, 0.0, 0.0, 0.0)
        told += [(now, "/wrench", wrench.encode(now, values)) for now, *_ in told]
    for _ in feed(session, told, begin_ns, end_ns, 10 * MS):
        pass


@pytest.fixture(scope="module")
def ran():
    """A session after a second of motion with a force at its end."""
    session = Session(SCENE)
    move(session, T0, T0 + SECOND, force=0.02)
    return session


@pytest.fixture
def path(ran, tmp_path):
    save_state(tmp_path / "state", ran.saved)
    return tmp_path / "state"


def test_nothing_to_save_before_the_cable_is_placed():
    assert Session(SCENE).saved is None


def test_goes_on_with_the_same_shape_and_motion(ran, path):
    saved, age = load_state(path, SCENE)
    assert 0.0 <= age < 60.0
    session = Session(SCENE, resume=saved)
    begin = T0 + 3 * SECOND
    move(session, begin, begin + 70 * MS)
    assert session.started and dict(session.journal.events)["resumed"] == 1
    free = slice(3, None)  # what the gripper holds rejoins its poses
    before, after = ran.simulator.control_points, session.simulator.control_points
    np.testing.assert_allclose(after[free], before[free], atol=0.02)
    assert np.abs(before[free, 1]).max() > 0.005, "the force had moved it"
    placed = Session(SCENE)
    move(placed, begin, begin + 70 * MS)
    assert np.abs(placed.simulator.control_points[free, 1]).max() < 1e-9, "a new one hangs still"
    move(session, begin + 70 * MS, begin + 2 * SECOND)
    gripper = 0.05 * np.sin((session.stamp_ns - T0) * 6e-9)
    assert session.simulator.control_points[0, 2] == pytest.approx(gripper, abs=1e-3)


def test_a_cable_that_a_grasp_took_is_held_on(tmp_path):
    free = {**VALUES, "grasps.names": ["hand"], "grasps.hand.at": 0.7, "grasps.hand.taken": False}
    session = Session(scene_from_values(free))
    move(session, T0, T0 + SECOND)
    session.reconfigure(session.scene.with_values({"grasps.hand.taken": True}))
    place = session.simulator.centerline([0.28])
    move(session, T0 + SECOND, T0 + 2 * SECOND)
    assert session.simulator.centerline([0.28]) == pytest.approx(place, abs=1e-9)
    save_state(tmp_path / "state", session.saved)
    saved, _ = load_state(tmp_path / "state", scene_from_values(free))
    assert saved.scene.grasps[0].taken
    again = Session(saved.scene, resume=saved)
    move(again, T0 + 5 * SECOND, T0 + 6 * SECOND)
    assert again.simulator.centerline([0.28]) == pytest.approx(place, abs=1e-9)
    again.reset()
    move(again, T0 + 7 * SECOND, T0 + 8 * SECOND)
    assert np.abs(again.simulator.centerline([0.28]) - place).max() > 1e-3, "reset places it anew"


def test_a_cable_long_at_rest_can_be_saved(tmp_path):
    """What an implicit method remembers of its steps stays finite."""
    scene = SCENE.with_values({"damping.stiffness": 1.0, "damping.mass": 20.0})
    sim = Simulator(scene)
    assert sim.advance_steps(4000).status.ok
    saved = sim.snapshot()
    assert np.isfinite(saved.state).all()
    save_state(tmp_path / "state", saved)
    assert load_state(tmp_path / "state", scene)[0].steps == 4000


def test_saved_again_and_after_a_change_of_parameters(ran, path, tmp_path):
    session = Session(SCENE, resume=load_state(path, SCENE)[0])
    move(session, T0 + 3 * SECOND, T0 + 4 * SECOND)
    softer = SCENE.with_values({"cable.youngs_modulus": 5e6})
    session.reconfigure(softer)
    move(session, T0 + 4 * SECOND, T0 + 5 * SECOND)
    save_state(tmp_path / "again", session.saved)
    other = Session(softer, resume=load_state(tmp_path / "again", softer)[0])
    move(other, T0 + 5 * SECOND, T0 + 5 * SECOND + 70 * MS)
    assert dict(other.journal.events)["resumed"] == 1
    before, after = session.simulator.control_points, other.simulator.control_points
    np.testing.assert_allclose(after, before, atol=0.02)


def test_clamp_without_a_tangent_keeps_the_one_it_was_placed_with():
    """The scene leaves it open: where the cable pointed when the gripper was first seen."""
    scene = SCENE.with_values({"start.tangent": [0.0, 0.0, 0.0], "end.position": [0.4, 0.0, 0.0]})
    poses = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")

    def turn(session, begin_ns, angle):
        """From level to this angle about y within half a second, then at rest."""
        for now in range(begin_ns, begin_ns + SECOND, 10 * MS):
            half = 0.5 * angle * min((now - begin_ns) / (0.5 * SECOND), 1.0)
            turned = (0.0, np.sin(half), 0.0, np.cos(half))
            session.receive("/pose", poses.encode(now, (0.0, 0.0, 0.0, *turned)), now)
            session.tick(now)
        points = session.simulator.control_points[:2, :3]
        return points[1] - points[0]

    session = Session(scene)
    held = turn(session, T0, 0.6)
    assert np.arctan2(-held[2], held[0]) == pytest.approx(0.6, abs=1e-3)
    session.reconfigure(scene.with_values({"damping.air_drag": 0.001}))
    for again in (1, 2):
        session = Session(session.scene, resume=session.saved)
        begin = T0 + again * 10 * SECOND
        held = turn(session, begin, 0.2 * again)
        assert np.arctan2(-held[2], held[0]) == pytest.approx(0.2 * again, abs=1e-3)


def test_reset_places_the_cable_anew(path):
    session = Session(SCENE, resume=load_state(path, SCENE)[0])
    move(session, T0 + 3 * SECOND, T0 + 3 * SECOND + 100 * MS)
    session.reset()
    move(session, T0 + 4 * SECOND, T0 + 4 * SECOND + 100 * MS)
    assert np.abs(session.simulator.control_points[:, 1]).max() < 1e-9
    assert dict(session.journal.events)["resumed"] == 1


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"cable.length": 0.5}, r"\(cable.length was 0.4, is 0.5\); remove the file, or give"),
        ({"discretization.control_points": 9}, "discretization.control_points was 7, is 9"),
        ({"loads.names": []}, "loads.names was"),
    ],
)
def test_state_of_another_scene_is_refused(path, changes, difference):
    values = {key: value for key, value in VALUES.items() if not key.startswith("loads.tip")}
    other = scene_from_values({**(VALUES if "loads.names" not in changes else values), **changes})
    with pytest.raises(SceneError, match=difference):
        load_state(path, other)


def test_inputs_and_outputs_may_differ(path):
    changes = {"inputs.latency": 0.1, "outputs.color_by": "tension", "state.save_to": "here"}
    assert load_state(path, SCENE.with_values(changes)) is not None


def test_a_motion_that_waits_is_not_lost_unsaid(ran, tmp_path):
    waiting = {"start": (object(),)}
    with pytest.raises(ValueError, match="motions of start wait for their start; save it once"):
        save_state(tmp_path / "state", dataclasses.replace(ran.saved, waiting=waiting))
    assert not (tmp_path / "state").exists()


def test_no_file_is_no_state(tmp_path):
    assert load_state(tmp_path / "state", SCENE) is None


def damaged(path, damage):
    """The file with this damage."""
    content = bytearray(path.read_bytes())
    with np.load(path) as file:
        arrays = dict(file)
    head = json.loads(str(arrays["head"]))
    if damage.endswith("%"):
        content = content[: int(damage[:-1]) * len(content) // 100]
    elif damage == "noise":
        content = np.random.default_rng(1).bytes(5000)
    elif damage == "zip":
        content = b"PK\x03\x04"
    elif damage == "a bit":
        content[content.index(b"state.npy") + 200] ^= 1
    else:
        if damage == "too short":
            arrays["state"] = arrays["state"][::2]
        elif damage == "not finite":
            arrays["inputs"][3] = np.nan
        elif damage == "no geometry":
            head["geometries"].clear()
        elif damage == "no version":
            del head["version"]
        with path.open("wb") as stream:
            np.savez(stream, **(arrays | {"head": np.array(json.dumps(head))}))
        return
    path.write_bytes(content)


@pytest.mark.parametrize(
    "damage",
    ["0%", "30%", "99%", "noise", "zip", "a bit"]
    + ["too short", "not finite", "no geometry", "no version"],
)
def test_a_damaged_file_is_refused(path, damage):
    """Whatever the damage: one line that says what to do."""
    damaged(path, damage)
    with pytest.raises(SceneError, match="state is no saved state, or a damaged one; remove the"):
        load_state(path, SCENE)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"cannot be read \(Is a directory\); remove the file, or"):
        load_state(tmp_path, SCENE)


def test_state_of_another_version_is_refused(path, monkeypatch):
    monkeypatch.setattr(saved_state, "__version__", "9.9")
    with pytest.raises(SceneError, match=r"is of dlo_sim \d.*; remove the file"):
        load_state(path, SCENE)


def test_a_cable_lowered_onto_a_table_can_be_changed_and_goes_on(tmp_path):
    """Where its gripper is now, and then where the scene has it, a straight cable would go through
    the table.
    """
    above = {"start.position": [0.0, 0.0, 0.5], "end.position": [0.0, 0.0, 0.1]}
    table = {"obstacles.names": ["table"], "obstacles.table.shape": "plane"}
    down = {"start.tangent": [0.0, 0.0, -1.0], "damping.mass": 5.0, "cable.diameter": 0.01}
    scene = scene_from_values(VALUES | above | table | down)

    def lower(session, begin_ns, end_ns):
        """From 0.5 m to 0.2 m within a second."""
        path = poses("/pose", lambda t: (0.0, 0.0, max(0.5 - 0.3 * t, 0.2)), begin_ns, end_ns)
        for _ in feed(session, path, begin_ns, end_ns, 10 * MS):
            pass

    session = Session(scene)
    lower(session, T0, T0 + 2 * SECOND)
    lying = session.simulator.control_points
    assert (lying[:, 2] > 0.0).all()
    session.reconfigure(scene.with_values({"damping.mass": 6.0}))
    np.testing.assert_allclose(session.simulator.control_points, lying, atol=1e-9)
    raised = {"obstacles.table.position": [0.0, 0.0, 0.11]}  # above where the scene has its end
    session.reconfigure(session.scene.with_values(raised))
    lower(session, T0 + 2 * SECOND, T0 + 3 * SECOND)
    lying = session.simulator.control_points
    save_state(tmp_path / "state", session.saved)
    again = Session(session.scene, resume=load_state(tmp_path / "state", session.scene)[0])
    lower(again, T0 + 5 * SECOND, T0 + 5 * SECOND + 70 * MS)
    assert dict(again.journal.events)["resumed"] == 1
    np.testing.assert_allclose(again.simulator.control_points, lying, atol=2e-3)


@pytest.fixture(scope="module")
def beside():
    """A simulator of a scene with markers, of which one has added a box."""
    sim = Simulator(scene_from_values(VALUES | {"contact.markers": 1}))
    sim.add_obstacles([Obstacle("boxes/1", "box", (0.1, 0.1, 0.1), (0.2, 3.0, 0.0))])
    return sim


def test_a_state_keeps_added_obstacles(beside, tmp_path):
    save_state(tmp_path / "state", beside.snapshot())
    assert load_state(tmp_path / "state", beside.scene)[0].scene.added == beside.scene.added


@pytest.mark.parametrize(
    "changes",
    [
        {"shape": "x"},
        {"friction": 2.0**70},
        {"size": [0.1, -1.0, 0.1]},
        {"name": "start"},
        {"name": 0},
    ],
)
def test_added_obstacles_of_a_state_are_checked(beside, tmp_path, changes):
    """As those that are added to a cable that runs."""
    path = tmp_path / "state"
    save_state(path, beside.snapshot())
    with np.load(path) as file:
        parts = dict(file)
    head = json.loads(str(parts["head"]))
    head["added"][0] |= changes
    with path.open("wb") as stream:
        np.savez(stream, **parts | {"head": np.array(json.dumps(head))})
    with pytest.raises(SceneError, match="state.save_to: .* is no saved state, or a damaged one"):
        load_state(path, beside.scene)


@pytest.mark.parametrize("damage", ["count", "number", "height"])
def test_a_state_that_names_what_is_not_there_is_refused(beside, damage):
    """Compiled code would read beyond its arrays."""
    snapshot = beside.snapshot()
    state = beside.cable.arrays.state
    {"count": state.near_count, "number": state.near, "height": state.x}[damage][0] = 1e300
    spoilt = beside.snapshot()
    beside.restore(snapshot)
    line = r"state.save_to: nothing goes on from .*; remove the file"
    with pytest.raises(SceneError, match=line):
        Session(beside.scene, resume=spoilt)
