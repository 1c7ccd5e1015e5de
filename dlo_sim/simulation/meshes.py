"""Triangle meshes as obstacles: files (read by trimesh), checks, and fields of signed distances."""

from __future__ import annotations

import base64
import hashlib
import math
import os
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from dlo_sim.engine import distance_field
from dlo_sim.scene.description import IN_MEMORY, IN_TEXT, Obstacle, Scene
from dlo_sim.scene.loading import SceneError

Array = NDArray[np.float64]
READ = "STL, OBJ, PLY, GLB or DAE"  # kinds of files that are tested; trimesh reads a few more
MOST_TRIANGLES = 1_000_000
MOST_VALUES = 20_000_000  # of a field: 160 MB, and three times as much while it is made
SAME = 1e-6  # share of the extent below which two corners are one
BORDER = 4  # cells of the grid around a mesh, beside the radius of the cable
_kept: dict[str, Array] = {}


class Field(NamedTuple):
    """Signed distances from a mesh on a grid.

    Attributes:
        triangles: [m], shape (k, 3, 3). values: at the grid points [m], shape (nx, ny, nz).
        numbers: `distance_field.ORIGIN` to HIGH. coefficients: of the tricubic B-spline through the
            values, which ends linearly, of their shape. off: largest distance [m] that it has at
            the middle of a triangle, as where a wall is lost between grid points.
    """

    triangles: Array
    values: Array
    numbers: Array
    coefficients: Array
    off: float = 0.0

    def distance(self, points: Array) -> Array:
        """Signed distances [m] of points (..., 3): between grid points linear, outside of the grid
        that from the box around the mesh.
        """
        n = self.numbers
        place = (points - n[:3]) * n[distance_field.FINENESS]
        most = np.array(self.values.shape) - 2.0
        inside = np.all((place >= 1.0) & (place < most), axis=-1)
        place = np.clip(place, 0.0, most)
        first = place.astype(int)
        share = place - first
        found = np.zeros(points.shape[:-1])
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, share, 1.0 - share), axis=-1)
            found += weight * self.values[tuple(np.moveaxis(first + corner, -1, 0))]
        low, high = n[distance_field.LOW :][:3], n[distance_field.HIGH :][:3]
        box = np.linalg.norm(points - np.clip(points, low, high), axis=-1)
        return np.where(inside, found, box)


def keep_triangles(triangles: Array) -> str:
    """Keep a mesh for `obstacles.<name>.mesh` in this process; returns the value of that key.

    Args:
        triangles: corners [m], shape (k, 3, 3), closed, in any order and orientation.

    Raises:
        ValueError: not triangles, or not closed, in one line.
    """
    given = _checked(triangles)
    name = IN_MEMORY + hashlib.sha256(given.tobytes()).hexdigest()[:16]
    _kept[name] = given
    return name


def kept_of(scene: Scene) -> dict[str, Array]:
    """The triangles that are kept for the obstacles of a scene, for `keep_also`."""
    return {one.mesh: _kept[one.mesh] for one in scene.bodies if one.mesh in _kept}


def keep_also(kept: dict[str, Array]) -> None:
    """Keep what another process keeps, from `kept_of`."""
    _kept.update(kept)


def as_text(triangles: Array) -> str:
    """A mesh as the value of `Obstacle.mesh`, in any process; too long for a file of a scene.

    Args:
        triangles: as of `keep_triangles`.

    Raises:
        ValueError: as `keep_triangles`.
    """
    return IN_TEXT + base64.b64encode(_checked(triangles).tobytes()).decode("ascii")


def _checked(triangles: Array) -> Array:
    given = np.ascontiguousarray(triangles, dtype=float)
    if given.ndim != 3 or given.shape[1:] != (3, 3):
        raise ValueError(f"triangles: need shape (k, 3, 3), got {given.shape}")
    problem = problem_of(given)
    if problem:
        raise ValueError(f"triangles: {problem}")
    return given


