"""Signed distance from a triangle mesh: a field that is made once on a grid, and looked up there.

**Making.** The distance of a grid point is that from the nearest triangle, searched for around
every triangle, and then among the nearest triangles of neighbouring points, in sweeps over the grid
(the idea of fast sweeping). Rays along x tell what is inside; they run a little beside the grid
lines, so that they meet no edge.

**Looking up.** The field is a tricubic B-spline, so that the distance, its gradient and its
curvature are continuous. Edges and walls thinner than two cells are rounded by about a cell.
Outside of the grid the distance is that from the box around the mesh, which is no more than that
from the mesh.
"""

from __future__ import annotations

import numpy as np
from numba import int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.lanes import LANES, zero
from dlo_sim.compiling.pieces import ARRAY, ARRAY_2D, ARRAY_3D, part, piece
from dlo_sim.engine.arrays import CABLE, MESHED

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


@part
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


@part
def side_of(a1, a2, b1, b2, y, z):
    """Twice the area of the triangle a, b, (y, z) in the plane x = 0, exactly opposite for b, a."""
    if (a1, a2) < (b1, b2):
        return (b1 - a1) * (z - a2) - (b2 - a2) * (y - a1)
    return -((a1 - b1) * (z - b2) - (a2 - b2) * (y - b1))


@part
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


@part
def look(triangles, numbers, field, nearest, i, j, k, triangle):
    """Let a grid point know of a triangle."""
    h = 1.0 / numbers[FINENESS]
    x, y = numbers[ORIGIN] + i * h, numbers[ORIGIN + 1] + j * h
    square = square_from(x, y, numbers[ORIGIN + 2] + k * h, triangles[triangle])
    if square < field[i, j, k]:
        field[i, j, k], nearest[i, j, k] = square, triangle


@part
def cells_of(a, b, c, begin, fineness, count):
    """Grid points along one axis, first and last + 1, near corners at a, b and c."""
    low, high = min(a, b, c), max(a, b, c)
    first = max(int((low - begin) * fineness) - NEAR, 0)
    return first, min(int((high - begin) * fineness) + NEAR + 2, count)


@part
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


@piece(void, ARRAY_2D, ARRAY, ARRAY_3D, ARRAY_3D, ARRAY_3D)
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


@part
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


@part
def set_outside(found, numbers, at, y0, y1, y2):
    """Distance and gradient of a point from the box around the mesh, in lane `at` of `found`."""
    w0 = y0 - min(max(y0, numbers[LOW]), numbers[HIGH])
    w1 = y1 - min(max(y1, numbers[LOW + 1]), numbers[HIGH + 1])
    w2 = y2 - min(max(y2, numbers[LOW + 2]), numbers[HIGH + 2])
    far = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    found[0, at], found[1, at], found[2, at], found[3, at] = far, w0 / far, w1 / far, w2 / far
    for entry in range(4, 10):
        found[entry, at] = 0.0


@part
def set_rough(found, field, at, first, along, across, bound):
    """A lower bound of the distance, with the gradient at the nearest grid point, in lane `at`: for
    points that do not touch.
    """
    n0 = field[first + across] - field[first - across]
    n1, n2 = field[first + along] - field[first - along], field[first + 1] - field[first - 1]
    inverse = 1.0 / np.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + 1e-30)
    found[0, at], found[1, at] = bound, n0 * inverse
    found[2, at], found[3, at] = n1 * inverse, n2 * inverse
    for entry in range(4, 10):
        found[entry, at] = 0.0


