"""A naive chain: lumped masses, discrete-rod bending, stiff links, velocity Verlet, compiled.

The simplest implementation, for comparison. Needs only numpy and numba.
"""

import numba
import numpy as np

PACKAGE = ""  # needs no other package


@numba.njit(cache=True)
def force(x, link, axial, bending, mass, spring, length, f):
    """Forces on all points: gravity, links, bending, end springs along x."""
    n = x.shape[0] - 1
    for i in range(n + 1):
        f[i, 0] = 0.0
        f[i, 1] = 0.0
        f[i, 2] = -9.81 * mass[i]
    f[0, 0] -= spring * x[0, 0]
    f[n, 0] -= spring * (x[n, 0] - length)
    for i in range(n):
        a0, a1, a2 = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1], x[i + 1, 2] - x[i, 2]
        a = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
        pull = axial * (a / link - 1.0) / a
        f[i, 0] += pull * a0
        f[i, 1] += pull * a1
        f[i, 2] += pull * a2
        f[i + 1, 0] -= pull * a0
        f[i + 1, 1] -= pull * a1
        f[i + 1, 2] -= pull * a2
        if i == n - 1:
            break
        b0, b1 = x[i + 2, 0] - x[i + 1, 0], x[i + 2, 1] - x[i + 1, 1]
        b2 = x[i + 2, 2] - x[i + 1, 2]
        b = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        # U = 2 B / l (|a||b| - a.b) / (|a||b| + a.b), tan^2 of half the angle
        p, q = a * b, a0 * b0 + a1 * b1 + a2 * b2
        slope = 4.0 * bending / link / (p + q) ** 2
        u, v = slope * q * b / a, slope * q * a / b  # with dU = slope (q dp - p dq)
        w = slope * p
        g0, g1, g2 = u * a0 - w * b0, u * a1 - w * b1, u * a2 - w * b2
        h0, h1, h2 = v * b0 - w * a0, v * b1 - w * a1, v * b2 - w * a2
        f[i, 0] += g0
        f[i, 1] += g1
        f[i, 2] += g2
        f[i + 1, 0] += h0 - g0
        f[i + 1, 1] += h1 - g1
        f[i + 1, 2] += h2 - g2
        f[i + 2, 0] -= h0
        f[i + 2, 1] -= h1
        f[i + 2, 2] -= h2


@numba.njit(cache=True)
def advance(x, v, first, steps, tau, link, constants, mass, free, push, closing):
    """Advance by whole steps from step number `first`."""
    axial, bending, spring, length, decay = constants
    n = x.shape[0] - 1
    f = np.zeros_like(x)
    damp = np.exp(-0.5 * decay * tau)
    for k in range(first, first + steps + 1):
        if k > first:
            for i in range(n + 1):
                for d in range(3):
                    x[i, d] += tau * v[i, d]
            if closing[0] > 0.0:
                half = 0.5 * closing[1]
                s = min(k * tau, 2.0 * half) / half
                share = 0.5 * s * s if s < 1.0 else 1.0 - 0.5 * (2.0 - s) ** 2
                x[n - 1, 0] = length - closing[0] * share - 0.5 * link
                x[n, 0] = x[n - 1, 0] + link
        force(x, link, axial, bending, mass, spring, length, f)
        sine = np.sin(2.0 * np.pi * push[3] * k * tau)
        for d in range(3):
            f[n // 2, d] += push[d] * sine
        # The half kick that ends the previous step, and the one that starts the next.
        for i in range(n + 1):
            for d in range(3):
                kick = 0.5 * tau * f[i, d] / mass[i] * free[i, d]
                if k > first:
                    v[i, d] = (v[i, d] + kick) * damp
                if k < first + steps:
                    v[i, d] = v[i, d] * damp + kick


def start(job):
    """Points, masses, free coordinates, link length and step of a job."""
    n, kind = job["n"], job["kind"]
    clamps = {"pinned": 0, "hanging": 0, "cantilever": 1, "clamped": 2}[kind]
    link = job["length"] / (n - 0.5 * clamps)
    x = np.outer(np.arange(n + 1) * link - (0.5 * link if clamps else 0.0), job["direction"])
    mass = np.full(n + 1, job["mu"] * link)
    mass[[0, n]] *= 0.5
    free = np.ones((n + 1, 3))
    if kind == "pinned":
        free[[0, n], 1:] = 0.0
    elif kind == "hanging":
        free[0] = 0.0
    else:
        free[:2] = 0.0
    if kind == "clamped":
        free[-2:] = 0.0
    waves = 2.0 / link * np.sqrt(job["EA"] / job["mu"])
    bends = 4.0 / link**2 * np.sqrt(job["EI"] / job["mu"])
    tau = 0.93 * 2.0 / np.hypot(waves, bends)
    return x, mass, free, link, job["every"] / np.ceil(job["every"] / tau)


class Cable:
    """A chain in motion; see `serve`."""

    def __init__(self, job):
        self.x, mass, free, link, self.step = start(job)
        self.v = np.zeros_like(self.x)
        spring = job["spring"] if job["kind"] == "pinned" else 0.0
        constants = (job["EA"], job["EI"], spring, job["length"], job["damping"])
        push = np.array([*job["force"], job["frequency"]])
        closing = np.array([job["closed"] if job["kind"] == "clamped" else 0.0, job["closing"]])
        self.rest = (self.step, link, constants, mass, free, push, closing)
        self.observed = [round(u * job["n"]) for u in job["observed"]]

    def look(self, first, steps):
        """Observed points."""
        return self.x[self.observed]

    def advance(self, first, steps):
        """Steps."""
        advance(self.x, self.v, first, steps, *self.rest)
