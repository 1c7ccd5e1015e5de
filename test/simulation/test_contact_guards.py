"""Obstacles that jump, steps that would jump over them, and cables with no room."""

import re

import numpy as np
import pytest
from cables import simulator

from dlo_sim import Simulator, load_scene
from dlo_sim.core.end_motion import EndMotion

RADIUS = 0.003
LYING = {
    "cable.length": 0.3,
    "cable.diameter": 2.0 * RADIUS,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 2e6,
    "start.fixed": [False] * 3,
    "start.position": [-0.15, 0.0, RADIUS],
    "end.position": [0.15, 0.0, RADIUS],
    "terms.twist": "off",
    "terms.out_of_plane": "on",
    "integrator.tolerance": 1e-11,
    "discretization.control_points": 13,
    "obstacles.names": ["table", "body"],
    "obstacles.body.shape": "box",
    "obstacles.body.size": [0.1, 0.1, 0.2],
    "obstacles.body.position": [0.0, 0.0, 1.0],
}
RING = {
    "shape": "ring",
    "size": [0.02, 0.004, 0.0],
    "position": [0.002, 0.0, RADIUS],
    "orientation": [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)],
}


def lying(*values, method="energy_momentum", step=2e-3):
    return simulator(LYING, *values, method=method, step=step)


def fastest(sim):
    return np.linalg.norm(sim.velocities[:, :3], axis=1).max()


def test_an_obstacle_that_jumps_into_the_cable_pushes_it_out_slowly():
    """40 mm deep, with an account that knows its work."""
    sim = lying({"contact.friction": 0.2})
    sim.advance(0.1)
    assert not any(line.startswith("obstacles") for line in sim.warnings)
    sim.set_obstacle("body", [0.0, -0.01, 0.0])
    (line,) = (line for line in sim.warnings if line.startswith("obstacles"))
    assert line.startswith("obstacles.body: jumped into the cable once, by 0.043 m at most; it")
    most = 0.0
    for _ in range(400):
        assert sim.advance(0.01).status.ok
        most = max(most, fastest(sim))
    assert 0.1 < most < 2.0
    assert sim.contact("body").clearance > -0.1 * RADIUS
    assert 0.04 + 0.9 * RADIUS < sim.centerline([0.15])[0, 1] < 0.08
    assert sim.energy_error < 1e-8


@pytest.mark.parametrize(
    "body", [{"position": [0.0, 0.0, 0.0]}, {"size": [0.02, 0.2, 0.2]}, {"position": [0.12, 0, 0]}]
)
def test_a_body_that_jumps_onto_the_cable_does_not_tear_it_along(body):
    """It pushes the cable out of two opposite sides at once, which the cable cannot follow."""
    given = {f"obstacles.body.{key}": value for key, value in body.items() if key == "size"}
    sim = lying({"contact.friction": 0.2}, given)
    sim.set_obstacle("body", body.get("position", [0.0, 0.0, 0.0]))
    most = 0.0
    for _ in range(40):
        assert sim.advance(0.01).status.ok
        most = max(most, fastest(sim))
    assert most < 0.6
    assert any("the cable is pressed" in line for line in sim.warnings)
    assert sim.energy_error < 1e-8


def test_what_pulls_the_cable_into_a_body_that_yields_gets_nowhere():
    """A load presses it onto a table that has jumped."""
    load = {"loads.names": ["press"], "loads.press.position": 0.5, "damping.mass": 20.0}
    load |= {"loads.press.signal": "constant", "loads.press.force": [0.0, 0.0, -5.0]}
    sim = lying(load)
    sim.set_obstacle("table", [0.0, 0.0, 0.004])
    deep = []
    for _ in range(3):
        assert sim.advance(0.2).status.ok
        deep.append(-sim.contact("table").clearance)
    assert deep == pytest.approx([deep[0]] * 3, rel=0.02)
    assert deep[0] < 0.004 + 2.0 * RADIUS


def test_a_cable_that_begins_a_little_inside_is_told_so():
    """And not that the obstacle jumped."""
    low = {"start.position": [-0.15, 0.0, -0.001], "end.position": [0.15, 0.0, -0.001]}
    sim = lying(low)
    (line,) = sim.warnings
    assert line.startswith("obstacles.table: the cable began 0.004 m inside it; it yields and")
    assert line.endswith("at 0.2 m/s: move it, or the cable's ends")
    assert sim.advance(0.1).status.ok
    assert fastest(sim) < 0.3


