"""The arrays of one simulated cable, and the compiled operations on them between steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.groups import aligned_zeros, numbers_of
from dlo_sim.compiling.kernels import Kernel
from dlo_sim.core import bspline
from dlo_sim.engine import contact, self_contact, sliding
from dlo_sim.engine.arrays import (
    BISHOP,
    CONTACT,
    DAMPED,
    MATERIAL,
    PLASTICITY,
    SELF,
    Inputs,
    State,
    Work,
)
from dlo_sim.engine.frames import control_points
from dlo_sim.engine.grasps import ACTIVE, POSITION, START
from dlo_sim.engine.natural_curvature import follow_to_present
from dlo_sim.engine.plasticity import flow_to_present
from dlo_sim.engine.roll import ANGLE
from dlo_sim.methods import between_steps
from dlo_sim.simulation.arrays import from_blocks, resampled, to_blocks, without_margins
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
TINY = 1e-300
_WORST = [State.balance.record.names.index(one) for one in ("error", "exchanged", "floor")]  # type: ignore[attr-defined]
CREEP = 1e-6  # cable lengths per second; the account's floor is the energy of such a motion


class Cable:
    """A model with its inputs, state and working memory, all zero at first.

    Attributes:
        arrays: all arrays by name. Their constants are those of the model.
        inputs: the numbers of `arrays.inputs`, changed by callers. state: those of `arrays.state`,
            changed by steps; a copy of them is a snapshot.
        x: positions, a view of shape (lines, n). w: projected velocity w = P v (`engine.rows`).
    """

    def __init__(self, model: Model) -> None:
        self._left_out = 0  # bits of terms that the method leaves out
        self.allocate(model)
        self.place_obstacles(0.0)

    def allocate(self, model: Model) -> None:
        """Go over to another model, with inputs and state that are zero."""
        sizes = model.arrays.sizes
        self.inputs, self.state = map(aligned_zeros, model.rooms)
        self.model, self.arrays = model, copy(model.arrays)
        self.arrays.inputs = Inputs(sizes, self.inputs)
        self.arrays.state = State(sizes, self.state)
        self.arrays.work = Work(sizes)
        self.arrays.terms &= ~self._left_out
        self.slides[:] = [slide.u for slide in model.holding.slides]
        for row, place in zip(self.obstacles, model.obstacles.values(), strict=False):
            row[:] = place
        self._balance = numbers_of(self.arrays.state.balance)
        self.x, self.w = self.shown(self.arrays.state.x), self.shown(self.arrays.state.w)

    def activate(self, model: Model) -> None:
        """Go over to a model of the same scene with other lines, terms, grasps, or obstacles.

        Inputs, plastic and natural curvature, the energy balance, and what the two models have of
        obstacles stay. The rest of the state is zero and still to be set: anchors, directions,
        positions and velocities (`put`).
        """
        before = Cable.__new__(Cable)  # with the present arrays; a copy would have others
        vars(before).update(vars(self))
        self.allocate(model)
        self.motion[:], self.loads[:] = before.motion, before.loads
        for array, values in zip(self._lasting, before._lasting, strict=True):
            array[...] = values
        if before.model.axes != model.axes:  # bristles are by these
            self.arrays.state.pair[1:] = 0.0
        self.take_contact(before)
        self.account.load_work += before.account.pending
        self._forget_history()

    def take_contact(self, other: Cable, time: float | None = None) -> None:
        """Go on with the motions of the obstacles of another cable, with how deep they have pressed
        it, and with the friction that holds it on them if its control points have the same knots.

        Args:
            time: of another cable [s], 0 here: obstacles of the same names may be stiffer, and
                yield anew; default: the cable before its model changed, which has yielded to the
                obstacles that are still the same.
        """
        state, group, theirs = self.arrays.state, self.arrays.contact, other.arrays
        anew = time is not None
        known = {one.name if anew else one: k for k, one in enumerate(other.model.obstacles)}
        there, here = ((one.pieces, one.guide_pieces) for one in (theirs.contact, group))
        pieces = there, here, (theirs.contact.extras, group.extras)
        same = np.array_equal(self.model.knots, other.model.knots)
        names = ["bristle", "slides", "lain", *["overlap"] * (not anew)]
        if anew and self.model.axes == other.model.axes:
            names.append("stopped")
            self.account.stopped = other.account.stopped if same else 0.0
        for k, obstacle in zip(range(len(self.obstacles)), self.model.obstacles, strict=False):
            number = known.get(obstacle.name if anew else obstacle, len(other.obstacles))
            if number >= len(other.obstacles):
                continue
            row = other.obstacles[number].copy()
            if time is not None:
                row[START] -= time
                row[POSITION : POSITION + 3] += other.model.origin - self.model.origin
            if not anew or row[ACTIVE]:
                self.obstacles[k] = row
            state.deepest[k] = theirs.state.deepest[number]
            for name in names * same:
                values = np.asarray(getattr(theirs.state, name))[number]
                np.asarray(getattr(state, name))[k] = resampled(values, *pieces)
            laws = theirs.contact.law[number], group.law[k]
            rubs = laws[1][contact.FRICTION] > 0.0
            ratio = laws[0][contact.BRISTLE] / laws[1][contact.BRISTLE] if rubs else 0.0
            np.asarray(state.bristle)[k] *= ratio
            if not anew:
                self.account.decaying = 1.0  # until a step has looked
        if anew:
            self.place_obstacles(0.0)

    def _begin_strands(self, before: Cable | None, released: Sequence[float]) -> None:
        """Begin the contact with itself. Pairs, bristles and overlap are those of the cable
        `before` if it touches itself by the same law; else, and where grasps have released it since
        (u [m]), what overlaps gives way, until it is pressed no more than before.
        """
        state, account = self.arrays.state, self.account
        state.pair[:] = 0.0
        if before and before.model.has(SELF) and self._touches_as(before):
            account.pairs = before.account.pairs
            account.pair_overlap = before.account.pair_overlap
            state.pair[:] = before.arrays.state.pair
            self.call(self_contact.reset)
            for u in released:
                self.part_strands(u)
        else:
            self.call(self_contact.reset)
            kept = before.pressed_strands if before and not released else None
            if kept is not None:
                kept /= self.arrays.chain.law[self_contact.STIFFNESS]
            parted = self.part_strands(kept=kept)
            shallow = contact.SHALLOW * self.arrays.chain.diameter
            account.overlap = parted if parted > shallow else 0.0
        if before and before.model.has(SELF):
            account.overlap = max(account.overlap, before.account.overlap)

    def _touches_as(self, other: Cable) -> bool:
        """Whether pairs of another cable are pairs of this one, and their forces the same."""
        ours, theirs = self.arrays.chain, other.arrays.chain
        return bool(
            np.array_equal(self.model.knots, other.model.knots)
            and self.model.axes == other.model.axes
            and ours.segments == theirs.segments
            and np.array_equal(ours.radius, theirs.radius)
            and np.array_equal(ours.joints, theirs.joints)
            and ours.law[self_contact.STIFFNESS] == theirs.law[self_contact.STIFFNESS]
        )

    @property
    def _lasting(self) -> tuple[Array, ...]:
        """What other lines, terms or grasps leave as it is."""
        state = self.arrays.state
        balance = numbers_of(state.balance)
        energies = state.energy, state.energy_begin
        return balance, *energies, state.natural, state.plastic, state.pair, state.frame

    def __getstate__(self) -> tuple[Model, int, Array, Array]:
        """What a copy needs; it has arrays of its own."""
        return self.model, self._left_out, self.inputs, self.state

    def __setstate__(self, kept: tuple[Model, int, Array, Array]) -> None:
        model, self._left_out, inputs, state = kept
        self.allocate(model)
        self.inputs[:], self.state[:] = inputs, state

    def call(self, entry: Kernel, *arguments: Any) -> Any:
        """Call compiled code on this cable; `entry` takes its address, then the arguments."""
        return entry.code(self.terms)(self.address, *arguments)

    @property
    def address(self) -> int:
        """All arrays, as the first argument of compiled functions."""
        return self.arrays.address

    @property
    def terms(self) -> int:
        """Bits of the active terms: those of the model but for what is left out."""
        return int(self.arrays.terms)

    def leave_out(self, bits: int) -> None:
        """Leave terms out from now on."""
        self._left_out |= bits
        self.arrays.terms &= ~bits
        self.arrays.pack_anew()

    def keep_length(self, flag: bool) -> None:
        """Whether the cable keeps its length from now on (`engine.tension`)."""
        self.arrays.physics.keeps_length = float(flag)
        self.arrays.pack_anew()

    # -- views ----------------------------------------------------------------------------------

    @property
    def points(self) -> Array:
        """Control points x, y, z [m], theta [rad], shape (n, 4), a copy."""
        out = self.model.blank.copy()
        self.call(control_points, out)
        return out

    @property
    def motion(self) -> Array:
        """Motions of the grasps (`engine.grasps`), a view of shape (grasps, MOTION_SIZE)."""
        return self.arrays.inputs.motion

    @property
    def loads(self) -> Array:
        """Force (3) [N], torque (3) [N m] and frequency [Hz] of the loads, a view (loads, 7)."""
        return self.arrays.inputs.load

    @property
    def anchors(self) -> Array:
        """Target values of the springs, a view of shape (springs,)."""
        return self.arrays.state.anchor[len(self.model.holding.rows) :]

    @property
    def slides(self) -> Array:
        """Material coordinates [m] of the grasps that slide, or `sliding.LOST`, a view."""
        return self.arrays.state.slide

    @property
    def account(self) -> Any:
        """Numbers of the energy account (`engine.arrays.State.balance`)."""
        return self.arrays.state.balance

    @property
    def natural(self) -> Array:
        """Natural curvature with its weight (3) and rest twist at the samples (`natural_shape`),
        a copy of shape (spans, samples, 4).
        """
        return from_blocks(self.arrays.state.natural, len(self.model.rule.xi))

    @natural.setter
    def natural(self, rows: Array) -> None:
        self.arrays.state.natural[:] = to_blocks(rows)

    @property
    def plastic(self) -> Array:
        """Plastic curvature [1/m], tangent and curvature of the last step at the samples, a copy of
        shape (spans, samples, 9).
        """
        return from_blocks(self.arrays.state.plastic, len(self.model.rule.xi))

    @plastic.setter
    def plastic(self, rows: Array) -> None:
        self.arrays.state.plastic[:] = to_blocks(rows)

    def held_twists(self, t: float) -> Array:
        """Twist angles [rad] that the grasps prescribe at time t, shape (grasps,)."""
        count = range(len(self.motion))
        return np.array([self.call(between_steps.twist_held, grasp, t) for grasp in count])

    def count_twists(self, t: float, twists: Iterable[tuple[int, float]]) -> None:
        """The twist angles that grasps prescribe are these at time t: number and angle [rad]."""
        for grasp, twist in twists:
            self.call(between_steps.count_twist, grasp, t, twist)

    @property
    def obstacles(self) -> Array:
        """Motions of the obstacles, as of grasps, a view of shape (obstacles, MOTION_SIZE)."""
        return self.arrays.inputs.obstacle

    def shape_of(self, other: Cable, time: float) -> tuple[Array, Array]:
        """Control points of this cable, and their velocities, with the shape and motion of another
        one at a time [s], in the coordinates of this model, each (n, 4).
        """
        points = other.points
        rates = other.model.to_columns(other.velocities(time), rest=False)
        points[:, :3] += other.model.origin - self.model.origin
        found = np.zeros((self.model.n, 4)), np.zeros((self.model.n, 4))
        for own, part in zip(self.model.parts, other.model.parts, strict=True):
            ours, theirs = own.model.knots, part.model.knots
            for out, values in zip(found, (points[part.here], rates[part.here]), strict=True):
                if np.array_equal(ours, theirs):
                    out[own.here] = values
                else:
                    u = bspline.greville(ours) * (theirs[-1] / ours[-1])
                    out[own.here] = bspline.interpolate(ours, bspline.evaluate(values, theirs, u))
        for mine, body in zip(self.model.bodies, other.model.bodies, strict=True):
            for out, values in zip(found, (points, rates), strict=True):
                out[mine.points, :3] = mine.taken(body, values[body.points, :3])
        return found

    # -- state ----------------------------------------------------------------------------------

    @property
    def indices_fit(self) -> bool:
        """Whether the state, which may be of a damaged file, names only what its arrays have."""
        state, account, chain = self.arrays.state, self.account, self.arrays.chain
        spans = len(chain.arc) ** 2
        named = [
            (account.near_spans, state.near_pair, spans),
            (account.pairs, state.pair[0], spans * chain.segments**2),
        ]
        groups = len(self.arrays.contact.first)
        named += [(n, row, groups) for n, row in zip(state.near_count, state.near, strict=True)]
        on = (self.slides >= 0.0) & (self.slides <= self.model.knots[-1])
        return bool(np.all(on | (self.slides == sliding.LOST))) and all(
            0.0 <= count <= len(row)
            and np.all((row[: int(count)] >= 0.0) & (row[: int(count)] < most))
            for count, row, most in named
        )

    def point_grasps(self, t: float) -> None:
        """Set the directions of the constraint rows to those of the grasps at time t."""
        self.call(between_steps.turn_to, t)

    def pull(self, t: float) -> None:
        """Let what gives, or lets the cable slide, hold it where its grippers are at time t."""
        self.call(between_steps.pull, t)

    def place_obstacles(self, t: float) -> None:
        """Set the poses of the obstacles at time t."""
        if self.model.has(CONTACT):
            self.call(contact.place_obstacles, t)

    def touch_anew(self, t: float) -> None:
        """Begin all contacts at the present configuration and time t, without friction or impulses
        so far.
        """
        state = self.arrays.state
        self.forget_contact()
        self.place_obstacles(t)
        if self.model.has(SELF):
            state.pair[:] = 0.0
            state.balance.pairs = 0.0
            self.call(self_contact.reset)

    def forget_contact(self) -> None:
        """Set what earlier steps have left of contact with obstacles, but for overlap, to zero."""
        state = self.arrays.state
        for array in (state.bristle, state.stopped, state.slides, state.lain, state.deepest):
            array[:] = 0.0

    def strands(self) -> Array:
        """What of the cable may touch itself, rows of `engine.self_contact.report`."""
        rows = np.zeros((int(self.account.pairs), 7))
        self.call(self_contact.report, rows)
        return rows

    @property
    def pressed_strands(self) -> float | None:
        """Largest force per length between strands [N/m]; None without contact with itself."""
        if not self.model.has(SELF):
            return None
        return float(self.arrays.chain.law[self_contact.STIFFNESS]) * self.strand_depth

    @property
    def strand_depth(self) -> float:
        """How deep strands are pressed into each other at most [m], between straight segments:
        where they bend, the surface of the cable is further in.
        """
        return max(-float(self.strands()[:, 0].min(initial=0.0)) - self.account.pair_overlap, 0.0)

    def part_strands(self, u: float | None = None, kept: float | None = None) -> float:
        """Let strands that overlap give way (`engine.self_contact`); returns by how much [m].

        Args:
            u: only if they depend on the control points of this material coordinate [m] of the
                first strand, which a grasp has released.
            kept: until they are this deep in each other [m]; default: all of it if they are not
                SHALLOW.
        """
        if not self.model.has(SELF):
            return 0.0
        chain, account = self.arrays.chain, self.account
        found = self.strands()[:, 0]
        if u is not None:
            keys = self.arrays.state.pair[0, : len(found)] // chain.segments**2
            spans = np.stack(np.divmod(keys, len(chain.arc)))
            main = self.model.parts[0]
            own = main.first + np.searchsorted(bspline.breaks(main.model.knots)[1:], u)
            found = found[(np.abs(spans - own) <= bspline.DEGREE).any(axis=0)]
        depth = -float(found.min(initial=0.0)) - (kept or 0.0)
        if depth <= (TINY if kept is not None else contact.SHALLOW * chain.diameter):
            return 0.0
        account.pair_overlap = account.pair_overlap_end = max(depth, account.pair_overlap)
        return depth

    def put(
        self,
        points: Array,
        rates: Array,
        time: float | None = None,
        follow: bool = False,
        strained: Sequence[float] | None = None,
    ) -> None:
        """Set the control points (n, 4) and their velocities, and clear the history.

        Args:
            time: if points between control points are held, project the configuration onto the
                constraints at this time [s].
            follow: the natural shape, also that in the material frame, follows the cable.
            strained: `strained_joints` before, which are kept; default: joints are not strained.
        """
        self.x[:] = self.model.to_lines(points)
        if time is not None and self.model.holding.border:
            self._count_joints(strained)
            self.call(between_steps.place_held, time)
        self.w[:] = self.model.to_lines(rates)
        self.call(between_steps.keep_free_motion)
        state = self.arrays.state
        for cleared in (state.history, state.acceleration):
            cleared[:] = 0.0
        self._forget_history()
        if follow:
            if self.model.has(MATERIAL):
                self.call(follow_to_present)
            self.flow()
        self._count_joints(strained)
        self.open_frame()

    def _angles_between(self) -> Iterator[tuple[int, float, float, bool]]:
        """Twist angles between strands and bodies, then between strands: number of the roll or row,
        the angle, what counts as unstrained [rad], and whether the joint gives.
        """
        arrays, theta, holding = self.arrays, self.x[-1], self.model.holding
        for number, first in enumerate(arrays.rolls.first):
            angle = float(arrays.rolls.weights[number] @ theta[first : first + bspline.ACTIVE])
            gives = number >= arrays.rolls.rigid_rolls
            yield number, angle, float(arrays.state.roll[number, ANGLE]), gives
        for k, row in enumerate([*holding.rows, *holding.springs]):
            if row.grasp < 0 and holding.points[row.point].twist:
                angle = float(holding.points[row.point].values(self.model.n) @ theta)
                yield k, angle, float(arrays.state.anchor[k]), k >= len(holding.rows)

    def strained_joints(self) -> list[float]:
        """Twist angles [rad] by which joints that give are strained; 0 of rigid ones."""
        return [gives * (angle - at_rest) for _, angle, at_rest, gives in self._angles_between()]

    def _count_joints(self, strained: Sequence[float] | None) -> None:
        """From now on the twist angles between strands, and between strands and bodies, count from
        the present ones, at which joints are strained by these; default: by nothing.
        """
        state, rolls = self.arrays.state, len(self.arrays.rolls.first)
        for which, (number, angle, _, _) in enumerate(list(self._angles_between())):
            rest = angle - (strained[which] if strained is not None else 0.0)
            if which < rolls:
                self.call(between_steps.count_roll, number, rest)
            else:
                state.anchor[number] = state.anchor_counted[number] = rest

    def turn_natural(self, rows: Array, turn: Array) -> None:
        """Set the natural shape to these rows, from `to_blocks`, with their vectors turned by a
        matrix (3, 3); the change of energy is work of the grasps.
        """
        self.call(between_steps.turn_natural, rows, turn.ravel())

    def flow(self) -> None:
        """Plastic flow at the present shape."""
        if self.model.has(PLASTICITY):
            self.call(flow_to_present)

    def take_over_samples(self, other: Cable) -> None:
        """Take over another cable's plastic curvature, and its natural shape where that follows the
        material frame, linear between its samples.
        """
        ours, theirs = self.model, other.model
        order = np.argsort(theirs.sample_shares, axis=None, kind="stable")
        order = order[theirs.rule.weights.ravel()[order] != 0.0]

        def here(values: Array) -> Array:
            rows, shares = values.reshape(-1, values.shape[-1])[order], theirs.sample_shares
            known = shares.ravel()[order]
            columns = [np.interp(ours.sample_shares, known, column) for column in rows.T]
            return np.stack(columns, axis=-1)

        if theirs.has(PLASTICITY) and ours.has(PLASTICITY):
            plastic = here(other.plastic)
            # p / (1 - h), from which strands have slipped, stays.
            plastic[..., :3] *= (1.0 - ours.elastic_share) / (1.0 - theirs.elastic_share)
            self.plastic = plastic
            self.flow()
        if theirs.has(MATERIAL) and ours.has(MATERIAL):
            natural = other.natural
            natural[..., :3] /= np.maximum(theirs.elastic_share * theirs.moment_weights, TINY)
            natural = here(natural)
            natural[..., :3] *= ours.elastic_share * ours.moment_weights
            self.natural = natural

    def open_frame(self) -> None:
        """From now on measure the twist angles in the Bishop frame of the present shape."""
        if self.model.has(BISHOP):
            self.shown(self.arrays.state.reference)[:] = self.x

    def velocities(self, t: float) -> Array:
        """Velocities of all control points at time t, lines of shape (lines, n)."""
        out = self._lines()
        self.call(between_steps.velocity, t, out)
        return self.shown(out)

    def kinetic(self, lines: Array | None = None) -> float:
        """Kinetic energy [J] of velocities in lines, by default of w."""
        v = self.padded(self.w if lines is None else lines)
        return float(self.call(between_steps.kinetic_energy, v))

    # -- account --------------------------------------------------------------------------------

    def open_account(self, before: Cable | None = None, released: Sequence[float] = ()) -> None:
        """Open the energy account at the present state.

        Args:
            before: the cable from whose state this one goes on; default: from none.
            released: material coordinates [m] at which grasps held that cable, but not this one.
        """
        cable, state = self.model.scene.cable, self.arrays.state
        numbers_of(state.balance)[:] = 0.0
        state.balance.decaying = float(np.asarray(state.overlap).any())
        state.energy[:] = state.energy_begin[:] = 0.0
        if self.model.has(SELF):
            self._begin_strands(before, released)
        state.balance.floor = 0.5 * cable.mu * cable.length * (CREEP * cable.length) ** 2
        self.call(between_steps.open_account)

    def _forget_history(self) -> None:
        """Set the numbers that are zero without earlier steps."""
        account = self.account
        account.known = account.is_counted = account.pending = 0.0
        account.reactions = account.matrix_weight = 0.0
        if self.model.has(CONTACT):
            self.call(contact.look_everywhere)
        account.near_margin = 0.0

    def potentials(self) -> Array:
        """Potential energies [J] in the order of `engine.arrays.ENERGIES`."""
        self.call(between_steps.measure)
        return self.arrays.state.energy.copy()

    def balance(self) -> tuple[float, float]:
        """|energy - work done + energy lost| now, and the largest energy exchanged so far, at least
        that below which differences are round-off [J].
        """
        error, exchanged = self.call(between_steps.open_balance)
        return error, exchanged

    def worst_balance(self, checked: bool) -> float:
        """Largest |energy - work done + energy lost| so far, as a share of the energy exchanged.

        Args:
            checked: whether a step has checked the present state.
        """
        worst, exchanged, floor = self._balance[_WORST].tolist()
        if not checked:
            error, present = self.balance()
            worst, exchanged = max(worst, error), max(exchanged, present)
        return float(worst / max(exchanged, floor))

    def settle(self, t: float) -> None:
        """Add the work up to time t, which a step leaves to the next one, to the account."""
        if self.account.is_counted:
            self.call(between_steps.settle, t)

    @contextmanager
    def working(self, t: float) -> Iterator[None]:
        """What is done at time t changes the energy by work of the end effectors and obstacles."""
        self.settle(t)
        before = self.present_energy()
        yield
        self.account.drive_work += self.present_energy() - before

    def present_energy(self) -> float:
        """Kinetic energy of w and potential energy [J]."""
        return self.kinetic() + float(self.potentials().sum())

    def share_open(self) -> float:
        """|energy - work done + energy lost| as a share of the energy exchanged so far."""
        error, exchanged = self.balance()
        return error / exchanged

    # -- forces ---------------------------------------------------------------------------------

    def forces(self, t: float = 0.0, rates: Array | None = None) -> Array:
        """Potential and load forces at the present configuration, shape (lines, n).

        With `rates`, velocities (lines, n), the damping forces are included.
        """
        out = self._lines()
        self.call(between_steps.forces_now, t, out)
        return self.shown(out) + (0.0 if rates is None else self.damping_forces(rates))

    def damping_forces(self, rates: Array) -> Array:
        """Damping forces at the present configuration and these velocities, both (lines, n)."""
        out = self._lines()
        if self.model.has(DAMPED):
            self.call(between_steps.damping_forces, self.padded(rates), out)
        return self.shown(out)

    def held_force(self, t: float) -> Array:
        """Forces of the grasps on the constraint rows in the present motion at time t, shape
        (rows,).
        """
        held = np.zeros(len(self.model.holding.rows))
        forces = self.padded(self.forces(t, self.velocities(t)))
        self.call(between_steps.held_force, t, forces, held)
        return held

    def stiffness(self, moments: bool = False) -> Array:
        """Hessian of the potential energy as a band matrix.

        Args:
            moments: with the (unsymmetric) stiffness of the moments at time zero.

        Returns:
            A view of the working memory, shape (n lines, width); entry (r, c) is at
            [r, c - r + 4 lines - 1].
        """
        self.call(between_steps.stiffness, moments)
        return self.band

    def take_tension(self, at_rest: bool) -> None:
        """Set the tension to that of the strain of the present shape if `at_rest`, else to 0."""
        self.arrays.state.tension[:] = 0.0
        if at_rest:
            self.call(between_steps.stiffness, False)

    @property
    def band(self) -> Array:
        """The band matrix in the working memory, a view of shape (n lines, width)."""
        return self.arrays.work.band

    @property
    def unbalanced(self) -> Array:
        """Right-hand side of the last Newton correction of an implicit step [N], shape (n, dim)."""
        return self.arrays.work.unbalanced.reshape(self.model.n, -1)[:, : len(self.model.axes)]

    def free_acceleration(self, force: Array) -> Array:
        """P M^-1 f of forces f, shape (lines, n)."""
        lines = self.padded(force)
        self.call(between_steps.free_acceleration, lines, True)
        return self.shown(lines)

    def jump(self, t: float, put: Callable[[Array], None]) -> None:
        """Move the held points instantly to their places at time t.

        The change of the potential energy counts as work of the grasps. `put` writes the prescribed
        entries of control points (n, 4); it changes free ones only where the neighbour of a clamp
        came too close.
        """
        self.settle(t)
        before = self.potentials().sum()
        self.call(between_steps.jump, t)
        points = self.points
        put(points)
        self.x[:] = self.model.to_lines(points)
        account, state = self.account, self.arrays.state
        account.drive_work += self.potentials().sum() - before
        account.is_counted = 0.0
        state.moved[:] = 0.0
        state.anchor_counted[:] = state.anchor

    # -- inside ---------------------------------------------------------------------------------

    def _lines(self) -> Array:
        return np.zeros(self.arrays.state.x.shape)

    def shown(self, lines: Array) -> Array:
        """View of `lines` without margins, shape (lines, n)."""
        return without_margins(lines, self.model.n)

    def padded(self, lines: Array) -> Array:
        """Copy of lines (lines, n) with margins."""
        out = self._lines()
        self.shown(out)[:] = lines
        return out
