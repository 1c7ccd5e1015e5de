"""Twist in the Bishop frame: driven by grippers, felt by the centerline (`terms.twist: bishop`)."""

import numpy as np
import pytest
from cables import move, simulator

from dlo_sim.core import bspline, rotations

LENGTH = 1.0
SHAFT = {
    "cable.length": LENGTH,
    "cable.diameter": 0.01,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 1e7,
    "gravity": [0.0, 0.0, 1e-5],
    "start.fixed": [True] * 3,
    "start.clamped": True,
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.position": [1.0, 0.0, 0.0],
    "terms.twist": "bishop",
    "damping.stiffness": 0.02,
    "damping.mass": 1.0,
    "discretization.control_points": 17,
}
SLACK = {
    "gravity": [0.0, 0.0, -9.81],
    "end.position": [0.7, 0.1, 0.2],
    "end.tangent": [1.0, 0.3, 0.0],
}


def held(method="energy_momentum", step=0.01, **values):
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return simulator(SHAFT, changed, method=method, step=step)


def turn(sim, end, rotation, duration):
    """Turn an end effector about its place by a rotation vector [rad], at a constant rate."""
    move(sim, end, duration, angular_velocity=np.asarray(rotation) / duration)


def roll(sim, angle, duration=4.0):
    """Turn the end about its own tangent."""
    turn(sim, "end", angle * sim.ends.tangent("end", sim.time), duration)


def slip(sim):
    """Rotation of the cable's material frame against the gripper at the end, as a vector [rad]."""
    frame = sim.frames(np.linspace(0.0, LENGTH, 801))[-1]
    own = rotations.multiply(rotations.conjugate(sim.end_pose("end")[1]), frame)
    return rotations.to_rotation_vector(own * np.sign(own[3]))


def largest(sim, axes, duration):
    """Largest way across some axes [m] while the simulation goes on."""
    ways = []
    for _ in range(10):
        sim.advance(0.1 * duration)
        ways.append(np.ptp(sim.control_points[:, axes], axis=0).max())
    return max(ways)


def test_a_straight_shaft_turns_end_to_end():
    sim = held(gravity=[0.0, 0.0, 0.0])
    roll(sim, 3.0)
    sim.advance(8.0)
    np.testing.assert_allclose(sim.control_points[:, 3], 3.0 * sim.greville / LENGTH, atol=1e-6)
    moment = sim.scene.cable.GJ * 3.0 / LENGTH
    for end, sign in (("start", -1.0), ("end", 1.0)):
        np.testing.assert_allclose(sim.reaction(end)[1], [sign * moment, 0.0, 0.0], atol=1e-6)


def moment_at_buckling(tension):
    """m = M L / EI of a shaft clamped at both ends under a tension of t EI / L^2.

    EI y'' - i M y' - T y = a + b s of y = y_1 + i y_2 (Greenhill 1883, Proc. Inst. Mech. Eng. 34)
    has the solutions 1, s and e^(i k s), k L = m/2 +- d, d^2 = (m/2)^2 - t. With y = y' = 0 at both
    ends their determinant vanishes where 2 d (cos d - cos m/2) = t sin d; for hinges it is d = pi.
    """
    half = np.linspace(np.sqrt(tension) * (1.0 + 1e-6), 20.0, 400001)
    d = np.sqrt(half**2 - tension)
    values = 2.0 * d * (np.cos(d) - np.cos(half)) - tension * np.sin(d)
    return 2.0 * half[np.flatnonzero(values[1:] * values[:-1] < 0.0)[0]]


@pytest.mark.parametrize("twist", ["bishop", "quasistatic"])
@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False)])
def test_tension_puts_off_buckling(share, stable, twist):
    """Under T = 20 EI / L^2 the moment is 11.8 EI / L, 31 % more."""
    assert moment_at_buckling(1e-3) == pytest.approx(8.9868, abs=1e-3)
    assert moment_at_buckling(20.0) == pytest.approx(11.800, abs=1e-3)
    cable = held().scene.cable
    strain = 20.0 * cable.EI / cable.EA / LENGTH**2
    sim = held(end__position=[LENGTH * (1.0 + strain), 0.0, 0.0], terms__twist=twist)
    sim.advance(1.0)
    assert sim.reaction("end")[0][0] == pytest.approx(20.0 * cable.EI, rel=1e-3)
    roll(sim, share * moment_at_buckling(20.0) * cable.EI / cable.GJ)
    assert (largest(sim, [1, 2], 16.0) < 3e-5) == stable


@pytest.mark.parametrize(("share", "stable"), [(0.9, True), (1.2, False)])
def test_a_straight_shaft_on_which_nothing_else_acts_coils(share, stable):
    """Greenhill's moment of a clamped shaft is 8.987 EI / L; without weight nothing disturbs it."""
    sim = held(gravity=[0.0, 0.0, 0.0])
    roll(sim, share * moment_at_buckling(1e-3) * sim.scene.cable.EI / sim.scene.cable.GJ)
    sim.advance(16.0)
    assert (np.abs(sim.control_points[:, 1:3]).max() == 0.0) == stable


