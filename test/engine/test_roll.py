"""Roll between strands and bodies."""

import numpy as np
import pytest
from bodies import FREE, Assembly, Body, Roll, relaxed, straight
from cables import scene_of
from numba import boolean, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.core import bspline, rotations
from dlo_sim.engine import roll as engine
from dlo_sim.engine.arrays import BETWEEN, IMPLICIT, cable_at
from dlo_sim.simulation.holding import Point

WIRE = FREE | {
    "cable.length": 0.3,
    "cable.diameter": 0.006,
    "cable.density": 1000.0,
    "cable.youngs_modulus": 2e6,
    "cable.shear_modulus": 1e6,
    "terms.twist": "bishop",
    "terms.stretch": "on",
    "initial.shape": "straight",
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.position": [0.3, 0.0, 0.0],
    "end.tangent": [1.0, 0.0, 0.0],
}
GJ = 1e6 * np.pi * 0.006**4 / 32.0
INERTIA = 2e-6
N = 11


@kernel(void, int64, ARRAY_2D, ARRAY_2D, boolean, family=IMPLICIT | BETWEEN)
def rows_between(address, x0, x1, twists):
    engine.set_rolls(cable_at(address), grid(x0), grid(x1), twists)


def headed(stiffness=np.inf, step=1e-3, method="energy_momentum", **more):
    """A strand with a body at its start, clamped at its end, straight along x."""
    scene = scene_of(WIRE, n=N, **more)
    first = 0.3 / (N - 3) / 3.0
    moments = (INERTIA, 3e-6, 4e-6)
    body = Body((2, 3, 0, 1), (first, 0.01, 0.012), 1e3, 0.02, (-0.01, 0.002, 0.0), moments)
    body = Body(**(vars(body) | {"idle": (0, 0, 1, 1)}))
    roll = Roll(0, 2, (1.0, 0.0, 0.0, 0.0), stiffness)
    whole = Assembly([2, scene], [body], [roll], method=method, step=step)
    points = np.zeros((N + 2, 4))
    points[2:] = straight(whole.models[1], [0.0, 0.0, 0.0])
    points[0, :3], points[1, :3] = [0.0, 0.01, 0.0], [0.0, 0.0, 0.012]
    return whole, points


def turned(whole, points, vector):
    """The body turned about its origin."""
    turn, out = rotations.to_matrix(rotations.from_rotation_vector(vector)), points.copy()
    own = list(whole.bodies[0].points)
    out[own, :3] = points[own[0], :3] + (points[own, :3] - points[own[0], :3]) @ turn.T
    return out


def rows_of(whole, first, second):
    """F and C over all control points, shape (n, 4), and the gap at the second configuration."""
    cable = whole.cable
    ends = [cable.padded(cable.model.to_lines(points)) for points in (first, second)]
    cable.call(rows_between, *ends, True)
    out = []
    for rows in (cable.arrays.work.roll_force[0], cable.arrays.work.roll_condition[0]):
        row = np.zeros((whole.n, 4))
        row[2:6] += rows[0].reshape(4, 4)
        row[0:4] += rows[1].reshape(4, 4)
        out.append(row)
    return *out, cable.arrays.work.border_gap[0]


def test_the_roll_of_a_body_turned_by_hand():
    whole, points = headed()
    points[2:, 3] = 0.3
    whole.put(points)
    assert rows_of(whole, points, points)[2] == pytest.approx(0.0, abs=1e-15)
    for angle in (0.4, -3.0):
        gap = rows_of(whole, points, turned(whole, points, [angle, 0.0, 0.0]))[2]
        assert gap == pytest.approx(-angle, abs=1e-14)
    aside = rows_of(whole, points, turned(whole, points, [0.0, 0.5, 0.7]))[2]
    assert aside == pytest.approx(0.0, abs=1e-14)