def thrown(speed, step):
    """A thin cable flies at a small box."""
    sim = simulator(
        LYING,
        {
            "cable.diameter": 1e-3,
            "cable.youngs_modulus": 1e8,
            "gravity": [0.0, 0.0, 0.0],
            "obstacles.body.size": [5e-3, 5e-3, 1e-2],
            "obstacles.body.position": [0.0, 0.0, -0.03],
            "obstacles.body.friction": 0.3,
            "obstacles.table.position": [0.0, 0.0, -1.0],
        },
        step=step,
    )
    velocities = np.zeros((13, 4))
    velocities[:, 2] = -speed
    sim.start_from(sim.control_points, velocities)
    return sim, sim.advance(0.06 / speed)


@pytest.mark.parametrize(("speed", "step"), [(20.0, 1e-4), (100.0, 1e-4), (300.0, 1e-5)])
def test_a_thin_cable_thrown_at_a_small_body_does_not_pass_it(speed, step):
    """Also at fifteen times inputs.max_speed, for which contact is chosen. At twenty times a knot
    span of 30 mm folds round the body, which is reported.
    """
    sim, report = thrown(speed, step)
    assert report.status.ok
    assert sim.contact("body").clearance > -0.4e-3  # of a body of 5 mm
    assert sim.centerline(np.linspace(0.14, 0.16, 9))[:, 2].max() > -0.03  # its middle


def test_a_thin_ring_that_is_pulled_through_a_taut_cable_is_told():
    """Its wire passes between two samples."""
    taut = {"start.fixed": [True] * 3, "end.fixed": [True] * 3, "end.position": [0.156, 0, RADIUS]}
    ring = {f"obstacles.body.{key}": value for key, value in RING.items()}
    sim = lying(taut, ring, {"cable.axial_stiffness": 2e4, "initial.shape": "straight"})
    place = EndMotion.resting(RING["position"], RING["orientation"])
    sim.move_obstacle("body", place.then(0.3, velocity=[0.0, 0.0, 1.0]))
    assert sim.advance(0.3).status.ok
    assert sim.contact("body").clearance > 0.1
    through, *pressed = sim.warnings
    assert pressed and all(" pressed " in line for line in pressed)
    assert "pressed near the middle of one, and may have gone through it" in through
    assert "raise contact.stiffness, or inputs.max_speed (20 m/s)" in through


def test_a_squeezed_cable_stays_finite():
    """Between the table and a plate that comes down to a third of its thickness, and goes on."""
    plate = {"obstacles.body.size": [1.0, 1.0, 0.1], "contact.stiffness": 1e5}
    sim = lying(plate, {"damping.mass": 1.0})
    down = EndMotion.resting([0.0, 0.0, 0.05 + 2.5 * RADIUS])
    sim.set_obstacle("body", down.position)
    sim.move_obstacle("body", down.then(0.5, velocity=[0.0, 0.0, -3.7 * RADIUS]))
    for _ in range(6):
        assert sim.advance(0.1).status.ok
    assert np.isfinite(sim.control_points).all()
    lines = [line for line in sim.warnings if " pressed " not in line]
    assert not lines
    assert sim.contact("body").force[2] == pytest.approx(-sim.contact("table").force[2], rel=0.05)
    assert -sim.contact("body").force[2] > 10.0
    assert fastest(sim) < 0.01


def test_a_cable_pinned_inside_a_body_stays_finite():
    """Held at both ends, it cannot leave: it is pushed as far as they let it."""
    held = {"start.fixed": [True] * 3, "end.fixed": [True] * 3, "damping.mass": 1.0}
    sim = lying(held)
    sim.set_obstacle("body", [0.0, -0.02, 0.0])
    for _ in range(10):
        report = sim.advance(0.05)
        assert report.status.advanced, report.message
    assert np.isfinite(sim.control_points).all()
    assert "obstacles.body: jumped into the cable once" in sim.warnings[0]


