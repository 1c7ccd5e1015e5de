"""Twist relative to the Frenet torsion, assembled: strain theta' - gamma (`terms.torsion`)."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, store, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import (
    add_sample,
    bending_at,
    block_of,
    coefficients,
    curve,
    sample_of,
    scatter,
    scatter_lines,
    tangent_at,
)
from dlo_sim.engine.term import ENERGY, FORCE, Term, add_energy
from dlo_sim.terms import torsion


@part
def torsion_scales(shape, model):
    """GJ [N m^2] and the squared curvature floor [1/m^2]."""
    at = shape[layout.SCALES]
    return load(model, at + layout.STIFFNESS_GJ * LANES), load(
        model, at + layout.TORSION_FLOOR * LANES
    )


@part
def third_derivative(p, slope):
    """r''', constant on each span."""
    f = 2.0 * slope * slope
    return f * p[0][2], f * p[1][2], f * p[2][2]


@part
def angle_block(shape, model, x, b):
    """Coefficients of theta' on the spans of a block."""
    at = shape[layout.DIM] * shape[layout.LINE] + layout.MARGIN * shape[layout.STRIDE] + LANES * b
    return coefficients(x, at, shape[layout.STRIDE], model, block_of(shape, b))


@piece(*FORCE)
def force(shape, model, state, _, x, out):
    """out -= gradient of the energy of `terms.torsion`."""
    stiffness, floor = torsion_scales(shape, model)
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p, angle = curve(shape, model, x, b, 1.0), angle_block(shape, model, x, b)
        third = third_derivative(p, s)
        g0 = g1 = g2 = turn = (zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            rate = angle[0] + xi * (angle[1] + xi * angle[2])
            on_t, on_k, on_third, on_rate = torsion.gradient(
                w, floor, tangent_at(p, xi), bending_at(p, xi, s), third, rate
            )
            f = 2.0 * s * s
            g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
            g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
            g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
            g0 = g0[0], g0[1], g0[2] + f * on_third[0]
            g1 = g1[0], g1[1], g1[2] + f * on_third[1]
            g2 = g2[0], g2[1], g2[2] + f * on_third[2]
            turn = turn[0] + on_rate, turn[1] + xi * on_rate, turn[2] + xi * xi * on_rate
        scatter_lines(shape, model, b, g0, g1, g2, -1.0, out)
        at = (
            shape[layout.DIM] * shape[layout.LINE]
            + layout.MARGIN * shape[layout.STRIDE]
            + LANES * b
        )
        scatter(turn, at, shape[layout.STRIDE], model, block, -1.0, out)


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the energy of `terms.torsion` [J]."""
    stiffness, floor = torsion_scales(shape, model)
    total_ = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p, angle = curve(shape, model, x, b, 1.0), angle_block(shape, model, x, b)
        third = third_derivative(p, s)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            rate = angle[0] + xi * (angle[1] + xi * angle[2])
            total_ += torsion.energy(w, floor, tangent_at(p, xi), bending_at(p, xi, s), third, rate)
    add_energy(shape, total_, layout.TORSIONAL, out)


@part
def undefined_torsion(shape, model, scratch, x):
    """Number of samples of one cable with |C| below the curvature floor (`terms.torsion`)."""
    _, floor = torsion_scales(shape, model)
    excess, count = shape[layout.NOTES], 0.0
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        p = curve(shape, model, x, b, 1.0)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            store(scratch, excess, torsion.excess(floor, tangent_at(p, xi), bending_at(p, xi, s)))
            for lane in range(LANES):
                inside = model[at + layout.QUADRATURE * LANES + lane] != 0.0
                count += 1.0 if inside and scratch[excess + lane] < 0.0 else 0.0
    return count


TERM = Term(layout.TORSION, force=force, energy=energy)
