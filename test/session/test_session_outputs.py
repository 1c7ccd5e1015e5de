"""What a session puts out: stamps on the grid, fresh states once, markers at their own rate."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from session_bench import FREE, MS, SECOND, T0, motion, play

from dlo_sim.core.color_scale import TABLE
from dlo_sim.scene.loading import load_scene
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.topics import CAPSULES, MARKERS, POINTS

STORE = get_typestore(Stores.ROS2_JAZZY)


class TestGrid:
    """Which states are published does not depend on when the timer happened to start."""

    @staticmethod
    def stamps(bench, phase, jitter=0, seed=0, **changes):
        """Stamps of a session whose timer started `phase` ns later, its ticks jittering."""
        rng = np.random.default_rng(seed)
        free = bench(FREE, **changes)
        period = round(SECOND / free.scene.rate)
        found = []
        for due in range(T0 + phase, T0 + phase + 4 * SECOND, period):
            free.session.tick(due + int(rng.uniform(-jitter, jitter)))
            found += [m.stamp_ns for m in free.session.messages() if "points" in m.topic]
        return found

    @pytest.mark.parametrize(
        ("rate", "step"), [(200.0, 1e-3), (30.0, 5e-4), (333.0, 1 / 3000), (333.0, 1e-3)]
    )
    def test_any_phase_gives_the_same_stamps(self, bench, rate, step):
        changes = {"rate": rate, "integrator.step": step}
        first = self.stamps(bench, 0, **changes)
        assert len(first) > 3.9 * rate
        for phase in (1, 123_456, 1_999_999, 2_500_000):
            other = self.stamps(bench, phase, **changes)
            assert set(first[2:-2]) <= set(other)

    @pytest.mark.parametrize("phase", [0, 1_000_000, 2_500_000, 4_950_000])
    def test_jitter_loses_no_stamp(self, bench, phase):
        first = self.stamps(bench, 0)
        other = self.stamps(bench, phase, jitter=400_000, seed=phase)
        assert set(first[2:-2]) <= set(other)
        assert set(np.diff(other[2:])) == {5 * MS}


class TestMessages:
    def test_markers_at_their_own_rate(self, loaded):
        play(loaded, 1.0)
        counts = {}
        for now in range(T0 + SECOND, T0 + 2 * SECOND, 5 * MS):
            if now % (20 * MS) == 0:
                loaded.pose(now, motion(now))
            loaded.session.tick(now)
            for message in loaded.session.messages():
                counts[message.topic] = counts.get(message.topic, 0) + 1
        assert counts["~/control_points"] == counts["~/start/reaction"] == 200
        assert counts["~/centerline"] == counts["~/control_polygon"] == 30

    def test_markers_which_expire_are_renewed(self, loaded):
        play(loaded, 1.0)
        loaded.session.pause(True)
        found = []
        for now in range(T0 + SECOND, T0 + 2 * SECOND, 5 * MS):
            loaded.session.tick(now)
            found += [m.topic for m in loaded.session.messages(["~/centerline"])]
        assert found == ["~/centerline"] * 30

    def test_a_tick_without_a_step_has_nothing_new(self, loaded):
        play(loaded, 1.0)
        loaded.session.pause(True)
        now = T0 + SECOND
        for k in range(200):
            loaded.session.tick(now + k * 5 * MS)
            due = [m for m in loaded.session.messages() if m.topic not in MARKERS]
            assert due == []
            assert len(loaded.session.messages([], ["~/control_points"])) == 1  # for who comes now
        loaded.session.step_once()
        assert len(loaded.session.messages()) == 4
        assert loaded.session.messages() == []

    def test_no_stamp_comes_twice(self, loaded):
        """Poses are missing now and then, and ticks come twice in a timer period."""
        stamps = []
        for now in range(T0, T0 + 4 * SECOND, 2 * MS):
            if now % (20 * MS) == 0 and now // SECOND % 2 == 0:
                loaded.pose(now, motion(now))
            loaded.session.tick(now)
            stamps += [m.stamp_ns for m in loaded.session.messages() if "points" in m.topic]
        assert len(stamps) > 350
        assert len(set(stamps)) == len(stamps)

    def test_outputs_hold_the_present_state(self, loaded):
        play(loaded, 1.0)
        loaded.session.pause(True)
        loaded.session.step_once()
        by_topic = {m.topic: m for m in loaded.session.messages(None)}
        by_topic |= {m.topic: m for m in loaded.session.messages([], ["~/centerline"])}
        points = STORE.deserialize_cdr(by_topic["~/control_points"].data, cdr.POSE_ARRAY)
        assert points.header.frame_id == "world"
        stamp = points.header.stamp.sec * SECOND + points.header.stamp.nanosec
        assert stamp == loaded.session.stamp_ns
        first = loaded.simulator.control_points[0]
        assert points.poses[0].position.x == first[0]
        line = STORE.deserialize_cdr(by_topic["~/centerline"].data, cdr.MARKER)
        assert len(line.points) == 50
        assert line.scale.x == 0.005
        assert line.lifetime.sec + line.lifetime.nanosec * 1e-9 == pytest.approx(5 / 30)
        assert "~/end/reaction" not in by_topic, "it is free"
        force = loaded.simulator.reaction_wrench("start")[:3]
        wrench = STORE.deserialize_cdr(by_topic["~/start/reaction"].data, cdr.WRENCH_STAMPED)
        assert (wrench.wrench.force.x, wrench.wrench.force.y) == (force[0], force[1])

    @pytest.mark.parametrize(
        ("by", "ends", "brightest"),
        [
            ("tension", [0.0, 0.0], 1.0),
            ("curvature", [0.0, 0.0], 1.0),
            ("tension", [0.0, 1.0], 0.5),
            ("curvature", [0.0, 1.5], 0.5),
        ],
    )
    def test_colors_along_the_cable(self, bench, by, ends, brightest):
        """The fake's tension is 2 u, its curvature 3 u, its length 1 m."""
        changes = {"outputs.color_by": by, "outputs.color_range": ends}
        found = bench(FREE, **changes)
        found.session.tick(T0)
        found.session.tick(T0 + SECOND)
        line = {m.topic: m for m in found.session.messages()}["~/centerline"]
        marker = STORE.deserialize_cdr(line.data, cdr.MARKER)
        rgb = np.array([[c.r, c.g, c.b] for c in marker.colors])
        assert rgb[0] == pytest.approx(TABLE[0], abs=1e-6)
        assert rgb[-1] == pytest.approx(TABLE[-1], abs=1e-6)
        full = np.flatnonzero(np.abs(rgb - TABLE[-1]).max(axis=1) < 1e-6)[0]
        assert full / (len(rgb) - 1) == pytest.approx(brightest, abs=0.03)


