"""Roll between strands and bodies."""

import numpy as np
import pytest
from nets import WEIGHTLESS, net
from numba import boolean, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.core import rotations
from dlo_sim.engine import roll as engine
from dlo_sim.engine.arrays import BETWEEN, IMPLICIT, cable_at
from dlo_sim.simulation.statics import relax

X, Y = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
GJ, INERTIA, LENGTH = 1.3e-4, 2e-6, 0.3
CLAMPED = {
    "cable.length": LENGTH,
    "cable.diameter": 0.003,
    "cable.linear_density": 0.03,
    "cable.axial_stiffness": 200.0,
    "cable.bending_stiffness": GJ,
    "cable.torsional_stiffness": GJ,
    "start.clamped": True,
    "start.tangent": X,
    "end.position": [LENGTH, 0.0, 0.0],
    "terms.twist": "bishop",
    "terms.out_of_plane": "on",
    "discretization.control_points": 11,
    "integrator.step": 1e-3,
}
SHORT = {  # across the end of the other one, next to massless
    "at": 1.0,
    "direction": Y,
    "cable.length": 0.06,
    "cable.linear_density": 1e-4,
    "discretization.control_points": 5,
}
RIGID, ELASTIC = {"joint": "rigid"}, {"joint": "elastic", "joint_stiffness": 2e-3}
ways = pytest.mark.parametrize("joint", [RIGID, ELASTIC], ids=["rigid", "gives"])


@kernel(void, int64, ARRAY_2D, ARRAY_2D, boolean, family=IMPLICIT | BETWEEN)
def rows_between(address, x0, x1, twists):
    engine.set_rolls(cable_at(address), grid(x0), grid(x1), twists)


def headed(joint=RIGID, center=(0.0, 0.0, 0.0), **more):
    """A strand along x with a body at its end, in which another one begins along y."""
    values = {"on": "b", "at": 0.0, "mass": 0.02, "center": list(center)}
    values["inertia"] = [3e-6, INERTIA, 4e-6]  # the second one about the strand
    body = {f"connectors.plug.{key}": value for key, value in values.items()}
    given = {key.replace("__", "."): value for key, value in more.items()}
    body["connectors.names"] = ["plug"]
    return net(WEIGHTLESS, CLAMPED, body, given, b=SHORT | joint)


def turned(sim, points, vector):
    """The body turned about its origin."""
    turn, out = rotations.to_matrix(rotations.from_rotation_vector(vector)), points.copy()
    own = sim.model.bodies[0].points
    out[own, :3] = points[own[0], :3] + (points[own, :3] - points[own[0], :3]) @ turn.T
    return out


def turn_of(sim):
    """Angle [rad] of the body about the x axis."""
    points = sim.cable.points[sim.model.bodies[0].points, :3]
    return np.arctan2(*(points[1] - points[0])[[2, 1]])


def rows_of(sim, first, second):
    """F and C of the strand over all control points, (n, 4), and the gap at the second shape."""
    cable = sim.cable
    ends = [cable.padded(cable.model.to_lines(points)) for points in (first, second)]
    cable.call(rows_between, *ends, True)
    rolls, work, out = cable.arrays.rolls, cable.arrays.work, []
    for rows in (work.roll_force[0], work.roll_condition[0]):
        row = np.zeros((sim.model.n, 4))
        for begin, own in zip((rolls.first[0], sim.model.bodies[0].first), rows, strict=True):
            row[begin : begin + 4] += own.reshape(4, 4)
        out.append(row)
    return *out, work.border_gap[sim.model.holding.border]


def test_the_roll_of_a_body_turned_by_hand():
    sim = headed()
    points = sim.cable.points
    points[:, 3] = 0.3
    sim.cable.put(points, np.zeros_like(points))
    assert rows_of(sim, points, points)[2] == pytest.approx(0.0, abs=1e-15)
    for angle in (0.4, -3.0):
        gap = rows_of(sim, points, turned(sim, points, [angle, 0.0, 0.0]))[2]
        assert gap == pytest.approx(-angle, abs=1e-13)
    aside = rows_of(sim, points, turned(sim, points, [0.0, 0.5, 0.7]))[2]
    assert aside == pytest.approx(0.0, abs=1e-13)


