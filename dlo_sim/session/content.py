"""Checks of the numbers and the frame of a message, independent of its time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dlo_sim.core.two_points import LEAST_APART
from dlo_sim.scene.description import Scene
from dlo_sim.session.cdr import Stamped

# Positions further from the origin than this must be a mistake [m].
MOST_DISTANT = 1e8

# The distance of two points may differ from pose_spacing by this share.
SPACING_TOLERANCE = 0.1

# What is said of positions that are as expected if divided by 1000.
MILLIMETRES = "1000 times too large: metres?"
# In cable lengths: a pose may be so far from where the scene expects it without suspicion, and is
# suspected if a thousandth of it is no further away than this.
_UNSUSPECTED, _NEAR = 50.0, 10.0

# The norm of a quaternion may differ from 1 by this much; it is then normalised.
NORM_TOLERANCE = 1e-3


def in_millimetres(position: Sequence[float], expected: Sequence[float], length: float) -> bool:
    """Whether a position seems to be in millimetres: far from where it is expected [m], in terms of
    the cable's length [m], but near to it if divided by 1000.
    """
    thousandth = [1e-3 * x for x in position]
    far = math.dist(position, expected) > _UNSUSPECTED * length
    return far and math.dist(thousandth, expected) < _NEAR * length


class Refused(Exception):
    """Why a message is not used: a reason (`diagnostics.REASONS`) and one line of detail."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(reason, detail)
        self.reason, self.detail = reason, detail


class ContentCheck:
    """Checks messages against the limits and frames of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._limits = scene.inputs
        self._frames: dict[str, str] = {scene.frame_id: "", "": ""}
        for name, end in scene.holders.items():
            if end.frame:
                self._frames.setdefault(end.frame, name)

    @property
    def tools(self) -> list[str]:
        """The frames of end effectors."""
        return [name for name, end in self._frames.items() if end]

    def knows(self, frame_id: str) -> bool:
        """Whether the scene names this frame."""
        return frame_id in self._frames

    def check(self, message: Stamped, kind: str, spacing: float = 0.0) -> Stamped:
        """Check that a message is finite, within the limits and in a known frame.

        Args:
            kind: of its topic (`session.topics`). spacing: [m] of two points, 0 = any.

        Returns:
            The message; its frame_id is replaced by the name of the end or grasp in whose
            end-effector frame it is, or "" for the world frame.

        Raises:
            Refused: it cannot be used.
        """
        values = message.values
        # The sum of finite numbers overflows only far beyond every limit.
        if not math.isfinite(sum(values)):
            raise Refused("not_finite", f"{_shown(values)}; repair the publisher")
        if kind == "pose":
            check_pose(values)
        elif kind == "two_points":
            _check_points(values, spacing)
        elif kind in ("wrench", "force"):
            self._check_size(values)
        elif values and max(map(abs, values)) > MOST_DISTANT:
            raise _too_distant(values)
        return message._replace(frame_id=self._check_frame(message.frame_id, kind))

    def _check_size(self, values: tuple[float, ...]) -> None:
        for name, unit, vector, limit in (
            ("force", "N", values[:3], self._limits.max_force),
            ("torque", "N m", values[3:], self._limits.max_torque),
        ):
            size = math.hypot(*vector)
            if size > limit:
                raise Refused(
                    "too_large",
                    f"{name} {size:.6g} {unit} exceeds inputs.max_{name} {limit:g} {unit}",
                )

    def _check_frame(self, frame_id: str, kind: str) -> str:
        end = self._frames.get(frame_id)
        # Only forces and torques may be given in the frame of an end effector, which moves.
        fixed = kind not in ("wrench", "force")
        if end is not None and not (end and fixed):
            return end
        known = [name for name, of in self._frames.items() if name and not (of and fixed)]
        world = f"set frame_id: {frame_id} if it is the world frame, "
        raise Refused(
            "unknown_frame",
            f"frame_id '{frame_id}', known: {', '.join(known)}; {world if end is None else ''}"
            "transform before publishing, or run live with inputs.tf: true",
        )


def _check_points(values: tuple[float, ...], spacing: float) -> None:
    if len(values) != 6:
        raise Refused("bad_points", f"{len(values) // 3} points; publish two")
    first, second = values[:3], values[3:]
    _check_position(first)
    _check_position(second)
    apart = math.dist(first, second)
    if apart < LEAST_APART:
        raise Refused("bad_points", f"{apart:.3g} m apart: they give no direction; publish two")
    if spacing and abs(apart - spacing) > SPACING_TOLERANCE * spacing:
        fits_in_millimetres = abs(1e-3 * apart - spacing) <= SPACING_TOLERANCE * spacing
        raise Refused(
            "bad_points",
            f"{apart:.6g} m apart, pose_spacing is {spacing:g} m; "
            f"{MILLIMETRES + ', ' if fits_in_millimetres else ''}"
            "correct it, or the markers",
        )


def _check_position(position: tuple[float, ...]) -> None:
    if math.hypot(*position) > MOST_DISTANT:
        raise _too_distant(position)


def check_pose(values: tuple[float, ...]) -> None:
    """Refuse a position that is too far away, or a quaternion that is not of unit length.

    Raises:
        Refused: it cannot be used.
    """
    _check_position(values[:3])
    norm = math.hypot(*values[3:])
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise Refused(
            "bad_quaternion", f"orientation {_shown(values[3:])} has norm {norm:.6g}, needs 1"
        )


def _too_distant(values: tuple[float, ...]) -> Refused:
    shown = _shown(values[:3])
    return Refused("too_large", f"position {shown} is beyond {MOST_DISTANT:g} m; check its unit")


def _shown(values: tuple[float, ...]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"
