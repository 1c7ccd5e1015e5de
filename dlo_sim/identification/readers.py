"""Recordings from files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import arguments
from dlo_sim.core.npz import NpzRefused, read_npz
from dlo_sim.identification.measurement import (
    Measurement,
    MeasurementError,
    checked_points,
    clamped_at,
    poses_of_two_markers,
    shares_along,
)
from dlo_sim.scene.refusal import printable

Array = NDArray[np.float64]
CLAMPED = [0, 1, -2, -1]
# Numbers of a .npz file -> least and most.
RANGES = {"rate_hz": (0.1, 1e5), "length_m": (0.01, 1e3), "mass_g": (1e-3, 1e5)}
NPZ_KEYS = ("pos_um", *RANGES, "clamped")
DOUBT = 2.0  # ratio of `length_m` and the length along the markers from which one is wrong


def read_recordings(
    path: str | os.PathLike[str], topics: Mapping[str, str] | None = None
) -> list[Measurement]:
    """The pieces of motion in a file: `.npz` of markers, or a bag.

    `topics` of a bag: `markers`, `start` and `end`, by default the only ones of their types. Raises
    MeasurementError if there is no such file, or it does not hold that.
    """
    place = Path(path)
    if not place.exists():
        raise MeasurementError(f"{place}: does not exist; give a .npz file or a bag")
    if place.suffix == ".npz":
        return _read_npz(place)
    from dlo_sim.identification.marker_bag import read_marker_bag

    return [read_marker_bag(place, topics or {})]


def _read_npz(path: Path) -> list[Measurement]:
    """Markers of several pieces: `pos_um` [1e-6 m] (pieces, F, M, 3), `rate_hz`, `clamped`,
    `length_m`, `mass_g`.
    """
    arrays = _arrays(path)
    try:
        numbers = {key: _number(key, arrays[key]) for key in RANGES}
        clamped = arguments.numbers("clamped", arrays["clamped"], (None,)).tolist()
        if clamped != CLAMPED:
            raise MeasurementError(f"clamped: {clamped}; give {CLAMPED}: two markers an end")
        return _pieces(printable(path.stem), _positions(arrays["pos_um"]), **numbers)
    except (MeasurementError, TypeError, ValueError) as refusal:
        raise MeasurementError(f"{path}: {refusal}") from None


def _pieces(
    name: str, markers: Array, rate_hz: float, length_m: float, mass_g: float
) -> list[Measurement]:
    """Recordings of markers [m], shape (pieces, F, M, 3)."""
    # The grippers hold the cable midway between their two markers.
    middles = 0.5 * (markers[:, :, [0, -2]] + markers[:, :, [1, -1]])
    chain = np.concatenate([middles[:, :, :1], markers[:, :, 1:-1], middles[:, :, 1:]], axis=2)
    times = np.arange(markers.shape[1]) / rate_hz
    recordings = []
    try:
        length, shares = shares_along(chain)
        for number, piece in enumerate(markers):
            poses = {
                "start": poses_of_two_markers("start", piece[:, 0], piece[:, 1]),
                "end": poses_of_two_markers("end", piece[:, -2], piece[:, -1]),
            }
            mu = 1e-3 * mass_g / length_m
            known = {"cable.length": length, "cable.linear_density": mu, **clamped_at(poses)}
            title, free = f"{name} piece {number}", piece[:, 2:-2]
            recordings.append(
                Measurement(title, times, free, poses, shares[2:-2], known, counted=len(CLAMPED))
            )
    except MeasurementError as refusal:
        raise MeasurementError(f"pos_um: {refusal}") from None
    if not length / DOUBT < length_m < length * DOUBT:
        raise MeasurementError(
            f"length_m: {length_m:g} m, but pos_um gives {length:.3g} m along the markers; "
            "correct one of them"
        )
    return recordings


def _arrays(path: Path) -> dict[str, Any]:
    """The arrays with the names of `NPZ_KEYS`."""
    try:
        arrays = read_npz(path, NPZ_KEYS)
    except NpzRefused as refused:
        raise MeasurementError(f"{path}: {refused}; give a .npz file") from None
    missing = [key for key in NPZ_KEYS if key not in arrays]
    if missing:
        raise MeasurementError(f"{path}: has no {missing[0]}; it needs {', '.join(NPZ_KEYS)}")
    return arrays


def _number(key: str, array: object) -> float:
    """A number within its range."""
    value, (least, most) = arguments.number(key, array), RANGES[key]
    if not least <= value <= most:
        raise MeasurementError(f"{key}: {value:g} is out of range; give {least:g} to {most:g}")
    return value


def _positions(array: object) -> Array:
    """Markers [m], shape (pieces, F, M, 3)."""
    markers = np.asarray(array)
    wanted = "give numbers (pieces, frames, 5 or more, 3), NaN for missing markers"
    if markers.dtype.kind not in "iuf":
        raise MeasurementError(f"pos_um: holds {markers.dtype}; {wanted}")
    if markers.ndim != 4 or 0 in markers.shape or markers.shape[2] < 5 or markers.shape[3] != 3:
        raise MeasurementError(f"pos_um: has shape {markers.shape}; {wanted}")
    return checked_points("pos_um", markers * 1e-6)
