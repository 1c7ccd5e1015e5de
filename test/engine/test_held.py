"""What is held: projection, placing, clamps that move and turn, and their energy account."""

from dataclasses import replace

import numpy as np
import pytest
from cables import (
    BY_SPAN,
    CLAMPED,
    FULLY_DAMPED,
    NATURAL,
    SOFT,
    TWISTED,
    Bench,
    rotation,
    simulator,
    wild,
)

from dlo_sim.core.end_motion import EndMotion

TURNING = EndMotion.resting([0.0, 0.0, 0.0]).then(
    1.0,
    velocity=[0.1, -0.3, 0.2],
    acceleration=[0.6, 0.4, -0.8],
    angular_velocity=[2.0, -1.0, 1.5],
    angular_acceleration=[1.0, 2.0, -1.4],
)
TRANSLATING = replace(TURNING, angular_velocity=[0.0] * 3, angular_acceleration=[0.0] * 3)
SCENES = {
    "pinned": SOFT | {"start.clamped": False},
    "one axis": SOFT | {"start.clamped": False, "start.fixed": [False, False, True]},
    "planar clamp": SOFT,
    "two clamps": CLAMPED,
    "shortest": CLAMPED | {"discretization.control_points": 4},
}


@pytest.fixture(params=SCENES)
def bench(request):
    return Bench(SCENES[request.param])


@pytest.fixture
def clamped():
    bench = Bench(CLAMPED | TWISTED)
    bench.drive.follow("start", TURNING)
    bench.drive.motion[0, 0] = 1.0
    return bench


def some(bench, seed=0):
    """Velocities or forces, lines of shape (lines, n)."""
    return np.random.default_rng(seed).normal(size=(bench.model.lines, bench.n))


def flat(lines):
    """Lines as a vector of all (n, lines) degrees of freedom."""
    return lines.T.ravel()


def projector(bench, t=0.0):
    """P = 1 - M^-1 B^T (B M^-1 B^T)^-1 B in plain numpy."""
    rows, _ = bench.held(t)
    shifts = np.linalg.solve(bench.mass(), rows.T)
    return np.eye(rows.shape[1]) - shifts @ np.linalg.solve(rows @ shifts, rows)


def put_motion(bench, rates, seed=0):
    """Give the cable velocities; what it keeps of them is the projected velocity."""
    bench.cable.put(wild(bench, seed), bench.model.to_columns(rates, rest=False))
    return flat(bench.cable.w)


def test_projection_takes_out_what_moves_the_held_and_nothing_else(bench):
    """Idempotent, orthogonal in the mass, and equal to the formula."""
    rates = some(bench)
    once = put_motion(bench, rates)
    rows, _ = bench.held(0.0)
    assert len(rows) == bench.cable.arrays.rows.count
    assert np.abs(rows @ flat(rates)).max() > 0.1
    assert np.abs(rows @ once).max() < 1e-13
    assert np.abs(once - projector(bench) @ flat(rates)).max() < 1e-12
    again = put_motion(bench, bench.cable.w.copy())
    assert np.abs(again - once).max() < 1e-13
    away = flat(rates) - once
    scale = once @ bench.mass() @ once
    assert abs(away @ bench.mass() @ put_motion(bench, some(bench, 1))) < 1e-12 * scale


@pytest.mark.parametrize("grading", [0.0, 0.5])
def test_accelerations_are_those_of_the_constrained_cable(grading):
    bench = Bench(CLAMPED | TWISTED, n=9, grading=grading)
    force = some(bench)
    found = flat(bench.cable.free_acceleration(force))
    expected = projector(bench) @ np.linalg.solve(bench.mass(), flat(force))
    assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()


