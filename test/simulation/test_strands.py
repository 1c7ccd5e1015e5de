"""Several cables of a scene beside each other: each moves as alone, and they touch."""

import numpy as np
import pytest
from cables import move, scene_of
from nets import WEIGHTLESS, WIRE, momenta, net

from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.self_contact import Watch, contacts_of, nearest
from dlo_sim.simulation.simulator import Simulator

FIXED, LOOSE = [True] * 3, [False] * 3
THICK, THIN = 0.01, 0.004
TOUCHING = {
    "contact.self_contact": "on",
    "cable.bending_stiffness": 1e-5,
    "cable.axial_stiffness": 2e3,
    "cable.length": 0.4,
    "terms.twist": "off",
    "discretization.control_points": 21,
    "discretization.stretch": "span",
}


def further(**cables):
    """Values of further cables, which have those of TOUCHING unless they say otherwise."""
    found = {"cables.names": list(cables)}
    for name, own in cables.items():
        alike = {key: value for key, value in TOUCHING.items() if key.startswith("cable.")}
        alike |= {"discretization.control_points": TOUCHING["discretization.control_points"]}
        alike |= {"cable.linear_density": 0.02, "cable.diameter": THIN}
        found |= {f"cables.{name}.{key}": value for key, value in (alike | own).items()}
    return found


def ends(middle, along, fixed):
    """Both ends of a cable of 0.4 m that is drawn straight by so much."""
    along, middle = np.array(along), np.array(middle)
    places = {"start": middle - 0.2 * along, "end": middle + 0.2 * along}
    places = {f"{end}.position": place.tolist() for end, place in places.items()}
    return places | {"start.fixed": fixed, "end.fixed": fixed}


def crossing(height, fixed, *values, tight=1.0, **more):
    """Two strings that cross at a right angle, the thin one, c, along y and higher by so much."""
    main = ends([0.0] * 3, [tight, 0.0, 0.0], fixed)
    main |= {"cable.diameter": THICK, "cable.linear_density": 0.1}
    other = ends([0.0, 0.0, height], [0.0, tight, 0.0], fixed)
    found = TOUCHING | main | further(c=other, **more)
    return net(WEIGHTLESS, found, *values)


def sagging(sim, name):
    """Sag of the middle of a string between its ends, and the force that it bears there."""
    line = sim.centerline([0.0, 0.2], name)
    sag = abs(line[1, 2] - line[0, 2])
    half = np.hypot(0.202, sag)
    return sag, 2.0 * 2e3 * (half / 0.2 - 1.0) * sag / half


STILL = {"damping.mass": 20.0, "discretization.control_points": 61, "integrator.step": 2e-3}


def test_tight_strands_that_cross_press_as_their_sags_say():
    """Strings of EA = 2 kN, 0.4 m long, 0.404 m between their ends, 28 mm through each other: a sag
    of 14 mm each, 24.8 N along them, and 3.436 N between them."""
    sim = crossing(0.009, FIXED, STILL, {"cables.c.discretization.control_points": 61}, tight=1.01)
    for end in ("c.start", "c.end"):
        move(sim, end, 0.5, velocity=[0.0, 0.0, -0.06])
    assert sim.advance(1.5).status.ok
    force = np.abs(contacts_of(sim.cable)["itself"].forces[:, 2]).sum()
    assert force == pytest.approx(3.436, rel=1e-2)
    for name in ("cable", "c"):
        sag, pressed = sagging(sim, name)
        assert sag == pytest.approx(0.014, rel=1e-2)
        assert pressed == pytest.approx(force, rel=1e-2)
    assert sim.cable.account.crossed == 0.0