def test_its_forces_do_the_work_of_the_moment():
    """Exactly, for large turns and strained bodies, and without a net force."""
    sim = headed()
    random, start = np.random.default_rng(3), turned(sim, sim.cable.points, [0.3, -0.5, 0.8])
    sim.cable.put(start, np.zeros_like(start))
    for size in (1.0, 1e-3, 1e-6):
        end = turned(sim, start, size * np.array([0.9, 0.6, -0.4]))
        end += 1e-4 * size * random.standard_normal(end.shape)
        force, _, gap = rows_of(sim, start, end)
        assert (force * (end - start)).sum() == pytest.approx(gap, abs=1e-13)
        assert np.abs(force[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(force).max()


def test_a_rigid_body_feels_a_couple_about_the_mean_tangent():
    sim = headed()
    points, body = sim.cable.points, sim.model.bodies[0]
    tangent = np.zeros(sim.model.n)
    tangent[body.first : body.first + 4] = body.weights(body.frame.T @ X)
    for vector in ([0.9, 0.6, -0.4], [2.5, 0.0, 0.3]):
        end = turned(sim, points, vector)
        force, _, _ = rows_of(sim, points, end)
        torque = np.cross(0.5 * (points + end)[:, :3], force[:, :3]).sum(axis=0)
        mean = tangent @ (points + end)[:, :3]
        assert np.abs(np.cross(torque, mean)).max() < 1e-12 * np.linalg.norm(mean)
        assert torque @ mean < 0.0


def test_its_condition_is_the_derivative():
    sim = headed()
    points = sim.cable.points
    end = turned(sim, points, [0.5, 0.4, -0.6])
    _, condition, _ = rows_of(sim, points, end)
    for vector in np.eye(3) * 1e-6:
        ahead, behind = (turned(sim, end, sign * vector) for sign in (1.0, -1.0))
        change = rows_of(sim, points, ahead)[2] - rows_of(sim, points, behind)[2]
        assert (condition * (ahead - behind)).sum() == pytest.approx(change, abs=1e-12)


@ways
def test_a_body_on_a_twisted_strand_is_a_torsional_pendulum(joint):
    """phi(t) = sin(omega t), of the strand and the roll in series; a third of the polar inertia of
    the strand, 1 % of that of the body, moves with it."""
    sim = headed(joint, integrator__step=2e-3)
    soft = 1.0 / joint["joint_stiffness"] if joint is ELASTIC else 0.0
    series = 1.0 / (LENGTH / GJ + soft)
    omega = np.sqrt(series / INERTIA)
    points, rates = sim.cable.points, np.zeros_like(sim.cable.points)
    main, across = (part.here for part in sim.model.parts)
    rates[main, 3] = omega * series * sim.greville / GJ
    moving = np.unique([*range(across.start, across.stop), *sim.model.bodies[0].points])
    rates[moving, :3] = np.cross([omega, 0.0, 0.0], points[moving, :3] - [LENGTH, 0.0, 0.0])
    sim.begin(points, rates)
    for _ in range(4):
        assert sim.advance(0.1).status.ok
        assert turn_of(sim) == pytest.approx(np.sin(omega * sim.time), abs=0.02)
    assert sim.energy_error < 1e-6


@pytest.mark.parametrize("method", ["energy_momentum", "implicit_midpoint"])
@ways
def test_the_energy_of_a_strand_with_a_tumbling_body_is_kept(joint, method):
    more = {"integrator__method": method, "integrator__tolerance": 1e-12}
    sim = headed(joint, (0.01, -0.002, 0.0), **more)
    points, rates = sim.cable.points, np.zeros_like(sim.cable.points)
    rates[10:, 1] = 0.3
    rates[10:, :3] += np.cross([10.0, 0.0, 3.0], points[10:, :3] - points[10, :3])
    sim.begin(points, rates)
    assert sim.advance_steps(300).status.ok
    now = sim.cable.points
    assert np.abs(now[10, :3] - points[10, :3]).max() > 0.01 and abs(now[10, 3]) > 0.3
    assert sim.energy_error < (1e-10 if method == "energy_momentum" else 0.02)
    if joint is RIGID:
        assert abs(rows_of(sim, now, now)[2]) < 1e-9


def test_a_search_for_the_shape_alone_turns_a_body_to_its_strand():
    sim = headed(gravity=[0.0, 0.0, -0.1])
    points = sim.cable.points
    points[:, 3] = 0.2
    sim.cable.put(points, np.zeros_like(points))
    sim.cable.x[:] = sim.model.to_lines(turned(sim, points, [0.5, 0.0, 0.0]))
    assert relax(sim.cable)
    found = sim.cable.points
    assert np.abs(found[10, 2]) > 0.01 and np.all(found[:11, 3] == 0.2)
    assert rows_of(sim, found, found)[2] == pytest.approx(0.0, abs=1e-9)
    assert abs(turn_of(sim)) < 1e-3


@pytest.mark.parametrize("bent", [0.0, 0.02], ids=["straight", "bent"])
@ways
def test_strands_on_one_body_share_the_roll_by_their_stiffnesses(joint, bent):
    """M = 1 rad / (L1 / GJ + L2 / GJ + 1 / k), through a body across which both lie in line; also
    from a bent shape, up to the error of the frame that follows it."""
    far = {"from": "b", "at": 0.0, "direction": X, "cable.length": 0.15, "end.clamped": True}
    far |= {"end.fixed": [True] * 3, "end.tangent": X, "end.position": [0.45, 0.0, 0.0]}
    far |= {"discretization.control_points": 11, "cable.linear_density": 0.03}
    sim = net(WEIGHTLESS, CLAMPED, b=SHORT | joint, c=far)
    first, _, last = (part.here for part in sim.model.parts)
    points = sim.cable.points
    points[last.stop - 1, 3] = 1.0
    sim.cable.put(points, np.zeros_like(points))
    points[2:9, 2] += bent * np.sin(np.pi * points[2:9, 0] / LENGTH)
    sim.cable.x[:] = sim.model.to_lines(points)
    sim.cable.open_frame()
    assert relax(sim.cable, twist=True)
    soft = 1.0 / joint["joint_stiffness"] if joint is ELASTIC else 0.0
    moment = 1.0 / (0.45 / GJ + soft)
    found, near = sim.cable.points, 1e-4 if bent else 1e-6
    assert found[first.stop - 1, 3] == pytest.approx(moment * LENGTH / GJ, abs=near)
    assert found[last.start, 3] == pytest.approx(1.0 - moment * 0.15 / GJ, abs=near)
    assert turn_of(sim) == pytest.approx(moment * (LENGTH / GJ + soft), abs=near)
    assert np.abs(found[[*range(11), *range(last.start, last.stop)], 2]).max() < 1e-9
