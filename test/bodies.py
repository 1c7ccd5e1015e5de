"""Rigid bodies in the arrays of a cable whose own spans are void, built by hand."""

from dataclasses import dataclass, replace

import numpy as np
from cables import scene_of

from dlo_sim.core import bspline, mass
from dlo_sim.core.methods import METHODS
from dlo_sim.engine import arrays as bits
from dlo_sim.engine.arrays import CableArrays
from dlo_sim.methods import between_steps, relax_step
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.arrays import from_blocks, sizes_of, to_blocks, without_margins
from dlo_sim.simulation.build_model import build_model, fill_rows, held_values
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import geometries_of
from dlo_sim.simulation.holding import Holding, Row
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


def model_of(scene):
    """The model of a scene, which may be changed."""
    return build_model(scene, needs_of(scene), geometries_of(scene))


class Loose:
    """Bodies alone: the spans of the cable are void, and its other control points particles."""

    def __init__(self, bodies, *values, method="energy_momentum", step=1e-3, n=8, **more):
        model = model_of(scene_of(FREE, *values, n=n, **more))
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


@dataclass(frozen=True)
class Roll:
    """A roll row (`engine.arrays.Rolls`); as a rule along the first director of the body."""

    body: int
    first: int
    weights: tuple[float, ...]
    stiffness: float = np.inf
    along: tuple[float, float, float] = (1.0, 0.0, 0.0)
    side: tuple[float, float, float] = (0.0, 1.0, 0.0)


VOID = {"padding": 1.0, "slope": 1.0, "number": -1.0}
VOID |= {"axial": 1.0, "bending": 1.0, "torsional": 1.0}


