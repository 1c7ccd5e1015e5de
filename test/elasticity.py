"""Elastic energy of the sampled spline and its gradient: plain numpy, slow, obvious.

The oracle for `dlo_sim.engine`: it goes from strain to energy sample by sample, as the paper
writes it, and shares nothing with the engine but the spline and the quadrature. With t = r'(u),
k = r''(u), C = t x k and n the axis of the natural curvature kappa0,

    stretch      eps = 1 - |t|              (positive in compression)
    curvature    kappa = |C| / |t|^3, as a vector along the binormal C / |t|^3
    twist rate   theta'
    U = 1/2 integral EA eps^2 + EI |C / |t|^3 - kappa0 n|^2 + GJ theta'^2 du

and the guard EA/2 (k max(v - v0, 0)^2 + k_c sum max(c0 - c, 0)^2) per length, with v a fourth of
the variance of c = t . t over a span (by span only), and c at its ends and in its middle.

Source: Khalifa & Palli, eqs. 6-8. Deviations: the integral runs over the rest length u, not over
the deformed length; the twist is the plain theta', since their Frenet torsion is 0/0 on a straight
cable; the natural curvature has an axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, quadrature

Array = NDArray[np.float64]
GUARD = 100.0, 0.01, 100.0, 0.25  # k, v0, k_c, c0


@dataclass(frozen=True)
class Section:
    """What the strains are multiplied with.

    Attributes:
        EA [N], EI [N m^2], GJ [N m^2]: stiffness, constant along the cable; 0 leaves a strain out.
        rest_curvature: kappa0 [1/m] at equally spaced points from start to end, linear between.
        rest_axis: unit axis n of the natural curvature, world frame, shape (3,).
        by_span: stretching counts by its mean over every span, and by a linear function in the
            first and the last (`span_strain`).
    """

    EA: float = 0.0
    EI: float = 0.0
    GJ: float = 0.0
    rest_curvature: tuple[float, ...] = (0.0,)
    rest_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    by_span: bool = False


@dataclass(frozen=True)
class Strains:
    """Strains at m material coordinates.

    Attributes:
        stretch: 1 - |r'| [-], shape (m,).
        curvature: |r' x r''| / |r'|^3 [1/m], shape (m,).
        binormal: curvature vector (r' x r'') / |r'|^3 [1/m], shape (m, 3).
        twist_rate: theta' [rad/m], shape (m,).
    """

    stretch: Array
    curvature: Array
    binormal: Array
    twist_rate: Array


def strains(control_points: Array, knots: Array, u: Array) -> Strains:
    """Strains of the cable at material coordinates u [m], shape (m,).

    Args:
        control_points: x, y, z [m], theta [rad], shape (n, 4).
        knots: from `bspline.clamped_knots`.

    Raises:
        ValueError: the tangent vanishes; the message gives the material coordinate.
    """
    first = bspline.evaluate(control_points, knots, u, 1)
    second = bspline.evaluate(control_points, knots, u, 2)
    length = np.linalg.norm(first[:, :3], axis=1)
    gone = length < 1e-12
    if gone.any():
        raise ValueError(f"the tangent vanishes at u = {u[gone][0]:g} m: no curvature there")
    binormal = np.cross(first[:, :3], second[:, :3]) / length[:, None] ** 3
    return Strains(1.0 - length, np.linalg.norm(binormal, axis=1), binormal, first[:, 3])


def samples(rule: quadrature.Quadrature, knots: Array) -> tuple[Array, Array]:
    """Material coordinates [m] and weights [m] of a rule, shape (m,) each, without its padding."""
    used = rule.weights != 0.0
    return rule.places(bspline.breaks(knots))[used], rule.weights[used]


def counted_stretch(stretch: Array, rule: quadrature.Quadrature, section: Section) -> Array:
    """The stretch that counts at the samples, shape (m,): itself, or by span its best fit by a
    constant, in the first and the last span by a straight line.
    """
    if not section.by_span:
        return stretch
    fitted = np.zeros_like(rule.xi)
    values = stretch.reshape(rule.xi.shape)
    last = len(values) - 1
    for span, (xi, weights) in enumerate(zip(rule.xi, rule.weights, strict=True)):
        degree = 1 if span in (0, last) else 0
        fit = np.polynomial.Polynomial.fit(
            xi, values[span], degree, domain=[-1.0, 1.0], w=np.sqrt(weights)
        )
        fitted[span] = fit(xi)
    return fitted.ravel()


def guard(control_points: Array, knots: Array, section: Section) -> tuple[float, Array]:
    """Energy of the guard [J] and its gradient [N], shape (n, 4); exact integrals over the spans of
    |t|^4 by five Gauss points.
    """
    strength, even, short, least = GUARD
    energy, result = 0.0, np.zeros_like(control_points, dtype=float)
    ends = bspline.breaks(knots)
    xi, weights = np.polynomial.legendre.leggauss(5)
    places = np.concatenate((xi, [-1.0 + 1e-14, 0.0, 1.0 - 1e-14]))
    for i, (begin, length) in enumerate(zip(ends, np.diff(ends), strict=False)):
        _, slopes = bspline.active_basis(knots, begin + 0.5 * length * (1.0 + places), 1)
        active = slice(i, i + bspline.ACTIVE)
        t = slopes @ control_points[active, :3]
        square = (t * t).sum(axis=1)
        off = square[:5] - 0.5 * weights @ square[:5]
        excess = max(0.125 * weights @ off**2 - even, 0.0) * section.by_span
        missing = np.maximum(least - square[5:], 0.0)
        factor = section.EA * length
        energy += 0.5 * factor * (strength * excess**2 + short * (missing @ missing))
        on_even = 0.25 * strength * excess * weights * off
        on_square = factor * np.concatenate((on_even, -short * missing))
        result[active, :3] += slopes.T @ (2.0 * on_square[:, None] * t)
    return energy, result


def natural_curvature(section: Section, share: float) -> Array:
    """kappa0 n [1/m] at u = share L, shape (3,)."""
    values = section.rest_curvature
    value = np.interp(share, np.linspace(0.0, 1.0, len(values)), values)
    return np.asarray(value * np.asarray(section.rest_axis))


def energies(
    control_points: Array, knots: Array, rule: quadrature.Quadrature, section: Section
) -> tuple[float, float, float]:
    """Stretching, bending and twisting energy [J]; zero for the unloaded shape."""
    length = float(knots[-1])
    u, weights = samples(rule, knots)
    strain = strains(control_points, knots, u)
    stretch, bend, twist = guard(control_points, knots, section)[0], 0.0, 0.0
    counted = counted_stretch(strain.stretch, rule, section)
    for i in range(len(u)):
        off = strain.binormal[i] - natural_curvature(section, u[i] / length)
        stretch += 0.5 * weights[i] * section.EA * counted[i] ** 2
        bend += 0.5 * weights[i] * section.EI * (off @ off)
        twist += 0.5 * weights[i] * section.GJ * strain.twist_rate[i] ** 2
    return float(stretch), float(bend), float(twist)


def gradient(
    control_points: Array, knots: Array, rule: quadrature.Quadrature, section: Section
) -> Array:
    """dU/dq of the sum of `energies` [N, N m], shape (n, 4); the elastic force is its negative.

    Chain rule from strain to control point: with s = |t| and m = EI (C/s^3 - kappa0 n) the moment,
    d eps = -t.dt / s,   m . d(C/s^3) = [(k x m).dt + (m x t).dk] / s^3 - 3 (m.C)(t.dt) / s^5.
    """
    length = float(knots[-1])
    u, weights = samples(rule, knots)
    strain = strains(control_points, knots, u)
    first, slopes = bspline.active_basis(knots, u, 1)
    _, curls = bspline.active_basis(knots, u, 2)
    counted = counted_stretch(strain.stretch, rule, section)
    result = guard(control_points, knots, section)[1]
    for i in range(len(u)):
        active = slice(first[i], first[i] + bspline.ACTIVE)
        t = slopes[i] @ control_points[active, :3]
        k = curls[i] @ control_points[active, :3]
        s = float(np.linalg.norm(t))
        moment = section.EI * (strain.binormal[i] - natural_curvature(section, u[i] / length))
        on_t = -section.EA * counted[i] * t / s
        on_t = on_t + np.cross(k, moment) / s**3
        on_t = on_t - 3.0 * (moment @ np.cross(t, k)) * t / s**5
        on_k = np.cross(moment, t) / s**3
        torque = section.GJ * strain.twist_rate[i]
        result[active, :3] += weights[i] * (np.outer(slopes[i], on_t) + np.outer(curls[i], on_k))
        result[active, 3] += weights[i] * torque * slopes[i]
    return result
