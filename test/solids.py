"""Solids as triangles, counter-clockwise seen from outside, shape (k, 3, 3)."""

from typing import Any

import numpy as np


def turned(meridian, around):
    """The solid of revolution about z of a meridian (rho, z) from one point of the axis to another,
    from bottom to top.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    rho, z = np.asarray(meridian, dtype=float).T
    rings = np.stack(
        [np.outer(rho, np.cos(angle)), np.outer(rho, np.sin(angle)), np.outer(z, np.ones(around))],
        axis=2,
    )
    low, high = rings[:-1], rings[1:]
    after, beyond = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    halves = (np.stack(three, axis=2) for three in ((low, after, high), (after, beyond, high)))
    triangles = np.concatenate([half.reshape(-1, 3, 3) for half in halves])
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return triangles[np.linalg.norm(areas, axis=1) > 1e-12 * np.ptp(triangles) ** 2]


def sphere(radius, across):
    polar = np.linspace(0.0, np.pi, across + 1)
    meridian = radius * np.stack([np.sin(polar), -np.cos(polar)], axis=1)
    meridian[[0, -1], 0] = 0.0
    return turned(meridian, 2 * across)


def cylinder(diameter, length, around):
    radius, half = 0.5 * diameter, 0.5 * length
    return turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)], around)


def box(x, y, z):
    corners = turned([(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)], 4)
    turn = np.sqrt(0.5) * np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]])
    return corners @ turn * [x / np.sqrt(2.0), y / np.sqrt(2.0), z]


def plate(side, hole, thick):
    """A square plate normal to x with a square hole in its middle."""
    square = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    wide, narrow, half = side * square, hole * square, 0.5 * thick
    triangles = []
    for k in range(4):
        j = (k + 1) % 4
        for a, b, c, d in (
            ((half, *wide[k]), (half, *wide[j]), (half, *narrow[j]), (half, *narrow[k])),
            ((-half, *wide[j]), (-half, *wide[k]), (-half, *narrow[k]), (-half, *narrow[j])),
            ((-half, *wide[k]), (-half, *wide[j]), (half, *wide[j]), (half, *wide[k])),
            ((-half, *narrow[j]), (-half, *narrow[k]), (half, *narrow[k]), (half, *narrow[j])),
        ):
            triangles += [(a, b, c), (a, c, d)]
    return np.array(triangles)


def binary_stl(triangles):
    """The content of a binary STL file."""
    records = np.zeros(len(triangles), [("n", "<f4", 3), ("corners", "<f4", (3, 3)), ("a", "<u2")])
    records["corners"] = triangles
    return bytes(80) + len(triangles).to_bytes(4, "little") + records.tobytes()


def ascii_stl(triangles):
    """The content of an ASCII STL file."""
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in np.asarray(triangles).tolist()
    ]
    return f"solid body\n{''.join(facets)}endsolid body\n".encode()


def files(triangles, kind, *places):
    """The content of a file of any kind, of one body at each place (4, 4) if there are some."""
    import trimesh

    body = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False)
    scene = trimesh.Scene()
    for place in places:
        scene.add_geometry(body, geom_name="body", transform=place)
    content: Any = (scene if places else body).export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()
