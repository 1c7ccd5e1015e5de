"""A buffer for the samples of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine import layout
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


class Recorder:
    """A buffer for one sample of the state at each of these times.

    Attributes:
        times: rising [s]. energies: [J], shape (T, LANES); one cable uses lane 0.
    """

    def __init__(self, model: Model, times: Array) -> None:
        self.times = np.ascontiguousarray(times, dtype=float)
        self.model = model
        self._samples = np.zeros((len(times), int(model.shape[layout.SIZE])))
        self.energies = np.zeros((len(times), LANES))
        self._marks = np.array([0, len(times)], dtype=np.int64)

    @property
    def arrays(self) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """Arguments of the compiled loops: times, samples, energies, and the two counts."""
        return self.times, self._samples.ravel(), self.energies.ravel(), self._marks

    @property
    def count(self) -> int:
        """Number of samples taken."""
        return int(self._marks[0])

    def forget(self, count: int) -> None:
        """Discard all but the first `count` samples."""
        self._marks[0] = min(self.count, count)

    def put(self, cable: Cable, energy: float | Array) -> None:
        """Store the present state as the next sample; energy: [J], or one for each lane."""
        at, size = self.model.shape[layout.X], self.model.shape[layout.SIZE]
        self._samples[self.count] = cable.state[at : at + size]
        self.energies[self.count] = energy
        self._marks[0] += 1

    @property
    def lines(self) -> Array:
        """The samples taken of one cable, shape (count, lines, n)."""
        width = int(self.model.shape[layout.LINE])
        shape = self.count, int(self.model.shape[layout.LINES]), width
        taken = self._samples[: self.count].reshape(shape)
        return taken[:, :, layout.MARGIN : layout.MARGIN + self.model.n]

    @property
    def points(self) -> Array:
        """Control points of the samples taken in the cable's coordinates, shape (count, n, 4)."""
        return self.model.to_columns(self.lines)

    @property
    def control_points(self) -> Array:
        """x, y, z [m] and theta [rad] of the samples taken, world frame, shape (count, n, 4)."""
        return self.model.in_world(self.points)
