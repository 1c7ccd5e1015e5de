"""What predictions of recordings are compared with in `study validation`."""

from simulated_cables import TRUTH, recorded

import dlo_sim
from dlo_sim.identification.prediction import COMPUTATION
from dlo_sim.studies.validation.references import spline_distance


def test_the_distance_from_a_smooth_cable_is_the_noise_of_the_markers():
    """Of 1 mm in each coordinate: sqrt(8 / pi) mm, less what the curve follows."""
    recording = recorded(TRUTH, duration=0.3)
    scene = dlo_sim.load_scene({**COMPUTATION, **recording.known, **TRUTH})
    assert 0.5e-3 < spline_distance((scene, recording)) < 2.0e-3
    quiet = recorded(TRUTH, duration=0.3, noise=1e-5)
    assert spline_distance((scene, quiet)) < 0.5e-3
