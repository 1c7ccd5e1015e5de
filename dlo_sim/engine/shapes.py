"""Distances of places from the shapes of obstacles, with normals and curvatures.

An obstacle is a core grown by its `reach`. The functions here write of a group of places, which
`work.measured` has in the frame of the obstacle, the signed distance d from the core, its gradient
n, the distance f from the centre of curvature, and f n' + n n^T, the curvature of the surface.
"""

from __future__ import annotations

from numba import int64, void

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import fabs, sqrt, where, zero
from dlo_sim.engine.arrays import BOXED, CABLE, MESHED, ROUND, TUBED
from dlo_sim.engine.contact_law import TINY, sign
from dlo_sim.engine.distance_field import field_distance

HALF_SPACE, BOX, CYLINDER, TUBE, MESH = range(5)  # kinds of cores
# Entries of `work.measured` of a group of samples: points of the cable, their places in the frame
# of an obstacle, and what `set_measured` sets.
POINT, PLACE, DISTANCE, NORMAL, FAR, BEND, SIZE = 0, 3, 6, 7, 10, 11, 17


@inline
def three(kept, at):
    """Three successive entries of lanes."""
    return kept[at], kept[at + 1], kept[at + 2]


@inline
def set_measured(kept, d, n, f, bend):
    """Set entries of `work.measured`: signed distance d from the core, its gradient n, the distance
    f from the centre of curvature, and f n' + n n^T as xx, yy, zz, xy, xz, yz.
    """
    kept[DISTANCE], kept[FAR] = d, f
    kept[NORMAL], kept[NORMAL + 1], kept[NORMAL + 2] = n
    kept[BEND], kept[BEND + 1], kept[BEND + 2] = bend[0], bend[1], bend[2]
    kept[BEND + 3], kept[BEND + 4], kept[BEND + 5] = bend[3], bend[4], bend[5]


@inline
def measured(kept):
    """What `set_measured` has set: d, n, f, bend."""
    bend = kept[BEND], kept[BEND + 1], kept[BEND + 2], kept[BEND + 3], kept[BEND + 4]
    return kept[DISTANCE], three(kept, NORMAL), kept[FAR], (*bend, kept[BEND + 5])


@kernel(void, CABLE, int64, int64, int64, terms=BOXED)
def box_distance(cable, o, g, when):
    """`set_distance` for a box."""
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    a, b, c = fabs(y[0]) - h[0], fabs(y[1]) - h[1], fabs(y[2]) - h[2]
    u, v, w = where(a, a, 0.0), where(b, b, 0.0), where(c, c, 0.0)
    far = sqrt(u * u + v * v + w * w)
    inverse = 1.0 / (far + TINY)
    first = where(a - b, 1.0, 0.0) * where(a - c, 1.0, 0.0)  # inside: the nearest face
    second = (1.0 - first) * where(b - c, 1.0, 0.0)
    third = 1.0 - first - second
    inside = first * a + second * b + third * c
    n = (
        where(far, u * inverse, first) * sign(y[0]),
        where(far, v * inverse, second) * sign(y[1]),
        where(far, w * inverse, third) * sign(y[2]),
    )
    d = where(far, far, inside)
    bend = (
        where(far, where(a, 1.0, 0.0), first),
        where(far, where(b, 1.0, 0.0), second),
        where(far, where(c, 1.0, 0.0), third),
        zero(),
        zero(),
        zero(),
    )
    set_measured(kept, d, n, fabs(d) + TINY, bend)


@kernel(void, CABLE, int64, int64, int64, terms=ROUND)
def cylinder_distance(cable, o, g, when):
    """`set_distance` for a cylinder about z: a box in the coordinates rho and z."""
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    rho = sqrt(y[0] * y[0] + y[1] * y[1])
    ex, ey = y[0] / (rho + TINY), y[1] / (rho + TINY)
    a, c = rho - h[0], fabs(y[2]) - h[2]
    u, w = where(a, a, 0.0), where(c, c, 0.0)
    far = sqrt(u * u + w * w)
    side = where(a - c, 1.0, 0.0)  # inside: the nearest face
    radial = where(far, u / (far + TINY), side)
    n = radial * ex, radial * ey, where(far, w / (far + TINY), 1.0 - side) * sign(y[2])
    d = where(far, far, where(a - c, a, c))
    lateral = where(radial, where(c, where(far, 0.0, 1.0), 1.0), 0.0)
    f = where(lateral, rho, fabs(d)) + TINY
    # Along the rim the surface curves by 1 / rho: u / rho instead of 1 in f n' + n n^T.
    less = where(lateral, 0.0, where(radial, 1.0 - u / (rho + TINY), 0.0))
    on_side, on_cap = where(radial, 1.0, 0.0), where(lateral, 0.0, 1.0)
    xx, yy = on_side - less * ey * ey, on_side - less * ex * ex
    set_measured(kept, d, n, f, (xx, yy, on_cap, less * ex * ey, zero(), zero()))


@kernel(void, CABLE, int64, int64, int64, terms=TUBED)
def tube_distance(cable, o, g, when):
    """`set_distance` for a tube about z, open at both ends: a segment along z in the coordinates
    rho and z. The distance from the middle of its wall, so that d > 0 on both sides.
    """
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    rho = sqrt(y[0] * y[0] + y[1] * y[1])
    ex, ey = y[0] / (rho + TINY), y[1] / (rho + TINY)
    u, c = rho - h[0], fabs(y[2]) - h[2]
    w = where(c, c, 0.0)
    d = sqrt(u * u + w * w)
    radial = where(d, u / (d + TINY), 1.0)
    n = radial * ex, radial * ey, where(d, w / (d + TINY), 0.0) * sign(y[2])
    # The wall curves by 1 / rho about the axis; at the rims also by 1 / d across it.
    wall = where(-c, 1.0 if h[2] > 0.0 else 0.0, 0.0)
    f = where(wall, rho, d) + TINY
    round_ = where(wall, sign(u), u / (rho + TINY))
    xx, yy = ex * ex + round_ * ey * ey, ey * ey + round_ * ex * ex
    set_measured(kept, d, n, f, (xx, yy, 1.0 - wall, (1.0 - round_) * ex * ey, zero(), zero()))


@kernel(void, CABLE, int64, int64, int64, terms=MESHED)
def mesh_distance(cable, o, g, when):
    """`set_distance` for a mesh, with a distance of 1 m from the centre of curvature."""
    kept = cable.work.measured[o, g, when]
    d, n, (xx, yy, zz, xy, xz, yz) = field_distance(cable, o, three(kept, PLACE))
    xx, yy, zz = xx + n[0] * n[0], yy + n[1] * n[1], zz + n[2] * n[2]
    xy, xz, yz = xy + n[0] * n[1], xz + n[0] * n[2], yz + n[1] * n[2]
    set_measured(kept, d, n, zero() + 1.0, (xx, yy, zz, xy, xz, yz))


@inline
def set_distance(cable, o, g, when, y):
    """Set the distance of the samples of a group at places y in the frame of an obstacle."""
    core, kept = cable.contact.core[o], cable.work.measured[o, g, when]
    kept[PLACE], kept[PLACE + 1], kept[PLACE + 2] = y
    if core == HALF_SPACE:
        one, none = zero() + 1.0, zero()
        set_measured(kept, y[2], (none, none, one), one, (none, none, one, none, none, none))
    elif core == BOX:
        box_distance(cable, o, g, when)
    elif core == CYLINDER:
        cylinder_distance(cable, o, g, when)
    elif core == TUBE:
        tube_distance(cable, o, g, when)
    else:
        mesh_distance(cable, o, g, when)
