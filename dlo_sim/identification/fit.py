"""Fits parameters of a scene to recordings, and estimates their uncertainty.

Robust least squares (soft L1) in stages, each from the solution of the one before, the first from
the best of a grid. Before a stage, parameters that the data cannot determine keep their values: J
are the derivatives of the errors by the unknowns in units of their widths; while a singular value
of J is so small that a change by a width is lost in the noise, the unknown with the largest part in
it is removed.

The covariance is estimated from the errors that the fit leaves. With the derivatives J, robust
weights W and H = J^T W J, an error e of the measurements changes the unknowns by -H^-1 J^T W e. Two
kinds of error count:
- residuals, with the sums g_t = J_t^T W_t e_t of frame t. Their part is H^-1 S H^-1, with S the sum
  of the autocovariance of g over the lags up to which errors are correlated (Newey & West 1987,
  doi:10.2307/1913610), within each piece of motion;
- noise of the frames from which a piece starts, which the whole piece then follows: the decay of a
  motion, which determines the damping, depends on its beginning. Its part is the mean of H^-1 g g^T
  H^-1 over simulations from starts with as much noise again, with the sum g over a piece
  (propagation of errors, by Monte Carlo: JCGM 101:2008).
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.identification.prediction import Sensor
from dlo_sim.identification.problem import DELAY, HARDENING, YIELD, Problem, Unknown
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import Refusal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Progress = Callable[[float], None]
TOGETHER = 20.0  # errors that count as one, before the fit
EVALUATIONS, FEW = 40, 20  # steps of a stage, at most, and of a fit that goes on from another
GAIN = 1e-3  # relative gain in the cost below which a stage ends
STARTS = ((-3.0, 0.0), (-1.5, 0.0), (0.0, 0.0), (1.5, 0.0), (3.0, 0.0), (0.0, 1.5), (-1.5, 1.5))
STARTED = ("cable.bending_stiffness", "damping.stiffness")
HARNESS = ("cable.bending_stiffness", "cable.torsional_stiffness", "damping.bend", "damping.twist")
HARNESS_STARTS = tuple((one, one, two, two) for one in (0.0, 1.5, 3.0) for two in (0.0, 1.5, 3.0))
TWISTED = ("cable.torsional_stiffness", "cable.bending_stiffness")
# Unknowns for which a stage that has the first of them looks for a better start in a grid.
GRIDS: tuple[tuple[tuple[str, ...], tuple[tuple[float, ...], ...]], ...] = (
    (
        ("damping.thinning", "damping.stiffness"),
        ((0.0, 0.0), (0.025, 0.1), (0.12, 0.4)),
    ),
    (
        (HARDENING, YIELD, "cable.bending_stiffness", "damping.stiffness"),
        (
            (0.0, 0.0, 0.0, 0.0),
            (-0.3, -1.0, 0.2, -0.3),
            (-0.3, 0.0, 0.2, -0.3),
            (-0.3, 1.0, 0.2, -0.3),
            (-0.5, -1.0, 0.4, -0.7),
            (-0.5, 0.0, 0.4, -0.7),
        ),
    ),
)
DELAYS = tuple(np.linspace(-0.1, 0.1, 11).tolist())  # [s] to start from
WIDE = "its 95 % interval is wider than the range that was searched"
KEPT = 40  # points whose errors are kept: a fit comes back to them
NORMAL = 1.96  # standard deviations of 95 %
DRAWS, SEED = 12, 1  # of noise of the starts


class FitError(Refusal):
    """A fit that cannot be made: one line with the cure."""


@dataclass(frozen=True)
class Number:
    """A fitted number with its 95 % interval."""

    unknown: Unknown
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Fit:
    """The result of a fit.

    Attributes:
        scene, sensor: with the fitted values. numbers: fitted.
        left: label -> why it kept its value. seen: the numbers in the units of the fit, at the end.
        evaluations: simulations of all recordings.
    """

    scene: Scene
    sensor: Sensor
    numbers: tuple[Number, ...]
    left: dict[str, str]
    seen: Array
    evaluations: int


def fit(
    problem: Problem,
    workers: Workers,
    progress: Progress,
    tell: Callable[[str], object],
    before: Fit | None = None,
) -> Fit:
    """Fit the unknowns of a problem, stage by stage.

    Args:
        before: a fit of the same unknowns to continue, in one stage.
        progress: called with the fraction done. tell: gets a line for each unknown that is left.

    Raises:
        FitError: no scipy, or nothing that the data can determine.
    """
    if importlib.util.find_spec("scipy") is None:
        raise FitError("identify needs scipy; install dlo_sim with the extra 'identify'")
    run = _Run(problem, workers, progress)
    stages = np.array([one.stage for one in problem.unknowns])
    if before is None:
        seen, active = run.best_start(), np.zeros(len(stages), dtype=bool)
        left: dict[str, str] = {}
    else:
        labels = {number.unknown.label for number in before.numbers}
        seen, active = before.seen, np.array([one.label in labels for one in problem.unknowns])
        left, stages = dict(before.left), stages[active][:1]
    for stage in np.unique(stages):
        if before is None:
            seen = run.in_proportion(seen, stages == stage)
            joining = {one.key for one in problem.unknowns if one.stage == stage}
            for names, grid in GRIDS:
                if names[0] in joining:
                    seen = run.best(seen, active | (stages == stage), names, grid)
            active, reasons = run.distinct(seen, active, stages == stage)
            seen = np.where((stages == stage) & ~active, problem.start(), seen)
            left |= reasons
            for label, reason in reasons.items():
                tell(f"{label} is left at its value: {reason}")
        if not active.any():
            continue
        seen = run.solved(seen, active, EVALUATIONS if before is None else FEW)
    while active.any():
        result, wide = run.result(seen, active, left)
        if not wide.any():
            return result
        for k in np.flatnonzero(wide):
            left[problem.unknowns[k].label] = WIDE
            tell(f"{problem.unknowns[k].label} is left at its value: {WIDE}")
        active = active & ~wide
        seen = np.where(wide, problem.start(), seen)
        if active.any():
            seen = run.solved(seen, active, FEW)
    raise FitError("the data tell none of the numbers; record a cable that moves")


class _Run:
    """A problem under way."""

    def __init__(self, problem: Problem, workers: Workers, progress: Progress) -> None:
        self.problem, self.workers, self.progress = problem, workers, progress
        self.evaluations = 0
        self._known: dict[bytes, Array] = {}
        stages = np.bincount([one.stage for one in problem.unknowns]).cumsum()
        self._expected = len(STARTS) + float(EVALUATIONS * (stages + 1).sum())

    def best_start(self) -> Array:
        """The best of a grid in stiffness and damping, about the scene's own."""
        own = self.problem.start()
        every = np.ones(len(own), dtype=bool)
        if self.problem.scene.branches:
            return self.best(own, every, HARNESS, HARNESS_STARTS)
        return self._with_best_delays(self.best(own, every, STARTED, STARTS))

    def best(
        self, seen: Array, active: Mask, names: Sequence[str], grid: Sequence[tuple[float, ...]]
    ) -> Array:
        """The best of a grid of changes of the named unknowns that are active."""
        unknowns = self.problem.unknowns
        ranges = [one.range(at) for one, at in zip(unknowns, self.problem.start(), strict=True)]
        points = [seen.copy() for _ in grid]
        for point, shifts in zip(points, grid, strict=True):
            shift_of = dict(zip(names, shifts, strict=True))
            for k in np.flatnonzero(active):
                shift = shift_of.get(unknowns[k].label, 0.0)
                point[k] = np.clip(point[k] + shift, *ranges[k]) if shift else point[k]
        return points[int(np.argmin([_cost(error) for error in self._all(points)]))]

    def in_proportion(self, seen: Array, joining: Mask) -> Array:
        """With the torsional stiffness, where it joins, changed as the bending stiffness was; in
        the grid of a harness it was.
        """
        if self.problem.scene.branches:
            return seen
        labels = np.array([one.label for one in self.problem.unknowns])
        torsion, bending = (labels == name for name in TWISTED)
        changed = (seen - self.problem.start())[bending].sum()  # 0 where it is not fitted
        return np.where(torsion & joining, seen + changed, seen)

    def _with_best_delays(self, seen: Array) -> Array:
        """With the delay of each force from a grid that leaves least of it but a constant."""
        delays = [(k, one.at) for k, one in enumerate(self.problem.unknowns) if one.key == DELAY]
        if not delays:
            return seen
        places = [k for k, _ in delays]
        points = [np.where(np.isin(np.arange(len(seen)), places), at, seen) for at in DELAYS]
        forces = [errors[:, -3:] - errors[:, -3:].mean(axis=0) for errors in self._all(points)]
        best = seen.copy()
        for place, axis in delays:
            best[place] = DELAYS[int(np.argmin([_cost(force[:, axis]) for force in forces]))]
        return best

    def solved(self, seen: Array, active: Mask, most: int) -> Array:
        """Where the active unknowns make the cost least."""
        from scipy.optimize import least_squares

        widths, low, high = self._room(active)
        expected, start = self._expected_within(active), self.problem.start()[active]

        def at(x: Array) -> Array:
            point = seen.copy()
            point[active] = x
            return point

        solution = least_squares(
            lambda x: np.append(self._all([at(x)])[0].ravel(), expected @ (x - start)),
            np.clip(seen[active], low + 1e-6 * widths, high - 1e-6 * widths),
            lambda x: np.vstack([self.linear(at(x), active)[1].reshape(-1, len(x)), expected]),
            (low, high),
            loss="soft_l1",
            x_scale=widths,
            ftol=GAIN,
            max_nfev=most,
        )
        return at(solution.x)

    def _expected_within(self, active: Mask) -> Array:
        """Rows on the active unknowns of those that are expected near their start."""
        spreads = np.array([one.spread for one in self.problem.unknowns])[active]
        rows = np.diag(1.0 / spreads)
        return np.asarray(rows[np.isfinite(spreads)])

    def linear(self, seen: Array, active: Mask) -> tuple[Array, Array]:
        """Errors (T, N) and derivatives (T, N, active) at a point, by forward differences."""
        steps = np.diag([0.01 * one.width for one in self.problem.unknowns])[active]
        here, *there = self._all([seen, *(seen + steps)])
        columns = [(moved - here) / step.sum() for moved, step in zip(there, steps, strict=True)]
        return here, np.stack(columns, axis=-1)

    def distinct(self, seen: Array, active: Mask, new: Mask) -> tuple[Mask, dict[str, str]]:
        """Those active and those new that the data can tell, and why not the others."""
        wanted, unknowns = active | new, self.problem.unknowns
        _, derivatives = self.linear(seen, wanted)
        lost = indistinct(derivatives / self.problem.noise, unknowns, wanted, active)
        wanted[[k for k, _ in lost]] = False
        return wanted, {unknowns[k].label: reason for k, reason in lost}

    def _room(self, active: Mask) -> tuple[Array, Array, Array]:
        """Widths and bounds of the active unknowns."""
        all_of = zip(self.problem.unknowns, self.problem.start(), strict=True)
        rows = np.array([(one.width, *one.range(start)) for one, start in all_of])
        widths, low, high = rows[active].T
        return widths, low, high

    def result(self, seen: Array, active: Mask, left: dict[str, str]) -> tuple[Fit, Mask]:
        """The fit with its intervals, and which of its numbers may be anywhere."""
        errors, derivatives = self.linear(seen, active)
        spread = covariance(
            errors, derivatives, self.problem.pieces, self._from_starts(seen, errors),
            self._expected_within(active),
        )  # fmt: skip
        deviation = NORMAL * np.sqrt(np.maximum(np.diag(spread), 0.0))  # rounding
        numbers = []
        for k, off in zip(np.flatnonzero(active), deviation, strict=True):
            unknown, at = self.problem.unknowns[k], seen[k]
            floor = -np.inf if unknown.log else unknown.least
            numbers.append(
                Number(unknown, *(unknown.value(x) for x in (at, max(at - off, floor), at + off)))
            )
        known = tuple(number.unknown for number in numbers)
        scene, sensor = replace(self.problem, unknowns=known).at(seen[active])
        wide = np.zeros_like(active)
        wide[active] = deviation > [number.unknown.reach for number in numbers]
        return Fit(scene, sensor, tuple(numbers), left, seen, self.evaluations), wide

    def _from_starts(self, seen: Array, errors: Array) -> list[Array]:
        """Changes of the errors by noise of the frames from which the recordings start."""
        rng, own = np.random.default_rng(SEED), self.problem
        if any(one.forces is not None for one in own.recordings):
            return []
        draws = [own.disturbed(rng).errors([seen], self.workers)[0] for _ in range(DRAWS)]
        self.evaluations += DRAWS
        return [draw - errors for draw in draws]

    def _all(self, points: list[Array]) -> list[Array]:
        """Errors at points; those of the last `KEPT` are known."""
        keys = [point.tobytes() for point in points]
        new = {
            key: point for key, point in zip(keys, points, strict=True) if key not in self._known
        }
        errors = self.problem.errors([*new.values()], self.workers)
        self._known |= dict(zip(new, errors, strict=True))
        rows = [self._known[key] for key in keys]
        for key in [*self._known][:-KEPT]:
            del self._known[key]
        self.evaluations += len(new)
        self.progress(min(self.evaluations / self._expected, 1.0))
        return rows


