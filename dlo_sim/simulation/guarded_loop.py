"""The stepping loop with a guard: a state that is far from its energy account is never shown.

A failed advance is taken back to its last good state. Where smaller steps may help, the step that
failed is done in smaller ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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


@dataclass(frozen=True)
class GuardedLoop:
    """The loop of one method on the arrays of a cable.

    Attributes:
        kept: room to keep a state in. unrecorded: a recorder without room.
    """

    cable: Cable
    stepper: Stepper
    kept: Array
    unrecorded: Recorder

    @classmethod
    def of(cls, cable: Cable, stepper: Stepper) -> GuardedLoop:
        """The loop of a stepper on a cable."""
        nothing = Recorder(cable.model, np.zeros(0))
        return cls(cable, stepper, np.empty_like(cable.state), nothing)

    def advance(self, first: int, steps: int, recorder: Recorder | None) -> Advance:
        """Advance by whole steps from step `first`; a failure keeps the last good state."""
        recorder = self.unrecorded if recorder is None else recorder
        self._keep()
        status, made, evaluations = self._run(first, steps, recorder)
        if status.ok and not self._sane(first + made):
            status = Status.DIVERGED
        if status.ok:
            return Advance(status, made, evaluations)
        worst = self._worst_point(status)
        made = self._redo(first, made)
        reached = (first + made + 1e-9) * self.stepper.step
        recorder.forget(int(np.searchsorted(recorder.times, reached, side="right")))
        done, used = self._retry(status, first + made, recorder)
        if done:
            status, made = Status.OK, made + 1
        return Advance(status, made, evaluations + used, worst)

    def advance_along(
        self, first: int, recorder: Recorder, motions: Array, natural: Moments
    ) -> Advance:
        """Steps with motions of their own (`Stepper.advance_along`); implicit steps look at the
        energy themselves, and one that fails is taken back.
        """
        code, made, evaluations = self.stepper.advance_along(
            self.cable, first, recorder, motions, natural
        )
        return Advance(_STATUS[code], made, evaluations)

    def _run(
        self, first: int, steps: int, recorder: Recorder, finer: int = 1
    ) -> tuple[Status, int, int]:
        code, made, evaluations = self.stepper.advance(self.cable, first, steps, recorder, finer)
        return _STATUS[code], made, evaluations

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
        status, _, _ = self._run(step, self.stepper.until_look(step), self.unrecorded)
        self.cable.state[:] = now
        return status.ok

    def _keep(self) -> None:
        """Remember the state before an advance, without allocating."""
        self.kept[:] = self.cable.state

    def _go_back(self) -> None:
        """Take back the advance since `_keep`."""
        self.cable.state[:] = self.kept

    def _redo(self, first: int, made: int) -> int:
        """Take back an advance that failed and do it again up to its last good state; its steps."""
        for good in (made, self.stepper.last_look(first + made) - first):
            self._go_back()
            if good > 0:
                self._run(first, good, self.unrecorded)
                if self._sane(first + good):
                    return good
        self._go_back()
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
        self._keep()
        sample, evaluations = recorder.count, 0
        for finer in RETRIES:
            status, _, used = self._run(step, 1, recorder, finer)
            evaluations += used
            if status.ok and self._sane(step + 1):
                return True, evaluations
            self._go_back()
            recorder.forget(sample)
        return False, evaluations

    def _worst_point(self, status: Status) -> int:
        """Control point that is least in balance, or fastest, as a step fails."""
        size = np.abs(self.cable.w).max(axis=0)
        if status is Status.NOT_CONVERGED and self.stepper.family == IMPLICIT:
            size = np.abs(self.cable.unbalanced).max(axis=1)
        return int(np.argmax(np.nan_to_num(size, nan=np.inf)))
