"""Triangle meshes as obstacles: files (read by trimesh), checks, and fields of signed distances."""

from __future__ import annotations

import base64
import io
import json
import math
import os
import stat
import zipfile
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from dlo_sim.engine import distance_field
from dlo_sim.scene.description import Obstacle
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.parameter import IN_TEXT

Array = NDArray[np.float64]
KINDS = "stl", "obj", "ply", "glb", "dae"  # of files; trimesh reads others, archives among them
READ = "STL, OBJ, PLY, GLB or DAE"
MOST_TRIANGLES, MOST_BYTES = 1_000_000, 500_000_000  # of a file
MOST_VALUES = 20_000_000  # of a field: 160 MB, and three times as much while it is made
CHOSEN_VALUES = 1_000_000  # most where the cells are chosen: made in about a second
FEWEST = 48  # cells along the longest side that are chosen
SAME = 1e-6  # share of the extent below which two corners are one
BORDER = 4  # cells of the grid around a mesh, beside the radius of the cable
FINEST = 0.125  # of the radius of the cable: no cell is smaller
CRUMB = 0.1  # of the diameter of the cable: a mesh below that is in the wrong unit
TIME_OF_VALUE = 2e-6  # [s] to make a value of a field; 0.3e-6 to 1.3e-6 are measured
# Triangles and fields that somebody uses, and the last ones that were made.
_used: WeakValueDictionary[tuple[object, ...], Any] = WeakValueDictionary()
_last: deque[object] = deque(maxlen=16)


@dataclass(frozen=True, eq=False)
class Field:
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

    @property
    def cell(self) -> float:
        """Length of a cell [m]."""
        return float(1.0 / self.numbers[distance_field.FINENESS])

    def cells(self, size: float) -> int:
        """Cells of this size [m] along the longest side of the mesh."""
        low, high = self.numbers[distance_field.LOW :][:3], self.numbers[distance_field.HIGH :][:3]
        return math.ceil(float((high - low).max()) / size - 1e-9)

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
        share = np.moveaxis(place - first, -1, 0)
        i, j, k = np.moveaxis(first, -1, 0)
        (x, y, z), (u, v, w) = 1.0 - share, share
        found = np.zeros(points.shape[:-1])
        for a, b, c in np.ndindex(2, 2, 2):
            weight = (u if a else x) * (v if b else y) * (w if c else z)
            found += weight * self.values[i + a, j + b, k + c]
        low, high = n[distance_field.LOW :][:3], n[distance_field.HIGH :][:3]
        box = np.linalg.norm(points - np.clip(points, low, high), axis=-1)
        return np.where(inside, found, box)


def keep_triangles(triangles: Array) -> str:
    """A mesh as the value of `obstacles.<name>.mesh`, in any process: as a text that contains it.

    Args:
        triangles: corners [m], shape (k, 3, 3), closed, in any order and orientation.

    Raises:
        ValueError: not triangles, or not closed, in one line.
    """
    given = np.array(triangles, dtype=float, order="C")
    if given.ndim != 3 or given.shape[1:] != (3, 3):
        raise ValueError(f"triangles: need shape (k, 3, 3), got {given.shape}")
    problem = problem_of(given)
    if problem:
        raise ValueError(f"triangles: {problem}")
    name = IN_TEXT + base64.b64encode(given.tobytes()).decode("ascii")
    _once((name, 1.0), lambda: given)
    return name


def field_of(obstacle: Obstacle, radius: float) -> Field:
    """The field of a mesh that a cable of this radius [m] touches. It is made again only if nobody
    uses it any more.

    Raises:
        SceneError: as `triangles_of`, or as `Grid`.
    """
    triangles, cells = triangles_of(obstacle), obstacle.mesh_cells
    try:
        return _once((*_source(obstacle), cells, radius), lambda: _made(triangles, cells, radius))
    except ValueError as error:
        raise SceneError(f"obstacles.{obstacle.name}.{error}") from None


def time_to_make(obstacle: Obstacle, radius: float) -> float:
    """Time [s] that is allowed for the field of a mesh, the same on every machine.

    Raises:
        SceneError: as `triangles_of`. ValueError: as `Grid`.
    """
    shape = Grid(triangles_of(obstacle), obstacle.mesh_cells, radius).shape
    return TIME_OF_VALUE * math.prod(shape.tolist())


def triangles_of(obstacle: Obstacle) -> Array:
    """The triangles of a mesh in its frame [m], shape (k, 3, 3).

    Raises:
        SceneError: no file, none that is read, or not a closed mesh.
    """
    key = f"obstacles.{obstacle.name}.mesh"
    try:
        return _once(_source(obstacle), lambda: _read(obstacle.mesh) * obstacle.mesh_scale)
    except OSError as error:
        where = error.filename or obstacle.mesh
        raise SceneError(
            f"{key}: {where} cannot be read ({error.strerror or error}); check the path, which is "
            "relative to the scene's file"
        ) from None
    except ValueError as error:
        raise SceneError(f"{key}: {obstacle.mesh:.255}: {error}") from None


