"""`simulate_batch`: scenes of a batch against the same scenes in simulators of their own."""

import numpy as np
import pytest
from batch_scenes import STEP, pulled, wire
from harness import harness

from dlo_sim.batch import simulate_batch
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator

POSITION = 1e-12  # [m], round-off of the interpolation at a sample
BY_SPAN = {"discretization.stretch": "span"}
IMPLICIT = {"integrator.method": "energy_momentum", "integrator.step": 5e-3}
ENERGY = 1e-9  # of the energy exchanged


def alone(scene, duration, start=None):
    """A simulator of the scene after `duration`."""
    sim = Simulator(scene)
    if start is not None:
        sim.start_from(*start)
    assert sim.advance_steps(round(duration / sim.step)).status.advanced
    return sim


@pytest.mark.parametrize(
    ("scenes", "duration"),
    [
        ([wire(k) for k in range(9)], 600 * STEP),
        ([pulled(k) for k in range(5)], 0.3),
        ([wire(k, **BY_SPAN) for k in range(3)], 600 * STEP),
        ([pulled(k, **BY_SPAN) for k in range(3)], 0.3),
    ],
    ids=[
        *("planar wire on springs", "soft cable in space with loads and damping"),
        *("planar wire, stretched by span", "soft cable in space, stretched by span"),
    ],
)
def test_scenes_move_as_in_simulators_of_their_own(scenes, duration):
    result = simulate_batch(scenes, duration, processes=1)
    assert result.ok and result.message == ("",) * len(scenes)
    moved = np.abs(result.control_points[:, -1] - result.control_points[:, 0])
    assert (moved.max(axis=(1, 2)) > 1e4 * POSITION).all()
    assert np.abs(np.diff(result.control_points[:, -1], axis=0)).max() > 1e3 * POSITION
    for k, scene in enumerate(scenes):
        sim = alone(scene, duration)
        assert result.simulated[k] == pytest.approx(duration) and result.method[k] == sim.method
        np.testing.assert_allclose(
            result.control_points[k, -1], sim.control_points, rtol=0.0, atol=POSITION
        )
        assert sim.energy_error > 1e-14
        assert abs(result.energy_error[k] - sim.energy_error) < ENERGY
        scale = np.ptp(result.energy[k]) + sim.energy().kinetic
        assert abs(result.energy[k, -1] - sim.energy().total) < ENERGY * scale


def test_scenes_follow_poses_as_simulators_do():
    """Also of another number of poses, by two points, and beside scenes that follow none."""
    times, still = np.linspace(0.0, 0.2, 21), pulled(3)
    turn = np.outer(np.sin(20.0 * np.minimum(times, 0.1)), [0.02, 0.05, 0.03])
    path = np.hstack([turn, np.zeros((21, 3)), np.ones((21, 1))])
    points = np.stack([turn[::4], turn[::4] + [0.02, 0.0, 0.0]], axis=1)
    scenes = [pulled(k, **IMPLICIT) for k in range(2)]
    poses = [(times, {"start": path}), (times[::4], {"start": points}), None]
    result = simulate_batch([*scenes, still], 0.2, poses=poses, every=0.05, processes=1)
    assert result.ok
    for k, scene in enumerate(scenes):
        sim = Simulator(scene)
        report, along = sim.follow(*poses[k], result.time[1:])
        assert report.status.ok and np.array_equal(result.control_points[k, 1:], along)
        assert np.array_equal(result.control_points[k, 0], Simulator(scene).control_points)
        assert result.energy[k, -1] == pytest.approx(sim.energy().total, rel=1e-9)
        assert result.simulated[k] == sim.time == pytest.approx(0.2)
    assert np.ptp(result.control_points[:2, :, 0, 1], axis=1).min() > 0.04
    alone = simulate_batch([still], 0.2, every=0.05, processes=1)
    assert np.array_equal(result.control_points[2], alone.control_points[0])


@pytest.mark.parametrize(
    ("poses", "text"),
    [
        ([None], "^poses: 1 for 2 scenes; give one each, or None"),
        ([None, ([0.0, 0.1], {})], "^poses 1: times: end at 0.1 s, the batch at 0.2 s; give poses"),
        ([([0.0, 0.2], {"foot": np.ones((2, 7))}), None], "^poses 0: end: 'foot' is not known"),
        ([([0.1, 0.2], {}), None], "^poses 0: times: needs a first time of 0.0 s"),
    ],
)
def test_poses_that_do_not_fit_are_refused(poses, text):
    scenes = [pulled(k, **IMPLICIT) for k in range(2)]
    with pytest.raises(ValueError, match=text):
        simulate_batch(scenes, 0.2, poses=poses, processes=1)


def test_scenes_do_not_depend_on_their_neighbours():
    scenes = [wire(k) for k in range(10)]
    together = simulate_batch(scenes, 100 * STEP, processes=1)
    other = simulate_batch(scenes[::-1], 100 * STEP, processes=1)
    assert together.control_points.tobytes() == other.control_points[::-1].tobytes()
    assert together.energy.tobytes() == other.energy[::-1].tobytes()


