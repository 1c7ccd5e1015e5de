"""Point wrenches: forces and moments at material coordinates.

A force F at u adds b_i(u) F. A moment m turns the tangent: its virtual work on
d phi = t x dt / |t|^2 gives b_i'(u) (m x t) / |t|^2, and its axial part m.t / |t| turns theta.
"""

from __future__ import annotations

import numpy as np
from numba import float64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.arrays import CABLE, LINES, LOADED, MARGIN
from dlo_sim.engine.grasps import component
from dlo_sim.terms.vectors import combined, cross, dot

TORQUE, FREQUENCY = 3, 6  # entries of a load behind its force


@inline
def amplitude_of(cable, k, t):
    """sin(2 pi f t) for the frequency f of load k, or 1 for f = 0, a constant load."""
    frequency = cable.inputs.load[k, FREQUENCY]
    return 1.0 if frequency == 0.0 else np.sin(2.0 * np.pi * frequency * t)


@inline
def moment_of(cable, k):
    """Amplitude of the moment of load k [N m], world frame."""
    values = cable.inputs.load[k]
    return values[TORQUE], values[TORQUE + 1], values[TORQUE + 2]


@inline
def load_tangent(cable, x, k):
    """r' at the material coordinate of load k, world frame."""
    slopes, c = cable.loads.slopes, MARGIN + cable.loads.first[k]
    t0 = t1 = t2 = 0.0
    for d in range(cable.dim):
        slope = 0.0
        for q in range(4):
            slope += slopes[k, q] * x[d, c + q]
        axis = cable.axes[d]
        if axis == 0:
            t0 = slope
        elif axis == 1:
            t1 = slope
        else:
            t2 = slope
    return t0, t1, t2


@kernel(void, CABLE, LINES, float64, LINES, terms=LOADED)
def load_force(cable, x, t, out):
    """out += generalised forces of the point wrenches at time t."""
    loads, dim = cable.loads, cable.dim
    for k in range(loads.count):
        factor, a = amplitude_of(cable, k, t), moment_of(cable, k)
        for d in range(dim):
            f = factor * cable.inputs.load[k, cable.axes[d]]
            for c in range(0, cable.columns, LANES):
                store(out, d, c, load(out, d, c) + f * load(loads.basis, k, c))
        m = factor * a[0], factor * a[1], factor * a[2]
        if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
            continue
        c, tangent = MARGIN + loads.first[k], load_tangent(cable, x, k)
        square, turning = dot(tangent, tangent), cross(m, tangent)
        for d in range(dim):
            g = component(turning, cable.axes[d]) / square
            for q in range(4):
                out[d, c + q] += loads.slopes[k, q] * g
        if cable.lines > dim:
            axial = dot(m, tangent) / np.sqrt(square)
            for q in range(4):
                out[dim, c + q] += loads.values[k, q] * axial


@kernel(void, CABLE, LINES, float64, float64, LINES, terms=LOADED)
def add_load_stiffness(cable, x, t, scale, band):
    """band -= scale times the Jacobian of the load forces: that of moments, by the tangent."""
    dim, lines, half = cable.dim, cable.lines, 4 * cable.lines - 1
    loads = cable.loads
    for k in range(loads.count):
        m = moment_of(cable, k)
        if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
            continue
        slopes, first = loads.slopes[k], loads.first[k]
        factor = amplitude_of(cable, k, t)
        tangent = load_tangent(cable, x, k)
        turning = cross(m, tangent)
        inverse = 1.0 / dot(tangent, tangent)
        for i in range(dim):
            for j in range(dim):
                a, c = cable.axes[i], cable.axes[j]
                # d/dt_c of (m x t)_a / |t|^2
                value = -2.0 * component(turning, a) * component(tangent, c) * inverse * inverse
                if a != c:
                    sign = -1.0 if (c - a) % 3 == 1 else 1.0
                    value += sign * component(m, 3 - a - c) * inverse
                for q in range(4):
                    for r in range(4):
                        change = factor * value * (slopes[q] * slopes[r])
                        band[(first + q) * lines + i, (r - q) * lines + j - i + half] -= (
                            scale * change
                        )
        if lines > dim:
            root = np.sqrt(inverse)
            across = combined(root, m, -dot(m, tangent) * inverse * root, tangent)
            for j in range(dim):
                value = scale * factor * component(across, cable.axes[j])
                for q in range(4):
                    for r in range(4):
                        change = value * loads.values[k, q] * slopes[r]
                        band[(first + q) * lines + dim, (r - q) * lines + j - dim + half] -= change
