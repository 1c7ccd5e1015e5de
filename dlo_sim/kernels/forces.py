"""Generalised forces on the control points, one function a term, and their sum."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.banded import multiply_differences
from dlo_sim.kernels.elastic import scatter_gradient, span_gradient, tangent_coefficients
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.plastic import plastic_force
from dlo_sim.kernels.torsion import torsion_force


@kernel
def clear(x):
    """Set all entries to zero."""
    for d in range(x.shape[0]):
        for i in range(x.shape[1]):
            x[d, i] = 0.0


@kernel
def elastic_force(x, lattice, stretch, spans, bend, rest, axes, coefficients, gradient, out):
    """out += - dU/dq of stretching and bending."""
    if stretch is not None or spans is not None or bend is not None:
        tangent_coefficients(x, lattice, axes, coefficients)
        span_gradient(coefficients, lattice, stretch, spans, bend, rest, axes, gradient)
        scatter_gradient(gradient, lattice, axes, -1.0, out)


@kernel
def twist_force(x, twist, n, row, out):
    """out[row] -= GJ integral b' theta'."""
    if twist is not None:
        multiply_differences(twist.stiffness, n, x[row], -1.0, out[row])


@kernel
def gravity_force(gravity, n, out):
    """out += generalised weight."""
    if gravity is not None:
        for d in range(gravity.shape[0]):
            for i in range(n):
                out[d, i] += gravity[d, i]


@kernel
def spring_force(x, springs, n, out):
    """out += force of the end springs."""
    if springs is not None:
        for d in range(springs.stiffness.shape[1]):
            out[d, 0] -= springs.stiffness[0, d] * (x[d, 0] - springs.anchor[0, d])
            out[d, n - 1] -= springs.stiffness[1, d] * (x[d, n - 1] - springs.anchor[1, d])


@kernel
def conservative_force(x, terms, work, out):
    """out = - dU/dq of everything that has a potential."""
    n = terms.lattice.n
    clear(out)
    elastic_force(
        x,
        terms.lattice,
        terms.stretch,
        terms.span_stretch,
        terms.bend,
        terms.rest,
        terms.axes,
        work.coefficients,
        work.gradient,
        out,
    )
    torsion_force(x, terms.lattice, terms.frenet, terms.axes, work.coefficients, work.gradient, out)
    plastic_force(
        x, terms.lattice, terms.plastic, terms.axes, work.coefficients, work.gradient, out
    )
    twist_force(x, terms.twist, n, len(terms.axes), out)
    gravity_force(terms.gravity, n, out)
    spring_force(x, terms.springs, n, out)


@kernel
def load_amplitude(frequency, t):
    """1 for a constant load, sin(2 pi f t) otherwise."""
    if frequency == 0.0:
        return 1.0
    return np.sin(2.0 * np.pi * frequency * t)


@kernel
def load_tangent(x, slope, first, axes):
    """r' (world) at a load's material coordinate."""
    t0 = 0.0
    t1 = 0.0
    t2 = 0.0
    for d in range(len(axes)):
        value = 0.0
        for k in range(4):
            value += slope[k] * x[d, first + k]
        if axes[d] == 0:
            t0 = value
        elif axes[d] == 1:
            t1 = value
        else:
            t2 = value
    return t0, t1, t2


@kernel
def load_force(x, loads, axes, t, out):
    """out += generalised forces of the point wrenches at time t.

    A force F at u adds b_i(u) F. A moment m turns the tangent: its virtual work on
    d phi = t x dt / |t|^2 gives b_i'(u) (m x t) / |t|^2, and its axial part m.t/|t| turns theta.
    """
    if loads is not None:
        dim = len(axes)
        for load in range(loads.first.shape[0]):
            amplitude = load_amplitude(loads.frequency[load], t)
            first = loads.first[load]
            for d in range(dim):
                f = amplitude * loads.force[load, d]
                for k in range(4):
                    out[d, first + k] += loads.basis[load, k] * f
            m0 = amplitude * loads.torque[load, 0]
            m1 = amplitude * loads.torque[load, 1]
            m2 = amplitude * loads.torque[load, 2]
            if m0 == 0.0 and m1 == 0.0 and m2 == 0.0:
                continue
            t0, t1, t2 = load_tangent(x, loads.slope[load], first, axes)
            c = t0 * t0 + t1 * t1 + t2 * t2
            for d in range(dim):
                axis = axes[d]
                if axis == 0:
                    g = m1 * t2 - m2 * t1
                elif axis == 1:
                    g = m2 * t0 - m0 * t2
                else:
                    g = m0 * t1 - m1 * t0
                for k in range(4):
                    out[d, first + k] += loads.slope[load, k] * g / c
            if out.shape[0] > dim:
                axial = (m0 * t0 + m1 * t1 + m2 * t2) / np.sqrt(c)
                for k in range(4):
                    out[dim, first + k] += loads.basis[load, k] * axial