def test_its_forces_do_the_work_of_the_moment():
    """Exactly, for large turns and strained bodies, and without a net force."""
    whole, points = headed()
    random = np.random.default_rng(3)
    start = turned(whole, points, [0.3, -0.5, 0.8])
    whole.put(start)
    for size in (1.0, 1e-3, 1e-6):
        end = turned(whole, start, size * np.array([0.9, 0.6, -0.4]))
        end += 1e-4 * size * random.standard_normal(end.shape)
        force, _, gap = rows_of(whole, start, end)
        assert (force * (end - start)).sum() == pytest.approx(gap, abs=1e-14)
        assert np.abs(force[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(force).max()


def test_a_rigid_body_feels_a_couple_about_the_mean_tangent():
    whole, points = headed()
    whole.put(points)
    for vector in ([0.9, 0.6, -0.4], [2.5, 0.0, 0.3]):
        end = turned(whole, points, vector)
        force, _, _ = rows_of(whole, points, end)
        middle = 0.5 * (points + end)[:, :3]
        torque = np.cross(middle, force[:, :3]).sum(axis=0)
        mean = (points + end)[3, :3] - (points + end)[2, :3]
        assert np.abs(np.cross(torque, mean)).max() < 1e-12 * np.linalg.norm(mean)
        assert torque @ mean < 0.0


def test_its_condition_is_the_derivative():
    whole, points = headed()
    whole.put(points)
    end = turned(whole, points, [0.5, 0.4, -0.6])
    _, condition, _ = rows_of(whole, points, end)
    for vector in np.eye(3) * 1e-6:
        ahead, behind = (turned(whole, end, sign * vector) for sign in (1.0, -1.0))
        change = rows_of(whole, points, ahead)[2] - rows_of(whole, points, behind)[2]
        assert (condition * (ahead - behind)).sum() == pytest.approx(change, abs=1e-12)


@pytest.mark.parametrize("twist", ["bishop", "quasistatic"])
@pytest.mark.parametrize("stiffness", [np.inf, 2e-4], ids=["rigid", "gives"])
def test_a_body_on_a_twisted_strand_is_a_torsional_pendulum(stiffness, twist):
    """phi(t) = cos(omega t), of the strand and the roll in series; a third of the polar inertia of
    the strand, 0.2 % of that of the body, moves with it."""
    whole, points = headed(stiffness, step=2e-3, terms__twist=twist)
    whole.put(points)
    start = turned(whole, points, [1.0, 0.0, 0.0])
    series = 1.0 / (0.3 / GJ + 1.0 / stiffness)
    u = bspline.greville(whole.models[1].knots)
    start[2:, 3] = series * (0.3 - u) / GJ
    whole.cable.put(start, np.zeros_like(start), strained=[start[2, 3] - 1.0])
    whole.cable.open_account()
    omega = np.sqrt(series / INERTIA)
    for time in (0.1, 0.2, 0.4):
        whole.advance(round(time / 2e-3) - whole.steps)
        e = whole.directors()[1:]
        angle = np.arctan2(e[1, 2], e[1, 1])
        # Quasistatic twist is damped as by half a step.
        left = np.exp(-0.25 * omega**2 * 2e-3 * time) if twist == "quasistatic" else 1.0
        assert angle == pytest.approx(left * np.cos(omega * time), abs=0.02)
    assert whole.cable.share_open() < 1e-6


@pytest.mark.parametrize("method", ["energy_momentum", "implicit_midpoint"])
@pytest.mark.parametrize("stiffness", [np.inf, 2e-4], ids=["rigid", "gives"])
def test_the_energy_of_a_strand_with_a_tumbling_body_is_kept(stiffness, method):
    whole, points = headed(stiffness, step=1e-3, method=method, integrator__tolerance=1e-12)
    rates = np.zeros_like(points)
    rates[0, :3], rates[1, :3] = [0.0, 0.1, 0.3], [0.0, -0.36, 0.1]
    rates[:3, 1] += 0.3
    whole.put(points, rates)
    whole.advance(300)
    now = whole.cable.points
    assert np.abs(now[3, :3] - points[3, :3]).max() > 0.01 and abs(now[2, 3]) > 0.3
    exact = method == "energy_momentum"
    assert whole.cable.share_open() < (1e-10 if exact else 0.02)
    if np.isinf(stiffness):
        assert abs(rows_of(whole, now, now)[2]) < 1e-9


def test_a_search_for_the_shape_alone_turns_a_body_to_its_strand():
    whole, points = headed(gravity=[0.0, 0.0, -9.81])
    points[2:, 3] = 0.2
    whole.put(points)
    relaxed_from = turned(whole, points, [0.5, 0.0, 0.0])
    whole.cable.x[:] = whole.cable.model.to_lines(relaxed_from)
    relaxed(whole.cable, 0.3)
    found = whole.cable.points
    assert np.abs(found[2, 2]) > 0.01 and np.all(found[2:, 3] == 0.2)
    assert rows_of(whole, found, found)[2] == pytest.approx(0.0, abs=1e-9)
    assert abs(whole.directors()[2, 2]) < 1e-3


def in_line(stiffness):
    """Two strands joined by a body between them, held at their far ends, one of which is turned."""
    left = {"start.fixed": [True] * 3, "start.clamped": True, "start.tangent": [1.0, 0.0, 0.0]}
    free = {"end.fixed": [False] * 3, "end.clamped": False}
    right = {"cable.length": 0.15, "start.position": [0.3, 0.0, 0.0]}
    scenes = [
        scene_of(WIRE, left, free, n=N),
        scene_of(WIRE, right, {"end.position": [0.45, 0.0, 0.0]}, n=N),
    ]
    body = Body((N, N + 1, N + 2, N + 3), (0.01, 0.01, 0.01), 1e3, 0.01, (0.0, 0.0, 0.0))
    far = N + 4
    rolls = [Roll(0, N - 4, (0.0, 0.0, 0.0, 1.0)), Roll(0, far, (1.0, 0.0, 0.0, 0.0), stiffness)]
    slopes = 3.0 * (N - 3) / 0.3, 3.0 * (N - 3) / 0.15
    rows = []
    for first, place, along in (
        (N - 4, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, -slopes[0], slopes[0])),
        (far, (1.0, 0.0, 0.0, 0.0), (-slopes[1], slopes[1], 0.0, 0.0)),
    ):
        at = Point(first, place, other=N, other_weights=(-1.0, 0.0, 0.0, 0.0))
        aim = Point(first, along, other=N, other_weights=(100.0, -100.0, 0.0, 0.0))
        rows += [(point, line) for point in (at, aim) for line in range(3)]
    whole = Assembly([scenes[0], 4, scenes[1]], [body], rolls, rows)
    points = np.zeros((2 * N + 4, 4))
    points[:N] = straight(whole.models[0], [0.0, 0.0, 0.0])
    points[far:] = straight(whole.models[2], [0.3, 0.0, 0.0])
    points[N:far, 0] = 0.3
    points[N + 1 : far, :3] += 0.01 * np.eye(3)
    whole.put(points)
    return whole, points


@pytest.mark.parametrize("bent", [0.0, 0.02], ids=["straight", "bent"])
@pytest.mark.parametrize("stiffness", [np.inf, 3e-4], ids=["rigid", "gives"])
def test_strands_in_line_share_the_roll_by_their_stiffnesses(stiffness, bent):
    """M = pi / (L1 / GJ + L2 / GJ + 1 / k); also from a shape that is not yet straight, up to the
    error of the frame that follows it."""
    whole, points = in_line(stiffness)
    points[-1, 3] = np.pi
    whole.put(points)
    points[2:-2, 2] += bent * np.sin(np.pi * points[2:-2, 0] / 0.45)
    whole.cable.x[:] = whole.cable.model.to_lines(points)
    whole.cable.open_frame()
    relaxed(whole.cable, 0.45, twist=True)
    moment = np.pi / (0.3 / GJ + 0.15 / GJ + 1.0 / stiffness)
    found, near = whole.cable.points, 1e-4 if bent else 1e-6
    assert found[N - 1, 3] == pytest.approx(moment * 0.3 / GJ, abs=near)
    assert found[N + 4, 3] == pytest.approx(np.pi - moment * 0.15 / GJ, abs=near)
    e = whole.directors()[1:]
    assert np.arctan2(e[1, 2], e[1, 1]) == pytest.approx(moment * 0.3 / GJ, abs=near)
    assert np.abs(found[:, 2]).max() < 0.011
