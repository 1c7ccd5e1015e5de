"""Contact with obstacles: known answers, and refusals."""

import numpy as np
import pytest
from cables import move, simulator, weight

from dlo_sim.core import rotations
from dlo_sim.engine.contact import STIFFNESS
from dlo_sim.scene.loading import load_scene
from dlo_sim.scene.needs import mirrors
from dlo_sim.simulation.simulator import Simulator

RADIUS = 0.005
ROD = {
    "cable.length": 0.5,
    "cable.diameter": 2.0 * RADIUS,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 1e7,
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.05],
    "end.position": [0.45, 0.0, 0.15],
    "discretization.control_points": 13,
    "obstacles.names": ["table"],
}
DAMPED = {"damping.mass": 5.0, "damping.stiffness": 0.01}


def falling(*values, method="energy_momentum", step=0.005):
    return simulator(ROD, *values, method=method, step=step)


def test_it_comes_to_rest_on_a_table():
    """As deep as its weight presses it in, less than a thousandth of its diameter."""
    end = [0.45 * np.cos(np.pi / 18.0), 0.45 * np.sin(np.pi / 18.0), 0.15]
    sim = falling(DAMPED, {"end.position": end})
    sim.advance(30.0)
    depth = RADIUS - sim.centerline(np.linspace(0.0, 0.5, 101))[:, 2]
    stiffness = sim.cable.arrays.contact.law[0, STIFFNESS]
    # The round tips, which reach a radius beyond both ends, carry, too.
    mean = weight(sim) / (0.5 + 2.0 * RADIUS) / stiffness
    np.testing.assert_allclose(depth[10:-10], mean, rtol=0.05)
    assert 0.5 * mean < depth.min() < depth.max() < 0.002 * RADIUS
    energy = sim.energy()
    assert energy.kinetic < 1e-9
    np.testing.assert_allclose(
        sim.contact("table").force, [0.0, 0.0, weight(sim)], atol=1e-3 * weight(sim)
    )
    assert energy.contact == pytest.approx(0.5 * weight(sim) * mean, rel=0.03)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
def test_it_leaves_as_fast_as_the_restitution_says_at_every_step(step, restitution):
    """A rod that falls flat from 0.05 m: it rises to restitution^2 of that height again."""
    level = {"end.position": [0.5, 0.0, 0.05], "contact.restitution": restitution}
    sim = falling({"integrator.tolerance": 1e-12}, level, step=step)
    drop = 0.05 - RADIUS
    landing = np.sqrt(2.0 * drop / 9.81)
    sim.advance(landing * (1.0 + restitution) + step)
    risen = sim.centerline([0.25])[0, 2] - RADIUS
    # A landing is noticed at the end of a step, so up to a step late.
    late = step * restitution * np.sqrt(2.0 * 9.81 * drop)
    assert risen == pytest.approx(restitution**2 * drop, abs=1.5 * late + 0.02 * drop)
    assert sim.energy_error < 1e-8
    lost = sim.cable.account.dissipated / (weight(sim) * drop)
    assert lost == pytest.approx(1.0 - restitution**2, abs=0.02 + 3.0 * late / drop)


SLANTED = {
    "cable.length": 1.2,
    "cable.diameter": 0.004,
    "cable.density": 1800.0,
    "cable.youngs_modulus": 3e5,
    "cable.axial_stiffness": 400.0,
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.1],
    "end.position": [1.16, 0.0, 0.4],
    "discretization.control_points": 19,
    "obstacles.names": ["table"],
}


def centre_of_mass(sim):
    u = np.linspace(0.0, sim.scene.cable.length, 241)
    return np.trapezoid(sim.centerline(u), u, axis=0) / u[-1]


@pytest.mark.parametrize("step", [5e-3, 2.5e-3, 3e-4])
def test_what_has_landed_lies_while_the_rest_of_the_cable_lands(step):
    """A soft cable falls with a slant: each point of it falls freely until it lands."""
    sim = simulator(SLANTED, step=step)
    heights = sim.centerline(np.linspace(0.0, 1.2, 241))[:, 2]
    while sim.time < 0.4:
        sim.advance(0.02)
        fallen = np.maximum(heights - 0.5 * 9.81 * sim.time**2, 0.002)
        mean = 0.5 * (fallen[1:] + fallen[:-1]).mean()
        assert centre_of_mass(sim)[2] == pytest.approx(mean, abs=2e-3), sim.time  # 0.8 mm
    assert sim.energy_error < 1e-5


