"""Known answers of friction and of contact with bodies."""

import numpy as np
import pytest
from cables import simulator

from dlo_sim.core import bspline, rotations
from dlo_sim.core.end_motion import EndMotion

MU = 0.4
ROD = {
    "cable.length": 1.0,
    "cable.diameter": 0.05,
    "cable.linear_density": 1.0,
    "cable.axial_stiffness": 1e7,
    "gravity": [0.0, 0.0, -9.8],
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.02495],
    "end.position": [1.0, 0.0, 0.02495],
    "obstacles.names": ["table"],
    "obstacles.table.friction": MU,
    "terms.out_of_plane": "off",
}


def pulled(force, step=1e-3, method="energy_momentum"):
    load = {"loads.names": ["pull"], "loads.pull.signal": "constant"}
    return simulator(ROD, load, {"loads.pull.force": [force, 0.0, 0.0]}, method=method, step=step)


def middle(sim):
    return sim.centerline([0.5 * sim.scene.cable.length])[0]


def test_a_pulled_rod_sticks_below_the_friction():
    sim = pulled(3.8, 5e-4)
    before = middle(sim)
    elastic = 3.8 / sim.scene.contact_stiffness
    sim.advance(30.0)
    first = middle(sim) - before
    sim.advance(30.0)
    last = middle(sim) - before
    assert last[0] == pytest.approx(elastic, abs=1e-6)
    assert abs(last[0] - first[0]) < 1e-13
    assert sim.energy().kinetic < 1e-20
    np.testing.assert_allclose(sim.contact("table").force, [-3.8, 0.0, 9.8], atol=1e-9)


@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize(("force", "kinetic"), [(5.0, 0.5832), (8.0, 8.3232), (10.0, 18.4832)])
def test_a_rod_pulled_harder_slides(force, kinetic, step):
    sim = pulled(force, step)
    sim.advance(1.0)
    assert sim.energy().kinetic == pytest.approx(kinetic, rel=0.01)
    assert sim.energy_error < 1e-8


def test_an_explicit_method_slides_and_sticks_alike():
    sim = pulled(8.0, 0.0, "velocity_verlet")
    sim.advance(1.0)
    assert sim.energy().kinetic == pytest.approx(8.3232, rel=0.01)
    sim = pulled(3.8, 0.0, "velocity_verlet")
    before = middle(sim)
    sim.advance(1.0)
    assert abs(middle(sim) - before)[0] < 3.8 / sim.scene.contact_stiffness + 1e-6


@pytest.mark.parametrize("share", [0.995, 1.005])
def test_it_slides_down_a_slope_beyond_the_friction_angle_only(share):
    angle = np.arctan(MU * share)
    up = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    along = np.array([np.cos(angle), 0.0, np.sin(angle)])
    start = (0.025 - 0.05e-3 * np.cos(angle)) * up
    turned = rotations.from_rotation_vector(np.array([0.0, -angle, 0.0]))
    sim = simulator(
        ROD,
        {
            "obstacles.table.orientation": turned.tolist(),
            "start.position": start.tolist(),
            "end.position": (start + along).tolist(),
        },
        method="energy_momentum",
        step=2e-3,
    )
    sim.advance(5.0)
    before = middle(sim) @ along
    sim.advance(5.0)
    slid = before - middle(sim) @ along
    pull = 9.8 * (np.sin(angle) - MU * np.cos(angle))
    if share < 1.0:
        assert abs(slid) < 1e-9
    else:
        assert slid == pytest.approx(0.5 * pull * (10.0**2 - 5.0**2), rel=0.02)


EI, WEIGHT, LIFT = 0.01, 0.5, 5e-3
LYING = {
    "cable.length": 0.6,
    "cable.diameter": 0.005,
    "cable.linear_density": WEIGHT / 9.81,
    "cable.axial_stiffness": 5e3,
    "cable.bending_stiffness": EI,
    "end.position": [0.6, 0.0, 0.0025],
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.0025],
    "end.fixed": [False, False, True],
    "end.tangent": [1.0, 0.0, 0.0],
    "discretization.control_points": 40,
    "discretization.knots": "uniform",
    "obstacles.names": ["table"],
    "contact.stiffness": 1e6,
    "damping.mass": 3.0,
    "damping.bend": 1e-3,
    "terms.out_of_plane": "off",
}


