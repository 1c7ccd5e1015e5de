"""The axial tension as an unknown of its own in Newton's method.

A cable is stiff along itself. A correction that turns it stretches it in second order, and the
tension which that seems to cause dwarfs all other forces: with the tension of each iterate in the
Jacobian, the number of iterations grows with EA. So the tension at each quadrature point is a
second unknown, T = EA eps, with Newton's method for both equations. It is eliminated at once: the
solution, the residual and the band matrix stay the same, but the geometric stiffness has the
tension that the last correction predicted to first order,
    T / EA = eps(q) + d eps/dq . correction.
The number of iterations then does not depend on EA.

A cable of constant length (`physics.keeps_length`) is the limit of an infinite EA. There T is the
multiplier of the constraint eps = 0, which is kept from iterate to iterate: the force is that of
T + EA eps, with EA as the penalty factor of an augmented Lagrangian, and every correction adds
EA times the strain that remains. Any EA that exceeds the other stiffnesses gives the same solution.

Rigid bodies have predicted stresses of the same kind (`engine.rigid_body`); the functions here set
both.

`state.tension` holds T / EA at the quadrature points; eps is the local or the projected strain
(`engine.elastic`), in a step the mean of those at its two configurations, or half the one at its
end for a cable of constant length.

Source: mixed integration points, Magisano, Leonetti & Garcea 2017, Int. J. Numer. Meth. Eng. 109,
1237-1262.
"""

from __future__ import annotations

from numba import float64, void
from numba.types import UniTuple

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import lane_sum, sqrt, zero
from dlo_sim.engine import rigid_body
from dlo_sim.engine.arrays import ANY_STRETCH, BETWEEN, CABLE, IMPLICIT, LINES, SPAN_STRETCH
from dlo_sim.engine.spans import curve, span_strains, tangent_at
from dlo_sim.terms import stretch
from dlo_sim.terms.vectors import combined, dot

TURN = 3.0  # change of a tangent by a correction, in its largest entry per span length: an estimate


@inline
def strain_rates(mesh, b, p, q, moved):
    """m and l (`elastic`) of the strain increment in a motion, at the midpoint of p and q."""
    average, slope, share = zero(), zero(), mesh.share[b]
    for j in range(mesh.xi.shape[1]):
        xi = mesh.xi[b, j]
        t = combined(0.5, tangent_at(p, xi), 0.5, tangent_at(q, xi))
        f = share * mesh.weight[b, j]
        f = f * dot(t, tangent_at(moved, xi)) / sqrt(dot(t, t))
        average += f
        slope += xi * f
    return average, slope


@inline
def local_strain(cable, xi, span, t):
    """The strain at a quadrature point with the tangent t; `span`: m and l times its factor."""
    if cable.terms & SPAN_STRETCH:
        return span[0] + xi * span[1]
    return stretch.strain(dot(t, t))


@inline
def strains_of_span(cable, b, p):
    """m and l times its factor f, where stretching counts by span, else zeros."""
    if cable.terms & SPAN_STRETCH:
        average, slope = span_strains(cable.mesh, b, p)
        return average, cable.mesh.linear[b] * slope
    return zero(), zero()


@kernel(void, CABLE, LINES, LINES, LINES, float64, family=IMPLICIT | BETWEEN)
def predict_tension(cable, x0, x1, moved, share):
    """Predict the tension for a correction `moved` of x1, the end of a step from x0:
        T / EA = (share eps(x0) + eps(x1) + d eps/dx1 . moved) / 2,
    plus the old one for a cable of constant length. `share` is 1 where the strain at x0 counts,
    too: not in a step that keeps the length. With x0 = x1 at the middle of a step, `moved` counts
    by half.
    """
    rigid_body.predict(cable, x0, x1, moved)
    if not cable.terms & ANY_STRETCH:
        return
    mesh, tension, before = cable.mesh, cable.state.tension, cable.work.tension_before
    kept = cable.physics.keeps_length
    for b in range(cable.blocks):
        p, q, r = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0), curve(cable, moved, b, 0.0)
        s0, s1, rate = strains_of_span(cable, b, p), strains_of_span(cable, b, q), (zero(), zero())
        if cable.terms & SPAN_STRETCH:
            average, slope = strain_rates(mesh, b, q, q, r)
            rate = average, mesh.linear[b] * slope
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            ta, tb = tangent_at(p, xi), tangent_at(q, xi)
            now = share * local_strain(cable, xi, s0, ta) + local_strain(cable, xi, s1, tb)
            if cable.terms & SPAN_STRETCH:
                now += rate[0] + xi * rate[1]
            else:
                now += dot(tb, tangent_at(r, xi)) / sqrt(dot(tb, tb))
            before[b, j] = tension[b, j]
            tension[b, j] = 0.5 * now + kept * tension[b, j]


