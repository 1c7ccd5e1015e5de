"""Shapes at rest against beam theory, the elastica, the ring and the elastic catenary."""

from pathlib import Path

import numpy as np
import pytest
from cables import FLAT, SOFT, Bench, simulator, straight
from closed_forms import Rod, cantilever_tip

import dlo_sim
from dlo_sim.core import bspline
from dlo_sim.simulation import statics

EI, EA = 0.05, 2e4  # [N m^2], [N]; length 1 m
BEAM = (
    SOFT
    | FLAT
    | {
        "cable.axial_stiffness": EA,
        "cable.bending_stiffness": EI,
        "initial.shape": "equilibrium",
        "integrator.method": "energy_momentum",
        "loads.tip.signal": "constant",
    }
)


def tip(*values, n):
    """Tip of the relaxed cable, x and z [m]."""
    return simulator(BEAM, *values, n=n).control_points[-1, [0, 2]]


def equilibrium(bench, points):
    """Newton's method on the forces along all motions that what is held leaves free."""
    free, columns = bench.free_motions(0.0), list(bench.model.columns)
    for _ in range(100):
        jacobian = free.T @ bench.stiffness(points, moments=True) @ free
        force = free.T @ bench.force(points)[:, columns].ravel()
        change = (free @ np.linalg.solve(jacobian, force)).reshape(bench.n, -1)
        points = points.copy()
        points[:, columns] += change * min(1.0, 0.05 / np.abs(change).max())
        if np.abs(change).max() < 1e-11:
            return points
    raise AssertionError("no equilibrium")


def orders(errors):
    """Orders in the span from errors at 2, 4, 8, ... spans."""
    errors = np.abs(errors)
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize("n", [4, 5, 13])
def test_cantilever_with_a_small_tip_load(n):
    """P L^3 / 3 EI: a cubic, so that one span is exact; stiff in tension it would lock."""
    force, soft = 1e-5, {"cable.axial_stiffness": 1.0}
    found = tip(soft, {"loads.tip.force": [0.0, 0.0, force]}, n=n)
    assert found[1] == pytest.approx(force / 3 / EI, rel=2e-6)


def test_cantilever_under_its_own_small_weight():
    """Tip q L^4 / 8 EI, exact in any mesh; the quartic between, q u^2 (6 - 4 u + u^2) / 24 EI, to
    fourth order in the span."""
    soft = {"cable.axial_stiffness": 1.0, "gravity": [0.0, 0.0, -1e-4]}
    u = np.linspace(0.0, 1.0, 41)
    quartic = -1e-5 * u**2 * (6 - 4 * u + u**2) / 24 / EI
    errors = []
    for n in (4, 5, 7, 11):
        line = simulator(BEAM, soft, n=n).centerline(u)[:, 2]
        assert line[-1] == pytest.approx(-1e-5 / 8 / EI, rel=1e-8)
        errors.append(np.abs(line - quartic).max())
    assert np.all(np.abs(orders(np.array(errors)) - 4.0) < 0.2)
    assert errors[0] < 0.03 * abs(quartic[-1])


def test_large_deflection_converges_to_the_elastica():
    """EA L^2 / EI = 2e7, as of a wire: few spans lock in tension, then the error falls fast."""
    load, exact = 4.0, cantilever_tip(Rod(1.0, 1e9, 0.0), 1.0, load=4.0)
    errors = []
    for n in (7, 11, 19, 35):
        values = {"cable.axial_stiffness": 1e6, "loads.tip.force": [0.0, 0.0, 1.0]}
        bench = Bench(BEAM, values, n=n)
        points = straight(bench)
        for share in np.linspace(0.1, 1.0, 10):
            bench.cable.loads[0, 2] = share * load * EI
            points = equilibrium(bench, points)
        errors.append(np.abs(points[-1, [0, 2]] - exact).max())
    assert errors[-1] < 5e-5
    assert min(orders(np.array(errors))[1:]) > 4.0


def test_end_moment_closes_a_ring():
    """M = 2 pi EI / L bends the cable into a circle whose tip meets the clamp.

    Curvature counts per deformed length here and energy per rest length, so that bending stretches
    a little: s = |r'| solves EA (s - 1) = 4 pi^2 EI / s^3, and the closing moment is 2 pi EI / s^2.
    """
    rigidity, s = 1e4, 1.0
    for _ in range(50):
        s = 1.0 + 4 * np.pi**2 * EI / rigidity / s**3
    moment = 2 * np.pi * EI / s**2
    assert moment == pytest.approx(2 * np.pi * EI, rel=5e-4)
    gaps, offs = [], []
    for n in (11, 19, 35):
        values = {"cable.axial_stiffness": rigidity, "loads.tip.torque": [0.0, -moment, 0.0]}
        bench = Bench(BEAM, values, n=n)
        angle = 2 * np.pi * bspline.greville(bench.model.knots)
        circle = np.zeros((n, 4))
        circle[:, 0] = np.sin(angle) / (2 * np.pi)
        circle[:, 2] = (1 - np.cos(angle)) / (2 * np.pi)
        circle[:, :3] = bspline.interpolate(bench.model.knots, circle[:, :3])
        circle[:2] = straight(bench)[:2]
        points = equilibrium(bench, circle)
        gaps.append(np.linalg.norm(points[-1]))
        around = bspline.evaluate(points[:, :3], bench.model.knots, np.linspace(0, 1, 60))
        radii = np.linalg.norm(around[:, [0, 2]] - [0.0, 0.5 * s / np.pi], axis=1)
        offs.append(np.abs(radii - 0.5 * s / np.pi).max())
    assert gaps[-1] < 2e-5
    assert offs[-1] < 2e-5
    assert min(orders(np.array(gaps))) > 3.0


