"""Prediction of a cable along planned motions of its end effectors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.recorder import CURVATURE, TENSION, Shapes, largest
from dlo_sim.simulation.report import Report

Array = NDArray[np.float64]
EVERY = 0.02  # [s] between two shapes of a forecast
MOST_SHAPES = 10_000  # of one forecast


@dataclass(frozen=True)
class Plan:
    """Planned poses of end effectors; those that are not named continue their present motion.

    Attributes:
        times: of the poses [s], rising from 0, the present, shape (T,).
        poses: end or grasp -> position [m] and quaternion x, y, z, w, shape (T, 7), the first of
            them its present pose.
    """

    times: ArrayLike
    poses: Mapping[str, ArrayLike]


@dataclass(frozen=True)
class Forecast:
    """Predicted shapes.

    Attributes:
        times: of the shapes, counted from the present [s], shape (S,).
        control_points: x, y, z [m] and theta [rad], shape (S, n_u, 4); of a net, as all that
            follows, of the main cable.
        u: material coordinates [m] of the points of the centerline, shape (n_c,).
        centerline: [m], shape (S, n_c, 3). curvature: [1/m], shape (S, n_c).
        tension: [N], shape (S, n_c); None if the shape does not determine it.
        report: of the advance; after a failure only the shapes before it are given.
        obstacles: what `drawn_obstacles` says of them and of contact. They follow their
            motions, also those that have not begun, and rest at the end of the last one.
        warnings: `Simulator.warnings` at the end of it; among them whether the cable passed through
            itself at one of the shapes, or was bent at one too sharply for its knot spans.
        control_points_needed: number that follows such bends; 0 if the present one does.
        contact_stiffness_needed: [N/m^2] with which the cable would not have been pressed in too
            deep; 0 if it was not.
        net: of a net, what `Recorder.net` says of the other cables and of connectors.
    """

    times: Array
    u: Array
    control_points: Array
    centerline: Array
    curvature: Array
    tension: Array | None
    report: Report
    obstacles: dict[str, Array] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    control_points_needed: int = 0
    contact_stiffness_needed: float = 0.0
    net: dict[str, Array] = field(default_factory=dict)

    def cables(self, scene: Scene) -> Iterator[Shapes]:
        """The shapes of all cables of the scene that was predicted, the main one first."""
        own = self.u, self.control_points, self.centerline, self.curvature, self.tension
        yield Shapes(*own)
        for strand in scene.strands[1:]:
            keys = ("centerline_u", "control_points", "centerline", "curvature")
            u, points, line, curvature = (self.net[f"{strand.name}.{key}"] for key in keys)
            yield Shapes(u, points, line, curvature, self.net.get(f"{strand.name}.{TENSION}"))

    def lines(self, scene: Scene) -> Array:
        """Points of all cables [m], one after another, shape (S, cables n_c, 3)."""
        return np.concatenate([one.centerline for one in self.cables(scene)], axis=1)

    @property
    def contact(self) -> dict[str, float]:
        """Largest sum `total` and largest one `largest` of the forces that obstacles and the cable
        itself exert by their pressure [N]; smallest gap `clearance` [m], negative where the cable
        is pressed in, and that between strands `to_itself`, infinite where none are near; empty if
        the cable can touch nothing.
        """
        found = self.obstacles
        if not found:
            return {}
        return {
            "total": float(found["contact_total"].max()),
            "largest": float(found["contact_largest"].max()),
            "clearance": float(found["contact_clearance"].min()),
            "to_itself": float(found["contact_to_itself"].min()),
        }

    @property
    def peak_tension(self) -> float | None:
        """The largest tension of all shapes [N], of any cable."""
        return largest(TENSION, self.tension, self.net)

    @property
    def largest_curvature(self) -> float:
        """The largest curvature of all shapes [1/m], of any cable."""
        return max(largest(CURVATURE, self.curvature, self.net) or 0.0, 0.0)


def checked_times(plan: Plan) -> Array:
    """Times of the poses of a plan [s].

    Raises:
        TypeError, ValueError: no plan, or times that do not begin at 0.
    """
    arguments.instance("plan", plan, Plan, "dlo_sim.Plan(times, poses)")
    arguments.instance("poses", plan.poses, dict, "{'start': numbers (T, 7)}")
    times = arguments.numbers("times", plan.times, (None,), "s")
    if not times.size or times[0] != 0.0:
        raise ValueError(
            f"times: begin with {times[:1].tolist()}; a plan begins at 0 s, the present"
        )
    return times


def shape_times(times: Array, every: float) -> Array:
    """Times of the shapes along a plan [s].

    Args:
        times: of its poses. every: time between two shapes [s].

    Raises:
        TypeError, ValueError: no number, or one that gives too many shapes or none.
    """
    every = arguments.number("every", every, "s, above 0")
    if times[-1] > MOST_SHAPES * every > 0.0:
        least = times[-1] / MOST_SHAPES
        raise ValueError(
            f"every: {every:g} s gives more than {MOST_SHAPES} shapes; give {least:g} s or more"
        )
    if not 0.0 < every <= times[-1]:
        raise ValueError(f"every: {every:g} s; give one above 0 s, up to the {times[-1]:g} s")
    return every * np.arange(1, math.floor(times[-1] / every + 1e-9) + 1)
