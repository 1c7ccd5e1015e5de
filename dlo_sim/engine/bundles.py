"""Tuples of arrays that calls from Python pass together: of a cable, and of a recorder."""

from __future__ import annotations

from dlo_sim.compiling.lanes import bare
from dlo_sim.compiling.pieces import NUMBERS, REALS, TABLE, WHOLES, bundle, part

CABLE = bundle(WHOLES, REALS, REALS, REALS, REALS)  # the arrays of `engine.layout`
RECORDS = bundle(REALS, REALS, REALS, WHOLES)  # those of `engine.sampling`
BARE_RECORDS = bundle(NUMBERS, NUMBERS, NUMBERS, TABLE)


@part
def bared(cable):
    """shape, model, inputs, state, scratch as bare addresses (`compiling.lanes`)."""
    shape, model, inputs, state, scratch = cable
    return bare(shape), bare(model), bare(inputs), bare(state), bare(scratch)


@part
def bared_records(records):
    """times, samples, energies, marks as bare addresses."""
    times, samples, powers, marks = records
    return bare(times), bare(samples), bare(powers), bare(marks)