def lifted(*values):
    sim = simulator(LYING, *values, method="energy_momentum", step=1e-3)
    there = [0.6, 0.0, 0.0025 + LIFT]
    lift = EndMotion(
        start=0.0,
        duration=0.5,
        position=[0.6, 0.0, 0.0025],
        orientation=rotations.IDENTITY,
        velocity=[0.0, 0.0, LIFT / 0.5],
    )
    sim.set_motion("end", lift)
    assert sim.advance(6.0).status.ok
    np.testing.assert_allclose(sim.end_pose("end")[0], there, atol=1e-12)
    return sim


def lift_off(sim):
    """Length off the table; a stiffness k lets the cable lift off by (4 EI / k)^(1/4) earlier."""
    touching = sim.contact("table").u
    u = np.linspace(touching.max(), 0.6, 20001)
    height = sim.centerline(u)[:, 2] - 0.0025
    off = u[np.nonzero(height > 0.0)[0][0]]
    return 0.6 - off + (4.0 * EI / 1e6) ** 0.25


def test_the_lifted_end_held_horizontal():
    sim = lifted({"end.clamped": True, "end.fixed": [True] * 3})
    length = (72.0 * EI * LIFT / WEIGHT) ** 0.25
    force, moment = sim.reaction("end")
    assert force[2] == pytest.approx(2.0 * WEIGHT * length / 3.0, rel=5e-3)
    assert abs(moment[1]) == pytest.approx(WEIGHT * length**2 / 6.0, rel=5e-3)
    assert lift_off(sim) == pytest.approx(length, rel=5e-3)
    # total weight: what the end does not carry lies on the table
    assert sim.contact("table").force[2] == pytest.approx(0.6 * WEIGHT - force[2], rel=1e-6)


def test_the_lifted_end_pinned():
    sim = lifted()
    length = (24.0 * EI * LIFT / WEIGHT) ** 0.25
    force, _ = sim.reaction("end")
    assert force[2] == pytest.approx(0.5 * WEIGHT * length, rel=5e-3)
    assert lift_off(sim) == pytest.approx(length, rel=5e-3)


@pytest.mark.parametrize(
    ("wrap", "ratio"), [(0.5 * np.pi, 1.602), (np.pi, 2.566), (2.0 * np.pi, 6.586)]
)
def test_a_capstan_holds_by_its_friction(wrap, ratio):
    """A flexible cable drawn slowly over a cylinder; the load is 1 N."""
    radius, tail, thick = 0.05, 0.15, 0.0025
    bend = radius + thick  # of the axis of the cable
    length = wrap * bend + 2.0 * tail
    # Wound about the origin from angle a to -a about the top, tails along the tangents.
    half = 0.5 * wrap
    t0, t1 = np.array([np.cos(half), np.sin(half)]), np.array([np.cos(half), -np.sin(half)])
    p0, p1 = (
        bend * np.array([-np.sin(half), np.cos(half)]),
        bend * np.array([np.sin(half), np.cos(half)]),
    )

    def place(u):
        if u < tail:
            return p0 - (tail - u) * t0
        if u > length - tail:
            return p1 + (u - length + tail) * t1
        angle = -half + (u - tail) / bend
        return bend * np.array([np.sin(angle), np.cos(angle)])

    first, last = place(0.0), place(length)
    sim = simulator(
        {
            "cable.length": length,
            "cable.diameter": 2.0 * thick,
            "cable.linear_density": 0.05,
            "cable.axial_stiffness": 500.0,
            "cable.bending_stiffness": 1e-6,
            "gravity": [0.0, 0.0, 0.0],
            "start.position": [first[0], 0.0, first[1]],
            "end.position": [last[0], 0.0, last[1]],
            "end.fixed": [False] * 3,
            "initial.shape": "straight",
            "loads.names": ["weight"],
            "loads.weight.signal": "constant",
            "loads.weight.force": [t1[0], 0.0, t1[1]],
            "obstacles.names": ["drum"],
            "obstacles.drum.shape": "cylinder",
            "obstacles.drum.size": [2.0 * radius, 2.0 * radius, 0.2],
            "obstacles.drum.orientation": [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)],
            "obstacles.drum.friction": 0.3,
            "contact.stiffness": 1e6,
            "discretization.control_points": 43 if wrap < 2.0 else round(26.5 * wrap),
            "terms.out_of_plane": "off",
        },
        method="energy_momentum",
        step=1e-3,
    )
    greville = sim.greville
    points = np.array([place(u) for u in greville])
    points = np.linalg.solve(
        bspline.evaluate(np.eye(len(greville)), sim.model.knots, greville), points
    )
    full = np.zeros((len(greville), 4))
    full[:, 0], full[:, 2] = points.T
    sim.start_from(full)
    speed = -0.02 * np.array([t0[0], 0.0, t0[1]])
    sim.set_motion(
        "start",
        EndMotion(
            start=0.0,
            duration=4.0,
            position=full[0, :3],
            orientation=rotations.IDENTITY,
            velocity=speed,
        ),
    )
    pulls = []
    for _ in range(100):
        assert sim.advance(0.03).status.ok
        pulls.append(np.linalg.norm(sim.reaction("start")[0]))
    assert np.mean(pulls[60:]) == pytest.approx(ratio, rel=0.01)