def field_of(obstacle: Obstacle, radius: float) -> Field:
    """The field of a mesh that a cable of this radius [m] touches.

    Raises:
        SceneError: as `triangles_of`, or a mesh that is far smaller than the cable is thick.
    """
    triangles = triangles_of(obstacle)
    try:
        return _made(triangles.tobytes(), obstacle.mesh_cells, radius)
    except ValueError as error:
        raise SceneError(f"obstacles.{obstacle.name}.mesh_cells: {error}") from None


def triangles_of(obstacle: Obstacle) -> Array:
    """The triangles of a mesh in its frame [m], shape (k, 3, 3).

    Raises:
        SceneError: no file, none that trimesh reads, or not a closed mesh.
    """
    key = f"obstacles.{obstacle.name}.mesh"
    try:
        triangles = _kept[obstacle.mesh] if obstacle.mesh in _kept else _read(obstacle.mesh)
    except OSError as error:
        where = error.filename or obstacle.mesh
        raise SceneError(
            f"{key}: {where} cannot be read ({error.strerror or error}); check the path, which is "
            "relative to the scene's file"
        ) from None
    except ValueError as error:
        raise SceneError(f"{key}: {obstacle.mesh}: {error}") from None
    return triangles * obstacle.mesh_scale


def _read(name: str) -> Array:
    """Triangles of a mesh file."""
    if name.startswith(IN_TEXT):
        return np.frombuffer(base64.b64decode(name.removeprefix(IN_TEXT))).reshape(-1, 3, 3)
    if name.startswith(IN_MEMORY):
        raise ValueError("these triangles are of another process; give them here again, or a file")
    path = found_path(name)
    stamp = path.stat()
    return _file(path, stamp.st_mtime_ns, stamp.st_size)


@lru_cache(maxsize=64)
def _file(path: Path, changed: int, size: int) -> Array:
    """Triangles of a file as it was when it was changed."""
    triangles = read_file(path)
    problem = problem_of(triangles)
    if problem:
        raise ValueError(problem)
    return triangles


def read_file(path: Path) -> Array:
    """Triangles of all bodies of a file, in its frame [m], shape (k, 3, 3), unchecked: where the
    nodes of its scene place them, with its unit of length (DAE; metres in files that name none). No
    axes are exchanged, and materials are not read.

    Raises:
        OSError: it cannot be read. ValueError: no trimesh, or not of its kind, in one line.
    """
    try:
        import trimesh
    except ModuleNotFoundError:
        raise ValueError(
            "mesh files need trimesh; pip install trimesh, or install dlo_sim with the extra 'mesh'"
        ) from None
    kind = path.suffix.lower().removeprefix(".")
    if kind not in trimesh.available_formats():
        collada = ", or pip install pycollada" if kind == "dae" else ""
        raise ValueError(f"a file '.{kind}' cannot be read here; convert it to {READ}{collada}")
    beside = trimesh.resolvers.FilePathResolver(str(path))
    with path.open("rb") as file:
        try:  # `process` would merge corners that are close, and drop those that are not finite
            scene = trimesh.load_scene(file, kind, beside, process=False, skip_materials=True)
            triangles = np.array(scene.to_mesh().triangles, dtype=float)
        except Exception as error:  # whatever the parser of this kind meets in a damaged file
            problem = f"is no {kind.upper()} file, or a damaged one"
            raise ValueError(f"{problem} ({error!r:.100}); export it again") from None
    if len(triangles) > MOST_TRIANGLES:
        raise ValueError(f"has {len(triangles)} triangles; reduce it to {MOST_TRIANGLES} or fewer")
    unit = scene.units
    return triangles if unit is None else triangles * trimesh.units.unit_conversion(unit, "m")


def found_path(name: str) -> Path:
    """A file, also as file://PATH, or as package://PACKAGE/PATH in the packages that are installed
    in AMENT_PREFIX_PATH.
    """
    if name.startswith("file://"):
        return Path(unquote(urlsplit(name).path))
    if not name.startswith("package://"):
        return Path(name).expanduser()
    package, _, inside = name.removeprefix("package://").partition("/")
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    for prefix in prefixes:
        if (prefix / "share" / package).is_dir():
            return prefix / "share" / package / inside
    raise ValueError("this package is not installed, or its workspace is not sourced")