def _once(key: tuple[object, ...], make: Callable[[], Any]) -> Any:
    """What is known under a key, made if nobody has it."""
    found = _used.get(key)
    if found is None:
        found = _used[key] = make()
        _last.append(found)
    return found


def _source(obstacle: Obstacle) -> tuple[object, ...]:
    """Where the triangles of a mesh are from: a file as it was when it was changed."""
    name, scale = obstacle.mesh, obstacle.mesh_scale
    if name.startswith(IN_TEXT):
        return name, scale
    status = found_path(name).stat()
    return name, scale, status.st_mtime_ns, status.st_size, status.st_ino


def _read(name: str) -> Array:
    """Triangles of a mesh, checked."""
    if name.startswith(IN_TEXT):
        triangles = np.frombuffer(base64.b64decode(name.removeprefix(IN_TEXT), validate=True))
        if triangles.size % 9:
            raise ValueError("are no triangles; take dlo_sim.simulation.meshes.keep_triangles")
        triangles = triangles.reshape(-1, 3, 3)
    else:
        triangles = read_file(found_path(name))
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
    if kind not in KINDS or kind not in trimesh.available_formats():
        collada = ", or pip install pycollada" if kind == "dae" else ""
        raise ValueError(f"a file '.{kind}' cannot be read here; convert it to {READ}{collada}")
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("is no regular file, and may never end; give a file")
    if status.st_size > MOST_BYTES:
        raise ValueError(f"has {status.st_size} bytes; reduce it to {MOST_BYTES} or fewer")
    content = _plain(path.read_bytes(), kind)
    try:  # `process` would merge corners that are close, and drop those that are not finite
        scene = trimesh.load_scene(io.BytesIO(content), kind, process=False, skip_materials=True)
        bodies = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        count = sum(len(getattr(body, "faces", ())) for body in bodies)
        if count <= MOST_TRIANGLES:
            triangles = np.array(scene.to_mesh().triangles, dtype=float)
    except Exception as error:  # whatever the parser of this kind meets in a damaged file
        problem = f"is no {kind.upper()} file, or a damaged one"
        raise ValueError(f"{problem} ({error!r:.100}); export it again") from None
    if count > MOST_TRIANGLES:
        raise ValueError(f"has {count} triangles; reduce it to {MOST_TRIANGLES} or fewer")
    unit = scene.units
    return triangles if unit is None else triangles * trimesh.units.unit_conversion(unit, "m")


def _plain(content: bytes, kind: str) -> bytes:
    """The content of a mesh file; names and comments of one in text, in whatever encoding, without
    letters beyond ASCII.

    Raises:
        ValueError: an archive, which pycollada would unpack, or data that are not in the file, for
            which trimesh would make room, whatever their size.
    """
    if kind == "dae" and zipfile.is_zipfile(io.BytesIO(content)):
        raise ValueError("is an archive; unpack it")
    if kind == "glb" and not _holds_data(content):
        raise ValueError("does not hold all its data; export it without compression")
    text = kind == "obj" or kind == "ply" and b"format ascii" in content[:1000]
    count = int.from_bytes(content[80:84], "little")
    if kind == "stl" and content and len(content) != 84 + 50 * count:
        text = content.lstrip()[:5].lower() == b"solid"
        if not text:
            said = f"it says {count} triangles, and has {len(content)} bytes"
            raise ValueError(f"is no STL file, or a damaged one ({said}); export it again")
    return content.decode("ascii", "replace").encode("ascii", "replace") if text else content


def _holds_data(content: bytes) -> bool:
    """Whether a GLB file that can be read holds what its accessors name."""
    try:
        tree = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
        return all("bufferView" in one for one in tree["accessors"])
    except (ValueError, LookupError, TypeError):  # the parser of the whole file says what it is
        return True


