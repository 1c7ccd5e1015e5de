"""A recorded cable: markers on it, and the end effectors that hold it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.two_points import poses_of_two_points
from dlo_sim.scene.description import Scene
from dlo_sim.scene.nets import MAIN
from dlo_sim.scene.refusal import Refusal
from dlo_sim.session.gripper_path import Pose, SmoothedPoses

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
START_FRAMES = 2  # from which the simulation of a recording starts
LEAST_FRAMES = START_FRAMES + 1
DIFFERENCE = 4  # order of the differences of frames that are noise and no motion
NORMAL_MEDIAN = 0.6745  # of |x|, x normal
FARTHEST = 1e4  # [m] of a marker from the origin
GRIP = "grip"  # name of a gripper between the ends
# Direction of the cable in the frame of a gripper with two markers, and the orientation of that
# frame where the cable leaves the start straight down and comes up to the end (y of the world).
TANGENT = (-1.0, 0.0, 0.0)
_HANGING = {
    **dict.fromkeys(("start", GRIP), ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))),
    "end": ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
}


class MeasurementError(Refusal):
    """Data that cannot be read: one line that names the file, the value and the cure."""


@dataclass(frozen=True)
class Measurement:
    """One piece of motion.

    Attributes:
        name: for people. times: of the frames [s], rising from 0, shape (F,).
        markers: on the free cable, from start to end [m], NaN where missing, shape (F, M, 3).
        poses: holder -> position [m] and quaternion x, y, z, w of its end effector, shape (F, 7).
        shares: material coordinates of the markers as fractions of the length of their strand,
            shape (M,).
        known: scene key -> value that the data give.
        counted: number of markers on the grippers, which the mean of an error counts with none.
        forces: load of the cable on the end effectors [N], shape (F, 3); None where not measured.
            Such a recording starts from rest.
        strands: name of the strand that each marker is on, M; by default the main cable.

    Raises:
        MeasurementError: too few frames, times that do not rise, or no marker to start from.
    """

    name: str
    times: Array
    markers: Array
    poses: Mapping[str, Array]
    shares: Array
    known: Mapping[str, Any] = field(default_factory=dict)
    counted: int = 0
    forces: Array | None = None
    strands: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.times)
        if count < LEAST_FRAMES:
            raise MeasurementError(f"{self.name}: {count} frames; give {LEAST_FRAMES} or more")
        if not np.isfinite(self.times).all() or not np.all(np.diff(self.times) > 0.0):
            raise MeasurementError(f"{self.name}: the times do not rise; give each frame its own")
        seen = np.isfinite(self.markers[:START_FRAMES]).all(axis=-1).any()
        if self.forces is None and not seen:
            raise MeasurementError(
                f"{self.name}: no marker is known in the first {START_FRAMES} frames, from which "
                "the simulation starts; leave out these frames, or cut other pieces by --piece"
            )

    def pieces(self, duration: float) -> list[Measurement]:
        """Parts of about this duration [s] and at least `LEAST_FRAMES`, each from time 0; not of
        forces.
        """
        if self.forces is not None:
            return [self]
        count = max(1, min(round(self.duration / duration), len(self.times) // LEAST_FRAMES))
        edges = np.linspace(0, len(self.times), count + 1).astype(int)
        return [self._part(*part, count) for part in itertools.pairwise(edges)]

    def _part(self, first: int, last: int, count: int) -> Measurement:
        if count == 1:
            return self
        start = self.times[first]
        return replace(
            self,
            name=f"{self.name} from {start:.3g} s",
            times=self.times[first:last] - start,
            markers=self.markers[first:last],
            poses={end: path[first:last] for end, path in self.poses.items()},
        )

    def disturbed(self, rng: np.random.Generator) -> Measurement:
        """With noise on the first markers, as large as that of all frames, which is estimated from
        the differences between five successive known ones.
        """
        paths = self.markers.reshape(len(self.times), -1).T
        known = [path[np.isfinite(path)] for path in paths]  # coordinates of frames that are there
        order = min(DIFFERENCE, len(self.times) - 1)
        spread = math.sqrt(math.comb(2 * order, order))
        apart = np.concatenate([np.abs(np.diff(path, order)) / spread for path in known])
        markers = self.markers.copy()
        noise = float(np.median(apart)) / NORMAL_MEDIAN if apart.size else 0.0
        first = markers[:START_FRAMES]
        first += rng.normal(0.0, noise, first.shape)
        return replace(self, markers=markers)

    def ends_at(self, frame: int) -> dict[str, tuple[Array, Array]]:
        """Position [m] and orientation of each end effector in a frame."""
        return {end: (path[frame, :3], path[frame, 3:]) for end, path in self.poses.items()}

    def smoothed(self, scene: Scene) -> Measurement:
        """With the poses as `pose_smoothing` of the scene's ends has them."""
        half = {end: round(1e9 * scene.holders[end].pose_smoothing) for end in self.poses}
        paths = {end: _smoothed(self.times, path, half[end]) for end, path in self.poses.items()}
        return replace(self, poses=paths)

    def rolled(self, angles: Mapping[str, float]) -> Measurement:
        """With end effectors turned about the cable [rad]."""
        paths = {
            end: np.hstack([path[:, :3], rolled(path[:, 3:], angles.get(end, 0.0))])
            for end, path in self.poses.items()
        }
        return replace(self, poses=paths)

    def on(self, strand: str) -> Mask:
        """Which markers are on a strand, shape (M,)."""
        return np.array([one == strand for one in self.strands or [MAIN] * len(self.shares)], bool)

    @property
    def along(self) -> Array:
        """Where each marker, or the branch that it is on, is on the main cable, 0 to 1, (M,)."""
        at = self.shares.copy()
        for strand in set(self.strands) - {MAIN}:
            at[self.on(strand)] = self.known[f"branches.{strand}.at"]
        return at

    @property
    def held_at(self) -> dict[str, float]:
        """Where the end effectors hold the main cable, 0 to 1."""
        places = {"start": 0.0, "end": 1.0}
        return {
            end: places[end] if end in places else self.known[f"grasps.{end}.at"]
            for end in self.poses
        }

    @property
    def duration(self) -> float:
        """From the first frame to the last [s]."""
        return float(self.times[-1])