def test_a_third_strand_over_two_presses_as_all_sags_say():
    """Along the diagonal, where the others cross; the lowest one bears what both others press."""
    over = ends(
        [0.0, 0.0, 0.016], (np.array([1.0, 1.0, 0.0]) * 1.01 / np.sqrt(2.0)).tolist(), FIXED
    )
    fine = {f"cables.{one}.discretization.control_points": 61 for one in "cd"}
    sim = crossing(0.009, FIXED, STILL, fine, tight=1.01, d=over)
    for end in ("start", "end"):
        move(sim, f"c.{end}", 0.5, velocity=[0.0, 0.0, -0.06])
        move(sim, f"d.{end}", 0.5, velocity=[0.0, 0.0, -0.07])
    assert sim.advance(1.5).status.ok
    main, middle, top = (sagging(sim, name)[1] for name in ("cable", "c", "d"))
    assert middle + top == pytest.approx(main, rel=1e-2) and min(middle, top) > 0.5
    assert sim.cable.account.crossed == 0.0


def throw(sim, **speeds):
    """Start with these velocities [m/s] of the strands."""
    points = sim.cable.points
    rates = np.zeros_like(points)
    for part in sim.model.parts:
        rates[part.here, :3] = speeds.get(part.name, 0.0)
    sim.begin(points, rates)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_strands_thrown_at_each_other_do_not_pass(friction):
    """They keep momentum and energy."""
    values = {"contact.friction": friction, "contact.damping": 0.0, "integrator.step": 5e-4}
    sim = crossing(0.02, LOOSE, values)
    throw(sim, cable=[0.0, 0.3, 0.0], c=[0.0, 0.0, -2.0])
    before, least = momenta(sim)[0], np.inf
    for _ in range(80):
        assert sim.advance_steps(1).status.ok
        least = min(least, nearest(sim.model, sim.cable.points).clearance)
    np.testing.assert_allclose(momenta(sim)[0], before, atol=1e-10 * np.linalg.norm(before))
    assert -0.5 * THIN < least < 0.0
    assert sim.cable.account.crossed == sim.cable.account.pairs_lost == 0.0
    middle = [sim.centerline([0.2], name)[0, 2] for name in ("cable", "c")]
    assert middle[1] - middle[0] > 0.5 * THICK
    assert sim.cable.share_open() < 1e-6


def test_strands_in_line_meet_tip_to_tip():
    """Nothing turns between them, as along one straight cable."""
    stiff = {"cable.bending_stiffness": 0.1, "cables.c.cable.bending_stiffness": 0.1}
    ahead = {
        f"cables.c.{key}": value for key, value in ends([0.43, 0, 0], [1, 0, 0], LOOSE).items()
    }
    sim = crossing(0.0, LOOSE, stiff, ahead, {"contact.damping": 0.0, "integrator.step": 2e-4})
    throw(sim, c=[-2.0, 0.0, 0.0])
    assert sim.advance_steps(200).status.ok
    gap = sim.centerline([0.0], "c")[0] - sim.centerline([0.4])[0]
    assert np.linalg.norm(gap) > 0.4 * (THICK + THIN) and gap[0] > 0.0
    assert sim.velocities[sim.model.parts[1].here, 0].mean() > 0.5
    assert sim.cable.account.crossed == 0.0


def test_strands_do_not_touch_near_their_joint():
    """A thin branch that leaves a thick cable across it touches it only if it does not begin there:
    as a cable of its own, in the same place."""
    branch = {"at": 0.5, "direction": [0.0, 1.0, 0.0], "joint": "hinged", "cable.diameter": THIN}
    main = TOUCHING | ends([0.0] * 3, [1.0, 0.0, 0.0], FIXED) | {"cable.diameter": THICK}
    joined = net(WEIGHTLESS, main, b=branch | {"discretization.control_points": 21})
    beside = net(WEIGHTLESS, main, further(c=ends([0.0, 0.2, 0.0], [0.0, 1.0, 0.0], LOOSE)))
    assert not np.any(joined.cable.strands()[:, 0] < 0.0)
    assert np.any(beside.cable.strands()[:, 0] < -0.9 * THIN)
    places = [nearest(one.cable.model, one.cable.points) for one in (joined, beside)]
    assert places[0].clearance > 0.0 > places[1].clearance


