"""The law of contact, the same for obstacles, for strands of the cable, and for rolling.

**Pressure** p on a step from the gap g0 to g1, per length of cable, with the share s of the way
that is inside: the divided difference p_el = - k s (depth0 + depth1) / 2 of the energy
k/2 depth^2, depth < 0, plus damping. Where a sample lands or rests, l = 1, and p = - k depth1:
contact may be as stiff as it likes, as what a step leaves over does not swing back. Where it slid
in the step before, l is nearly 0: pressures at the ends of steps would lag behind the places of
contact and brake the cable.

**Friction** f = - min(1, mu p / |T|) T with the trial force T = k_t P z0 + (k_t + c_t) P dy, P
normal to n, and the bristle z, an elastic displacement along the surface with the energy k_t/2 z^2
and the damping c_t over the length of the step. It ends as z1 = (c_t P z0 - f) / (k_t + c_t), or
zero where nothing touches.

**Losses**, no part of which is negative:
    (p - p_el) (g0 - g1) + (k_t/2 + c_t) |z1 - P z0|^2 + k_t/2 (|z0|^2 - |P z0|^2)
    - f.(P z0 + P dy - z1).

**Jacobian.** With the direction m in which the end of the step changes the gap, and e = T / |T|,
    - d (p n + f) = (- p' n + mu p' e) m . dy1 + S dy1,   S = h (1 - n n / |n|^2 - e e),
with h, the share of k_t + c_t that holds; mu p' e and e e only where friction slides.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import fabs, sqrt, where
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, dot

TINY = 1e-30
HOLDS = 1e-15  # of the trial force, by which friction may be less while it counts as all of it


@inline
def sign(a):
    """1 where a > 0, else -1."""
    return where(a, 1.0, -1.0)


@inline
def scaled(f, v):
    """f v."""
    return f * v[0], f * v[1], f * v[2]


@inline
def only(condition, v):
    """v on the lanes where the condition is above 0, else zero."""
    return where(condition, v[0], 0.0), where(condition, v[1], 0.0), where(condition, v[2], 0.0)


@inline
def along(n, v):
    """P v = v - n (n . v) / |n|^2."""
    return combined(1.0, v, -dot(n, v) / (dot(n, n) + TINY), n)


@inline
def pressure(k, damping, lands, g0, g1):
    """p, dp/dg1 and the loss by damping, for gaps before and after; `damping`: c over the length of
    the step, `lands`: l.
    """
    deep, inverse = depth(g0) + depth(g1), 1.0 / (fabs(g0) + fabs(g1) + TINY)
    share, up, closing = -deep * inverse, sign(g1), g1 - g0
    elastic = -0.5 * k * deep * share
    p = elastic - damping * share * closing
    slope = -0.5 * k * share * (1.0 - up + share * up) - damping * share
    slope += damping * closing * inverse * (0.5 * (1.0 - up) + share * up)
    far = where(g0, 0.5 * k * lands * (1.0 - share), 0.0)
    p, slope = p - far * depth(g1), slope - where(g1, 0.0, far * (1.0 - share))
    p = where(p, p, 0.0)
    return p, where(p, slope, 0.0), (elastic - p) * closing


@inline
def held_share(limit, trial):
    """Share of a trial force that friction of at most `limit` holds, and the size of it."""
    size = sqrt(dot(trial, trial)) + TINY
    return where(limit - size, 1.0, limit / size), size


@inline
def friction(k_t, whole, mu, p, n, dy, z):
    """T, the share of it that holds, z1 and the loss; `whole`: k_t + c_t."""
    held, slip = along(n, z), along(n, dy)
    trial = combined(k_t, held, whole, slip)
    share, _ = held_share(mu * p, trial)
    z1 = only(p, scaled(1.0 / whole, combined(whole - k_t, held, share, trial)))
    change = combined(1.0, z1, -1.0, held)
    slid = combined(1.0, slip, -1.0, change)
    full = dot(z, z)
    loss = (whole - 0.5 * k_t) * dot(change, change) + 0.5 * k_t * (full - dot(held, held))
    return trial, share, z1, where(p, loss + share * dot(trial, slid), 0.5 * k_t * full)


@inline
def friction_jacobian(whole, mu, p, slope, n, trial):
    """S by rows, and the vector mu p' e by which friction changes with the gap."""
    share, size = held_share(mu * p, trial)
    slides = where(share - 1.0 + HOLDS, 0.0, 1.0)
    e, hold = scaled(1.0 / size, trial), share * whole
    a, b = scaled(hold / (dot(n, n) + TINY), n), scaled(hold * slides, e)
    xy, xz = -a[0] * n[1] - b[0] * e[1], -a[0] * n[2] - b[0] * e[2]
    yz = -a[1] * n[2] - b[1] * e[2]
    rows = (
        (hold - a[0] * n[0] - b[0] * e[0], xy, xz),
        (xy, hold - a[1] * n[1] - b[1] * e[1], yz),
        (xz, yz, hold - a[2] * n[2] - b[2] * e[2]),
    )
    return rows, scaled(mu * slides * slope, e)


@inline
def with_product(h, a, b):
    """h + a b^T of a matrix by rows."""
    return combined(1.0, h[0], a[0], b), combined(1.0, h[1], a[1], b), combined(1.0, h[2], a[2], b)


@inline
def product(h, v):
    """h v of a matrix by rows."""
    return dot(h[0], v), dot(h[1], v), dot(h[2], v)


@inline
def product_from_left(v, h):
    """v^T h of a matrix by rows."""
    return combined(1.0, combined(v[0], h[0], v[1], h[1]), v[2], h[2])
