"""Contact of the cable with itself: exact balances, nothing passes through, refusals, warnings."""

import warnings

import numpy as np
import pytest
from cables import momenta, move, simulator

from dlo_sim import Plan
from dlo_sim.core import bspline
from dlo_sim.session import cdr
from dlo_sim.session.outputs import Outputs
from dlo_sim.session.topics import CONTACTS
from dlo_sim.simulation import self_contact

DIAMETER, COUNT = 0.005, 26
CABLE = {
    "cable.diameter": DIAMETER,
    "cable.linear_density": 0.05,
    "cable.axial_stiffness": 500.0,
    "cable.bending_stiffness": 1e-3,
    "discretization.control_points": COUNT,
    "gravity": [0.0, 0.0, 0.0],
    "terms.twist": "off",
    "terms.out_of_plane": "on",
    "contact.self_contact": "on",
}
FREE = {"start.fixed": [False] * 3, "end.fixed": [False] * 3}
HELD = {"start.fixed": [True] * 3, "end.fixed": [True] * 3}
DAMPED = {"damping.air_drag": 0.05, "damping.stretch": 1e-3, "damping.bend": 2e-3}


def along(path, *values, step=1e-3, method="energy_momentum", count=COUNT):
    """A simulator of a cable at rest along a path of dense points, of its length, and its control
    points."""
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    u = np.linspace(0.0, s[-1], 20 * count)
    dense = np.stack([np.interp(u, s, path[:, k]) for k in range(3)], axis=1)
    basis = bspline.evaluate(np.eye(count), bspline.clamped_knots(count, s[-1]), u)
    points = np.linalg.lstsq(basis, dense, rcond=None)[0]
    held = {
        "cable.length": float(s[-1]),
        "start.position": points[0].tolist(),
        "end.position": points[-1].tolist(),
        "discretization.control_points": count,
    }
    sim = simulator(CABLE, held, *values, step=step, method=method)
    sim.start_from(np.hstack([points, np.zeros((count, 1))]))
    return sim, points


def hairpin():
    """Two strands 3 cm apart in y that cross seen along y, joined by half a circle at x = 0."""
    t, angle = np.linspace(0.0, 1.0, 400)[:, None], np.linspace(0.5, -0.5, 200)[:, None] * np.pi
    one = np.hstack((0.15 * t - 0.15, 0.0 * t + 0.015, 0.03 * np.sin(np.pi * t)))
    bend = 0.015 * np.hstack((np.cos(angle), np.sin(angle), 0.0 * angle))
    other = np.hstack((-0.15 * t, 0.0 * t - 0.015, -0.04 * np.sin(2.0 * np.pi * t)))
    return np.vstack((one, bend, other))


def thrown(*values, speed=1.0, step=2e-4):
    """The free hairpin, whose strands are thrown at each other."""
    sim, points = along(hairpin(), FREE, *values, step=step)
    inward = np.tanh(points[:, 1] / 0.008) * np.clip((-0.02 - points[:, 0]) / 0.05, 0.0, 1.0)
    rates = np.zeros((COUNT, 4))
    rates[:, 1], rates[:, 0] = -speed * inward, 0.1
    sim.start_from(np.hstack([points, np.zeros((COUNT, 1))]), rates)
    return sim


def overhand():
    """An open trefoil with straight tails."""
    t = np.linspace(-2.05, 2.05, 2000)
    x, y = 0.012 * (t**3 - 3.0 * t), 0.0096 * (t**4 - 4.0 * t**2)
    knot = np.stack((x, y, 0.006 * (t**5 - 10.0 * t)), axis=1)
    s = np.linspace(0.0, 0.08, 100)[:, None]
    ends = knot[0] - knot[1], knot[-1] - knot[-2]
    before, after = (end / np.linalg.norm(end) for end in ends)
    return np.vstack((knot[0] + s[:0:-1] * before, knot, knot[-1] + s[1:] * after))


def loop(gap):
    """A loop in the plane xy whose legs cross at a distance of their axes in diameters."""
    t = np.linspace(-1.6, 1.6, 3000)
    over = gap * 0.5 * DIAMETER * np.sin(0.5 * np.pi * t)
    return np.stack((0.06 * (t**2 - 1.0), 0.05 * (t**3 - t), over), axis=1)


