"""Material frames along a curve: rotation-minimising frames rotated by the twist angle."""

from __future__ import annotations

import numpy as np
from numba import float64, int64, void

from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, STRIDED, STRIDED_WHOLES, inline, kernel
from dlo_sim.engine.arrays import MARGIN, cable_at
from dlo_sim.engine.grasps import turned
from dlo_sim.terms.vectors import combined, cross, dot


@inline
def curve_sample(points, columns, values, slopes, i):
    """Position (3), tangent (3, not unit) and twist angle of sample i."""
    x0 = x1 = x2 = t0 = t1 = t2 = angle = 0.0
    for k in range(4):
        c = columns[i, k]
        b = values[i, k]
        s = slopes[i, k]
        x0 += b * points[c, 0]
        x1 += b * points[c, 1]
        x2 += b * points[c, 2]
        t0 += s * points[c, 0]
        t1 += s * points[c, 1]
        t2 += s * points[c, 2]
        angle += b * points[c, 3]
    return (x0, x1, x2), (t0, t1, t2), angle


@inline
def unit(v):
    """v / |v|."""
    norm = np.sqrt(dot(v, v))
    return v[0] / norm, v[1] / norm, v[2] / norm


@inline
def reflected(factor, v, a):
    """a - factor (v . a) v: for factor 2 / |v|^2 the reflection of a in the plane normal to v."""
    return combined(1.0, a, -(factor * dot(v, a)), v)


@inline
def transport(points, columns, values, slopes, reference, out):
    """Points and material frames along a spline; the x axis of a frame is the tangent.

    Rotation-minimising transport by double reflection (Wang, Juettler, Zheng & Liu 2008), fourth
    order in the spacing, then a rotation by theta - theta[0] about the tangent.

    Args:
        points: control points (n, 4). columns, values, slopes: active basis of m samples, (m, 4).
        reference: its part normal to the first tangent is the second axis at the first sample.
        out: point [m] and quaternion (x, y, z, w) of every sample, shape (m, 7).
    """
    d = reference[0], reference[1], reference[2]
    last_x = last_t = (0.0, 0.0, 0.0)
    first_angle = 0.0
    for i in range(out.shape[0]):
        x, t, angle = curve_sample(points, columns, values, slopes, i)
        t = unit(t)
        if i == 0:
            first_angle = angle
        else:
            v = combined(1.0, x, -1.0, last_x)
            c = dot(v, v)
            if c > 0.0:
                w = combined(1.0, t, -1.0, reflected(2.0 / c, v, last_t))
                e = dot(w, w)
                d = reflected(2.0 / e if e > 0.0 else 0.0, w, reflected(2.0 / c, v, d))
        d = unit(reflected(1.0, t, d))  # normal to t
        last_x, last_t = x, t
        m = combined(np.cos(angle - first_angle), d, np.sin(angle - first_angle), cross(t, d))
        out[i, 0], out[i, 1], out[i, 2] = x
        write_quaternion(t, m, cross(t, m), out[i])


@inline
def write_points(cable, out):
    """Write the coordinates of the cable to the columns x, y, z, theta of out, (n, 4)."""
    for line in range(cable.lines):
        column = cable.axes[line] if line < cable.dim else 3
        for i in range(cable.n):
            out[i, column] = cable.state.x[line, MARGIN + i]


@kernel(void, int64, ARRAY_2D)
def control_points(address, out):
    """`write_points` for Python."""
    write_points(cable_at(address), out)


@kernel(
    *(void, int64, ARRAY_2D, STRIDED_WHOLES, STRIDED, STRIDED),
    *(float64, int64, ARRAY, ARRAY, int64, ARRAY_2D),
)
def curve_frames(address, points, columns, values, slopes, t, grasp, direction, origin, own, out):
    """`transport`, with a reference that has this direction in the frame of the end effector of a
    grasp at time t, or in the world if `grasp` is negative.

    Args:
        points: for `write_points`. origin: added to the points in `out`. own: -1, or in place of
            points of the curve, as many control points as samples, from this one on.
    """
    cable = cable_at(address)
    write_points(cable, points)
    reference = direction[0], direction[1], direction[2]
    if grasp >= 0:
        reference = turned(cable.inputs.motion[grasp], t, *reference)
    transport(points, columns, values, slopes, reference, out)
    for i in range(out.shape[0]):
        for axis in range(3):
            out[i, axis] = (points[own + i, axis] if own >= 0 else out[i, axis]) + origin[axis]


@inline
def write_quaternion(x, y, z, out):
    """Write to out[3:7] the quaternion of the rotation with columns x, y, z; its largest component
    is positive.

    Source: Shepperd 1978 (the branch with the largest denominator).
    """
    trace = x[0] + y[1] + z[2]
    if trace >= x[0] and trace >= y[1] and trace >= z[2]:
        out[6] = 1.0 + trace
        out[3] = y[2] - z[1]
        out[4] = z[0] - x[2]
        out[5] = x[1] - y[0]
    elif x[0] >= y[1] and x[0] >= z[2]:
        out[3] = 1.0 + 2.0 * x[0] - trace
        out[4] = x[1] + y[0]
        out[5] = x[2] + z[0]
        out[6] = y[2] - z[1]
    elif y[1] >= z[2]:
        out[4] = 1.0 + 2.0 * y[1] - trace
        out[3] = x[1] + y[0]
        out[5] = y[2] + z[1]
        out[6] = z[0] - x[2]
    else:
        out[5] = 1.0 + 2.0 * z[2] - trace
        out[3] = x[2] + z[0]
        out[4] = y[2] + z[1]
        out[6] = x[1] - y[0]
    norm = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2 + out[6] ** 2)
    for k in range(3, 7):
        out[k] /= norm
