"""Nets that the tests share, and their small motions by dense algebra."""

import numpy as np
import scipy.linalg

from dlo_sim.core import bspline, mass
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator

WIRE = {
    "cable.diameter": 0.005,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 1e4,
    "cable.bending_stiffness": 0.01,
    "cable.torsional_stiffness": 0.008,
    "initial.shape": "straight",
    "accuracy.estimate": "off",
}
WEIGHTLESS = {"gravity": [0.0, 0.0, 0.0]}
STRING = {"cable.bending_stiffness": 1e-6, "terms.twist": "off"}


def net(*values, **branches):
    """A simulator of these values; branches: values of each, without `branches.<name>.`."""
    found = dict(WIRE)
    for part in values:
        found |= part
    if branches:
        found["branches.names"] = list(branches)
    for name, own in branches.items():
        found |= {f"branches.{name}.{key}": value for key, value in own.items()}
    return Simulator(scene_from_values(found))


def system(sim):
    """Stiffness K, mass M and constraint rows B of the unknowns, dense."""
    cable, model = sim.cable, sim.model
    n, lines, dim = model.n, model.lines, len(model.axes)
    band, half, size = cable.stiffness().copy(), 4 * lines - 1, n * lines
    K, M = np.zeros((size, size)), np.zeros((size, size))
    for r in range(size):
        low, high = max(0, r - half), min(size, r + half + 1)
        K[r, low:high] = band[r, low - r + half : high - r + half]
    for line in range(lines):
        M[line::lines, line::lines] = mass.dense(model.mass(line))
    rows = []
    for k, row in enumerate([*model.holding.rows, *model.holding.springs]):
        values, b = model.holding.points[row.point].values(n), np.zeros(size)
        direction = np.eye(lines)[row.line]
        if row.line < 0:
            direction = np.append(cable.arrays.state.direction[k], np.zeros(lines - dim))
        b[:] = np.kron(values, direction)
        if k < len(model.holding.rows):
            rows.append(b)
        elif model.holding.points[row.point].other >= 0:
            K += row.stiffness * np.outer(b, b)
    cable.forces()  # sets the rows of rolls
    work, rolls = cable.arrays.work, cable.arrays.rolls
    for k, body in enumerate(rolls.body):
        b = np.zeros(size)
        first = int(cable.arrays.bodies.point[body].min())
        for w, begin in enumerate((rolls.first[k], first)):
            b[lines * begin : lines * (begin + 4)] += work.roll_condition[k, w]
        if k < rolls.rigid_rolls:
            rows.append(b)
        else:
            K += rolls.stiffness[k] * np.outer(b, b)
    for body, idle in zip(cable.arrays.bodies.point, cable.arrays.bodies.idle, strict=True):
        for point in body[idle == 1] if lines > dim else ():
            rows.append(np.eye(size)[lines * point + dim])
    return 0.5 * (K + K.T), M, np.reshape(rows, (-1, size))


def frequencies(sim, count, still=()):
    """Lowest angular frequencies [rad/s] of the present shape; `still`: lines that do not move."""
    return np.sqrt(np.maximum(second_variation(sim, still), 0.0))[:count]


def second_variation(sim, still=()):
    """Squares of all angular frequencies of the present shape, rising; negative: unstable."""
    K, M, B = system(sim)
    size, lines = len(K), sim.model.lines
    B = np.vstack([B, *(np.eye(size)[line::lines] for line in still)])
    free = scipy.linalg.null_space(B)
    return scipy.linalg.eigh(free.T @ K @ free, free.T @ M @ free, eigvals_only=True)


def momenta(sim):
    """Momentum [kg m/s] and angular momentum [kg m^2/s] about the world's origin."""
    x, v = sim.cable.points[:, :3], sim.velocities[:, :3]
    pushed = mass.multiply(sim.model.mass(0), v)
    return pushed.sum(axis=0), np.cross(x, pushed).sum(axis=0)


def spinning(sim, turning, velocity):
    """Control points, and their velocities in a motion as one body about their mean."""
    points, rates = sim.cable.points, np.zeros_like(sim.cable.points)
    rates[:, :3] = np.cross(turning, points[:, :3] - points[:, :3].mean(axis=0)) + velocity
    for part in sim.model.parts:
        knots, own = part.model.knots, points[part.here, :3]
        column, slopes = bspline.active_basis(knots, bspline.greville(knots), 1)
        tangents = [s @ own[c : c + 4] for c, s in zip(column, slopes, strict=True)]
        if sim.model.twist:
            rates[part.here, 3] = [t @ turning / np.linalg.norm(t) for t in np.array(tangents)]
    return points, rates
