"""Named access to the tables of whole numbers (`engine.layout`)."""

from __future__ import annotations

from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout


@part
def first_of_point(shape, point):
    """Index of the first of the four control points that a held point depends on."""
    return shape[shape[layout.POINT_TABLE] + layout.POINT_ENTRIES * point]


@part
def is_twist(shape, point):
    """1 for a held point of the twist angle, 0 in space."""
    return shape[shape[layout.POINT_TABLE] + layout.POINT_ENTRIES * point + 1]


@part
def own_of(shape, point):
    """Control point that coincides with a held point, -1 if there is none."""
    return shape[shape[layout.POINT_TABLE] + layout.POINT_ENTRIES * point + 2]


@part
def point_of(shape, k):
    """Held point of row k."""
    return shape[shape[layout.ROW_TABLE] + layout.ROW_ENTRIES * k]


@part
def grasp_of(shape, k):
    """Grasp of held row k."""
    return shape[shape[layout.ROW_TABLE] + layout.ROW_ENTRIES * k + 1]


@part
def line_of(shape, k):
    """Line of held row k, -1 if its direction turns with its grasp."""
    return shape[shape[layout.ROW_TABLE] + layout.ROW_ENTRIES * k + 2]


@part
def spring_first(shape, k):
    """First control point of spring row k."""
    return shape[shape[layout.SPRING_TABLE] + layout.SPRING_ENTRIES * k]


@part
def spring_grasp(shape, k):
    """Grasp of spring row k."""
    return shape[shape[layout.SPRING_TABLE] + layout.SPRING_ENTRIES * k + 1]


@part
def spring_line(shape, k):
    """Line of spring row k."""
    return shape[shape[layout.SPRING_TABLE] + layout.SPRING_ENTRIES * k + 2]
