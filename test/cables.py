"""Cables that the numerics tests share, and their compiled forces as functions of plain arrays.

Every combination of present terms is compiled once and kept on disk, which takes seconds the first
time. So the tests use two combinations, SOFT and FULL, and reach special cases through values.
"""

import numpy as np

from dlo_sim.core import bspline, mass, spectrum
from dlo_sim.kernels.ends import end_velocities
from dlo_sim.kernels.instant import STIFFNESS_TERMS, instant_force, stiffness_band
from dlo_sim.kernels.jit import entry
from dlo_sim.kernels.observe import potentials
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation import workspace
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import end_geometries
from dlo_sim.simulation.model import build_model
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
    "terms.gravity": "on",
    "terms.twist": "off",
    "start.clamped": True,
    "loads.names": ["tip"],
}
# Everything at once: both ends driven, the start by a clamp, the end by springs; twist and torques.
FULL = SOFT | {
    "terms.twist": "on",
    "cable.rest_curvature": [0.5, -1.0, 2.0],
    "cable.rest_curvature_axis": [0.6, 0.0, 0.8],
    "start.pose_topic": "/start_pose",
    "end.pose_topic": "/end_pose",
    "end.spring": [30.0, 20.0, 10.0],
}
MASS_DAMPED = FULL | {"damping.mass": 0.8}
FULLY_DAMPED = MASS_DAMPED | {"damping.stiffness": 2e-3, "damping.air_drag": 0.05}

# Stretching by its means over spans, of a cable that would lock otherwise.
BY_SPAN = {"discretization.stretch": "span", "cable.axial_stiffness": 3e3}
FLAT = {"gravity": [0.0, 0.0, 0.0]}
FREE = {"start.clamped": False, "start.fixed": [False, False, False]}


@entry
def all_forces(x, v, terms, friction, viscosity, work, solver, t, out):
    """Kernels without a wrapper for Python crash when Python calls them: hence these entries."""
    instant_force(x, v, terms, friction, viscosity, work, solver, t, out)


@entry
def driven_rates(motion, t, n, axes, free, out):
    """Velocities of driven control points."""
    end_velocities(motion, t, n, axes, free, out)


def scene_of(*values, **more):
    """A scene of merged values; method, step and n are short for the integrator's method and step
    and the number of control points."""
    names = {
        "method": "integrator.method",
        "step": "integrator.step",
        "n": "discretization.control_points",
    }
    merged = {}
    for part in values:
        merged |= part
    merged |= {names[key]: value for key, value in more.items()}
    return scene_from_values(merged)


def simulator(*values, **more):
    """A simulator of merged values, see `scene_of`."""
    return Simulator(scene_of(*values, **more))


class Bench:
    """Forces, energies and stiffness of a scene at any configuration, without a simulator.

    Configurations are arrays of control points (x, y, z, theta), shape (n, 4).
    """

    def __init__(self, *values, **more):
        self.scene = scene_of(*values, **more)
        geometries = end_geometries(self.scene)
        self.model = build_model(self.scene, needs_of(self.scene), geometries)
        self.drive = EndDrive(self.scene, geometries)
        self.terms = self.model.terms
        if self.terms.drive is not None:
            shared = self.terms.drive._replace(motion=self.drive.motion)
            self.terms = self.terms._replace(drive=shared)
        self.n = self.model.n
        self.rows = self.model.rows
        self.greville = bspline.greville(self.model.knots)
        self.work = workspace.new_work(self.model)
        self.solver = workspace.new_solver(self.model)
        self.free = self.terms.mass.free.T != 0.0  # (n, rows)

    def pack(self, points):
        """(n, 4) -> what kernels read, (rows, width)."""
        out = np.zeros((self.rows, self.model.width))
        out[:, : self.n] = self.model.to_rows(np.asarray(points))
        return out

    def unpack(self, rows):
        """(rows, width) -> (n, 4), zero where there is no row."""
        return self.model.to_columns(rows, rest=False)

    def potentials(self, points):
        """Stretch, bend, twist, gravity, spring energy [J]."""
        return np.array(potentials(self.pack(points), self.terms, self.work))

    def potential(self, points):
        """Total potential energy [J]."""
        return float(self.potentials(points).sum())

    def force(self, points, rates=None, t=0.0):
        """Generalised forces on the control points, shape (n, 4)."""
        v = np.zeros((self.n, 4)) if rates is None else rates
        out = np.zeros((self.rows, self.model.width))
        all_forces(
            self.pack(points),
            self.pack(v),
            self.terms,
            self.model.friction,
            self.model.viscosity,
            self.work,
            self.solver,
            t,
            out,
        )
        return self.unpack(out)

    def stiffness(self, points):
        """Hessian of the potential energy in x, y, z, shape (3 n, 3 n), control point by point."""
        terms = self.terms.only(*STIFFNESS_TERMS)
        stiffness_band(self.pack(points), terms, self.model.viscosity, self.work, self.solver)
        return spectrum.dense(self.solver.band)

    def mass(self):
        """Mass matrix over all (n, rows) degrees of freedom, shape (n rows, n rows)."""
        full = np.zeros((self.n, self.rows, self.n, self.rows))
        for d in range(self.rows):
            full[:, d, :, d] = mass.dense(self.terms.mass.band[d])
        return full.reshape(self.n * self.rows, -1)


