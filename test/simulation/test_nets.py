"""Nets of cables against known answers: star, T and Y of beams and strings, rings."""

import beams
import numpy as np
import pytest
from nets import STRING, WEIGHTLESS, WIRE, frequencies, net

LENGTH, EI, MU = 0.5, WIRE["cable.bending_stiffness"], WIRE["cable.linear_density"]
FIXED = [True, True, True]
FREE = {"start.fixed": [False] * 3}


def star(arms, points=13):
    """Equal arms, clamped at their far ends, joined rigidly; the main one comes from -x."""
    branches = {}
    for k in range(1, arms):
        angle = np.pi + 2.0 * np.pi * k / arms
        along = [np.cos(angle), np.sin(angle), 0.0]
        branches[f"b{k}"] = {
            "at": 1.0,
            "direction": along,
            "discretization.control_points": points,
            "end.fixed": FIXED,
            "end.clamped": True,
            "end.position": [LENGTH * x for x in along],
            "end.tangent": along,
        }
    main = {
        "cable.length": LENGTH,
        "discretization.control_points": points,
        "start.position": [-LENGTH, 0.0, 0.0],
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [0.0, 0.0, 0.0],
    }
    return net(WEIGHTLESS, main, **branches)


@pytest.mark.parametrize("arms", [3, 4, 5])
def test_a_star_of_clamped_arms(arms):
    """In its plane the node turns with beta L = 3.9266, or rests with 4.7300, arms - 1 times."""
    found = frequencies(star(arms), arms, still=(2, 3))
    expected = [3.9266] + [4.7300] * (arms - 1)
    np.testing.assert_allclose(np.sqrt(found * np.sqrt(MU / EI)) * LENGTH, expected, rtol=1e-3)


def test_a_t_of_beams():
    """A branch from the middle of a beam between two walls: first ten frequencies."""
    branch = {"at": 0.5, "direction": [0.0, 0.0, -1.0], "cable.length": 0.3}
    clamped = {
        "cable.length": 1.0,
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.fixed": FIXED,
        "end.clamped": True,
        "end.tangent": [1.0, 0.0, 0.0],
        "discretization.control_points": 24,
    }
    sim = net(WEIGHTLESS, clamped, b=branch | {"discretization.control_points": 13})
    numbers = MU, WIRE["cable.axial_stiffness"], EI, WIRE["cable.torsional_stiffness"]
    left, middle, right = (np.array([x, 0.0, 0.0]) for x in (0.0, 0.5, 1.0))
    tip = np.array([0.5, 0.0, -0.3])
    parts = [(a, b, *numbers) for a, b in ((left, middle), (middle, right), (middle, tip))]
    expected = beams.frequencies(parts, [left, right], 10)
    np.testing.assert_allclose(frequencies(sim, 10), expected, rtol=1e-3)


def heavy_strings(**more):
    """Ends on a circle of 0.4 m, strings of 0.5 m, 0.5 N/m, hinged where they meet."""
    main = {
        "cable.length": 0.5,
        "cable.linear_density": 0.5 / 9.81,
        "cable.axial_stiffness": 3e3,
        "start.position": [0.4, 0.0, 0.0],
        "end.position": [0.0, 0.0, -0.3],
        "discretization.control_points": 25,
        "initial.shape": "equilibrium",
    }
    branches = {}
    for k in (1, 2):
        angle = 2.0 * np.pi * k / 3.0
        branches[f"b{k}"] = {
            "at": 1.0,
            "joint": "hinged",
            "discretization.control_points": 25,
            "end.fixed": FIXED,
            "end.position": [0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.0],
        }
    return net(STRING, main, more, **branches)


def test_three_heavy_strings_hang_as_catenaries():
    """With 0.3 N where they meet each arm has a horizontal force of 0.2995 N, a sag of 0.2898 m and
    0.4607 N at its far end; it is at rest."""
    sim = heavy_strings(**{"end.mass": 0.3 / 9.81})
    for _ in range(2):
        assert -sim.centerline([0.5])[0, 2] == pytest.approx(0.2898, rel=5e-3)
        for name in ("start", "b1.end", "b2.end"):
            force = sim.reaction(name)[0]
            assert np.linalg.norm(force) == pytest.approx(0.4607, rel=5e-3)
            assert np.linalg.norm(force[:2]) == pytest.approx(0.2995, rel=5e-3)
        assert sim.advance(0.5).status.ok


