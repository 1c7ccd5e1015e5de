"""The inextensible cable: where its length is kept, and what that does to frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, quadrature, spectrum
from dlo_sim.kernels import layout
from dlo_sim.kernels.observe import kinetic_energy
from dlo_sim.kernels.rattle import advance_rattle, project
from dlo_sim.kernels.splitting import OK
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.workspace import new_recorder

Array = NDArray[np.float64]
GAUSS_POINTS = 3
MOST_STEPS = 40_000
REST = 1e-7  # of the length, movement between two restarts that counts as rest


def constraint_slopes(knots: Array) -> Array:
    """Points of every constraint: four basis derivatives [1/m] and a weight, shape (n - 1, 3, 5).

    Constraint 0 is at u = 0, the last at u = L, those between are means over a knot span by three
    Gauss points (exact: |r'|^2 is of fourth degree).
    """
    n_spans = len(knots) - 2 * bspline.DEGREE - 1
    length = float(knots[-1])
    rule = quadrature.gauss(n_spans, length, GAUSS_POINTS)
    width = length / n_spans
    u = (np.arange(n_spans)[:, None] + 0.5 * (rule.xi + 1.0)) * width
    result = np.zeros((n_spans + 2, GAUSS_POINTS, 5))
    _, slopes = bspline.active_basis(knots, u.ravel(), 1)
    result[1:-1, :, :4] = slopes.reshape(n_spans, GAUSS_POINTS, 4)
    result[1:-1, :, 4] = rule.weights / width
    _, ends = bspline.active_basis(knots, [0.0, length], 1)
    # Exact zeros at the ends, where only two control points count: round-off there would make a
    # constraint out of nothing at a clamped end.
    ends[np.abs(ends) < 1e-9 * np.abs(ends).max()] = 0.0
    for row, slope in zip((0, -1), ends, strict=True):
        result[row, :, :4] = slope
        result[row, 0, 4] = 1.0
    return result


def new_chain(model: Model) -> layout.Chain:
    """Scratch of the inextensible step. A row reaches four control points and their constraints."""
    dim = len(model.axes)
    n = model.n
    size = n * (dim + 1) + 1
    half = 4 * (dim + 1)
    shape = (dim, model.width)
    points = constraint_slopes(model.knots)
    return layout.Chain(
        gram=np.einsum("jqk,jqm,jq->jkm", points[..., :4], points[..., :4], points[..., 4]),
        band=np.zeros((size, 2 * half + 2)),
        blank=np.zeros((size, 2 * half + 2)),
        rhs=np.zeros(size),
        pull=np.zeros(size),
        multipliers=np.zeros(n - 1),
        start=np.zeros(shape),
        guess=np.zeros(shape),
        change=np.zeros(shape),
    )


def to_rest_length(model: Model, state: layout.State) -> bool:
    """Move a configuration onto the constraints; true if that succeeded."""
    dim = len(model.axes)
    return bool(project(state.position, model.terms.mass, new_chain(model), model.n, dim))


def to_equilibrium(model: Model, state: layout.State, work: layout.Work, step: float) -> bool:
    """Let a configuration on the constraints come to rest; true if it did.

    Steps of RATTLE with kinetic damping: whenever the kinetic energy falls, the velocity is set to
    zero (Cundall's dynamic relaxation), until a restart hardly moves the cable any more.
    """
    chain = new_chain(model)
    recorder = new_recorder(model, np.zeros(0))
    length = float(model.knots[-1])
    dim = len(model.axes)
    peak, still = 0.0, 0
    resting = state.position.copy()
    for _ in range(MOST_STEPS):
        status, _, _ = advance_rattle(
            state, model.terms, work, chain, 0, 1, step, MOST_STEPS, recorder
        )
        if status != OK:
            return False
        kinetic = kinetic_energy(state.w, model.terms.mass, model.n)
        if kinetic < peak:
            state.w[:] = 0.0
            moved = float(np.abs(state.position[:dim] - resting[:dim]).max())
            still = still + 1 if moved < REST * length else 0
            if still >= 3:
                return True
            resting[:] = state.position
            peak = 0.0
        else:
            peak = kinetic
    return False


def largest_constrained_frequency(model: Model, stiffness: Array, position: Array) -> float:
    """Largest natural frequency [rad/s] of motion that keeps the length, by a dense solution.

    Args:
        stiffness: row-stored band matrix of the spatial DOFs (`kernels.matrix`), without
        stretching.
        position: rows of the configuration it belongs to.
    """
    dim, n = len(model.axes), model.n
    free = (model.terms.mass.free[:dim] != 0.0).T.ravel()
    inertia = np.zeros((n * dim, n * dim))
    for d in range(dim):
        inertia[d::dim, d::dim] = mass.dense(model.terms.mass.band[d])
    gradients = np.zeros((n - 1, n * dim))
    for j, points in enumerate(constraint_slopes(model.knots)):
        first = min(max(j - 1, 0), n - 4)
        slopes, weights = points[:, :4], points[:, 4]
        tangents = slopes @ position[:dim, first : first + 4].T
        row = np.einsum("q,qk,qd->kd", weights, slopes, tangents)
        gradients[j, first * dim : (first + 4) * dim] = row.ravel()
    gradients = gradients[:, free]
    gradients = gradients[np.abs(gradients).max(axis=1) > 0.0]
    _, _, vt = np.linalg.svd(gradients)
    basis = vt[len(gradients) :].T
    if basis.shape[1] == 0:
        return 0.0
    k = basis.T @ spectrum.dense(stiffness)[np.ix_(free, free)] @ basis
    m = basis.T @ inertia[np.ix_(free, free)] @ basis
    factor = np.linalg.inv(np.linalg.cholesky(m))
    return float(np.sqrt(max(np.linalg.eigvalsh(factor @ k @ factor.T).max(), 0.0)))
