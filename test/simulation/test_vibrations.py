"""Natural frequencies and damping: of the matrices, with their order in the span, and of runs."""

import numpy as np
import pytest
from cables import FLAT, FREE, FULL, SOFT, Bench, set_state, simulator, straight

from dlo_sim.core import bspline, mass

EA, EI, GJ, MU, LENGTH = 60.0, 0.02, 0.015, 0.1, 1.0  # of the scene SOFT
BETAS = (1.87510407, 4.69409113, 7.85475744)  # cos(x) cosh(x) = -1
ZEROS = (2.40482556, 5.52007811, 8.65372791)  # of the Bessel function J0


def modes(bench, axis, points=None):
    """Natural frequencies [rad/s], ascending, and shapes (n, k), of motion along one axis."""
    points = straight(bench) if points is None else points
    n, dim, line = bench.n, len(bench.axes), bench.axes.index(axis)
    stiffness = bench.stiffness(points).reshape(n, dim, n, dim)[:, line, :, line]
    free = bench.free_motions(0.0).reshape(n, bench.model.lines, -1)[:, line]
    basis, sizes, _ = np.linalg.svd(free)
    basis = basis[:, : int((sizes > 1e-9 * sizes[0]).sum())] if len(sizes) else np.eye(n)
    inertia = mass.dense(bench.model.mass(line))
    factor = np.linalg.inv(np.linalg.cholesky(basis.T @ inertia @ basis))
    values, vectors = np.linalg.eigh(factor @ basis.T @ stiffness @ basis @ factor.T)
    return np.sqrt(np.abs(values)), basis @ factor.T @ vectors


def relative_errors(values, exact, axis, counts, mode=0):
    found = [modes(Bench(SOFT, FLAT, values, n=n), axis)[0][mode] for n in counts]
    return np.array(found) / exact - 1.0


def assert_order(errors, order):
    """Rayleigh quotients: from above, and of the order of the energy."""
    assert np.all(errors > 0.0)
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - order) < 0.7)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_cantilever_bending(mode):
    """Clamped-free, (beta_k / L)^2 sqrt(EI / mu), beta_1 L = 1.8751."""
    exact = (BETAS[mode] / LENGTH) ** 2 * np.sqrt(EI / MU)
    errors = relative_errors({}, exact, 2, (7, 11, 19), mode)
    assert_order(errors, 4)
    assert errors[-1] < (2e-7, 8e-6, 6e-5)[mode]


def test_free_bending():
    """No hold at all: two rigid motions, then 4.7300 (cos(x) cosh(x) = 1)."""
    found = modes(Bench(SOFT, FLAT, FREE, n=19), 2)[0]
    assert np.all(found[:2] < 1e-3 * found[2])
    assert found[2] == pytest.approx((4.73004074 / LENGTH) ** 2 * np.sqrt(EI / MU), rel=1e-5)


@pytest.mark.parametrize("mode", [0, 1])
def test_axial_waves(mode):
    """Wave speed sqrt(EA / mu): quarter waves between the held and the free end."""
    values = {"start.clamped": False}
    exact = (mode + 0.5) * np.pi / LENGTH * np.sqrt(EA / MU)
    errors = relative_errors(values, exact, 0, (5, 7, 11), mode)
    assert_order(errors, 6)
    assert errors[-1] < (1e-8, 1e-5)[mode]


def test_torsional_waves():
    """Wave speed sqrt(GJ / I), I = mu D^2 / 8: quarter waves from the clamp to the free end."""
    errors = []
    for n in (5, 7, 11):
        bench = Bench(FULL, FLAT, {"terms.twist": "frenet"}, n=n)
        points = straight(bench)
        stiffness = np.zeros((n, n))
        for i in range(n):
            turned = points.copy()
            turned[i, 3] = 1.0
            stiffness[:, i] = bench.force(points)[:, 3] - bench.force(turned)[:, 3]
        inertia = bench.mass()[3::4, 3::4]
        values = np.linalg.eigvals(np.linalg.solve(inertia[1:, 1:], stiffness[1:, 1:])).real
        exact = 0.5 * np.pi * np.sqrt(GJ / (MU * 0.02**2 / 8))
        errors.append(np.sqrt(values.min()) / exact - 1.0)
    assert_order(np.array(errors), 6)
    assert errors[-1] < 1e-8


def test_hanging_chain():
    """Zeros of J0: omega_k = (j_k / 2) sqrt(g / L) for a chain that hangs from one end."""
    values = {
        "start.clamped": False,
        "end.position": [0.0, 0.0, -1.0],
        "cable.axial_stiffness": 1e6,
        "cable.bending_stiffness": 1e-9,
        "initial.shape": "equilibrium",
    }
    sim = simulator(SOFT, values, n=30, method="energy_momentum")
    found = modes(Bench(SOFT, values, n=30), 0, sim.control_points)[0][:3]
    assert np.allclose(found, 0.5 * np.array(ZEROS) * np.sqrt(9.81 / LENGTH), rtol=1e-4)


# ------------------------------------------------------------------------------------------- runs