@inline
def shorten_tension(cable, share):
    """Leave this share of the last prediction."""
    rigid_body.shorten(cable, share)
    tension, before = cable.state.tension, cable.work.tension_before
    for b in range(cable.blocks):
        for j in range(cable.samples):
            tension[b, j] = before[b, j] + share * (tension[b, j] - before[b, j])


@kernel(void, CABLE, LINES, LINES)
def take_tension(cable, x0, x1):
    """Set the tension to that of the mean strain at x0 and x1; that of a cable of constant length
    stays.
    """
    mesh, tension = cable.mesh, cable.state.tension
    rigid_body.take(cable, x0, x1)
    if not cable.terms & ANY_STRETCH or cable.physics.keeps_length != 0.0:
        return
    for b in range(cable.blocks):
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        s0, s1 = strains_of_span(cable, b, p), strains_of_span(cable, b, q)
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            now = local_strain(cable, xi, s0, tangent_at(p, xi))
            tension[b, j] = 0.5 * (now + local_strain(cable, xi, s1, tangent_at(q, xi)))


@inline
def may_stretch(cable, moved, allowed):
    """Whether a correction whose largest entry is `moved` [m] may cause a strain beyond the
    predicted one of more than the energy `allowed` [J]: that strain is of second order.
    """
    if rigid_body.may_strain(cable, moved, allowed):
        return True
    turned = TURN * moved / cable.physics.shortest_span
    strain = turned * turned
    return cable.physics.axial_round_off * strain * strain > allowed


@inline
def copy_tension(source, target):
    """target = source."""
    for b in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[b, j] = source[b, j]


@kernel(UniTuple(float64, 2), CABLE, LINES, LINES, LINES, family=IMPLICIT)
def unpredicted(cable, x0, x1, moved):
    """What the strain e of a step from x0 to x1 has beyond the predicted tension, as integrals of
    EA e^2 and of EA e d eps along `moved` [J]: a bound of its energy, and the work against it.
    """
    energy, work = zero(), zero()
    of_bodies = rigid_body.unpredicted(cable, x0, x1, moved)
    if not cable.terms & ANY_STRETCH:
        return of_bodies
    mesh, tension, elastic = cable.mesh, cable.state.tension, 1.0 - cable.physics.keeps_length
    for b in range(cable.blocks):
        p, q, r = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0), curve(cable, moved, b, 0.0)
        s0, s1 = strains_of_span(cable, b, p), strains_of_span(cable, b, q)
        for j in range(cable.samples):
            xi, f = mesh.xi[b, j], mesh.weight[b, j] * mesh.axial[b]
            ta, tb = tangent_at(p, xi), tangent_at(q, xi)
            strain = elastic * local_strain(cable, xi, s0, ta) + local_strain(cable, xi, s1, tb)
            strain = 0.5 * strain - elastic * tension[b, j]
            along = dot(combined(1.0, ta, 1.0, tb), tangent_at(r, xi))
            energy += f * strain * strain
            work += f * strain * along / (sqrt(dot(ta, ta)) + sqrt(dot(tb, tb)))
    return lane_sum(energy) + of_bodies[0], lane_sum(work) + of_bodies[1]
