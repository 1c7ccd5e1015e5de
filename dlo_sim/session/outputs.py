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
- `/tf`: both ends of the cable with the material frame, the end effector of each grasp, and the
  connectors that have a frame.

Of a net, `~/branches/<name>/...` and `~/cables/<name>/...` have what `~/...` has of the main cable;
markers of all cables are on one topic, in namespaces and colours of their own. Also
`~/connectors/<name>/pose`, and their shapes on `~/connectors`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.color_scale import CONNECTOR, STRANDS, colors
from dlo_sim.scene.description import EARTH, Obstacle, Scene
from dlo_sim.scene.nets import MAIN, Strand
from dlo_sim.session import cdr
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import (
    CAPSULES,
    CENTERLINE,
    CONNECTORS,
    CONTACTS,
    CONTROL_POINTS,
    CONTROL_POLYGON,
    DEFAULT_NAMING,
    MARKERS,
    POINTS,
    POSE,
    TF,
    of_strand,
    output_topics,
    places,
    reactions,
)

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]

_POLYGON_COLOR = (0.3, 0.5, 0.9, 0.6)
_BODY_COLOR, _FORCE_COLOR = (0.6, 0.6, 0.6, 0.5), (0.9, 0.1, 0.1, 1.0)
_CONNECTOR_COLOR = (*CONNECTOR, 0.9)
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


class _Cable:
    """What the messages of one cable are made with.

    Attributes:
        samples, along_capsules: material coordinates [m] of points. color: of its own.
        poses, centerline, polygon: write messages.
    """

    def __init__(
        self, strand: Strand, number: int, control_points: int, lifetime_ns: int, alone: bool
    ) -> None:
        scene, wanted = strand.scene, strand.scene.outputs
        self.name, self.diameter, count = strand.name, scene.cable.diameter, control_points
        self.samples = np.linspace(0.0, scene.cable.length, wanted.centerline_samples)
        self.along_capsules = np.linspace(0.0, scene.cable.length, _FINER * wanted.capsules + 1)
        self.color = (*STRANDS[number % len(STRANDS)], 1.0)
        space = f"/{strand.name}" * (strand.name != MAIN)
        polygon = _POLYGON_COLOR if alone else (*self.color[:3], _POLYGON_COLOR[3])
        self.poses = cdr.PoseArrayEncoder(scene.frame_id, count)
        self.centerline = cdr.LineEncoder(
            *(scene.frame_id, f"centerline{space}", wanted.centerline_samples),
            *(self.diameter, self.color, lifetime_ns),
            colored=wanted.color_by != "none",
        )
        self.polygon = cdr.LineEncoder(
            *(scene.frame_id, f"control_polygon{space}", count),
            *(0.3 * self.diameter, polygon, lifetime_ns),
        )