def test_quasistatic_twist_is_at_rest_in_every_step():
    """A roll within the time in which a wave of twist passes three times."""
    sim = held(terms__twist="quasistatic", gravity=[0.0, 0.0, 0.0], damping__mass=0.0)
    roll(sim, 3.0, duration=0.05)
    for k in range(1, 9):
        sim.advance(0.01)
        angle = 3.0 * min(k / 5.0, 1.0)
        np.testing.assert_allclose(sim.control_points[:, 3], angle * sim.greville, atol=1e-9)
    moment = sim.scene.cable.GJ * 3.0 / LENGTH
    np.testing.assert_allclose(sim.reaction("end")[1], [moment, 0.0, 0.0], atol=1e-9)
    assert sim.energy().twist == pytest.approx(1.5 * moment, rel=1e-6)
    assert sim.energy_error < 1e-9


def test_a_moment_twists_at_once_and_does_not_ring():
    """theta = M u / GJ at the end of the first step, and of every other."""
    free = {"end__fixed": [False] * 3, "end__clamped": False, "loads__names": ["tip"]}
    free |= {"damping__mass": 0.0, "damping__stiffness": 0.0, "gravity": [0.0, 0.0, 0.0]}
    sim = held(**free, terms__twist="quasistatic")
    sim.set_load("tip", torque=[1e-3, 0.0, 0.0])
    for _ in range(4):
        assert sim.advance_steps(1).status.ok
        angles = 1e-3 * sim.greville / sim.scene.cable.GJ
        np.testing.assert_allclose(sim.control_points[:, 3], angles, atol=1e-7)


def test_a_shape_that_twists_slowly_hardly_knows_inertia():
    """The hanging cable, its end swung and rolled: quasistatic and dynamic twist agree."""
    slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
    shapes = []
    for twist in ("bishop", "quasistatic"):
        sim = held(**slack, terms__twist=twist, damping__mass=3.0, integrator__tolerance=1e-7)
        turn(sim, "end", [2.0, 0.5, 0.3], 2.0)
        assert sim.advance(3.0).status.ok
        assert sim.energy_error < 1e-6
        shapes.append(sim.control_points)
    np.testing.assert_allclose(shapes[0][:, :3], shapes[1][:, :3], atol=1e-3)
    np.testing.assert_allclose(shapes[0][:, 3], shapes[1][:, 3], atol=1e-2)


def ring(n=33):
    """A ring, with weight enough to leave its plane."""
    sim = held(
        end__position=[-1e-4, 0.0, 0.0],
        start__tangent=[1.0, 0.0, 0.0],
        end__tangent=[1.0, 0.0, 0.0],
        initial__shape="straight",
        discretization__control_points=n,
        damping__mass=3.0,
        gravity=[0.0, 1e-6, 1e-6],
    )
    u = np.linspace(0.0, LENGTH, 400)
    angle, radius = 2.0 * np.pi * u / LENGTH, 0.5 * LENGTH / np.pi
    circle = np.stack([np.sin(angle), 0.0 * angle, 1.0 - np.cos(angle)], axis=1)
    points = np.zeros((n, 4))
    first, values = bspline.active_basis(sim.model.knots, u)
    basis = np.zeros((len(u), n))
    np.put_along_axis(basis, first[:, None] + np.arange(4), values, axis=1)
    points[:, :3] = np.linalg.lstsq(basis, radius * circle, rcond=None)[0]
    with pytest.warns(UserWarning, match="moved back"):
        sim.start_from(points)
    sim.advance(2.0)
    return sim


@pytest.mark.parametrize(("share", "stable"), [(0.95, True), (1.04, False)])
def test_a_ring_buckles_at_michells_twist(share, stable):
    """2 pi sqrt(3) EI / GJ (Michell 1889, Zajac 1962)."""
    sim = ring()
    cable = sim.scene.cable
    roll(sim, share * 2.0 * np.pi * np.sqrt(3.0) * cable.EI / cable.GJ)
    assert (largest(sim, [1], 10.0) < 2e-3) == stable


def test_a_gripper_that_turns_keeps_the_material_frame():
    """Rolled, and swung about an axis across which it points: on the way and after a full turn."""
    sim = held(**{key.replace(".", "__"): value for key, value in SLACK.items()}, step=0.005)
    sim.advance(0.5)
    begin, angle = slip(sim), sim.control_points[-1, 3]
    turn(sim, "end", [2.0 * np.pi, 0.0, 0.0], 2.0)
    for _ in range(4):
        sim.advance(0.5)
        np.testing.assert_allclose(slip(sim), begin, atol=1e-3)
    sim.advance(0.5)
    np.testing.assert_allclose(slip(sim), begin, atol=1e-3)
    # The link is conserved: what is no twist is writhe, and it does not come back by itself.
    assert 4.0 < sim.control_points[-1, 3] - angle < 5.5
    roll(sim, -4.0 * np.pi, 2.0)
    sim.advance(3.0)
    np.testing.assert_allclose(slip(sim), begin, atol=1e-3)