@pytest.mark.parametrize(
    ("shape", "radius", "youngs_modulus", "pull"),
    [("sphere", 0.05, 1e9, 0.0), ("cylinder", 0.01, 1e7, 2.0), ("cylinder", 0.01, 1e8, 20.0)],
)
def test_a_cable_over_a_body_penetrates_by_a_hundredth(shape, radius, youngs_modulus, pull):
    """Stiff, or pulled down at both ends; nor does its damping open the energy account."""
    values = {"cable.youngs_modulus": youngs_modulus, "cable.length": 0.5, "damping.mass": 20.0}
    values |= {"obstacles.names": ["body"], "obstacles.body.shape": shape, "contact.friction": 0.5}
    values |= {"obstacles.body.size": [2.0 * radius, 2.0 * radius, 0.2 * (shape == "cylinder")]}
    values |= {"obstacles.body.orientation": [0.5**0.5, 0.0, 0.0, 0.5**0.5]}
    height = radius + RADIUS
    values |= {"start.position": [-0.25, 0.0, height], "end.position": [0.25, 0.0, height]}
    values |= {"obstacles.body.position": [0.0, 0.0, 0.0], "discretization.control_points": 41}
    values |= {"loads.names": ["left", "right"], "loads.left.position": 0.0}
    for name in ("left", "right"):
        values |= {f"loads.{name}.signal": "constant", f"loads.{name}.force": [0.0, 0.0, -pull]}
    values |= {"integrator.tolerance": 1e-6, "damping.stiffness": 0.01}
    sim = lying(values, step=2.5e-3)
    assert sim.advance(2.0).status.ok
    weight = sim.scene.cable.mu * 0.5 * 9.81
    assert sim.contact("body").force[2] == pytest.approx(weight + 2.0 * pull, rel=0.01)
    assert -0.015 < sim.contact("body").clearance / (2.0 * RADIUS) < 0.0
    assert sim.energy_error < 1e-5
    # Deeper only while it comes to lie on a few samples, which is said.
    assert all("the cable was pressed" in line for line in sim.warnings)


def test_a_cable_with_no_room_between_planes_is_told():
    """The table holds; the lid that jumps yields, and stays inside it."""
    lid = {"shape": "plane", "orientation": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 1.0]}
    sim = lying({f"obstacles.body.{key}": value for key, value in lid.items()})
    sim.set_obstacle("body", [0.0, 0.0, 1.2 * RADIUS], lid["orientation"])
    assert sim.advance(0.5).status.ok
    lines = [line for line in sim.warnings if "the cable is pressed" in line]
    assert [line.split(":")[0] for line in lines] == ["obstacles.body"]
    assert "0.0024 m into it, 40% of its diameter; give it room" in lines[0]
    assert fastest(sim) < 0.01


def test_an_obstacle_that_is_thinner_than_the_samples_is_told():
    """Of 4 m of cable with 9 control points, 128 samples of a span are 5.2 mm apart."""
    pin = {"obstacles.body.shape": "cylinder", "obstacles.body.size": [1e-3, 1e-3, 0.1]}
    pin |= {"cable.length": 4.0, "cable.diameter": 1e-3, "end.position": [3.4, 0.0, RADIUS]}
    (line,) = lying(pin, {"discretization.control_points": 9}).warnings
    assert line.startswith(
        "obstacles.body: may pass between samples of the cable, which are 0.00521"
    )
    assert line.endswith("raise discretization.control_points to 19 or more")
    assert not lying(pin, {"discretization.control_points": 19}).warnings


def test_a_bend_round_an_edge_that_the_spans_cannot_follow_is_told():
    """Chosen spans can, given ones need not; what lies flat is not meant. The number that is told
    does.
    """
    values = {
        "cable.length": 0.6,
        "cable.diameter": 0.006,
        "cable.bending_stiffness": 1e-5,
        "cable.linear_density": 0.03,
        "damping.mass": 5.0,
        "damping.bend": 0.01,
        "start.position": [-0.4, 0.0, 0.003],
        "end.position": [0.2, 0.0, 0.003],
        "end.fixed": [False] * 3,
        "initial.shape": "straight",
        "integrator.method": "energy_momentum",
        "contact.friction": 0.5,
        "obstacles.names": ["box"],
        "obstacles.box.shape": "box",
        "obstacles.box.size": [1.0, 0.5, 0.1],
        "obstacles.box.position": [-0.5, 0.0, -0.05],
    }
    told = {}
    for points in (0, 25):
        sim = Simulator(load_scene(values | {"discretization.control_points": points}))
        assert not sim.warnings
        sim.advance(1.0)
        told[sim.model.n] = sim.warnings
    assert told[60] == ()
    (line,) = told[25]
    found = re.fullmatch(
        r"obstacles.box: the cable bends round it by 0\.9\d rad in a knot span at 0\.40\d m, so "
        r"forces there may be some 10 % off or more; raise discretization.control_points to (\d+)",
        line,
    )
    assert found
    assert 50 <= int(found[1]) <= 75
    sim = Simulator(load_scene(values | {"discretization.control_points": int(found[1])}))
    sim.advance(1.0)
    assert not sim.warnings
