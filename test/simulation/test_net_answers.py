"""Nets that move or are twisted, against known answers."""

import warnings

import numpy as np
import pytest
import scipy.linalg
from cables import move
from nets import WEIGHTLESS, WIRE, frequencies, momenta, net, second_variation, spinning

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion

FREE = {"start.fixed": [False] * 3}
X, Z = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
EI, GJ = WIRE["cable.bending_stiffness"], WIRE["cable.torsional_stiffness"]


def harness(joint, twist, step):
    """A free cable with two branches across and a connector at its end, spinning and bending."""
    main = {
        "cable.length": 0.6,
        "cable.axial_stiffness": 200.0,
        "end.position": [0.6, 0.0, 0.0],
        "discretization.control_points": 9,
        "integrator.step": step,
        "integrator.tolerance": 1e-13,
        "terms.twist": twist,
        "terms.out_of_plane": "on",
        "connectors.names": ["plug"],
        "connectors.plug.mass": 0.02,
        "connectors.plug.center": [0.01, 0.005, -0.01],
        "connectors.plug.inertia": [2e-5, 3e-5, 4e-5],
        "connectors.plug.joint": joint,
    }
    branch = {"cable.length": 0.2, "joint": joint, "discretization.control_points": 6}
    a, b = {"at": 0.3, "direction": [0.0, 1.0, 0.0]}, {"at": 0.7, "direction": Z}
    sim = net(WEIGHTLESS, FREE, main, a=branch | a, b=branch | b)
    points, rates = spinning(sim, [1.0, 2.0, 3.0], [0.1, -0.2, 0.05])
    for part in sim.model.parts:
        rates[part.here, 2] += 0.3 * np.sin(np.linspace(0.0, 3.0, part.model.n))
    sim.start_from(points, rates)
    return sim


# Steps of 5 ms, 50 control points: energy and angular momentum open by 2e-7 and 2e-5 in 10 s.
@pytest.mark.parametrize(
    "joint, twist, duration, energy, turning",
    [("hinged", "off", 100.0, 1e-9, 1e-9), ("rigid", "bishop", 5.0, 1e-9, 1e-3)],
)
def test_a_free_harness_tumbles(joint, twist, duration, energy, turning):
    """It keeps energy, momentum and angular momentum; with twist the latter to the order of what
    theta, a spline, does not show of the tangent."""
    sim = harness(joint, twist, 5e-3 if joint == "hinged" else 2e-3)
    before = momenta(sim)
    assert sim.advance(duration).status.ok
    for now, then, share in zip(momenta(sim), before, (1e-12, turning), strict=True):
        assert np.abs(now - then).max() < share * np.linalg.norm(then)
    assert sim.energy_error < energy
    assert sum(sim.cable.potentials()[:2]) > 1e-3 * sim.cable.kinetic()


CLAMPED = {
    "start.clamped": True,
    "start.tangent": X,
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.tangent": X,
    "damping.mass": 4.0,
    "damping.stiffness": 0.02,
    "integrator.step": 5e-3,
}


def turn(sim, end, axis, angle=np.pi):
    """Turn an end, and come to rest."""
    move(sim, end, 1.0, angular_velocity=(angle * np.array(axis)).tolist())
    assert sim.advance(4.0).status.ok


def test_half_a_turn_is_shared_by_cables_in_line():
    """By the compliances length / GJ; the joint rolls by the first one's share."""
    main = {"cable.length": 0.3, "end.fixed": [False] * 3, "end.clamped": False}
    other = {"cable.length": 0.2, "cable.torsional_stiffness": 0.003, "at": 1.0}
    branch = other | {"end.fixed": [True] * 3, "end.clamped": True, "end.pose_topic": "/end"}
    branch |= {"end.position": [0.5, 0.0, 0.0], "end.tangent": X}
    sim = net(WEIGHTLESS, CLAMPED, main, b=branch)
    turn(sim, "b.end", X)
    shares = 0.3 / GJ, 0.2 / 0.003
    torque = np.pi / sum(shares)
    assert sim.reaction("b.end")[1][0] == pytest.approx(torque, rel=5e-3)
    assert sim.reaction("start")[1][0] == pytest.approx(-torque, rel=5e-3)
    roll = sim.frames(np.linspace(0.0, 0.3, 9))[-1]
    assert 2.0 * np.arctan2(roll[0], roll[3]) == pytest.approx(torque * shares[0], rel=5e-3)


