"""Converged references, with their own error estimated by refinement in space and time, each
checked by a method of another family, which uses other code for forces and time stepping.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from dlo_sim.batch.workers import Workers
from dlo_sim.scene.loading import SceneError
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import Array, each
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, Trial, at_share, attempt

METHOD = "velocity_verlet"  # valid with mass damping; its time error at such steps is negligible
CHECK, CHECK_STEP = "energy_momentum_4", 2.5e-4  # [s]
CHECK_DAMPED = "rk4"  # at its own step: damping is unstable in negative sub-steps of compositions


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion; differences are relative to the case's scale.

    Attributes:
        space: difference between the two finest resolutions. time: effect of half the step at the
            coarser one. check: setting of another method on the coarser mesh, with its step.
        disagreement: between that method and the run at half the step on the same mesh.
    """

    run: Trial
    space: float
    time: float
    check: Setting
    disagreement: float

    @property
    def points(self) -> Array:
        """Positions [m] at the job's times and coordinates, shape (T, m, 3)."""
        return self.run.points

    @property
    def own_error(self) -> float:
        """Sum of the errors in space and time, an upper bound while the error falls with n_u."""
        return self.space + self.time


def references(cases: list[Case], workers: Workers) -> dict[str, Reference]:
    """The references of cases by name; four runs each.

    Raises:
        RuntimeError: a run failed.
    """
    asked = {case.name: _runs(case) for case in cases}
    trials = each(workers, run, [one for some in asked.values() for one in some])
    found = {}
    for case in cases:
        coarse, fine, half, other = own = [trials[one] for one in asked[case.name]]
        for trial in own:
            if not trial.ok:
                raise RuntimeError(f"a reference run of {case.name} failed: {trial.message}")
        pairs = ((coarse, fine), (half, coarse), (other, half))
        space, time, check = (case.error(one.points, truth.points) for one, truth in pairs)
        found[case.name] = Reference(fine, space, time, other.setting, check)
    return found


def run(job: Job, setting: Setting, share: float) -> Trial:
    """An untimed run at a share of the method's own step, or for share 0 at the setting's step; for
    workers. A refused scene gives a trial with the message.
    """
    with contextlib.suppress(SceneError):  # the attempt is refused for the same reason
        setting = at_share(job, setting, share) if share else setting
    return attempt(job, setting, timed=False)


def _runs(case: Case) -> list[tuple[Job, Setting, float]]:
    coarse, fine = case.fine
    other = (Setting(CHECK, coarse, CHECK_STEP), 0.0)
    if case.scene.damping.mass:
        other = (Setting(CHECK_DAMPED, coarse), 1.0)
    own = ((coarse, 1.0), (fine, 1.0), (coarse, 0.5))
    return [*((case.job, Setting(METHOD, n), share) for n, share in own), (case.job, *other)]


def add(report: Report, cases: list[Case], truths: dict[str, Reference]) -> None:
    """Add the cases, the errors of their references, and the differences from another method."""
    report.section("Cases and references")
    report.text(
        """Error: rms over time of the worst axis at the material coordinates, in % of the case's
        scale. Reference: velocity_verlet on the finer of two meshes. Own error in space: its
        distance from the coarser mesh; in time: the effect of half the step there. Because the
        method is among those compared, one of another family is also run on the coarser mesh; its
        distance from velocity_verlet at half the step contains the time errors of both."""
    )
    compared, sure = [], []
    for case in cases:
        truth = truths[case.name]
        axes = "".join("xyz"[axis] for axis in case.components)
        at = ", ".join(f"{u:g}" for u in case.job.u)
        compared.append((case.name, case.job.duration, axes, at, case.scale_words, case.scale))
        own = (truth.run.setting.control_points, truth.run.step, truth.space, truth.time)
        check = (truth.check.method, truth.check.control_points, truth.check.step)
        sure.append((case.name, *own, *check, truth.disagreement))
    header = "case | duration [s] | axes | at [L] | scale | length of the scale [mm]"
    report.table("cases", header, compared, "Cases")
    report.table(
        "references",
        "case | n_u | step [us] | own error in space [%] | own error in time [%] | checked by | "
        "at n_u | with step [us] | distance [%]",
        sure,
        "References, their own errors, and their distance from another method",
    )