@pytest.mark.parametrize("step", [5e-3, 2.5e-3, 3e-4])
def test_a_cable_thrown_along_a_table_is_braked_as_the_law_of_coulomb_says(step):
    """Whatever lands when: what slides is braked by mu times the impulse that carries it."""
    sim = simulator(SLANTED, {"contact.friction": 0.2}, step=step)
    rates = np.zeros_like(sim.control_points)
    rates[:, 0] = 3.0
    sim.start_from(sim.control_points, rates)
    before = centre_of_mass(sim)
    while sim.time < 0.4:
        sim.advance(0.02)
        x, _, z = centre_of_mass(sim) - before
        braked = 0.2 * (0.5 * 9.81 * sim.time**2 + z)
        assert x == pytest.approx(3.0 * sim.time - braked, abs=2e-3), sim.time  # 0.6 mm of 107


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_falls_keep_the_energy_account_within_the_default_tolerance(friction):
    """Flat on a box, which touches and lets go within one step here and there."""
    box = {"shape": "box", "size": [0.6, 1.0, 0.1], "position": [0.25, 0.0, -0.05]}
    thin = {"cable.diameter": 0.003, "discretization.control_points": 6}
    values = {f"obstacles.table.{key}": value for key, value in box.items()} | thin
    values |= {"contact.friction": friction, "accuracy.estimate": "off"}
    for height in np.linspace(0.005, 0.04, 25):
        places = {"start.position": [0.0, 0.0, height], "end.position": [0.5, 0.0, height]}
        sim = falling(values, places, step=0.0025)
        report = sim.advance(0.4)
        assert report.status.ok and not report.message, height
        assert sim.energy_error < 1e-5, height


def test_it_slides_down_a_slope():
    """Lying along the contour of a slope of 0.3 rad: sideways at g sin(0.3), and no faster."""
    slope = rotations.from_rotation_vector(np.array([0.3, 0.0, 0.0]))
    normal = rotations.rotate(slope, np.array([0.0, 0.0, 1.0]))
    place = 0.998 * RADIUS * normal
    sim = falling(
        {
            "obstacles.table.orientation": slope.tolist(),
            "start.position": place.tolist(),
            "end.position": (place + [0.5, 0.0, 0.0]).tolist(),
        }
    )
    assert len(sim.model.axes) == 3
    sim.advance(1.0)
    moved = sim.centerline([0.25])[0] - place
    assert abs(moved @ normal) < 2e-4
    down = -0.5 * 9.81 * np.sin(0.3) * rotations.rotate(slope, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(moved[1:], down[1:], rtol=2e-3)


def test_a_plane_across_the_motion_mirrors_it():
    held = {"start.fixed": [True] * 3}
    assert mirrors(falling(held).scene) == [0.0, 1.0, 0.0]
    tilted = rotations.from_rotation_vector(np.array([0.1, 0.0, 0.0])).tolist()
    assert mirrors(falling(held, {"obstacles.table.orientation": tilted}).scene) == [0.0] * 3


def test_methods_agree():
    """On a hard landing, until a little after it."""

    def after(method, step):
        sim = falling({"contact.stiffness": 3e4}, method=method, step=step)
        sim.advance(0.2)
        return sim

    reference = after("energy_momentum", 2e-4)
    assert reference.energy().contact > 0.0
    sim = after("implicit_midpoint", 2e-4)
    np.testing.assert_allclose(sim.control_points, reference.control_points, atol=3e-4)


def test_a_held_cable_lies_down_in_its_equilibrium():
    held = {
        "start.fixed": [True] * 3,
        "end.fixed": [True] * 3,
        "start.position": [0.0, 0.0, 0.05],
        "end.position": [0.35, 0.0, 0.05],
        "cable.youngs_modulus": 1e5,
        "discretization.control_points": 25,
    }
    sim = falling(held, DAMPED)
    u = np.linspace(0.0, 0.5, 201)
    before = sim.centerline(u)
    assert 0.6 * RADIUS < before[:, 2].min() < RADIUS
    sim.advance(2.0)
    np.testing.assert_allclose(sim.centerline(u), before, atol=1e-4)


def test_what_the_cable_cannot_reach_is_named():
    far = {"obstacles.table.position": [0.0, 0.0, -1.0], "start.fixed": [True] * 3}
    reason = falling(far).left_out["obstacles.table"]
    assert reason == "1.05 m from the start of a cable of 0.5 m"
    assert "obstacles.table" not in falling({"start.fixed": [True] * 3}).left_out
    driven = {"start.pose_topic": "/pose"}
    assert "obstacles.table" not in falling(far, driven).left_out


@pytest.mark.parametrize(
    ("guide", "lift", "aside"),
    [("peg", [0.1, 0.0, 0.05], [0.1, 0.2, 0.0]), ("clip", [-0.1, 0.0, 0.05], [-0.1, 0.1, 0.0])],
)
def test_a_cable_is_drawn_from_the_table_through_a_guide(guide, lift, aside):
    """The shipped scene, with a gripper that lifts the cable and draws it past the peg, or through
    the clip.
    """
    sim = Simulator(load_scene("table", {"obstacles.names": ["table", guide]}))
    aside_motion = move(sim, "start", 1.0, velocity=lift).then(1.5, velocity=aside)
    sim.set_motion("start", aside_motion)
    sim.set_motion("start", aside_motion.then(1.0, velocity=[0.0, 0.0, 0.0]))
    held = []
    for _ in range(25):
        assert sim.advance(0.1).status.ok
        found = sim.contacts
        assert found["table"].clearance > -0.01 * sim.scene.cable.diameter
        held.append(np.linalg.norm(found[guide].force))
    assert max(held) > 0.05
    assert sim.advance(0.5).status.ok
    found = sim.contacts
    assert sim.energy_error < 1e-5
    # At rest again, the weight is on the table, on the gripper, and by friction on the guide.
    carried = sim.reaction("start")[0][2] + sum(one.force[2] for one in found.values())
    assert carried == pytest.approx(weight(sim), rel=2e-3)
    if guide == "clip":
        assert found["clip"].passes[0] > 0.3
