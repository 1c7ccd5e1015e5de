"""Material frames along a curve: rotation-minimising frames rotated by the twist angle."""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.pieces import (
    MATRIX,
    NOTHING,
    REAL,
    REALS,
    STRIDED,
    STRIDED_WHOLES,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.grasps import turned


@part
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
    return x0, x1, x2, t0, t1, t2, angle


@part
def transport(points, columns, values, slopes, reference, out):
    """Points and material frames along a spline; the x axis of a frame is the tangent.

    Rotation-minimising transport by double reflection (Wang, Juettler, Zheng & Liu 2008), fourth
    order in the spacing, then a rotation by theta - theta[0] about the tangent.

    Args:
        points: control points (n, 4). columns, values, slopes: active basis of m samples, (m, 4).
        reference: its part normal to the first tangent is the second axis at the first sample.
        out: point [m] and quaternion (x, y, z, w) of every sample, shape (m, 7).
    """
    d0, d1, d2 = reference[0], reference[1], reference[2]
    p0 = p1 = p2 = q0 = q1 = q2 = first_angle = 0.0  # p, q: tangent and point of the last sample
    for i in range(out.shape[0]):
        x0, x1, x2, t0, t1, t2, angle = curve_sample(points, columns, values, slopes, i)
        norm = np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        t0, t1, t2 = t0 / norm, t1 / norm, t2 / norm
        if i == 0:
            first_angle = angle
        else:
            v0, v1, v2 = x0 - q0, x1 - q1, x2 - q2
            c = v0 * v0 + v1 * v1 + v2 * v2
            if c > 0.0:
                a = 2.0 / c * (v0 * d0 + v1 * d1 + v2 * d2)
                b = 2.0 / c * (v0 * p0 + v1 * p1 + v2 * p2)
                l0, l1, l2 = d0 - a * v0, d1 - a * v1, d2 - a * v2
                w0, w1, w2 = t0 - (p0 - b * v0), t1 - (p1 - b * v1), t2 - (p2 - b * v2)
                e = w0 * w0 + w1 * w1 + w2 * w2
                f = 2.0 / e * (w0 * l0 + w1 * l1 + w2 * l2) if e > 0.0 else 0.0
                d0, d1, d2 = l0 - f * w0, l1 - f * w1, l2 - f * w2
        along = d0 * t0 + d1 * t1 + d2 * t2
        d0, d1, d2 = d0 - along * t0, d1 - along * t1, d2 - along * t2
        norm = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        d0, d1, d2 = d0 / norm, d1 / norm, d2 / norm
        p0, p1, p2, q0, q1, q2 = t0, t1, t2, x0, x1, x2
        b0, b1, b2 = t1 * d2 - t2 * d1, t2 * d0 - t0 * d2, t0 * d1 - t1 * d0
        c, s = np.cos(angle - first_angle), np.sin(angle - first_angle)
        m0, m1, m2 = c * d0 + s * b0, c * d1 + s * b1, c * d2 + s * b2
        n0, n1, n2 = t1 * m2 - t2 * m1, t2 * m0 - t0 * m2, t0 * m1 - t1 * m0
        out[i, 0], out[i, 1], out[i, 2] = x0, x1, x2
        write_quaternion(t0, t1, t2, m0, m1, m2, n0, n1, n2, out[i])


@piece(NOTHING, CABLE, MATRIX)
def control_points(cable, out):
    """Write the coordinates that one cable has to the columns x, y, z, theta of out, (n, 4)."""
    shape, _, _, state, _ = bared(cable)
    for line in range(shape[layout.LINES]):
        at = shape[layout.X] + line * shape[layout.LINE] + layout.MARGIN
        column = shape[layout.AXES + line] if line < shape[layout.DIM] else 3
        for i in range(shape[layout.N]):
            out[i, column] = state[at + i]


@piece(NOTHING, CABLE, MATRIX, STRIDED_WHOLES, STRIDED, STRIDED, REAL, REALS, MATRIX)
def curve_frames(cable, points, columns, values, slopes, t, direction, out):
    """`transport`, with a reference that has this direction in the frame of the start's end
    effector at time t.
    """
    shape, _, inputs, _, _ = bared(cable)
    x, y, z = direction[0], direction[1], direction[2]
    reference = turned(inputs, shape[layout.MOTION], t, x, y, z)
    transport(points, columns, values, slopes, reference, out)


@part
def write_quaternion(x0, x1, x2, y0, y1, y2, z0, z1, z2, out):
    """Write to out[3:7] the quaternion of the rotation with columns x, y, z; its largest component
    is positive.

    Source: Shepperd 1978 (the branch with the largest denominator).
    """
    trace = x0 + y1 + z2
    if trace >= x0 and trace >= y1 and trace >= z2:
        out[6] = 1.0 + trace
        out[3] = y2 - z1
        out[4] = z0 - x2
        out[5] = x1 - y0
    elif x0 >= y1 and x0 >= z2:
        out[3] = 1.0 + 2.0 * x0 - trace
        out[4] = x1 + y0
        out[5] = x2 + z0
        out[6] = y2 - z1
    elif y1 >= z2:
        out[4] = 1.0 + 2.0 * y1 - trace
        out[3] = x1 + y0
        out[5] = y2 + z1
        out[6] = z0 - x2
    else:
        out[5] = 1.0 + 2.0 * z2 - trace
        out[3] = x2 + z0
        out[4] = y2 + z1
        out[6] = x1 - y0
    norm = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2 + out[6] ** 2)
    for k in range(3, 7):
        out[k] /= norm
