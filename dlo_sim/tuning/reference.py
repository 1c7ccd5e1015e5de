"""A scene's own converged motion: resolution and step refined until they stop mattering."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.setting import Setting, ways_to_resolve
from dlo_sim.tuning.trial import Job, Trial, attempt, farthest

Array = NDArray[np.float64]
RESOLUTIONS = (13, 17, 21, 25, 33, 41, 57, 81)
METHODS = ("energy_momentum", "velocity_verlet")  # the second where the first will not do
IMPLICIT_STEPS = tuple(1e-3 / 2.0**k for k in range(7))  # [s]
SHARE = 0.25  # of the tolerance, that space and time may each be off


class NoReference(Exception):
    """A scene whose motion does not converge within the tolerance: one line with the cure."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion.

    Attributes:
        points: (T, m, 3) [m]. setting: with which it was computed.
        error: change by the last refinements in space and time together [m].
    """

    points: Array
    setting: Setting
    error: float


def converged(
    job: Job, tolerance: float, progress: Callable[[float], None] = lambda fraction: None
) -> Reference:
    """Refine until the largest change of the motion is less than a quarter of the tolerance [m].

    Raises NoReference if a run failed, or the finest two differ by more.
    """
    wanted = SHARE * tolerance
    setting, in_time = _method_and_step(job, wanted)
    before: Trial | None = None
    change = np.inf
    for k, n_u in enumerate(RESOLUTIONS):
        now = _checked(attempt(job, replace(setting, control_points=n_u), timed=False))
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


def _method_and_step(job: Job, wanted: float) -> tuple[Setting, float]:
    """A method and a step whose halving changes the motion by less than wanted [m], and that
    change."""
    implicit, explicit = (
        Setting(method, RESOLUTIONS[1], stretch=_stretch(job.scene, method)) for method in METHODS
    )
    if attempt(replace(job, duration=0.0), implicit, timed=False).ok:
        last, change = _halved(job, implicit, IMPLICIT_STEPS, wanted)
        setting = last.setting
    else:  # Frenet torsion
        own = Simulator(explicit.applied(job.scene)).step
        last, change = _halved(job, explicit, (own, 0.5 * own), wanted)
        setting = explicit  # finer resolutions need, and take, smaller steps of their own
    if change <= wanted:
        return setting, change
    _checked(last)
    raise NoReference(
        f"the motion does not converge to {wanted:.2g} m in time, not even at a step of "
        f"{last.setting.step:.2g} s; raise --tolerance or shorten --duration"
    )


def _stretch(scene: Scene, method: str) -> str:
    """By span where it can be: thin cables converge sooner."""
    return "span" if len(ways_to_resolve(scene, method)) > 1 else "sample"


def _halved(
    job: Job, setting: Setting, steps: Sequence[float], wanted: float
) -> tuple[Trial, float]:
    """The first trial that differs from the one before by no more than wanted [m], else the last;
    and by how much."""
    before = attempt(job, replace(setting, step=steps[0]), timed=False)
    for step in steps[1:]:
        now = attempt(job, replace(setting, step=step), timed=False)
        change = farthest(before.points, now.points) if before.ok and now.ok else np.inf
        if change <= wanted:
            break
        before = now
    return now, change


def _checked(trial: Trial) -> Trial:
    if not trial.ok:
        raise NoReference(f"a reference run failed ({trial.message}); simulate the scene first")
    return trial
