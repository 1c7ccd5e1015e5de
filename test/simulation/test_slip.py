"""Bending of a cable whose strands slip (`plasticity`), with implicit methods, a natural curvature
and the material frame."""

import elasticity
import numpy as np
import pytest
from cables import SOFT, simulator
from plasticity import Law

from dlo_sim.core import rotations

EI, NATURAL = 0.02, 1.5
STRANDS = {"plasticity.yield_curvature": 0.8, "plasticity.hardening": 0.4}
BENT = {"cable.rest_curvature": [NATURAL], "cable.rest_curvature_axis": [0.0, 1.0, 0.0]}
# Both keep the natural curvature of a straight clamp; a gripper's roll does not change it.
FRAMES = [{"terms.twist": "off"}, {"terms.twist": "quasistatic"}]
SETTLING = SOFT | {
    "damping.mass": 3.0,
    "gravity": [0.0, 0.0, 0.0],
    "loads.tip.type": "wrench",
    "initial.shape": "equilibrium",
    "integrator.method": "energy_momentum",
    "integrator.step": 0.01,
}
INSIDE = np.linspace(0.2, 0.8, 101)  # away from the ends; a cubic spline ripples about a circle


def curvature_of(sim):
    """Mean curvature [1/m] about y."""
    strain = elasticity.strains(sim.control_points, sim.model.knots, INSIDE)
    return strain.binormal[:, 1].mean()


@pytest.mark.parametrize("frame", FRAMES, ids=["world", "material"])
def test_moment_and_curvature_follow_the_loop_of_masing(frame):
    """There and back: h EI (kappa - kappa0) of the elastic part, and strands that slip."""
    sim = simulator(SETTLING, BENT, STRANDS, frame)
    assert curvature_of(sim) == pytest.approx(NATURAL, rel=5e-3)
    share, slip = STRANDS["plasticity.hardening"], STRANDS["plasticity.yield_curvature"]
    strands = Law((1.0 - share) * EI, slip, 0.0)
    plastic = np.array([NATURAL, 0.0, 0.0])
    lost = 0.0
    for moment in [*np.linspace(0.0, 0.03, 13), *np.linspace(0.03, -0.03, 25)]:
        sim.set_load("tip", torque=(0.0, moment, 0.0))
        for _ in range(4):
            assert sim.advance(1.0).status.ok
        bent, before = curvature_of(sim), plastic[0]
        plastic, _ = strands.flow([bent, 0.0, 0.0], plastic)
        lost += strands.yield_moment * abs(plastic[0] - before)
        expected = share * EI * (bent - NATURAL) + strands.EI * (bent - plastic[0])
        assert expected == pytest.approx(moment, abs=5e-4)
    assert bent < 0.0  # it yielded both ways
    assert sim.plastic_work == pytest.approx(lost, rel=0.1)
    assert sim.energy_error < 1e-4


def test_small_motion_is_stiffer_than_large_motion():
    """The secant stiffness falls from EI to h EI with the amplitude."""
    secants = []
    for moment in (2e-3, 0.03):
        sim = simulator(SETTLING, STRANDS)
        sim.set_load("tip", torque=(0.0, moment, 0.0))
        assert sim.advance(6.0).status.ok
        secants.append(moment / curvature_of(sim))
    assert secants[0] == pytest.approx(EI, rel=0.01)
    share, slip = STRANDS["plasticity.hardening"], STRANDS["plasticity.yield_curvature"]
    bent = (0.03 - (1.0 - share) * EI * slip) / (share * EI)
    assert secants[1] == pytest.approx(0.03 / bent, rel=0.02)


@pytest.mark.parametrize("natural", [{}, BENT], ids=["straight", "bent"])
@pytest.mark.parametrize("frame", FRAMES, ids=["world", "material"])
def test_equilibrium_is_found_with_slip(natural, frame):
    values = {"gravity": [0.0, 0.0, -9.81], "loads.names": [], "loads.tip.type": "none"}
    values = {key: value for key, value in (SETTLING | values).items() if "loads.tip" not in key}
    sim = simulator(values, natural, STRANDS, frame)
    before = sim.control_points
    slipped = sim.cable.plastic[..., :3]
    unslipped = (1.0 - STRANDS["plasticity.hardening"]) * (NATURAL if natural else 0.0)
    assert np.abs(np.linalg.norm(slipped, axis=-1) - unslipped).max() > 0.5
    assert sim.advance(1.0).status.ok
    assert np.abs(sim.control_points - before)[:, :3].max() < 1e-5


def bent_and_let_go(*values):
    """A cable bent to 4 1/m and let go: it keeps a set beyond its natural curvature."""
    sim = simulator(SETTLING, BENT, STRANDS, {"terms.twist": "quasistatic"}, *values)
    for moment in (0.03, 0.0):
        sim.set_load("tip", torque=(0.0, moment, 0.0))
        assert sim.advance(8.0).status.ok
    return sim


