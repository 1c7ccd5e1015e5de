"""Other parameters for a session that runs: from the same state, between two ticks."""

import numpy as np
import pytest
from session_bench import MS, SECOND, T0, motion, play

from dlo_sim.session import cdr
from dlo_sim.session.topics import CONTROL_POINTS


class TestReconfigure:
    def test_goes_on_from_the_same_state(self, loaded):
        play(loaded, 2.0)
        points = loaded.simulator.control_points
        stamp = loaded.session.stamp_ns
        loaded.session.reconfigure(loaded.scene.with_values({"integrator.step": 5e-4}))
        assert loaded.session.stamp_ns == stamp
        assert np.allclose(loaded.simulator.control_points, points, atol=1e-12)
        assert loaded.simulator.loads["tip"].any()
        places = []
        for k in range(60, 160):
            now = T0 + k * 33_333_333
            loaded.pose(now, motion(now))
            for tick in range(now, now + 33 * MS, 3 * MS):
                loaded.session.tick(tick)
                places.append((loaded.session.stamp_ns, loaded.simulator.control_points[0, 0]))
        error = [x - motion(stamp)[0] for stamp, x in places]
        assert np.abs(error).max() < 5e-4
        assert loaded.simulator.step == 5e-4

    def test_a_motion_under_way_goes_on(self, loaded):
        """Changed in the middle of a segment: neither place nor speed of the end jumps."""
        play(loaded, 2.0)
        for k in range(60, 64):
            loaded.pose(T0 + k * 33_333_333, motion(T0 + k * 33_333_333))
        loaded.session.tick(T0 + 2003 * MS)
        loaded.session.reconfigure(loaded.scene.with_values({"integrator.step": 5e-4}))
        for now in range(T0 + 2003 * MS, T0 + 2100 * MS, MS):
            loaded.session.tick(now)
            expected = motion(loaded.session.stamp_ns)
            assert loaded.simulator.control_points[0, :3] == pytest.approx(expected, abs=2e-4)

    def test_what_was_prepared_goes_on_from_the_state_of_now(self, loaded):
        play(loaded, 2.0)
        scene = loaded.scene.with_values({"integrator.step": 5e-4})
        prepared = loaded.session.prepare(scene)
        assert loaded.simulator.step != 5e-4
        old = loaded.simulator.control_points
        loaded.session.tick(T0 + 2050 * MS)
        points, stamp = loaded.simulator.control_points, loaded.session.stamp_ns
        assert np.abs(points - old).max() > 1e-4
        loaded.session.reconfigure(scene, prepared)
        assert loaded.simulator is prepared.simulator
        assert loaded.session.stamp_ns == stamp
        assert np.allclose(loaded.simulator.control_points, points, atol=1e-12)

    def test_limits_of_inputs_change_with_the_scene(self, loaded):
        play(loaded, 1.0)
        loaded.session.reconfigure(loaded.scene.with_values({"inputs.max_force": 0.5}))
        loaded.wrench(T0 + SECOND, (1, 0, 0))
        assert loaded.refused("/wrench") == {"too_large": 1}

    def test_a_refused_scene_changes_nothing(self, loaded):
        play(loaded, 1.0)
        simulator, scene = loaded.simulator, loaded.session.scene
        with pytest.raises(ValueError, match="too thick"):
            loaded.session.reconfigure(loaded.scene.with_values({"cable.diameter": 0.9}))
        for key, value in (("start.pose_topic", "/other"), ("measured.type", "pose_array")):
            with pytest.raises(ValueError, match=f"^{key}: cannot change"):
                loaded.session.reconfigure(loaded.scene.with_values({key: value}))
        assert loaded.simulator is simulator
        assert loaded.session.scene is scene
        assert loaded.session.tick(T0 + SECOND).advanced_steps > 0

    def test_before_the_first_pose(self, loaded):
        loaded.session.reconfigure(loaded.scene.with_values({"discretization.control_points": 9}))
        play(loaded, 0.5)
        (points,) = loaded.session.messages((), [CONTROL_POINTS])
        assert len(cdr.decode_pose_array(points.data).rows) == 9
