"""Recordings of simulated cables, whose numbers are known."""

import numpy as np
from marker_arrays import array, marker

import dlo_sim
from dlo_sim.core import bspline, rotations
from dlo_sim.identification.measurement import TANGENT, Measurement, clamped_at
from dlo_sim.identification.prediction import COMPUTATION
from dlo_sim.replay.bags import BagWriter
from dlo_sim.session import cdr
from dlo_sim.simulation.simulator import Simulator

SHARES = np.linspace(0.1, 0.9, 8)
TRUTH = {
    "cable.length": 1.0,
    "cable.diameter": 0.006,
    "cable.linear_density": 0.05,
    "cable.axial_stiffness": 500.0,
    "cable.bending_stiffness": 2e-3,
    "damping.stiffness": 0.06,
    "damping.air_drag": 0.01,
    "terms.twist": "off",
}


def poses(times, amount, seed):
    """Grippers that hold a hanging loop and move along smooth random ways."""
    rng = np.random.default_rng(seed)
    found = {}
    down = {"start": [0.0, 0.0, -1.0], "end": [0.0, 0.0, 1.0]}
    for end, place in (("start", [0.0, 0.0, 0.0]), ("end", [0.5, 0.0, 0.0])):
        phase, rate = rng.uniform(0.0, 2.0 * np.pi, (2, 3)), rng.uniform(0.4, 1.2, (2, 3))
        way = np.sin(2.0 * np.pi * rate[0] * times[:, None] + phase[0]) - np.sin(phase[0])
        tilt = np.sin(2.0 * np.pi * rate[1] * times[:, None] + phase[1]) - np.sin(phase[1])
        direction = np.array(down[end]) + 0.3 * amount * tilt
        turned = rotations.minimal_rotation(np.array(TANGENT), direction)
        found[end] = np.hstack([np.array(place) + 0.08 * amount * way, turned])
    return found


def recorded(truth, seed=0, amount=1.0, duration=1.5, noise=1e-3):
    """A piece at 100 Hz, from rest, with noise on the markers [m]."""
    times = np.arange(0.0, duration, 0.01)
    paths = poses(times, amount, seed)
    known = {"cable.length": truth["cable.length"], **clamped_at(paths)}
    scene = dlo_sim.load_scene({**COMPUTATION, **known, **truth, "initial.shape": "equilibrium"})
    sim = Simulator(scene, {end: (path[0, :3], path[0, 3:]) for end, path in paths.items()})
    u = SHARES * scene.cable.length
    first = sim.centerline(u)
    report, points = sim.follow(times, paths, times[1:])
    assert report.status.ok
    basis = bspline.evaluate(np.eye(sim.model.n), sim.model.knots, u)
    markers = np.concatenate([first[None], basis @ points[:, :, :3]])
    markers += np.random.default_rng(seed + 1000).normal(0.0, noise, markers.shape)
    return Measurement(f"simulated {seed}", times, markers, paths, SHARES, known)


def encoded(kind, stamp, points):
    """A message of markers."""
    if kind == cdr.POSE_ARRAY:
        still = np.tile([0.0, 0.0, 0.0, 1.0], (len(points), 1))
        return cdr.PoseArrayEncoder("world", len(points)).encode(stamp, np.hstack([points, still]))
    if kind == cdr.MARKER_ARRAY:
        return array(stamp, *(marker(0, point, (0.0, 0.0, 0.0)) for point in points))
    field = [
        cdr.new("sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=7, count=1)
        for k, name in enumerate("xyz")
    ]
    raw = np.frombuffer(points.astype("<f4").tobytes(), np.uint8)
    size = {"height": 1, "width": len(points), "point_step": 12, "row_step": 12 * len(points)}
    cloud = cdr.new(kind, fields=field, data=raw, is_dense=True, **size)
    cloud.header.stamp.sec, cloud.header.stamp.nanosec = divmod(stamp, 10**9)
    cloud.header.frame_id = "world"
    return cdr.write(kind, cloud)


def bag_of(folder, recording, kind=None, cut=0):
    """A bag of a recording, with its markers as messages of a kind, less some bytes of each."""
    poses = {f"/{end}_pose": values for end, values in recording.poses.items()}
    topics = dict.fromkeys(poses, cdr.POSE_STAMPED)
    topics["/ft" if kind is None else "/markers"] = kind or cdr.WRENCH_STAMPED
    pose, wrench = (
        cdr.StampedEncoder(each, "world") for each in (cdr.POSE_STAMPED, cdr.WRENCH_STAMPED)
    )
    writer = BagWriter(folder, topics, "mcap")
    for k, time in enumerate(recording.times):
        stamp = 10**12 + round(time * 1e9)
        for topic, values in poses.items():
            writer.write(topic, stamp, pose.encode(stamp, values[k]))
        if kind is None:
            force = [*recording.forces[k], 0.0, 0.0, 0.0]
            writer.write("/ft", stamp, wrench.encode(stamp, force))
        else:
            data = encoded(kind, stamp, recording.markers[k])
            writer.write("/markers", stamp, data[: len(data) - cut])
    writer.finish()
    return folder
