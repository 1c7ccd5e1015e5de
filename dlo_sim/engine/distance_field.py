"""Signed distance from a triangle mesh: a field that is made once on a grid, and looked up there.

**Making.** The distance of a grid point is that from the nearest triangle, searched for around
every triangle, and then among the nearest triangles of neighbouring points, in sweeps over the grid
(the idea of fast sweeping). Rays along x tell what is inside; they run a little beside the grid
lines, so that they meet no edge.

**Looking up.** The field is a tricubic B-spline, so that the distance, its gradient and its
curvature are continuous. Edges and walls thinner than two cells are rounded by about a cell.
Where a cable is further from the box around the mesh than it reaches, the distance is that from the
box, which is no more than that from the mesh.
"""

from __future__ import annotations

import numpy as np
from numba import void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, ARRAY_3D, inline, kernel
from dlo_sim.compiling.lanes import LANES, any_above, lane, sqrt, where, zero

# Numbers of the field of an obstacle: first grid point (3) [m], cells per length [1/m], corners of
# the box around the mesh (6) [m].
ORIGIN, FINENESS, LOW, HIGH, FIELD_SIZE = 0, 3, 4, 7, 10
NEAR = 2  # cells around a triangle in which all distances from it are computed
SWEEPS = 2  # in each of the eight directions
BESIDE = 1.3e-5, 2.9e-5  # of a cell: how far rays are beside the grid lines
FAR = 1e30  # [m^2]
# Cells by which a coefficient at the nearest grid point may exceed the distance of a point: 0.87
# for the way between them, the rest since coefficients are not values.
ROUGH = 1.6
TINY = 1e-30


@inline
def square_from(p0, p1, p2, corners):
    """Squared distance of a point from a triangle with corners (9,)."""
    u0, u1, u2 = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    v0, v1, v2 = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    size = n0 * n0 + n1 * n1 + n2 * n2
    least, inside = FAR, size > 0.0
    for k in range(3):
        a, b = 3 * k, 3 * ((k + 1) % 3)
        e0, e1 = corners[b] - corners[a], corners[b + 1] - corners[a + 1]
        e2 = corners[b + 2] - corners[a + 2]
        w0, w1, w2 = p0 - corners[a], p1 - corners[a + 1], p2 - corners[a + 2]
        length = e0 * e0 + e1 * e1 + e2 * e2
        share = (w0 * e0 + w1 * e1 + w2 * e2) / length if length > 0.0 else 0.0
        share = min(max(share, 0.0), 1.0)
        c0, c1, c2 = e1 * w2 - e2 * w1, e2 * w0 - e0 * w2, e0 * w1 - e1 * w0
        inside = inside and c0 * n0 + c1 * n1 + c2 * n2 >= 0.0
        w0, w1, w2 = w0 - share * e0, w1 - share * e1, w2 - share * e2
        least = min(least, w0 * w0 + w1 * w1 + w2 * w2)
        if k == 2 and inside:
            high = w0 * n0 + w1 * n1 + w2 * n2
            least = min(least, high * high / size)
    return least


@inline
def side_of(a1, a2, b1, b2, y, z):
    """Twice the area of the triangle a, b, (y, z) in the plane x = 0, exactly opposite for b, a."""
    if (a1, a2) < (b1, b2):
        return (b1 - a1) * (z - a2) - (b2 - a2) * (y - a1)
    return -((a1 - b1) * (z - b2) - (a2 - b2) * (y - b1))


@inline
def cross_rays(corners, numbers, crossings):
    """Count, at the first grid point behind it, where rays along x meet a triangle: 1 or, seen from
    its other side, -1.
    """
    h = 1.0 / numbers[FINENESS]
    y0, z0 = numbers[ORIGIN + 1] + BESIDE[0] * h, numbers[ORIGIN + 2] + BESIDE[1] * h
    low_y = min(corners[1], corners[4], corners[7])
    high_y = max(corners[1], corners[4], corners[7])
    low_z = min(corners[2], corners[5], corners[8])
    high_z = max(corners[2], corners[5], corners[8])
    for j in range(max(int(np.ceil((low_y - y0) / h)), 0), int((high_y - y0) / h) + 1):
        for k in range(max(int(np.ceil((low_z - z0) / h)), 0), int((high_z - z0) / h) + 1):
            y, z = y0 + j * h, z0 + k * h
            a = side_of(corners[4], corners[5], corners[7], corners[8], y, z)
            b = side_of(corners[7], corners[8], corners[1], corners[2], y, z)
            c = side_of(corners[1], corners[2], corners[4], corners[5], y, z)
            if (a > 0.0 and b > 0.0 and c > 0.0) or (a < 0.0 and b < 0.0 and c < 0.0):
                x = (a * corners[0] + b * corners[3] + c * corners[6]) / (a + b + c)
                i = max(int(np.ceil((x - numbers[ORIGIN]) / h)), 0)
                if i < crossings.shape[0]:
                    crossings[i, j, k] += 1.0 if a > 0.0 else -1.0


