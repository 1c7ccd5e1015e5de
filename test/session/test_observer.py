"""Measured points pull the prediction to the real cable; never silently, never by chance."""

import tracemalloc

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from session_bench import MS, SECOND, T0

from dlo_sim import Simulator, load_scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.session import cdr, observer
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.session import Session

STORE = get_typestore(Stores.ROS2_JAZZY)
# A cable that sags between two points and swings; what it swings in the prediction does not know.
FREE = {
    "cable.length": 1.0,
    "cable.diameter": 0.008,
    "cable.youngs_modulus": 1e6,
    "damping.stiffness": 0.05,
    "end.position": [0.7, 0.0, 0.0],
    "end.fixed": [True, True, True],
    "terms.out_of_plane": "on",
}
WIND = {
    "loads.names": ["wind"],
    "loads.wind.type": "force",
    "loads.wind.position": 0.4,
    "loads.wind.signal": "sine",
    "loads.wind.force": [0.0, 0.04, 0.02],
    "loads.wind.frequency": 0.6,
}
LATENCY = 0.06
SEEN = {**FREE, "measured.type": "point_cloud"}
PERIOD = 33 * MS


def scene(values, **changes):
    return load_scene({**values, **changes})


@pytest.fixture(scope="module")
def truth():
    """Points at ten places of the real cable, in the wind: seconds -> (10, 3)."""
    real = scene(FREE, **WIND)
    sim, shapes = Simulator(real), []
    u = np.linspace(0.05, 0.95, 10) * real.cable.length
    for _ in range(round(2.0 / sim.step)):
        shapes.append(sim.centerline(u))
        sim.advance_steps(1)
    return lambda seconds: shapes[round((seconds + LATENCY) / sim.step)]


