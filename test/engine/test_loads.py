"""Point loads: forces and moments do the work that they should, at any place and time."""

import numpy as np
import pytest
from cables import BENT, Bench, wild

from dlo_sim.core import bspline

FORCE, MOMENT = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.4])


def loaded(place, force=(0, 0, 0), moment=(0, 0, 0)):
    """A bench with a constant load, and the function that gives the load's forces alone."""
    values = {"loads.tip.position": place, "loads.tip.signal": "constant"}
    zero = Bench(BENT, values, n=9)
    loads = {"loads.tip.force": list(force), "loads.tip.torque": list(moment)}
    bench = Bench(BENT, values, loads, n=9)
    return bench, lambda points: bench.force(points) - zero.force(points)


def spinning(bench, points, place, spin):
    """Velocities of a rigid turn about the load's place, with the twist that turns along."""
    u = [place * bench.scene.cable.length]
    centre = bspline.evaluate(points[:, :3], bench.model.knots, u)[0]
    tangent = bspline.evaluate(points[:, :3], bench.model.knots, u, 1)[0]
    rates = np.zeros((bench.n, 4))
    rates[:, :3] = np.cross(spin, points[:, :3] - centre)
    rates[:, 3] = spin @ tangent / np.linalg.norm(tangent)
    return rates


@pytest.mark.parametrize("place", [0.0, 0.31, 0.5, 1.0])
def test_force_works_on_the_velocity_of_its_place(place):
    bench, load = loaded(place, force=FORCE)
    points = wild(bench)
    rates = np.random.default_rng(4).normal(size=(9, 4))
    velocity = bspline.evaluate(rates[:, :3], bench.model.knots, [place])[0]
    found = load(points)
    assert np.sum(found * rates) == pytest.approx(FORCE @ velocity, rel=1e-10)
    assert np.allclose(found.sum(axis=0)[:3], FORCE, rtol=1e-10)


@pytest.mark.parametrize("place", [0.0, 0.31, 0.5, 1.0])
def test_moment_works_on_a_rigid_turn_and_pushes_nowhere(place):
    bench, load = loaded(place, moment=MOMENT)
    points = wild(bench)
    found = load(points)
    assert np.abs(found.sum(axis=0)[:3]).max() < 1e-10
    for spin in np.eye(3):
        power = np.sum(found * spinning(bench, points, place, spin))
        assert power == pytest.approx(MOMENT @ spin, rel=1e-9)


def test_moment_across_bends_and_along_twists():
    """The tangent at 0.5 decides: the axial part acts on theta alone, the rest on the shape."""
    bench, _ = loaded(0.5)
    points = wild(bench)
    tangent = bspline.evaluate(points[:, :3], bench.model.knots, [0.5], 1)[0]
    tangent /= np.linalg.norm(tangent)
    axial = loaded(0.5, moment=0.3 * tangent)[1](points)
    assert np.abs(axial[:, :3]).max() < 1e-12
    assert axial[:, 3].sum() == pytest.approx(0.3)
    across = loaded(0.5, moment=0.3 * np.cross(tangent, [0.0, 0.0, 1.0]))[1](points)
    assert np.abs(across[:, 3]).max() < 1e-12
    assert np.abs(across[:, :3]).max() > 0.1


def test_a_sine_swings():
    values = {
        "loads.tip.signal": "sine",
        "loads.tip.force": list(FORCE),
        "loads.tip.frequency": 2.0,
    }
    bench = Bench(BENT, values, n=9)
    points = wild(bench)
    rest = bench.force(points, t=0.0)
    for t, share in ((0.125, 1.0), (0.25, 0.0), (0.375, -1.0), (1.03, np.sin(4 * np.pi * 1.03))):
        found = bench.force(points, t=t) - rest
        assert np.allclose(found.sum(axis=0)[:3], share * FORCE, rtol=1e-9, atol=1e-9)
