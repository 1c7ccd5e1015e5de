"""Cables that the numerics tests share, their forces as functions of plain arrays, and an
independent program that moves them."""

import warnings

import numpy as np

from dlo_sim.core import bspline, mass, rotations, spectrum
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine.arrays import CURVED, ENERGIES
from dlo_sim.methods import between_steps
from dlo_sim.scene.loading import scene_from_values, scene_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import geometries_of
from dlo_sim.simulation.natural_shape import local_turn, natural_rows, turned_rows, weighted
from dlo_sim.simulation.play import play
from dlo_sim.simulation.simulator import Simulator

# Stretching, bending, gravity and a point load; the start is clamped along x, the end is free.
SOFT = {
    "cable.length": 1.0,
    "cable.diameter": 0.02,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 60.0,
    "cable.bending_stiffness": 0.02,
    "cable.torsional_stiffness": 0.015,
    "discretization.control_points": 8,
    "discretization.stretch": "sample",
    "integrator.tolerance": 1e-10,
    "terms.gravity": "on",
    "terms.twist": "off",
    "start.clamped": True,
    "loads.names": ["tip"],
}
# All that every method knows: both ends driven, the start by a clamp, the end by springs; torques.
FULL = SOFT | {
    "start.pose_topic": "/start_pose",
    "end.pose_topic": "/end_pose",
    "end.spring": [30.0, 20.0, 10.0],
}
CLAMPED = FULL | {  # both ends by clamps, askew
    "end.spring": [0.0, 0.0, 0.0],
    "end.fixed": [True, True, True],
    "end.clamped": True,
    "end.position": [0.8, 0.1, 0.2],
    "start.tangent": [0.6, 0.0, 0.8],
    "end.tangent": [0.0, 0.8, -0.6],
}
NATURAL = {  # that only implicit methods know
    "cable.rest_curvature": [0.5, -1.0, 2.0],
    "cable.rest_curvature_axis": [0.6, 0.0, 0.8],
}
# Twist that is theta' alone, for forces: `Bench` suppresses the torsion of the centerline.
TWISTED = {"terms.twist": "frenet", "torsion.curvature_floor": 1e5}
BENT = FULL | NATURAL | TWISTED
MASS_DAMPED = FULL | {"damping.mass": 0.8}
FULLY_DAMPED = MASS_DAMPED | {"damping.stiffness": 2e-3, "damping.air_drag": 0.05}

# Free along x; friction with what comes below it.
LYING = {
    "cable.length": 0.3,
    "cable.diameter": 0.006,
    "cable.youngs_modulus": 2e6,
    "start.fixed": [False] * 3,
    "end.position": [0.3, 0.0, 0.0],
    "discretization.control_points": 9,
    "damping.mass": 1.0,
    "integrator.step": 5e-3,
    "integrator.method": "energy_momentum",
    "contact.friction": 0.5,
}

# Stretching by its means over spans, of a cable that would lock otherwise.
BY_SPAN = {"discretization.stretch": "span", "cable.axial_stiffness": 3e3}
FLAT = {"gravity": [0.0, 0.0, 0.0]}
FREE = {"start.clamped": False, "start.fixed": [False, False, False]}

# What acts on FULL: a force and a moment that swing, a start that moves and turns, a moving spring.
SINE_LOAD = {
    "loads.tip.signal": "sine",
    "loads.tip.frequency": 7.0,
    "loads.tip.force": [0.3, 0.5, -0.4],
    "loads.tip.torque": [0.02, 0.01, -0.02],
}
MOTIONS = {
    "start": EndMotion.resting([0.0, 0.0, 0.0]).then(
        0.2,
        velocity=[0.1, -0.3, 0.2],
        acceleration=[6.0, 4.0, -8.0],
        angular_velocity=[2.0, 0, 0],
        angular_acceleration=[60.0, 0.0, 0.0],
    ),
    "end": EndMotion.resting([1.0, 0.0, 0.0]).then(
        0.2, velocity=[0.2, 0.1, -0.5], acceleration=[-8.0, 6.0, 12.0]
    ),
}

