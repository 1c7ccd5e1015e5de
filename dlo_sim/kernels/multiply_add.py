"""A plain fused multiply-add loop: what one core does when nothing but arithmetic is asked of
it."""

from __future__ import annotations

from dlo_sim.kernels.jit import entry

CHAIN = 32  # multiply-adds per element and pass


@entry
def multiply_add(x, factor, summand, passes):
    """x <- factor x + summand, CHAIN times per pass and element; len(x) a multiple of 128.

    The 128 elements in flight hide the latency of one multiply-add, and nothing but registers is
    touched inside a chain. Floating-point operations: 2 CHAIN passes len(x).
    """
    for _ in range(passes):
        for i in range(x.shape[0]):
            value = x[i]
            for _ in range(CHAIN):
                value = value * factor + summand
            x[i] = value