def test_strands_keep_their_slip_in_the_material_frame_when_a_gripper_rolls():
    """A bent cable, turned about its clamp by a half turn, keeps its shape in the clamp's frame."""
    sim = bent_and_let_go({"start.pose_topic": "/start"})
    set_ = curvature_of(sim)
    times = np.linspace(sim.time, sim.time + 20.0, 201)
    roll = np.pi * np.clip((times - times[0]) / 10.0, 0.0, 1.0)
    turns = np.stack([rotations.from_rotation_vector([a, 0.0, 0.0]) for a in roll])
    poses = np.hstack([np.zeros((len(times), 3)), turns])
    report, _ = sim.follow(times, {"start": poses}, times[1:])
    assert report.status.ok
    assert curvature_of(sim) == pytest.approx(-set_, rel=0.05)


# Falls from straight; without damping waves along the cable would hide the order.
FALLING = {
    "gravity": [0.0, 0.0, -3.0],
    "initial.shape": "straight",
    "damping.bend": 0.01,
    "damping.stretch": 0.01,
}


def test_slip_converges_with_second_order():
    """Half the step, a quarter of the error."""
    ends = {}
    for step in (8e-3, 4e-3, 2.5e-4):
        sim = simulator(SETTLING, FALLING, BENT, STRANDS, step=step)
        assert sim.advance(0.4).status.ok
        assert sim.energy_error < 1e-4
        assert sim.plastic_work > 1e-3
        ends[step] = sim.control_points
    errors = [np.abs(ends[step] - ends[2.5e-4]).max() for step in (8e-3, 4e-3)]
    assert errors[0] > 3.5 * errors[1]
    assert errors[1] < 1e-4


@pytest.mark.parametrize("frame", FRAMES, ids=["world", "material"])
def test_account_is_closed_while_a_gripper_shakes_the_cable(frame):
    sim = simulator(SETTLING, BENT, STRANDS, frame, {"start.pose_topic": "/start"})
    times = np.linspace(0.0, 2.0, 201)
    sway = 0.1 * np.sin(8.0 * times) * np.minimum(times / 0.5, 1.0)
    turns = [rotations.from_rotation_vector([0.3 * a, 4.0 * a, a]) for a in sway]
    poses = np.hstack([sway[:, None] * [0.2, 1.0, 0.5], np.stack(turns)])
    report, _ = sim.follow(times, {"start": poses}, times[1:])
    assert report.status.ok
    assert sim.plastic_work > 1e-2
    assert sim.energy_error < 1e-5


def test_a_reconfigured_cable_keeps_its_slip():
    sim = bent_and_let_go()
    assert curvature_of(sim) == pytest.approx(2.5, abs=0.1)
    other = sim.reconfigured(sim.scene.with_values({"discretization.control_points": 12}))
    other.advance(4.0)
    assert curvature_of(other) == pytest.approx(2.5, abs=0.1)
    elastic = sim.reconfigured(sim.scene.with_values({"plasticity.yield_curvature": 0.0}))
    elastic.advance(8.0)
    assert curvature_of(elastic) == pytest.approx(NATURAL, rel=0.02)


def test_account_is_closed_after_a_correction_that_bends_the_cable():
    """What slips at once is lost, and is part of the work."""
    sim = simulator(SETTLING, BENT, STRANDS)
    shift = np.zeros((len(sim.control_points), 3))
    shift[:, 2] = 0.2 * sim.greville**2
    sim.correct(shift, 0.0 * shift)
    assert sim.plastic_work > 1e-3
    assert sim.advance(0.1).status.ok
    assert sim.energy_error < 1e-6


@pytest.mark.parametrize("change", [{"plasticity.hardening": 0.2}, {"cable.rest_curvature": [0.0]}])
@pytest.mark.parametrize("strands", [STRANDS, {}], ids=["slipping", "elastic"])
def test_account_is_closed_after_a_change_of_the_strands(strands, change):
    """Slip from the change is before the account opens."""
    sim = simulator(SETTLING, BENT, strands, FALLING)
    sim.advance(0.4)
    other = sim.reconfigured(sim.scene.with_values(STRANDS | change))
    assert other.advance(0.2).status.ok
    assert other.energy_error < 1e-6


def test_a_bent_cable_in_a_jaw_does_not_yield_at_its_natural_curvature():
    """The jaw stiffens its spans; their natural curvature stays free of moment."""
    jaw = {"start.jaw": 0.1, "start.pose_topic": "/start"}
    sim = simulator(SETTLING, BENT, STRANDS, jaw, {"terms.twist": "off"})
    assert sim.model.bending_stiffness.max() > 1.5 * EI
    assert sim.advance(1.0).status.ok
    assert sim.plastic_work < 1e-6


def test_the_implicit_midpoint_rule_converges_to_the_same_motion():
    fine = simulator(SETTLING, FALLING, BENT, STRANDS, step=2.5e-4)
    fine.advance(0.4)
    errors = []
    for step in (8e-3, 4e-3):
        sim = simulator(SETTLING, FALLING, BENT, STRANDS, method="implicit_midpoint", step=step)
        assert sim.advance(0.4).status.ok
        errors.append(np.abs(sim.control_points - fine.control_points).max())
    assert errors[0] > 2.5 * errors[1]
    assert errors[1] < 1e-3
