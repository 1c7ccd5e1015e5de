"""A setting tried on a job: what its times contain."""

import time

import numpy as np
import pytest
from cables import SOFT, scene_of

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.simulation import stepper
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, attempt

STILL = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros((2, 3))
COMPILING = 1000.0  # [s] that the compiler takes here
SLIDE = EndMotion(  # 1 cm upwards in a second
    0.0, 1.0, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, 0.0]]), *STILL
)


@pytest.fixture
def clock(monkeypatch):
    """Time passes only while a step is compiled."""
    now = [0.0]

    def bound(*arguments):
        now[0] += COMPILING
        return stepper_bound(*arguments)

    stepper_bound = stepper.bound
    monkeypatch.setattr(stepper, "bound", bound)
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    return now


def test_what_a_moved_end_has_compiled_is_not_run_time(clock):
    """The first setting with a moved end once took the blame for the compiler."""
    job = Job(scene_of(SOFT), 0.02, (0.5,), motions=(("start", SLIDE),))
    trial = attempt(job, Setting("velocity_verlet", 6, 5e-4), timed=False)
    assert trial.ok and trial.steps == 40
    assert clock[0] == 2.0 * COMPILING  # as the scene is, and with the moved end
    assert trial.first == 0.0


def test_a_simulator_is_made_ready_before_time_counts(clock):
    sim = Simulator(scene_of(SOFT, n=6, method="velocity_verlet", step=5e-4))
    assert sim.compile_seconds == COMPILING
    sim.set_motion("start", SLIDE)
    sim.make_ready()
    assert sim.compile_seconds == clock[0] == 2.0 * COMPILING
    assert sim.advance_steps(10).status.ok
    assert clock[0] == 2.0 * COMPILING
    sim.make_ready()
    assert clock[0] == 2.0 * COMPILING
