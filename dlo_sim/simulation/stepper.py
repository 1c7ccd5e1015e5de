"""Choosing and calling the compiled loop of a scene's method."""

from __future__ import annotations

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
from dlo_sim.kernels.rattle import advance_rattle
from dlo_sim.kernels.runge_kutta import advance_runge_kutta
from dlo_sim.kernels.splitting import advance_splitting
from dlo_sim.kernels.zhai import advance_zhai
from dlo_sim.scene.description import Scene
from dlo_sim.simulation import optional_terms
from dlo_sim.simulation.inextensible import largest_constrained_frequency, new_chain
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.selection import Choice

GUARD_STEPS = 16  # explicit steps between two looks at the energy


def largest_frequency(
    model: Model, state: layout.State, work: layout.Work, solver: layout.Solver
) -> float:
    """Largest natural frequency [rad/s] of the scene linearised at its present configuration."""
    dim = len(model.terms.axes)
    stiffness_band(state.position, model.terms, model.viscosity, work, solver)
    if model.terms.stretch is None and dim * model.n <= spectrum.DENSE_LIMIT:
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
        self._choice = choice
        self._tolerance = scene.integrator.tolerance
        self._drift = np.array(choice.method.drift_weights)
        self._kick = np.array(choice.method.kick_weights)
        self._alpha = alpha_constants(choice.method, scene.integrator.spectral_radius)
        self._zhai = (scene.integrator.zhai_psi, scene.integrator.zhai_phi)
        self.chain: layout.Chain | None = None
        if choice.method.family == CONSTRAINED:
            self.chain = new_chain(model)
        if choice.method.family == RUNGE_KUTTA:
            self._table, self._nodes = _butcher_table(choice.method)
            self._slopes = np.zeros((len(self._table), 2, model.rows, model.width))

    def looked_at(self, step: int) -> bool:
        """Whether the loop compares the energy of the state after so many steps."""
        return self._choice.method.family == IMPLICIT or step % GUARD_STEPS == 0

    def advance(
        self,
        state: layout.State,
        work: layout.Work,
        solver: layout.Solver,
        first: int,
        steps: int,
        recorder: layout.Recorder | None = None,
    ) -> tuple[int, int, int]:
        """(kernel status, steps done, force evaluations or Newton iterations)."""
        model, choice = self._model, self._choice
        if choice.method.family == SPLITTING:
            return advance_splitting(
                state,
                model.terms,
                work,
                self._drift,
                self._kick,
                first,
                steps,
                choice.step,
                GUARD_STEPS,
                recorder,
            )
        if choice.method.family == RUNGE_KUTTA:
            return advance_runge_kutta(
                state,
                model.terms,
                work,
                self._table,
                self._nodes,
                self._slopes,
                first,
                steps,
                choice.step,
                GUARD_STEPS,
                recorder,
            )
        if choice.method.family == ZHAI:
            return advance_zhai(
                state,
                model.terms,
                work,
                *self._zhai,
                first,
                steps,
                choice.step,
                GUARD_STEPS,
                recorder,
            )
        if self.chain is not None:
            return advance_rattle(
                state,
                model.terms,
                work,
                self.chain,
                first,
                steps,
                choice.step,
                GUARD_STEPS,
                recorder,
            )
        return advance_implicit(
            state,
            model.terms,
            model.friction,
            model.viscosity,
            work,
            solver,
            first,
            steps,
            choice.step,
            choice.method.conserves_energy,
            self._alpha,
            self._tolerance,
            MAX_HALVINGS,
            recorder,
        )


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
