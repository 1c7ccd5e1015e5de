"""The scenario of the demo: a cable, a gripper that draws it over the edge of a table and swings
it, a hand that pulls at its free end.

The gripper's pose has a rate of 100 Hz and the hand's wrench 200 Hz, with the noise of good sensors
and the delays of a network, all from one random seed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.session import cdr
from dlo_sim.session.time_base import SECOND

Array = NDArray[np.float64]

SIGNATURE = "# The scene of `dlo_sim demo`"

SCENE = f"""{SIGNATURE}: a rubber-sheathed cable leaves a gripper along the
# gripper's x axis and droops beside a table. The gripper draws it over the edge and swings it; a
# hand with a force sensor pulls at its other end for a moment.
# Change a value and replay:
#
#   dlo_sim replay input --params scene.yaml --output again
/**:
  ros__parameters:
    frame_id: world
    cable:
      length: 1.0               # m
      diameter: 0.008           # m
      linear_density: 0.09      # kg/m
      axial_stiffness: 500.0    # N; stiffer than the weight by far
      bending_stiffness: 0.015  # N m^2
      torsional_stiffness: 0.01 # N m^2
    damping:
      stiffness: 0.004          # s
      mass: 0.5                 # 1/s
      air_drag: 0.12            # N s/m^2
    discretization:
      control_points: 60        # for the bend at the edge, which decides how far the end swings
    integrator:
      step: 0.001               # s
    start:
      fixed: [true, true, true]
      clamped: true
      tangent: [1.0, 0.0, 0.0]
      pose_topic: /gripper_pose
    loads:
      names: [hand]
      hand:
        topic: /hand_wrench     # WrenchStamped: the load on the cable by the hand
        position: 1.0           # at the free end
    initial:
      shape: equilibrium
    obstacles:
      names: [table]
      table:
        shape: box
        size: [0.5, 0.4, 0.03]  # m; the cable is drawn over its edge, at y = 0.1
        position: [0.2, 0.3, 0.5]
        friction: 0.3
"""

POSES, WRENCHES = "/gripper_pose", "/hand_wrench"
TOPICS = {POSES: cdr.POSE_STAMPED, WRENCHES: cdr.WRENCH_STAMPED}

DURATION = 8.0  # s
SEED = 20240229
EPOCH_NS = 1_700_000_000 * SECOND  # of the first stamp

_REST = 0.5  # s before the gripper moves
_MOVING = 4.0  # s
_LOOPS = 1
PULL = (5.4, 6.4)  # s; start and end of the hand's pull
_PULL_FORCE = np.array([0.1, 0.4, 0.15])  # N
_PULL_TORQUE = np.array([0.0, 0.0, 0.01])  # N m


class Message(NamedTuple):
    """Topic, arrival time [ns], serialised message."""

    topic: str
    time_ns: int
    data: bytes


def gripper_pose(t: Array) -> tuple[Array, Array]:
    """Pose of the gripper at times t [s]: one figure of eight, from rest to rest.

    Returns:
        Positions [m], shape (n, 3), and quaternions x, y, z, w, shape (n, 4).
    """
    s = np.clip((t - _REST) / _MOVING, 0.0, 1.0)
    # Minimum-jerk polynomial from 0 to 1, with zero velocity and acceleration at both ends.
    phase = 2.0 * np.pi * _LOOPS * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    across, along = np.sin(phase), np.sin(2.0 * phase)
    position = np.stack((0.08 * along, 0.35 * across, 1.0 + 0.08 * along), axis=-1)
    zero = np.zeros_like(s)
    yaw = rotations.from_rotation_vector(np.stack((zero, zero, 0.7 * across), axis=-1))
    pitch = rotations.from_rotation_vector(np.stack((zero, 0.4 * along, zero), axis=-1))
    return position, rotations.multiply(yaw, pitch)


def hand_wrench(t: Array) -> Array:
    """Force [N] and torque [N m] of the hand on the cable at times t [s], shape (n, 6)."""
    s = np.clip((t - PULL[0]) / (PULL[1] - PULL[0]), 0.0, 1.0)
    return np.sin(np.pi * s)[:, None] ** 2 * np.concatenate((_PULL_FORCE, _PULL_TORQUE))


def messages(duration: float = DURATION, seed: int = SEED) -> Iterator[Message]:
    """All messages in order of arrival."""
    random = np.random.default_rng(seed)
    t_pose = np.arange(round(duration * 100.0) + 1) / 100.0
    position, orientation = gripper_pose(t_pose)
    position += random.normal(scale=2e-5, size=position.shape)  # m
    tremble = rotations.from_rotation_vector(random.normal(scale=1e-4, size=position.shape))
    poses = np.concatenate((position, rotations.multiply(tremble, orientation)), axis=-1)
    t_wrench = np.arange(round(duration * 200.0) + 1) / 200.0
    wrenches = hand_wrench(t_wrench)
    wrenches += random.normal(scale=(0.01,) * 3 + (2e-4,) * 3, size=wrenches.shape)  # N, N m
    streams = [
        *_stream(POSES, t_pose, poses, random),
        *_stream(WRENCHES, t_wrench, wrenches, random),
    ]
    yield from sorted(streams, key=lambda message: message.time_ns)


def _stream(topic: str, t: Array, values: Array, random: np.random.Generator) -> Iterator[Message]:
    """Messages of one topic: stamped at t [s], arriving some milliseconds later, in order."""
    encoder = cdr.StampedEncoder(TOPICS[topic], "world")
    arrival = np.maximum.accumulate(t + random.gamma(2.0, 1e-3, size=t.shape))
    for stamp, arrived, row in zip(t, arrival, values, strict=True):
        data = encoder.encode(EPOCH_NS + round(stamp * SECOND), row.tolist())
        yield Message(topic, EPOCH_NS + round(arrived * SECOND), data)