# Unless a test says otherwise, since it is rarely about what is chosen.
RESOLUTION = {"discretization.control_points": 13, "discretization.knots": "uniform"}


SHORT = {
    "method": "integrator.method",
    "step": "integrator.step",
    "n": "discretization.control_points",
}


def merged(*values, **more):
    """Merged values; of more of them `a__b` stands for the key `a.b`, and n, method and step for
    the number of control points and the integrator's method and step."""
    found: dict[str, object] = {}
    for part in values:
        found |= part
    return found | {SHORT.get(key) or key.replace("__", "."): more[key] for key in more}


def scene_of(*values, **more):
    """A scene of merged values, see `merged`."""
    return scene_from_values(merged(RESOLUTION, *values, **more))


def simulator(*values, **more):
    """A simulator of merged values, see `scene_of`."""
    return Simulator(scene_of(*values, **more))


def solve_held(cable, unknowns, transposed=False):
    """Solve band x = unknowns, or band^T x = unknowns, in place with the constraint rows fixed.

    Returns the number of negative pivots, or -1 if a pivot is not usable. unknowns: shape
    (n lines,), or one row for each right-hand side.
    """
    rows = unknowns.reshape(-1, cable.model.n * cable.model.lines)
    return cable.call(between_steps.solve_held, rows, transposed)


def advance(target, steps):
    """Advance a simulator, alone or with the estimate of its error, which watches it."""
    if isinstance(target, Simulator):
        return target.advance_steps(steps)
    return play(target.simulator, target.simulator.steps + steps, watchers=(target,))


