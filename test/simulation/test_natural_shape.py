"""Natural shape in two planes and twisted: in the material frame (`terms.twist: bishop`), and fixed
to the gripper without it."""

import numpy as np
import pytest
from cables import move, simulator

from dlo_sim.core import rotations

LENGTH = 1.0
HELD = {
    "cable.length": LENGTH,
    "cable.diameter": 0.01,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 1e7,
    "cable.rest_curvature_axis": [0.0, 1.0, 0.0],
    "gravity": [0.0, 0.0, 0.0],
    "start.fixed": [True] * 3,
    "start.clamped": True,
    "end.fixed": [False] * 3,
    "end.clamped": False,
    "initial.shape": "straight",
    "terms.twist": "bishop",
    "terms.out_of_plane": "on",
    "discretization.control_points": 25,
}
BENT = {"cable__rest_curvature": [4.0], "cable__rest_curvature_2": [-1.0, 2.0]}


def bent(method="energy_momentum", step=0.004, **values):
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return simulator(HELD, changed, method=method, step=step)


def slack(method, step):
    """The same between two grippers, at rest under its weight."""
    return bent(
        method, step, end__fixed=[True] * 3, end__clamped=True, end__position=[0.8, 0.0, 0.0],
        gravity=[0.0, 0.0, -9.81], initial__shape="auto", damping__mass=1.0,
        cable__rest_twist=[0.5], cable__rest_curvature=[1.0, 2.0],
        cable__rest_curvature_2=[0.5, -1.0], discretization__control_points=17,
    )  # fmt: skip


def helix(curvature, torsion, count=201, parts=100):
    """Centerline of a helix that leaves the origin along x, bent about y: its frame turns about
    (torsion, curvature, 0) at a constant rate."""
    short = LENGTH / ((count - 1) * parts)
    turn = rotations.to_matrix(
        rotations.from_rotation_vector(np.array([torsion, curvature, 0.0]) * short)
    )
    half = rotations.to_matrix(
        rotations.from_rotation_vector(np.array([torsion, curvature, 0.0]) * 0.5 * short)
    )
    frame, point, points = np.eye(3), np.zeros(3), [np.zeros(3)]
    for _ in range(count - 1):
        for _ in range(parts):
            point = point + short * (frame @ half)[:, 0]
            frame = frame @ turn
        points.append(point)
    return np.array(points)


def test_a_rod_of_constant_curvature_and_twist_relaxes_to_its_helix():
    """Curvature kappa and rest twist tau in the material frame: radius kappa / (kappa^2 + tau^2),
    pitch 2 pi tau / (kappa^2 + tau^2)."""
    values = {"cable__rest_curvature": [4.0], "cable__rest_twist": [3.0], "damping__mass": 2.5}
    sim = bent(**values, damping__stiffness=2e-3)
    assert sim.advance(20.0).status.ok
    u = np.linspace(0.0, LENGTH, 201)
    assert np.abs(sim.centerline(u) - helix(4.0, 3.0)).max() < 2e-4
    assert sim.curvature(u[20:-20]) == pytest.approx(4.0, rel=0.01)
    lowest = -0.5 * sim.scene.cable.EI * 4.0**2 * LENGTH
    assert sim.energy().bend == pytest.approx(lowest, rel=1e-3)
    assert sim.energy().twist < 1e-3 * abs(lowest)


@pytest.mark.parametrize("method", ["energy_momentum", "energy_momentum_4"])
def test_the_energy_account_closes_while_it_coils(method):
    sim = bent(method, 0.004, **BENT,
               cable__rest_twist=[3.0, -2.0], integrator__tolerance=1e-12)  # fmt: skip
    assert sim.advance(1.0).status.ok
    assert sim.energy().kinetic > 1e-3
    assert sim.energy_error < 1e-11


@pytest.mark.parametrize("damping", [1.0, 100.0])
def test_the_account_closes_with_damping_and_rest_twist_alone(damping):
    """Rest twist without curvature: one iteration of the shape, several corrections of theta."""
    sim = bent(cable__rest_twist=[3.0, -2.0], damping__mass=damping, integrator__tolerance=1e-12)
    assert sim.advance(0.5).status.ok
    assert sim.energy_error < 1e-9


