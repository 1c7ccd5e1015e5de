"""Recordings from files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import arguments
from dlo_sim.core.npz import NpzRefused, read_npz
from dlo_sim.identification.harness import branch_values
from dlo_sim.identification.measurement import (
    GRIP,
    TANGENT,
    Measurement,
    MeasurementError,
    checked_points,
    clamped_at,
    poses_of_two_markers,
    shares_along,
)
from dlo_sim.scene.nets import MAIN
from dlo_sim.scene.refusal import printable

Array = NDArray[np.float64]
CLAMPED = [0, 1, -2, -1]
# Numbers of a .npz file -> least and most.
RANGES = {"rate_hz": (0.1, 1e5), "length_m": (0.01, 1e3), "mass_g": (1e-3, 1e5)}
NPZ_KEYS = ("pos_um", "rate_hz", "clamped", "length_m", "mass_g")
# Of a harness, whose length and mass need not be known.
HARNESS_KEYS = ("pos_um", "rate_hz", "clamped", "branch", "attached_to")
CONTROL_POINTS = 11  # of the main cable of a harness
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
    `length_m`, `mass_g`; those of a harness with `branch` (M,) and `attached_to` (branches,).
    """
    arrays = _arrays(path)
    try:
        numbers = {key: _number(key, arrays[key]) for key in RANGES if key in arrays}
        markers = _positions(arrays["pos_um"])
        strands, attached = _strands(arrays, markers)
        held = _held(arrays["clamped"], strands[MAIN].shape[2], bool(attached))
        return _pieces(printable(path.stem), strands, attached, held, **numbers)
    except (MeasurementError, TypeError, ValueError) as refusal:
        raise MeasurementError(f"{path}: {refusal}") from None


def _strands(arrays: Mapping[str, Any], markers: Array) -> tuple[dict[str, Array], dict[str, int]]:
    """Markers of the main cable and of each branch, whose first is that where it begins, and which
    marker of the main cable that is.
    """
    if "branch" not in arrays:
        return {MAIN: markers}, {}
    number = arguments.numbers("branch", arrays["branch"], (markers.shape[2],))
    at = arguments.numbers("attached_to", arrays["attached_to"], (None,)).tolist()
    parent = np.flatnonzero(number == 0)
    strands = {MAIN: markers[:, :, parent]}
    attached: dict[str, int] = {}
    given = sorted(set(number.tolist()))
    if not 0 < len(at) <= len(ascii_lowercase) or given != [*range(len(at) + 1)]:
        raise MeasurementError(
            f"branch: holds {given} for {len(at)} branches of attached_to; give each "
            "marker 0, of the main cable, or 1, 2, ... of a branch"
        )
    for k, name in zip(at, ascii_lowercase, strict=False):
        if k not in range(1, len(parent) - 1):
            raise MeasurementError(
                f"attached_to: {k:g} is no marker between others of the main cable, which has "
                f"{len(parent)}; give 1 to {len(parent) - 2}"
            )
        own = np.flatnonzero(number == len(attached) + 1)
        attached[name] = int(k)
        strands[name] = markers[:, :, np.append(parent[int(k)], own)]
    return strands, attached


def _held(clamped: object, count: int, branched: bool) -> dict[str, int]:
    """The first marker of each gripper on the main cable: two are at an end, one between."""
    given = arguments.numbers("clamped", clamped, (None,)).tolist()
    if given == CLAMPED:
        return {"start": 0, "end": count - 2}
    if branched and given[1:] == CLAMPED[2:] and given[0] in range(1, count - 3):
        return {GRIP: int(given[0]), "end": count - 2}
    other = ", or one marker amid a harness and -2, -1" if branched else ""
    raise MeasurementError(f"clamped: {given}; give {CLAMPED}: two markers an end{other}")


