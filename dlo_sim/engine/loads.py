"""Point wrenches: forces and moments at material coordinates.

A force F at u adds b_i(u) F. A moment m turns the tangent: its virtual work on
d phi = t x dt / |t|^2 gives b_i'(u) (m x t) / |t|^2, and its axial part m.t / |t| turns theta.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, load, store
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout

TORQUE, FREQUENCY = 3, 6  # rows of a load behind its force


@part
def amplitude(frequency, t):
    """sin(2 pi f t), or 1 for f = 0, a constant load."""
    return 1.0 if frequency == 0.0 else np.sin(2.0 * np.pi * frequency * t)


@part
def load_force(shape, model, inputs, scratch, x, t, out):
    """out += generalised forces of the point wrenches at time t."""
    width, stride = shape[layout.LINE], shape[layout.STRIDE]
    start = layout.MARGIN * stride
    for k in range(shape[layout.LOADS]):
        at = shape[layout.LOAD] + layout.LOAD_ROWS * LANES * k
        factors = shape[layout.NOTES]
        for lane in range(LANES):  # each cable has its own frequency
            scratch[factors + lane] = amplitude(inputs[at + FREQUENCY * LANES + lane], t)
        factor = load(scratch, factors)
        basis = shape[layout.LOAD_BASIS] + width * k
        for d in range(shape[layout.DIM]):
            f = factor * load(inputs, at + shape[layout.AXES + d] * LANES)
            for b in range(shape[layout.PARTS]):
                to = start + LANES * b
                here = d * width + to
                store(out, here, load(out, here) + f * load(model, basis + to))
        if stride == 1:
            add_moment(shape, model, inputs, x, k, scratch[factors], out)


@part
def moment_of(shape, inputs, k):
    """Amplitude of the moment of load k [N m], world frame; one cable only."""
    at = shape[layout.LOAD] + (layout.LOAD_ROWS * k + TORQUE) * LANES
    return inputs[at], inputs[at + LANES], inputs[at + 2 * LANES]


@part
def load_tangent(shape, model, x, k):
    """r' at the material coordinate of load k, world frame."""
    at = shape[layout.LOAD_POINT] + (layout.LOAD_POINT_ROWS * k + 4) * LANES
    to = layout.MARGIN + shape[shape[layout.LOAD_TABLE] + k]
    t0 = t1 = t2 = 0.0
    for d in range(shape[layout.DIM]):
        f = 0.0
        for q in range(4):
            f += model[at + q * LANES] * x[d * shape[layout.LINE] + to + q]
        axis = shape[layout.AXES + d]
        if axis == 0:
            t0 = f
        elif axis == 1:
            t1 = f
        else:
            t2 = f
    return t0, t1, t2


@part
def add_moment(shape, model, inputs, x, k, factor, out):
    """out += generalised forces of the moment of load k; one cable only."""
    m = moment_of(shape, inputs, k)
    m0, m1, m2 = factor * m[0], factor * m[1], factor * m[2]
    if m0 == 0.0 and m1 == 0.0 and m2 == 0.0:
        return
    t0, t1, t2 = load_tangent(shape, model, x, k)
    c = t0 * t0 + t1 * t1 + t2 * t2
    g = (m1 * t2 - m2 * t1) / c, (m2 * t0 - m0 * t2) / c, (m0 * t1 - m1 * t0) / c
    basis = shape[layout.LOAD_POINT] + layout.LOAD_POINT_ROWS * LANES * k
    to = layout.MARGIN + shape[shape[layout.LOAD_TABLE] + k]
    for d in range(shape[layout.DIM]):
        axis = shape[layout.AXES + d]
        value = g[0] if axis == 0 else (g[1] if axis == 1 else g[2])
        for q in range(4):
            out[d * shape[layout.LINE] + to + q] += model[basis + (4 + q) * LANES] * value
    if shape[layout.LINES] > shape[layout.DIM]:
        axial = (m0 * t0 + m1 * t1 + m2 * t2) / np.sqrt(c)
        for q in range(4):
            out[shape[layout.DIM] * shape[layout.LINE] + to + q] += model[basis + q * LANES] * axial


@part
def add_load_stiffness(shape, model, inputs, x, t, scale, band):
    """band -= scale times the Jacobian of the load forces: that of moments, by the tangent."""
    dim = shape[layout.DIM]
    half, row = 4 * dim - 1, 16 * (dim - 1)
    for k in range(shape[layout.LOADS]):
        m = moment_of(shape, inputs, k)
        if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
            continue
        factor = amplitude(
            inputs[shape[layout.LOAD] + (layout.LOAD_ROWS * k + FREQUENCY) * LANES], t
        )
        tangent = load_tangent(shape, model, x, k)
        ic = 1.0 / (tangent[0] ** 2 + tangent[1] ** 2 + tangent[2] ** 2)
        slope = shape[layout.LOAD_POINT] + (layout.LOAD_POINT_ROWS * k + 4) * LANES
        first = shape[shape[layout.LOAD_TABLE] + k]
        for i in range(dim):
            for j in range(dim):
                a, c = shape[layout.AXES + i], shape[layout.AXES + j]
                b, e = (a + 1) % 3, (a + 2) % 3
                g = at3(m, b) * at3(tangent, e) - at3(m, e) * at3(tangent, b)
                # d/dt_c of (m x t)_a / |t|^2
                value = -2.0 * g * at3(tangent, c) * ic * ic
                if a != c:
                    sign = -1.0 if (c - a) % 3 == 1 else 1.0
                    value += sign * at3(m, 3 - a - c) * ic
                for q in range(4):
                    for other in range(4):
                        to = ((first + q) * dim + i) * row + (other - q) * dim + j - i + half
                        f = model[slope + q * LANES] * model[slope + other * LANES]
                        band[to] -= scale * factor * value * f


@part
def at3(v, k):
    """Component k of a vector."""
    return v[0] if k == 0 else (v[1] if k == 1 else v[2])
