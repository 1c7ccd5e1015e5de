"""What predictions of recordings are compared with in `study validation`."""

import numpy as np
import robot_arm
from simulated_cables import TRUTH, bag_of, recorded
from test_forces import HANGING, PATH, TIMES

import dlo_sim
from dlo_sim.identification.measurement import Measurement
from dlo_sim.identification.prediction import COMPUTATION
from dlo_sim.studies.validation import spline_distance


def test_the_distance_from_a_smooth_cable_is_the_noise_of_the_markers():
    """Of 1 mm in each coordinate: sqrt(8 / pi) mm, less what the curve follows."""
    recording = recorded(TRUTH, duration=0.3)
    scene = dlo_sim.load_scene({**COMPUTATION, **recording.known, **TRUTH})
    assert 0.5e-3 < spline_distance((scene, recording)) < 2.0e-3
    quiet = recorded(TRUTH, duration=0.3, noise=1e-5)
    assert spline_distance((scene, quiet)) < 0.5e-3


def test_a_moved_cable_is_read_with_its_tips_and_compared(tmp_path):
    """Shapes with a tip in closed form: straight, half a circle, straight in a turned clamp."""
    scene = dlo_sim.load_scene(HANGING)
    length, weight = 0.5, 9.81 * (0.5 * 0.6 + 0.05 + 0.1)
    forces = np.tile([0.0, 0.0, -weight], (100, 1))
    still = np.repeat(PATH[:1], 100, axis=0)
    blank = np.zeros((100, 0, 3))
    run = Measurement("run", TIMES, blank, {"start": still}, np.zeros(0), forces=forces)
    (tmp_path / "bags").mkdir()
    bag_of(tmp_path / "bags" / "run", run)
    shapes = np.zeros((100, 3))  # Phi, Theta0, Theta1
    shapes[30:60, 1], shapes[60:, 0] = np.pi, 0.5 * np.pi
    rows = np.column_stack([TIMES, np.ones(100), np.full(100, 2.0), shapes])
    table = tmp_path / "dyn_ft" / "run" / "state_and_input.csv"
    table.parent.mkdir(parents=True)
    np.savetxt(table, rows, delimiter=",", header="ts,X,Z,Phi,Theta0,Theta1", comments="")
    read = robot_arm.recorded(tmp_path / "bags" / "run", scene)
    tips = read.markers[[0, 40, 80], 0]
    wanted = [[0.0, 0.0, -length], [-2.0 * length / np.pi, 0.0, 0.0], [-length, 0.0, 0.0]]
    assert np.abs(tips - [1.0, 0.0, 2.0] - wanted).max() < 1e-4
    ((name, numbers, _, x_rms, *_, z_rms, z_bias, tip),) = robot_arm.moving_rows(
        "run", scene, read, {}
    )
    assert (name, numbers) == ("run", "published")
    assert max(x_rms, z_rms, abs(z_bias)) < 1e-5
    assert tip > 0.5