def test_arms_of_equal_tension_meet_at_120_degrees():
    """Two weightless arms are pulled with 1 N each at 60 degrees to the line of the third one's
    far end, which then pulls as much; all begin elsewhere."""
    main = {
        "cable.length": 0.5,
        "cable.linear_density": 1e-3,
        "end.position": [0.3, 0.4, 0.0],
        "discretization.control_points": 9,
        "initial.shape": "equilibrium",
        "loads.names": ["b1", "b2"],
    }
    branches = {}
    for name, side, along in (("b1", 1.0, [0.0, 1.0, 0.0]), ("b2", -1.0, [1.0, 0.0, 0.0])):
        pull = [0.5, side * np.sqrt(0.75), 0.0]
        signal = {"on": name, "type": "force", "signal": "constant", "force": pull}
        main |= {f"loads.{name}.{key}": value for key, value in signal.items()}
        branches[name] = {"at": 1.0, "joint": "hinged", "direction": along}
    sim = net(STRING, WEIGHTLESS, main, **branches)
    tangents = [sim.centerline([0.5, 0.4], "cable")]
    tangents += [sim.centerline([0.0, 0.1], name) for name in branches]
    away = np.array([(b - a) / np.linalg.norm(b - a) for a, b in tangents])
    angles = np.degrees(np.arccos([away[0] @ away[1], away[1] @ away[2], away[2] @ away[0]]))
    np.testing.assert_allclose(angles, 120.0, rtol=1e-3)
    assert np.linalg.norm(sim.reaction("start")[0]) == pytest.approx(1.0, rel=1e-3)


def ring(points=49, **more):
    """A free ring of 1 m without natural curvature."""
    main = {
        "cable.length": 1.0,
        "end.joined": "cable",
        "end.joined_at": 0.0,
        "discretization.control_points": points,
        "initial.shape": "equilibrium",
    }
    return net(WEIGHTLESS, FREE, main, more)


def test_a_free_ring():
    """It is a circle with the moment 2 pi EI / L; in its plane the frequencies of bending are
    k (k^2 - 1) / sqrt(k^2 + 1) sqrt(EI / mu) (2 pi / L)^2."""
    sim = ring()
    np.testing.assert_allclose(sim.curvature(np.linspace(0.0, 1.0, 9)), 2.0 * np.pi, rtol=3e-3)
    across = int(np.argmin(np.ptp(sim.control_points[:, :3], axis=0)))
    found = frequencies(sim, 10, still=(across,))
    k = np.array([2.0, 3.0, 4.0])
    expected = k * (k**2 - 1.0) / np.sqrt(k**2 + 1.0) * np.sqrt(EI / MU) * (2.0 * np.pi) ** 2
    np.testing.assert_allclose(found[4:], np.repeat(expected, 2), rtol=3e-3)
    assert found[3] < 1e-2 * expected[0]  # it moves freely, and turns inside out


@pytest.mark.parametrize("twist", ["off", "bishop"])
def test_a_cable_cut_in_two_and_joined_moves_as_uncut(twist):
    """To round-off while the bases agree; twist has a kink at the joint, and so another basis."""
    clamped = {"end.fixed": FIXED, "end.clamped": True, "end.tangent": [1.0, 0.0, 0.0]}
    soft = {
        "cable.axial_stiffness": 60.0,
        "cable.length": 1.0,
        "discretization.control_points": 13,
        "discretization.stretch": "sample",
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [1.0, 0.0, 0.0],
        "integrator.step": 2e-3,
        "integrator.tolerance": 1e-13,
        "terms.twist": twist,
        "terms.out_of_plane": "on",
    }
    whole = net(soft, clamped, {"discretization.knots": "uniform", "end.pose_topic": "/end"})
    short = {"cable.length": 0.4, "discretization.control_points": 7, "end.position": [0.4, 0, 0]}
    rest = {"at": 1.0, "cable.length": 0.6, "discretization.control_points": 9}
    rest |= {"end.position": [1.0, 0.0, 0.0], "end.pose_topic": "/end"} | clamped
    cut = net(soft, short, b=rest)
    times, poses = np.linspace(0.0, 0.4, 21), np.zeros((21, 7))
    poses[:, 0], poses[:, 1] = 1.0 - 0.2 * times, 0.2 * times
    turn = (twist == "bishop") * times
    poses[:, 3], poses[:, 6] = np.sin(turn), np.cos(turn)
    for sim, end in ((whole, "end"), (cut, "b.end")):
        assert sim.follow(times, {end: poses}, times[-1:])[0].status.ok
    u = np.linspace(0.0, 0.4, 21)
    apart = [
        np.abs(cut.centerline(u) - whole.centerline(u)).max(),
        np.abs(cut.centerline(1.5 * u, "b") - whole.centerline(0.4 + 1.5 * u)).max(),
    ]
    assert np.abs(whole.centerline(u)[:, 1:]).max() > 0.03
    assert max(apart) < (1e-10 if twist == "off" else 1e-6)
