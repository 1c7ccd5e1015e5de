"""Converged references, with their own error by refinement in space and in time.

They are made with a method that is itself among those compared, so each is checked by a method of
another family, whose forces and time stepping are other code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.studies.report import Report
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, Trial, at_share, attempt, error

Array = NDArray[np.float64]
METHOD = "velocity_verlet"  # valid with mass damping; its time error at such steps is negligible
CHECK, CHECK_STEP = "energy_momentum_4", 2.5e-4  # [s]
CHECK_DAMPED = "rk4"  # at its own step: compositions with negative sub-steps let damping grow


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion.

    Attributes:
        points: positions at the job's times and coordinates, shape (T, m, 3).
        setting: what it was made with. step: [s].
        space: difference between the two finest resolutions, as a share of the case's scale.
        time: difference made by half the step at the coarser of the two, likewise.
        check: the setting of another method on the coarser mesh, with its step.
        disagreement: its distance from the run with half the step on the same mesh, likewise.
    """

    points: Array
    setting: Setting
    step: float
    space: float
    time: float
    check: Setting
    disagreement: float

    @property
    def own_error(self) -> float:
        """Space and time together: an upper bound, as the error still falls with n_u."""
        return self.space + self.time


def references(cases: list[Case], workers: Workers) -> dict[str, Reference]:
    """The references of cases by name; four runs each.

    Raises:
        RuntimeError: a run failed.
    """
    runs = [_Run(case.job, Setting(METHOD, n, samples=3), 1.0) for case in cases for n in case.fine]
    runs += [_Run(case.job, Setting(METHOD, case.fine[0], samples=3), 0.5) for case in cases]
    runs += [_check(case) for case in cases]
    done = list(workers.map(_done, runs))
    found = {}
    for k, case in enumerate(cases):
        coarse, fine = done[2 * k], done[2 * k + 1]
        half, other = done[2 * len(cases) + k], done[3 * len(cases) + k]
        for trial in (coarse, fine, half, other):
            if not trial.ok:
                raise RuntimeError(f"a reference run of {case.name} failed: {trial.message}")
        found[case.name] = Reference(
            fine.points,
            fine.setting,
            fine.step,
            error(coarse.points, fine.points, case.components) / case.scale,
            error(half.points, coarse.points, case.components) / case.scale,
            other.setting,
            error(other.points, half.points, case.components) / case.scale,
        )
    return found


def add(report: Report, cases: list[Case], truths: dict[str, Reference]) -> None:
    """The references in a table: own errors, and how far another method is from them."""
    report.section("References")
    report.text(
        f"""The reference of a case is {METHOD} on the finer of two meshes. Own error in space: its
        distance from the coarser mesh; in time: what half the step changes there. As {METHOD} is
        among the methods compared, one of another family is run on the coarser mesh too:
        {CHECK}, or {CHECK_DAMPED} at its own step where damping excludes it. Its distance from
        {METHOD} at half the step holds the time errors of both. All in % of the case's scale."""
    )
    report.table(
        "references",
        [
            *("case", "n_u", "step [us]", "own error in space [%]", "own error in time [%]"),
            *("checked by", "at n_u", "with step [us]", "distance [%]"),
        ],
        [
            [
                *(case.name, truth.setting.control_points, 1e6 * truth.step),
                *(100 * truth.space, 100 * truth.time),
                *(truth.check.method, truth.check.control_points, 1e6 * truth.check.step),
                100 * truth.disagreement,
            ]
            for case, truth in ((case, truths[case.name]) for case in cases)
        ],
        "References, their own errors, and their distance from another method",
    )


@dataclass(frozen=True, eq=False)
class _Run:
    """A job, a setting, and the share of its own step that it is run at; 0 = the setting's."""

    job: Job
    setting: Setting
    share: float


def _check(case: Case) -> _Run:
    if case.damped:
        return _Run(case.job, Setting(CHECK_DAMPED, case.fine[0], samples=3), 1.0)
    return _Run(case.job, Setting(CHECK, case.fine[0], CHECK_STEP, samples=3), 0.0)


def _done(run: _Run) -> Trial:
    setting = at_share(run.job, run.setting, run.share) if run.share else run.setting
    return attempt(run.job, setting, timed=False)