@pytest.mark.parametrize("joint, angle", [("rigid", np.pi), ("elastic", 0.3)])
def test_a_branch_that_is_turned_bends_its_parent(joint, angle, stiffness=0.1):
    """Across the middle of a clamped cable of length L, which turns by M L / 16 EI. A joint that
    gives turns by M / k, while that is small."""
    length, stiff = 1.0, 0.15
    main = {"cable.length": length, "cable.bending_stiffness": stiff, "end.position": X}
    main |= {"cable.axial_stiffness": 100.0, "cable.torsional_stiffness": 0.1}
    branch = {"at": 0.5, "direction": Z, "cable.length": 0.3, "cable.torsional_stiffness": GJ}
    branch |= {"end.fixed": [True] * 3, "end.clamped": True, "end.pose_topic": "/end"}
    branch |= {"end.position": [0.5, 0.0, 0.3], "end.tangent": Z}
    branch |= {"joint": joint, "joint_stiffness": stiffness * (joint == "elastic")}
    sim = net(WEIGHTLESS, CLAMPED, main, b=branch)
    turn(sim, "b.end", Z, angle)
    shares = 0.3 / GJ, length / (16.0 * stiff), (joint == "elastic") / stiffness
    torque = angle / sum(shares)
    assert sim.reaction("b.end")[1][2] == pytest.approx(torque, rel=5e-3)
    middle = sim.centerline([0.4999, 0.5001], "cable")
    bent = np.arctan2(*(middle[1] - middle[0])[[1, 0]])
    assert bent == pytest.approx(torque * shares[1], rel=5e-3)


def test_a_push_across_the_end_of_a_branch_twists_its_parent():
    """F at the end of a branch of length b in the middle of a clamped cable of length L moves it by
    F (b^3 / 3 EI + b^2 L / 4 GJ + L^3 / 192 EI)."""
    length, reach, push, stiff = 1.0, 0.3, 2e-4, 0.02
    main = {"cable.length": length, "end.position": X, "terms.out_of_plane": "on"}
    main |= {"cable.bending_stiffness": stiff, "initial.shape": "equilibrium"}
    main |= {"loads.names": ["push"], "loads.push.on": "b", "loads.push.signal": "constant"}
    main |= {"loads.push.type": "force", "loads.push.force": [0.0, push, 0.0]}
    sim = net(WEIGHTLESS, CLAMPED, main, b={"at": 0.5, "direction": Z, "cable.length": reach})
    roll = push * reach * length / (4.0 * GJ)
    expected = push * (reach**3 / (3.0 * stiff) + length**3 / (192.0 * stiff)) + roll * reach
    assert sim.centerline([reach], "b")[0, 1] == pytest.approx(expected, rel=5e-3)
    frame = sim.frames(np.linspace(0.0, 0.5, 9))[-1]
    assert 2.0 * np.arctan2(frame[0], frame[3]) == pytest.approx(-roll, rel=5e-3)


def test_a_ring_with_twist_leaves_its_plane():
    """Beyond sqrt(3) EI / GJ turns, by two modes (Michell)."""
    main = {"cable.length": 1.0, "end.joined": "cable", "end.joined_at": 0.0}
    more = {"discretization.control_points": 49, "initial.shape": "equilibrium"}
    sim = net(WEIGHTLESS, FREE, main, more, {"terms.twist": "bishop"})
    for share, unstable in ((0.99, 0), (1.01, 2)):
        turns, points = share * np.sqrt(3.0) * EI / GJ, sim.control_points
        points[:, 3] = 2.0 * np.pi * turns * sim.greville
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            sim.start_from(points)
        assert sim.cable.potentials()[2] == pytest.approx(0.5 * GJ * (2.0 * np.pi * turns) ** 2)
        squares = second_variation(sim)  # of the first mode with twist that moves: 33.5 without
        assert np.sum(squares < -1.0) == unstable


