"""What a step preserves: the symplectic form, its damped version, time reversal, stability."""

import numpy as np
import pytest
from cables import (
    FLAT,
    FULL,
    MASS_DAMPED,
    MOTIONS,
    SOFT,
    Bench,
    Reference,
    scene_of,
    set_state,
    simulator,
    straight,
    wild,
)

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.simulation.stepper import Stepper

# Methods whose step depends on the state alone; Zhai's carries an acceleration along.
ONE_STEP = [method for method in METHODS.values() if method.name != "zhai"]
MOVING = MOTIONS["start"]
EXACT = {"integrator.tolerance": 1e-15}
SPEED = 1200.0  # [rad/s], about the largest frequency of the scenes


def by_name(method):
    return method.name


def jacobian(step, state):
    """d step / d state by five-point differences."""
    h = 1e-4
    columns = []
    for unit in np.eye(len(state)):
        near = step(state + h * unit) - step(state - h * unit)
        far = step(state + 2 * h * unit) - step(state - 2 * h * unit)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


def defect(matrix, factor=1.0):
    """Largest entry of J^T W J - factor W with the canonical W = [[0, 1], [-1, 0]]."""
    half = len(matrix) // 2
    form = np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(half))
    return np.abs(matrix.T @ form @ matrix - factor * form).max()


def simulated(scene, method, tau):
    """One step of a method as a map of control points and velocities, while the clamp moves."""
    sim = simulator(scene, EXACT, n=5, method=method, step=tau)
    sim.set_motion("start", MOVING)
    start = sim.snapshot()

    def step(points, rates):
        sim.restore(start)
        set_state(sim, points, rates)
        assert sim.advance_steps(1).status.advanced
        return sim.control_points, sim.velocities

    return step


def measured_defect(step, scene, tau, motion=MOVING, factor=1.0):
    """Defect of a step at a bent, moving state, in canonical coordinates of what is free.

    With the motions Z(t) that are free, Z^T M Z = 1, these are xi = Z^T M q and p = Z^T M v.
    """
    bench = Bench(scene, n=5)
    if motion:
        bench.drive.follow("start", motion)
    inertia, before, after = bench.mass(), bench.free_motions(0.0), bench.free_motions(tau)
    bent = 0.3 * (wild(bench, 1) - wild(bench, 2))[:, :3].ravel()
    rates = 0.5 * np.random.default_rng(4).normal(size=15)

    def flat_step(state):
        moved = [(before @ part).reshape(5, 3) for part in np.split(state, 2)]
        q, v = (np.pad(part, ((0, 0), (0, 1))) for part in (moved[0], moved[1] * SPEED))
        q, v = (part[:, :3].ravel() for part in step(straight(bench) + q, v))
        q, v = after.T @ inertia @ q, after.T @ inertia @ v
        return np.concatenate((q, v / SPEED))

    state = [before.T @ inertia @ part for part in (bent, rates / SPEED)]
    return defect(jacobian(flat_step, np.concatenate(state)), factor)


@pytest.mark.parametrize("share", [0.1, 0.4, 0.8])
@pytest.mark.parametrize("method", ONE_STEP, ids=by_name)
def test_symplectic_form_is_kept_as_declared(method, share):
    """Also while the clamp moves and turns, with springs and weight."""
    share /= max(map(abs, method.substeps))
    tau = share / SPEED
    found = measured_defect(simulated(FULL, method.name, tau), FULL, tau)
    if method.symplectic:
        assert found < 1e-8  # the floor of the differences, at every step
    elif share >= 0.8:
        assert found > (1e-6 if len(method.substeps) == 1 else 3e-8)


def test_runge_kutta_written_out_here_fails_and_more_so_with_the_step():
    """The measurement can see a method that is not symplectic: its defect grows as tau^5."""
    solver = Reference(Bench(FULL, n=5), 1.0)

    def classical(q, v, tau):
        q, v = q[:, :3], v[:, :3]
        total_q, total_v = np.zeros_like(q), np.zeros_like(v)
        dq, dv = np.zeros_like(q), np.zeros_like(v)
        for node, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            now = v + node * tau * dv
            dq, dv = now, solver.acceleration(node * tau, q + node * tau * dq, now)
            total_q += weight * dq
            total_v += weight * dv
        return q + tau / 6.0 * total_q, v + tau / 6.0 * total_v

    found = [
        measured_defect(lambda q, v, tau=tau: classical(q, v, tau), FULL, tau, motion=None)
        for tau in np.array([0.3, 0.6, 1.2]) / SPEED
    ]
    assert found[0] > 3e-9
    assert found[1] > 20 * found[0]
    assert found[2] > 20 * found[1]


