"""Every method against an independent solution: order and size of its error.

The scene is nonlinear: a clamp that moves and turns, springs, weight, natural curvature, a swinging
force and moment, and damping where the method admits it.
"""

from functools import cache

import numpy as np
import pytest
from cables import (
    FULL,
    FULLY_DAMPED,
    MASS_DAMPED,
    MOTIONS,
    SINE_LOAD,
    Bench,
    Reference,
    simulator,
    straight,
)

from dlo_sim.core.methods import IMPLICIT, METHODS

DURATION = 0.08  # [s]; 5 cm and 0.35 rad of the clamp, some 10 cm of the middle
LOAD = SINE_LOAD | {"loads.tip.position": 0.6}
DAMPING = {"undamped": FULL, "mass": MASS_DAMPED, "all": FULLY_DAMPED}
SAME_EQUATIONS = list(METHODS.values())


def motions(springs_move):
    """They go on beyond the run, so that velocities at its end are those of moving ends."""
    return MOTIONS if springs_move else {"start": MOTIONS["start"]}


@cache
def reference(damping, springs_move, precision=1e-10):
    """Control points and velocities after the run, by an independent Runge-Kutta program."""
    bench = Bench(DAMPING[damping], LOAD, n=6)
    for end, motion in motions(springs_move).items():
        bench.drive.follow(end, motion)
    solver, q = Reference(bench, DURATION), straight(bench)[:, :3]
    return solver.run(q, solver.at_rest(q), precision)


def errors(method, damping, steps, springs_move):
    """Largest errors of the shape [m] and of its velocity [m/s]."""
    sim = simulator(DAMPING[damping], LOAD, n=6, method=method, step=DURATION / steps)
    for end, motion in motions(springs_move).items():
        sim.set_motion(end, motion)
    report = sim.advance_steps(steps)
    assert report.status.ok, report.message
    q, v = reference(damping, springs_move)
    return [np.abs(sim.control_points[:, :3] - q).max(), np.abs(sim.velocities[:, :3] - v).max()]


@cache
def convergence(method, damping, springs_move=False):
    """Slopes between successive step sizes, and the errors at the largest step."""
    counts = (340, 480, 680, 960) if method.order == 4 else (400, 800, 1600, 3200)
    if method.order == 4 and method.family == IMPLICIT:
        counts = (120, 170, 240, 340)  # finer steps err by less than the solver's tolerance
    found = np.array([errors(method.name, damping, n, springs_move) for n in counts])
    return -np.diff(np.log(found), axis=0) / np.diff(np.log(counts))[:, None], found[0]


def admitted(method, damping):
    return {
        "undamped": True,
        "mass": method.mass_damping,
        "all": method.mass_damping and method.stiffness_damping,
    }[damping]


# Every method with every damping that it admits.
PAIRS = pytest.mark.parametrize(
    ("method", "damping"),
    [
        pytest.param(method, damping, id=f"{method.name}-{damping}")
        for method in SAME_EQUATIONS
        for damping in DAMPING
        if admitted(method, damping)
    ],
)


def test_reference_is_converged():
    for damping in DAMPING:
        coarse, fine = reference(damping, False, 1e-9), reference(damping, False)
        assert np.abs(coarse[0] - fine[0]).max() < 4e-11
        assert np.abs(coarse[1] - fine[1]).max() < 2e-8  # measured 1.1e-8
        assert np.abs(fine[0] - straight(Bench(FULL, n=6))[:, :3]).max() > 0.05


def assert_order(method, orders):
    """Of rk4 the shape's error of fourth order is small, so that the fifth still shows: measured
    4.6, 4.3, 4.2."""
    assert orders.min() > method.order - 0.1
    assert orders.max() < method.order + (0.7 if method.name == "rk4" else 0.1)


@PAIRS
def test_shape_has_the_declared_order(method, damping):
    orders, first = convergence(method, damping)
    assert_order(method, orders[:, 0])
    assert np.abs(orders[:, 1] - method.order).max() < 0.05
    assert first[0] < {2: 4e-6, 4: 1e-8}[method.order]
    # The first span of a clamp is free and rings: measured 9.5e-4 and 2.4e-5.
    assert first[1] < {2: 1e-3, 4: 3e-5}[method.order]


@pytest.mark.parametrize("method", SAME_EQUATIONS, ids=lambda method: method.name)
def test_order_holds_with_springs_that_are_moved(method):
    orders, first = convergence(method, "undamped", springs_move=True)
    assert_order(method, orders[:, 0])
    assert first[0] < {2: 4e-6, 4: 1e-8}[method.order]
