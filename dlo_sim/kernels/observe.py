"""Looking at a state without changing it: velocities, energies, divergence, samples."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.banded import difference_form, quadratic_form
from dlo_sim.kernels.elastic import elastic_energy, tangent_coefficients
from dlo_sim.kernels.ends import end_velocities
from dlo_sim.kernels.jit import entry, kernel, shared
from dlo_sim.kernels.layout import (
    BOOKED,
    DISSIPATED,
    DRIVE_WORK,
    ENERGY_ERROR,
    ENERGY_START,
    EXCHANGED,
    FLOOR,
    LOAD_WORK,
    PENDING,
    PLASTIC_WORK,
    POTENTIAL_START,
    TORSION_LOOKS,
    TORSION_SUM,
    TORSION_WORST,
)
from dlo_sim.kernels.plastic import plastic_energy
from dlo_sim.kernels.span_stretch import span_stretch_energy
from dlo_sim.kernels.torsion import count_undefined, torsion_energy

DIVERGED_SHARE = 0.5  # of the energy exchanged so far; a usable run stays far below
RESOLUTION = 1e6  # times the round-off of the energies: below that, differences mean nothing
EPSILON = 2.2e-16

# The terms that `start_account` reads.
ACCOUNT_TERMS = ("lattice", "axes", "stretch", "span_stretch", "bend", "frenet", "gravity")


@kernel
def prescribed_column(j, n):
    """Control point of column j of a shift matrix."""
    return j if j < 2 else n - 4 + j


@shared
def add_drive_velocity(drive, free, t, n, axes, out):
    """Turn w into velocities: prescribed values in place, v_f = w - shift v_p."""
    if drive is not None:
        end_velocities(drive.motion, t, n, axes, free, out)
        for j in range(4):
            column = prescribed_column(j, n)
            for d in range(out.shape[0]):
                rate = out[d, column]
                if free[d, column] == 0.0 and rate != 0.0:
                    for i in range(n):
                        # shift vanishes on prescribed rows, so `rate` itself stays
                        out[d, i] -= drive.shift[d, j, i] * rate


@entry
def velocities(w, terms, t, out):
    """Velocities of all control points at time t, from the momentum variable w."""
    n = terms.lattice.n
    for d in range(out.shape[0]):
        for i in range(n):
            out[d, i] = w[d, i]
    add_drive_velocity(terms.drive, terms.mass.free, t, n, terms.axes, out)


@kernel
def twist_energy(x, twist, n, row):
    """Twisting energy [J]."""
    if twist is not None:
        return 0.5 * difference_form(twist.stiffness, n, x[row])
    return 0.0


@kernel
def gravity_energy(x, gravity, n):
    """Energy in the field of gravity [J], zero at the world's origin."""
    total = 0.0
    if gravity is not None:
        for d in range(gravity.shape[0]):
            for i in range(n):
                total -= gravity[d, i] * x[d, i]
    return total


@kernel
def spring_energy(x, springs, n):
    """Energy of the end springs [J]."""
    total = 0.0
    if springs is not None:
        for d in range(springs.stiffness.shape[1]):
            start = x[d, 0] - springs.anchor[0, d]
            end = x[d, n - 1] - springs.anchor[1, d]
            total += 0.5 * springs.stiffness[0, d] * start * start
            total += 0.5 * springs.stiffness[1, d] * end * end
    return total


@entry
def potentials(x, terms, work):
    """Stretch, bend, twist, gravity and spring energy [J]."""
    n = terms.lattice.n
    tangent_coefficients(x, terms.lattice, terms.axes, work.coefficients)
    stretch, bend = elastic_energy(
        work.coefficients,
        terms.lattice,
        terms.stretch,
        terms.bend,
        terms.rest,
        terms.axes,
        work.gradient,
    )
    stretch += span_stretch_energy(work.coefficients, terms.lattice, terms.span_stretch, terms.axes)
    torsion = torsion_energy(x, terms.lattice, terms.frenet, terms.axes, work.coefficients)
    return (
        stretch,
        bend + plastic_energy(terms.lattice, terms.plastic, work.coefficients),
        twist_energy(x, terms.twist, n, len(terms.axes)) + torsion,
        gravity_energy(x, terms.gravity, n),
        spring_energy(x, terms.springs, n),
    )


@entry
def kinetic_energy(w, mass, n):
    """w^T M w / 2 [J]. For w it is the energy of the free motion, for velocities all of it."""
    total = 0.0
    for d in range(w.shape[0]):
        total += 0.5 * quadratic_form(mass.band[d], n, w[d])
    return total


@kernel
def gravity_size(x, gravity, n):
    """Sum of the sizes of the weight's energy [J]: it is large far from the world's origin."""
    total = 0.0
    if gravity is not None:
        for d in range(gravity.shape[0]):
            for i in range(n):
                total += abs(gravity[d, i] * x[d, i])
    return total


@kernel
def stiffness_of(term):
    """Stiffness of a term, 0 without it."""
    if term is not None:
        return term.stiffness
    return 0.0


@kernel
def strain_round_off(stiffness, energy, strain):
    """Round-off of an energy E = k eps^2 / 2 [J] whose strain is known to `strain`:
    k (eps strain + strain^2). It outweighs that of E itself where the strain is small.
    """
    return np.sqrt(2.0 * abs(energy) * stiffness) * strain + stiffness * strain * strain


