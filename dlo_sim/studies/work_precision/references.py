"""Converged references, with their own error by refinement in space and in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, Trial, at_share, attempt, error

Array = NDArray[np.float64]
METHOD = "velocity_verlet"  # valid with mass damping; its time error at such steps is negligible


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion.

    Attributes:
        points: positions at the job's times and coordinates, shape (T, m, 3).
        setting: what it was made with. step: [s].
        space: difference between the two finest resolutions, as a share of the case's scale.
        time: difference made by half the step at the coarser of the two, likewise.
    """

    points: Array
    setting: Setting
    step: float
    space: float
    time: float

    @property
    def own_error(self) -> float:
        """Space and time together: an upper bound, as the error still falls with n_u."""
        return self.space + self.time


def references(cases: list[Case], workers: Workers) -> dict[str, Reference]:
    """The references of cases by name; three runs each.

    Raises:
        RuntimeError: a run failed.
    """
    runs = [_Run(case.job, Setting(METHOD, n, samples=3), 1.0) for case in cases for n in case.fine]
    runs += [_Run(case.job, Setting(METHOD, case.fine[0], samples=3), 0.5) for case in cases]
    done = list(workers.map(_done, runs))
    found = {}
    for k, case in enumerate(cases):
        coarse, fine, half = done[2 * k], done[2 * k + 1], done[2 * len(cases) + k]
        for trial in (coarse, fine, half):
            if not trial.ok:
                raise RuntimeError(f"a reference run of {case.name} failed: {trial.message}")
        found[case.name] = Reference(
            fine.points,
            fine.setting,
            fine.step,
            error(coarse.points, fine.points, case.components) / case.scale,
            error(half.points, coarse.points, case.components) / case.scale,
        )
    return found


@dataclass(frozen=True, eq=False)
class _Run:
    """A job, a setting, and the share of its own step that it is run at."""

    job: Job
    setting: Setting
    share: float


def _done(run: _Run) -> Trial:
    setting = at_share(run.job, run.setting, run.share)
    return attempt(run.job, setting, timed=False)
