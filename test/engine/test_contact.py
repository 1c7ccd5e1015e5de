"""The contact force of one step with every shape: account, Jacobian, and no energy from nothing."""

import numpy as np
import pytest
import solids
from cables import FREE, SOFT, Bench
from numba import float64, int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, kernel
from dlo_sim.core import bspline
from dlo_sim.engine import contact, shapes
from dlo_sim.engine.arrays import CONTACT, TOUCHING, cable_at
from dlo_sim.engine.band import clear_band
from dlo_sim.engine.grasps import ACTIVE, DURATION, POSITION, TURN
from dlo_sim.simulation import obstacles
from dlo_sim.simulation.meshes import keep_triangles

TAU = 0.01
MOVING = [0.5, 0.2, 1.0], [0.3, -0.5, 0.2]  # [m/s], [rad/s]
# Each touches some of a cable along x from 0 to 1 m that is 0.02 m thick.
SHAPES = {
    "plane": {"position": [0.0, 0.0, 0.0]},
    "sphere": {"size": [0.2] * 3, "position": [0.5, 0.03, -0.09]},
    "capsule": {"size": [0.1, 0.1, 0.5], "position": [0.5, 0.03, -0.045]},
    "box": {"size": [0.4, 0.2, 0.1], "position": [0.5, 0.03, -0.05]},
    "cylinder": {"size": [0.2, 0.2, 0.3], "position": [0.5, 0.03, -0.09]},
    "ring": {"size": [0.04, 0.02, 0.0], "position": [0.52, 0.022, 0.0]},
    "channel": {"size": [0.04, 0.02, 0.3], "position": [0.52, 0.022, 0.0]},
    "mesh": {"position": [0.5, 0.03, -0.09]},
    "rim": {"size": [0.04, 0.04, 0.1], "position": [0.52, 0.018, -0.056]},
}
ENTRIES = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)  # of `bend` in `shapes.set_measured`
LYING = [0.0, 0.6, 0.0, 0.8]  # its z axis is almost along x


@kernel((float64, float64), int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, terms=CONTACT)
def step_force(address, x0, x1, out):
    cable = cable_at(address)
    contact.begin(cable, 0.0, TAU, 1.0, grid(x0))
    contact.add_force(cable, True, grid(x1), grid(out))
    return cable.work.results.contact_work, cable.work.results.contact_loss


@kernel(void, int64, terms=CONTACT)
def step_tangent(address):
    cable = cable_at(address)
    clear_band(cable.work.band)
    contact.add_tangent(cable, True, 1.0, cable.work.band)


@kernel(void, int64, ARRAY, terms=CONTACT)
def end_step(address, out):
    cable = cable_at(address)
    contact.commit(cable, TAU)
    cable.work.energies[TOUCHING] = 0.0
    contact.energy(cable, cable.state.x, cable.work.energies)
    out[0] = cable.work.energies[TOUCHING]


class Step(Bench):
    """A step from one random configuration to another, with bristles, beside a moving obstacle."""

    def __init__(self, shape, friction, seed=3, motion=0.003):
        values = {f"obstacles.body.{key}": value for key, value in SHAPES[shape].items()}
        if shape in ("capsule", "cylinder", "ring", "channel"):
            values["obstacles.body.orientation"] = LYING
        kind = "cylinder" if shape == "rim" else shape
        if shape == "mesh":
            values["obstacles.body.mesh"] = keep_triangles(solids.sphere(0.1, 12))
            values["obstacles.body.mesh_cells"] = 12
        values |= {"obstacles.names": ["body"], "obstacles.body.shape": kind, "loads.names": []}
        values |= {"obstacles.body.friction": friction, "contact.stiffness": 1e4}
        super().__init__(SOFT | FREE, values, {"terms.out_of_plane": "on"})
        moves = self.cable.obstacles[0]
        moves[ACTIVE], moves[DURATION] = 1.0, 1.0
        moves[POSITION + 3 : POSITION + 6], moves[TURN : TURN + 3] = MOVING
        rng = np.random.default_rng(seed)
        straight = np.zeros((self.n, 4))
        straight[:, 0] = self.greville
        self.first = straight + 0.01 * rng.standard_normal((self.n, 4))
        self.second = self.first + motion * rng.standard_normal((self.n, 4))
        self.bristle = self.cable.arrays.state.bristle
        self.bristle[:] = 0.3 * motion * rng.standard_normal(self.bristle.shape)

    def lines(self, points):
        return self.cable.padded(self.model.to_lines(points))

    def force(self, second):
        out = np.zeros(self.cable.arrays.state.x.shape)
        found = self.cable.call(step_force, self.lines(self.first), self.lines(second), out)
        return self.cable.shown(out), found

    def energy(self, points):
        out = np.zeros(1)
        self.put(points)
        self.cable.call(end_step, out)
        return out[0]