def band(friction, pull=0.115):
    """A rubber band of 0.6 m round two pegs of 6 cm, laid as a circle, then drawn apart; its
    tension without friction."""
    main = {
        "cable.length": 0.6,
        "cable.diameter": 2e-3,
        "cable.linear_density": 5e-3,
        "cable.axial_stiffness": 20.0,
        "cable.bending_stiffness": 1e-7,
        "end.joined": "cable",
        "discretization.control_points": 121,
        "terms.out_of_plane": "on",
        "damping.mass": 8.0,
        "contact.stiffness": 2e6,
        "contact.friction": friction,
        "obstacles.names": ["a", "b"],
        "integrator.step": 2e-3,
    }
    for name, x in (("a", -0.05), ("b", 0.05)):
        peg = {"shape": "cylinder", "size": [0.06, 0.06, 0.1]}
        peg["position"] = [x, 0.6 / (2.0 * np.pi), 0.0]
        main |= {f"obstacles.{name}.{key}": value for key, value in peg.items()}
    sim = net(WEIGHTLESS, FREE, main)
    move(sim, "b", 1.0, velocity=[pull, 0.0, 0.0])
    assert sim.advance(4.0).status.ok
    strained = 2.0 * np.pi * 0.031 + 2.0 * (0.1 + pull)
    return sim, 20.0 * (strained / 0.6 - 1.0)


def test_a_rubber_band_round_two_pegs_is_as_tight_as_it_is_long():
    """EA strain, in both of its sides."""
    sim, tension = band(0.0)
    np.testing.assert_allclose(sim.tension(np.linspace(0.0, 0.6, 25)), tension, rtol=1e-2)
    assert -sim.contacts["a"].force[0] == pytest.approx(2.0 * tension, rel=1e-2)


def test_a_peg_that_turns_draws_one_side_of_a_band_tighter(friction=0.2):
    """By e^(mu pi), where the band slides."""
    sim, _ = band(friction)
    place = EndMotion.resting(sim.pose_of("b", sim.time)[0], start=sim.time)
    sim.set_motion("b", place.then(1.0, angular_velocity=[0.0, 0.0, 1.0]))
    assert sim.advance(1.0).status.ok
    u = np.linspace(0.0, 0.6, 600)
    line, tension = sim.centerline(u), sim.tension(u)
    free = np.abs(line[:, 0] - np.ptp(line[:, 0]) / 2.0 - line[:, 0].min()) < 0.03
    above = line[:, 1] > 0.6 / (2.0 * np.pi)
    ratio = tension[free & ~above].mean() / tension[free & above].mean()
    assert ratio == pytest.approx(np.exp(friction * np.pi), rel=1e-2)


MASS, ARM, LENGTH, GRAVITY, INERTIA = 0.2, 0.1, 0.5, 9.81, (4e-4, 7e-4, 7e-4)


def hanging(joint, **more):
    """A body that hangs on a string, its centre ARM below the end; and the matrices M and K of the
    angles of both, with the stiffness sqrt(EI T) of a string bent sharply at its end if rigid."""
    bending = 2e-5 if joint == "rigid" else 1e-9
    main = {
        "cable.length": LENGTH,
        "cable.diameter": 0.02,
        "cable.linear_density": 5e-5,
        "cable.bending_stiffness": bending,
        "end.position": [0.0, 0.0, -LENGTH],
        "discretization.control_points": 100 if joint == "rigid" else 13,
        "connectors.names": ["bob"],
        "connectors.bob.mass": MASS,
        "connectors.bob.center": [ARM, 0.0, 0.0],
        "connectors.bob.inertia": list(INERTIA),
        "connectors.bob.joint": joint,
        "initial.shape": "equilibrium",
    }
    sim = net({"terms.twist": "bishop" if joint == "rigid" else "off"}, main, more)
    M = np.array([[LENGTH**2, LENGTH * ARM], [LENGTH * ARM, ARM**2]]) * MASS
    M[1, 1] += INERTIA[1]
    K = np.diag([LENGTH, ARM]) * MASS * GRAVITY
    if joint == "rigid":
        K += np.sqrt(bending * MASS * GRAVITY) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return sim, M, K