def _cost(errors: Array) -> float:
    """Sum of the soft L1 of errors."""
    return float(np.sum(np.sqrt(1.0 + errors**2) - 1.0))


def indistinct(
    derivatives: Array, unknowns: tuple[Unknown, ...], active: Mask, kept: Mask
) -> list[tuple[int, str]]:
    """Places and reasons of the active unknowns, except those kept, that the data cannot determine,
    from derivatives of the errors in units of their noise.
    """
    places: list[int] = np.flatnonzero(active).tolist()
    widths = np.array([unknowns[k].width for k in places])
    scaled = derivatives.reshape(-1, len(places)) * widths / np.sqrt(TOGETHER)
    lost = []
    while places:
        _, values, shares = np.linalg.svd(scaled, full_matrices=False)
        if values[-1] >= 1.0:
            break
        worst = int(np.argmax(np.abs(shares[-1])))
        alone = float(np.linalg.norm(scaled[:, worst]))
        reason = f"changed by {widths[worst]:.2g} it changes what is measured by less than noise"
        if alone >= 1.0:
            others = np.argsort(-np.abs(shares[-1]))
            other = next(unknowns[places[k]].label for k in others if k != worst)
            reason = f"the data do not tell it from {other}"
        if not kept[places[worst]]:
            lost.append((places[worst], reason))
        del places[worst]
        scaled, widths = np.delete(scaled, worst, axis=1), np.delete(widths, worst)
    return lost