class Bench:
    """Forces, energies and stiffness of a scene at any configuration, without a simulator.

    Configurations are arrays of control points (x, y, z, theta), shape (n, 4).
    """

    def __init__(self, *values, grading=0.0, **more):
        self.scene = scene_of(*values, **more)
        if grading:
            graded = [grading, grading, 0.1 * self.scene.cable.length]
            closer = {"discretization.knots": "graded", "discretization.grading": graded}
            self.scene = self.scene.with_values(closer)
        geometries, needs = geometries_of(self.scene), needs_of(self.scene)
        self.model = build_model(self.scene, needs, geometries)
        if TWISTED.items() <= scene_values(self.scene).items():
            self.model.arrays.physics.torsion_floor = 1e40
        self.cable = Cable(self.model)
        self.n, self.axes = self.model.n, self.model.axes
        self.greville = bspline.greville(self.model.knots)
        self.drive = EndDrive(self.model)
        self.drive.live_in(self.cable.motion)
        for row, load in zip(self.cable.loads, self.scene.loads, strict=False):
            if load.signal != "none":
                row[:6] = [*load.force, *load.torque]
            row[6] = load.frequency if load.signal == "sine" else 0.0
        self.cable.pull(0.0)
        self.cable.point_grasps(0.0)
        if self.model.has(CURVED) and any(self.scene.cable.rest_curvature):
            natural = natural_rows(self.model, np.array([1.0, 0.0, 0.0]))
            rows = weighted(self.model, natural)
            rows = turned_rows(rows, local_turn(np.eye(3), self.model.axes))
            self.cable.natural = rows

    def placed(self, grasp, t):
        """Attachment point and twist angle of a grasp at time t."""
        name = list(self.scene.holders)[grasp]
        return np.append(self.drive.held_at(name, t)[0], self.cable.held_twists(t)[grasp])

    def put(self, points):
        """Make a configuration the present one."""
        self.cable.x[:] = self.model.to_lines(np.asarray(points))

    def potentials(self, points):
        """Energies [J] by term."""
        self.put(points)
        return dict(zip(ENERGIES, self.cable.potentials(), strict=True))

    def potential(self, points):
        """Total potential energy [J]."""
        return sum(self.potentials(points).values())

    def force(self, points, rates=None, t=0.0):
        """Generalised forces on the control points, shape (n, 4)."""
        self.put(points)
        v = None if rates is None else self.model.to_lines(rates)
        return self.model.to_columns(self.cable.forces(t, v), rest=False)

    def stiffness(self, points, moments=False):
        """Hessian of the potential energy in the axes of the scene, shape (n dim, n dim), control
        point by control point; with that of the moments."""
        self.put(points)
        self.cable.stiffness(moments)
        return self.band_of_axes()

    def band_of_axes(self):
        """The band matrix in the working memory in the axes of the scene, as `stiffness`."""
        n, lines, dim = self.n, self.model.lines, len(self.axes)
        full = spectrum.dense(self.cable.band, 4 * lines - 1).reshape(n, lines, n, lines)
        return full[:, :dim, :, :dim].reshape(n * dim, -1)

    def mass(self):
        """Mass matrix over all (n, lines) degrees of freedom, shape (n lines, n lines)."""
        lines = self.model.lines
        full = np.zeros((self.n, lines, self.n, lines))
        for line in range(lines):
            full[:, line, :, line] = mass.dense(self.model.mass(line))
        return full.reshape(self.n * lines, -1)

    def held(self, t):
        """What is held at time t: rows over all (n, lines) degrees of freedom, and their values."""
        rows, values, columns = [], [], list(self.model.columns)
        for row in self.model.holding.rows:
            point, end = self.model.holding.points[row.point], list(self.scene.holders)[row.grasp]
            direction = np.zeros(4)
            if row.line < 0:
                direction[:3] = rotations.rotate(self.drive.orientation(end, t), row.body)
            else:
                direction[columns[row.line]] = 1.0
            along = direction[columns]
            full = np.zeros((self.n, self.model.lines))
            full[point.first : point.first + 4] = np.outer(point.weights, along)
            rows.append(full.ravel())
            place = self.placed(row.grasp, t)[columns]
            values.append(sum(point.weights) * along @ place)
        return np.array(rows), np.array(values)

    def free_motions(self, t):
        """Motions Z of all (n, lines) degrees of freedom that leave what is held at time t at rest,
        with Z^T M Z = 1, shape (n lines, free)."""
        inverse = np.linalg.inv(np.linalg.cholesky(self.mass())).T
        rows, _ = self.held(t)
        if len(rows) == 0:
            return inverse
        return inverse @ np.linalg.svd(rows @ inverse)[2][len(rows) :].T


