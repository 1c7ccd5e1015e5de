"""Bends round what a cable is drawn through or over: spans that follow them, and what does else."""

import math
import re

import numpy as np
import pytest

from dlo_sim import Plan, load_scene
from dlo_sim.core import bspline
from dlo_sim.simulation.error_estimate import error_along
from dlo_sim.simulation.simulator import Simulator

POINTS, STIFFNESS = "discretization.control_points", "contact.stiffness"
# A weightless cable along x through an opening without friction; a spring holds the start.
DRAWN = {
    "cable.length": 0.8,
    "cable.diameter": 0.004,
    "cable.linear_density": 0.02,
    "cable.axial_stiffness": 2e4,
    "cable.bending_stiffness": 1e-4,
    "start.position": [-0.4, 0.0, 0.0],
    "start.fixed": [False, True, True],
    "start.spring": [200.0, 0.0, 0.0],
    "end.position": [0.4, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "gravity": [0.0, 0.0, 0.0],
    "damping.mass": 5.0,
    "damping.stiffness": 1e-3,
    "obstacles.names": ["guide"],
    "obstacles.guide.orientation": [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)],
    "obstacles.guide.friction": 0.0,
}
RING = {"obstacles.guide.shape": "ring", "obstacles.guide.size": [0.01, 0.004, 0.0]}
CHANNEL = {"obstacles.guide.shape": "channel", "obstacles.guide.size": [0.01, 0.004, 0.06]}
STIFF = {"cable.axial_stiffness": 2e5, "cable.bending_stiffness": 0.1}
# An elastic band along x in front of a peg.
BAND = {
    "cable.length": 0.1,
    "cable.diameter": 0.002,
    "cable.density": 1100.0,
    "cable.youngs_modulus": 1e6,
    "start.position": [-0.05, 0.0, 0.015],
    "start.fixed": [True] * 3,
    "end.position": [0.05, 0.0, 0.015],
    "end.fixed": [True] * 3,
    "obstacles.names": ["peg"],
    "obstacles.peg.shape": "cylinder",
    "obstacles.peg.size": [0.005, 0.005, 0.03],
    "obstacles.peg.position": [0.0, 0.02, 0.015],
    "obstacles.peg.friction": 0.3,
}
BEHIND_PEG = 0.0165  # y of the axis of a band that touches the peg [m]


def poses(points):
    """Poses at positions (T, 3), not turned."""
    return np.hstack([points, np.tile([0.0, 0.0, 0.0, 1.0], (len(points), 1))])


def round_the_guide():
    """The end goes a quarter round the guide within 1.5 s, then draws the cable on by 0.15 m."""
    s, on = np.linspace(0.0, 1.0, 61), np.linspace(0.0, 0.15, 31)[1:]
    turn = 0.5 * np.pi * s**2 * (3.0 - 2.0 * s)
    arc = 0.4 * np.stack([np.cos(turn), 0.0 * s, -np.sin(turn)], axis=1)
    down = np.stack([0.0 * on, 0.0 * on, -0.4 - on], axis=1)
    times = np.append(1.5 * s, 1.5 + on / 0.1)
    return Plan(times, {"end": poses(np.vstack([arc, down]))})


def past_the_peg(farther=1.0):
    """Both ends go by 0.12 m along y within 0.24 s, or farther and as fast, and rest there."""
    s = np.linspace(0.0, 1.0, 41)
    way = 0.12 * farther * np.append(s, 1.0)
    paths = {
        name: poses(np.stack([0.0 * way + x, way, 0.0 * way + 0.015], axis=1))
        for name, x in (("start", -0.05), ("end", 0.05))
    }
    return Plan(farther * np.append(0.24 * s, 0.74), paths)


def ripple(found):
    """Largest difference of the tensions on both sides of the guide while it is drawn through, as a
    share."""
    before, after = (
        found.tension[found.times > 1.6, int(share * len(found.u))] for share in (0.1, 0.88)
    )
    return np.abs(after / before - 1.0).max()


def cures(lines):
    """Keys and values that warnings name."""
    found = re.findall(
        r"(discretization\.control_points|contact\.stiffness) to ([\d.e+]+\d)", lines
    )
    numbers = {key: max(float(value) for name, value in found if name == key) for key, _ in found}
    return {key: int(value) if key == POINTS else value for key, value in numbers.items()}


@pytest.mark.parametrize(
    ("values", "points", "within"),
    [
        (RING, 250, 0.05),
        (CHANNEL, 250, 0.05),
        (STIFF | RING, 48, 0.03),
        (STIFF | CHANNEL, 93, 0.05),
    ],
    ids=["ring", "channel", "stiff, ring", "stiff, channel"],
)
def test_without_friction_the_tension_is_the_same_on_both_sides(values, points, within):
    """Though no load tells the tension of 20 to 40 N, at which a soft cable bends over 2 mm, and a
    stiff one over 53 mm, where it touches few samples.
    """
    sim = Simulator(load_scene(DRAWN | values))
    assert sim.model.n == points
    assert "the bend round obstacles.guide" in sim.resolution
    found = sim.forecast(round_the_guide())
    assert found.report.status.ok
    assert found.peak_tension > 10.0
    assert ripple(found) < within
    assert found.control_points_needed == 0
    assert points < 250 or found.warnings == ()


