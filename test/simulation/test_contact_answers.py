"""Known answers of friction and of contact with bodies."""

import numpy as np
import pytest
from cables import simulator

from dlo_sim.core import rotations
from dlo_sim.engine.contact import BRISTLE
from dlo_sim.studies import bodies


def middle(sim):
    return sim.centerline([0.5 * sim.scene.cable.length])[0]


def test_a_pulled_rod_sticks_below_the_friction():
    """By its bristles alone; a load that comes at once sends a wave along it, which slips."""
    sim = bodies.pulled(0.0, 5e-4)
    before = middle(sim)
    elastic = 3.8 / sim.cable.arrays.contact.law[0, BRISTLE]
    bodies.pull_slowly(sim, 3.8)
    sim.advance(30.0)
    first = middle(sim) - before
    sim.advance(30.0)
    last = middle(sim) - before
    assert last[0] == pytest.approx(elastic, abs=1e-6)
    assert abs(last[0] - first[0]) < 1e-13
    assert sim.energy().kinetic < 1e-20
    np.testing.assert_allclose(sim.contact("table").force, [-3.8, 0.0, 9.8], atol=1e-9)


def within(measured, allowed):
    """Whether all answers of a test of the study are, with a closed energy account."""
    assert measured.simulator.energy_error < 1e-4
    for answer in measured.answers:
        assert abs(answer.error) < allowed, answer


@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize("force", [5.0, 8.0, 10.0])
def test_a_rod_pulled_harder_slides(force, step):
    within(bodies.sliding(force, step), 0.01)


@pytest.mark.parametrize("clamped", [True, False])
def test_a_lifted_end_carries_what_it_lifts(clamped):
    found = bodies.lifted(clamped, 40)
    within(found, 0.005)
    # what the end does not carry lies on the table
    carried = found.answers[1].value
    lies = found.simulator.contact("table").force[2]
    assert lies == pytest.approx(0.6 * bodies.WEIGHT - carried, rel=1e-6)


@pytest.mark.parametrize(
    ("wrap", "ratio", "points"), [(0.5, 1.602, 43), (1.0, 2.566, 83), (2.0, 6.586, 166)]
)
def test_a_capstan_holds_by_its_friction(wrap, ratio, points):
    found = bodies.capstan(wrap * np.pi, points)
    assert found.answers[0].exact == pytest.approx(ratio, rel=1e-3)
    within(found, 0.01)


def test_a_conveyor_drags_what_one_end_holds():
    within(bodies.conveyor(1e-3), 0.01)


@pytest.mark.parametrize("share", [0.995, 1.005])
def test_it_slides_down_a_slope_beyond_the_friction_angle_only(share):
    angle = np.arctan(bodies.ROD_FRICTION * share)
    up = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    along = np.array([np.cos(angle), 0.0, np.sin(angle)])
    start = 0.025 * up
    turned = rotations.from_rotation_vector(np.array([0.0, -angle, 0.0]))
    sim = simulator(
        bodies.ROD,
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
    pull = 9.8 * (np.sin(angle) - bodies.ROD_FRICTION * np.cos(angle))
    if share < 1.0:
        assert abs(slid) < 1e-9
    else:
        assert slid == pytest.approx(0.5 * pull * (10.0**2 - 5.0**2), rel=0.02)


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
    for _ in range(4):
        turn = rng.standard_normal(4)
        turn = (turn / np.linalg.norm(turn)).tolist()
        place, sideways = float(rng.uniform(-0.08, 0.08)), rng.normal(0.0, 0.5, 2)
        coarse, fine = (thrown(shape, turn, place, sideways, step) for step in (1e-3, 1e-4))
        assert fine > 0.2
        assert 0.4 < coarse / fine < 2.5
