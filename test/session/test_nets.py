"""A session of a net: every cable is heard, moved, published, saved and predicted."""

import numpy as np
import pytest
from harness import MS, SECOND, T0, feed, harness
from plans import trajectory

from dlo_sim.core import rotations
from dlo_sim.session import cdr
from dlo_sim.session.plans import answer, request
from dlo_sim.session.saved_state import load_state, save_state
from dlo_sim.session.session import Session
from dlo_sim.session.topics import input_topics, output_topics

SHOWN = {"outputs.tf": True, "outputs.points": True, "outputs.capsules": 4, "forecast.processes": 1}
SHOWN["outputs.marker_rate"] = 100.0
ENDS = ("start", "end")


@pytest.fixture(scope="module")
def ran():
    """A session after half a second of motion, and what it has published."""
    session = Session(harness(**SHOWN))
    found = feed(session)
    return session, found


def last(found, topic):
    """The messages on a topic with the newest stamp there."""
    on = [one for one in found if one.topic == topic]
    return [one for one in on if one.stamp_ns == on[-1].stamp_ns]


def test_every_cable_has_its_topics(ran):
    session, found = ran
    topics = output_topics(session.scene)
    for kind in ("control_points", "points"):
        own = ("", "branches/a/", "branches/b/", "cables/c/")
        assert {f"~/{one}{kind}" for one in own} <= set(topics)
    held = ("start", "end", "branches/a/end", "cables/c/start", "clip")
    reactions = {topic for topic in topics if topic.endswith("/reaction")}
    assert reactions == {f"~/{one}/reaction" for one in held}
    assert {one.target for one in input_topics(session.scene)} == {"start", "a.end", "clip", "hand"}
    published = {one.topic for one in found}
    later = {"~/forecast", "~/forecast/ghosts", "/diagnostics"}
    assert published == set(topics) - later
    assert not session.journal.refused and not session.journal.events


def test_messages_are_of_the_cable_that_they_name(ran):
    session, found = ran
    sim = session.simulator
    for topic, name in (("~/", "cable"), ("~/branches/b/", "b"), ("~/cables/c/", "c")):
        (message,) = last(found, f"{topic}control_points")
        rows = np.empty((len(sim.strand(name).greville), 7))
        sim.control_poses(rows, name)
        assert np.array_equal(cdr.decode_pose_array(message.data).rows, rows)
        (cloud,) = last(found, f"{topic}points")
        line = sim.strand(name).points(np.linspace(0.0, sim.strand(name).length, 50))
        points = cdr.decode_points(cdr.POINT_CLOUD, cloud.data).rows
        assert points == pytest.approx(line, abs=1e-6)
    (wrench,) = last(found, "~/branches/a/end/reaction")
    assert cdr.decode(cdr.WRENCH_STAMPED, wrench.data).values == sim.reaction_wrench("a.end")
    (pose,) = last(found, "~/connectors/plug/pose")
    expected = np.concatenate(sim.connector_pose("plug"))
    assert cdr.decode(cdr.POSE_STAMPED, pose.data).values == tuple(expected)


def test_markers_of_all_cables_differ_in_name_and_colour(ran):
    _, found = ran
    for topic in ("~/centerline", "~/control_polygon"):
        markers = [cdr.read(cdr.MARKER, one.data) for one in last(found, topic)]
        assert [m.ns for m in markers] == [f"{topic[2:]}{of}" for of in ("", "/a", "/b", "/c")]
        assert len({(m.color.r, m.color.g, m.color.b) for m in markers}) == 4
    (capsules,) = last(found, "~/capsules")
    markers = cdr.read(cdr.MARKER_ARRAY, capsules.data).markers
    assert len({(m.ns, m.id) for m in markers}) == len(markers) == 4 * (4 + 5)


def test_connector_is_marked_where_it_is(ran):
    """A capsule about its x axis, 4 cm long, 2 cm thick, its middle 1 cm ahead of the cable."""
    session, found = ran
    position, turned = session.simulator.connector_pose("plug")
    (shown,) = last(found, "~/connectors")
    markers = cdr.read(cdr.MARKER_ARRAY, shown.data).markers
    places = np.array([(m.pose.position.x, m.pose.position.y, m.pose.position.z) for m in markers])
    near = session.simulator.strand("b").points(np.array([0.39999, 0.4]))
    along = np.diff(near, axis=0)[0] / 1e-5
    assert rotations.rotate(turned, np.array([1.0, 0.0, 0.0])) == pytest.approx(along, abs=1e-3)
    assert np.sort((places - position) @ along) == pytest.approx([0.0, 0.01, 0.02], abs=1e-4)
    assert {(m.scale.x, m.scale.y) for m in markers} == {(0.02, 0.02)}


def test_frames_of_ends_grasps_and_connectors(ran):
    session, found = ran
    (message,) = last(found, "/tf")
    transforms = cdr.read(cdr.TF_MESSAGE, message.data).transforms
    frames = {one.child_frame_id: cdr.transform_values(one.transform) for one in transforms}
    ends = [f"{of}{end}" for of in ("", "branches/a/", "branches/b/", "cables/c/") for end in ENDS]
    assert set(frames) == {"plug", "dlo_sim/clip", *(f"dlo_sim/{one}" for one in ends)}
    assert frames["plug"] == tuple(np.concatenate(session.simulator.connector_pose("plug")))
    assert set(output_topics(harness())) >= {"/tf"}, "also where outputs.tf is off"


