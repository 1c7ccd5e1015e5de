"""Choosing and calling the compiled loop of a scene's method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dlo_sim.core import spectrum
from dlo_sim.core.methods import (
    CONSTRAINED,
    IMPLICIT,
    RUNGE_KUTTA,
    SPLITTING,
    ZHAI,
    Method,
)
from dlo_sim.kernels import layout
from dlo_sim.kernels.implicit import MAX_HALVINGS, advance_implicit
from dlo_sim.kernels.instant import stiffness_band
from dlo_sim.kernels.jit import bound
from dlo_sim.kernels.rattle import advance_rattle
from dlo_sim.kernels.runge_kutta import advance_runge_kutta
from dlo_sim.kernels.splitting import advance_splitting, jump_ends
from dlo_sim.kernels.zhai import advance_zhai
from dlo_sim.scene.description import Scene
from dlo_sim.simulation import optional_terms
from dlo_sim.simulation.inextensible import largest_constrained_frequency, new_chain
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.selection import Choice

Loop = Callable[..., Any]

GUARD_STEPS = 16  # explicit steps between two looks at the energy


def largest_frequency(
    model: Model, state: layout.State, work: layout.Work, solver: layout.Solver
) -> float:
    """Largest natural frequency [rad/s] of the scene linearised at its present configuration."""
    dim = len(model.terms.axes)
    stiffness_band(state.position, model.stiffness_terms, model.viscosity, work, solver)
    stretches = model.terms.stretch is not None or model.terms.span_stretch is not None
    if not stretches and dim * model.n <= spectrum.DENSE_LIMIT:
        # Without stretching only motion that keeps the length counts.
        return largest_constrained_frequency(model, solver.band, state.position)
    free = model.terms.mass.free != 0.0
    value = spectrum.largest_frequency(solver.band.copy(), model.terms.mass.band[:dim], free[:dim])
    if model.terms.twist is not None:
        twist = _twist_rows(model.terms.twist.stiffness)
        row = slice(dim, dim + 1)
        value = max(value, spectrum.largest_frequency(twist, model.terms.mass.band[row], free[row]))
    if model.terms.frenet is not None:
        value = optional_terms.with_torsion(
            value, model.terms.frenet, model.knots, model.terms.mass
        )
    return value


def _twist_rows(band: np.ndarray) -> np.ndarray:
    """Symmetric lower diagonals as a row-stored band."""
    n = band.shape[1]
    rows = np.zeros((n, 7))
    for k in range(4):
        rows[: n - k, 3 + k] = band[k, : n - k]
        rows[k:, 3 - k] = band[k, : n - k]
    return rows


class Stepper:
    """Calls one method's loop on the arrays of a simulator."""

    def __init__(self, scene: Scene, model: Model, choice: Choice) -> None:
        self._model = model
        self._code: Loop | None = None
        self.chain: layout.Chain | None = None
        method = choice.method
        self.family = method.family
        self.step = choice.step
        self._loop: Loop
        self._own: tuple[object, ...]  # what only this method needs
        if method.family == SPLITTING:
            self._loop = advance_splitting
            self._own = (np.array(method.drift_weights), np.array(method.kick_weights))
        elif method.family == RUNGE_KUTTA:
            self._loop = advance_runge_kutta
            table, nodes = _butcher_table(method)
            self._own = (table, nodes, np.zeros((len(table), 2, model.rows, model.width)))
        elif method.family == ZHAI:
            self._loop = advance_zhai
            self._own = (scene.integrator.zhai_psi, scene.integrator.zhai_phi)
        elif method.family == CONSTRAINED:
            self._loop = advance_rattle
            self.chain = new_chain(model)
            self._own = (self.chain,)
        else:
            self._loop = advance_implicit
            self._own = (
                model.friction,
                model.viscosity,
                np.array(method.substeps),
                method.conserves_energy,
                alpha_constants(method, scene.integrator.spectral_radius),
                scene.integrator.tolerance,
                MAX_HALVINGS,
            )

    @property
    def ready(self) -> bool:
        """Whether the loop's machine code has been used for this scene's arrays."""
        return self._code is not None

    def looked_at(self, step: int) -> bool:
        """Whether the loop compares the energy of the state after so many steps."""
        return self.family == IMPLICIT or step % GUARD_STEPS == 0

    def jump(self, state: layout.State, work: layout.Work, time: float) -> None:
        """Let ends that were put elsewhere be there now. Implicit steps account for that exactly,
        and constraints need a step to follow.
        """
        if self.family in (SPLITTING, RUNGE_KUTTA, ZHAI):
            jump_ends(state, self._model.terms, work, time)

    def last_look(self, step: int) -> int:
        """The last such state up to there."""
        return step if self.family == IMPLICIT else step - step % GUARD_STEPS

    def until_look(self, step: int) -> int:
        """Steps from there to the next such state."""
        return GUARD_STEPS - step % GUARD_STEPS

    def advance(
        self,
        state: layout.State,
        work: layout.Work,
        solver: layout.Solver,
        first: int,
        steps: int,
        recorder: layout.Recorder,
        finer: int = 1,
    ) -> tuple[int, int, int]:
        """(kernel status, steps done, force evaluations or Newton iterations).

        Every step is done in so many parts as `finer` says, of which the steps done are counted.
        """
        span = (first * finer, steps * finer, self.step / finer)
        arguments = self._arguments(state, work, solver, span, recorder)
        if self._code is None:
            self._code = bound(self._loop, *arguments)
        done: tuple[int, int, int] = self._code(*arguments)
        return done

    def compile(
        self,
        state: layout.State,
        work: layout.Work,
        solver: layout.Solver,
        recorder: layout.Recorder,
    ) -> None:
        """Make the loop's machine code ready for arrays like these."""
        bound(self._loop, *self._arguments(state, work, solver, (0, 0, self.step), recorder))

    def _arguments(
        self,
        state: layout.State,
        work: layout.Work,
        solver: layout.Solver,
        span: tuple[int, int, float],
        recorder: layout.Recorder,
    ) -> tuple[object, ...]:
        shared = (state, self._model.terms, work)
        if self.family == IMPLICIT:
            return (*shared, solver, *self._own, *span, recorder)
        return (*shared, *self._own, *span, GUARD_STEPS, recorder)


def alpha_constants(method: Method, spectral_radius: float) -> layout.Alpha:
    """Constants of an implicit method.

    Generalised-alpha: second order, with the given spectral radius at infinite frequency
    (Chung & Hulbert 1993, eqs. 25 and 17).
    """
    if method.name != "generalized_alpha":
        return layout.Alpha(0.5, 0.5, 0.25, 0.5, 2.0)
    alpha_m = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
    alpha_f = spectral_radius / (spectral_radius + 1.0)
    beta = 0.25 * (1.0 - alpha_m + alpha_f) ** 2
    return layout.Alpha(
        1.0 - alpha_f, alpha_m, beta, 0.5 - alpha_m + alpha_f, (1.0 - alpha_m) / beta
    )


def _butcher_table(method: Method) -> tuple[np.ndarray, np.ndarray]:
    """Rows a_ij and, last, b_j, shape (s + 1, s), and the times c_i and 1 that they lead to."""
    stages = len(method.stage_weights)
    table = np.zeros((stages + 1, stages))
    for i, row in enumerate((*method.stage_matrix, method.stage_weights)):
        table[i, : len(row)] = row
    return table, table.sum(axis=1)
