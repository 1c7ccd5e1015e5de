"""How far a prediction is from a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.identification.measurement import Recording
from dlo_sim.identification.prediction import Prediction
from dlo_sim.replay.comparison import AxisComparison, compare_reaction

Array = NDArray[np.float64]
SLOW = 0.5  # [s], error that lasts longer is slow


@dataclass(frozen=True)
class Score:
    """Of one recording, in metres.

    Attributes:
        l1: sum over the frames after the first two of the mean |error| of coordinates, by the
            number of all frames; markers on the grippers count with no error.
        distance: mean distance of the free markers.
        bias: mean distance of their mean errors from zero. slow: `l1` of the error averaged over
            SLOW; fast: of the rest.
    """

    l1: float
    distance: float
    bias: float
    slow: float
    fast: float


def score(recording: Recording, predicted: Array) -> Score:
    """Score of predicted markers, shape (F, M, 3), frames 2 and later."""
    error = (predicted - recording.markers)[2:]
    slow = _averaged(error, max(1, round(SLOW / float(np.median(np.diff(recording.times))))))
    return Score(
        _l1(recording, error),
        float(np.nanmean(np.linalg.norm(error, axis=-1))),
        float(np.nanmean(np.linalg.norm(np.nanmean(error, axis=0), axis=-1))),
        _l1(recording, slow),
        _l1(recording, error - slow),
    )


def reaction(recording: Recording, predicted: Prediction) -> list[AxisComparison]:
    """Predicted against measured forces, axis by axis; empty where none were measured."""
    if recording.forces is None:
        return []
    times, known = recording.times, np.isfinite(recording.forces).all(axis=1)
    return compare_reaction(
        times, predicted.forces, times[known], recording.forces[known], sign=1.0
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """The mean of several."""
    rows = np.array([(one.l1, one.distance, one.bias, one.slow, one.fast) for one in scores])
    return Score(*rows.mean(axis=0).tolist())


def _l1(recording: Recording, error: Array) -> float:
    markers = error.shape[1]
    share = markers / (markers + recording.counted) * len(error) / len(recording.times)
    return float(np.nanmean(np.abs(error)) * share)


def _averaged(error: Array, window: int) -> Array:
    """Running mean over so many frames, fewer at both ends."""
    total = np.cumsum(np.nan_to_num(error), axis=0)
    count = np.cumsum(np.isfinite(error), axis=0)
    first = np.arange(len(error)) - window // 2 - 1
    last = np.clip(first + window + 1, 0, len(error) - 1)
    before, inside = np.clip(first, 0, None), (first >= 0)[:, None, None]
    sums = total[last] - np.where(inside, total[before], 0.0)
    counts = count[last] - np.where(inside, count[before], 0)
    return np.asarray(np.where(np.isfinite(error), sums / np.maximum(counts, 1), np.nan))