def covariance(
    errors: Array,
    derivatives: Array,
    pieces: NDArray[np.int64],
    disturbed: Sequence[Array],
    expected: Array,
) -> Array:
    """Covariance of the unknowns.

    Args:
        errors: in units of what counts as large, shape (T, N). derivatives: by the unknowns, (T, N,
            U).
        pieces: number of the piece of each frame, rising from 0, shape (T,).
        disturbed: changes of the errors by noise of the starts, shape (T, N) each.
        expected: derivatives of the distances from what is expected, (rows, U).
    """
    weights = 1.0 / np.sqrt(1.0 + errors**2)
    weighted = weights[:, :, None] * derivatives
    inverse = np.linalg.pinv(
        np.einsum("tnj,tnk->jk", weighted, derivatives) + expected.T @ expected
    )
    scores = np.einsum("tn,tnj->tj", errors, weighted)
    firsts = np.flatnonzero(np.diff(pieces, prepend=-1))
    lags = _correlated_frames(errors)
    left = sum(_long_run(part, lags) for part in np.split(scores, firsts[1:]))
    # As many degrees of freedom are used as there are unknowns.
    count = len(errors) / lags
    used = derivatives.shape[2] / errors.shape[1]
    spread = left * count / max(count - used, 1.0)
    for change in disturbed:
        sums = np.add.reduceat(np.einsum("tn,tnj->tj", change, weighted), firsts)
        spread = spread + sums.T @ sums / len(disturbed)
    return np.asarray(inverse @ spread @ inverse)


def _long_run(scores: Array, lags: int) -> Array:
    """Sum of the autocovariance of scores (T, U) over the lags, with falling weights."""
    spread = scores.T @ scores
    for lag in range(1, min(lags, len(scores))):
        product = (1.0 - lag / lags) * scores[lag:].T @ scores[:-lag]
        spread = spread + product + product.T
    return spread


def _correlated_frames(errors: Array) -> int:
    """Frames up to which errors are correlated: twice the first lag below 1/e, at least 1."""
    power = float(np.sum(errors**2))
    for lag in range(1, len(errors) // 4):
        if float(np.sum(errors[lag:] * errors[:-lag])) < power / math.e:
            return 1 if lag == 1 else 2 * lag
    return max(1, len(errors) // 4)