@pytest.mark.parametrize(("curvature", "z"), [(np.pi, -2 / np.pi), (-np.pi, 2 / np.pi)])
def test_naturally_curved_cable_rests_as_a_half_circle(curvature, z):
    """Positive about +y turns the tangent from +x towards -z (right-hand rule), without stress."""
    values = {"cable.rest_curvature": [curvature], "cable.axial_stiffness": 200.0}
    sim = simulator(BEAM, values, n=23)
    assert np.allclose(sim.control_points[-1, [0, 2]], [0.0, z], atol=1e-5)
    # The constant EI kappa^2 L / 2 is left out of the energy.
    assert sim.energy().bend == pytest.approx(-0.5 * EI * np.pi**2, rel=1e-5)


CABLES = sorted((Path(__file__).parents[2] / "config" / "cables").glob("*.yaml"))


@pytest.mark.parametrize("path", CABLES, ids=lambda path: path.stem)
def test_a_recorded_cable_rests_between_its_grippers(path):
    """With slip, natural curvature in the material frame and the twist that it causes: 2e-9 m and
    3e-8 rad."""
    sim = dlo_sim.Simulator(dlo_sim.load_scene(path))
    assert moved_within(sim, 2.0) < 1e-6


def moved_within(sim, duration):
    """Largest movement of a control point [m], or of its twist [rad]."""
    points, moved = sim.control_points, 0.0
    for _ in range(20):
        assert sim.advance(duration / 20).status.ok
        moved = max(moved, np.abs(sim.control_points - points).max())
    return moved


BENT = {
    **{"cable.length": 0.6, "cable.diameter": 0.008, "cable.youngs_modulus": 1e7},
    **{"start.clamped": True, "start.tangent": [1, 0, 0], "end.position": [0.45, 0.0, 0.0]},
    **{"end.fixed": [True] * 3, "end.clamped": True, "end.tangent": [1, 0, 0]},
    **{"cable.shear_modulus": 3.5e6, "initial.shape": "equilibrium", "terms.twist": "bishop"},
}


def test_plastic_flow_that_is_not_found_is_said(monkeypatch):
    """The search with flow is made to fail."""
    relax = statics.relax
    monkeypatch.setattr(
        statics,
        "relax",
        lambda cable, flow=None, rest=1e-10, **_: flow is None and relax(cable, rest=rest),
    )
    yields = {"plasticity.yield_curvature": 0.5, "plasticity.hardening": 0.3, "terms.twist": "off"}
    with pytest.warns(UserWarning, match="plastic flow did not converge; .* plasticity.hardening"):
        dlo_sim.Simulator(dlo_sim.load_scene({**BENT, **yields}))


WIRE = {
    **{"cable.youngs_modulus": 2e11, "cable.shear_modulus": 8e10, "cable.diameter": 0.002},
    **{"cable.rest_curvature": [0.5], "cable.rest_curvature_2": [0.3, -0.5]},
    **{"discretization.control_points": 13, "discretization.knots": "uniform"},
    "terms.twist": "quasistatic",
}


NATURAL = {"cable.rest_curvature": [2.0, -1.0], "cable.rest_curvature_2": [1.0, 2.0]}
BETWEEN = {  # its rows border the matrix
    **{"grasps.names": ["hand"], "grasps.hand.at": 0.43},
    "grasps.hand.position": [0.2, 0.02, -0.05],
}
TURNED = {
    **{"cable.rest_curvature": [0.0], "loads.names": ["turn"], "loads.turn.position": 0.4},
    **{"loads.turn.signal": "constant", "loads.turn.torque": [6e-3, 0.0, 2e-3]},
    **{"cable.youngs_modulus": 2e6, "cable.shear_modulus": 7e5},
}


@pytest.mark.parametrize(
    ("values", "duration", "aside", "angle", "bound"),
    [
        (NATURAL, 1.0, 0.0, 0.0, 1e-6),
        (NATURAL | BETWEEN, 1.0, 0.0, 0.1, 1e-6),
        (WIRE, 0.5, 0.0, 0.0, 1e-6),
        (TURNED, 0.5, 0.02, 0.5, 1e-9),
        (TURNED | {"terms.twist": "quasistatic"}, 0.5, 0.02, 0.5, 1e-9),
    ],
)
def test_shape_and_twist_at_rest_are_found_in_turn(values, duration, aside, angle, bound):
    """Of natural shapes and of moments, each of which acts on the other: the cable stays [m]."""
    sim = dlo_sim.Simulator(dlo_sim.load_scene({**BENT, **values}))
    assert np.abs(sim.control_points[:, 1]).max() >= aside
    assert np.abs(sim.control_points[:, 3]).max() >= angle
    assert moved_within(sim, duration) < bound


def test_a_twist_that_is_not_found_is_said(monkeypatch):
    """The search for it is made to fail."""
    relax = statics.relax
    monkeypatch.setattr(
        statics, "relax", lambda *given, twist=False, **more: not twist and relax(*given, **more)
    )
    with pytest.warns(UserWarning, match="twist .* did not converge; .* check cable.shear_modulus"):
        dlo_sim.Simulator(dlo_sim.load_scene({**BENT, **WIRE}))