@inline
def look(triangles, numbers, field, nearest, i, j, k, triangle):
    """Let a grid point know of a triangle."""
    h = 1.0 / numbers[FINENESS]
    x, y = numbers[ORIGIN] + i * h, numbers[ORIGIN + 1] + j * h
    square = square_from(x, y, numbers[ORIGIN + 2] + k * h, triangles[triangle])
    if square < field[i, j, k]:
        field[i, j, k], nearest[i, j, k] = square, triangle


@inline
def cells_of(a, b, c, begin, fineness, count):
    """Grid points along one axis, first and last + 1, near corners at a, b and c."""
    low, high = min(a, b, c), max(a, b, c)
    first = max(int((low - begin) * fineness) - NEAR, 0)
    return first, min(int((high - begin) * fineness) + NEAR + 2, count)


@inline
def sweep(triangles, numbers, field, nearest, direction):
    """Look at the nearest triangles of the neighbours that lie behind, in one sweep."""
    nx, ny, nz = field.shape
    a, b, c = 1 - 2 * (direction & 1), 1 - (direction & 2), 1 - (direction & 4) // 2
    for p in range(nx):
        i = p if a > 0 else nx - 1 - p
        for q in range(ny):
            j = q if b > 0 else ny - 1 - q
            for r in range(nz):
                k = r if c > 0 else nz - 1 - r
                for behind in range(1, 8):
                    u = i - a * (behind & 1)
                    v = j - b * (behind >> 1 & 1)
                    w = k - c * (behind >> 2)
                    if 0 <= u < nx and 0 <= v < ny and 0 <= w < nz:
                        found = nearest[u, v, w]
                        if found >= 0.0 and found != nearest[i, j, k]:
                            look(triangles, numbers, field, nearest, i, j, k, int(found))


@kernel(void, ARRAY_2D, ARRAY, ARRAY_3D, ARRAY_3D, ARRAY_3D)
def make_field(corners, numbers_of, out, spare, crossed):
    """out = distances [m] from triangles at the points of a grid, without signs; crossed = how
    often the ray to each point meets them behind the point before, as `cross_rays` counts.

    Args:
        corners: of the triangles [m], shape (k, 9). numbers_of: ORIGIN to HIGH of the field. spare,
            crossed: of the shape of `out`, overwritten.
    """
    triangles, numbers, field = grid(corners), grid(numbers_of), grid(out)
    nearest, crossings = grid(spare), grid(crossed)
    nx, ny, nz = field.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                field[i, j, k], nearest[i, j, k], crossings[i, j, k] = FAR, -1.0, 0.0
    fineness = numbers[FINENESS]
    for t in range(len(triangles)):
        c = triangles[t]
        cross_rays(c, numbers, crossings)
        i0, i1 = cells_of(c[0], c[3], c[6], numbers[ORIGIN], fineness, nx)
        j0, j1 = cells_of(c[1], c[4], c[7], numbers[ORIGIN + 1], fineness, ny)
        k0, k1 = cells_of(c[2], c[5], c[8], numbers[ORIGIN + 2], fineness, nz)
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    look(triangles, numbers, field, nearest, i, j, k, t)
    for _ in range(SWEEPS):
        for direction in range(8):
            sweep(triangles, numbers, field, nearest, direction)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                field[i, j, k] = np.sqrt(field[i, j, k])


@inline
def cubic(t):
    """Values, slopes and curvatures of the four cubic B-splines at t in a cell, 0 to 1."""
    s = 1.0 - t
    values = (
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - 0.5 * t),
        2.0 / 3.0 - s * s * (1.0 - 0.5 * s),
        t * t * t / 6.0,
    )
    slopes = -0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t
    return values, slopes, (s, 3.0 * t - 2.0, 3.0 * s - 2.0, t)


@inline
def weighted(rows, z):
    """Sum of the first four lanes with these weights."""
    low = lane(rows, 0) * z[0] + lane(rows, 1) * z[1]
    return low + (lane(rows, 2) * z[2] + lane(rows, 3) * z[3])