class Assembly:
    """Strands, bodies and what joins them in one set of arrays.

    Args:
        parts: scenes of strands, or how many loose control points follow. bodies: at the control
            points of all. rolls: rigid ones first. rows: points and lines of further border rows.
    """

    def __init__(self, parts, bodies, rolls, rows=(), method="energy_momentum", step=1e-3):
        models = [part if isinstance(part, int) else model_of(part) for part in parts]
        counts = [one if isinstance(one, int) else one.n for one in models]
        starts = np.cumsum([0, *counts]).tolist()
        strands = [(m, b) for m, b in zip(models, starts, strict=False) if not isinstance(m, int)]
        first, n = strands[0][0], starts[-1]
        holding = self._holding(strands, rows)
        grasps = sum(model.arrays.sizes["grasps"] for model, _ in strands)
        giving = sum(np.isfinite(roll.stiffness) for roll in rolls)
        samples = first.arrays.sizes["samples"]
        terms = first.terms | bits.RIGID | bits.ROLLED | bits.BORDERED
        sizes = sizes_of(
            terms=terms,
            dim=3,
            twist=True,
            n=n,
            samples=samples,
            holding=holding,
            grasps=grasps,
            loads=0,
            obstacles=0,
            pieces=0,
            segments=0,
            bodies=len(bodies),
            strands=len(strands),
            rolls=(len(rolls) - giving, giving),
        )
        arrays = CableArrays(sizes, inputs=None, state=None, work=None)
        arrays.axes[:], arrays.physics = first.arrays.axes, first.arrays.physics
        self.starts, self.models, self.bodies, self.n = starts, models, bodies, n
        self._fill(arrays, strands)
        for k, body in enumerate(bodies):
            arrays.bodies.point[k], arrays.bodies.idle[k] = body.points, body.idle
            arrays.bodies.length[k], arrays.bodies.stiffness[k] = body.lengths, body.stiffness
            add_mass(arrays.linear.mass[0], n, body)
        for k, roll in enumerate(rolls):
            for name in ("body", "first", "weights", "stiffness", "along", "side"):
                getattr(arrays.rolls, name)[k] = getattr(roll, name)
        factorize(arrays, n)
        model = replace(first, arrays=arrays, holding=holding)
        values = held_values(model)
        twisting = [int(point.twist) for point in holding.points]
        shifts = [
            model.mass_solutions(row[None], twist)[0]
            for row, twist in zip(values, twisting, strict=True)
        ]
        fill_rows(model, values, np.reshape(shifts, values.shape))
        self.cable = Cable(model)
        self.cable.motion[:] = np.concatenate([motion_of(m) for m, _ in strands])
        self.cable.pull(0.0)
        self.cable.point_grasps(0.0)
        self.stepper = Stepper(self.cable, METHODS[method], step)
        self.steps = 0

    @staticmethod
    def _holding(strands, rows):
        out, at_points, grasps = Holding(), [], 0
        for model, begin in strands:
            known = len(out.points)
            for point in model.holding.points:
                own = point.own + begin if point.own >= 0 else -1
                out.hold(replace(point, first=point.first + begin, own=own))
            for row in model.holding.rows:
                at_points.append(replace(row, point=row.point + known, grasp=row.grasp + grasps))
            assert not model.holding.border and not model.holding.springs
            grasps += model.arrays.sizes["grasps"]
        between = []
        for point, line in rows:
            between.append(Row(out.hold(point), -1, line))
        out.rows = at_points + between
        return out

    @staticmethod
    def _fill(arrays, strands):
        mesh, linear, n = arrays.mesh, arrays.linear, arrays.n
        for name in mesh.fields:
            if name in ("branch", "strand", "length", "radius"):
                continue
            parts = [from_blocks(getattr(m.arrays.mesh, name), m.n - 3) for m, _ in strands]
            whole = np.full((n - 3, *parts[0].shape[1:]), VOID.get(name, 0.0))
            for k, (part, (_, begin)) in enumerate(zip(parts, strands, strict=True)):
                whole[begin : begin + len(part)] = part + k * (name == "number")
            getattr(mesh, name)[:] = to_blocks(whole, beyond=VOID.get(name, 0.0))
        slopes, held = np.zeros((4, n)), np.ones(n, dtype=bool)
        without_margins(linear.mass[1], n)[3] = 1e-6
        for k, (model, begin) in enumerate(strands):
            here = slice(begin, begin + model.n)
            mesh.branch[here], mesh.strand[k] = k, (begin, begin + model.n)
            mesh.length[k], mesh.radius[k] = model.arrays.mesh.length[0], model.arrays.mesh.radius[0]
            for name in ("mass", "damping", "twist", "weight", "greville"):
                into, of = getattr(linear, name), getattr(model.arrays.linear, name)
                if of.size:
                    without_margins(into, n)[..., here] = without_margins(of, model.n)
            slopes[:, here] = mass.gram(model.knots, 1, model.rule)
            held[begin + 1 : begin + model.n] = False
        lower, inverse = mass.factorize(slopes, held)
        factors = without_margins(linear.frame_factors, n)
        factors[3] = inverse
        for k in range(1, 4):
            factors[3 - k] = lower[k - 1]
            factors[3 + k, :-k] = lower[k - 1, k:]

    def put(self, points, rates=None):
        """Place and start to count the rolls, at the twist angles of their strands."""
        self.cable.put(points, np.zeros_like(points) if rates is None else rates)
        self.count()
        self.cable.open_account()

    def count(self):
        rolls = self.cable.arrays.rolls
        for k, (first, weights) in enumerate(zip(rolls.first, rolls.weights, strict=True)):
            angle = weights @ self.cable.points[first : first + 4, 3]
            self.cable.call(between_steps.count_roll, k, float(angle))

    advance, directors = Loose.advance, Loose.directors


def motion_of(model):
    """Motions of the grasps of a scene at rest."""
    cable = Cable(model)
    EndDrive(model).live_in(cable.motion)
    return cable.motion


def straight(model, begin, along=(1.0, 0.0, 0.0)):
    """Control points of a straight strand without twist, shape (n, 4)."""
    line = np.outer(bspline.greville(model.knots), along) + begin
    return np.column_stack([line, np.zeros(model.n)])


def relaxed(cable, length, twist=False):
    """Bring a cable into the equilibrium near its present shape, which must be stable."""
    begun, pseudo = cable.arrays.state.x.copy(), 1e-3
    given = np.zeros((3, 3)), begun, cable.anchors.copy(), length, twist, False
    for _ in range(60):
        before = cable.state.copy()
        iterations, _ = cable.call(relax_step.relax_step, pseudo, *given)
        if iterations == 0:
            cable.state[:] = before
        pseudo *= 10.0 if iterations else 0.1
    assert pseudo > 1e20
    assert cable.call(relax_step.is_stable, pseudo, *given)
