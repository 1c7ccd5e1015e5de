"""The stepping loop with a guard: a state that is far from its energy account is never shown.

A failed advance is taken back to its last good state. Where smaller steps may help, the step that
failed is done in smaller ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT
from dlo_sim.engine.account import DIVERGED_SHARE
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.stepper import Moments, Stepper

Array = NDArray[np.float64]

GROSS_SHARE = 1.0  # of the energy exchanged: a state further from its account is never shown
SOUND_SHARE = 0.1  # of it: a state that smaller steps may go on from
RETRIES = (2, 4, 8, 16, 32, 64)  # parts of a step that failed
_STATUS = (Status.OK, Status.DIVERGED, Status.NOT_CONVERGED)


class Advance(NamedTuple):
    """Outcome of an advance.

    Attributes:
        status: whether it came to its end; steps: whole steps to the state that is kept.
        evaluations: force evaluations, or Newton iterations. worst: control point where it failed.
    """

    status: Status
    steps: int
    evaluations: int
    worst: int = 0


class GuardedLoop:
    """The loop of one method on the arrays of a cable."""

    def __init__(self, cable: Cable, stepper: Stepper) -> None:
        self.cable, self.stepper = cable, stepper
        self._kept = np.empty_like(cable.state)  # once: no advance allocates
        self._unrecorded = Recorder(cable.model, np.zeros(0))

    def advance(self, first: int, steps: int, recorder: Recorder | None) -> Advance:
        """Advance by whole steps from step `first`; a failure keeps the last good state."""
        recorder = self._unrecorded if recorder is None else recorder
        self._kept[:] = self.cable.state
        done = self._run(first, steps, recorder)
        status = done.status
        if status.ok and not self._sane(first + done.steps):
            status = Status.DIVERGED
        if status.ok:
            return done
        worst = self._worst_point(status)
        made = self._redo(first, done.steps)
        reached = (first + made + 1e-9) * self.stepper.step
        recorder.forget(int(np.searchsorted(recorder.times, reached, side="right")))
        redone, used = self._retry(status, first + made, recorder)
        if redone:
            status, made = Status.OK, made + 1
        return Advance(status, made, done.evaluations + used, worst)

    def advance_along(
        self, first: int, recorder: Recorder, motions: Array, natural: Moments
    ) -> Advance:
        """Steps with motions of their own (`Stepper.advance_along`); implicit steps look at the
        energy themselves, and one that fails is taken back.
        """
        code, *done = self.stepper.advance_along(self.cable, first, recorder, motions, natural)
        return Advance(_STATUS[code], *done)

    def _run(self, first: int, steps: int, recorder: Recorder, finer: int = 1) -> Advance:
        code, *done = self.stepper.advance(self.cable, first, steps, recorder, finer)
        return Advance(_STATUS[code], *done)

    def _sane(self, step: int) -> bool:
        """Whether the state may be shown: explicit loops look at the energy only now and then."""
        position = self.cable.x
        if not math.isfinite(np.vdot(position, position)):  # half the time of isfinite().all()
            return False
        if self.stepper.looked_at(step):
            return True
        share = self.cable.share_open()
        if share > DIVERGED_SHARE:
            # Right after a blow little has been exchanged, and near its limit a stable method errs
            # by more than half of that for a few steps. Growth does not end.
            return share <= GROSS_SHARE and self._passes_next_look(step)
        return not math.isnan(share)

    def _passes_next_look(self, step: int) -> bool:
        """Whether the loop goes on to its next look at the energy; the state stays as it is."""
        now = self.cable.state.copy()
        done = self._run(step, self.stepper.until_look(step), self._unrecorded)
        self.cable.state[:] = now
        return done.status.ok

    def _redo(self, first: int, made: int) -> int:
        """Take back an advance that failed and do it again up to its last good state; its steps."""
        for good in (made, self.stepper.last_look(first + made) - first):
            self.cable.state[:] = self._kept
            if good > 0:
                self._run(first, good, self._unrecorded)
                if self._sane(first + good):
                    return good
        self.cable.state[:] = self._kept
        return 0

    def _retry(self, status: Status, step: int, recorder: Recorder) -> tuple[bool, int]:
        """Do one step in smaller ones where that may help; whether it did, and its evaluations.

        An explicit run that grew did so for many steps; implicit loops have already halved a step
        that could not be solved.
        """
        family = self.stepper.family
        helps = IMPLICIT if status is Status.DIVERGED else CONSTRAINED
        if family != helps or self.cable.share_open() > SOUND_SHARE:
            return False, 0
        self._kept[:] = self.cable.state
        sample, evaluations = recorder.count, 0
        for finer in RETRIES:
            done = self._run(step, 1, recorder, finer)
            evaluations += done.evaluations
            if done.status.ok and self._sane(step + 1):
                return True, evaluations
            self.cable.state[:] = self._kept
            recorder.forget(sample)
        return False, evaluations

    def _worst_point(self, status: Status) -> int:
        """Control point that is least in balance, or fastest, as a step fails."""
        size = np.abs(self.cable.w).max(axis=0)
        if status is Status.NOT_CONVERGED and self.stepper.family == IMPLICIT:
            size = np.abs(self.cable.unbalanced).max(axis=1)
        return int(np.argmax(np.nan_to_num(size, nan=np.inf)))
