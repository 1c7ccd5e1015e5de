"""Read access to a running cable: shape, motion, energies, reactions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline
from dlo_sim.core.methods import CONSTRAINED
from dlo_sim.core.strain import strain
from dlo_sim.engine.arrays import ENERGIES, TORSION
from dlo_sim.engine.frames import curve_frames
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.coiling import coiling_warning
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.following import checked_poses
from dlo_sim.simulation.geometry import Geometries, known_holder
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.reaction import reaction
from dlo_sim.simulation.report import Energy, UndefinedTorsion, balance_warning
from dlo_sim.simulation.selection import Choice
from dlo_sim.simulation.stepper import Stepper

Array = NDArray[np.float64]
Basis = tuple[NDArray[np.int64], Array, Array]
NOTABLE = 1e4  # energy exchanged, in floors of the account: as of a motion by 1e-4 lengths a second
MOST_BASES = 16  # sets of material coordinates whose basis values are kept


class CableView:
    """The read-only part of `Simulator`, which sets the attributes.

    Attributes:
        scene: what is simulated. cable: its arrays. choice: method, step and the reason for them.
    """

    scene: Scene
    cable: Cable
    choice: Choice
    _needs: Needs
    _ends: EndDrive
    _geometries: Geometries  # relative to the origin
    _origin: Array  # in the world, as of the model
    _stepper: Stepper
    _steps: int
    _greville: Array
    _frame_axis: Array
    _bases: dict[bytes, Basis]

    # -- what it is -----------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time [s]: whole steps since the start."""
        return self._steps * self.choice.step if self._steps else 0.0

    @property
    def steps(self) -> int:
        """Whole steps since the start."""
        return self._steps

    @property
    def step(self) -> float:
        """Step tau [s]."""
        return self.choice.step

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return self.choice.method.name

    @property
    def model(self) -> Model:
        """Constant arrays of the scene."""
        return self.cable.model

    @property
    def active_terms(self) -> tuple[str, ...]:
        """Terms that the compiled step contains."""
        return self._needs.active

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is missing because of terms that the scene needs but are switched off, and what the
        model cannot show in its present state, one line each.
        """
        tolerance, account = self.scene.integrator.tolerance, self.cable.account
        notable = account.exchanged > NOTABLE * account.floor
        error = self.energy_error if notable else 0.0
        lines = (
            coiling_warning(self.scene, self.cable),
            balance_warning(self.choice.method, tolerance, error),
        )
        return (*self._needs.warnings, *filter(None, lines))

    @property
    def left_out(self) -> dict[str, str]:
        """Terms that the step does not contain, with the reason."""
        return dict(self._needs.left_out)

    # -- state ----------------------------------------------------------------------------------

    @property
    def control_points(self) -> Array:
        """Control points (x, y, z [m], theta [rad]), shape (n_u, 4), a copy."""
        return self.model.in_world(self.cable.points)

    @property
    def velocities(self) -> Array:
        """Velocities of the control points [m/s, rad/s], shape (n_u, 4)."""
        return self.model.to_columns(self.cable.velocities(self.time), rest=False)

    @property
    def greville(self) -> Array:
        """Material coordinate [m] of each control point (Greville abscissa), shape (n_u,)."""
        return self._greville.copy()

    def centerline(self, u: ArrayLike) -> Array:
        """Points of the cable [m] at material coordinates u [m] in [0, L], shape (len(u), 3).

        Raises:
            TypeError, ValueError: not such numbers.
        """
        columns, values, _ = self._basis(_coordinates(u))
        points = self.cable.points[:, :3].take(columns, axis=0)
        return np.einsum("mk,mkd->md", values, points) + self.model.origin

    def tension(self, u: ArrayLike) -> Array:
        """Tension EA (|r'| - 1) - EI kappa^2 [N] at u, shape (len(u),), without damping forces.

        Interpolated linearly between the means of the knot spans; negative under compression.

        Raises:
            TypeError, ValueError: as `centerline`; the shape does not determine the tension.
        """
        if self.scene.without_tension:
            raise ValueError(f"tension: {self.scene.without_tension}")
        shape, cable = strain(self.model.knots, _coordinates(u)), self.scene.cable
        return shape.tension(self.cable.points[:, :3], cable.EA, cable.EI)

    def curvature(self, u: ArrayLike) -> Array:
        """Curvature [1/m] at u, shape (len(u),), 0 or more.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        return strain(self.model.knots, _coordinates(u)).curvature(self.cable.points[:, :3])

    def frames(self, u: ArrayLike) -> Array:
        """Material frames at u as quaternions x, y, z, w, shape (len(u), 4); x axis = tangent.

        Raises:
            TypeError, ValueError: as `centerline`.
        """
        basis = self._basis(_coordinates(u))
        poses = np.empty((len(basis[0]), 7))
        self._write_poses(self.cable.points, basis, poses)
        return poses[:, 3:]

    def control_poses(self, out: Array) -> None:
        """Write into out, shape (n_u, 7), every control point [m] with the material frame at its
        material coordinate, quaternion x, y, z, w.

        Raises:
            TypeError: out is not such an array of doubles, contiguous and writeable.
        """
        shape = self.model.n, 7
        fits = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == np.float64
        if not (fits and out.flags.c_contiguous and out.flags.writeable):
            raise TypeError(f"out: needs np.empty({shape}), got {arguments.given(out)}")
        points = self.cable.points
        self._write_poses(points, self._basis(self._greville), out)
        out[:, :3] = points[:, :3] + self.model.origin

    def energy(self) -> Energy:
        """Energies of the present state."""
        e = dict(zip(ENERGIES, self.cable.potentials().tolist(), strict=True))
        return Energy(
            kinetic=self.cable.kinetic(self.cable.velocities(self.time)),
            stretch=e["stretch"],
            bend=e["bend"] + e["plasticity"],
            twist=e["twist"] + e["torsion"],
            gravity=e["gravity"],
            spring=e["spring"],
            contact=e["contact"],
        )

    @property
    def undefined_torsion(self) -> UndefinedTorsion:
        """At how many samples the Frenet torsion was undefined in the run so far."""
        if not self.model.has(TORSION):
            return UndefinedTorsion(0, 0, 0.0, 0, 0.0)
        account = self.cable.account
        return UndefinedTorsion(
            samples=int(np.count_nonzero(self.model.rule.weights)),
            last=int(account.torsion_last),
            mean=float(account.torsion_sum / max(account.torsion_looks, 1.0)),
            worst=int(account.torsion_worst),
            floor=self.scene.curvature_floor,
        )

    @property
    def plastic_work(self) -> float:
        """Energy [J] that plastic bending has dissipated since the start, and what rotating the
        plastic curvature with the tangent took from the stored energy, which may be negative.
        """
        return float(self.cable.account.plastic_work)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers of the results, one line each."""
        torsion = self.undefined_torsion
        return (*self.warnings, *([torsion.note] if torsion.worst else []))

    @property
    def energy_error(self) -> float:
        """Largest |energy - work done + energy lost| so far, as a share of the energy exchanged."""
        cable, account = self.cable, self.cable.account
        worst, exchanged = float(account.error), float(account.exchanged)
        if not self._stepper.looked_at(self._steps):
            error, present = cable.balance()
            worst, exchanged = max(worst, error), max(exchanged, present)
        return worst / max(exchanged, float(account.floor))

    def end_pose(self, end: str) -> tuple[Array, Array]:
        """End-effector pose at the present time: position [m] (3,), quaternion x, y, z, w (4,)."""
        position, orientation = self._ends.pose(end, self.time)
        return position + self.model.origin, orientation

    def path(self, name: str, given: ArrayLike, count: int) -> Array:
        """Check poses (count, 7), or pairs of points (count, 2, 3), of an end effector.

        Returns:
            Poses, shape (count, 7).

        Raises:
            TypeError, ValueError: no such end effector, or as `following.checked_poses`.
        """
        orientation = self.end_pose(known_holder(self.scene, name))[1]
        tangent = self._geometries[name].tangent
        return checked_poses(name, given, count, orientation, tangent)

    def reaction(self, end: str) -> tuple[Array, Array]:
        """Force [N] and moment [N m] ON THE CABLE BY the end effector, world frame, each (3,).

        The moment is about the attachment point; it is zero if neither a clamp nor a spring holds
        the direction. The inertia and weight of the end's point mass are included.
        """
        wrench = np.array(self.reaction_wrench(end))
        return wrench[:3], wrench[3:]

    def reaction_wrench(self, end: str) -> tuple[float, ...]:
        """`reaction` as six floats: force, then moment."""
        number = list(self.scene.holders).index(known_holder(self.scene, end))
        keeps_length = self._stepper.family == CONSTRAINED
        return tuple(reaction(self.cable, self.time, number, keeps_length).tolist())

    # -- inside ---------------------------------------------------------------------------------

    def _basis(self, u: Array) -> Basis:
        """Indices of the active control points, basis values and derivatives at u, each (m, 4);
        cached.
        """
        key = u.tobytes()
        table = self._bases.get(key)
        if table is None:
            first, values = bspline.active_basis(self.model.knots, u)
            _, slopes = bspline.active_basis(self.model.knots, u, 1)
            table = (first[:, None] + np.arange(bspline.ACTIVE), values, slopes)
            if len(self._bases) >= MOST_BASES:
                self._bases.clear()
            self._bases[key] = table
        return table

    def _write_poses(self, points: Array, basis: Basis, out: Array) -> None:
        """Points of the curve and material frames, whose second axis at the start is fixed in the
        start's end effector, into out, shape (m, 7).
        """
        self.cable.call(curve_frames, points, *basis, self.time, self._frame_axis, out)


def _coordinates(u: ArrayLike) -> Array:
    """Material coordinates given by a caller, checked to be numbers."""
    return arguments.numbers("u", u, (None,), "m, from 0 to the length")