def test_a_clamp_that_swings_on_a_cone_carries_the_roll_within_the_step():
    """While it swings, the frame of theta turns by the solid angle of the cone."""

    def slipped(step):
        slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
        sim = held(**slack, step=step, damping__mass=3.0, discretization__control_points=13)
        sim.advance(1.0)
        begin, angle = slip(sim), sim.control_points[-1, 3]
        turn(sim, "end", [1.6 * np.pi, 0.0, 0.0], 0.8)
        sim.advance(0.4)
        assert abs(sim.control_points[-1, 3] - angle - 0.8 * np.pi) > 0.1
        return slip(sim) - begin

    # 8.1e-3 of 9.0e-3 where the solid angle of a step counted in the next one
    np.testing.assert_allclose(slipped(0.02), slipped(0.0025), atol=1e-5)


def test_shapes_without_curvature_give_no_jump():
    """From a sagging cable through a straight one to an arch: the frame has no 0/0 anywhere."""
    sim = held(gravity=[0.0, 0.0, 0.0], end__position=[0.9, 0.0, 0.0], damping__mass=5.0)
    roll(sim, 2.0, 0.5)
    sim.advance(1.0)
    angles = []
    for force in np.linspace(-0.02, 0.02, 41):
        sim.set_end("end", position=[0.9 + 0.0999 * (1.0 - abs(force) / 0.02), 0.0, 0.0])
        sim.advance(0.1)
        angles.append(sim.control_points[:, 3].copy())
        assert np.isfinite(sim.control_points).all()
    assert np.abs(np.diff(angles, axis=0)).max() < 0.3


@pytest.mark.parametrize("method", ["implicit_midpoint", "energy_momentum"])
def test_methods_agree(method):
    def moved(method, step):
        slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
        sim = held(method, step, **slack, damping__stiffness=0.0)
        turn(sim, "end", [1.5, 0.4, -0.5], 0.3)
        sim.advance(0.4)
        return sim

    sim, reference = moved(method, 2e-3), moved("energy_momentum", 5e-4)
    np.testing.assert_allclose(
        sim.control_points[:, :3], reference.control_points[:, :3], atol=3e-4
    )
    assert sim.energy_error < 1e-2
    assert np.abs(reference.control_points[-1, 3]) > 0.5


def test_its_energy_account_closes():
    """What of the frame's twist no spline is counts as lost: much of it in few long steps."""
    slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
    coarse = {"discretization__control_points": 8, "integrator__tolerance": 1e-11}
    sim = held(**slack, **coarse, damping__stiffness=0.0, step=0.01)
    turn(sim, "end", [3.0, 1.0, -0.5], 0.3)
    sim.advance(3.0)
    assert sim.energy().twist > 1e-3
    assert sim.energy_error < 1e-9


def test_cones_of_a_gripper_leave_nothing_behind():
    """Thirty times around a cone and back: the angle between cable and gripper does not drift."""
    slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
    sim = held(**slack, step=0.005, damping__mass=3.0, discretization__control_points=13)
    sim.advance(2.0)
    begin, (place, orientation) = slip(sim), sim.end_pose("end")
    times = np.arange(0.0, 30.01, 1.0 / 30.0)
    ramp = 0.8 * np.minimum(1.0, np.minimum(times, times[-1] - times))
    phase = 2.0 * np.pi * times
    swing = ramp[:, None] * np.stack([0.0 * phase, np.cos(phase), np.sin(phase)], axis=1)
    turned = rotations.multiply(rotations.from_rotation_vector(swing), orientation)
    poses = {"end": np.hstack([np.tile(place, (len(times), 1)), turned])}
    sim.follow(sim.time + times, poses, sim.time + times[-1:])
    sim.advance(2.0)
    np.testing.assert_allclose(slip(sim), begin, atol=1e-5)
    assert sim.energy_error < 1e-5


def twisted():
    slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
    sim = held(**slack, step=0.005)
    turn(sim, "end", [3.0, 1.0, -0.5], 1.0)
    sim.advance(1.5)
    return sim


def test_a_reconfigured_cable_keeps_its_twist_and_leaves_the_other_alone():
    sim = twisted()
    before, begin = sim.snapshot(), slip(sim)
    other = sim.reconfigured(sim.scene.with_values({"cable.diameter": 0.0101}))
    after = sim.snapshot()
    assert np.array_equal(before.state, after.state)
    assert np.array_equal(before.inputs, after.inputs)
    for one in (sim, other):
        one.advance(0.5)
        np.testing.assert_allclose(slip(one), begin, atol=1e-3)
    assert other.energy().twist == pytest.approx(sim.energy().twist, rel=0.1)


def test_the_first_shape_has_no_twist():
    """An equilibrium out of a plane is found as without the coupling."""
    slack = {key.replace(".", "__"): value for key, value in SLACK.items()}
    sim, plain = (held(**slack, terms__twist=value) for value in ("bishop", "off"))
    np.testing.assert_allclose(sim.control_points, plain.control_points, atol=1e-9)
    assert sim.energy().twist < 1e-12