def test_initial_states_are_taken_over():
    scenes = [wire(0)] * 3
    rng = np.random.default_rng(1)
    starts = [None]
    for size in (0.01, 0.02):
        points, rates = np.zeros((13, 4)), np.zeros((13, 4))
        points[:, 0] = Simulator(scenes[0]).control_points[:, 0]
        points[:, 2] = size * np.sin(np.pi * points[:, 0] / 2.0)
        points[[0, -1], 2] = 0.0
        rates[1:-1, 2] = rng.normal(size=11)
        starts.append((points, rates))
    result = simulate_batch(scenes, 200 * STEP, initial=starts, processes=1)
    np.testing.assert_array_equal(result.control_points[1, 0], starts[1][0])
    for k, start in enumerate(starts):
        sim = alone(scenes[k], 200 * STEP, start)
        np.testing.assert_allclose(
            result.control_points[k, -1], sim.control_points, rtol=0.0, atol=POSITION
        )
        assert abs(result.energy_error[k] - sim.energy_error) < ENERGY


def test_a_scene_that_diverges_harms_no_other():
    scenes = [wire(0)] * 4
    kicked = np.zeros((13, 4))
    kicked[1:-1, 0] = 3e4 * (-1.0) ** np.arange(11)  # m/s: tears it through itself
    straight = Simulator(scenes[0]).control_points
    starts = [None, None, (straight, kicked), None]
    every = 20 * STEP
    result = simulate_batch(scenes, 400 * STEP, initial=starts, every=every, processes=1)
    calm = simulate_batch(scenes[:3], 400 * STEP, every=every, processes=1)
    assert result.status == ("ok", "ok", "diverged", "ok") and not result.ok
    assert "energy grew" in result.message[2] and "forest_ruth" in result.message[2]
    assert result.control_points[[0, 1, 3]].tobytes() == calm.control_points.tobytes()
    for values in (result.control_points, result.energy, result.energy_error, result.simulated):
        assert np.isfinite(values).all()
    good = result.samples[2]
    assert 1 <= good < len(result.time) and result.simulated[2] < 400 * STEP
    assert (result.control_points[2, good:] == result.control_points[2, -1]).all()
    assert result.samples[0] == len(result.time) and result.simulated[0] == 400 * STEP


def test_scenes_of_a_batch_may_have_different_methods():
    implicit = wire(1, **{"integrator.method": "energy_momentum", "integrator.step": 2e-3})
    result = simulate_batch([wire(0), implicit], 0.01, processes=1)
    assert result.method == ("forest_ruth", "energy_momentum")
    assert result.step.tolist() == [STEP, 2e-3]
    sim = alone(implicit, 0.01)
    np.testing.assert_array_equal(result.control_points[1, -1], sim.control_points)


def test_batches_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="scenes: there are none"):
        simulate_batch([], 1.0)
    with pytest.raises(ValueError, match="scene 1 has 9 control points, scene 0 has 13"):
        simulate_batch([wire(0), wire(0, **{"discretization.control_points": 9})], 1.0)
    for name in ("duration", "every"):
        for value in (0.0, float("nan")):
            with pytest.raises(ValueError, match=f"{name}: {value:g} s is not above 0"):
                simulate_batch([wire(0)], **{"duration": 1.0, name: value})
    with pytest.raises(ValueError, match="initial: 1 for 2 scenes"):
        simulate_batch([wire(0)] * 2, 1.0, initial=[None])
    with pytest.raises(SceneError, match=r"scene 1: integrator.step: 0.001 s exceeds"):
        simulate_batch([wire(0), wire(0, **{"integrator.step": 1e-3})], 1.0, processes=1)
    points = Simulator(wire(0)).control_points
    for column, match in ((1, "leave the coordinates of the step"), (0, "finite numbers")):
        wrong = points.copy()
        wrong[4, column] = np.nan if column == 0 else 0.1
        with pytest.raises(ValueError, match=f"initial 0: control points: .*{match}"):
            simulate_batch([wire(0)], 1.0, initial=[(wrong, 0.0 * wrong)], processes=1)


def test_nets_move_as_in_simulators_of_their_own():
    """Where branches leave the number of their control points open, it is one for all."""
    changes = ({}, {"branches.b.cable.bending_stiffness": 0.02})
    nets = [harness(**one, **{"branches.b.discretization.control_points": 0}) for one in changes]
    result = simulate_batch(nets, 0.1, processes=1)
    count = result.control_points.shape[2] - Simulator(harness()).model.n + 8
    for k, changed in enumerate(changes):
        own = harness(**changed, **{"branches.b.discretization.control_points": count})
        np.testing.assert_array_equal(result.control_points[k, -1], alone(own, 0.1).control_points)
    assert not np.array_equal(*result.control_points[:, -1])
    fewer = harness(**{"branches.b.discretization.control_points": 9})
    with pytest.raises(ValueError, match="scene 0 has 8 control points of b, scene 1 has 9; give"):
        simulate_batch([harness(), fewer], 0.1)
    with pytest.raises(ValueError, match="scene 1 has the cables cable, a, b, scene 0"):
        simulate_batch([harness(), harness().with_values({"cables.names": []})], 0.1)
    hinged = harness(**{"branches.a.joint": "hinged"})
    with pytest.raises(ValueError, match="scene 1 has 31 control points with those of bodies"):
        simulate_batch([harness(), hinged], 0.1, processes=1)