def ringing(values, axis, method, step, periods, n=8, scene=SOFT):
    """Frequency [rad/s] and damping ratio of a run that starts in the first mode, and that mode's
    natural frequency."""
    bench = Bench(scene, FLAT, values, n=n)
    if axis == 3:
        omega = 0.5 * np.pi * np.sqrt(GJ / (MU * 0.02**2 / 8))
        knots = bench.model.knots
        wave = np.sin(0.5 * np.pi * bspline.greville(knots))
        shape = bspline.interpolate(knots, wave[:, None])[:, 0]
    else:
        frequencies, shapes = modes(bench, axis)
        omega, shape = frequencies[0], shapes[:, 0]
    sim = simulator(scene, FLAT, values, n=n, method=method, step=step)
    points = sim.control_points
    points[:, axis] += 1e-5 * shape / np.abs(shape).max()
    set_state(sim, points)
    weigh = mass.multiply(mass.gram(bench.model.knots), shape)
    rest = straight(bench)[:, axis]
    times, values = [], []
    for _ in range(int(periods * 2 * np.pi / omega / step / 5)):
        assert sim.advance_steps(5).status.ok
        times.append(sim.time)
        values.append(weigh @ (sim.control_points[:, axis] - rest))
    times, values = np.array(times), np.array(values)
    up = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    share = values[up] / (values[up] - values[up + 1])
    crossings = times[up] + share * (times[up + 1] - times[up])
    frequency = 2 * np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    swings = [np.abs(values[a:b]).max() for a, b in zip(up[:-1], up[1:], strict=True)]
    decay = -np.polyfit(np.arange(len(swings)), np.log(swings), 1)[0] / (2 * np.pi)
    return frequency, decay / np.hypot(1.0, decay), omega


@pytest.mark.parametrize(
    ("axis", "exact"),
    [(2, BETAS[0] ** 2 * np.sqrt(EI / MU)), (0, 0.5 * np.pi * np.sqrt(EA / MU))],
    ids=["bending", "axial"],
)
def test_a_run_rings_at_the_natural_frequency(axis, exact):
    values = {"start.clamped": axis == 2, "terms.out_of_plane": "on"}
    frequency, decay, _ = ringing(values, axis, "velocity_verlet", 2e-4, 5)
    assert frequency == pytest.approx(exact, rel=5e-5)
    assert abs(decay) < 1e-6


def test_a_run_twists_at_the_natural_frequency():
    values = {"end.spring": [1e-12, 0, 0], "terms.twist": "bishop"}
    frequency, decay, exact = ringing(values, 3, "energy_momentum", 4e-5, 6, scene=FULL)
    assert frequency == pytest.approx(exact, rel=5e-5)
    assert abs(decay) < 1e-6


@pytest.mark.parametrize(
    ("values", "method"),
    [
        ({"damping.mass": 0.15}, "velocity_verlet"),
        ({"damping.mass": 0.15, "damping.stiffness": 1e-300}, "energy_momentum"),
        ({"damping.air_drag": 0.015, "damping.stiffness": 1e-300}, "energy_momentum"),
        ({"damping.mass": 1e-300, "damping.stiffness": 0.05}, "energy_momentum"),
        ({"damping.mass": 1e-300, "damping.stiffness": 0.05}, "implicit_midpoint"),
        ({"damping.mass": 0.05, "damping.stiffness": 0.03}, "energy_momentum"),
    ],
    ids=lambda value: (
        value if isinstance(value, str) else "-".join(k for k in value if value[k] > 1e-9)
    ),
)
def test_a_run_decays_at_the_damping_ratio(values, method):
    """alpha / (2 omega) + beta omega / 2; drag c is an alpha of c / mu."""
    alpha = values.get("damping.mass", 0.0) + values.get("damping.air_drag", 0.0) / MU
    values = {"terms.out_of_plane": "on"} | values
    _, found, omega = ringing(values, 2, method, 2e-3, 5)
    exact = 0.5 * (alpha / omega + values.get("damping.stiffness", 0.0) * omega)
    assert exact > 0.03
    assert found == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("thinning", [1.0, 0.03])
def test_damping_that_thins_takes_what_its_formula_says(thinning):
    """A cable that falls from straight: the energy lost is the integral of EI beta kappa'^2 /
    sqrt(1 + (lambda kappa')^2) over cable and time, by the curvature of what was recorded."""
    values = {"damping.bend": 0.2, "damping.thinning": thinning, "loads.names": []}
    sim = simulator(SOFT | {"cable.axial_stiffness": 3e3}, values, n=12, step=1e-3)
    assert sim.method == "energy_momentum"
    energy, shapes, step = sim.energy().total, [], 2e-3
    for _ in range(250):
        shapes.append(sim.control_points[:, :3].copy())
        assert sim.advance(step).status.ok
    shapes.append(sim.control_points[:, :3].copy())
    u = (np.arange(200) + 0.5) / 200 * LENGTH
    first, second = (bspline.evaluate(np.eye(12), sim.model.knots, u, d) @ shapes for d in (1, 2))
    bent = np.cross(first, second)[..., 1] / np.linalg.norm(first, axis=-1) ** 3
    change = np.diff(bent, axis=0) / step
    lost = 0.2 * EI * LENGTH * np.mean(change**2 / np.hypot(1.0, change * thinning), axis=1)
    assert np.abs(change).max() * thinning > 0.1
    assert energy - sim.energy().total == pytest.approx(lost.sum() * step, rel=0.01)
    assert sim.energy_error < 1e-8