def _smoothed(times: Array, path: Array, half_window_ns: int) -> Array:
    waiting = SmoothedPoses(half_window_ns, round(2e9 * times[-1]), len(times))
    for time, (x, y, z, *turn) in zip(times.tolist(), path.tolist(), strict=True):
        a, b, c, d = turn
        waiting.add(Pose(round(1e9 * time), (x, y, z), (a, b, c, d)))
    waiting.settle()
    smoothed = [waiting.take() for _ in times]
    return np.array([(*pose.position, *pose.orientation) for pose in smoothed])


def rolled(orientations: Array, angle: float) -> Array:
    """Quaternions (F, 4) of grippers, turned about the cable [rad]."""
    turn = rotations.from_rotation_vector(angle * np.array(TANGENT))
    return rotations.multiply(orientations, np.tile(turn, (len(orientations), 1)))


def checked_points(name: str, points: Array) -> Array:
    """Measured points, NaN allowed; MeasurementError if infinite or beyond `FARTHEST`."""
    farthest = np.nanmax(np.abs(points), initial=0.0)
    if farthest > FARTHEST:
        raise MeasurementError(
            f"{name}: {farthest:g} m is no place of a marker; give at most {FARTHEST:g} m, and NaN "
            "for missing ones"
        )
    return points


def poses_of_two_markers(end: str, first: Array, second: Array) -> Array:
    """Poses (F, 7) of a gripper that holds the cable midway between two markers (F, 3).

    The x axis points from the second to the first; the frame turns by the least rotation. Raises
    MeasurementError if a marker is missing, or both are at the same place.
    """
    distance = np.linalg.norm(second - first, axis=1, keepdims=True)
    if not np.all(distance > 0.0):
        worst = int(np.argmin(distance[:, 0] > 0.0))
        raise MeasurementError(
            f"the markers on the gripper of the {end} are missing or at the same place in frame "
            f"{worst}; give two apart in every frame"
        )
    x, y, z, w = rotations.from_matrix(np.array(_HANGING[end]).T).tolist()
    points = np.stack([first, second], axis=1)
    return poses_of_two_points(points, (x, y, z, w), body=(-1.0, 0.0, 0.0))


def shares_along(points: Array) -> tuple[float, Array]:
    """Length [m] of points (..., M, 3), by the medians of the distances between neighbours, and the
    fraction of it at which each point is, shape (M,).

    Raises MeasurementError for neighbours that are never known together, or at the same place.
    """
    edges = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    edges = edges.reshape(-1, edges.shape[-1])
    apart = (edges > 0.0).any(axis=0)
    if not apart.all():
        first = int(np.argmin(apart))
        raise MeasurementError(
            f"points {first} and {first + 1} along the cable, grippers counted, are in no frame "
            "both known and apart; leave one of them out"
        )
    along = np.cumsum(np.nanmedian(edges, axis=0))
    return float(along[-1]), np.concatenate([[0.0], along / along[-1]])


def clamped_at(ends: Mapping[str, Array]) -> dict[str, object]:
    """Scene values of holders that clamp the cable at the first of their poses."""
    values: dict[str, object] = {}
    for end, poses in ends.items():
        key = f"grasps.{end}" if end == GRIP else end
        values |= {
            f"{key}.fixed": [True, True, True],
            f"{key}.clamped": True,
            f"{key}.tangent": list(TANGENT),
            f"{key}.position": poses[0, :3].tolist(),
            f"{key}.offset": [0.0, 0.0, 0.0],
        }
    return values
