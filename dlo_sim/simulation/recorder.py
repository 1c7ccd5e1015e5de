"""A buffer for the samples of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.core.strain import strain
from dlo_sim.engine.arrays import Records
from dlo_sim.scene.nets import Connector
from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.obstacles import surface

Array = NDArray[np.float64]


TENSION, CURVATURE = "tension", "curvature"  # fields of `Shapes`


class Shapes(NamedTuple):
    """Shapes of a cable at material coordinates u [m], shape (n_c,).

    Attributes:
        control_points: x, y, z [m] and theta [rad], world frame, shape (T, n_u, 4).
        centerline: points of the cable [m], shape (T, n_c, 3). curvature: [1/m], shape (T, n_c).
        tension: [N], shape (T, n_c); None if the shape does not determine it.
    """

    u: Array
    control_points: Array
    centerline: Array
    curvature: Array
    tension: Array | None


class Recorder:
    """A buffer for one sample of the state at each of these times.

    Args:
        times: rising [s], shape (T,).
    """

    def __init__(self, model: Model, times: Array) -> None:
        self.model = model
        self._records = Records(model.arrays.sizes | {"count": len(times)})
        self._records.times[:] = times
        self._obstacles: list[tuple[int, Array]] = []  # first sample, rows from there on

    @property
    def address(self) -> int:
        """The last argument of the compiled loops."""
        return self._records.address

    @property
    def times(self) -> Array:
        """Times of the samples [s], shape (T,)."""
        return self._records.times

    @property
    def energies(self) -> Array:
        """Energies at the ends of the steps that contain the samples [J], shape (T,)."""
        return self._records.energy

    @property
    def count(self) -> int:
        """Number of samples taken."""
        return int(self._records.marks[0])

    def forget(self, count: int) -> None:
        """Discard all but the first `count` samples."""
        self._records.marks[0] = min(self.count, count)

    def keep_obstacles(self, rows: Array) -> None:
        """Store rows of `Cable.obstacles`, which hold for the samples to come."""
        if not (self._obstacles and np.array_equal(self._obstacles[-1][1], rows)):
            self._obstacles.append((self.count, rows.copy()))

    def obstacles(self) -> list[tuple[slice, Array]]:
        """Rows of `Cable.obstacles`, each with the samples taken at which they held."""
        ends = [*(first for first, _ in self._obstacles[1:]), self.count]
        parts = zip(self._obstacles, ends, strict=True)
        return [(slice(first, end), rows) for (first, rows), end in parts if first < end]

    def put(self, cable: Cable, energy: float) -> None:
        """Store the present state as the next sample; energy: [J]."""
        self.keep_obstacles(cable.obstacles)
        self._records.x[self.count] = cable.arrays.state.x
        self._records.energy[self.count] = energy
        self._records.marks[0] += 1

    @property
    def lines(self) -> Array:
        """The samples taken, shape (count, lines, n)."""
        return without_margins(self._records.x[: self.count], self.model.n)

    @property
    def points(self) -> Array:
        """Control points of the samples taken in the cable's coordinates, shape (count, n, 4)."""
        return self.model.to_columns(self.lines)

    @property
    def control_points(self) -> Array:
        """x, y, z [m] and theta [rad] of the samples taken, world frame, shape (count, n, 4)."""
        return self.model.in_world(self.points)

    def along(self, number: int = 0) -> Shapes:
        """The shapes of the samples taken, at outputs.centerline_samples places of a cable.

        Args:
            number: of the strand, 0 for the main cable.
        """
        part = self.model.parts[number]
        model, points, scene = part.model, self.points[:, part.here, :3], part.model.scene
        cable = scene.cable
        u = np.linspace(0.0, cable.length, scene.outputs.centerline_samples)
        shape = strain(model.knots, u)
        return Shapes(
            u=u,
            control_points=self.control_points[:, part.here],
            centerline=bspline.evaluate(np.eye(model.n), model.knots, u) @ points + model.origin,
            curvature=shape.curvature(points),
            tension=None if scene.without_tension else shape.tension(points, cable.EA, cable.EI),
        )

    def net(self) -> dict[str, Array]:
        """Of a net, what a picture shows besides the main cable; empty for a single cable.

        Returns:
            `a.centerline`, `a.centerline_u` and so on: `Shapes` of the cable a. `plug.pose`:
            position [m] and quaternion x, y, z, w of the connector plug, shape (T, 7), and
            `plug.triangles`: of its surface in its frame [m], shape (k, 3, 3).
        """
        found: dict[str, Array] = {}
        for number, part in enumerate(self.model.parts[1:], 1):
            own = self.along(number)._asdict()
            own["centerline_u"] = own.pop("u")
            found |= {f"{part.name}.{key}": one for key, one in own.items() if one is not None}
        for body in self.model.bodies:
            if (one := body.connector) is not None:
                poses = body.pose(self.points[:, body.points, :3])
                poses[:, :3] += self.model.origin
                found |= {f"{one.name}.pose": poses, f"{one.name}.triangles": drawn_body(one)}
        return found


def largest(what: str, own: Array | None, net: Mapping[str, Array]) -> float | None:
    """The largest value of a field of `Shapes` over all cables; None where it is unknown."""
    others = [values for key, values in net.items() if key.endswith(f".{what}")]
    known = [values for values in (own, *others) if values is not None]
    return max((float(one.max(initial=-math.inf)) for one in known), default=None)


def drawn_body(connector: Connector) -> Array:
    """Triangles of the surface of a connector in its frame [m], shape (k, 3, 3)."""
    if connector.shape == "none":
        return np.zeros((0, 3, 3))
    body = connector.body
    turned = rotations.rotate(np.array(body.orientation), surface(body))
    return np.asarray(turned + body.position)