def test_strands_that_pass_through_each_other_are_seen():
    """Without contact between them; a start inside each other is refused where both are held."""
    sim, watch = crossing(0.006, FIXED, {"contact.self_contact": "off"}), Watch()
    watch.look(sim.model, sim.cable.x[:3], 0.5)
    assert "up to 0.001 m deep (at 0.2 m and 0.2 m)" in watch.warning
    held = {"grasps.names": ["g", "h"], "grasps.h.on": "c", "grasps.h.position": [0.0, 0.0, 0.001]}
    with pytest.raises(SceneError, match="begins 0.006 m inside itself, at 0.2 m and 0.2 m, where"):
        crossing(0.001, FIXED, held)


@pytest.mark.parametrize("gap", [0.02, 0.006])
def test_the_nearest_places_of_two_strands_are_found(gap):
    sim = crossing(gap, FIXED, {"contact.self_contact": "off"})
    found = nearest(sim.model, sim.cable.points)
    assert found.clearance == pytest.approx(gap - 0.5 * (THICK + THIN), abs=0.02 * THIN)
    assert found.strands == (0, 1) and found.u == pytest.approx((0.2, 0.2), abs=1e-3)


ALONE = {
    "terms.twist": "bishop",
    "terms.out_of_plane": "on",
    "discretization.control_points": 13,
    "discretization.knots": "uniform",
    "integrator.step": 2e-3,
    "integrator.tolerance": 1e-13,
    "damping.stiffness": 2e-3,
    "damping.mass": 0.5,
    "cable.length": 0.5,
    "cable.axial_stiffness": 2e3,
    "cable.diameter": 0.01,
    "start.clamped": True,
    "end.fixed": FIXED,
    "end.position": [0.42, 0.03, 0.0],
    "initial.shape": "equilibrium",
}
OTHER = {
    "cable.length": 0.8,
    "cable.torsional_stiffness": 0.013,
    "cable.bending_stiffness": 0.02,
    "discretization.control_points": 18,
    "start.clamped": True,
    "start.position": [0.0, 1.0, 0.2],
    "start.tangent": [0.0, 1.0, 0.0],
    "end.fixed": FIXED,
    "end.clamped": True,
    "end.position": [0.1, 1.65, 0.0],
    "end.tangent": [0.0, 0.8, 0.6],
}
GIVING = {"end.clamped": False, "end.tangent_spring": 0.05, "end.roll_spring": 0.01}
BENT = {"cable.rest_curvature": [1.0, 4.0], "cable.rest_twist": [2.0]}
COILED = {"cable.rest_curvature": [-3.0], "cable.rest_twist": [0.0]}
COILED |= {"cable.rest_curvature_axis": [0.0, 0.0, 1.0]}


@pytest.mark.parametrize("held", [{"end.clamped": True}, GIVING], ids=["clamped", "giving"])
@pytest.mark.parametrize("natural", [{}, BENT], ids=["straight", "curved"])
def test_strands_turned_apart_move_as_two_cables(held, natural):
    """From equilibria, as their ends twist them by a turn and move."""
    first, second = WIRE | ALONE | held | natural, WIRE | ALONE | OTHER | (natural and COILED)
    whole = {f"cables.c.{key}": value for key, value in second.items() if key.startswith("cable.")}
    whole |= {f"cables.c.{key}": value for key, value in OTHER.items()}
    sims = [Simulator(scene_of(one)) for one in (first, second)]
    both = net(first, whole, {"cables.names": ["c"]})
    for sim, end in ((sims[0], "end"), (sims[1], "end"), (both, "end"), (both, "c.end")):
        axis = (sim.ends.tangent(end, 0.0) + [0.0, 0.1, -0.2]) * 14.0
        move(sim, end, 0.4, velocity=[-0.2, 0.1, 0.1], angular_velocity=axis)
    starts = [sim.control_points for sim in sims]
    for sim in (*sims, both):
        assert sim.advance(0.3).status.ok
    for sim, start, name in zip(sims, starts, ("cable", "c"), strict=True):
        curve, now = both.strand(name), sim.control_points
        assert np.ptp(now[:, 3]) > 1.0 and np.abs(now - start)[:, :3].max() > 0.02
        np.testing.assert_allclose(curve.control_points, now, rtol=0.0, atol=1e-8)
        u = np.linspace(0.0, sim.scene.cable.length, 30)
        np.testing.assert_allclose(curve.frames(u, 0.3), sim.frames(u), atol=1e-8)
    lost = sum(sim.cable.account.dissipated for sim in sims)
    assert both.cable.account.dissipated == pytest.approx(lost, rel=1e-6)