def test_branch_feels_its_gripper_and_its_load():
    """The reaction at the end of a branch balances what acts on it."""
    session = Session(harness())
    feed(session)
    sim = session.simulator
    assert sim.end_pose("a.end")[0][1] > 0.03
    assert sim.centerline([0.3], "a")[0] == pytest.approx(sim.end_pose("a.end")[0])
    assert session.newest_poses["a.end"].position[1] == pytest.approx(0.05 * np.sin(4 * 0.49))
    number = [one.name for one in sim.scene.loads].index("hand")
    assert sim.cable.loads[number, 1] != 0.0


def test_a_pose_that_is_too_fast_is_refused_for_the_end_of_a_branch():
    session = Session(harness(**{"inputs.max_speed": 0.01}))
    feed(session, end=0.1)
    assert session.journal.topics["/a"].refused["too_fast"] > 0


def test_grasp_on_a_branch_takes_and_releases():
    session = Session(harness(**{"grasps.clip.taken": False}))
    feed(session, end=0.2)
    assert session.simulator.held_at("clip") is None
    taken = cdr.write(cdr.BOOL, cdr.new(cdr.BOOL, data=True))
    session.receive("/taken", taken, T0 + SECOND // 5)
    feed(session, 0.2, 0.5)
    assert session.simulator.held_at("clip") == pytest.approx(0.2)
    assert session.scene.grasp("clip").taken


def test_a_branch_is_stiffened_while_it_moves():
    session = Session(harness())
    feed(session, end=0.3)
    before = session.simulator.strand("a").control_points
    changes = {"branches.a.cable.bending_stiffness": 0.02, "branches.b.cable.diameter": 0.008}
    session.reconfigure(session.scene.with_values(changes))
    assert session.simulator.strand("a").control_points == pytest.approx(before, abs=1e-9)
    assert session.simulator.strand("a").bending_stiffness == 0.02
    feed(session, 0.3, 0.5)
    assert not session.journal.events


@pytest.mark.parametrize("key", ["branches.a.at", "connectors.plug.at"])
def test_no_joint_moves_along_a_cable_that_runs(key):
    """Joined elsewhere, the present shape would be torn: no step converged."""
    session = Session(harness())
    feed(session, end=0.1)
    with pytest.raises(ValueError, match=f"^{key}: cannot change while the session runs; restart"):
        session.reconfigure(session.scene.with_values({key: 0.55}))


def test_a_plug_gets_another_shape_while_it_moves():
    """Also one that touches in more or fewer places; friction that held it ends."""
    wall = {"obstacles.names": ["wall"], "obstacles.wall.position": [0.0, 0.0, -9.0]}
    size = {"connectors.plug.shape": "box", "connectors.plug.size": [0.04, 0.03, 0.02]}
    session = Session(harness(**wall, **size))
    feed(session, end=0.1)
    before = session.simulator.control_points
    for shape in ("sphere", "capsule", "box"):
        session.reconfigure(session.scene.with_values({"connectors.plug.shape": shape}))
        np.testing.assert_allclose(session.simulator.control_points, before, atol=1e-9)
    feed(session, 0.1, 0.2)
    assert not session.journal.events


def test_saved_state_goes_on_bit_for_bit(tmp_path):
    first = Session(harness())
    feed(first, end=0.3)
    save_state(tmp_path / "state", first.saved)
    state, _ = load_state(tmp_path / "state", harness())
    one, other = (type(first.simulator).resumed(start) for start in (first.saved, state))
    for sim in (one, other):
        sim.set_end("a.end", position=[0.3, 0.1, -0.3])
        sim.advance_steps(50)
    assert np.array_equal(one.cable.state, other.cable.state)
    resumed = Session(harness(), resume=state)
    feed(resumed, 0.3, 0.5)
    assert resumed.journal.events == {"resumed": 1, "rejoined": 2}


def test_plan_moves_the_end_of_a_branch(ran):
    session, _ = ran
    times = np.linspace(0.0, 0.4, 9)
    now = T0 + 490 * MS
    rows = np.tile((0.3, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0), (9, 1, 1))
    rows[:, 0, 1] = 0.05 * np.sin(4 * 0.49) + 0.1 * times
    raw = trajectory(("a.end",), [round(t * SECOND) for t in times], rows, now, "")
    found = answer(request(session, raw, now))
    assert not found.problem and not found.refused
    cloud = cdr.read(cdr.POINT_CLOUD, found.messages[0].data)
    assert [field.name for field in cloud.fields][-1] == "strand"
    rows = cloud.data.view(np.float32).reshape(-1, 4, 50, 7)
    tips = rows[-1, :, -1, :3]
    assert rows[-1, :, -1, -1].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert tips[1, 1] == pytest.approx(0.05 * np.sin(4 * 0.49) + 0.04, abs=1e-3)
    assert np.linalg.norm(tips[3] - (0.0, -0.5, 0.0)) == pytest.approx(0.2, abs=1e-3)
    ghosts = cdr.read(cdr.MARKER, found.messages[1].data)
    assert len(ghosts.points) == 5 * 4 * 2 * 49