@pytest.mark.parametrize("joint", ["rigid", "hinged"])
def test_a_payload_on_a_cable_has_two_pendulum_modes(joint):
    """In both planes; it spins about its axis as it likes."""
    sim, M, K = hanging(joint)
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True))
    found = frequencies(sim, 5)
    assert found[0] < 1e-2 * found[1]
    np.testing.assert_allclose(found[1:], np.repeat(expected, 2), rtol=5e-3)
    assert np.linalg.norm(sim.reaction("start")[0]) == pytest.approx(MASS * GRAVITY, rel=1e-3)


@pytest.mark.parametrize("joint", ["rigid", "hinged"])
def test_a_body_spun_on_a_hanging_cable_precesses(joint, spin=40.0, push=0.15):
    """Small angles as complex numbers, by Euler's equations: M q'' + i J spin q' + K q = 0."""
    sim, M, K = hanging(joint, **{"integrator.step": 1e-3})
    points = sim.cable.points
    rates, body = np.zeros_like(points), sim.model.bodies[0].points
    rates[:, :3] = np.cross([0.0, push, 0.0], points[:, :3])
    rates[body, :3] += np.cross([0.0, 0.0, -spin], points[body, :3] - points[body[0], :3])
    rates[sim.model.parts[0].here, 3] = spin * sim.model.twist
    sim.begin(points, rates)
    inverse, times, found = np.linalg.inv(M), np.linspace(0.0, 1.5, 31)[1:], []
    for _ in times:
        assert sim.advance(0.05).status.ok
        place, turn = sim.connector_pose("bob")
        axis = rotations.rotate(turn, [1.0, 0.0, 0.0])
        found.append([complex(*place[:2]) / LENGTH, complex(*axis[:2])])
    gyro = np.diag([0.0, 1j * INERTIA[0] * spin])
    whole = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ gyro]])
    begun = np.array([0.0, 0.0, -push, -push], dtype=complex)
    expected = np.array([(scipy.linalg.expm(t * whole) @ begun)[:2] for t in times])
    assert np.abs(np.angle(expected[:, 1])).max() > 2.0
    for k in range(2):
        assert np.abs(np.array(found) - expected)[:, k].max() < 5e-3 * np.abs(expected[:, k]).max()


@pytest.mark.parametrize("way", ["correct", "take", "reconfigured"])
@pytest.mark.parametrize("along", [X, Z], ids=["in line", "across"])
def test_a_joint_that_gives_stays_strained(along, way):
    """Where a measurement corrects the shape, a gripper takes the cable, or the scene changes."""
    main = {"cable.length": 0.3, "end.fixed": [False] * 3, "end.clamped": False}
    main |= {"grasps.names": ["g"], "grasps.g.taken": False, "grasps.g.at": 0.2}
    place = (0.1 * np.array(along) + [0.3, 0.0, 0.0]).tolist()
    branch = {"at": 1.0, "direction": along, "cable.length": 0.1, "end.fixed": [True] * 3}
    branch |= {"joint": "elastic", "joint_stiffness": 0.05, "end.clamped": True}
    branch |= {"end.position": place, "end.tangent": along}
    sim = net(WEIGHTLESS, CLAMPED, main, b=branch)
    turn(sim, "b.end", X, 0.5)
    before = sim.cable.potentials()
    if way == "correct":
        sim.correct(np.zeros((sim.model.n, 3)), np.zeros((sim.model.n, 3)))
    elif way == "take":
        sim.set_end("g", sim.centerline([0.06])[0])
        sim.take("g")
    else:
        sim = sim.reconfigured(sim.scene.with_values({"damping.mass": 3.0}))
    assert before[6] > 0.1 * before.sum()
    np.testing.assert_allclose(sim.cable.potentials()[:7], before[:7], rtol=1e-6, atol=1e-9)
