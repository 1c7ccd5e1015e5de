"""Twist that acts on the shape: its forces in a step, and their Jacobian with shape and twist as
unknowns of one system.
"""

import numpy as np
import pytest
from cables import Bench
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.core import spectrum
from dlo_sim.engine import bishop
from dlo_sim.engine.arrays import BETWEEN, IMPLICIT, MATERIAL, cable_at
from dlo_sim.engine.assembly import discrete_gradient, discrete_jacobian
from dlo_sim.engine.band import clear_band
from dlo_sim.engine.natural_curvature import follow_to_present
from dlo_sim.engine.tension import take_tension

VISCOUS = 0.3
PARTS = slice(0, 3), slice(3, 4)  # shape and twist
CABLE = {
    "cable.length": 1.0,
    "cable.diameter": 0.02,
    "cable.density": 1000.0,
    "cable.youngs_modulus": 1e6,
    "cable.shear_modulus": 2e6,
    "gravity": [0.0, 0.0, 0.0],
    "discretization.control_points": 12,
    "terms.twist": "bishop",
    "terms.stretch": "on",
}
NATURAL = {"cable.rest_curvature": [1.0, 6.0], "cable.rest_curvature_axis": [0.0, 0.8, 0.6]}
TURNED = NATURAL | {"cable.rest_twist": [2.0]}
SLIPS = TURNED | {"plasticity.yield_curvature": 1.0, "plasticity.hardening": 0.2}


@kernel(float64, int64, ARRAY_2D, ARRAY_2D, boolean, ARRAY_2D, family=IMPLICIT | BETWEEN)
def forces_between(address, x0, x1, discrete, out):
    cable = cable_at(address)
    discrete_gradient(cable, grid(x0), grid(x1), grid(x1), 0.0, grid(out))
    return bishop.step_force(cable, grid(x0), grid(x1), VISCOUS, discrete, grid(out))


@kernel(void, int64, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def tangent_between(address, x0, x1):
    cable = cable_at(address)
    clear_band(cable.work.band)
    take_tension(cable, grid(x0), grid(x1))
    discrete_jacobian(cable, grid(x0), grid(x1), 0.0, 0.5 + VISCOUS, 1.0, cable.work.band)


class Twisted(Bench):
    """A bent and twisted cable at the start of a step, and at its end."""

    def __init__(self, values, motion):
        super().__init__(CABLE, values)
        random = np.random.default_rng(1)
        u = self.greville
        points = np.stack([0.3 * np.sin(3.0 * u), 0.3 * np.cos(3.0 * u), 0.4 * u, 5.0 * u], axis=1)
        self.first = points + 0.01 * random.standard_normal(points.shape)
        self.second = self.first + motion * random.standard_normal(points.shape)
        reference = self.cable.arrays.state.reference
        reference[:] = self.padded(np.outer(u, [1.0, 0.0, 0.0, 0.0]))
        self.put(self.first)
        if self.model.has(MATERIAL):
            self.cable.call(follow_to_present)
        reference[:] = self.padded(self.first)
        self.cable.account.slip = 0.5  # as in a step

    def padded(self, points):
        return self.cable.padded(self.model.to_lines(points))

    def between(self, first, second):
        """Force on all lines of the control points, shape (n, lines), and the energy lost."""
        given = [self.padded(points) for points in (first, second)]
        self.cable.x[:] = self.model.to_lines(second)
        out = np.zeros_like(given[0])
        lost = self.cable.call(forces_between, *given, True, out)
        return self.cable.shown(out).T.copy(), lost

    def energy(self, points):
        """Stretching, bending and twisting energy [J]."""
        parts = self.potentials(points)
        return parts["stretch"] + parts["bend"] + parts["twist"]


@pytest.mark.parametrize("values", [{}, NATURAL, TURNED], ids=["straight", "natural", "turned"])
def test_a_step_changes_the_energy_by_the_work_of_its_forces(values):
    """Exactly, for a large motion, less what the internal damping of the twist dissipates."""
    cable = Twisted(values, 0.02)
    force, lost = cable.between(cable.first, cable.second)
    work = (force * (cable.second - cable.first)).sum()
    before, after = cable.energy(cable.first), cable.energy(cable.second)
    assert lost > 0.0
    assert work + lost == pytest.approx(before - after, abs=1e-11 * after)


KINDS = {"straight": {}, "natural": NATURAL, "turned": TURNED, "slips": SLIPS}


@pytest.mark.parametrize("values", KINDS.values(), ids=KINDS)
def test_its_jacobian_is_that_of_the_forces(values):
    """Of all lines by all lines, where the step is short: it is of first order in the step."""
    errors = []
    for motion in (1e-6, 2e-4):
        cable = Twisted(values, motion)
        cable.between(cable.first, cable.second)
        ends = cable.padded(cable.first), cable.padded(cable.second)
        cable.cable.call(tangent_between, *ends)
        lines = cable.model.lines
        found = spectrum.dense(cable.cable.band, 4 * lines - 1)
        exact, size = np.zeros_like(found), 1e-6
        for column in range(len(found)):
            moved = np.zeros((cable.n, 4))
            moved.flat[column] = size
            ahead, behind = (
                cable.between(cable.first, cable.second + sign * moved)[0] for sign in (1.0, -1.0)
            )
            exact[:, column] = -(ahead - behind).ravel() / (2.0 * size)
        for rows, columns in np.ndindex(2, 2):
            parts = [
                one.reshape(cable.n, 4, cable.n, 4)[:, PARTS[rows], :, PARTS[columns]]
                for one in (found, exact)
            ]
            errors.append(np.abs(parts[0] - parts[1]).max() / np.abs(parts[1]).max())
    assert max(errors[:4]) < 2e-4, errors
    assert max(errors[4:]) < 0.02, errors