class Reference:
    """The same equations of motion, M a = f(q, v, t) with prescribed ends, by classical RK4.

    It shares forces and the ends' placing with the simulator, but neither the way in which steps
    are made nor the treatment of the prescribed ends.
    """

    def __init__(self, bench):
        self.bench = bench
        self.drive = bench.drive
        self.mask = bench.free.ravel()
        full = bench.mass()
        self.inverse = np.linalg.inv(full[np.ix_(self.mask, self.mask)])
        self.coupling = full[np.ix_(self.mask, ~self.mask)]

    def prescribed(self, q, v, t):
        """Put positions and velocities of driven ends at time t; returns their accelerations."""
        bench, terms = self.bench, self.bench.terms
        self.drive.put(q, t)
        acceleration = np.zeros((bench.n, 4))
        if terms.drive is not None:
            rates = []
            for shift in (0.0, 1e-5, 2e-5):
                rows = bench.pack(v if shift == 0.0 else 0.0 * v)
                motion = self.drive.motion
                driven_rates(motion, t + shift, bench.n, terms.axes, terms.mass.free, rows)
                rates.append(bench.unpack(rows))
            v[:] = rates[0]
            held = ~self.mask.reshape(bench.n, bench.rows)
            one_sided = (4.0 * rates[1] - 3.0 * rates[0] - rates[2]) / 2e-5
            acceleration[:, : bench.rows][held] = one_sided[:, : bench.rows][held]
        if terms.springs is not None:
            for row, end in enumerate(("start", "end")):
                terms.springs.anchor[row] = self.drive.pose(end, t)[0][list(terms.axes)]
        return acceleration

    def at_rest(self, v):
        """Velocities (n, rows) with vanishing momentum of the free control points, ends moving."""
        out = v.ravel().copy()
        out[self.mask] = -self.inverse @ (self.coupling @ out[~self.mask])
        return out.reshape(v.shape)

    def rate(self, t, q, v):
        """(q', v') at time t; q and v are completed in place."""
        bench = self.bench
        acceleration = self.prescribed(q, v, t)[:, : bench.rows].ravel()
        force = bench.force(q, v, t)[:, : bench.rows].ravel()
        acceleration[self.mask] = self.inverse @ (
            force[self.mask] - self.coupling @ acceleration[~self.mask]
        )
        out = np.zeros((bench.n, 4))
        out[:, : bench.rows] = acceleration.reshape(bench.n, bench.rows)
        return v.copy(), out

    def step(self, t, q, v, tau):
        """One RK4 step; returns the new (q, v)."""
        total_q, total_v = np.zeros_like(q), np.zeros_like(v)
        dq, dv = np.zeros_like(q), np.zeros_like(v)
        for node, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            dq, dv = self.rate(t + node * tau, q + node * tau * dq, v + node * tau * dv)
            total_q += weight * dq
            total_v += weight * dv
        q, v = q + tau / 6.0 * total_q, v + tau / 6.0 * total_v
        self.prescribed(q, v, t + tau)
        return q, v

    def run(self, q, v, duration, steps):
        """State after `duration` in `steps` steps from time 0."""
        q, v = q.copy(), v.copy()
        for k in range(steps):
            q, v = self.step(k * duration / steps, q, v, duration / steps)
        return q, v


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
    """Overwrite configuration and velocities of a simulator whose ends are at rest."""
    sim._set(
        sim.control_points if points is None else np.asarray(points),
        sim.velocities if rates is None else np.asarray(rates),
    )
    sim._open_account()


def rotation(vector):
    """Rotation matrix exp([vector]) by its series-free formula."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
