"""Nothing grows: neither a session over many messages, nor a simulator over many steps."""

import gc
import sys
import tracemalloc

import numpy as np
import pytest
from soak import resident_bytes, soak

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator

ROUNDS, WARM_ROUNDS = 7, 5
STEPS = 5000  # from one look to the next


def moving(method):
    """The paper's wire, straight, with half a sine wave of downward velocity."""
    step = 2e-3 if METHODS[method].family == IMPLICIT else 0.0
    values = {
        "discretization.control_points": 9,
        "discretization.quadrature": "gauss",
        "discretization.samples": 3,
        "integrator.method": method,
        "integrator.step": step,
    }
    simulator = Simulator(load_scene("paper_wire", values))
    rates = np.zeros((9, 4))
    phase = np.pi * simulator.greville / simulator.scene.cable.length
    rates[1:-1, 2] = -0.3 * np.sin(phase[1:-1])
    simulator.start_from(simulator.control_points, rates)
    return simulator


def blocks_left(simulator, calls):
    """Blocks of Python's allocator that so many calls of `advance_steps` leave: the median of a few
    rounds, because a late release changes the count in some. The first rounds, in which the
    interpreter fills its free lists, do not count.
    """
    counts = np.zeros(WARM_ROUNDS + ROUNDS, dtype=np.int64)  # holds no Python objects
    for k in range(len(counts)):
        for _ in range(calls):
            simulator.advance_steps(1)
        gc.collect()
        counts[k] = sys.getallocatedblocks()
    return int(np.median(np.diff(counts[WARM_ROUNDS - 1 :])))


def traced(simulator, calls, steps):
    """Traced bytes (Python's and numpy's) that calls of `advance_steps` leave behind, and the most
    in use meanwhile beyond those before."""
    tracemalloc.start()
    try:
        for _ in range(calls):
            simulator.advance_steps(steps)
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        for _ in range(calls):
            simulator.advance_steps(steps)
        after, peak = tracemalloc.get_traced_memory()
        return after - before, peak - before
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("method", ["forest_ruth", "energy_momentum"])
def test_memory_does_not_grow_over_steps(method):
    simulator = moving(method)
    resident = np.zeros(21)
    for _ in range(500):  # the first hundred readings themselves allocate a few pages
        resident_bytes()
    for look in range(len(resident)):
        assert simulator.advance_steps(STEPS).status.ok
        resident[look] = resident_bytes()
    # A byte a step would be 90 KB; a page or two are the interpreter's. Measured: 0.
    assert resident[-1] - resident[2] < 64 * 1024
    # A block a call would be 1000; a score now and then is the test runner's own.
    assert blocks_left(simulator, 1000) < 100
    assert traced(simulator, 200, 1)[0] < 200
    # Both are long enough to look at the shape, which takes two kilobytes for a moment.
    assert traced(simulator, 1, 25_000)[1] < traced(simulator, 1, STEPS)[1] + 1000


def test_what_is_left_behind_is_seen():
    simulator = moving("forest_ruth")
    kept, original = [], simulator.advance_steps

    def leaking(count):
        kept.append(np.zeros(64))
        return original(count)

    simulator.advance_steps = leaking
    assert blocks_left(simulator, 200) >= 200
    assert traced(simulator, 200, 1)[0] > 200 * 512


def test_a_session_does_not_grow_over_messages():
    first, *_, last = looks = list(soak(60.0))
    assert last.time == pytest.approx(60.0, abs=0.5)
    assert max(look.energy_error for look in looks) < 1e-4
    assert (last.files, last.threads, last.refused) == (first.files, first.threads, 0)
