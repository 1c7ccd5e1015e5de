"""From recordings to a scene: a fit that is checked on pieces it did not see, then one of all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.identification.fit import Fit, FitError, Progress, fit
from dlo_sim.identification.measurement import START_FRAMES, Recording
from dlo_sim.identification.prediction import COMPUTATION, predicted_of
from dlo_sim.identification.problem import Problem, Unknown, prepared, unknowns_of
from dlo_sim.identification.scores import Score, mean_score, score
from dlo_sim.scene.description import Scene

Array = NDArray[np.float64]
TRAINING, LEFT_OUT, ALL = "training pieces", "left-out pieces", "all pieces, fitted to all"


@dataclass(frozen=True)
class Identified:
    """What came of an identification.

    Attributes:
        scene: with the numbers fitted to all pieces. fit: of all pieces.
        scores: of the training and the left-out pieces with the numbers of the first fit, and of
            all pieces with those of the last.
        pieces: number of pieces. left_out: of them not seen by the first fit.
        recordings, predicted: all pieces and their markers with the first fit.
        seconds: it took.
    """

    scene: Scene
    fit: Fit
    scores: dict[str, Score]
    pieces: int
    left_out: int
    recordings: tuple[Recording, ...]
    predicted: tuple[Array, ...]
    seconds: float


def identify(
    scene: Scene,
    asked: Mapping[str, object],
    recordings: Sequence[Recording],
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
        keys: to fit, all if empty. left_out: share of the pieces. piece: their duration [s].
        progress, tell: as in `fit`.

    Raises:
        FitError: keys that cannot be fitted, or no scipy. SceneError: an impossible scene.
    """
    began = time.perf_counter()
    pieces = tuple(part for one in recordings for part in one.pieces(piece))
    given = {**COMPUTATION, **recordings[0].known, **asked}
    base = prepared(scene.with_values(given))
    problem = Problem(base, _chosen(unknowns_of(base), keys, asked), pieces, START_FRAMES)
    away = int(left_out * len(pieces))
    first = replace(problem, recordings=pieces[: len(pieces) - away])
    found = fit(first, workers, lambda share: progress(0.6 * share if away else share), tell)
    predicted = predicted_of(found.scene, pieces, workers)
    scores = {TRAINING: _score(pieces[: len(pieces) - away], predicted)}
    if away:
        scores[LEFT_OUT] = _score(pieces[-away:], predicted[-away:])
        found = fit(problem, workers, lambda share: progress(0.6 + 0.4 * share), tell, found)
        scores[ALL] = _score(pieces, predicted_of(found.scene, pieces, workers))
    shape = {"initial.shape": asked.get("initial.shape", scene.initial.shape)}
    return Identified(
        found.scene.with_values(shape),
        found,
        scores,
        len(pieces),
        away,
        pieces,
        tuple(predicted),
        time.perf_counter() - began,
    )


def _score(pieces: Sequence[Recording], predicted: Sequence[Array]) -> Score:
    return mean_score([score(*both) for both in zip(pieces, predicted, strict=False)])


def _chosen(
    unknowns: tuple[Unknown, ...], keys: Sequence[str], asked: Mapping[str, object]
) -> tuple[Unknown, ...]:
    """Those of the keys; by default all that nobody has given."""
    known = {one.key for one in unknowns}
    for key in keys:
        if key not in known:
            raise FitError(f"--fit {key} cannot be fitted; give one of {', '.join(sorted(known))}")
    return tuple(one for one in unknowns if (one.key in keys if keys else one.key not in asked))