def bulb(gap):
    """A hairpin in the plane xz whose strands lie along each other at this distance of their axes
    in diameters."""
    t, angle = np.linspace(0.0, 1.0, 400)[:, None], np.linspace(0.5, -0.5, 200)[:, None] * np.pi
    near, none = 0.5 * gap * DIAMETER, 0.0 * t
    ahead = 0.0125 * (0.5 + 0.5 * np.cos(np.pi * np.clip(2.5 * t, 0.0, 1.0)))
    one, other = np.hstack((-0.15 * t, none, near + ahead)), np.hstack((-0.15 * t, none, none))
    other[:, 2] -= one[:, 2]
    bend = (near + 0.0125) * np.hstack((np.cos(angle), 0.0 * angle, np.sin(angle)))
    return np.vstack((one[::-1], bend, other))


def pulled_apart(sim, points):
    """The same simulator, whose ends go on at 0.2 m/s, away from each other."""
    out = points[-1] - points[0]
    out *= 0.2 / np.linalg.norm(out)
    for name, way in (("start", -out), ("end", out)):
        move(sim, name, 1.0, velocity=way)
    return sim


def shown_lines(sim):
    """Number of the ends of the lines along contact forces that `~/contacts` shows."""
    (message,) = Outputs(sim.scene, COUNT).messages(sim, 0, {CONTACTS})
    (lines,) = cdr.read(cdr.MARKER_ARRAY, message.data).markers
    return len(lines.points)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_strands_that_collide_keep_momentum_and_account(friction):
    """Pressure keeps the angular momentum, too."""
    exact = {"contact.friction": friction, "contact.damping": 0.0, "integrator.tolerance": 1e-11}
    sim = thrown(exact)
    flow, spin = momenta(sim)
    touched = 0.0
    for _ in range(50):
        assert sim.advance(0.0004).status.ok
        touched = max(touched, sim.energy().contact)
        now, turned = momenta(sim)
        np.testing.assert_allclose(now, flow, atol=1e-12 * np.linalg.norm(flow))
        if friction == 0.0:
            np.testing.assert_allclose(turned, spin, atol=1e-11 * np.linalg.norm(spin))
    assert touched > 1e-6
    assert ("friction" in sim.active_terms) == (friction > 0.0)
    assert sim.energy_error < 1e-8
    lost = float(sim.cable.account.dissipated)
    assert (lost > 1e-5) if friction else (lost == 0.0)
    assert sim.cable.account.crossed == 0.0
    assert sim.clearance_to_itself > -DIAMETER


def test_only_contact_keeps_strands_from_passing():
    """Seen along y, the strands that cross keep their order at 10 m/s, and lose it without."""

    def order(settings):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = thrown(settings, DAMPED, speed=10.0, step=5e-4)
            assert sim.advance(0.006).status.ok
        line = sim.centerline(np.linspace(0.0, sim.scene.cable.length, 600))
        one, other = line[:250], line[350:]
        apart = np.linalg.norm((one[:, None] - other)[:, :, [0, 2]], axis=2)
        a, b = np.unravel_index(np.argmin(apart), apart.shape)
        return sim, one[a, 1] - other[b, 1]

    sim, between = order({})
    assert between > 0.5 * DIAMETER
    assert sim.cable.account.crossed == sim.cable.account.pairs_lost == 0.0
    sim, between = order({"contact.self_contact": "off"})
    assert between < -0.5 * DIAMETER


def test_contact_too_soft_to_hold_is_counted():
    """Steps in which strands pass are repeated down to small ones, then counted."""
    sim = thrown({"contact.stiffness": 100.0}, DAMPED, speed=10.0, step=5e-4)
    assert sim.advance(0.006).status.ok
    assert sim.cable.account.crossed > 0.0
    assert any("contact.self_contact: it passed through itself in" in line for line in sim.warnings)


def test_a_knot_is_tightened():
    """The ends of an overhand knot are pulled apart: it locks, and nothing passes through."""
    sim = pulled_apart(*along(overhand(), HELD, DAMPED, {"contact.friction": 0.2}))
    pulled, iterations, steps = [], 0, 0
    for _ in range(5):
        report = sim.advance(0.05)
        assert report.status.ok
        iterations, steps = iterations + report.force_evaluations, steps + report.steps
        pulled.append(np.linalg.norm(sim.reaction("end")[0]))
        assert sim.clearance_to_itself > -0.02 * DIAMETER
    assert pulled[-1] > 2.0 * pulled[1] > 0.1
    # with couplings in the matrix 5, without them 14 and halved steps
    assert iterations < 9 * steps
    assert sim.energy_error < 1e-5
    found = sim.contacts["itself"]
    assert len(found.u) > 10
    assert found.total > pulled[-1]
    np.testing.assert_allclose(found.points, sim.centerline(found.u), atol=1e-12)
    assert shown_lines(sim) == 2 * len(found.u)
    (line,) = (line for line in sim.warnings if "contact.self_contact" in line)
    assert line.startswith("contact.self_contact: the cable bends round itself by 1.")
    assert line.endswith("raise discretization.control_points to 41")
    forecast = sim.forecast(Plan(np.array([0.0, 0.004]), {}), 0.002)  # that the motion goes on
    sim.advance(0.004)
    last = sim.contacts["itself"]
    assert forecast.contact["to_itself"] == forecast.contact["clearance"]
    assert forecast.obstacles["contact_to_itself"][-1] == last.clearance < 0.0
    sim.cable.touch_anew(sim.time)  # a shape tells no friction
    total = sim.contacts["itself"].total
    assert forecast.obstacles["contact_total"][-1] == pytest.approx(total, rel=1e-12)
    assert 0.5 * last.total < total != last.total