@kernel
def energy_floor(stretched, bent, others, reach, span, length, axial, bending):
    """Energy [J] below which differences mean nothing, for one cable and for a lane of a stack.

    Strain is a difference of coordinates over a span, curvature one over the square of a span, so
    their round-off grows with the number of spans and with the distance from the origin.

    Args:
        stretched, bent: energies [J]; others: sum of the sizes of all others. reach: the largest
            coordinate [m]. span: length of a knot span [m]. length: of the cable [m].
        axial, bending: EA [N] and EI [N m^2], 0 without the term.
    """
    strain = EPSILON * (1.0 + reach / span)
    noise = EPSILON * (abs(stretched) + abs(bent) + others)
    noise += strain_round_off(axial * length, stretched, strain)
    noise += strain_round_off(bending * length, bent, strain / span)
    return RESOLUTION * noise


@kernel
def raise_floor(state, terms, parts, kinetic):
    """Raise the account's floor to that of the present state."""
    lattice = terms.lattice
    reach = 0.0
    for d in range(len(terms.axes)):
        for i in range(lattice.n):
            reach = max(reach, abs(state.position[d, i]))
    span = 2.0 / lattice.slope
    floor = energy_floor(
        parts[0],
        parts[1],
        abs(parts[2]) + parts[4] + kinetic + gravity_size(state.position, terms.gravity, lattice.n),
        reach,
        span,
        span * (lattice.n - 3.0),
        stiffness_of(terms.stretch) + stiffness_of(terms.span_stretch),
        stiffness_of(terms.bend),
    )
    state.ledger[FLOOR] = max(state.ledger[FLOOR], floor)


@entry
def start_account(state, terms, work, parts, kinetic):
    """Open the energy account at a state of which these are the energies [J].

    work.coefficients are those that `potentials` has left there.
    """
    ledger = state.ledger
    raise_floor(state, terms, parts, kinetic)
    ledger[EXCHANGED] = kinetic
    total = kinetic
    for i in range(5):
        ledger[POTENTIAL_START + i] = parts[i]
        total += parts[i]
    ledger[LOAD_WORK] = 0.0
    ledger[DRIVE_WORK] = 0.0
    ledger[DISSIPATED] = 0.0
    ledger[ENERGY_START] = total
    ledger[ENERGY_ERROR] = 0.0
    ledger[BOOKED] = 0.0
    ledger[PENDING] = 0.0
    ledger[PLASTIC_WORK] = 0.0
    ledger[TORSION_LOOKS] = 0.0
    ledger[TORSION_SUM] = 0.0
    ledger[TORSION_WORST] = 0.0
    count_undefined(terms.lattice, terms.frenet, work.coefficients, ledger)


@kernel
def update_account(state, terms, work):
    """Compare the energy with work done and energy lost; returns (energy [J], still sane)."""
    ledger = state.ledger
    kinetic = kinetic_energy(state.w, terms.mass, terms.lattice.n)
    parts = potentials(state.position, terms, work)
    count_undefined(terms.lattice, terms.frenet, work.coefficients, ledger)
    total = kinetic
    exchanged = max(ledger[EXCHANGED], kinetic)
    for i in range(5):
        total += parts[i]
        exchanged = max(exchanged, abs(parts[i] - ledger[POTENTIAL_START + i]))
    exchanged = max(exchanged, max(abs(ledger[LOAD_WORK]), abs(ledger[DRIVE_WORK])))
    error = abs(
        total
        - ledger[ENERGY_START]
        - ledger[LOAD_WORK]
        - ledger[DRIVE_WORK]
        - ledger[PENDING]
        + ledger[DISSIPATED]
    )
    raise_floor(state, terms, parts, kinetic)
    ledger[EXCHANGED] = exchanged
    ledger[ENERGY_ERROR] = max(ledger[ENERGY_ERROR], error)
    sane = np.isfinite(total) and error <= DIVERGED_SHARE * max(exchanged, ledger[FLOOR])
    return total, sane


@kernel
def begin_sample(state, terms, work, recorder, t0, tau):
    """Keep the state before a step if a sample falls into it; true if so."""
    k = recorder.next[0]
    if k < recorder.times.shape[0] and recorder.times[k] <= t0 + tau * (1.0 + 1e-9):
        for d in range(state.position.shape[0]):
            for i in range(terms.lattice.n):
                recorder.before[d, i] = state.position[d, i]
        velocities(state.w, terms, t0, work.v0)
        return True
    return False


@kernel
def end_sample(state, terms, work, recorder, t0, tau):
    """Store every sample time inside the step: cubic Hermite between the states at its two ends.

    The energy is that of the state at the end of the step.
    """
    n = terms.lattice.n
    velocities(state.w, terms, t0 + tau, work.v1)
    energy, _ = update_account(state, terms, work)
    while recorder.next[0] < recorder.times.shape[0]:
        k = recorder.next[0]
        s = (recorder.times[k] - t0) / tau
        if s > 1.0 + 1e-9:
            break
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * (1.0 - s) * (1.0 - s) * tau
        c = s * s * (3.0 - 2.0 * s)
        e = s * s * (s - 1.0) * tau
        if abs(s - 1.0) < 1e-9:
            a, b, c, e = 0.0, 0.0, 1.0, 0.0
        for d in range(state.position.shape[0]):
            for i in range(n):
                recorder.positions[k, d, i] = (
                    a * recorder.before[d, i]
                    + b * work.v0[d, i]
                    + c * state.position[d, i]
                    + e * work.v1[d, i]
                )
        recorder.energies[k] = energy
        recorder.next[0] = k + 1
