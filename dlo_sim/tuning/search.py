"""The fastest setting within a tolerance: every valid method, coarse to fine, then fewer terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.reference import Reference, converged
from dlo_sim.tuning.setting import Setting, present_setting, ways_to_resolve
from dlo_sim.tuning.trial import Job, Trial, attempt, farthest, longest_step, timed_again

TRIED = (
    *("velocity_verlet", "forest_ruth"),
    *("energy_momentum", "energy_momentum_4", "implicit_midpoint"),
)
RESOLUTIONS = (5, 6, 7, 8, 9, 10, 11, 12, 13, 15, 17, 19, 21, 25, 29, 33, 41, 57)
POINTS = (2, 3)  # Gauss points per span
SHARES = (1.0, 0.5, 0.25)  # of an explicit method's own step
PARTS = (1, 2, 4, 8, 16, 32)  # of a timer period, for the steps of implicit methods
PERIODS = (8, 4, 2)  # in a step where nothing arrives in between
PLACES = 21  # points of the cable that are compared
MOST_TIMES = 1000
HOPELESS = 2.0  # times the best run time: finer settings of a method are not tried any more
STUCK = 0.9  # if a smaller step leaves this fraction of the error, space limits it
FINALISTS = 3
# Terms that may be switched off where that pays. Not twist: the angle is not in what is compared.
SWITCHES = ("bend", "gravity", "damping", "out_of_plane")
WORTH_IT = 0.95  # of the run time, for which a term is switched off


@dataclass(frozen=True, eq=False)
class Tuned:
    """The outcome of a search.

    Attributes:
        best: the fastest trial within the tolerance; None if there was none.
        error: its largest distance from the reference [m]. reference: what it was compared with.
        present: the scene as it was, timed; its error [m] is infinite if it failed.
        tried: number of settings that were run. least: smallest error of them [m].
    """

    best: Trial | None
    error: float
    reference: Reference
    present: Trial
    present_error: float
    tried: int
    least: float


@dataclass(eq=False)
class _Search:
    """State of the search."""

    job: Job
    reference: Reference
    allowed: float
    good: list[tuple[Trial, float]]
    progress: Callable[[float], None]
    done: float = 0.3  # fraction of the whole
    tried: int = 0
    least: float = float("inf")

    def run(self, setting: Setting) -> tuple[Trial, float]:
        """Try a setting; time it if it is good enough."""
        self.progress(self.done)
        trial = attempt(self.job, setting, timed=False)
        off = farthest(trial.points, self.reference.points) if trial.ok else float("inf")
        self.tried += trial.steps > 0
        self.least = min(self.least, off)
        if off <= self.allowed:
            trial = timed_again(trial, self.job, budget=0.1)
            self.good.append((trial, off))
        return trial, off

    @property
    def fastest(self) -> float:
        """Run time of the best so far [s per simulated s]."""
        return min((trial.wall for trial, _ in self.good), default=float("inf"))


def tune(
    scene: Scene,
    tolerance: float,
    duration: float,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Tuned:
    """Find the fastest setting whose centerline stays within the tolerance of the converged one.

    The error is the largest distance at any of 21 points of the cable and any time; the error of
    the reference is subtracted from the tolerance. Grippers rest where the scene has them.

    Args:
        tolerance: [m]. duration: simulated time [s].

    Raises:
        SceneError: the scene cannot be simulated. NoReference: it does not converge.
    """
    Simulator(scene)  # refuses what cannot be simulated at all
    every = duration / min(MOST_TIMES, max(int(np.ceil(duration / 1e-3)), 1))
    job = Job(scene, duration, tuple(np.linspace(0.0, 1.0, PLACES)), every)
    reference = converged(job, tolerance, lambda fraction: progress(0.3 * fraction))
    search = _Search(job, reference, tolerance - reference.error, [], progress)
    kinds = [
        Setting(method, 0, 0.0, points, stretch=stretch, knots=knots)
        for method in TRIED
        for points, (stretch, knots) in product(POINTS, ways_to_resolve(scene, method))
    ]
    for k, kind in enumerate(kinds):
        _method(search, kind)
        search.done = 0.3 + 0.6 * (k + 1) / len(kinds)
    finalists = sorted(search.good, key=lambda pair: pair[0].wall)[:FINALISTS]
    finalists = [(timed_again(trial, job), off) for trial, off in finalists]
    best, error = min(finalists, key=lambda pair: pair[0].wall, default=(None, float("inf")))
    if best is not None:
        best, error = _without_terms(search, best, error)
    present = attempt(job, present_setting(scene))
    progress(1.0)
    off = farthest(present.points, reference.points)
    return Tuned(best, error, reference, present, off, search.tried, search.least)


def _method(search: _Search, kind: Setting) -> None:
    """Resolutions of a kind of setting from coarse to fine, until one is good or it gets slow."""
    beyond = 0
    for n_u in RESOLUTIONS:
        if n_u >= search.reference.setting.control_points:
            return
        succeeded, first = False, float("inf")
        last = float("inf")
        coarse = replace(kind, control_points=n_u)
        for step in _steps(search, coarse):
            trial, off = search.run(replace(coarse, step=step))
            first = min(first, trial.first)
            if off <= search.allowed:
                succeeded = True
                break
            if trial.first > HOPELESS * search.fastest or off > STUCK * last:
                break
            last = off
        # One resolution more may allow a longer step.
        beyond += succeeded
        if beyond >= 2 or (np.isfinite(first) and first > HOPELESS * search.fastest):
            return


def _without_terms(search: _Search, best: Trial, error: float) -> tuple[Trial, float]:
    """The best setting without the terms that cost time and that the tolerance does not need.

    Only for a scene that holds all of its motion, as grippers and live loads are not known.
    """
    scene = search.job.scene
    if _live(scene):
        return best, error
    for name in SWITCHES:
        simulator = Simulator(best.setting.applied(scene))
        there = name in simulator.active_terms or (
            name == "out_of_plane" and name not in simulator.left_out
        )
        if not there or getattr(scene.terms, name) == "on":
            continue
        less = replace(best.taken, off=(*best.setting.off, name))
        trial, off = search.run(less)
        if off <= search.allowed:
            best = timed_again(best, search.job)
            trial = timed_again(trial, search.job)
            if trial.wall < WORTH_IT * best.wall:
                best, error = trial, off
    return best, error


def _live(scene: Scene) -> bool:
    """Whether poses or loads arrive while it runs."""
    driven = any(holder.driven for holder in scene.holders.values())
    return driven or any(load.signal == "none" for load in scene.loads)


def _steps(search: _Search, setting: Setting) -> list[float]:
    """Steps to try [s], from long to short; empty if the scene refuses the setting."""
    scene = search.job.scene
    if METHODS[setting.method].family == IMPLICIT:
        longer = [] if _live(scene) else [periods / scene.rate for periods in PERIODS]
        return [*longer, *(1.0 / scene.rate / part for part in PARTS)]
    try:
        own = longest_step(setting.applied(scene))
    except SceneError:
        return []
    # Whole nanoseconds: message stamps have no finer unit.
    return [max(np.floor(fraction * own * 1e9 + 1e-3), 1.0) / 1e9 for fraction in SHARES]