def problem_of(triangles: Array) -> str:
    """Why triangles are no closed mesh, with the cure, or an empty line."""
    if not len(triangles):
        return "has no triangles; export the body again"
    if not np.isfinite(triangles).all():
        return "has a corner that is not finite; export the body again"
    points = triangles.reshape(-1, 3)
    extent = float(np.ptp(points, axis=0).max())
    if extent <= 0.0:
        return "has no extent; export the body again"
    _, number = np.unique(np.round(points / (SAME * extent)), axis=0, return_inverse=True)
    ends = number.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, uses = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    open_ = (uses % 2 == 1) & (edges[:, 0] != edges[:, 1])
    if open_.any():
        return (
            f"is not closed: {int(open_.sum())} of {len(edges)} edges have triangles on one side "
            "only; close its holes in the program that made it, or take its convex hull"
        )
    if float(np.ptp(points, axis=0).min()) < SAME * extent:
        return "is flat; a sheet needs a thickness"
    faces = np.sort(number.reshape(-1, 3), axis=1)
    faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
    if 2 * len(np.unique(faces, axis=0)) <= len(faces):
        return (
            "has every triangle twice, as where both sides of faces are exported, so that nothing "
            "tells what is inside; remove one of each in the program that made it"
        )
    return ""


@lru_cache(maxsize=16)
def _made(triangles: bytes, cells: int, radius: float) -> Field:
    """The field of triangles, with this number of cells along the longest side.

    Raises:
        ValueError: it has more than MOST_VALUES values, as around a mesh in the wrong unit.
    """
    corners = np.frombuffer(triangles).reshape(-1, 3, 3).copy()
    points = corners.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max()) / cells
    border = BORDER + int(np.ceil(radius / size))
    shape = np.ceil((high - low) / size).astype(int) + 1 + 2 * border
    if math.prod(shape.tolist()) > MOST_VALUES:
        raise ValueError(
            f"{cells} cells along a mesh of {size * cells:.3g} m, and as small ones around it for "
            f"a cable {2.0 * radius:.3g} m thick, are too many; check mesh_scale, or give fewer"
        )
    origin = 0.5 * (low + high) - 0.5 * size * (shape - 1)
    numbers = np.concatenate([origin, [1.0 / size], low, high])
    values, *spare = (np.zeros(shape) for _ in range(3))
    distance_field.make_field(corners.reshape(-1, 9), numbers, values, *spare)
    _sign(values, spare[1])
    field = Field(corners, values, numbers, _coefficients(values))
    return field._replace(off=float(field.distance(corners.mean(axis=1)).max()))


def _sign(distances: Array, crossings: Array) -> None:
    """Make the distances inside negative, overwriting both arrays.

    A ray along x has entered so many more surfaces than it left. It is inside of one of several
    bodies, which may overlap, where that is not 0. A ray that does not end with 0 met triangles
    that are not oriented alike: it is inside after an odd number of crossings.
    """
    within = np.cumsum(crossings, axis=0, out=crossings)
    inside = np.where(within[-1] == 0.0, within != 0.0, within % 2.0 == 1.0)
    np.negative(distances, out=distances, where=inside)


def _coefficients(values: Array) -> Array:
    """Of the tricubic B-spline through values, which ends linearly."""
    c = values
    for axis, n in enumerate(c.shape):
        through = np.diag(np.full(n, 2.0 / 3.0))
        through += (np.eye(n, k=1) + np.eye(n, k=-1)) / 6.0
        through[[0, -1]] = np.eye(n)[[0, -1]]
        c = np.moveaxis(np.tensordot(np.linalg.inv(through), c, (1, axis)), 0, axis)
    return np.ascontiguousarray(c)