def test_a_channel_that_long_spans_cannot_follow_is_told():
    """It holds the direction, so that a stiff cable turns little in a span, and is 30 % off."""
    narrow = {"obstacles.guide.size": [0.006, 0.002, 0.05]}
    scene = load_scene(DRAWN | STIFF | CHANNEL | narrow | {POINTS: 20})
    found = Simulator(scene).forecast(round_the_guide())
    assert ripple(found) > 0.2
    needed = found.control_points_needed
    assert 40 < needed < 60
    cured = Simulator(scene.with_values({POINTS: needed})).forecast(round_the_guide())
    assert cured.control_points_needed == 0
    assert ripple(cured) < 0.1


def test_spans_too_long_for_a_ring_are_told_with_the_number_that_does():
    """By the forecast, by a simulator that was moved so, and by the estimate; one number."""
    scene = load_scene(DRAWN | RING | {POINTS: 30})
    plan = round_the_guide()
    found = Simulator(scene).forecast(plan)
    assert ripple(found) > 0.2
    needed = found.control_points_needed
    assert needed == 253
    told = [line for line in found.warnings if line.startswith("obstacles.guide: ")]
    assert len(told) == 1
    assert f"raise discretization.control_points to {needed}" in told[0]
    driven = Simulator(scene)
    assert driven.control_points_needed == 0
    driven.follow(plan.times, plan.poses, [])
    assert cures("".join(driven.warnings))[POINTS] == driven.control_points_needed == needed
    _, advice = error_along(
        Simulator(scene),
        found.centerline,
        lambda finer: Simulator(finer).forecast(plan).centerline,
        needed,
    )
    assert f"raise discretization.control_points to {needed}" in advice
    cured = Simulator(scene.with_values({POINTS: needed})).forecast(plan)
    assert ripple(cured) < 0.05
    assert cured.control_points_needed == 0
    assert POINTS not in "".join(cured.warnings)


def hindmost(found):
    """Smallest y of a band at the end of its forecast [m]."""
    knots = bspline.clamped_knots(found.control_points.shape[1], 0.1)
    return bspline.evaluate(found.control_points[-1], knots, np.linspace(0.04, 0.06, 101))[
        :, 1
    ].min()


def test_a_band_stays_behind_its_peg():
    """With what is chosen, though stretched to 1.5 times its length, and to 2.3 times."""
    for way in (0.6, 1.0):
        found = Simulator(load_scene(BAND)).forecast(past_the_peg(way))
        assert found.report.status.ok
        assert found.warnings == ()
        assert hindmost(found) == pytest.approx(BEHIND_PEG, abs=0.05 * 0.002)


def test_the_settings_that_a_band_is_told_keep_it_behind_its_peg():
    """One set, the same in each line, that of the estimate included."""
    scene, plan = load_scene(BAND | {POINTS: 13, STIFFNESS: 8.6e6}), past_the_peg()
    begin = Simulator(scene)
    assert not begin.warnings
    first = begin.forecast(plan)
    settings = cures("".join(first.warnings))
    assert settings[POINTS] == first.control_points_needed == 39
    assert settings[STIFFNESS] == pytest.approx(first.contact_stiffness_needed, rel=0.05)

    def along(finer):
        return Simulator(finer).forecast(plan).centerline

    needed = first.control_points_needed, first.contact_stiffness_needed
    _, advice = error_along(begin, first.centerline, along, *needed)
    assert cures(advice)[STIFFNESS] == settings[STIFFNESS]
    settings[POINTS] = max(settings[POINTS], cures(advice)[POINTS])
    cured = Simulator(scene.with_values(settings)).forecast(plan)
    assert cured.report.status.ok
    assert not cured.warnings
    assert hindmost(cured) == pytest.approx(BEHIND_PEG, abs=0.05 * 0.002)


def test_the_stiffness_that_is_told_softens_nothing():
    """The key holds for all obstacles, and that of the smaller peg is larger than one that suffices
    for the other, which alone presses too hard."""
    thick = {"shape": "cylinder", "size": [0.02, 0.02, 0.03], "position": [0.0, 0.0, 0.0]}
    values = {f"obstacles.thick.{key}": value for key, value in thick.items()}
    scene = load_scene(BAND | values | {"obstacles.names": ["peg", "thick"]})
    sim = Simulator(scene)
    assert sim.contact_stiffness_needed == 0.0
    found = sim.contacts
    peg, deep = found["peg"].stiffness, found["thick"]._replace(deepest=1e-4)
    assert deep.stiffness * 1e-4 / 2e-5 < 5.0 * peg
    for depth in (4.1e-5, 1e-3):
        pressed = found | {"thick": deep._replace(deepest=depth)}
        wanted = max(peg, deep.stiffness * depth / 2e-5)
        assert f"contact.stiffness to {wanted:.2g}" in "".join(sim.warnings_with(pressed))
