"""From recordings to a scene: a fit that is checked on pieces it did not see, then one of all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from dlo_sim.batch.workers import Workers
from dlo_sim.identification.fit import Fit, FitError, Progress, fit
from dlo_sim.identification.measurement import Measurement
from dlo_sim.identification.prediction import (
    COMPUTATION,
    Prediction,
    Score,
    mean_score,
    position_error,
    predicted_of,
    reaction,
    score,
)
from dlo_sim.identification.problem import (
    HARDENING,
    YIELD,
    Problem,
    Unknown,
    plastic,
    prepared,
    unknowns_of,
)
from dlo_sim.replay.comparison import AxisComparison
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.report import DiscretizationError

TRAINING, LEFT_OUT, ALL = "training pieces", "left-out pieces", "all pieces, fitted to all"


@dataclass(frozen=True)
class Identified:
    """The result of an identification.

    Attributes:
        scene, fit: fitted to all pieces.
        scores: of markers: training and left-out pieces with the first fit, all pieces with the
            last.
        reactions: axis by axis, of a recording of forces.
        failures: pieces that the fitted scene could not simulate to their end.
        pieces, left_out: numbers of all pieces, and of those not seen by the first fit.
        recordings, predicted: all pieces and what the first fit predicts of them.
        seconds: duration. error: estimated discretisation error of the predicted places, or None.
        advice: the cure of an error above accuracy.target, one line; else empty.
    """

    scene: Scene
    fit: Fit
    scores: dict[str, Score]
    reactions: list[AxisComparison]
    failures: list[str]
    pieces: int
    left_out: int
    recordings: tuple[Measurement, ...]
    predicted: tuple[Prediction, ...]
    seconds: float
    error: DiscretizationError | None
    advice: str


def identify(
    scene: Scene,
    asked: Mapping[str, object],
    recordings: Sequence[Measurement],
    workers: Workers,
    keys: Sequence[str],
    left_out: float,
    piece: float,
    progress: Progress,
    tell: Callable[[str], object],
) -> Identified:
    """Fit a scene to recordings.

    Args:
        asked: scene keys that the data and `COMPUTATION` do not override.
        keys: to fit, all if empty. left_out: fraction of the pieces. piece: their duration [s].
        progress, tell: as in `fit`.

    Raises:
        FitError: keys that cannot be fitted, or no scipy. SceneError: an impossible scene.
    """
    began = time.perf_counter()
    values = {**COMPUTATION, **recordings[0].known, **asked}
    base = prepared(scene.with_values(values))
    if recordings[0].forces is not None:
        _check_alone(base)
    pieces = tuple(part.smoothed(base) for one in recordings for part in one.pieces(piece))
    unknowns = _chosen(unknowns_of(base, recordings[0]), keys, asked)
    fitted = {one.key for one in unknowns}
    if {YIELD, HARDENING} & fitted:
        if not base.plasticity.yield_curvature and not {YIELD, HARDENING} <= fitted:
            raise FitError(
                f"--fit {min(fitted & {YIELD, HARDENING})}: the scene has no yield curvature; give "
                f"--fit for both {YIELD} and {HARDENING}, or set {YIELD}"
            )
        if base.terms.plasticity == "off":
            raise FitError(f"--fit {YIELD}: terms.plasticity is off; set it to auto")
        base = plastic(base)
    problem = Problem(base, unknowns, pieces)
    away = int(left_out * len(pieces))
    first = replace(problem, recordings=pieces[: len(pieces) - away])
    result = fit(first, workers, lambda done: progress(0.6 * done if away else done), tell)
    predicted = last = predicted_of(result.scene, pieces, workers, result.sensor)
    scores = _scores(TRAINING, pieces[: len(pieces) - away], predicted)
    if away:
        scores |= _scores(LEFT_OUT, pieces[-away:], predicted[-away:])
        result = fit(problem, workers, lambda done: progress(0.6 + 0.4 * done), tell, result)
        last = predicted_of(result.scene, pieces, workers, result.sensor)
        scores |= _scores(ALL, pieces, last)
    failures = [
        f"{one.name}: {made.failure}"
        for one, made in zip(pieces, last, strict=True)
        if made.failure
    ]
    for failure in failures:
        tell(f"the fitted scene fails in {failure}; its last good shape counts from there on")
    error, advice = None, ""
    if result.scene.estimates_errors and not failures:
        error, advice = position_error(result.scene, pieces, last, workers, result.sensor)
    shape = {"initial.shape": asked.get("initial.shape", scene.initial.shape)}
    if not any(result.scene.cable.rest_curvature_2):
        shape["cable.rest_curvature_2"] = [0.0]
    return Identified(
        result.scene.with_values(shape),
        result,
        scores,
        [row for one, made in zip(pieces, last, strict=True) for row in reaction(one, made)],
        failures,
        len(pieces),
        away,
        pieces,
        tuple(predicted),
        time.perf_counter() - began,
        error,
        advice,
    )


def _scores(
    title: str, pieces: Sequence[Measurement], predicted: Sequence[Prediction]
) -> dict[str, Score]:
    """Mean score of the pieces under a title; nothing where there are no markers."""
    pairs = zip(pieces, predicted, strict=False)
    scores = [score(recording, made.markers) for recording, made in pairs if recording.markers.size]
    return {title: mean_score(scores)} if scores else {}


def _check_alone(scene: Scene) -> None:
    """Refuse to fit a force to more than one end effector."""
    held = [name for name, holder in scene.holders.items() if holder.held]
    if held != ["start"]:
        raise FitError(
            f"the scene is held by {', '.join(held) or 'nothing'}; a force is fitted where the "
            "start alone holds: set end.fixed to [false, false, false]"
        )


def _chosen(
    unknowns: tuple[Unknown, ...], keys: Sequence[str], asked: Mapping[str, object]
) -> tuple[Unknown, ...]:
    """Those of the keys; by default all but extra ones that nobody has given."""
    known = {one.key for one in unknowns}
    for key in keys:
        if key not in known:
            raise FitError(f"--fit {key} cannot be fitted; give one of {', '.join(sorted(known))}")
    return tuple(
        one
        for one in unknowns
        if (one.key in keys if keys else not one.extra and one.key not in asked)
    )