class Outputs:
    """Encodes the state of one simulator.

    Args:
        control_points: numbers of those of each cable.

    Attributes:
        not_finite: messages withheld because a number in them was not finite.
    """

    def __init__(self, scene: Scene, *control_points: int, node: str = DEFAULT_NAMING.node) -> None:
        frame = scene.frame_id
        self._lifetime = round(_MARKER_PERIODS * SECOND / scene.outputs.marker_rate)
        self.not_finite = 0
        self._scene, self._node = scene, node.lstrip("/")
        numbered = enumerate(zip(scene.strands, control_points, strict=True))
        alone = len(scene.strands) == 1
        self._cables = [_Cable(one, k, n, self._lifetime, alone) for k, (one, n) in numbered]
        self._wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, frame)
        self._pose = cdr.StampedEncoder(cdr.POSE_STAMPED, frame)
        self._fields = ["x", "y", "z", "u"] + ["tension"] * (not scene.without_tension)
        # The weight of the cable has a tenth of its length.
        self._length_per_force = 0.1 / (scene.cable.mu * EARTH)
        encoders: dict[str, list[_Encode]] = {
            CAPSULES: [self._encode_capsules],
            CONTACTS: [self._encode_contacts],
            CONNECTORS: [self._encode_connectors],
            TF: [self._encode_transforms],
        }
        for strand, cable in zip(scene.strands, self._cables, strict=True):
            for topic, encode in (
                (of_strand(CONTROL_POINTS, strand), self._encode_control_points),
                (of_strand(POINTS, strand), self._encode_points),
                (CENTERLINE, self._encode_centerline),
                (CONTROL_POLYGON, self._encode_control_polygon),
            ):
                encoders.setdefault(topic, []).append(partial(encode, cable))
        encoders |= {
            topic: [partial(self._encode_reaction, name)]
            for name, topic in reactions(scene).items()
        }
        for one in scene.connectors:
            encoders[POSE.format(one.name)] = [partial(self._encode_connector, one.name)]
        self._topics = tuple(
            (topic, message_type, encode, topic in MARKERS)
            for topic, message_type in output_topics(scene).items()
            for encode in encoders.get(topic, ())  # the others need more than the present state
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

    def _encode_connector(self, name: str, simulator: Simulator, stamp_ns: int) -> bytes | None:
        pose = np.concatenate(simulator.connector_pose(name))
        return self._pose.encode(stamp_ns, pose) if _finite(pose) else None

    def _encode_control_points(
        self, cable: _Cable, simulator: Simulator, stamp_ns: int
    ) -> bytes | None:
        simulator.control_poses(cable.poses.rows, cable.name)
        return cable.poses.encode(stamp_ns) if _finite(cable.poses.rows) else None

    def _encode_centerline(
        self, cable: _Cable, simulator: Simulator, stamp_ns: int
    ) -> bytes | None:
        line = simulator.strand(cable.name).points(cable.samples)
        if not _finite(line):
            return None
        wanted = self._scene.outputs
        if wanted.color_by == "none":
            return cable.centerline.encode(stamp_ns, line)
        shown = {
            one.name: getattr(simulator.strand(one.name), wanted.color_by)(one.samples)
            for one in self._cables
        }
        low, high = wanted.color_range
        if not high > low:
            all_shown = np.concatenate(list(shown.values()))
            low, high = float(all_shown.min()), float(all_shown.max())
        return cable.centerline.encode(stamp_ns, line, colors(shown[cable.name], low, high))

    def _encode_control_polygon(
        self, cable: _Cable, simulator: Simulator, stamp_ns: int
    ) -> bytes | None:
        points = simulator.strand(cable.name).control_points[:, :3]
        return cable.polygon.encode(stamp_ns, points) if _finite(points) else None

    def _encode_points(self, cable: _Cable, simulator: Simulator, stamp_ns: int) -> bytes | None:
        curve, samples = simulator.strand(cable.name), cable.samples
        columns = [*curve.points(samples).T, samples]
        if "tension" in self._fields:
            columns.append(curve.tension(samples))
        rows = np.stack(columns, axis=1)
        if not _finite(rows):
            return None
        return cdr.encode_point_cloud(stamp_ns, self._scene.frame_id, self._fields, rows)

    def _encode_capsules(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        bodies: list[cdr.Body] = []
        for cable in self._cables:
            line = simulator.strand(cable.name).points(cable.along_capsules)
            if not _finite(line):
                return None
            joints = line[::_FINER]
            radii = 0.5 * cable.diameter + _sag(line[:-1].reshape(-1, _FINER, 3), joints)
            bodies += capsules_of(joints, radii, cable.color)
        return self._encode_bodies("capsules", stamp_ns, bodies)

    def _encode_connectors(self, simulator: Simulator, stamp_ns: int) -> bytes | None:
        bodies: list[cdr.Body] = []
        for one in self._scene.connectors:
            position, turned = simulator.connector_pose(one.name)
            if not _finite(position):
                return None
            if one.shape != "none":
                body = one.body
                place = position + rotations.rotate(turned, np.array(body.position))
                way = rotations.multiply(turned, np.array(body.orientation))
                bodies += _bodies(body, place, way, 0.0, _CONNECTOR_COLOR)
        return self._encode_bodies("connectors", stamp_ns, bodies)

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
        scene, poses = self._scene, dict[str, Array]()
        if scene.outputs.tf:
            for strand, cable in zip(scene.strands, self._cables, strict=True):
                simulator.control_poses(cable.poses.rows, cable.name)
                ends = zip(("start", "end"), cable.poses.rows[[0, -1]], strict=True)
                poses |= {strand.holder(end): pose for end, pose in ends}
            poses |= {g.name: np.concatenate(simulator.end_pose(g.name)) for g in scene.grasps}
        named = places(scene)
        frames = {f"{self._node}/{named[name]}": pose for name, pose in poses.items()}
        for one in scene.connectors:
            if one.frame:
                frames[one.frame] = np.concatenate(simulator.connector_pose(one.name))
        if not all(map(_finite, frames.values())):
            return None
        poses_of = {frame: pose.tolist() for frame, pose in frames.items()}
        return cdr.encode_transforms(stamp_ns, scene.frame_id, poses_of)


def _bodies(
    obstacle: Obstacle,
    position: Array,
    turned: Array,
    length: float,
    color: cdr.Color = _BODY_COLOR,
) -> list[cdr.Body]:
    """Markers of an obstacle at a pose; a plane is a plate of four lengths of the cable."""
    x, y, z = obstacle.size
    up = rotations.rotate(turned, np.array([0.0, 0.0, 1.0]))

    def body(kind: int, away: float, *extents: float) -> cdr.Body:
        return cdr.Body(kind, color, [*(position + away * up), *turned], extents)

    if obstacle.shape == "plane":
        return [body(cdr.CUBE, -0.5 * _PLATE, 4.0 * length, 4.0 * length, _PLATE)]
    if obstacle.shape == "box":
        return [body(cdr.CUBE, 0.0, x, y, z)]
    if obstacle.shape == "cylinder":
        return [body(cdr.CYLINDER, 0.0, x, x, z)]
    straight = max(z - x, 0.0) if obstacle.shape == "capsule" else 0.0
    caps = [body(cdr.SPHERE, side * 0.5 * straight, x, x, x) for side in (-1.0, 1.0)]
    return [*caps, body(cdr.CYLINDER, 0.0, x, x, straight)] if straight else caps[:1]


def capsules_of(joints: Array, radii: Array, color: cdr.Color) -> list[cdr.Body]:
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
            cdr.Body(cdr.CYLINDER, color, pose, (2.0 * radius, 2.0 * radius, length))
            for pose, radius, length in zip(poses, radii, lengths, strict=True)
        ),
        *(
            cdr.Body(cdr.SPHERE, color, [*joint, *cdr.NO_POSE[3:]], (2.0 * radius,) * 3)
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