@pytest.mark.parametrize("share", [0.2, 0.8])
def test_mass_damping_contracts_the_form_at_its_exact_rate(share):
    """J^T W J = exp(-alpha tau) W for the splitting method, whose damping is an exact flow."""
    scene = MASS_DAMPED | {"damping.mass": 40.0}
    tau = share / SPEED
    step, factor = simulated(scene, "velocity_verlet", tau), np.exp(-40.0 * tau)
    assert measured_defect(step, scene, tau, factor=factor) < 1e-8
    assert measured_defect(step, scene, tau) > 0.5 * (1.0 - factor)


def there_and_back(method, steps=60):
    """Way of a swinging cable and what is left of it after as many steps back; driven clamp."""
    tau = 2e-4
    sim = simulator(FULL, EXACT, n=6, method=method, step=tau)
    sim.set_motion("start", MOVING)
    begin = sim.control_points
    assert sim.advance_steps(steps).status.ok
    far = sim.control_points
    total = steps * tau
    p0, p1, p2 = MOVING.position_coefficients
    w1, w2 = MOVING.rotation_coefficients
    # The same path backwards: p(total - s); the rotation is about one axis, so its vectors add up.
    angle = w1 * total + w2 * total**2
    back = EndMotion(
        start=total,
        duration=1.0,
        position=p0 + p1 * total + p2 * total**2,
        orientation=[np.sin(angle[0] / 2), 0, 0, np.cos(angle[0] / 2)],
        velocity=-p1 - 2 * p2 * total,
        acceleration=2.0 * p2,
        angular_velocity=-w1 - 2 * w2 * total,
        angular_acceleration=2.0 * w2,
    )
    sim.set_motion("start", back)
    sim.cable.put(far, -sim.model.to_columns(sim.cable.w, rest=False))
    sim.cable.open_account()
    assert sim.advance_steps(steps).status.ok
    units = np.array([1, 1, 1, 0.01])
    return np.abs((far - begin) * units).max(), np.abs((sim.control_points - begin) * units).max()


@pytest.mark.parametrize("method", ONE_STEP, ids=by_name)
def test_a_symmetric_method_goes_back_the_way_it_came(method):
    way, left = there_and_back(method.name)
    assert way > 2e-3
    if method.symmetric:
        # explicit: round-off; implicit: what the solver's tolerance leaves in every sub-step
        allowed = 1e-11 * len(method.substeps) if method.family == IMPLICIT else 1e-12
        assert left < allowed * way
    else:
        assert left > 1e-10 * way


def test_zhai_with_one_half_walks_in_the_steps_of_verlet():
    tracks = []
    for method in ("velocity_verlet", "zhai"):
        sim = simulator(FULL, n=6, method=method, step=1e-4)
        sim.set_motion("start", MOVING)
        assert sim.advance_steps(800).status.ok
        tracks.append((sim.control_points, sim.velocities))
    assert np.abs(tracks[0][0] - tracks[1][0]).max() < 1e-12 * np.abs(tracks[0][0]).max()
    assert np.abs(tracks[0][1] - tracks[1][1]).max() > 1e-6  # its velocities are others


def spectral_radius(sim, bench, omega):
    """Of the matrix of one step of small motion about a straight cable at rest."""
    rest, free, inertia = straight(bench), bench.free_motions(0.0), bench.mass()
    half = free.shape[1]

    def full(coordinates):
        return bench.model.to_columns((free @ coordinates).reshape(bench.n, -1).T, rest=False)

    def step(state):
        set_state(sim, rest + full(state[:half]), omega * full(state[half:]))
        sim.advance_steps(1)
        parts = (sim.control_points - rest, sim.velocities / omega)
        flat = [bench.model.to_lines(part).T.ravel() for part in parts]
        return np.concatenate([free.T @ inertia @ part for part in flat])

    h = 1e-6
    columns = [(step(h * unit) - step(-h * unit)) / (2 * h) for unit in np.eye(2 * half)]
    return np.abs(np.linalg.eigvals(np.array(columns).T)).max()


@pytest.mark.parametrize("method", [m for m in ONE_STEP if m.family != IMPLICIT], ids=by_name)
def test_linear_stability_of_the_whole_cable(method, monkeypatch):
    """The recorded limit over the largest frequency is where the spectral radius leaves one.

    Beyond it a simulator takes a step back that begins to grow.
    """
    monkeypatch.setattr(Stepper, "_sane", lambda loop, step: True)
    limit = simulator(SOFT, FLAT, n=5, method=method.name).choice.limit
    bench = Bench(SOFT, FLAT, n=5)
    free = bench.free_motions(0.0)
    omega = np.sqrt(np.linalg.eigvalsh(free.T @ bench.stiffness(straight(bench)) @ free).max())
    assert limit * omega == pytest.approx(method.stability_limit, rel=1e-6)
    radii = []
    for share in (0.5, 0.99, 1.01):
        scene = scene_of(SOFT, FLAT, n=5, method=method.name, step=share * limit)
        sim = Simulator(scene, unchecked_step=True)
        radii.append(spectral_radius(sim, bench, omega))
    assert max(radii[:2]) < 1.0 + 1e-6
    assert radii[2] > 1.02
