"""Linear damping inside the implicit step: the matrix of every row, and beta of the twist."""

from __future__ import annotations

from dlo_sim.kernels.banded import multiply, quadratic_form
from dlo_sim.kernels.jit import kernel


@kernel
def friction_beta(friction, tau):
    """beta / tau of the Kelvin-Voigt damping."""
    if friction is not None:
        return friction.stiffness / tau
    return 0.0


@kernel
def friction_force(friction, dx, n, tau, out):
    """out -= C (q1 - q0) / tau of the linear damping, every row."""
    if friction is not None:
        for d in range(dx.shape[0]):
            multiply(friction.viscous[d], n, dx[d], -1.0 / tau, out[d])


@kernel
def friction_stiffness(friction, n, dim, tau, band):
    """Add C / tau to the band matrix."""
    if friction is not None:
        half = 4 * dim - 1
        for d in range(dim):
            for i in range(n):
                r = i * dim + d
                band[r, half] += friction.viscous[d, 0, i] / tau
                for k in range(1, 4):
                    if i + k < n:
                        value = friction.viscous[d, k, i] / tau
                        band[r, half + k * dim] += value
                        band[r + k * dim, half - k * dim] += value


@kernel
def friction_loss(friction, dx, n, row, tau):
    """Energy that the linear damping of one row takes over a step."""
    if friction is not None:
        return quadratic_form(friction.viscous[row], n, dx) / tau
    return 0.0


@kernel
def add_friction_row(friction, dx, n, row, tau, out):
    """out -= C dx / tau of one row."""
    if friction is not None:
        multiply(friction.viscous[row], n, dx, -1.0 / tau, out)


@kernel
def add_friction_band(friction, row, n, tau, band):
    """Add C / tau of one row to its symmetric band."""
    if friction is not None:
        for k in range(4):
            for i in range(n):
                band[k, i] += friction.viscous[row, k, i] / tau