FALLING = {
    "cable.diameter": 0.01,
    "cable.axial_stiffness": 2e3,
    "damping.mass": 0.2,
    "contact.stiffness": 2e4,
    "integrator.tolerance": 1e-12,
    "integrator.step": 2e-3,
    "discretization.control_points": 13,
    "discretization.knots": "uniform",
    "terms.out_of_plane": "on",
    "obstacles.names": ["floor", "bar", "eye"],
    "obstacles.floor.shape": "plane",
    "obstacles.floor.position": [0.0, 0.0, -0.06],
    "obstacles.bar.shape": "cylinder",
    "obstacles.bar.size": [0.03, 0.03, 0.6],
    "obstacles.bar.orientation": [0.7071067811865476, 0.0, 0.0, 0.7071067811865476],
    "obstacles.bar.position": [0.2, 0.15, -0.03],
    "obstacles.eye.shape": "ring",
    "obstacles.eye.size": [0.05, 0.005, 0.0],
    "obstacles.eye.orientation": [0.0, 0.7071067811865476, 0.0, 0.7071067811865476],
    "obstacles.eye.position": [0.4, 0.0, 0.0],
}


@pytest.mark.parametrize("twist", ["off", "bishop"])
@pytest.mark.parametrize("lands", [0, 1])
@pytest.mark.parametrize("friction, steps", [(0.0, 90), (0.3, 50)])
def test_a_strand_falls_on_obstacles_as_a_cable(lands, friction, steps, twist):
    """Both are of unlike thickness and mass; while the other one falls freely, since steps and
    impulses of both are decided together. The first one also goes through a ring. Where friction
    begins to hold a landing cable, round-off grows."""
    cables = [
        {"cable.length": 0.5, "start.position": [0.0] * 3, "end.position": [0.5, 0.0, 0.0]},
        {
            "cable.length": 0.7,
            "cable.diameter": 0.016,
            "cable.linear_density": 0.3,
            "start.position": [-0.1, 0.3, 0.0],
            "end.position": [0.6, 0.3, 0.0],
        },
    ]
    high = {"start.position": [0.0, 0.0, 9.0], "end.position": [0.7 - 0.2 * lands, 0.0, 9.0]}
    cables[1 - lands] |= high
    base = WIRE | FALLING | {"terms.twist": twist, "contact.friction": friction}
    free = {"start.fixed": LOOSE, "end.fixed": LOOSE}
    alone = Simulator(scene_of(base | free | cables[lands]))
    other = {"discretization.control_points": 13} | free | cables[1]
    other = {f"cables.c.{key}": value for key, value in other.items()}
    pair = net(base, free | cables[0], other, {"cables.names": ["c"]})
    for sim in (alone, pair):
        assert sim.advance_steps(steps).status.ok
    curve = pair.strand(("cable", "c")[lands])
    np.testing.assert_allclose(curve.control_points[:, :3], alone.control_points[:, :3], atol=1e-6)
    touching = 0
    for name in ("floor", "bar", "eye"):
        both, own = pair.contacts[name], alone.contacts[name]
        assert np.all(both.strands == lands)
        touching += len(own.u)
        np.testing.assert_allclose(both.u, own.u, atol=1e-12)
        np.testing.assert_allclose(both.points, own.points, atol=1e-6)
        np.testing.assert_allclose(both.forces, own.forces, atol=1e-3)
        assert both.deepest == pytest.approx(own.deepest, abs=1e-6)
    assert touching > 4