def test_a_conveyor_drags_what_one_end_holds():
    """mu w L on the held end of a rope on a belt, here a plane, that moves at 0.2 m/s."""
    sim = simulator(
        LYING,
        {
            "start.fixed": [True] * 3,
            "end.fixed": [False] * 3,
            "obstacles.table.friction": 0.5,
            "cable.bending_stiffness": 1e-4,
            "damping.bend": 0.0,
            "damping.mass": 0.0,
        },
        method="energy_momentum",
        step=1e-3,
    )
    belt = EndMotion(
        start=0.0,
        duration=10.0,
        position=[0.0, 0.0, 0.0],
        orientation=rotations.IDENTITY,
        velocity=[0.2, 0.0, 0.0],
    )
    sim.move_obstacle("table", belt)
    sim.advance(1.0)
    forces = []
    for _ in range(100):
        sim.advance(0.01)
        forces.append(sim.reaction("start")[0])
    on_belt = -np.mean(forces, axis=0)[2] + 0.6 * WEIGHT
    assert on_belt == pytest.approx(0.6 * WEIGHT, rel=0.02)
    assert -np.mean(forces, axis=0)[0] == pytest.approx(0.5 * 0.6 * WEIGHT, rel=0.01)
    assert sim.energy_error < 1e-4


def thrown(shape, turn, place, sideways, step):
    """Mean velocity that a thin cable loses that is thrown at 20 m/s at a small body."""
    sim = simulator(
        {
            "cable.length": 0.2,
            "cable.diameter": 1e-3,
            "cable.density": 1200.0,
            "cable.youngs_modulus": 1e8,
            "discretization.control_points": 20,
            "start.fixed": [False] * 3,
            "start.position": [-0.1, 0.0, 0.0],
            "end.position": [0.1, 0.0, 0.0],
            "gravity": [0.0, 0.0, 0.0],
            "terms.twist": "off",
            "obstacles.names": ["body"],
            "obstacles.body.shape": shape,
            "obstacles.body.size": [5e-3, 5e-3, 1e-2],
            "obstacles.body.orientation": turn,
            "obstacles.body.position": [place, 0.0, -0.03],
            "obstacles.body.friction": 0.3,
        },
        method="energy_momentum",
        step=step,
    )
    velocities = np.zeros((20, 4))
    velocities[:, :3] = [*sideways, -20.0]
    sim.start_from(sim.control_points, velocities)
    assert sim.advance(3e-3).status.ok
    assert sim.energy_error < 1e-5
    knots = sim.model.knots
    shares = (knots[4:] - knots[:-4]) / 4.0 / 0.2
    return shares @ sim.velocities[:, 2] + 20.0


@pytest.mark.parametrize("shape", ["box", "sphere", "cylinder", "capsule"])
def test_nothing_passes_through_what_it_is_thrown_at(shape):
    """Steps of four times the body's size take most of the momentum that short steps take, though
    the cable may glance off to another side.
    """
    rng = np.random.default_rng(7)
    for _ in range(10):
        turn = rng.standard_normal(4)
        turn = (turn / np.linalg.norm(turn)).tolist()
        place, sideways = float(rng.uniform(-0.08, 0.08)), rng.normal(0.0, 0.5, 2)
        coarse, fine = (thrown(shape, turn, place, sideways, step) for step in (1e-3, 1e-4))
        assert fine > 0.2
        assert 0.4 < coarse / fine < 2.5
