"""The inextensible cable: where its length is kept, and what that does to frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, spectrum
from dlo_sim.kernels import layout
from dlo_sim.kernels.rattle import project
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.workspace import new_chain

Array = NDArray[np.float64]


def constraint_slopes(knots: Array) -> Array:
    """Derivatives [1/m] of the four basis functions at each constraint point, shape (n - 1, 4).

    The points are u = 0, the middles of the knot spans and u = L.
    """
    n_spans = len(knots) - 2 * bspline.DEGREE - 1
    length = knots[-1]
    middles = (np.arange(n_spans) + 0.5) * length / n_spans
    _, slopes = bspline.active_basis(knots, np.concatenate(([0.0], middles, [length])), 1)
    return slopes


def to_rest_length(model: Model, state: layout.State) -> bool:
    """Move a configuration onto the constraints; true if that succeeded."""
    slopes = constraint_slopes(model.knots)
    dim = len(model.axes)
    return bool(project(state.position, slopes, model.terms.mass, new_chain(model), model.n, dim))


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
    for j, slopes in enumerate(constraint_slopes(model.knots)):
        first = min(max(j - 1, 0), n - 4)
        tangent = position[:dim, first : first + 4] @ slopes
        gradients[j, first * dim : (first + 4) * dim] = np.outer(slopes, tangent).ravel()
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