@pytest.mark.parametrize("friction", [0.0, 0.01, 30.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_step_accounts_for_its_energy(shape, friction):
    step = Step(shape, friction)
    step.put(step.first)
    before = step.cable.potentials()[-1]
    force, (worked, lost) = step.force(step.second)
    assert np.abs(force).max() > 0.1
    assert lost > 0.0
    gain = step.energy(step.second) - before
    done = np.sum(force * step.model.to_lines(step.second - step.first))
    scale = max(abs(gain), abs(done), abs(worked), lost)
    assert abs(gain + done + lost - worked) < 1e-12 * scale
    assert np.asarray(step.cable.arrays.work.trial).any() == (friction > 0.0)


@pytest.mark.parametrize("friction", [0.0, 0.01, 30.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_its_jacobian_is_that_of_the_force(shape, friction):
    """But for the change of the normal's directional part, and of the plane of friction: both are
    small with the motion in a step, beside the radius of curvature.
    """
    step = Step(shape, friction, motion=1e-4)
    step.cable.obstacles[0, ACTIVE] = 0.0
    dim = step.cable.arrays.dim
    step.force(step.second)
    step.cable.call(step_tangent)
    found = step.band_of_axes()
    exact, size = np.zeros_like(found), 1e-7
    for column in range(step.n * dim):
        moved = np.zeros((step.n, 4))
        moved[column // dim, column % dim] = size
        ahead, behind = (step.force(step.second + sign * moved)[0] for sign in (1.0, -1.0))
        exact[:, column] = -(ahead - behind).T.ravel() / (2.0 * size)
    close = 0.03 if shape in ("rim", "ring", "channel") and friction else 2e-3
    assert np.abs(found - exact).max() < close * np.abs(exact).max()


@pytest.mark.parametrize("shape", SHAPES)
def test_no_step_puts_energy_in(shape):
    for seed in range(20):
        step = Step(shape, 0.4, seed)
        assert step.force(step.second)[1][1] >= 0.0


def test_what_touches_is_told_sample_by_sample():
    """Also where as many let go as begin to touch."""
    step, numbers = Step("box", 0.3), []
    step.cable.obstacles[0, ACTIVE] = 0.0
    for lowered in (3, 4, 3, None):
        points = np.zeros((step.n, 4))
        points[:, 0], points[:, 2] = step.greville, 0.1
        if lowered is not None:
            points[lowered, 2] -= 0.14
        step.first = points
        step.force(points)
        numbers.append(int(step.cable.arrays.work.touched[0]))
    assert numbers[0] == numbers[2]
    assert len(set(numbers)) == 3


@kernel(void, int64, ARRAY_2D, ARRAY_2D, terms=CONTACT)
def distances(address, points, out):
    y, to = grid(points), grid(out)
    cable, place = cable_at(address), (load(y, 0, 0), load(y, 1, 0), load(y, 2, 0))
    shapes.set_distance(cable, 0, 0, contact.ENDED, place)
    d, n, f, bend = shapes.measured(cable.work.measured[0, 0, contact.ENDED])
    for k, value in enumerate((d, n[0], n[1], n[2], f, *bend)):
        store(to, k, 0, value)


def nearest(shape, y):
    """Distances from a dense sampling of the middle of the wire or wall, or from the sphere whose
    facets the mesh has.
    """
    if shape == "mesh":
        return np.linalg.norm(y, axis=0) - 0.1
    inner, thick, length = SHAPES[shape]["size"]
    half = 0.5 * (length - thick) if shape == "channel" else 0.0
    angle, z = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, 3001), np.linspace(-half, half, 301 if half else 1)
    )
    radius = 0.5 * (inner + thick)
    middle = np.stack([radius * np.cos(angle), radius * np.sin(angle), z]).reshape(3, -1)
    return np.linalg.norm(y[:, :, None] - middle[:, None], axis=0).min(axis=1)


@pytest.mark.parametrize(
    ("shape", "box", "close"),
    [
        ("ring", [0.06, 0.06, 0.02], 1e-5),
        ("channel", [0.06, 0.06, 0.2], 1e-5),
        ("mesh", [0.08, 0.08, 0.08], 2e-3),
    ],
)
def test_the_distance_is_that_of_the_nearest_point(shape, box, close):
    """With its gradient and curvature."""
    step = Step(shape, 0.0)

    def found(y):
        out = np.zeros((11, 8))
        step.cable.call(distances, np.ascontiguousarray(y), out)
        return out

    y = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 8)) * np.array(box)[:, None]
    d, *rest = found(y)
    np.testing.assert_allclose(d, nearest(shape, y), atol=close)
    n, f, bend = np.array(rest[:3]), rest[3], rest[4:]
    size, curved = 1e-6, np.zeros((3, 3, 8))
    for axis in range(3):
        ahead, behind = (found(y + sign * size * np.eye(3)[:, axis:][:, :1]) for sign in (1, -1))
        np.testing.assert_allclose((ahead[0] - behind[0]) / (2.0 * size), n[axis], atol=1e-8)
        curved[:, axis] = (ahead[1:4] - behind[1:4]) / (2.0 * size)
    exact = f * curved + n[:, None] * n[None]
    for entry, (i, j) in zip(bend, ENTRIES, strict=True):
        np.testing.assert_allclose(entry, exact[i, j], rtol=1e-5, atol=1e-7)


def test_weights_integrate_every_basis_function():
    for n in (4, 9, 20):
        knots = bspline.clamped_knots(n, 1.0, bspline.Grading(1.0, 0.0, 0.2))
        for rule in (obstacles.sample_rule(knots, 1), obstacles.sample_rule(knots, 3)):
            assert rule.weights[:, :-1].min() > 0.0
            there = rule.weights > 0.0
            places = rule.places(bspline.breaks(knots))[there]
            assert places[0] == 0.0
            assert places[-1] == pytest.approx(1.0, rel=1e-12)
            exact = (knots[4:] - knots[:-4]) / 4.0
            basis = bspline.evaluate(np.eye(n), knots, places)
            np.testing.assert_allclose(rule.weights[there] @ basis, exact, rtol=1e-9)
