"""Forces that a moved cable exerts: predicted, read from a bag, fitted."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_cables import bag_of, poses

import dlo_sim
from dlo_sim.batch.workers import HERE
from dlo_sim.identification.fit import FitError
from dlo_sim.identification.identify import identify
from dlo_sim.identification.measurement import Measurement, MeasurementError, clamped_at
from dlo_sim.identification.prediction import COMPUTATION, Sensor, predict
from dlo_sim.identification.readers import read_recordings

TIMES = np.arange(0.0, 2.0, 0.02)
PATH = poses(TIMES, 1.0, 3)["start"]
HANGING = {
    **COMPUTATION,
    **clamped_at({"start": PATH}),
    "cable.length": 0.5,
    "cable.diameter": 0.01,
    "cable.linear_density": 0.6,
    "cable.axial_stiffness": 500.0,
    "cable.bending_stiffness": 0.05,
    "damping.stiffness": 0.1,
    "damping.air_drag": 0.2,
    "start.mass": 0.05,
    "end.mass": 0.1,
    "end.position": (PATH[0, :3] - [0.0, 0.0, 0.5]).tolist(),
}
SENSOR = Sensor((0.04, 0.0, -0.02), (0.3, 0.0, -0.2))
WEIGHT = 9.81 * (0.5 * 0.6 + 0.05 + 0.1)


@pytest.fixture(scope="module")
def moved():
    """A run whose forces are those of HANGING, as SENSOR reads them with 0.02 N of noise."""
    blank = Measurement(
        "run", TIMES, np.zeros((100, 0, 3)), {"start": PATH}, np.zeros(0), forces=np.zeros((100, 3))
    )
    made = predict(dlo_sim.load_scene(HANGING), blank, sensor=SENSOR)
    noise = np.random.default_rng(2).normal(0.0, 0.02, (100, 3))
    return replace(blank, forces=made.forces + noise)


def fitted(recording, keys=(), **changes):
    scene = dlo_sim.load_scene({**HANGING, **changes})
    return identify(
        scene, {}, [recording], HERE, keys, 0.3, 5.0, lambda share: None, lambda line: None
    )


def test_the_load_of_a_cable_at_rest_is_its_weight(moved):
    still = replace(moved, poses={"start": np.repeat(PATH[:1], 100, axis=0)})
    made = predict(dlo_sim.load_scene(HANGING), still)
    assert not made.failure
    assert np.abs(made.forces - [0.0, 0.0, -WEIGHT]).max() < 1e-5


@pytest.mark.parametrize("drag", [(0.2, 1.0), (2.0, 0.0)])
def test_the_load_of_a_moved_cable_is_its_reaction(moved, drag):
    """The reaction is the mean of a step: that at an instant is the mean of the steps around it."""
    step, last = 0.0025, 160
    times = step * np.arange(last + 3)
    path = poses(times, 1.0, 3)["start"]
    dragged = {"damping.air_drag": drag[0], "damping.air_drag_ratio": drag[1]}
    scene = dlo_sim.load_scene({**HANGING, **dragged, "integrator.step": step, "start.mass": 0.0})
    recording = replace(moved, times=times, poses={"start": path})
    load = predict(scene, recording).forces[last]
    reactions = []
    for count in (last + 1, last + 2):
        resting = scene.with_values({"initial.shape": "equilibrium"})
        sim = dlo_sim.Simulator(resting, {"start": (path[0, :3], path[0, 3:])})
        report, _ = sim.follow(times[:count], {"start": path[:count]}, times[1:count])
        assert report.status.ok
        reactions.append(sim.reaction("start")[0])
    assert np.abs(np.mean(reactions, axis=0) + load).max() < 0.05
    assert np.abs(load - [0.0, 0.0, -9.81 * 0.4]).max() > 0.3


def test_a_delayed_sensor_reads_what_was_and_its_offset(moved):
    scene = dlo_sim.load_scene(HANGING)
    plain = predict(scene, moved).forces
    late = predict(scene, moved, sensor=Sensor((0.04, 0.0, 0.0), (0.0, 0.5, 0.0))).forces
    assert np.abs(late[2:, 0] - plain[:-2, 0]).max() < 1e-9
    assert np.abs(late[:, 1] - plain[:, 1] - 0.5).max() < 1e-12
    assert np.ptp(plain[:, 0]) > 0.5


def test_material_and_sensor_are_found_from_forces(moved):
    keys = ("cable.bending_stiffness", "sensor.delay", "sensor.offset")
    found = fitted(moved, keys, **{"cable.bending_stiffness": 0.1})
    truth = {"cable.bending_stiffness": 0.05}
    for k in range(3):
        truth |= {f"sensor.delay[{k}]": SENSOR.delay[k], f"sensor.offset[{k}]": SENSOR.offset[k]}
    assert {number.unknown.label for number in found.fit.numbers} == set(truth)
    for number in found.fit.numbers:
        margin = 0.5 * (number.high - number.low)
        assert number.low - margin < truth[number.unknown.label] < number.high + margin
        assert number.high - number.low < 0.05
    assert [axis.correlation > 0.9 for axis in found.reactions] == [True, True, True]
    assert (found.pieces, found.left_out, found.scores) == (1, 0, {})


def test_a_force_of_two_grippers_is_refused(moved):
    with pytest.raises(FitError, match=r"held by start, end; .* set end\.fixed to"):
        fitted(moved, **{"end.fixed": [True, True, True]})


def test_a_bag_of_a_wrench_gives_the_recording(moved, tmp_path):
    (found,) = read_recordings(bag_of(tmp_path / "bag", moved))
    assert np.abs(found.times - moved.times).max() < 1e-9
    assert np.abs(found.forces - moved.forces).max() < 1e-12
    assert np.abs(found.poses["start"] - PATH).max() < 1e-9
    broken = replace(moved, forces=np.where(TIMES[:, None] < 1.0, moved.forces, np.nan))
    with pytest.raises(MeasurementError, match="/ft: .* is not finite; repair"):
        read_recordings(bag_of(tmp_path / "broken", broken))


def test_poses_are_smoothed_as_the_scene_says(moved):
    noise = np.random.default_rng(4).normal(0.0, 1e-3, PATH.shape) * [1, 1, 1, 0, 0, 0, 0]
    noisy = replace(moved, poses={"start": PATH + noise})
    assert np.all(
        noisy.smoothed(dlo_sim.load_scene(HANGING)).poses["start"] == noisy.poses["start"]
    )
    scene = dlo_sim.load_scene({**HANGING, "start.pose_smoothing": 0.1})
    smooth = noisy.smoothed(scene).poses["start"]
    assert np.std((smooth - PATH)[:, :3]) < 0.7 * np.std(noise[:, :3])


def test_a_failed_simulation_is_named_and_keeps_its_last_shape(moved, monkeypatch):
    follow = dlo_sim.Simulator.follow

    def failing(self, times, paths, samples):
        report, points = follow(self, times, paths, samples)
        return report._replace(message="diverged (at 0.1 s)"), points[:10]

    monkeypatch.setattr(dlo_sim.Simulator, "follow", failing)
    tip = replace(moved, markers=np.zeros((100, 1, 3)), shares=np.ones(1))
    made = predict(dlo_sim.load_scene(HANGING), tip)
    assert made.failure == "diverged (at 0.1 s)"
    assert np.all(made.markers[10:] == made.markers[-1])
