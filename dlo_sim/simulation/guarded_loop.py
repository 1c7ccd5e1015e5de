"""The stepping loop with a guard: states with a large error of the energy balance are never shown.

After a failed advance the last good state is restored. Where smaller steps may help, the failed
step is repeated with them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT
from dlo_sim.engine.account import DIVERGED_SHARE
from dlo_sim.engine.arrays import GUARDED
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.stepper import NaturalAlong, Stepper

Array = NDArray[np.float64]

GROSS_SHARE = 1.0  # of the energy exchanged: states with a larger energy error are never shown
SOUND_SHARE = 0.1  # of the energy exchanged: largest energy error from which steps are retried
RETRIES = (2, 4, 8, 16, 32, 64)  # numbers of smaller steps that replace a failed one
_STATUS = (Status.OK, Status.DIVERGED, Status.NOT_CONVERGED)


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


class GuardedLoop:
    """The loop of one method on the arrays of a cable."""

    def __init__(self, cable: Cable, stepper: Stepper) -> None:
        self.cable, self.stepper = cable, stepper
        if stepper.family != IMPLICIT:
            # What keeps spans from turning over is a hundred times as stiff as the cable, more than
            # explicit steps bear; `soundness` tells of folds instead.
            cable.terms &= ~GUARDED
        self._kept = np.empty_like(cable.state)  # allocated once, not in every advance
        self._unrecorded = Recorder(cable.model, np.zeros(0))

    def advance(self, first: int, steps: int, recorder: Recorder | None) -> Advance:
        """Advance by whole steps from step `first`; after a failure restore the last good state."""
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
        self, first: int, recorder: Recorder, motions: Array, natural: NaturalAlong
    ) -> Advance:
        """Advance with one motion per step (`Stepper.advance_along`).

        Needs no guard: implicit steps check the energy themselves, and a failed one is undone.
        """
        code, *done = self.stepper.advance_along(self.cable, first, recorder, motions, natural)
        return Advance(_STATUS[code], *done)

    def _run(self, first: int, steps: int, recorder: Recorder, finer: int = 1) -> Advance:
        code, *done = self.stepper.advance(self.cable, first, steps, recorder, finer)
        return Advance(_STATUS[code], *done)

    def _sane(self, step: int) -> bool:
        """Whether the state may be shown; explicit loops check the energy only every few steps."""
        position = self.cable.x
        if not math.isfinite(np.vdot(position, position)):  # half the time of isfinite().all()
            return False
        if self.stepper.looked_at(step):
            return True
        share = self.cable.share_open()
        if share > DIVERGED_SHARE:
            # Right after an impact little energy has been exchanged, and near the stability limit
            # the error of a stable method exceeds half of it for a few steps. Unlike the error of a
            # diverging run, it does not keep growing.
            return share <= GROSS_SHARE and self._passes_next_look(step)
        return not math.isnan(share)

    def _passes_next_look(self, step: int) -> bool:
        """Whether the loop passes its next check of the energy; the state is left unchanged."""
        now = self.cable.state.copy()
        done = self._run(step, self.stepper.until_look(step), self._unrecorded)
        self.cable.state[:] = now
        return done.status.ok

    def _redo(self, first: int, made: int) -> int:
        """Undo a failed advance and repeat it up to its last good state; returns its steps."""
        for good in (made, self.stepper.last_look(first + made) - first):
            self.cable.state[:] = self._kept
            if good > 0:
                self._run(first, good, self._unrecorded)
                if self._sane(first + good):
                    return good
        self.cable.state[:] = self._kept
        return 0

    def _retry(self, status: Status, step: int, recorder: Recorder) -> tuple[bool, int]:
        """Repeat one step as smaller ones where that may help.

        It does not help an explicit method that diverged, since its energy has grown for many
        steps, or an implicit one that did not converge, which has already halved the step.

        Returns:
            Whether it succeeded, and the force evaluations or Newton iterations used.
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
        """Control point with the largest unbalanced force, or the fastest one, of a failed step."""
        size = np.abs(self.cable.w).max(axis=0)
        if status is Status.NOT_CONVERGED and self.stepper.family == IMPLICIT:
            size = np.abs(self.cable.unbalanced).max(axis=1)
        return int(np.argmax(np.nan_to_num(size, nan=np.inf)))
