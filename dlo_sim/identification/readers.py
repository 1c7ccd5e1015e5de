"""Recordings from files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from dlo_sim.identification.measurement import (
    MeasurementError,
    Recording,
    clamped_at,
    poses_of_two_markers,
    shares_along,
)

Array = NDArray[np.float64]
NPZ_KEYS = ("pos_um", "rate_hz", "clamped", "length_m", "mass_g")


def read_recordings(
    path: str | os.PathLike[str], topics: Mapping[str, str] | None = None
) -> list[Recording]:
    """The pieces of motion in a file: `.npz` of markers, or a bag.

    Args:
        topics: of a bag, `markers`, `start` and `end`: by default the only ones of their types.

    Raises:
        MeasurementError: there is no such file, or it does not hold that.
    """
    place = Path(path)
    if not place.exists():
        raise MeasurementError(f"{place}: does not exist; give a .npz file or a bag")
    if place.suffix == ".npz":
        return _read_npz(place)
    from dlo_sim.identification.marker_bag import read_marker_bag

    return [read_marker_bag(place, topics or {})]


def _read_npz(path: Path) -> list[Recording]:
    """Markers of several pieces: `pos_um` [1e-6 m] (pieces, F, M, 3), `rate_hz`, `clamped` (the two
    first and two last markers), `length_m`, `mass_g`.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            given = {key: data[key] for key in NPZ_KEYS if key in data}
    except (OSError, ValueError, BadZipFile) as trouble:
        raise MeasurementError(f"{path}: cannot be read ({trouble}); give a .npz file") from None
    missing = [key for key in NPZ_KEYS if key not in given]
    if missing:
        raise MeasurementError(f"{path}: has no {missing[0]}; it needs {', '.join(NPZ_KEYS)}")
    markers = given["pos_um"] * 1e-6
    if markers.ndim != 4 or markers.shape[2] < 5 or markers.shape[3] != 3:
        raise MeasurementError(
            f"{path}: pos_um has shape {markers.shape}; give (pieces, frames, 5 or more, 3)"
        )
    if list(given["clamped"]) != [0, 1, -2, -1]:
        raise MeasurementError(
            f"{path}: clamped is {list(given['clamped'])}; give 0, 1, -2, -1: two markers an end"
        )
    mu = float(given["mass_g"]) * 1e-3 / float(given["length_m"])
    # The grippers hold the cable midway between their two markers.
    middles = 0.5 * (markers[:, :, [0, -2]] + markers[:, :, [1, -1]])
    chain = np.concatenate([middles[:, :, :1], markers[:, :, 1:-1], middles[:, :, 1:]], axis=2)
    length, shares = shares_along(chain)
    times = np.arange(markers.shape[1]) / float(given["rate_hz"])
    recordings = []
    for number, piece in enumerate(markers):
        poses = {
            "start": poses_of_two_markers("start", piece[:, 0], piece[:, 1]),
            "end": poses_of_two_markers("end", piece[:, -2], piece[:, -1]),
        }
        known = {"cable.length": length, "cable.linear_density": mu, **clamped_at(poses)}
        free = piece[:, 2:-2]
        recordings.append(
            Recording(
                f"{path.stem} piece {number}", times, free, poses, shares[2:-2], known, counted=4
            )
        )
    return recordings