class TestForPlanningScenes:
    """Outputs that are off unless asked for."""

    @pytest.fixture
    def hanging(self):
        """A session of a bent, stretched cable."""
        values = {"outputs.points": True, "outputs.capsules": 6, "outputs.centerline_samples": 20}
        values |= {
            "cable.rest_curvature": [0.0],
            "start.pose_topic": "",
            "gravity": [9.0, 0.0, 0.0],
        }
        session = Session(load_scene("hanging_cable", values))
        for now in range(T0, T0 + SECOND // 2, 5 * MS):
            session.tick(now)
        return session

    def test_points_carry_place_and_tension(self, hanging):
        (message,) = hanging.messages((), [POINTS])
        cloud = STORE.deserialize_cdr(message.data, message.type)
        rows = cloud.data.view(np.float32).reshape(20, 5)
        u = np.linspace(0.0, hanging.scene.cable.length, 20)
        simulator = hanging.simulator
        expected = np.column_stack([simulator.centerline(u), u, simulator.tension(u)])
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "u", "tension"]
        assert np.array_equal(rows, expected.astype(np.float32))
        assert np.ptp(rows[:, 4]) > 0.1

    def test_capsules_hold_the_cable(self, hanging):
        (message,) = hanging.messages((), [CAPSULES])
        markers = STORE.deserialize_cdr(message.data, message.type).markers
        joints = cdr.decode_points(cdr.MARKER_ARRAY, message.data).rows[6:]
        radii = np.array([0.5 * marker.scale.x for marker in markers[:6]])
        line = hanging.simulator.centerline(np.linspace(0.0, hanging.scene.cable.length, 1201))
        pieces = np.stack([line[200 * k : 200 * k + 201] for k in range(6)])
        ways = np.diff(joints, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        across = np.cross(pieces - joints[:-1, None], (ways / lengths[:, None])[:, None])
        apart = np.linalg.norm(across, axis=-1).max(axis=1)
        radius = 0.5 * hanging.scene.cable.diameter
        assert apart.max() > 1e-3  # the cable is bent
        assert np.all(apart + radius < radii + 1e-4)
        assert np.all(apart + radius > radii - 2e-4)

    def test_tension_that_is_not_known_is_left_out(self):
        values = {"outputs.points": True, "cable.rest_curvature": [1.0], "start.pose_topic": ""}
        session = Session(load_scene("hanging_cable", values))
        session.tick(T0)
        (message,) = session.messages((), [POINTS])
        fields = STORE.deserialize_cdr(message.data, message.type).fields
        assert [field.name for field in fields] == ["x", "y", "z", "u"]
