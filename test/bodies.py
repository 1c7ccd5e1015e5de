"""Rigid bodies in the arrays of a cable whose own spans are void, built by hand."""

from dataclasses import dataclass, replace

import numpy as np
from cables import scene_of

from dlo_sim.core import mass
from dlo_sim.core.methods import METHODS
from dlo_sim.engine import arrays as bits
from dlo_sim.engine.arrays import CableArrays
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.geometry import geometries_of
from dlo_sim.simulation.stepper import Stepper

FREE = {
    "gravity": [0.0, 0.0, 0.0],
    "start.fixed": [False] * 3,
    "start.clamped": False,
    "end.fixed": [False] * 3,
    "terms.out_of_plane": "on",
}


@dataclass(frozen=True)
class Body:
    """A body at control points: origin, then the ends of the directors.

    Attributes:
        points, lengths, stiffness: of `engine.arrays.Bodies`; idle: those of no strand.
        mass [kg], center [m], moments [kg m^2] about the centre along the directors.
    """

    points: tuple[int, int, int, int]
    lengths: tuple[float, float, float]
    stiffness: float = 1e3
    mass: float = 0.1
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moments: tuple[float, float, float] = (2e-4, 3e-4, 4e-4)
    idle: tuple[int, int, int, int] = (1, 1, 1, 1)

    @property
    def weights(self):
        """Of the four points in (o, e1, e2, e3), shape (4, 4)."""
        out = np.zeros((4, 4))
        out[0, 0] = 1.0
        for i, length in enumerate(self.lengths):
            out[i + 1, [0, i + 1]] = -1.0 / length, 1.0 / length
        return out

    @property
    def mass_matrix(self):
        """Of the four points, the same for every axis, shape (4, 4)."""
        center, moments = np.array(self.center), np.array(self.moments)
        second = np.diag(0.5 * moments.sum() - moments)
        whole = np.empty((4, 4))
        whole[0, 0], whole[0, 1:] = self.mass, self.mass * center
        whole[1:, 0], whole[1:, 1:] = whole[0, 1:], second + self.mass * np.outer(center, center)
        return self.weights.T @ whole @ self.weights


def with_bodies(model, bodies, terms=0, **more):
    """A model with bodies, which are added to its masses; `more` sizes."""
    sizes = model.arrays.sizes | {"bodies": len(bodies)} | more
    sizes["terms"] |= bits.RIGID | terms
    arrays = CableArrays(sizes, inputs=None, state=None, work=None)
    arrays.axes[:] = model.arrays.axes
    for name in CableArrays.groups:
        if name not in ("bodies", "rolls", "inputs", "state", "work"):
            setattr(arrays, name, getattr(model.arrays, name))
    for k, body in enumerate(bodies):
        arrays.bodies.point[k], arrays.bodies.idle[k] = body.points, body.idle
        arrays.bodies.length[k], arrays.bodies.stiffness[k] = body.lengths, body.stiffness
        add_mass(arrays.linear.mass[0], model.n, body)
    factorize(arrays, model.n)
    return replace(model, arrays=arrays)


def add_mass(seven, n, body):
    """Add the mass of a body to seven diagonals."""
    inside, matrix = without_margins(seven, n), body.mass_matrix
    for a, i in enumerate(body.points):
        for b, j in enumerate(body.points):
            inside[3 + j - i, i] += matrix[a, b]


def factorize(arrays, n):
    """Write the factors of the masses of all lines."""
    for kind in range(1 + (arrays.lines > arrays.dim)):
        seven = without_margins(arrays.linear.mass[kind], n)
        band = np.array([np.append(seven[3 + k, : n - k], np.zeros(k)) for k in range(4)])
        lower, inverse = mass.factorize(band, np.zeros(n, dtype=bool))
        factors = without_margins(arrays.linear.factors[kind], n)
        factors[:] = 0.0
        factors[3] = inverse
        for k in range(1, 4):
            factors[3 - k] = lower[k - 1]
            factors[3 + k, :-k] = lower[k - 1, k:]


def model_of(*values, **more):
    """The model of a scene, which may be changed."""
    scene = scene_of(*values, **more)
    return build_model(scene, needs_of(scene), geometries_of(scene))


class Loose:
    """Bodies alone: the spans of the cable are void, and its other control points particles."""

    def __init__(self, bodies, *values, method="energy_momentum", step=1e-3, n=8, **more):
        model = model_of(FREE, *values, n=n, **more)
        mesh = model.arrays.mesh
        for name in ("slopes", "values", "share", "linear", "guard", "weight"):
            getattr(mesh, name)[:] = 0.0
        for name in ("padding", "slope", "axial", "bending"):
            getattr(mesh, name)[:] = 1.0
        for kind in range(model.arrays.lines - model.arrays.dim + 1):
            inside = without_margins(model.arrays.linear.mass[kind], n)
            inside[:] = 0.0
            inside[3] = 1e-3
        for body in bodies:
            without_margins(model.arrays.linear.mass[0], n)[3, list(body.points)] = 0.0
        self.bodies, self.n = bodies, n
        self.cable = Cable(with_bodies(model, bodies))
        self.stepper = Stepper(self.cable, METHODS[method], step)
        self.steps = 0

    def put(self, points, rates):
        self.cable.put(points, rates)
        self.cable.open_account()

    def advance(self, steps):
        done = self.stepper.advance(self.steps, steps)
        assert done.status.ok and done.steps == steps
        self.steps += steps
        return done

    def directors(self, body=0, points=None):
        """Origin and directors, rows of shape (4, 3)."""
        points = self.cable.points if points is None else points
        return self.bodies[body].weights @ points[list(self.bodies[body].points), :3]

    def momenta(self):
        """Momentum, and angular momentum about the world's origin, of all bodies."""
        points, velocity = self.cable.points[:, :3], self.cable.w[:3].T
        linear, angular = np.zeros(3), np.zeros(3)
        for body in self.bodies:
            own = list(body.points)
            push = body.mass_matrix @ velocity[own]
            linear += push.sum(axis=0)
            angular += np.cross(points[own], push).sum(axis=0)
        return linear, angular
