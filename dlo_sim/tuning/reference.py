"""A scene's own converged motion: resolution and step refined until they stop mattering."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, Trial, attempt, farthest

Array = NDArray[np.float64]
RESOLUTIONS = (13, 17, 21, 25, 33, 41, 57, 81)
METHODS = ("velocity_verlet", "energy_momentum")  # the second where the first is not valid
IMPLICIT_STEPS = tuple(1e-3 / 2.0**k for k in range(7))  # [s]
SHARE = 0.25  # of the tolerance, that space and time may each be off


class NoReference(Exception):
    """A scene whose motion does not converge within the tolerance: one line with the cure."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion.

    Attributes:
        points: (T, m, 3) [m]. setting: what it was made with.
        error: what the last refinements in space and time changed together [m].
    """

    points: Array
    setting: Setting
    error: float


def converged(
    job: Job, tolerance: float, progress: Callable[[float], None] = lambda fraction: None
) -> Reference:
    """Refine until the motion changes by less than a quarter of the tolerance.

    Args:
        tolerance: [m], of the largest distance anywhere at any time.

    Raises:
        NoReference: a run failed, or the finest two differ by more.
    """
    method = next((m for m in METHODS if _valid(job, m)), METHODS[-1])
    wanted = SHARE * tolerance
    step, in_time = _step(job, method, wanted)
    before: Trial | None = None
    change = np.inf
    for k, n_u in enumerate(RESOLUTIONS):
        now = _checked(attempt(job, Setting(method, n_u, step), timed=False))
        progress((k + 1) / len(RESOLUTIONS))
        if before is not None:
            change = farthest(before.points, now.points)
            if change <= wanted:
                return Reference(now.points, now.taken, change + in_time)
        before = now
    raise NoReference(
        f"the motion does not converge to {wanted:.2g} m: n_u {RESOLUTIONS[-2]} and "
        f"{RESOLUTIONS[-1]} still differ by {change:.2g} m; raise --tolerance or shorten --duration"
    )


def _valid(job: Job, method: str) -> bool:
    return attempt(replace(job, duration=0.0), Setting(method, RESOLUTIONS[0]), timed=False).ok


def _step(job: Job, method: str, wanted: float) -> tuple[float, float]:
    """A step whose halving changes the motion by less than wanted [m], and that change."""
    n_u = RESOLUTIONS[1]
    if method != METHODS[-1]:
        own = Simulator(Setting(method, n_u).applied(job.scene)).step
        runs = [attempt(job, Setting(method, n_u, s), timed=False) for s in (own, 0.5 * own)]
        change = farthest(_checked(runs[0]).points, _checked(runs[1]).points)
        if change <= wanted:
            # Finer resolutions need, and take, smaller steps of their own.
            return 0.0, change
    before: Trial | None = None
    for step in IMPLICIT_STEPS:
        now = attempt(job, Setting(METHODS[-1], n_u, step), timed=False)
        if before is not None and before.ok and now.ok:
            change = farthest(before.points, now.points)
            if change <= wanted:
                return step, change
        before = now
    raise NoReference(
        f"the motion does not converge to {wanted:.2g} m in time, not even at a step of "
        f"{IMPLICIT_STEPS[-1]:.2g} s; raise --tolerance or shorten --duration"
    )


def _checked(trial: Trial) -> Trial:
    if not trial.ok:
        raise NoReference(f"a reference run failed ({trial.message}); simulate the scene first")
    return trial