def test_the_control_points_that_a_knot_is_told_carry_its_pull():
    """It converges at 1.80 N (60 to 120 control points); 26 make it 15 % too large."""
    pulls = []
    for count in (COUNT, 41):
        held = HELD | DAMPED | {"contact.friction": 0.2}
        sim = pulled_apart(*along(overhand(), held, count=count))
        sim.advance(0.25)
        pulls.append(np.linalg.norm(sim.reaction("end")[0]))
        assert sim.control_points_needed == (41 if count == COUNT else 0)
    assert pulls[0] > 2.0
    assert pulls[1] == pytest.approx(1.80, rel=0.03)


def test_a_cable_much_thinner_than_its_segments_is_knotted():
    """Segments of a hundred diameters: their smoothing must not let strands come through."""
    sim = pulled_apart(*along(overhand(), HELD, DAMPED, {"cable.diameter": 1e-5}))
    pressed = []
    for _ in range(10):
        assert sim.advance(0.01).status.ok
        pressed.append(sim.contacts["itself"].total)
        assert sim.cable.strands()[:, 0].min() > -0.1e-5
    assert max(pressed) > 0.1
    assert sim.cable.account.crossed == 0.0
    assert any("are coarse for a diameter of 1e-05 m" in line for line in sim.warnings)


def test_strands_that_overlap_are_pushed_out_slowly():
    sim, _ = along(loop(0.6), FREE, DAMPED, {"contact.friction": 0.2})
    began = sim.clearance_to_itself
    assert began == pytest.approx(-0.4 * DIAMETER, rel=1e-2)
    gaps = []
    for _ in range(10):
        assert sim.advance(0.001).status.ok
        gaps.append(sim.clearance_to_itself - began)
    assert max(np.diff(gaps[:5])) < 1.2 * 0.2e-3, "at 0.2 m/s, as long as nothing else moves them"
    assert gaps[-1] > 0.38 * DIAMETER
    assert sim.energy_error < 1e-6
    assert any("began up to 0.002 m inside itself" in line for line in sim.warnings)


def squeezed(speed):
    """A simulator of a hairpin whose strands grasp a has pressed against each other for 0.1 s, with
    grasp b opposite and grasp c at the end, which has not taken the cable."""
    path = bulb(1.4)
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    grasps = {"grasps.names": ["a", "b", "c"], "terms.out_of_plane": "off"}
    for name, share in (("a", 0.25), ("b", 0.75), ("c", 0.5)):
        place = [float(np.interp(share * s[-1], s, path[:, k])) for k in range(3)]
        grasps |= {f"grasps.{name}.at": share, f"grasps.{name}.position": place}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that what is held is moved by 0.1 mm
        held = {"contact.friction": 0.2, "grasps.c.taken": False}
        sim, _ = along(path, HELD, DAMPED, grasps, held)
    move(sim, "a", 0.1, velocity=[0.0, 0.0, -speed])
    assert sim.advance(0.1).status.ok
    return sim


