"""Static equilibrium of a scene, for its first shape.

The cable descends from its first guess by backward Euler steps of the gradient flow,
    M (q1 - q0) / s = f(q1),
whose pseudo-time s grows as long as Newton's method converges, so that the descent ends in Newton's
method and does not stop at unstable shapes on the way.

A thin cable is up to a billion times stiffer along itself than across. A correction that turns it
stretches it in second order, and the tension which that seems to cause dwarfs all other forces: the
plain Newton method then crawls. So the tension of the tangent matrix is not the one of the present
shape but the one that the linear system itself predicted (the mixed iteration of Magisano, Leonetti
& Garcea 2017, Int. J. Numer. Meth. Eng. 109, 1237-1262): the same equations and the same solution,
found in a handful of iterations whatever the stiffness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass
from dlo_sim.kernels import layout
from dlo_sim.kernels.instant import stiffness_band
from dlo_sim.kernels.static import add_moment_stiffness, solve_held, static_force
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]

MAX_STEPS = 400
MAX_ITERATIONS = 12
TOLERANCE = 1e-10  # of the cable's length, movement of a step that counts as rest
ROUND_OFF = 1e-6  # the same where steps do not shrink any more
PATIENCE = 6  # steps without progress after which they do not
CONVERGED = 1e-4  # last correction of a step, as a share of the step


def relax(model: Model, state: layout.State, work: layout.Work, solver: layout.Solver) -> bool:
    """Move `state` to a nearby stable equilibrium at rest; true if it was reached.

    Damping plays no part, and sine loads are at their value at time zero.
    """
    search = _Search(model, state, work, solver)
    state.w[:] = 0.0
    pseudo = search.first_step()
    least, stuck, ceiling, smooth = np.inf, 0, np.inf, 0
    for _ in range(MAX_STEPS):
        iterations, moved = search.step(pseudo)
        if iterations == 0:
            ceiling, smooth = 0.5 * pseudo, 0
            pseudo *= 0.25
            continue
        if pseudo >= search.patient:
            stuck = 0 if moved < 0.5 * least else stuck + 1
            least = min(least, moved)
            if moved < TOLERANCE or (moved < ROUND_OFF and stuck >= PATIENCE):
                search.relax_twist()
                return True
        pseudo *= 10.0 if iterations <= 4 else 2.0 if iterations <= 7 else 0.7
        smooth += 1
        ceiling *= 1.2**smooth
        pseudo = min(pseudo, ceiling, 1e12 * search.patient)
    return False


class _Search:
    """The spatial rows of one search.

    Attributes:
        patient: pseudo-time [s^2] of steps that see the whole stiffness: the cable falls by many
            times its length meanwhile.
    """

    def __init__(
        self, model: Model, state: layout.State, work: layout.Work, solver: layout.Solver
    ) -> None:
        self._model, self._state, self._work, self._solver = model, state, work, solver
        self._dim = len(model.axes)
        self._length = float(model.knots[-1])
        self._slopes, self._spans = _slopes(model.terms.lattice)
        lattice, stretch, means = model.terms.lattice, model.terms.stretch, model.terms.span_stretch
        self._weights = _flat(lattice.weights)[: len(self._spans)]
        self._xi = _flat(lattice.xi)[: len(self._spans)]
        self._means = means
        if means is not None:
            self._linear = means.linear.reshape(-1, 1)[: len(self._spans)]
        term = stretch if stretch is not None else means
        self._half_stiffness = 0.5 * (term.stiffness if term else 0.0) * self._weights
        self._force = np.zeros_like(state.position)
        self.patient = 0.0

    def first_step(self) -> float:
        """Pseudo-time [s^2] in which the first guess moves by a percent of the length."""
        n, dim = self._model.n, self._dim
        free = self._model.terms.mass.free[:dim]
        static_force(self._state.position, self._model.static_terms, self._work, self._force)
        pull = float(np.abs(self._force[:dim, :n] * free).sum())
        inertia = float(mass.multiply(self._model.terms.mass.band[0], np.ones(n)).sum())
        fall = inertia * self._length / max(pull, 1e-300)
        self.patient = 100.0 * fall
        return 0.01 * fall

    def step(self, pseudo: float) -> tuple[int, float]:
        """One backward Euler step in place; iterations (0: not converged) and the largest move.

        The move is a share of the length.
        """
        n, dim = self._model.n, self._dim
        x = self._state.position
        before = x.copy()
        tangents = self._tangents()
        stress = self._stress(tangents)
        lead = stress
        for iteration in range(1, MAX_ITERATIONS + 1):
            change = self._correction(before, pseudo, lead - stress)
            if change is None:
                break
            x[:dim, :n] += change
            moved = np.abs(x[:dim, :n] - before[:dim, :n]).max()
            largest = np.abs(change).max()
            if not moved < 1e3 * self._length:
                break
            new = self._tangents()
            lead = stress + self._predicted(tangents, new - tangents)
            tangents = new
            stress = self._stress(tangents)
            if largest <= CONVERGED * moved or largest < 1e-12 * self._length:
                return iteration, float(moved / self._length)
        x[:] = before
        return 0, 0.0

    def relax_twist(self) -> None:
        """The twist row is linear: one solution at the shape found.

        Where no end holds the twist there is nothing to solve: the cable keeps the one it has.
        """
        terms, row = self._model.terms, self._model.twist_row
        if terms.twist is None or row is None or terms.mass.free[row].all():
            return
        n = self._model.n
        x = self._state.position
        static_force(x, self._model.static_terms, self._work, self._force)
        free = terms.mass.free[row] != 0.0
        stiffness = mass.dense(terms.twist.stiffness)[np.ix_(free, free)]
        x[row, :n][free] += np.linalg.solve(stiffness, self._force[row, :n][free])

    def _tangents(self) -> Array:
        """r' at the samples of every span, shape (spans, samples, dim)."""
        x = self._state.position[: self._dim]
        return np.einsum("sjk,dsk->sjd", self._slopes, x[:, self._spans])

    def _stress(self, tangents: Array) -> Array:
        """psi = w EA/2 eps / |r'|, half the tension over |r'|, with the strain that counts."""
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        return np.asarray(self._half_stiffness * self._counted(size - 1.0) / size)

    def _predicted(self, tangents: Array, moved: Array) -> Array:
        """Change of psi with that of the tangents, to first order."""
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        strained = np.einsum("sjd,sjd->sj", tangents, moved) / size
        change = self._counted(strained) - self._counted(size - 1.0) * strained / size
        return np.asarray(self._half_stiffness * change / size)

    def _counted(self, strain: Array) -> Array:
        """The strain that counts at the samples: itself or its projection of `span_stretch`."""
        if self._means is None:
            return strain
        share = self._means.share * self._weights
        mean = (share * strain).sum(axis=1, keepdims=True)
        slope = (share * self._xi * strain).sum(axis=1, keepdims=True)
        return np.asarray(mean + self._linear * self._xi * slope)

    def _correction(self, before: Array, pseudo: float, extra: Array) -> Array | None:
        """Newton correction of the free DOFs, shape (dim, n); None where it leads uphill."""
        n, dim = self._model.n, self._dim
        terms, solver = self._model.terms, self._solver
        x = self._state.position
        static_force(x, self._model.static_terms, self._work, self._force)
        stiffness_band(x, self._model.stiffness_terms, self._model.viscosity, self._work, solver)
        if terms.loads is not None and terms.loads.torque.any():
            add_moment_stiffness(x, terms.loads, terms.axes, solver.band)
        band = solver.band
        half = 4 * dim - 1
        blocks = 2.0 * np.einsum("sj,sji,sjk->sik", extra, self._slopes, self._slopes)
        inertia = terms.mass.band[:dim]
        rhs = np.zeros((n, dim))
        for d in range(dim):
            moved = mass.multiply(inertia[d], x[d, :n] - before[d, :n])
            rhs[:, d] = self._force[d, :n] - moved / pseudo
        # Row i dim + d of the matrix belongs to coordinate d of control point i.
        by_point = band[: n * dim].reshape(n, dim, -1)
        for i in range(4):
            for k in range(4):
                by_point[i : i + n - 3, :, half + (k - i) * dim] += blocks[:, i, k, None]
        for k in range(4):
            diagonal = inertia[:, k, : n - k].T / pseudo
            by_point[: n - k, :, half + k * dim] += diagonal
            if k:
                by_point[k:, :, half - k * dim] += diagonal
        free = terms.mass.free[:dim]
        rhs *= free.T
        flat = rhs.ravel()
        solved, negative = solve_held(band, free, flat)
        if not solved or negative or not np.isfinite(flat).all():
            return None
        return flat.reshape(n, dim).T


def _flat(lanes: Array) -> Array:
    """(blocks, m, LANES) -> (blocks LANES, m): one row per span."""
    return np.asarray(lanes.transpose(0, 2, 1).reshape(-1, lanes.shape[1]))


def _slopes(lattice: layout.Lattice) -> tuple[Array, NDArray[np.int64]]:
    """Basis derivatives [1/m] at the samples, shape (spans, m, 4), and each span's control
    points."""
    spans = lattice.n - 3
    xi = _flat(lattice.xi)[:spans, :, None]
    parts = _flat(lattice.extraction)[:spans].reshape(spans, 1, 4, 3)
    slopes = parts[..., 0] + xi * (parts[..., 1] + xi * parts[..., 2])
    return slopes, np.arange(spans)[:, None] + np.arange(4)
