"""Selects and calls the compiled loop of a scene's method."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.methods import implicit, rattle, runge_kutta, splitting, zhai
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.selection import Choice

Array = NDArray[np.float64]
NaturalAlong = tuple[Array, Array]
"""What `simulation.following.natural_along` returns."""
GUARD_STEPS = 16  # explicit steps between two checks of the energy


class Loop(Protocol):
    """The time loop of a family of methods."""

    def __call__(
        self, cable: Cable, first: int, steps: int, tau: float, recorder: Recorder
    ) -> tuple[int, int, int]:
        """Take steps of `tau` [s]; returns (status, steps done, force evaluations or Newton
        iterations).
        """


class _Explicit:
    """A loop that checks the energy every GUARD_STEPS steps."""

    def __init__(self, loop: Any, *own: Any) -> None:
        self._loop, self._own = loop, own

    def __call__(
        self, cable: Cable, first: int, steps: int, tau: float, recorder: Recorder
    ) -> tuple[int, int, int]:
        given = first, steps, tau, GUARD_STEPS, recorder.address
        status, done, evaluations = cable.call(self._loop, *self._own, *given)
        return status, done, evaluations


class _Implicit:
    """A loop that checks the energy after every step."""

    def __init__(self, method: Method, scene: Scene) -> None:
        constants = alpha_constants(method, scene.integrator.spectral_radius)
        self._own = (
            constants,
            np.array(method.substeps),
            method.conserves_energy,
            scene.integrator.tolerance,
            implicit.MAX_HALVINGS,
        )

    def __call__(
        self, cable: Cable, first: int, steps: int, tau: float, recorder: Recorder
    ) -> tuple[int, int, int]:
        given = first, steps, tau, recorder.address
        status, done, iterations = cable.call(implicit.advance_implicit, *self._own, *given)
        return status, done, iterations

    def along(
        self,
        cable: Cable,
        first: int,
        tau: float,
        recorder: Recorder,
        motions: Array,
        natural: NaturalAlong,
    ) -> tuple[int, int, int]:
        """The same with separate motions for every step."""
        given = first, tau, recorder.address, motions, *natural
        status, done, iterations = cable.call(implicit.advance_along, *self._own, *given)
        return status, done, iterations


def loop_of(method: Method, scene: Scene) -> Loop:
    """The loop of a method."""
    if method.family == SPLITTING:
        weights = np.array(method.drift_weights), np.array(method.kick_weights)
        return _Explicit(splitting.advance_splitting, *weights)
    if method.family == RUNGE_KUTTA:
        table, nodes = _butcher_table(method)
        return _Explicit(runge_kutta.advance_runge_kutta, table, nodes)
    if method.family == ZHAI:
        return _Explicit(zhai.advance_zhai, *method.zhai_pair)
    if method.family == CONSTRAINED:
        return _Explicit(rattle.advance_rattle)
    return _Implicit(method, scene)


class Stepper:
    """Calls one method's loop on the arrays of a cable."""

    def __init__(self, scene: Scene, choice: Choice) -> None:
        self.family = choice.method.family
        self.step = choice.step
        self._loop = loop_of(choice.method, scene)

    @property
    def guard_steps(self) -> int:
        """Steps between two checks of the energy."""
        return 1 if self.family == IMPLICIT else GUARD_STEPS

    def looked_at(self, step: int) -> bool:
        """Whether the loop checks the energy after step number `step`."""
        return self.family == IMPLICIT or step % GUARD_STEPS == 0

    def jump(self, cable: Cable, ends: EndDrive, time: float) -> None:
        """Move the cable at once to ends that were set to new poses.

        Only explicit methods without constraints need it: implicit steps account for the jump
        exactly, and constraints need a step to follow.
        """
        if self.family in (SPLITTING, RUNGE_KUTTA, ZHAI):
            cable.jump(time, lambda points: ends.put(points, time))

    def last_look(self, step: int) -> int:
        """The last step up to `step` after which the loop checks the energy."""
        return step if self.family == IMPLICIT else step - step % GUARD_STEPS

    def until_look(self, step: int) -> int:
        """Number of explicit steps from `step` to the next check of the energy."""
        return GUARD_STEPS - step % GUARD_STEPS

    def advance_along(
        self, cable: Cable, first: int, recorder: Recorder, motions: Array, natural: NaturalAlong
    ) -> tuple[int, int, int]:
        """As `advance`, with separate motions for every step; implicit methods only.

        Args:
            motions: of the grasps, shape (steps, grasps, MOTION_SIZE).
            natural: from `simulation.following.natural_along`.
        """
        assert isinstance(self._loop, _Implicit)
        return self._loop.along(cable, first, self.step, recorder, motions, natural)

    def advance(
        self, cable: Cable, first: int, steps: int, recorder: Recorder, finer: int = 1
    ) -> tuple[int, int, int]:
        """Advance; returns (status, steps done, force evaluations or Newton iterations).

        Every step is divided into `finer` smaller ones; steps done counts the smaller ones.
        """
        return self._loop(cable, first * finer, steps * finer, self.step / finer, recorder)


def alpha_constants(method: Method, spectral_radius: float) -> np.ndarray:
    """theta, mass weight, beta, gamma and inertia of an implicit method (`methods.implicit`).

    theta = 1 - alpha_f, mass weight = alpha_m, beta and gamma of Newmark's formulas, and
    inertia = (1 - alpha_m) / beta. Generalised-alpha: second order, with the given spectral radius
    at infinite frequency (Chung & Hulbert 1993, eqs. 25 and 17). For the midpoint family
    theta = 1/2, and the other constants are not used.
    """
    if method.name != "generalized_alpha":
        return np.array([0.5, 0.5, 0.25, 0.5, 2.0])
    alpha_m = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
    alpha_f = spectral_radius / (spectral_radius + 1.0)
    beta = 0.25 * (1.0 - alpha_m + alpha_f) ** 2
    inertia = (1.0 - alpha_m) / beta
    return np.array([1.0 - alpha_f, alpha_m, beta, 0.5 - alpha_m + alpha_f, inertia])


def _butcher_table(method: Method) -> tuple[np.ndarray, np.ndarray]:
    """Rows a_ij, followed by the row b_j, shape (s + 1, s), and the nodes c_i of the stages."""
    stages = len(method.stage_weights)
    table = np.zeros((stages + 1, stages))
    for i, row in enumerate((*method.stage_matrix, method.stage_weights)):
        table[i, : len(row)] = row
    return table, table[:stages].sum(axis=1)
