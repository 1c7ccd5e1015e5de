"""The arrays of one simulated cable, and the compiled operations on them between steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine import layout
from dlo_sim.engine.frames import control_points
from dlo_sim.engine.grasps import MOTION_SIZE
from dlo_sim.engine.held_motion import carry
from dlo_sim.engine.natural_curvature import follow_to_present
from dlo_sim.engine.plasticity import flow_to_present, plastic_flow
from dlo_sim.methods import between_steps
from dlo_sim.methods.implicit_layout import BALANCE, BAND
from dlo_sim.methods.works import evaluate
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.arrays import line_view
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
CREEP = 1e-6  # cable lengths per second; the account's floor is the energy of such a motion


@dataclass(frozen=True)
class Cable:
    """A model with its inputs, state and scratch.

    Attributes:
        inputs: changed by callers. state: changed by steps. scratch: working memory, not needed
            from one step to the next.
    """

    model: Model
    inputs: Array
    state: Array
    scratch: Array

    @classmethod
    def new(cls, model: Model) -> Cable:
        """A cable whose arrays are all zero."""
        return cls(model, *(model.new(name) for name in ("inputs", "state", "scratch")))

    @property
    def arrays(self) -> tuple[Any, ...]:
        """shape, model, inputs, state, scratch: the first arguments of the compiled functions."""
        return self.model.shape, self.model.values, self.inputs, self.state, self.scratch

    @property
    def terms(self) -> int:
        """Bits of the active terms."""
        return int(self.model.shape[layout.TERMS])

    # -- views ----------------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, Any]:
        """Only the fields: a copy makes cached views of its own arrays."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def x(self) -> Array:
        """Positions, a view of shape (lines, n)."""
        return self.model.view(self.state, layout.X)

    @property
    def points(self) -> Array:
        """Control points x, y, z [m], theta [rad], shape (n, 4), a copy."""
        out = self.model.blank.copy()
        control_points(self.arrays, out)
        return out

    @cached_property
    def w(self) -> Array:
        """Momentum variable w = P v (`engine.held`), a view of shape (lines, n)."""
        return self.model.view(self.state, layout.W)

    @property
    def motion(self) -> Array:
        """Motions of the grasps (`engine.grasps`), a view of shape (grasps, MOTION_SIZE)."""
        at, count = self.model.shape[layout.MOTION], self.model.shape[layout.GRASPS]
        return self.inputs[at : at + count * MOTION_SIZE].reshape(count, MOTION_SIZE)

    @property
    def loads(self) -> Array:
        """Force, torque and frequency of each load, a view of shape (loads, 7, LANES)."""
        count = int(self.model.shape[layout.LOADS])
        rows = self.model.rows(self.inputs, layout.LOAD, count * layout.LOAD_ROWS)
        return rows.reshape(count, layout.LOAD_ROWS, LANES)

    @property
    def anchors(self) -> Array:
        """Target values of the springs, a view of shape (springs, LANES)."""
        return self.model.rows(self.state, layout.ANCHOR, int(self.model.shape[layout.SPRINGS]))

    @property
    def frame_turn(self) -> Array:
        """Angle by which the Bishop frame lags behind each grasp [rad], a view of shape
        (grasps, LANES); empty if twist is not measured against a Bishop frame.
        """
        count = int(self.model.shape[layout.GRASPS]) * self.model.has(layout.BISHOP)
        return self.model.rows(self.state, layout.FRAME_TURN, count)

    @cached_property
    def ledger(self) -> Array:
        """The energy account, a view of shape (LEDGER_ROWS, LANES); one cable uses lane 0."""
        return self.model.rows(self.state, layout.LEDGER, layout.LEDGER_ROWS)

    def entry(self, row: int) -> float:
        """An entry of the energy account."""
        return float(self.state[self.model.shape[layout.LEDGER] + row * LANES])

    @property
    def directions(self) -> Array:
        """Directions of the held rows, a view of shape (held, dim)."""
        count = len(self.model.holding.rows)
        rows = self.model.rows(self.state, layout.DIRECTION, count * layout.DIRECTION_ROWS)
        return rows.reshape(count, layout.DIRECTION_ROWS, LANES)[:, : len(self.model.axes), 0]

    def place(self, grasp: int, t: float) -> Array:
        """Attachment point [m] and twist angle [rad] of a grasp at time t, shape (4,)."""
        out, at = np.empty(4), int(self.model.shape[layout.MOTION]) + grasp * MOTION_SIZE
        between_steps.grasp_place(self.inputs, at, t, out)
        return out

    # -- state ----------------------------------------------------------------------------------

    def point_grasps(self, t: float) -> None:
        """Set the directions of the held rows to those of the grasps at time t."""
        between_steps.turn_to(self.arrays, t)

    def put(
        self, points: Array, rates: Array, time: float | None = None, follow: bool = False
    ) -> None:
        """Set the control points (n, 4) and their velocities, and clear the history.

        Args:
            time: if points between control points are held, project the configuration onto the
                constraints at this time [s].
            follow: the natural shape follows the change of shape.
        """
        self.x[:] = self.model.to_lines(points)
        if time is not None and self.model.holding.border:
            between_steps.place_held(self.arrays, time)
        self.w[:] = self.model.to_lines(rates)
        between_steps.keep_free_motion(self.arrays)
        at, size = self.model.shape[layout.HISTORY], self.model.shape[layout.SIZE]
        self.state[at : at + 3 * size] = 0.0
        self.model.rows(self.state, layout.RATES_BEFORE, len(self.model.holding.rows))[:] = 0.0
        self.ledger[list(layout.OF_HISTORY)] = 0.0
        if follow:
            self.follow()
            self.flow()
        self.open_frame()

    def follow(self) -> None:
        """Let the natural shape in the material frame follow the cable to the present shape."""
        if self.model.has(layout.MATERIAL):
            follow_to_present(self.arrays)

    def turn_natural(self, rows: Array, turn: Array) -> None:
        """Set the natural shape to these rows, as blocks, with their vectors turned by a matrix
        (3, 3); the change of energy is work of the grasps.
        """
        energies = between_steps.energies_of(self.terms).code
        between_steps.turn_natural(self.arrays, energies, rows, turn.ravel())

    def flow(self) -> None:
        """Plastic flow at the present shape."""
        if self.model.has(layout.PLASTICITY):
            flow_to_present(self.arrays, plastic_flow.code)

    def open_frame(self) -> None:
        """From now on measure the twist angles in the Bishop frame of the present shape."""
        if self.model.has(layout.BISHOP):
            self.model.view(self.state, layout.REFERENCE)[:] = self.x
            self.frame_turn[:] = 0.0

    def velocities(self, t: float) -> Array:
        """Velocities of all control points at time t, lines of shape (lines, n)."""
        out = self._lines()
        between_steps.velocity(self.arrays, t, out)
        return self.shown(out)

    def kinetic(self, lines: Array | None = None) -> float:
        """Kinetic energy [J] of velocities in lines, by default of w."""
        v = self.padded(self.w if lines is None else lines)
        return float(between_steps.kinetic_energy(self.arrays, v))

    # -- account --------------------------------------------------------------------------------

    def open_account(self, scene: Scene) -> None:
        """Open the energy account at the present state."""
        cable = scene.cable
        self.ledger[:] = 0.0
        self.ledger[layout.FLOOR] = 0.5 * cable.mu * cable.length * (CREEP * cable.length) ** 2
        between_steps.open_account(self.arrays, between_steps.energies_of(self.terms).code)

    def potentials(self) -> Array:
        """Potential energies [J] in the order of `layout.ENERGIES`."""
        between_steps.measure(self.arrays, between_steps.energies_of(self.terms).code)
        first = layout.ENERGY
        return self.ledger[first : first + len(layout.ENERGIES), 0].copy()

    def balance(self) -> tuple[float, float]:
        """|energy - work done + energy lost| now and the largest energy exchanged so far [J]."""
        parts, kinetic = self.potentials(), self.kinetic()
        first = layout.ENERGY_BEGIN
        start = self.ledger[first : first + len(parts), 0]
        works = self.entry(layout.LOAD_WORK), self.entry(layout.DRIVE_WORK)
        error = kinetic + float(parts.sum()) - self.entry(layout.ENERGY_START) - sum(works)
        error += self.entry(layout.DISSIPATED) - self.entry(layout.PENDING)
        largest = float(np.abs(parts - start).max())
        exchanged = max(self.entry(layout.EXCHANGED), kinetic, largest, *np.abs(works))
        return abs(error), exchanged

    def settle(self, t: float) -> None:
        """Add the work up to time t, which a step leaves to the next one, to the account."""
        if self.entry(layout.IS_BOOKED):
            forces = between_steps.forces_of(self.terms).code
            between_steps.settle(self.arrays, evaluate.code, forces, t)

    def present_energy(self) -> float:
        """Kinetic energy of w and potential energy [J]."""
        return self.kinetic() + float(self.potentials().sum())

    def share_open(self) -> float:
        """|energy - work done + energy lost| as a share of the energy exchanged so far."""
        error, exchanged = self.balance()
        return error / max(exchanged, self.entry(layout.FLOOR))

    # -- forces ---------------------------------------------------------------------------------

    def forces(self, t: float = 0.0, rates: Array | None = None) -> Array:
        """Potential and load forces at the present configuration, shape (lines, n).

        With `rates`, velocities (lines, n), the damping forces are included.
        """
        out = self._lines()
        between_steps.forces_now(self.arrays, between_steps.forces_of(self.terms).code, t, out)
        if rates is not None and self.model.has(layout.DAMPED):
            v = self.padded(rates)
            gradient = between_steps.gradient_of(self.terms).code
            between_steps.damping_forces(self.arrays, gradient, v, out)
        return self.shown(out)

    def held_force(self, t: float, force: Array | None = None) -> Array:
        """Forces of the grasps on the held rows at time t, shape (held,).

        Args:
            force: all other forces, shape (lines, n); default: those of the present motion.
        """
        lines = self.padded(self.forces(t, self.velocities(t)) if force is None else force)
        held = np.zeros(int(self.model.shape[layout.HELD]))
        between_steps.held_force(self.arrays, t, lines, held)
        return held

    def stiffness(self) -> Array:
        """Hessian of the potential energy with respect to the spatial lines, as a band matrix.

        Returns:
            A view of scratch, shape (n dim, width); entry (r, c) is at [r, c - r + 4 dim - 1].
        """
        between_steps.stiffness(self.arrays, between_steps.tangent_of(self.terms).code)
        return self.band

    @property
    def band(self) -> Array:
        """The band matrix in scratch, a view of shape (n dim, width)."""
        shape = self.model.shape
        dim, n = int(shape[layout.DIM]), int(shape[layout.N])
        width = 16 * (dim - 1)
        at = shape[BAND]
        return self.scratch[at : at + n * dim * width].reshape(n * dim, width)

    @property
    def unbalanced(self) -> Array:
        """Right-hand side of the last Newton correction of an implicit step [N], shape (n, dim)."""
        shape = self.model.shape
        count, at = int(shape[layout.N] * shape[layout.DIM]), shape[BALANCE]
        return self.scratch[at : at + count].reshape(self.model.n, -1)

    def add_moment_stiffness(self) -> None:
        """Add the (unsymmetric) stiffness of the moments at time zero to the band matrix."""
        between_steps.moment_stiffness(self.arrays)

    def solve_held(self, unknowns: Array) -> int:
        """Solve band x = unknowns in place with the held rows fixed.

        Returns:
            The number of negative pivots, or -1 if a pivot is not usable.
        """
        return int(between_steps.solve_held(self.arrays, unknowns))

    def free_acceleration(self, force: Array, keep: bool = True) -> Array:
        """P M^-1 f of forces f, shape (lines, n); M^-1 f if `keep` is false."""
        lines = self.padded(force)
        between_steps.free_acceleration(self.arrays, lines, keep)
        return self.shown(lines)

    @property
    def shifts(self) -> Array:
        """M^-1 b for the basis values b of every held point, a view of shape (points, n)."""
        at, count = int(self.model.shape[layout.HELD_SHIFT]), len(self.model.holding.points)
        return line_view(self.model.shape, self.model.values, at, count)

    def jump(self, t: float, put: Callable[[Array], None]) -> None:
        """Move the held points instantly to their places at time t.

        The change of the potential energy counts as work of the grasps. `put` writes the prescribed
        entries of control points (n, 4); it changes free ones only where the neighbour of a clamp
        came too close.
        """
        self.settle(t)
        before = self.potentials().sum()
        between_steps.jump(self.arrays, carry.code, t)
        points = self.points
        put(points)
        self.x[:] = self.model.to_lines(points)
        self.ledger[layout.DRIVE_WORK] += self.potentials().sum() - before
        self.ledger[layout.IS_BOOKED] = 0.0
        held, springs = (int(self.model.shape[k]) for k in (layout.HELD, layout.SPRINGS))
        self.model.rows(self.state, layout.MOVED, held)[:] = 0.0
        self.model.rows(self.state, layout.ANCHOR_BOOKED, springs)[:] = self.anchors

    # -- inside ---------------------------------------------------------------------------------

    def _lines(self) -> Array:
        return np.zeros(int(self.model.shape[layout.SIZE]))

    def shown(self, lines: Array) -> Array:
        """View of `lines` without margins, shape (lines, n)."""
        width = int(self.model.shape[layout.LINE])
        begin = layout.MARGIN
        return lines.reshape(-1, width)[:, begin : begin + self.model.n]

    def padded(self, lines: Array) -> Array:
        """Copy of lines (lines, n) with margins, flat."""
        out = self._lines()
        self.shown(out)[:] = lines
        return out
