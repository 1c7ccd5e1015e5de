"""Steps a cable with the compiled loop of one method, and never shows a diverged state.

A state with a large error of the energy balance is not shown: after a failed advance the last good
state is restored.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import IMPLICIT, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.engine import arrays
from dlo_sim.engine.account import DIVERGED_SHARE
from dlo_sim.methods import implicit
from dlo_sim.methods.advance import advance
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Status

Array = NDArray[np.float64]
CHUNK = 4096  # steps of a long advance after which the state is kept in case of a failure
GUARD_STEPS = 16  # explicit steps between two checks of the energy
_STATUS = (Status.OK, Status.DIVERGED, Status.NOT_CONVERGED)
LOOK = 2e-3  # [s] between two looks for buckling at a straight cable at least
_FAMILIES = {
    SPLITTING: arrays.SPLITTING,
    RUNGE_KUTTA: arrays.RUNGE_KUTTA,
    ZHAI: arrays.ZHAI,
    IMPLICIT: arrays.IMPLICIT,
}


class Along(NamedTuple):
    """What the end effectors do in every step of a run.

    Attributes:
        motions: of the grasps, shape (steps, grasps, MOTION_SIZE). natural, turns: from
            `NaturalShape.turns_along`.
    """

    motions: Array
    natural: Array
    turns: Array

    def part(self, first: int, steps: int) -> Along:
        """So many steps of it."""
        piece = slice(first, first + steps)
        return Along(self.motions[piece], self.natural, self.turns[piece])


AS_BEFORE = Along(np.zeros((0, 0, 0)), np.zeros((0, 0, 0, 0)), np.zeros((0, 0)))


class Advance(NamedTuple):
    """Outcome of an advance.

    Attributes:
        status: ok, or why it failed. steps: whole steps up to the state that is kept.
        evaluations: force evaluations, or Newton iterations. worst: control point where it failed.
    """

    status: Status
    steps: int
    evaluations: int
    worst: int = 0


class Stepper:
    """Steps of `step` [s] of one method on the arrays of a cable.

    Attributes:
        method, step: of the steps. check_every: steps between two checks of the energy by the
            compiled loop: 1 for an implicit method, else GUARD_STEPS. look_every: steps between
            two looks for buckling, a multiple of it.
    """

    def __init__(self, cable: Cable, method: Method, step: float) -> None:
        self.method, self.step = method, step
        self.check_every = 1 if method.family == IMPLICIT else GUARD_STEPS
        self.look_every = max(1, round(LOOK / (step * self.check_every))) * self.check_every
        self._cable = cable
        tolerance = cable.model.scene.integrator.tolerance
        self._constants = _constants_of(method, tolerance, self.check_every)
        self._kept = np.empty_like(cable.state)  # new memory in every advance would take as long
        self._unrecorded = Recorder(cable.model, np.zeros(0))
        if method.family != IMPLICIT:
            # What keeps spans from turning over is a hundred times as stiff as the cable, more than
            # explicit steps bear; `soundness` tells of folds instead.
            cable.leave_out(arrays.GUARDED)

    def checked(self, step: int) -> bool:
        """Whether the compiled loop checks the energy after step number `step`."""
        return step % self.check_every == 0

    def advance(
        self,
        first: int,
        steps: int,
        recorder: Recorder | None = None,
        along: Along = AS_BEFORE,
    ) -> Advance:
        """Advance by whole steps from step `first`; after a failure keep the last good state.

        Args:
            along: of these steps; implicit methods only.
        """
        recorder = self._unrecorded if recorder is None else recorder
        if self._kept.size != self._cable.state.size:  # it has another model
            self._kept = np.empty_like(self._cable.state)
        self._kept[:] = self._cable.state
        done = self._called(first, steps, recorder, along)
        if done.status.ok and self._sane(first + done.steps):
            return done
        status = Status.DIVERGED if done.status.ok else done.status
        worst, made = self._worst_point(status), self._redo(first, done.steps, along)
        reached = (first + made + 1e-9) * self.step
        recorder.forget(int(np.searchsorted(recorder.times, reached, side="right")))
        return Advance(status, made, done.evaluations, worst)

    def _called(self, first: int, steps: int, recorder: Recorder, along: Along) -> Advance:
        cable, constants = self._cable, self._constants
        if recorder is not self._unrecorded:
            recorder.keep_obstacles(cable.obstacles)
        code = advance.code(cable.terms | constants.family)
        given = cable.address, constants.address, first, steps, self.step, recorder.address
        status, done, evaluations = code(*given, *along)
        return Advance(_STATUS[status], done, evaluations)

    def _sane(self, step: int) -> bool:
        """Whether the state may be shown, also between two checks of the energy."""
        return self.checked(step) or self._cable.share_open() <= DIVERGED_SHARE

    def _redo(self, first: int, made: int, along: Along) -> int:
        """Repeat a failed advance up to its last good state; returns its steps."""
        last_check = first + made - (first + made) % self.check_every
        for good in (made, last_check - first):
            self._cable.state[:] = self._kept
            if good > 0:
                self._called(first, good, self._unrecorded, along)
                if self._sane(first + good):
                    return good
        self._cable.state[:] = self._kept
        return 0

    def _worst_point(self, status: Status) -> int:
        """Control point with the largest unbalanced force, or the fastest one, of a failed step."""
        size = np.abs(self._cable.w).max(axis=0)
        if status is Status.NOT_CONVERGED and self.method.family == IMPLICIT:
            size = np.abs(self._cable.unbalanced).max(axis=1)
        return int(np.argmax(np.nan_to_num(size, nan=np.inf)))


def _constants_of(method: Method, tolerance: float, check_every: int) -> arrays.Method:
    """The numbers of a method for the compiled loop."""
    stages = max(len(method.drift_weights), len(method.stage_weights), len(method.substeps))
    out = arrays.Method({"stages": stages})
    out.family, out.check_every, out.stages = _FAMILIES[method.family], check_every, stages
    out.drift[: len(method.drift_weights)] = method.drift_weights
    out.kick[: len(method.kick_weights)] = method.kick_weights
    for i, row in enumerate(method.stage_matrix):
        out.matrix[i, : len(row)] = row
    out.nodes[:] = out.matrix.sum(axis=1)
    out.weights[: len(method.stage_weights)] = method.stage_weights
    out.substeps[: len(method.substeps)] = method.substeps
    out.conserves_energy, out.tolerance = method.conserves_energy, tolerance
    out.halvings = implicit.MAX_HALVINGS
    return out
