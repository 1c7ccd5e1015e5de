"""The obstacles of a run, and where the cable touches them or itself, as arrays that a picture is
drawn from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.engine.arrays import CONTACT, SELF
from dlo_sim.engine.grasps import DURATION
from dlo_sim.simulation import obstacles
from dlo_sim.simulation.bodies import motion_of
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.self_contact import contacts_of

Array = NDArray[np.float64]
Look = Callable[[Cable, Mapping[str, obstacles.Contact]], object]
MOST_LOOKS = 100  # samples of a run whose contacts are computed
PLATE = 1.4  # side of what is shown of a plane, in diagonals of the box that the run needs


def drawn_obstacles(cable: Cable, recorder: Recorder, look: Look) -> dict[str, Array]:
    """Obstacles along the samples of a run, and where the cable touches them or itself; empty if it
    can touch nothing.

    Args:
        look: called with the cable at every sample whose contacts are computed, and these by the
            names of the obstacles.

    Returns:
        obstacle_triangles: surfaces, each in the frame of its obstacle [m], shape (k, 3, 3), and
        obstacle_of: the number of that, shape (k,). obstacle_poses: position [m] and quaternion
        x, y, z, w of every obstacle at every sample, shape (T, obstacles, 7).

        contact_looks: the samples whose contacts are computed, up to `MOST_LOOKS` of them, shape
        (l,). There contact_clearance: smallest gap [m], contact_to_itself: that between strands of
        the cable, infinite where it does not touch itself, contact_total and contact_largest: sum
        and largest of what obstacles and the cable itself exert [N], shape (l,); contact_points [m]
        and contact_forces on the cable [N], shape (c, 3), at the samples contact_samples, shape
        (c,). The forces are those of the pressure, without friction, which a shape does not tell.
    """
    bodies = cable.model.scene.bodies if cable.model.has(CONTACT) else ()
    if not (recorder.count and (bodies or cable.model.has(SELF))):
        return {}
    points = recorder.control_points[:, :, :3].reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    poses = np.empty((recorder.count, len(bodies), 7))
    for part, rows in recorder.obstacles():
        for k, row in enumerate(rows):
            moving = recorder.times[part] if row[DURATION] else recorder.times[part][:1]
            motion = motion_of(row)
            poses[part, k, :3] = motion.position_at(moving) + cable.model.origin
            poses[part, k, 3:] = motion.orientation_at(moving)
    surfaces, numbers = [np.zeros((0, 3, 3))], [np.zeros(0)]
    for k, body in enumerate(bodies):
        surface = obstacles.surface(body, PLATE * float(np.linalg.norm(high - low)))
        if body.shape == "plane":
            way = 0.5 * (low + high) - poses[0, k, :3]
            there = rotations.rotate(rotations.conjugate(poses[0, k, 3:]), way)
            surface = surface + there * (1.0, 1.0, 0.0)
        surfaces.append(surface)
        numbers.append(np.full(len(surface), float(k)))
    return {
        "obstacle_triangles": np.concatenate(surfaces),
        "obstacle_of": np.concatenate(numbers),
        "obstacle_poses": poses,
        **_contacts(cable, recorder, look),
    }


def _contacts(cable: Cable, recorder: Recorder, look: Look) -> dict[str, Array]:
    """The part of `drawn_obstacles` that has to do with contact."""
    twin, count = deepcopy(cable), recorder.count
    points, forces, samples = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)]
    looks = np.unique(np.linspace(0, count - 1, min(count, MOST_LOOKS)).round().astype(int))
    gaps, sizes, to_itself = [], [], []
    for sample in looks:
        twin.x[:] = recorder.lines[sample]
        twin.obstacles[:] = next(
            rows for part, rows in recorder.obstacles() if part.start <= sample < part.stop
        )
        twin.touch_anew(recorder.times[sample])
        found = contacts_of(twin)
        itself = found.get(obstacles.ITSELF)
        to_itself.append(itself.clearance if itself else math.inf)
        look(twin, found)
        gaps.append(min(contact.clearance for contact in found.values()))
        sizes.append([contact.exerted for contact in found.values()])
        for contact in found.values():
            points.append(contact.points)
            forces.append(contact.forces)
            samples.append(np.full(len(contact.points), float(sample)))
    return {
        "contact_looks": looks.astype(float),
        "contact_clearance": np.array(gaps),
        "contact_to_itself": np.array(to_itself),
        "contact_total": np.sum(sizes, axis=1),
        "contact_largest": np.max(sizes, axis=1),
        "contact_points": np.concatenate(points),
        "contact_forces": np.concatenate(forces),
        "contact_samples": np.concatenate(samples),
    }
