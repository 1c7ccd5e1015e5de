"""A predicted reaction against a recorded force: how alike, how far off, how late."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LONGEST_LAG = 0.15  # s, either way
_LAG_STEP = 1e-3  # s

# Below this spread [N] an axis is at rest and has no correlation.
_AT_REST = 1e-6


class ForceSeries:
    """Times and forces being collected."""

    def __init__(self, end: str) -> None:
        self.end = end
        self.frames: set[str] = set()
        self._times: list[int] = []
        self._forces: list[object] = []

    def add(self, stamp_ns: int, force: object) -> None:
        """Append a sample; one that is not newer than the last replaces nothing and is left out."""
        if not self._times or stamp_ns > self._times[-1]:
            self._times.append(stamp_ns)
            self._forces.append(force)

    def arrays(self) -> tuple[Array, Array]:
        """Times [s], shape (n,), and forces [N], shape (n, 3)."""
        return np.array(self._times, dtype=float) * 1e-9, np.array(
            self._forces, dtype=float
        ).reshape(-1, 3)


@dataclass(frozen=True)
class AxisComparison:
    """One axis of a predicted force against the measured one, world frame.

    Attributes:
        axis: x, y or z. samples: measured samples compared.
        correlation: Pearson's, at the recorded times; NaN if either side is constant.
        rms_error, bias: root mean square and mean of predicted - measured [N].
        rms_measured, spread_measured: root mean square and standard deviation of the measured force
            [N]; a prediction is better than a constant if its error is below the latter.
        lag: delay of the prediction [s] that correlates best, within +-0.15 s; positive = the
            measurement is later. lag_correlation, lag_rms_error [N]: at that delay.
    """

    axis: str
    samples: int
    correlation: float
    rms_error: float
    bias: float
    rms_measured: float
    spread_measured: float
    lag: float
    lag_correlation: float
    lag_rms_error: float


def compare_reaction(
    predicted_times: ArrayLike,
    predicted_force: ArrayLike,
    measured_times: ArrayLike,
    measured_force: ArrayLike,
    sign: float = -1.0,
) -> list[AxisComparison]:
    """Compare axis by axis at the measured times that the prediction covers at every lag.

    Args:
        predicted_times, measured_times: increasing [s], shapes (n,), (m,).
        predicted_force: [N], shape (n, 3), load ON THE CABLE BY the end effector.
        measured_force: [N], shape (m, 3), same axes.
        sign: of the measurement; -1 for a sensor that reads the load of the cable ON THE ROBOT.

    Raises:
        ValueError: fewer than three measured samples overlap the prediction (names both spans).
    """
    times, force = np.asarray(predicted_times, float), np.asarray(predicted_force, float)
    at, measured = np.asarray(measured_times, float), sign * np.asarray(measured_force, float)
    if len(times) < 2 or len(at) < 3:
        raise ValueError(
            f"{len(times)} predicted and {len(at)} measured samples are too few to compare"
        )
    inside = (at >= times[0]) & (at <= times[-1])
    if np.count_nonzero(inside) < 3:
        raise ValueError(
            f"prediction ({times[0]:.3f} to {times[-1]:.3f} s) and measurement "
            f"({at[0]:.3f} to {at[-1]:.3f} s) do not overlap"
        )
    rows = []
    for k, axis in enumerate("xyz"):
        predicted = np.interp(at[inside], times, force[:, k])
        recorded = measured[inside, k]
        error = predicted - recorded
        lag, lag_correlation, lag_rms = _best_lag(times, force[:, k], at[inside], recorded)
        rows.append(
            AxisComparison(
                axis=axis,
                samples=int(np.count_nonzero(inside)),
                correlation=_correlation(predicted, recorded),
                rms_error=_rms(error),
                bias=float(error.mean()),
                rms_measured=_rms(recorded),
                spread_measured=float(recorded.std()),
                lag=lag,
                lag_correlation=lag_correlation,
                lag_rms_error=lag_rms,
            )
        )
    return rows


def comparison_table(rows_by_end: Mapping[str, Sequence[AxisComparison]]) -> str:
    """The rows as a text table, without a trailing newline."""
    lines = [
        f"{'reaction':<9} {'axis':<4} {'corr':>6} {'rms error':>10} {'bias':>8} {'rms meas.':>10} "
        f"{'spread':>8} {'best lag':>9} {'corr there':>10} {'rms there':>10}"
    ]
    lines += [
        f"{end:<9} {r.axis:<4} {_number(r.correlation, 6)} {r.rms_error:>8.3f} N {r.bias:>6.3f} N "
        f"{r.rms_measured:>8.3f} N {r.spread_measured:>6.3f} N {_number(1e3 * r.lag, 6, 0)} ms "
        f"{_number(r.lag_correlation, 10)} {_number(r.lag_rms_error, 8)} N"
        for end, rows in rows_by_end.items()
        for r in rows
    ]
    return "\n".join(lines)


def _best_lag(times: Array, force: Array, at: Array, recorded: Array) -> tuple[float, float, float]:
    """Delay of the prediction with the largest correlation, that correlation, and its rms error."""
    reach = min(LONGEST_LAG, 0.25 * (at[-1] - at[0]))
    inner = (at - reach >= times[0]) & (at + reach <= times[-1])
    if np.count_nonzero(inner) < 3:
        return math.nan, math.nan, math.nan
    at, recorded = at[inner], recorded[inner]
    count = round(reach / _LAG_STEP)
    best = (math.nan, -math.inf, math.nan)
    for lag in np.arange(-count, count + 1) * _LAG_STEP:
        predicted = np.interp(at - lag, times, force)
        correlation = _correlation(predicted, recorded)
        if math.isnan(correlation):
            return math.nan, math.nan, math.nan
        if correlation > best[1]:
            best = (float(lag), correlation, _rms(predicted - recorded))
    return best


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    spread = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / spread if spread > _AT_REST**2 * len(a) else math.nan


def _rms(values: Array) -> float:
    return math.sqrt(float(values @ values) / len(values))


def _number(value: float, width: int, digits: int = 3) -> str:
    return f"{'-':>{width}}" if math.isnan(value) else f"{value:>{width}.{digits}f}"