def run(truth, values=SEEN, *, late=0, ticks=5 * MS, outliers=False, kind="cloud", seconds=1.5):
    """A session that sees three points 30 times a second with 5 mm of noise, and its errors [m]."""
    rng = np.random.default_rng(7)
    session, errors, waiting = Session(scene(values)), [], []
    u = np.linspace(0.05, 0.95, 10) * session.scene.cable.length
    for now in range(T0, T0 + round(seconds * SECOND), ticks):
        for stamp in range(-(-max(now - ticks + MS, T0) // PERIOD) * PERIOD, now + 1, PERIOD):
            seen = truth((stamp - T0) * 1e-9)[rng.permutation(10)[:3]]
            points = seen + rng.normal(0.0, 0.005, (3, 3))
            if outliers:
                points[0] += [0.0, 0.5, 0.0]
            waiting.append((stamp + late, encoded(points, stamp, kind)))
        while waiting and waiting[0][0] <= now and "measured.type" in values:
            session.receive("/dlo_sim/measured", waiting.pop(0)[1], now)
        session.tick(now)
        if session.started:
            real = truth((session.stamp_ns - T0) * 1e-9)
            errors.append(np.linalg.norm(session.simulator.centerline(u) - real, axis=1).mean())
    return session, np.array(errors)


def encoded(points, stamp, kind):
    if kind == "cloud":
        points = np.vstack([points, [np.nan] * 3])  # not seen
        return cdr.encode_point_cloud(stamp, "", "xyz", points)
    encoder = cdr.PoseArrayEncoder("", len(points))
    encoder.rows[:, :3], encoder.rows[:, 6] = points, 1.0
    return encoder.encode(stamp)


def values_of(session):
    (status, *_) = cdr.decode_diagnostic_array(session.diagnostics(T0 + 2 * SECOND))[1]
    return dict(status.values)


def test_it_halves_the_error_and_keeps_the_account(truth):
    (session, corrected), (_, alone) = run(truth), run(truth, FREE)
    assert alone[100:].mean() > 0.015
    assert corrected[100:].mean() < 0.5 * alone[100:].mean()
    found = values_of(session)
    assert int(found["measured points used"]) > 120
    assert found["measured points rejected"] == "0"
    assert 0.003 < float(found["innovation [m]"]) < 0.03
    assert float(found["correction work [J]"]) != 0.0
    assert session.simulator.energy_error < 1e-4


def test_a_force_that_the_model_lacks_is_learnt(truth, monkeypatch):
    _, learnt = run(truth)
    monkeypatch.setattr(observer, "_LEARNT", 0.0)
    _, without = run(truth)
    assert learnt[100:].mean() < 0.97 * without[100:].mean()


def test_the_same_bits_however_it_arrives(truth):
    session, _ = run(truth, seconds=0.905)
    session.tick(T0 + 950 * MS)
    for changes in ({"late": 40 * MS}, {"ticks": 10 * MS}):
        other, _ = run(truth, seconds=0.905, **changes)
        other.tick(T0 + 950 * MS)
        assert other.stamp_ns == session.stamp_ns
        assert np.array_equal(other.saved.state, session.saved.state)


def test_points_that_come_too_late_are_counted_and_not_used(truth):
    session, _ = run(truth, late=100 * MS, seconds=0.9)
    found = values_of(session)
    assert found["measured points used"] == "0"
    assert int(found["measured points rejected"]) == 3 * int(found["event late"]) > 30
    assert "after their time was simulated" in found["last event"]


def test_measurements_too_many_to_wait_are_counted():
    journal = Journal(())
    waiting = observer.Observer(scene(SEEN).measured, journal)
    for stamp in range(1003):
        waiting.add(observer.Points(stamp, np.zeros((3, 3))))
    assert dict(waiting.values())["measured points rejected"] == "9"
    assert journal.events == {"full": 3}
    assert waiting.next_change_ns() == 3


def test_points_far_away_are_rejected(truth):
    session, errors = run(truth, outliers=True)
    found = values_of(session)
    assert int(found["measured points used"]) == 2 * int(found["measured points rejected"]) > 50
    assert errors[100:].mean() < run(truth, FREE)[1][100:].mean()


def test_a_pose_array_does_the_same(truth):
    session, _ = run(truth, seconds=0.5)
    other, _ = run(truth, {**SEEN, "measured.type": "pose_array"}, kind="poses", seconds=0.5)
    points = session.simulator.control_points
    assert other.simulator.control_points == pytest.approx(points, abs=1e-5)  # of float32
    assert values_of(other)["measured points used"] == values_of(session)["measured points used"]


def test_messages_that_cannot_be_used_are_refused():
    session = Session(scene(SEEN))
    topic, good = "/dlo_sim/measured", np.zeros((2, 3))
    far, endless = np.full((2, 3), 1e9), np.array([[0.0, np.inf, 0.0]])
    session.receive(topic, encoded(far, T0, "cloud"), T0)
    session.receive(topic, encoded(endless, T0, "cloud"), T0)
    session.receive(topic, cdr.encode_point_cloud(T0, "camera", "xyz", good), T0)
    session.receive(topic, encoded(good, T0, "poses"), T0)
    record = session.journal.topics[topic]
    assert record.accepted == 0
    assert record.refused == {"too_large": 1, "not_finite": 1, "unknown_frame": 1, "undecodable": 1}


def test_an_estimate_of_the_error_is_refused_beside_it():
    with pytest.raises(SceneError, match="accuracy.estimate: 'on' cannot be had"):
        scene(SEEN, **{"accuracy.estimate": "on"})


@pytest.mark.parametrize(
    ("rows", "columns", "offset", "step", "row_step"),
    [(1, 1, 8, 8, 8), (1, 1, 2**31, 12, 12), (3_000_000, 1, 8, 0, 0), (2**32 - 1, 0, 8, 12, 0)],
)
def test_clouds_with_a_layout_that_cannot_be_are_refused_or_empty(
    rows, columns, offset, step, row_step
):
    field = STORE.types["sensor_msgs/msg/PointField"]
    cloud = cdr.new(
        cdr.POINT_CLOUD,
        height=rows,
        width=columns,
        fields=[field(name, at, 7, 1) for name, at in (("x", 0), ("y", 4), ("z", offset))],
        point_step=step,
        row_step=row_step,
        data=np.zeros(12, np.uint8),
    )
    raw = cdr.write(cdr.POINT_CLOUD, cloud)
    if columns == 0:
        assert len(cdr.decode_points(cdr.POINT_CLOUD, raw).rows) == 0
    else:
        with pytest.raises(cdr.DecodeError, match="does not hold fields"):
            cdr.decode_points(cdr.POINT_CLOUD, raw)


def clouded(points):
    return cdr.encode_point_cloud(T0, "world", "xyz", points)


@pytest.mark.parametrize(
    ("kind", "topic_type", "count"),
    [
        ("point_cloud", "cloud", 5001),
        ("point_cloud", "cloud", 307_200),
        ("pose_array", "poses", 5001),
    ],
)
def test_more_points_than_are_used_are_refused_before_they_are_decoded(kind, topic_type, count):
    session = Session(scene({**SEEN, "measured.type": kind}))
    raw = encoded(np.zeros((count, 3)), T0, topic_type)
    tracemalloc.start()
    try:
        session.receive("/dlo_sim/measured", raw, T0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    record = session.journal.topics["/dlo_sim/measured"]
    assert (record.refused, record.accepted) == ({"too_many": 1}, 0)
    assert f"too_many: {count} po" in record.last_refusal
    assert "5000 at most are used" in record.last_refusal
    assert peak < 4 * count + 200_000, "masks of a byte each, no coordinates"


def test_an_organised_cloud_of_which_little_is_the_cable_is_used():
    """640 x 480 pixels, all but 3,000 of them NaN in one coordinate or another."""
    pixels = np.full((307_200, 3), 0.1)
    for k, axis in enumerate(np.array_split(np.arange(304_200), 3)):
        pixels[axis, k] = np.nan
    there = cdr.decode(cdr.POINT_CLOUD, clouded(pixels), keep_missing=False).values
    assert np.reshape(there, (-1, 3)).tolist() == pixels[304_200:].astype(np.float32).tolist()


def markers(number, points, data=0):
    """Markers with so many points each, and so many bytes of a mesh and of a texture."""
    types = STORE.types
    count = max(points, 1)
    line = cdr.LineEncoder("world", "", count, 0.1, (1.0,) * 4, 0).encode(T0, np.zeros((count, 3)))
    marker = STORE.deserialize_cdr(line, cdr.MARKER)
    if not points:
        marker.points, marker.colors = [], []
    marker.mesh_file.data = marker.texture.data = np.zeros(data, np.uint8)
    return bytes(STORE.serialize_cdr(types[cdr.MARKER_ARRAY]([marker] * number), cdr.MARKER_ARRAY))


def _joined(*arrays):
    found = [STORE.deserialize_cdr(raw, cdr.MARKER_ARRAY).markers for raw in arrays]
    joined = STORE.types[cdr.MARKER_ARRAY](sum(found, []))
    return bytes(STORE.serialize_cdr(joined, cdr.MARKER_ARRAY))


def test_marker_arrays_have_the_same_bound():
    assert len(cdr.decode_points(cdr.MARKER_ARRAY, markers(500, 10)).rows) == 5000
    with pytest.raises(cdr.TooMany, match="501 markers in .* bytes, 500 at most are used"):
        cdr.decode_points(cdr.MARKER_ARRAY, markers(501, 1))
    with pytest.raises(cdr.TooMany, match="5489 points, 5000 at most are used"):
        cdr.decode_points(cdr.MARKER_ARRAY, markers(499, 11))
    with pytest.raises(cdr.TooMany, match="5001 points, 5000 at most are used"):
        cdr.decode_points(cdr.MARKER_ARRAY, _joined(markers(1, 5000), markers(1, 0)))


def test_markers_with_long_meshes_and_textures_are_read():
    assert len(cdr.decode_points(cdr.MARKER_ARRAY, markers(2, 3, data=200_001)).rows) == 6


def test_the_nearest_places_are_those_of_the_distances():
    """Also far from the origin, where the squares of distances lose digits."""
    random = np.random.default_rng(5)
    for shift in (0.0, 1e6):
        line = shift + np.cumsum(random.normal(size=(201, 3)), axis=0)
        points = line[random.integers(201, size=300)] + random.normal(scale=0.1, size=(300, 3))
        distances = np.linalg.norm(points[:, None] - line, axis=-1)
        found = distances[np.arange(300), observer.nearest_of(line, points)]
        assert found == pytest.approx(distances.min(axis=1), abs=1e-9 + 1e-15 * shift)
