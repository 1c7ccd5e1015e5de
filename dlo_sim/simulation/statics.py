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

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass
from dlo_sim.engine import layout
from dlo_sim.simulation.cable import Cable

Array = NDArray[np.float64]

MAX_STEPS = 400
MAX_ITERATIONS = 12
TOLERANCE = 1e-10  # of the cable's length, movement of a step that counts as rest
ROUND_OFF = 1e-6  # the same where steps do not shrink any more
FAST, SLOW = 0.5, 0.9  # movement that counts as progress, relative to the least so far
PATIENCE = 6  # steps without progress after which they do not
NUDGE = 1e-6  # of the length
CONVERGED = 1e-4  # last correction of a step, as a share of the step


def relax(cable: Cable, after_step: Callable[[], None] | None = None) -> bool:
    """Move a cable to a nearby stable equilibrium at rest; true if it was reached.

    Damping plays no part, and sine loads are at their value at time zero. The twist stays as
    it is: `relax_twist` solves for it. `after_step` may change the natural and plastic curvature
    after each step of the search, which then converges linearly.
    """
    search = _Search(cable)
    cable.w[:] = 0.0
    pseudo = search.first_step()
    least, stuck, ceiling, smooth = np.inf, 0, np.inf, 0
    last_move, nudged = np.inf, False
    progress = SLOW if after_step else FAST
    for _ in range(MAX_STEPS):
        iterations, moved = search.step(pseudo)
        if iterations == 0 and last_move < TOLERANCE and not nudged:
            # At rest, yet not stable: a symmetric shape may be the top of a ridge.
            search.nudge()
            nudged, ceiling, smooth = True, np.inf, 0
            continue
        last_move = moved if iterations else last_move
        if iterations == 0:
            ceiling, smooth = 0.5 * pseudo, 0
            pseudo *= 0.25
            continue
        if after_step:
            after_step()
        if pseudo >= search.patient:
            stuck = 0 if moved < progress * least else stuck + 1
            least = min(least, moved)
            if moved < TOLERANCE or (moved < ROUND_OFF and stuck >= PATIENCE):
                return True
        pseudo *= 10.0 if iterations <= 4 else 2.0 if iterations <= 7 else 0.7
        smooth += 1
        ceiling *= 1.2**smooth
        pseudo = min(pseudo, ceiling, 1e12 * search.patient)
    return False


def relax_twist(cable: Cable) -> bool:
    """One linear solution for the twist line at the present shape; false where nothing holds the
    twist: the cable keeps the one it has. With a natural shape in the material frame it is a step
    of a fixed-point iteration.
    """
    model = cable.model
    if not model.twist:
        return False
    free = ~model.held_mask()[-1]
    if free.all() and not any(spring.point.twist for spring in model.holding.springs):
        return False
    stiffness = mass.dense(model.twisting_stiffness)[np.ix_(free, free)]
    cable.x[-1][free] += np.linalg.solve(stiffness, cable.forces()[-1][free])
    return True


class _Search:
    """The spatial rows of one search.

    Attributes:
        patient: pseudo-time [s^2] of steps that see the whole stiffness: the cable falls by many
            times its length meanwhile.
    """

    def __init__(self, cable: Cable) -> None:
        self._cable, model = cable, cable.model
        self._dim = len(model.axes)
        self._length = float(model.knots[-1])
        self._ends = bspline.breaks(model.knots)
        self._xi, self._weights = model.rule.xi, model.rule.weights
        spans = len(self._ends) - 1
        self._spans = np.arange(spans)[:, None] + np.arange(4)
        polynomials = bspline.span_polynomials(model.knots)
        powers = self._xi[..., None] ** np.arange(3)
        own = np.einsum("skp,sjp->sjk", polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0]), powers)
        self._slopes = own * (2.0 / np.diff(self._ends))[:, None, None]
        self._by_span = model.has(layout.SPAN_STRETCH)
        self._linear = np.zeros((spans, 1))
        self._linear[[0, -1]] = 3.0
        stretches = model.has(layout.STRETCH) or self._by_span
        self._half_stiffness = 0.5 * (model.axial_stiffness if stretches else 0.0) * self._weights
        self.patient = 0.0

    def first_step(self) -> float:
        """Pseudo-time [s^2] in which the first guess moves by a percent of the length."""
        model = self._cable.model
        free = ~model.held_mask()[: self._dim]
        pull = float(np.abs(self._cable.forces()[: self._dim] * free).sum())
        inertia = float(mass.multiply(model.band(layout.MASS, 0), np.ones(model.n)).sum())
        fall = inertia * self._length / max(pull, 1e-300)
        self.patient = 100.0 * fall
        return 0.01 * fall

    def step(self, pseudo: float) -> tuple[int, float]:
        """One backward Euler step in place; iterations (0: not converged) and the largest move.

        The move is a share of the length.
        """
        dim = self._dim
        x = self._cable.x
        before = x.copy()
        tangents = self._tangents()
        stress = self._stress(tangents)
        lead = stress
        for iteration in range(1, MAX_ITERATIONS + 1):
            change = self._correction(before, pseudo, lead - stress)
            if change is None:
                break
            x[:dim] += change
            moved = np.abs(x[:dim] - before[:dim]).max()
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

    def nudge(self) -> None:
        """Move the spatial lines by a little that has no symmetry."""
        cable = self._cable
        push = np.random.default_rng(0).standard_normal(cable.x.shape)
        push[self._dim :] = 0.0
        way = cable.free_acceleration(push)
        cable.x[:] += NUDGE * self._length / np.abs(way).max() * way

    def _tangents(self) -> Array:
        """r' at the samples of every span, shape (spans, samples, dim)."""
        x = self._cable.x[: self._dim]
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
        if not self._by_span:
            return strain
        share = self._weights / np.diff(self._ends)[:, None]
        mean = (share * strain).sum(axis=1, keepdims=True)
        slope = (share * self._xi * strain).sum(axis=1, keepdims=True)
        return np.asarray(mean + self._linear * self._xi * slope)

    def _correction(self, before: Array, pseudo: float, extra: Array) -> Array | None:
        """Newton correction of the spatial lines, shape (dim, n); None where it leads uphill."""
        cable, dim = self._cable, self._dim
        n, x = cable.model.n, cable.x
        cable.follow()
        cable.open_frame()  # the shape is found without twist
        force = cable.forces()
        band = cable.stiffness()
        if cable.loads.size and cable.loads[:, 3:6].any():
            cable.add_moment_stiffness()
        half = 4 * dim - 1
        blocks = 2.0 * np.einsum("sj,sji,sjk->sik", extra, self._slopes, self._slopes)
        inertia = cable.model.band(layout.MASS, 0)
        moved = np.stack([mass.multiply(inertia, x[d] - before[d]) for d in range(dim)], axis=1)
        unknowns = (force[:dim].T - moved / pseudo).ravel()
        # Row i dim + d of the matrix belongs to coordinate d of control point i.
        by_point = band.reshape(n, dim, -1)
        for i in range(4):
            for k in range(4):
                by_point[i : i + n - 3, :, half + (k - i) * dim] += blocks[:, i, k, None]
        for k in range(4):
            diagonal = inertia[k, : n - k, None] / pseudo
            by_point[: n - k, :, half + k * dim] += diagonal
            if k:
                by_point[k:, :, half - k * dim] += diagonal
        if cable.solve_held(unknowns) != 0 or not np.isfinite(unknowns).all():
            return None
        return unknowns.reshape(n, dim).T
