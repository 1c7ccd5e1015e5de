"""Linear system of an implicit step with couplings outside the band: LU factors in a skyline.

Where the cable touches itself, control points that are far apart along it act on each other. Row r
of the lower factor then begins at column `begin[r]`, left of the band, and column r of the upper
one at the same row; nothing is filled in outside. Row and column lie in `work.skyline` behind each
other, from `place[r]` on, `begin[r]` to r - 1 each; the inverse pivots in `work.skyline_pivot`.

Factors are dot products of a row and a column (Crout's algorithm), so a few long rows, as of two
strands that cross, cost little, and a knot costs what a dense block of its control points does.
"""

from __future__ import annotations

from numba import boolean, int64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane_sum, zero
from dlo_sim.engine.arrays import CABLE, LINES, PADDING, SELF, VECTOR


@inline
def begin_skyline(cable):
    """The skyline of the band alone."""
    begin, lines = cable.work.skyline_begin, cable.lines
    for r in range(len(begin)):
        begin[r] = max(r - r % lines - 3 * lines, 0)


@inline
def reach_to(cable, first, other):
    """Let the four control points from `other` on couple with those from `first` on, which is not
    larger.
    """
    begin, lines = cable.work.skyline_begin, cable.lines
    for r in range(lines * other, lines * (other + 4)):
        begin[r] = min(begin[r], lines * first)


@kernel(boolean, CABLE, LINES, terms=SELF)
def open_skyline(cable, band):
    """Copy the band matrix into the skyline; returns whether there is room."""
    work, half = cable.work, 4 * cable.lines - 1
    sky, begin, place = work.skyline, work.skyline_begin, work.skyline_place
    at = 0
    for r in range(len(begin)):
        place[r] = at
        at += 2 * (r - begin[r])
        if at + LANES > len(sky):
            return False
    for r in range(len(begin)):
        low, row = begin[r], place[r]
        column = row + r - low
        for c in range(low, r):
            inside = r - c <= half
            sky[row + c - low] = band[r, c - r + half] if inside else 0.0
            sky[column + c - low] = band[c, r - c + half] if inside else 0.0
        work.skyline_pivot[r] = band[r, half]
    return True


@inline
def add_entry(work, r, c, value):
    """Add to entry (r, c) of the matrix."""
    if r > c:
        work.skyline[work.skyline_place[r] + c - work.skyline_begin[r]] += value
    elif c > r:
        column = work.skyline_place[c] + c - work.skyline_begin[c]
        work.skyline[column + r - work.skyline_begin[c]] += value
    else:
        work.skyline_pivot[r] += value


@inline
def product(sky, a, b, count):
    """Sum of sky[a + k] sky[b + k] over k < count."""
    rest = count % LANES
    sum_ = 0.0
    for k in range(rest):
        sum_ += sky[a + k] * sky[b + k]
    lanes = zero()
    for k in range(rest, count, LANES):
        lanes += load(sky, a + k) * load(sky, b + k)
    return sum_ + lane_sum(lanes)


@kernel(boolean, CABLE, terms=SELF)
def eliminate_skyline(cable):
    """LU factorisation in place without pivoting, as `band.eliminate`."""
    work = cable.work
    sky, begin, place, pivot = (
        work.skyline,
        work.skyline_begin,
        work.skyline_place,
        work.skyline_pivot,
    )
    for r in range(len(begin)):
        low, row = begin[r], place[r]
        column = row + r - low
        for c in range(low, r):
            start = max(low, begin[c])
            other, count = place[c] + start - begin[c], c - start
            upper = other + c - begin[c]
            if count > 0:
                sky[row + c - low] -= product(sky, row + start - low, upper, count)
                sky[column + c - low] -= product(sky, column + start - low, other, count)
            sky[row + c - low] *= pivot[c]
        value = pivot[r] - product(sky, row, column, r - low)
        if not abs(value) > 0.0 or value - value != 0.0:
            return False
        pivot[r] = 1.0 / value
    return True


@kernel(void, CABLE, int64, VECTOR, terms=SELF)
def substitute_skyline(cable, size, x):
    """Forward and back substitution in place; unknown r is x[PADDING + r]."""
    work = cable.work
    sky, begin, place = work.skyline, work.skyline_begin, work.skyline_place
    for r in range(size):
        low, row = begin[r], place[r]
        value = x[PADDING + r]
        for c in range(low, r):
            value -= sky[row + c - low] * x[PADDING + c]
        x[PADDING + r] = value
    for r in range(size - 1, -1, -1):
        low = begin[r]
        column = place[r] + r - low
        value = x[PADDING + r] * work.skyline_pivot[r]
        x[PADDING + r] = value
        for c in range(low, r):
            x[PADDING + c] -= sky[column + c - low] * value


@kernel(void, CABLE, int64, int64, int64, LINES, terms=SELF)
def substitute_skyline_columns(cable, size, first, column, z):
    """`substitute_skyline` for eight columns of z from `column` on, zero before row `first`."""
    work = cable.work
    sky, begin, place = work.skyline, work.skyline_begin, work.skyline_place
    for r in range(first, size):
        low, row = begin[r], place[r]
        value = load(z, PADDING + r, column)
        for c in range(max(low, first), r):
            value -= sky[row + c - low] * load(z, PADDING + c, column)
        store(z, PADDING + r, column, value)
    for r in range(size - 1, -1, -1):
        low = begin[r]
        above = place[r] + r - low
        value = load(z, PADDING + r, column) * work.skyline_pivot[r]
        store(z, PADDING + r, column, value)
        for c in range(low, r):
            store(
                z, PADDING + c, column, load(z, PADDING + c, column) - sky[above + c - low] * value
            )