@part
def set_inside(found, field, begin, shape, at, fineness, place):
    """Distance, gradient and curvature from the spline at a place (3) on the grid, in lane `at`."""
    i, j, k = int(place[0]), int(place[1]), int(place[2])
    x, y = cubic(place[0] - i), cubic(place[1] - j)
    z = cubic(place[2] - k)
    d, dx, dy, dz, xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(4):
        e, ey, ez, eyy, ezz, eyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(4):
            first = begin + ((i - 1 + a) * shape[1] + j - 1 + b) * shape[2] + k - 1
            c0, c1, c2, c3 = field[first], field[first + 1], field[first + 2], field[first + 3]
            v = c0 * z[0][0] + c1 * z[0][1] + c2 * z[0][2] + c3 * z[0][3]
            s = c0 * z[1][0] + c1 * z[1][1] + c2 * z[1][2] + c3 * z[1][3]
            e, ey, eyy = e + y[0][b] * v, ey + y[1][b] * v, eyy + y[2][b] * v
            ez, eyz = ez + y[0][b] * s, eyz + y[1][b] * s
            ezz += y[0][b] * (c0 * z[2][0] + c1 * z[2][1] + c2 * z[2][2] + c3 * z[2][3])
        d, dx, xx = d + x[0][a] * e, dx + x[1][a] * e, xx + x[2][a] * e
        dy, xy, yy = dy + x[0][a] * ey, xy + x[1][a] * ey, yy + x[0][a] * eyy
        dz, xz, zz = dz + x[0][a] * ez, xz + x[1][a] * ez, zz + x[0][a] * ezz
        yz += x[0][a] * eyz
    h, square = fineness, fineness * fineness
    found[0, at], found[1, at], found[2, at], found[3, at] = d, dx * h, dy * h, dz * h
    found[4, at], found[5, at], found[6, at] = xx * square, yy * square, zz * square
    found[7, at], found[8, at], found[9, at] = xy * square, xz * square, yz * square


@piece(void, CABLE, int64, terms=MESHED)
def look_up(cable, o):
    """Signed distance [m], gradient (3) and second derivatives xx, yy, zz, xy, xz, yz [1/m] at the
    places in the rows 0 to 2 of `work.looked`, in its rows 0 to 9; a lower bound beyond the reach.
    """
    contact, found = cable.contact, cable.work.looked
    numbers, shape, field = contact.field[o], contact.field_shape[o], contact.field_values
    for at in range(LANES):
        y0, y1, y2 = found[0, at], found[1, at], found[2, at]
        place = (
            (y0 - numbers[ORIGIN]) * numbers[FINENESS],
            (y1 - numbers[ORIGIN + 1]) * numbers[FINENESS],
            (y2 - numbers[ORIGIN + 2]) * numbers[FINENESS],
        )
        inside = 1.0 <= place[0] < shape[0] - 2 and 1.0 <= place[1] < shape[1] - 2
        if inside and 1.0 <= place[2] < shape[2] - 2:
            i, j, k = int(place[0] + 0.5), int(place[1] + 0.5), int(place[2] + 0.5)
            across, fineness = shape[1] * shape[2], numbers[FINENESS]
            first = shape[3] + i * across + j * shape[2] + k
            bound = field[first] - ROUGH / fineness
            if bound > contact.reach[o]:
                set_rough(found, field, at, first, shape[2], across, bound)
            else:
                set_inside(found, field, shape[3], shape, at, fineness, place)
        else:
            set_outside(found, numbers, at, y0, y1, y2)


@part
def field_distance(cable, o, y):
    """`contact.distance` of a mesh: with a distance of 1 m from the centre of curvature."""
    found = cable.work.looked
    store(found, 0, 0, y[0])
    store(found, 1, 0, y[1])
    store(found, 2, 0, y[2])
    look_up(cable, o)
    n = load(found, 1, 0), load(found, 2, 0), load(found, 3, 0)
    bend = (
        load(found, 4, 0) + n[0] * n[0],
        load(found, 5, 0) + n[1] * n[1],
        load(found, 6, 0) + n[2] * n[2],
        load(found, 7, 0) + n[0] * n[1],
        load(found, 8, 0) + n[0] * n[2],
        load(found, 9, 0) + n[1] * n[2],
    )
    return load(found, 0, 0), n, zero() + 1.0, bend