def test_a_drift_places_what_is_held_exactly_and_leaves_the_clamps_length_free(clamped):
    """After a jump the rows have their targets; the neighbour's distance is what was free."""
    cable, points = clamped.cable, wild(clamped)
    clamped.drive.put(points, 0.0, cable.held_twists(0.0))
    cable.put(points, 0.0 * points)
    cable.jump(0.3, lambda points: None)
    rows, targets = clamped.held(0.3)
    assert np.abs(rows @ flat(cable.x) - targets).max() < 1e-14
    assert np.array_equal(cable.x[:3, 0], clamped.drive.held_at("start", 0.3)[0])  # to the last bit
    arm = cable.x[:3, 1] - cable.x[:3, 0]
    tangent = clamped.drive.tangent("start", 0.3)
    assert np.abs(np.cross(arm, tangent)).max() < 1e-14
    before = np.linalg.norm(points[1, :3] - points[0, :3])
    assert abs(np.linalg.norm(arm) - before) > 1e-4  # not the third of the first span
    # Everything else follows with the mass: the change is M^-1 B^T times multipliers.
    pushed = clamped.mass() @ flat(cable.x - clamped.model.to_lines(points))
    left = pushed - rows.T @ np.linalg.lstsq(rows.T, pushed, rcond=None)[0]
    assert np.abs(left).max() < 1e-12 * np.abs(pushed).max()


@pytest.mark.parametrize("t", [0.05, 0.4, 0.9])
def test_velocities_are_those_that_keep_the_rows(clamped, t):
    """B v = d/dt (targets) - (d/dt B) x, and w is what is M-orthogonal to it."""
    cable, points = clamped.cable, wild(clamped)
    cable.point_grasps(t)
    cable.put(points, np.random.default_rng(3).normal(size=(clamped.n, 4)))
    h, x = 1e-5, flat(cable.x)
    (low, below), (high, above) = clamped.held(t - h), clamped.held(t + h)
    rows, _ = clamped.held(t)
    v = flat(cable.velocities(t))
    asked = ((above - below) - (high - low) @ x) / (2 * h)
    assert np.abs(asked).max() > 0.3
    assert np.abs(rows @ v - asked).max() < 1e-8
    assert np.abs(projector(clamped, t) @ v - flat(cable.w)).max() < 1e-12


def test_the_force_that_holds_gives_the_accelerations_of_the_grasps(clamped):
    """B M^-1 (f + B^T lambda) is the second derivative that moving targets ask for."""
    t, h, cable = 0.4, 1e-4, clamped.cable
    cable.point_grasps(t)
    cable.put(wild(clamped), np.zeros((clamped.n, 4)))
    x, v = flat(cable.x), flat(cable.velocities(t))
    (low, below), (rows, now), (high, above) = (clamped.held(t + d * h) for d in (-1, 0, 1))
    asked = (above - 2 * now + below - (high - 2 * rows + low) @ x) / h**2
    asked = asked - (high - low) @ v / h
    pulls = cable.held_force(t)
    force = flat(cable.forces(t)) + rows.T @ pulls
    found = rows @ np.linalg.solve(clamped.mass(), force)
    assert np.abs(asked).max() > 0.5
    assert np.abs(found - asked).max() < 1e-4 * np.abs(asked).max()


MOTIONS = pytest.mark.parametrize("motion", [TRANSLATING, TURNING], ids=["translating", "turning"])


def moved(motion, values, **more):
    sim = simulator(CLAMPED, values, n=7, **more)
    sim.set_motion("start", motion)
    report = sim.advance(0.5)
    assert report.status.ok, report.message
    return sim


def clamp_defect(sim, motion):
    """How far the clamp's neighbour is off the tangent, and its distance from the attachment."""
    s = sim.time
    w1, w2 = motion.rotation_coefficients
    turn = rotation(s * w1 + s * s * w2) if motion is TURNING else 1
    tangent = turn @ np.array([0.6, 0.0, 0.8]) if motion is TURNING else np.array([0.6, 0.0, 0.8])
    arm = sim.control_points[1, :3] - sim.control_points[0, :3]
    return np.abs(np.cross(arm, tangent)).max(), float(arm @ tangent)


@MOTIONS
@pytest.mark.parametrize("values", [{}, BY_SPAN, FULLY_DAMPED], ids=["plain", "by_span", "damped"])
def test_energy_momentum_closes_the_account_exactly(motion, values):
    damping = {key: value for key, value in values.items() if key.split(".")[0] != "end"}
    sim = moved(motion, damping | CLAMPED | NATURAL, method="energy_momentum", step=2e-3)
    assert sim.energy_error < 1e-9
    assert clamp_defect(sim, motion)[0] < 1e-12
    assert abs(sim.cable.account.drive_work) > 1e-2