def test_strands_stay_pressed_while_something_else_changes():
    """Where another grasp takes or releases the cable, and in a simulator of another scene, unless
    a grasp does not hold the cable that has pressed them; by another law they are pressed as much.
    """
    sim = squeezed(0.025)
    before, rows = sim.contacts["itself"], sim.cable.strands()
    assert before.total > 10.0 and rows[:, 0].min() < -0.05 * DIAMETER
    assert np.abs(sim.cable.arrays.state.pair[1:]).max() > 0.0
    sim.take("c")
    np.testing.assert_array_equal(sim.cable.strands(), rows)
    sim.release("c")
    np.testing.assert_array_equal(sim.cable.strands(), rows)
    other = sim.reconfigured(sim.scene.with_values({"damping.air_drag": 0.1}))
    after = other.contacts["itself"]
    np.testing.assert_allclose(after.forces, before.forces, rtol=1e-9, atol=1e-9)
    assert other.cable.account.dissipated == 0.0
    assert not any("inside itself" in line for line in other.warnings)
    assert other.advance(0.001).status.ok
    assert other.contacts["itself"].total > 0.9 * before.total
    other = sim.reconfigured(sim.scene.with_values({"contact.stiffness": 1e9}))
    assert other.contacts["itself"].pressure == pytest.approx(before.pressure, rel=0.01)
    assert any("inside itself, or came there by changed parameters" in x for x in other.warnings)
    other = sim.reconfigured(sim.scene.with_values({"grasps.a.taken": False}))
    assert other.contacts["itself"].total < 1e-3 * before.total
    assert not any("inside itself" in line for line in other.warnings)


def test_strands_that_grippers_squeezed_part_slowly():
    """Let go, the pressure of 0.4 diameters would throw them apart with 40 m/s; the gripper takes
    its energy."""
    sim = squeezed(0.04)
    began = sim.clearance_to_itself
    assert began == pytest.approx(-0.4 * DIAMETER, rel=0.01)
    assert sim.energy().contact > 0.3
    assert any("strands are pressed 0.002 m into each" in line for line in sim.warnings)
    sim.release("a")
    assert sim.energy().contact < 0.01
    assert sim.advance(0.02).status.ok
    assert np.abs(sim.velocities).max() < 4.0
    assert sim.clearance_to_itself > -0.01 * DIAMETER
    assert sim.energy_error < 1e-6


def test_what_is_far_from_itself_is_as_without():
    """The same bits, and no pair is looked at."""
    values = {"start.position": [0.0] * 3, "end.position": [0.2, 0.0, 0.0], "cable.length": 0.3}
    sims = [
        simulator(CABLE, values, {"contact.self_contact": one}, step=1e-3) for one in ("on", "off")
    ]
    for sim in sims:
        sim.set_end("end", [0.18, 0.05, 0.0])
        sim.advance(0.2)
    assert (sims[0].control_points == sims[1].control_points).all()
    assert sims[0].cable.account.pairs == 0.0


def test_a_gripper_that_jumps_may_fold_the_cable():
    """No smaller step would be without the jump; what was straight is looked at then."""
    sim, points = along(hairpin(), HELD, DAMPED)
    sim.set_end("end", points[-1] + [0.0, -0.01, 0.0])
    assert sim.advance(0.001).status.ok
    assert sim.cable.account.pairs > 0.0, "also what is next to each other"
    assert sim.advance(0.05).status.ok
    assert sim.cable.account.pairs < 20.0
    assert sim.cable.account.pairs_lost == sim.cable.account.crossed == 0.0
    assert sim.energy_error < 1e-5


def test_without_it_passing_through_is_counted():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = thrown({"contact.self_contact": "off"}, DAMPED, speed=1.0)
        ahead = sim.forecast(Plan(np.array([0.0, 0.03]), {}), 0.005)
        for _ in range(6):
            sim.advance(0.005)
    assert sim.left_out["self_contact"] == "contact.self_contact is not on"
    (line,) = [line for line in sim.warnings if line.startswith("contact.self_contact: off")]
    assert "first at 0.015 s, in 1 of 3 looks, up to 0.0039 m deep" in line
    assert "in 1 of 3 looks, up to 0.0039 m deep" in ahead.warnings[-1]


@pytest.mark.parametrize(("points", "found"), [(4, True), (40, True), (40, False)])
def test_a_loop_that_crosses_itself_is_seen_with_one_span(points, found):
    """A loop of one span turns by 360 degrees, though its first and last edges are parallel."""
    values = {"end.position": [0.05, 0.0, 0.0], "start.position": [0.0] * 3, "cable.length": 0.4}
    sim = simulator(CABLE, FREE, values, {"contact.self_contact": "off"}, n=points)
    t = np.linspace(-1.6, 1.6 if found else 0.8, 500)
    path = np.stack((0.06 * (t**2 - 1.0), 0.05 * (t**3 - t), 0.0 * t), axis=1)
    basis = bspline.evaluate(np.eye(points), sim.model.knots, np.linspace(0.0, 0.4, len(t)))
    place = np.linalg.lstsq(basis, path, rcond=None)[0]
    nearest = self_contact.nearest(sim.model, place)
    assert (nearest.clearance < 0.0) == found