def found_path(name: str) -> Path:
    """A file, also as file://PATH, or as package://PACKAGE/PATH in the packages that are installed
    in AMENT_PREFIX_PATH.
    """
    if name.startswith("file://"):
        return Path(unquote(urlsplit(name).path))
    if not name.startswith("package://"):
        return Path(os.path.expanduser(name))  # unchanged if there is no such user
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
    low, high = box_of(triangles)
    sides = high - low
    extent = float(sides.max())
    if SAME * extent < np.finfo(float).tiny:
        return "has no extent; export the body again"
    # Corners, edges and faces as whole numbers, of which np.unique is fast.
    x, y, z = np.rint((_columns(triangles) - low[:, None]) / (SAME * extent)).astype(np.int64)
    number = _numbered((x << 40) + (y << 20) + z).reshape(-1, 3)  # each < 2^20
    count = number.size
    ends = np.sort(number[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(ends[:, 0] * count + ends[:, 1], return_counts=True)
    open_ = (uses % 2 == 1) & (edges // count != edges % count)
    if open_.any():
        return (
            f"is not closed: {int(open_.sum())} of {len(edges)} edges have triangles on one side "
            "only; close its holes in the program that made it, or take its convex hull"
        )
    if float(sides.min()) < SAME * extent:
        return "is flat; a sheet needs a thickness"
    faces = np.sort(number, axis=1)
    faces = faces[(faces[:, 0] < faces[:, 1]) & (faces[:, 1] < faces[:, 2])]
    first = _numbered(faces[:, 0] * count + faces[:, 1])
    if 2 * len(np.unique(first * count + faces[:, 2])) <= len(faces):
        return (
            "has every triangle twice, as where both sides of faces are exported, so that nothing "
            "tells what is inside; remove one of each in the program that made it"
        )
    return ""


def box_of(triangles: Array) -> tuple[Array, Array]:
    """Lowest and highest x, y, z of triangles (k, 3, 3) or points (k, 3), (3,) each."""
    columns = _columns(triangles)
    return columns.min(axis=1), columns.max(axis=1)


def _columns(triangles: Array) -> Array:
    """Their x, y and z, shape (3, 3 k), of which numpy is 30 times faster than of short rows."""
    return np.ascontiguousarray(triangles.reshape(-1, 3).T)


def chosen_cells(sides: Array, radius: float) -> int:
    """Cells along the longest side of a mesh with these sides [m]: FEWEST, or as many as make them
    no larger than the radius of the cable [m], as far as CHOSEN_VALUES values do for the grid.
    """
    longest = float(sides.max())
    most = longest / FEWEST
    size = min(radius, most) if radius else most
    while size < most and math.prod(_shape(sides, size, radius).tolist()) > CHOSEN_VALUES:
        size *= 1.05
    return max(math.ceil(longest / size - 1e-9), FEWEST)


def _shape(sides: Array, size: float, radius: float) -> NDArray[np.int64]:
    """Points by axis of the grid around a mesh with these sides, of cells of this size [m]."""
    border = BORDER + int(np.ceil(radius / size))
    return np.asarray(np.ceil(sides / size).astype(int) + 1 + 2 * border)


def _numbered(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """The number of each value among all different ones."""
    return np.asarray(np.unique(values, return_inverse=True)[1])


class Grid:
    """The grid of a field around triangles (k, 3, 3) [m]: `cells` along the longest side of their
    box, 0 = `chosen_cells`, but none smaller than FINEST of the radius [m] of the cable, for which
    there is a border.

    Attributes:
        shape: number of points by axis. numbers: `distance_field.ORIGIN` to HIGH.

    Raises:
        ValueError: a mesh far smaller than the cable is thick, as in the wrong unit, or more than
            MOST_VALUES values; nothing was made.
    """

    def __init__(self, triangles: Array, cells: int, radius: float) -> None:
        low, high = box_of(triangles)
        extent = float((high - low).max())
        if extent < CRUMB * 2.0 * radius:
            raise ValueError(
                f"mesh_scale: a mesh of {extent:.3g} m is a crumb beside a cable "
                f"{2.0 * radius:.3g} m thick; check the unit of its lengths, or leave it out"
            )
        cells = cells or chosen_cells(high - low, radius)
        size = max(extent / cells, FINEST * radius)
        self.shape = _shape(high - low, size, radius)
        if math.prod(self.shape.tolist()) > MOST_VALUES:
            raise ValueError(
                f"mesh_cells: {cells} cells along a mesh of {extent:.3g} m, and as small ones "
                f"around it for a cable {2.0 * radius:.3g} m thick, are too many; give fewer"
            )
        origin = 0.5 * (low + high) - 0.5 * size * (self.shape - 1)
        self.numbers = np.concatenate([origin, [1.0 / size], low, high])


def _made(triangles: Array, cells: int, radius: float) -> Field:
    """The field of triangles on their `Grid`."""
    grid = Grid(triangles, cells, radius)
    corners = np.ascontiguousarray(triangles)
    values, *spare = (np.zeros(grid.shape) for _ in range(3))
    distance_field.make_field(corners.reshape(-1, 9), grid.numbers, values, *spare)
    _sign(values, spare[1])
    field = Field(triangles, values, grid.numbers, _coefficients(values))
    return replace(field, off=float(field.distance(corners.mean(axis=1)).max()))


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
    """Of the tricubic B-spline through values, which ends linearly: (c[i-1] + 4 c[i] + c[i+1]) / 6
    = values[i] along each axis, by elimination, for which a library would take all processors.
    """
    c = values
    for axis, n in enumerate(values.shape):
        c = np.array(np.moveaxis(c, axis, 0), order="C")
        shares = np.zeros(n)
        for i in range(1, n - 1):
            shares[i] = 1.0 / (4.0 - shares[i - 1])
            c[i] = shares[i] * (6.0 * c[i] - c[i - 1])
        for i in range(n - 2, 0, -1):
            c[i] -= shares[i] * c[i + 1]
        c = np.moveaxis(c, 0, axis)
    return np.ascontiguousarray(c)