def _pieces(
    name: str,
    strands: Mapping[str, Array],
    attached: Mapping[str, int],
    held: Mapping[str, int],
    rate_hz: float,
    length_m: float | None = None,
    mass_g: float | None = None,
) -> list[Measurement]:
    """Recordings of markers [m] on strands, shape (pieces, F, M, 3) each, see `_strands`."""
    main = strands[MAIN]
    first, last = 2 if "start" in held else 0, main.shape[2] - 2
    # The grippers hold the cable midway between their two markers.
    middles = 0.5 * (main[:, :, [0, -2]] + main[:, :, [1, -1]])
    chain = [middles[:, :, : first // 2], main[:, :, first:last], middles[:, :, 1:]]
    times = np.arange(main.shape[1]) / rate_hz
    recordings: list[Measurement] = []
    try:
        length, along = shares_along(np.concatenate(chain, axis=2))
        share = dict(zip(range(first, last), along[first // 2 :].tolist(), strict=False))
        free = [k for k in share if k != held.get(GRIP)]
        known: dict[str, object] = {"cable.length": length}
        if length_m is not None and mass_g is not None:
            known["cable.linear_density"] = 1e-3 * mass_g / length_m
        if attached:
            known |= {"branches.names": [*attached], "terms.twist": "bishop"}
            known["discretization.control_points"] = CONTROL_POINTS
        on, shares, markers = [MAIN] * len(free), [share[k] for k in free], [main[:, :, free]]
        for branch, k in attached.items():
            if k not in free:
                raise MeasurementError(
                    f"branch {branch} begins at marker {k}, on a gripper; leave it out"
                )
            points = strands[branch]
            known |= branch_values(branch, share[k], points, main[:, :, [k - 1, k + 1]])
            markers.append(points[:, :, 1:])
            shares += shares_along(points)[1][1:].tolist()
            on += [branch] * (len(shares) - len(on))
        if GRIP in held:
            known |= {"grasps.names": [GRIP], f"grasps.{GRIP}.at": share[held[GRIP]]}
            known |= {f"grasps.{GRIP}.roll": True, "start.fixed": [False] * 3}
            known |= {"start.clamped": False, "start.pose_topic": "", "start.tangent": [*TANGENT]}
        for piece, free_markers in zip(main, np.concatenate(markers, axis=2), strict=True):
            poses = {
                end: _amid(piece[:, k - 1 : k + 2])
                if end == GRIP
                else poses_of_two_markers(end, piece[:, k], piece[:, k + 1])
                for end, k in held.items()
            }
            recordings.append(
                Measurement(
                    f"{name} piece {len(recordings)}",
                    times,
                    free_markers,
                    poses,
                    np.array(shares),
                    known | clamped_at(poses),
                    counted=main.shape[2] - len(free),
                    strands=tuple(on),
                )
            )
    except MeasurementError as refusal:
        raise MeasurementError(f"pos_um: {refusal}") from None
    if length_m is not None and not length / DOUBT < length_m < length * DOUBT:
        raise MeasurementError(
            f"length_m: {length_m:g} m, but pos_um gives {length:.3g} m along the markers; "
            "correct one of them"
        )
    return recordings


def _amid(markers: Array) -> Array:
    """Poses (F, 7) of a gripper that holds the cable at the second of three markers (F, 3, 3). It
    does not turn, and the cable leaves it as the others say at first: on a recorded harness the
    markers beside it that nothing else holds turned by less than 2 degrees.
    """
    poses = np.repeat(poses_of_two_markers(GRIP, markers[:1, 0], markers[:1, 2]), len(markers), 0)
    poses[:, :3] = markers[:, 1]
    if not np.isfinite(poses).all():
        raise MeasurementError("the marker amid the cable is missing; give it in every frame")
    return poses


def _arrays(path: Path) -> dict[str, Any]:
    """The arrays with the names of `NPZ_KEYS`, or `HARNESS_KEYS`."""
    try:
        arrays = read_npz(path, {*NPZ_KEYS, *HARNESS_KEYS})
    except NpzRefused as refused:
        raise MeasurementError(f"{path}: {refused}; give a .npz file") from None
    keys = HARNESS_KEYS if {"branch", "attached_to"} & set(arrays) else NPZ_KEYS
    missing = [key for key in keys if key not in arrays]
    if missing:
        raise MeasurementError(f"{path}: has no {missing[0]}; it needs {', '.join(keys)}")
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