@inline
def set_inside(found, field, begin, shape, at, fineness, place):
    """Distance, gradient and curvature from the spline at a place (3) on the grid, in lane `at`.

    The lanes are coefficients along z, of which four count.
    """
    i, j, k = int(place[0]), int(place[1]), int(place[2])
    x, y = cubic(place[0] - i), cubic(place[1] - j)
    z = cubic(place[2] - k)
    c, cx, cy, cxx, cyy, cxy = zero(), zero(), zero(), zero(), zero(), zero()
    for a in range(4):
        first = begin + ((i - 1 + a) * shape[1] + j - 1) * shape[2] + k - 1
        r0, r1 = load(field, first), load(field, first + shape[2])
        r2, r3 = load(field, first + 2 * shape[2]), load(field, first + 3 * shape[2])
        e = y[0][0] * r0 + y[0][1] * r1 + (y[0][2] * r2 + y[0][3] * r3)
        ey = y[1][0] * r0 + y[1][1] * r1 + (y[1][2] * r2 + y[1][3] * r3)
        eyy = y[2][0] * r0 + y[2][1] * r1 + (y[2][2] * r2 + y[2][3] * r3)
        c, cx, cxx = c + x[0][a] * e, cx + x[1][a] * e, cxx + x[2][a] * e
        cy, cxy, cyy = cy + x[0][a] * ey, cxy + x[1][a] * ey, cyy + x[0][a] * eyy
    h, square = fineness, fineness * fineness
    found[0, at], found[1, at] = weighted(c, z[0]), weighted(cx, z[0]) * h
    found[2, at], found[3, at] = weighted(cy, z[0]) * h, weighted(c, z[1]) * h
    found[4, at], found[5, at] = weighted(cxx, z[0]) * square, weighted(cyy, z[0]) * square
    found[6, at], found[7, at] = weighted(c, z[2]) * square, weighted(cxy, z[0]) * square
    found[8, at], found[9, at] = weighted(cx, z[1]) * square, weighted(cy, z[1]) * square


@inline
def look_up(cable, o):
    """Replace in `work.looked`, on the lanes of samples that may touch, what is that of the box by
    that of the mesh: distance [m], gradient (3), second derivatives xx, yy, zz, xy, xz, yz [1/m] in
    rows 0 to 9; beyond the reach a lower bound. Rows 10 to 12 have the places.
    """
    contact, found = cable.contact, cable.work.looked
    numbers, shape, field = contact.field[o], contact.field_shape[o], contact.field_values
    fineness, across, along = numbers[FINENESS], shape[1] * shape[2], shape[2]
    near, half = contact.reach[o] + ROUGH / fineness, 0.5 * fineness
    for at in range(LANES):
        if not found[0, at] < near:
            continue
        place = (
            (found[10, at] - numbers[ORIGIN]) * fineness,
            (found[11, at] - numbers[ORIGIN + 1]) * fineness,
            (found[12, at] - numbers[ORIGIN + 2]) * fineness,
        )
        i, j, k = int(place[0] + 0.5), int(place[1] + 0.5), int(place[2] + 0.5)
        first = shape[3] + i * across + j * along + k
        if field[first] > near:
            found[0, at] = field[first] - ROUGH / fineness
            found[1, at] = half * (field[first + across] - field[first - across])
            found[2, at] = half * (field[first + along] - field[first - along])
            found[3, at] = half * (field[first + 1] - field[first - 1])
        else:
            set_inside(found, field, shape[3], shape, at, fineness, place)


@inline
def beyond(y, low, high):
    """By how much y is beyond an interval, with its sign."""
    below, above = y - low, y - high
    return where(-below, below, where(above, above, 0.0))


@inline
def field_distance(cable, o, y):
    """Signed distance from a mesh at places y in its frame, its gradient and second derivatives xx,
    yy, zz, xy, xz, yz. For samples that cannot touch it is a lower bound: far from the mesh that
    from the box around it.
    """
    numbers, found = cable.contact.field[o], cable.work.looked
    a = beyond(y[0], numbers[LOW], numbers[HIGH])
    b = beyond(y[1], numbers[LOW + 1], numbers[HIGH + 1])
    c = beyond(y[2], numbers[LOW + 2], numbers[HIGH + 2])
    far, none = sqrt(a * a + b * b + c * c), zero()
    inverse = 1.0 / (far + TINY)
    d, n = far, (a * inverse, b * inverse, c * inverse)
    bend, mixed = (none, none, none), (none, none, none)
    if any_above(cable.contact.reach[o] + ROUGH / numbers[FINENESS] - far):
        store(found, 0, 0, d)
        store(found, 1, 0, n[0])
        store(found, 2, 0, n[1])
        store(found, 3, 0, n[2])
        for row in range(4, 10):
            store(found, row, 0, 0.0)
        store(found, 10, 0, y[0])
        store(found, 11, 0, y[1])
        store(found, 12, 0, y[2])
        look_up(cable, o)
        d, n = load(found, 0, 0), (load(found, 1, 0), load(found, 2, 0), load(found, 3, 0))
        bend = load(found, 4, 0), load(found, 5, 0), load(found, 6, 0)
        mixed = load(found, 7, 0), load(found, 8, 0), load(found, 9, 0)
    return d, n, (*bend, *mixed)
