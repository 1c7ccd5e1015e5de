"""Two measured points as the pose of a gripper."""

import math
import re

import numpy as np
import pytest
from session_bench import GRIPPER, MS, SECOND, T0, Bench

from dlo_sim.core import rotations
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.scene.refusal import SceneError

MARKERS = {**GRIPPER, "start.pose_type": "two_points", "start.pose_spacing": 0.05}
APART = 0.05


def two_points(now):
    """A gripper that moves along y and turns about z and y."""
    angle = 0.8 * (now - T0) / SECOND
    axis = np.array([math.cos(angle), math.sin(angle), -0.5 * math.sin(angle)])
    axis *= APART / np.linalg.norm(axis)
    middle = np.array([0.1, 0.05 * (now - T0) / SECOND, 0.2])
    return middle - 0.5 * axis, middle + 0.5 * axis


def feed(bench, bad=None):
    """Points at 100 Hz for a second; `bad` in the middle."""
    for now in range(T0, T0 + SECOND, 5 * MS):
        if now % (10 * MS) == 0:
            bench.points(now, *two_points(now))
        if bad is not None and now == T0 + 505 * MS:
            bench.points(now, *bad)
        bench.session.tick(now)
    return bench


def test_the_gripper_is_midway_and_points_along_them():
    bench = feed(Bench(MARKERS))
    stamp = bench.session.stamp_ns
    assert stamp > T0 + 900 * MS
    first, second = two_points(stamp)
    position, orientation = bench.simulator.end_pose("start")
    assert position == pytest.approx(0.5 * (first + second), abs=1e-5)
    x_axis = rotations.rotate(orientation, np.array([1.0, 0.0, 0.0]))
    assert x_axis == pytest.approx((second - first) / APART, abs=1e-4)
    assert bench.refused("/gripper_pose") == {}


HERE = two_points(T0 + 505 * MS)
BAD = {
    "one": (HERE[:1], "bad_points", "1 points; publish two"),
    "three": ((*HERE, (0, 0, 0)), "bad_points", "3 points"),
    "none": ((), "bad_points", "0 points"),
    "coinciding": ((HERE[0], HERE[0]), "bad_points", "0 m apart: they give no direction"),
    "nan": (((math.nan, 0, 0), HERE[1]), "not_finite", "nan"),
    "far away": (((0, 0, 2e8), HERE[1]), "too_large", "position"),
    "spacing": ((HERE[0], 1.2 * HERE[1] - 0.2 * HERE[0]), "bad_points", "pose_spacing is 0.05 m"),
    "exchanged": (HERE[::-1], "bad_points", "turned by 18. degrees .* first nearer to the start"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_points_are_refused_and_leave_no_trace(name):
    points, reason, text = BAD[name]
    broken, clean = feed(Bench(MARKERS), points), feed(Bench(MARKERS))
    assert broken.refused("/gripper_pose") == {reason: 1}
    refusal = broken.session.journal.topics["/gripper_pose"].last_refusal
    assert np.array_equal(broken.simulator.control_points, clean.simulator.control_points)
    for one, other in zip(
        broken.simulator.end_pose("start"), clean.simulator.end_pose("start"), strict=True
    ):
        assert np.array_equal(one, other)
    assert re.search(text, refusal) and "\n" not in refusal


@pytest.mark.parametrize(
    "values, text",
    [
        ({"start.tangent": [1, 0, 0]}, r"^start.tangent: \[1.0, 0.0, 0.0\] would be ignored"),
        ({"start.pose_type": "pose"}, "^start.pose_spacing: 0.05 m would be ignored"),
        ({"start.pose_type": "points"}, "^start.pose_type: "),
    ],
)
def test_a_scene_refuses_what_would_be_ignored(values, text):
    with pytest.raises(SceneError, match=text):
        scene_from_values({**MARKERS, **values})