class Reference:
    """The same equations of motion with Lagrange multipliers, M a = f(q, v, t) + B^T lambda where
    B(t) q = c(t) is held, by scipy's DOP853, for ends that move smoothly from time 0 to `duration`.

    It shares the forces and the ends' placing with the simulator, but neither the way in which
    steps are made nor the treatment of what is held.
    """

    def __init__(self, bench, duration):
        self.bench = bench
        self.inverse = np.linalg.inv(bench.mass())
        self.shape = bench.held(0.0)[0].shape
        # B and c side by side as polynomials of time, with two derivatives
        nodes = np.cos(np.pi * (np.arange(13) + 0.5) / 13)
        held = [bench.held(0.5 * duration * (1.0 + s)) for s in nodes]
        values = np.stack([np.append(rows, places) for rows, places in held])
        fitted = np.polynomial.chebyshev.chebfit(nodes, values, 12)
        self.held = [np.polynomial.chebyshev.chebder(fitted, k) for k in range(3)]
        self.duration = duration

    def rows(self, t, derivative):
        """B and c, or their derivatives, at time t."""
        s = 2.0 * t / self.duration - 1.0
        found = np.polynomial.chebyshev.chebval(s, self.held[derivative])
        found = found * (2.0 / self.duration) ** derivative
        count = int(np.prod(self.shape))
        return found[:count].reshape(self.shape), found[count:]

    def impulse(self, v, wanted, rows):
        """v with what the multipliers add to it for rows . v = wanted."""
        shifts = self.inverse @ rows.T
        return v + shifts @ np.linalg.solve(rows @ shifts, wanted - rows @ v)

    def at_rest(self, q):
        """Velocities (n, lines) that the motion of the ends gives a cable at rest at time 0."""
        (rows, _), (turning, moving) = self.rows(0.0, 0), self.rows(0.0, 1)
        return self.impulse(0.0 * q.ravel(), moving - turning @ q.ravel(), rows).reshape(q.shape)

    def acceleration(self, t, q, v):
        """a(t, q, v), all of shape (n, lines)."""
        bench = self.bench
        bench.cable.pull(t)
        columns = [bench.model.to_columns(x.T, rest=rest) for x, rest in ((q, True), (v, False))]
        force = bench.model.to_lines(bench.force(*columns, t)).T.ravel()
        (rows, _), (turning, _), (more, asked) = (self.rows(t, k) for k in range(3))
        wanted = asked - more @ q.ravel() - 2.0 * turning @ v.ravel()
        return self.impulse(self.inverse @ force, wanted, rows).reshape(q.shape)

    def run(self, q, v, precision):
        """State after the duration; the relative error of every step is below the precision."""
        from scipy.integrate import solve_ivp

        def rate(t, state):
            q, v = state.reshape(start.shape)
            return np.append(v, self.acceleration(t, q, v))

        start = np.array([q, v])
        tolerances = {"rtol": precision, "atol": 1e-2 * precision}
        found = solve_ivp(rate, (0.0, self.duration), start.ravel(), "DOP853", **tolerances)
        return found.y[:, -1].reshape(start.shape)


def wild(bench, seed=0, size=0.05, turn=1.0):
    """A bent, stretched and twisted configuration; the same seed gives the same one."""
    rng = np.random.default_rng(seed)
    points = np.zeros((bench.n, 4))
    points[:, :3] = np.outer(bench.greville, [0.8, 0.0, 0.6])
    points[:, :3] += size * rng.normal(size=(bench.n, 3))
    points[:, 3] = turn * rng.normal(size=bench.n)
    return points


def straight(bench):
    """Unstretched along x."""
    points = np.zeros((bench.n, 4))
    points[:, 0] = bench.greville
    return points


def inflected(bench):
    """An S in the xz plane: the curvature changes sign."""
    points = straight(bench)
    length = bench.scene.cable.length
    points[:, 2] = 0.1 * length * np.sin(2 * np.pi * points[:, 0] / length)
    return points


def set_state(sim, points=None, rates=None):
    """Give a simulator a configuration and velocities, as they are while its ends are at rest."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that what is held was moved back
        sim.start_from(
            sim.control_points if points is None else points,
            sim.velocities if rates is None else rates,
        )


def momenta(sim):
    """Momentum [kg m/s] and angular momentum about the origin [kg m^2/s] of the centerline, with
    the masses at its ends."""
    points, rates = sim.control_points[:, :3], sim.velocities[:, :3]
    impulses = mass.multiply(sim.model.mass(0), rates)
    return impulses.sum(axis=0), np.cross(points, impulses).sum(axis=0)


def rotation(vector):
    """Rotation matrix exp([vector]) by its series-free formula."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def weight(sim):
    """Of the cable [N]."""
    return sim.scene.cable.mu * sim.scene.cable.length * np.linalg.norm(sim.scene.gravity)


def move(sim, end, duration, **rates):
    """Let an end effector or obstacle move from where it is for so long [s], with velocity,
    acceleration, angular_velocity and angular_acceleration; the motion."""
    now = getattr(sim, "simulator", sim).time  # of an error estimate
    position, orientation = sim.end_pose(end)
    motion = EndMotion.resting(position, orientation, now).then(duration, **rates)
    sim.set_motion(end, motion)
    return motion
