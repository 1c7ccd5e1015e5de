"""One setting tried on a job: its motion, then its time, from the same simulator."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.play import play
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report
from dlo_sim.simulation.selection import SAFETY
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.setting import Setting

Array = NDArray[np.float64]
TIMED = 0.3  # [s] of repeats per setting, about
MOST_REPEATS = 20


@dataclass(frozen=True, eq=False)
class Job:
    """What is computed and compared, whatever the setting.

    Attributes:
        scene: the cable and its world. duration: simulated time [s].
        u: compared material coordinates, as fractions of the length. every: sampling time [s].
        motions: of the grippers, (end, motion) by start; a step that does not divide the times
            between them applies each up to a step late.
    """

    scene: Scene
    duration: float
    u: tuple[float, ...]
    every: float = 1e-3
    motions: tuple[tuple[str, EndMotion], ...] = ()

    @property
    def times(self) -> Array:
        """Times that are looked at [s], shape (T,)."""
        return np.arange(round(self.duration / self.every) + 1, dtype=float) * self.every


@dataclass(frozen=True, eq=False)
class Trial:
    """A setting and its results.

    Attributes:
        step: [s]. steps: in the run. force_evaluations: in the run; Newton iterations of an
            implicit method.
        points: positions [m] at the job's times and coordinates of all cables, shape
            (T, cables len(u), 3), up to a failure.
        message: empty, or why the run failed or was refused.
        wall: least run time [s per simulated s] of the repeats; infinite where not timed.
        spread: (median - least) / least of them. repeats: their number.
        energy_error: as the simulator reports it.
        first: rough run time of the run that was sampled [s per simulated s].
    """

    setting: Setting
    step: float
    steps: int
    force_evaluations: int
    points: Array
    message: str
    wall: float = float("inf")
    spread: float = 0.0
    repeats: int = 0
    energy_error: float = float("nan")
    first: float = float("inf")

    @property
    def taken(self) -> Setting:
        """The setting with the step that was taken."""
        return replace(self.setting, step=self.step)

    @property
    def ok(self) -> bool:
        """Whether the run got to its end."""
        return not self.message

    @property
    def status(self) -> str:
        """`ok`, or why not, in a word or two."""
        if self.ok:
            return "ok"
        if self.steps == 0 and len(self.points) == 0:
            return "refused"
        return "not converged" if "converge" in self.message else "diverged"


def attempt(job: Job, setting: Setting, timed: bool = True, budget: float = TIMED) -> Trial:
    """Run a setting on a job and sample the motion, then time the same steps without sampling.

    A setting that the scene refuses and a run that fails give a trial with a message.
    """
    try:
        simulator = Simulator(setting.applied(job.scene))
    except SceneError as refusal:
        nothing = np.zeros((0, len(job.u), 3))
        return Trial(setting, setting.step, 0, 0, nothing, str(refusal))
    recorder = Recorder(simulator.model, job.times)
    recorder.put(simulator.cable, simulator.energy().total)
    began = time.perf_counter()
    report = _run(simulator, job, recorder)
    took = time.perf_counter() - began
    places, lines = recorder.control_points[:, :, :3], []
    for part in simulator.model.parts:
        u = np.asarray(job.u) * part.length
        basis = bspline.evaluate(np.eye(part.model.n), part.model.knots, u)
        lines.append(basis @ places[:, part.here])
    result = Trial(
        setting,
        simulator.step,
        simulator.steps,
        report.force_evaluations,
        np.concatenate(lines, axis=1),
        "" if report.status.ok else report.message,
        energy_error=simulator.energy_error,
        first=took / max(simulator.time, 1e-300),
    )
    return timed_again(result, job, simulator, budget) if timed and result.ok else result


def timed_again(
    trial: Trial, job: Job, simulator: Simulator | None = None, budget: float = TIMED
) -> Trial:
    """The trial with its run time measured, or measured once more and the least kept.

    `simulator`: one of the trial's setting that has run already. `budget`: time for repeats [s].
    """
    if simulator is None:
        simulator = Simulator(trial.setting.applied(job.scene))
        _run(simulator, job, None)
    walls: list[float] = []
    while len(walls) < 2 or (sum(walls) < budget and len(walls) < MOST_REPEATS):
        simulator.reset()
        began = time.perf_counter()
        _run(simulator, job, None)
        walls.append(time.perf_counter() - began)
    walls = sorted(wall / simulator.time for wall in walls)
    middle = walls[len(walls) // 2]
    best = min(walls[0], trial.wall)
    spread = middle / best - 1.0
    return replace(trial, wall=best, spread=spread, repeats=trial.repeats + len(walls))


def longest_step(scene: Scene) -> float:
    """Longest stable step [s] of an explicit method; raises SceneError if the scene refuses it."""
    choice = Simulator(scene).choice
    return float(min(SAFETY * choice.limit, 1.0 / scene.rate))


def at_share(job: Job, setting: Setting, fraction: float) -> Setting:
    """A setting at a fraction of its longest step, such that whole steps make a second.

    Raises SceneError if it does not fit the scene.
    """
    own = longest_step(replace(setting, step=0.0).applied(job.scene))
    return replace(setting, step=float(1.0 / np.ceil(1.0 / (fraction * own) - 1e-9)))


def error(points: Array, truth: Array, components: Sequence[int] = (0, 1, 2)) -> float:
    """Largest rms over time [m] of any of the components at any of the coordinates.

    `points`, `truth`: shape (T, m, 3) at the same times. Infinite if lengths differ or both are
    empty.
    """
    if len(points) != len(truth) or len(truth) == 0:
        return float("inf")
    gap = (points - truth)[:, :, list(components)]
    return float(np.sqrt(np.mean(gap**2, axis=0)).max())


def farthest(points: Array, truth: Array) -> float:
    """Largest distance [m] of two motions (T, m, 3); infinity if unequally long or both empty."""
    if len(points) != len(truth) or len(truth) == 0:
        return float("inf")
    return float(np.linalg.norm(points - truth, axis=2).max())


def _run(simulator: Simulator, job: Job, recorder: Recorder | None) -> Report:
    """Step over the job; its report."""
    for end, motion in job.motions:
        simulator.set_motion(end, motion)
    until = int(np.ceil(job.duration / simulator.step - 1e-9))
    return play(simulator, until, recorder)
