"""Serialises the simulator's state to output messages.

All are in the world frame `frame_id`; the stamp is the time of the state.
- `~/start/reaction`, `~/end/reaction`, `~/<grasp>/reaction`: force [N] and torque [N m] ON THE
  CABLE BY THE END EFFECTOR, with inertia and weight of the point mass `<end>.mass`; torque about
  the attachment point. A wrist force-torque sensor reads the NEGATIVE.
- `~/control_points`: they lie on the cable only at its ends, else near it; orientation: material
  frame at the control point's material coordinate, x axis = tangent from start to end.
- `~/centerline`, `~/control_polygon`: points on the cable, coloured by outputs.color_by; the
  control points.
- `~/points`: the centerline with u [m] and, where known, tension [N]; float64 beyond 1 km.
- `~/capsules`: capsules that enclose the cable. `~/contacts`: obstacles, and a line along the force
  at every sample that touches (with itself, on one of the strands).
- `/tf`: both ends of the cable with the material frame, and the end effector of each grasp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.color_scale import colors
from dlo_sim.scene.description import EARTH, Obstacle, Scene
from dlo_sim.session import cdr
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import (
    CAPSULES,
    CENTERLINE,
    CONTACTS,
    CONTROL_POINTS,
    CONTROL_POLYGON,
    DEFAULT_NAMING,
    MARKERS,
    POINTS,
    REACTION,
    TF,
    output_topics,
)

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]

_CABLE_COLOR = (0.95, 0.55, 0.1, 1.0)
_POLYGON_COLOR = (0.3, 0.5, 0.9, 0.6)
_BODY_COLOR, _FORCE_COLOR = (0.6, 0.6, 0.6, 0.5), (0.9, 0.1, 0.1, 1.0)
_PLATE = 1e-3  # [m], thickness of the marker of a plane
_MARKED = "plane", "box", "sphere", "cylinder", "capsule"  # shapes that `_bodies` has markers for
_MARKER_PERIODS = 5  # after which a marker that is not renewed disappears
_FINER = 4  # points of the cable per capsule from which its radius is computed


class OutgoingMessage(NamedTuple):
    """A serialised message: topic as in the scene, ROS type, stamp (clock time [ns]), CDR bytes."""

    topic: str
    type: str
    stamp_ns: int
    data: bytes


_Encode = Callable[["Simulator", int], bytes | None]


class Outputs:
    """Encodes the state of one simulator.

    Attributes:
        not_finite: messages withheld because a number in them was not finite.
    """

    def __init__(self, scene: Scene, control_points: int, node: str = DEFAULT_NAMING.node) -> None:
        wanted, frame, width = scene.outputs, scene.frame_id, scene.cable.diameter
        samples, capsules = wanted.centerline_samples, wanted.capsules
        self._lifetime = lifetime = round(_MARKER_PERIODS * SECOND / wanted.marker_rate)
        self.not_finite = 0
        self._scene, self._node = scene, node.lstrip("/")
        self._samples = np.linspace(0.0, scene.cable.length, samples)
        self._along_capsules = np.linspace(0.0, scene.cable.length, _FINER * capsules + 1)
        self._wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, frame)
        self._poses = cdr.PoseArrayEncoder(frame, control_points)
        self._centerline = cdr.LineEncoder(
            *(frame, "centerline", samples, width, _CABLE_COLOR, lifetime),
            colored=wanted.color_by != "none",
        )
        self._polygon = cdr.LineEncoder(
            frame, "control_polygon", control_points, 0.3 * width, _POLYGON_COLOR, lifetime
        )
        self._fields = ["x", "y", "z", "u"] + ["tension"] * (not scene.without_tension)
        # The weight of the cable has a tenth of its length.
        self._length_per_force = 0.1 / (scene.cable.mu * EARTH)
        encoders: dict[str, _Encode] = {
            CONTROL_POINTS: self._encode_control_points,
            CENTERLINE: self._encode_centerline,
            CONTROL_POLYGON: self._encode_control_polygon,
            POINTS: self._encode_points,
            CAPSULES: self._encode_capsules,
            CONTACTS: self._encode_contacts,
            TF: self._encode_transforms,
        }
        encoders |= {
            REACTION.format(name): partial(self._encode_reaction, name) for name in scene.holders
        }
        self._topics = tuple(
            (topic, message_type, encoders[topic], topic in MARKERS)
            for topic, message_type in output_topics(scene).items()
            if topic in encoders  # the others need more than the present state
        )

    def messages(
        self,
        simulator: Simulator,
        stamp_ns: int,
        wanted: Collection[str] | None = None,
        again: Collection[str] = (),
        states: bool = True,
        markers: bool = True,
    ) -> list[OutgoingMessage]:
        """The messages of this state with a stamp (clock time [ns]).

        Args:
            wanted: topics to compute, None = all: those of the state if `states`, those of markers
                if `markers`. again: topics to compute in any case.
        """
        messages: list[OutgoingMessage] = []
        for topic, message_type, encode, is_marker in self._topics:
            due = (markers if is_marker else states) and (wanted is None or topic in wanted)
            if not due and topic not in again:
                continue
            data = encode(simulator, stamp_ns)
            if data is None:
                self.not_finite += 1
            else:
                messages.append(OutgoingMessage(topic, message_type, stamp_ns, data))
        return messages

    # Each encoder returns None if a number is not finite.

    def _encode_reaction(self, end: str, simulator: Simulator, stamp_ns: int) -> bytes | None:
        wrench = simulator.reaction_wrench(end)
        return self._wrench.encode(stamp_ns, wrench) if math.isfinite(sum(wrench)) else None

    def _encode_control_points(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        simulator.control_poses(self._poses.rows)
        return self._poses.encode(stamp_ns) if _finite(self._poses.rows) else None

    def _encode_centerline(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        line = simulator.centerline(self._samples)
        if not _finite(line):
            return None
        wanted = self._scene.outputs
        if wanted.color_by == "none":
            return self._centerline.encode(stamp_ns, line)
        low, high = wanted.color_range
        by_tension = wanted.color_by == "tension"
        shown = (simulator.tension if by_tension else simulator.curvature)(self._samples)
        shades = colors(shown, *((low, high) if high > low else ()))
        return self._centerline.encode(stamp_ns, line, shades)

    def _encode_control_polygon(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        points = simulator.control_points[:, :3]
        return self._polygon.encode(stamp_ns, points) if _finite(points) else None

    def _encode_points(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        columns = [*simulator.centerline(self._samples).T, self._samples]
        if "tension" in self._fields:
            columns.append(simulator.tension(self._samples))
        rows = np.stack(columns, axis=1)
        if not _finite(rows):
            return None
        return cdr.encode_point_cloud(stamp_ns, self._scene.frame_id, self._fields, rows)

    def _encode_capsules(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        line = simulator.centerline(self._along_capsules)
        if not _finite(line):
            return None
        joints = line[::_FINER]
        radii = 0.5 * self._scene.cable.diameter + _sag(line[:-1].reshape(-1, _FINER, 3), joints)
        return self._encode_bodies("capsules", stamp_ns, capsules_of(joints, radii))

    def _encode_contacts(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        scene, bodies, lines = self._scene, [], [np.zeros((0, 3))]
        for obstacle in simulator.scene.bodies:
            position, turned = simulator.end_pose(obstacle.name)
            pose, url = [*position, *turned], obstacle.mesh_url
            if obstacle.shape == "mesh" and url:
                size = (obstacle.mesh_scale,) * 3
                bodies.append(cdr.Body(cdr.MESH_RESOURCE, _BODY_COLOR, pose, size, resource=url))
            elif obstacle.shape not in _MARKED:
                points = simulator.surface(obstacle.name).reshape(-1, 3)
                bodies.append(cdr.Body(cdr.TRIANGLE_LIST, _BODY_COLOR, pose, (1.0,) * 3, points))
            else:
                bodies += _bodies(obstacle, position, turned, scene.cable.length)
        for one in simulator.contacts.values():
            ends = one.points + self._length_per_force * one.forces
            lines.append(np.stack([one.points, ends], axis=1).reshape(-1, 3))
        forces = np.concatenate(lines)
        if not (_finite(forces) and all(_finite(np.array(body.pose)) for body in bodies)):
            return None
        extents = (0.3 * scene.cable.diameter, 0.0, 0.0)
        arrows = cdr.Body(cdr.LINE_LIST, _FORCE_COLOR, cdr.NO_POSE, extents, forces)
        return self._encode_bodies("contacts", stamp_ns, [arrows, *bodies])

    def _encode_bodies(self, namespace: str, stamp_ns: int, bodies: Iterable[cdr.Body]) -> bytes:
        return cdr.encode_bodies(self._scene.frame_id, namespace, stamp_ns, self._lifetime, bodies)

    def _encode_transforms(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        simulator.control_poses(self._poses.rows)
        poses = {"start": self._poses.rows[0], "end": self._poses.rows[-1]}
        poses |= {g.name: np.concatenate(simulator.end_pose(g.name)) for g in self._scene.grasps}
        if not all(map(_finite, poses.values())):
            return None
        frames = {f"{self._node}/{name}": pose for name, pose in poses.items()}
        return cdr.encode_transforms(stamp_ns, self._scene.frame_id, frames)


def _bodies(obstacle: Obstacle, position: Array, turned: Array, length: float) -> list[cdr.Body]:
    """Markers of an obstacle at a pose; a plane is a plate of four lengths of the cable."""
    x, y, z = obstacle.size
    up = rotations.rotate(turned, np.array([0.0, 0.0, 1.0]))

    def body(kind: int, away: float, *extents: float) -> cdr.Body:
        return cdr.Body(kind, _BODY_COLOR, [*(position + away * up), *turned], extents)

    if obstacle.shape == "plane":
        return [body(cdr.CUBE, -0.5 * _PLATE, 4.0 * length, 4.0 * length, _PLATE)]
    if obstacle.shape == "box":
        return [body(cdr.CUBE, 0.0, x, y, z)]
    if obstacle.shape == "cylinder":
        return [body(cdr.CYLINDER, 0.0, x, x, z)]
    straight = max(z - x, 0.0) if obstacle.shape == "capsule" else 0.0
    caps = [body(cdr.SPHERE, side * 0.5 * straight, x, x, x) for side in (-1.0, 1.0)]
    return [*caps, body(cdr.CYLINDER, 0.0, x, x, straight)] if straight else caps[:1]


def capsules_of(joints: Array, radii: Array) -> list[cdr.Body]:
    """Cylinders between joints [m], shape (count + 1, 3), with radii [m], shape (count,), and a
    sphere at each joint with the larger radius of its cylinders.
    """
    ways = np.diff(joints, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    # A cylinder can be reversed, so its axis never has to turn by more than 90 degrees.
    upward = np.where(ways[:, 2:] < 0.0, -ways, ways)
    upward[lengths == 0.0] = 0.0, 0.0, 1.0
    turned = rotations.minimal_rotation(np.array([0.0, 0.0, 1.0]), upward)
    poses = np.hstack([0.5 * (joints[1:] + joints[:-1]), turned])
    thick = np.maximum(np.append(radii, 0.0), np.insert(radii, 0, 0.0))
    return [
        *(
            cdr.Body(cdr.CYLINDER, _CABLE_COLOR, pose, (2.0 * radius, 2.0 * radius, length))
            for pose, radius, length in zip(poses, radii, lengths, strict=True)
        ),
        *(
            cdr.Body(cdr.SPHERE, _CABLE_COLOR, [*joint, *cdr.NO_POSE[3:]], (2.0 * radius,) * 3)
            for joint, radius in zip(joints, thick, strict=True)
        ),
    ]


def _sag(pieces: Array, joints: Array) -> Array:
    """Largest distance [m] of the points of each piece, shape (n, k, 3), from the segment between
    its joints, shape (n,).
    """
    ways = np.diff(joints, axis=0)[:, None]
    from_joint = pieces - joints[:-1, None]
    squares = np.maximum(np.sum(ways * ways, axis=-1), np.finfo(float).tiny)
    fraction = np.clip(np.sum(from_joint * ways, axis=-1) / squares, 0.0, 1.0)
    apart = np.linalg.norm(from_joint - fraction[..., None] * ways, axis=-1)
    return np.asarray(apart.max(axis=1))


def _finite(values: Array) -> bool:
    # A sum of squares is not finite if one term is not; half the time of isfinite().all().
    return math.isfinite(np.vdot(values, values))