def test_a_shape_given_from_outside_has_the_natural_shape_along_it():
    """Half of the way to the helix, as one that has come there by itself."""
    sim = bent(**BENT, damping__mass=2.5, damping__stiffness=2e-3)
    sim.advance(1.0)
    other = bent(**BENT)
    other.start_from(sim.control_points)
    assert other.energy().bend == pytest.approx(sim.energy().bend, rel=0.02)


def test_forces_are_the_gradient_of_the_energy():
    """With a shape and twist apart from those of the last step, against central differences; what
    natural curvature adds, since twist alone has no potential in this frame."""
    rng = np.random.default_rng(3)
    both = bent(cable__rest_curvature=[4.0, -2.0], cable__rest_curvature_2=[1.0, 3.0])
    plain = bent()
    noise = rng.normal(0.0, 0.002, both.cable.x.shape)  # short of the span guard
    noise[3] *= 100.0
    for sim in (both, plain):
        sim.cable.x[:] += noise

    def difference(what):
        return what(both) - what(plain)

    force = difference(lambda sim: sim.cable.forces())
    for line, point in [(0, 5), (1, 11), (2, 20), (3, 4), (3, 17)]:
        energy = []
        for push in (1e-5, -1e-5):
            for sim in (both, plain):
                sim.cable.x[line, point] += push
            energy.append(difference(lambda sim: sim.cable.potentials().sum()))
            for sim in (both, plain):
                sim.cable.x[line, point] -= push
        slope = (energy[0] - energy[1]) / 2e-5
        assert force[line, point] == pytest.approx(-slope, rel=1e-5, abs=1e-7)


def rolled(method, step):
    """The slack cable after its start has rolled by 3 rad."""
    sim = slack(method, step)
    move(sim, "start", 1.0, angular_acceleration=[6.0, 0.0, 0.0])
    assert sim.advance(1.0).status.ok
    return sim


def test_methods_agree_on_a_cable_whose_gripper_rolls():
    one, other = rolled("energy_momentum", 0.004), rolled("implicit_midpoint", 0.002)
    ways = one.control_points - other.control_points
    assert np.abs(ways[:, :3]).max() < 3e-5
    assert np.abs(ways[:, 3]).max() < 1e-2


def test_the_material_frame_follows_a_gripper_that_rolls():
    """Rolled by a quarter turn at rest, the bent cable turns with its gripper as a whole."""
    sim = bent(step=0.01, **BENT, damping__mass=1.5, damping__stiffness=2e-3)
    sim.advance(40.0)
    before = sim.control_points[:, :3]
    spin = np.array([0.5 * np.pi / 2.0, 0.0, 0.0])
    move(sim, "start", 2.0, angular_velocity=spin)
    sim.advance(40.0)
    turned = before @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]).T
    assert np.abs(sim.control_points[:, :3] - turned).max() < 2e-3
    assert sim.energy_error < 1e-5


@pytest.mark.parametrize("twist", ["off", "bishop"])
def test_the_second_plane_is_the_first_with_another_axis(twist):
    """About x cross y = z, both with and without the material frame."""
    one = bent(terms__twist=twist, cable__rest_curvature_2=[2.0, 1.0])
    axis = {"cable__rest_curvature_axis": [0.0, 0.0, 1.0]}
    other = bent(terms__twist=twist, cable__rest_curvature=[2.0, 1.0], **axis)
    for sim in (one, other):
        sim.advance(0.2)
    assert np.abs(one.control_points - other.control_points).max() < 1e-9
    assert np.abs(one.control_points[-1, 1]) > 0.01


def test_a_term_that_comes_in_leaves_the_natural_shape_along_the_cable():
    sim = bent(**BENT, damping__mass=4.0)
    sim.advance(3.0)
    before = sim.energy().bend
    twin = sim.reconfigured(sim.scene.with_values({"gravity": [0.0, 0.0, -1e-6]}))
    assert twin.energy().bend == pytest.approx(before, rel=1e-9)


def test_a_natural_shape_that_is_changed_takes_effect():
    """As a cable that has it from the start; the same if the cable was straight before."""
    for before in ({"cable__rest_curvature": [-1.0]}, {}):
        sim = bent(**before, damping__mass=1.5, damping__stiffness=2e-3)
        sim.advance(0.5)
        other = sim.reconfigured(sim.scene.with_values({"cable.rest_curvature": [2.0]}))
        other.advance(20.0)
        assert other.curvature([0.3, 0.6]) == pytest.approx(2.0, rel=1e-3)
