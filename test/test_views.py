"""The shipped views show topics that the node publishes, with the types and the QoS it has."""

import json

import pytest
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.topics import CONTROL_POINTS, DIAGNOSTICS, MARKERS, output_topics, resolved

TOPICS = output_topics(scene_from_values({"contact.markers": 1}))  # with obstacles
PUBLISHED = {resolved(topic): kind for topic, kind in TOPICS.items()}
SHAPES = {resolved(topic) for topic in TOPICS.keys() & {CONTROL_POINTS, *MARKERS}}
RVIZ = {
    "rviz_default_plugins/Marker": cdr.MARKER,
    "rviz_default_plugins/MarkerArray": cdr.MARKER_ARRAY,
    "rviz_default_plugins/PoseArray": cdr.POSE_ARRAY,
}
# What a subscriber may ask of a reliable, transient local publisher; ROS connects others to none.
OFFERED = {
    "Reliability Policy": {"Reliable", "Best Effort", "System Default"},
    "Durability Policy": {"Transient Local", "Volatile", "System Default"},
}


@pytest.fixture(scope="module")
def rviz(checkout) -> dict:
    return YAML(typ="safe").load(checkout / "config" / "cable.rviz")["Visualization Manager"]


@pytest.fixture(scope="module")
def foxglove(checkout) -> dict:
    return json.loads((checkout / "config" / "cable.foxglove.json").read_text(encoding="utf-8"))


def test_rviz_shows_every_shape_as_it_is_published(rviz):
    shown = {d["Topic"]["Value"]: d for d in rviz["Displays"] if "Topic" in d}
    assert set(shown) == SHAPES
    for topic, display in shown.items():
        assert RVIZ[display["Class"]] == PUBLISHED[topic]
        for policy, offered in OFFERED.items():
            assert display["Topic"][policy] in offered
        if PUBLISHED[topic] in (cdr.MARKER, cdr.MARKER_ARRAY):
            assert display["Namespaces"] == {topic.rpartition("/")[2]: True}


def test_views_are_in_the_frame_that_scenes_have(rviz, foxglove):
    frame = Scene().frame_id
    assert rviz["Global Options"]["Fixed Frame"] == frame
    assert foxglove["configById"]["3D!cable"]["followTf"] == frame


def panels(layout) -> list[str]:
    """The panels that a Foxglove layout shows."""
    if isinstance(layout, str):
        return [layout]
    return [*panels(layout["first"]), *panels(layout["second"])]


def test_foxglove_shows_its_panels_and_every_shape(foxglove):
    assert sorted(panels(foxglove["layout"])) == sorted(foxglove["configById"])
    assert set(foxglove["configById"]["3D!cable"]["topics"]) == SHAPES
    state = next(v for k, v in foxglove["configById"].items() if k.startswith("DiagnosticSummary"))
    assert state["topicToRender"] == DIAGNOSTICS


def test_foxglove_plots_fields_that_exist(foxglove):
    store = get_typestore(Stores.ROS2_JAZZY)
    plots = [v for k, v in foxglove["configById"].items() if k.startswith("Plot!")]
    paths = [path["value"] for plot in plots for path in plot["paths"]]
    assert len(paths) == 6
    for path in paths:
        topic, *fields = path.split(".")
        kind = PUBLISHED[topic]
        for name in fields:
            _, described = dict(store.get_msgdef(kind).fields)[name]  # kind of node, type
            kind = described if isinstance(described, str) else described[0]
        assert kind == "float64"
