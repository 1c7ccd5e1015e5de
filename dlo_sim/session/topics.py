"""The topics that a scene subscribes to or publishes: names, types, resolved names."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import NODE_NAME
from dlo_sim.scene.nets import Strand
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session import cdr

CONTROL_POINTS = "~/control_points"
CENTERLINE = "~/centerline"
CONTROL_POLYGON = "~/control_polygon"
POINTS = "~/points"
CAPSULES = "~/capsules"
CONTACTS = "~/contacts"
PLAN = "~/plan"
MEASURED = "~/measured"
OBSTACLES = "~/obstacles"
FORECAST = "~/forecast"
GHOSTS = "~/forecast/ghosts"
CONNECTORS = "~/connectors"
TF = "/tf"
DIAGNOSTICS = "/diagnostics"
MARKERS = {
    CENTERLINE: cdr.MARKER,
    CONTROL_POLYGON: cdr.MARKER,
    CAPSULES: cdr.MARKER_ARRAY,
    CONTACTS: cdr.MARKER_ARRAY,
    CONNECTORS: cdr.MARKER_ARRAY,
    GHOSTS: cdr.MARKER,
}
REACTION = "~/{}/reaction"
POSE = "~/connectors/{}/pose"

_POSES = {"pose": cdr.POSE_STAMPED, "two_points": cdr.POSE_ARRAY}
_LOADS = {"wrench": cdr.WRENCH_STAMPED, "force": cdr.VECTOR3_STAMPED}
POINT_KINDS = {"point_cloud": cdr.POINT_CLOUD, "pose_array": cdr.POSE_ARRAY}
_INPUTS = {**_POSES, **_LOADS, **POINT_KINDS, "taken": cdr.BOOL, "plan": cdr.TRAJECTORY}
_INPUTS["markers"] = cdr.MARKER_ARRAY


def _transforms(scene: Scene) -> bool:
    """Whether anything is published on tf2."""
    return scene.outputs.tf or any(one.frame for one in scene.connectors)


def of_strand(topic: str, strand: Strand) -> str:
    """The topic of the main cable, or `~/branches/<name>/...` of a branch."""
    return topic.replace("~", f"~/{strand.key.replace('.', '/')}") if strand.key else topic


def places(scene: Scene) -> dict[str, str]:
    """End or grasp -> its name in topics and frames: `end`, `branches/a/end`."""
    found = {name: name for name in scene.holders}
    for strand in (one for one in scene.strands if one.key):
        own = strand.key.replace(".", "/")
        found |= {strand.holder(end): f"{own}/{end}" for end in ("start", "end")}
    return found


def reactions(scene: Scene) -> dict[str, str]:
    """End or grasp -> topic of its reaction."""
    return {name: REACTION.format(place) for name, place in places(scene).items()}


def output_topics(scene: Scene) -> dict[str, str]:
    """Topic -> ROS type of all outputs of a scene, in the order of publication."""
    topics = reactions(scene)
    free = {topics[name] for name, holder in scene.holders.items() if not holder.held}
    asked = dict.fromkeys(
        (of_strand(POINTS, strand) for strand in scene.strands), scene.outputs.points
    )
    asked |= {CAPSULES: scene.outputs.capsules > 0, TF: _transforms(scene)}
    asked[CONTACTS] = scene.touches or scene.touches_itself
    asked[CONNECTORS] = any(one.shape != "none" for one in scene.connectors)
    asked |= dict.fromkeys((FORECAST, GHOSTS), scene.forecast.processes > 0)
    free |= {topic for topic, wanted in asked.items() if not wanted}
    return {topic: kind for topic, kind in possible_outputs(scene).items() if topic not in free}


def possible_outputs(scene: Scene) -> dict[str, str]:
    """Topic -> ROS type of all outputs if the free ends were held and every output enabled."""
    strands = scene.strands
    return {
        **{of_strand(CONTROL_POINTS, strand): cdr.POSE_ARRAY for strand in strands},
        **dict.fromkeys(reactions(scene).values(), cdr.WRENCH_STAMPED),
        **{POSE.format(one.name): cdr.POSE_STAMPED for one in scene.connectors},
        **{of_strand(POINTS, strand): cdr.POINT_CLOUD for strand in strands},
        TF: cdr.TF_MESSAGE,
        FORECAST: cdr.POINT_CLOUD,
        **MARKERS,
        DIAGNOSTICS: cdr.DIAGNOSTIC_ARRAY,
    }


class InputTopic(NamedTuple):
    """An input topic of a scene.

    Attributes:
        topic: its name as in the scene (`~/...`), or resolved.
        kind: `pose`, `two_points`, `wrench`, `force`, `taken`, `plan`, `markers`, or `point_cloud`
            or `pose_array` of points on the cable.
        target: name of the end, grasp, obstacle or load; empty if it has none.
    """

    topic: str
    kind: str
    target: str

    @property
    def type(self) -> str:
        """ROS message type, for example geometry_msgs/msg/PoseStamped."""
        return _INPUTS[self.kind]

    @property
    def is_pose(self) -> bool:
        """Whether it drives an end effector."""
        return self.kind in _POSES


def input_topics(scene: Scene) -> tuple[InputTopic, ...]:
    """The input topics of a scene, poses first; several targets may share a topic."""
    topics = [
        InputTopic(e.pose_topic, e.pose_type, name)
        for name, e in scene.holders.items()
        if e.pose_topic
    ]
    bodies = [x for x in scene.obstacles if x.pose_topic and x.name in scene.moved]
    topics += [InputTopic(x.pose_topic, "pose", x.name) for x in bodies]
    topics += [InputTopic(x.input_topic, x.type, x.name) for x in scene.loads if x.input_topic]
    topics += [InputTopic(g.taken_topic, "taken", g.name) for g in scene.grasps if g.taken_topic]
    if scene.measured.type != "none":
        topics.append(InputTopic(MEASURED, scene.measured.type, ""))
    if scene.contact.markers:
        topics.append(InputTopic(OBSTACLES, "markers", ""))
    return tuple(topics)


def tf_inputs(scene: Scene) -> tuple[InputTopic, ...]:
    """The tf2 frames that drive end effectors and obstacles, each as an input topic."""
    return tuple(
        InputTopic(one.tf_frame, "pose", name) for name, one in scene.moved.items() if one.tf_frame
    )


def plan_topics(scene: Scene) -> tuple[InputTopic, ...]:
    """The topic of plans, if the scene enables forecasts."""
    return (InputTopic(PLAN, "plan", ""),) if scene.forecast.processes else ()


def resolved(topic: str) -> str:
    """The name of a topic in the node `/dlo_sim`."""
    if topic.startswith("~/"):
        return f"/{NODE_NAME}/{topic[2:]}"
    return topic if topic.startswith("/") else f"/{topic}"


class Naming(NamedTuple):
    """Full name of a node, and topics of its scene (`~/force`) -> resolved names; default: not
    remapped.
    """

    node: str = f"/{NODE_NAME}"
    topic: Callable[[str], str] = resolved

    def inputs(self, scene: Scene) -> tuple[InputTopic, ...]:
        """The input topics of a scene, by their resolved names.

        Raises SceneError if two topics of different types have one resolved name.
        """
        entries = input_topics(scene)
        seen: dict[str, tuple[str, str]] = {}
        listed = [(entry.topic, entry.type) for entry in entries]
        for topic, kind in (*listed, *possible_outputs(scene).items()):
            name = self.topic(topic)
            first_topic, other_kind = seen.setdefault(name, (topic, kind))
            if kind != other_kind:
                raise SceneError(
                    f"{name}: stands for {first_topic} ({other_kind}) and for {topic} ({kind}); "
                    "give one of them another name"
                )
        return tuple(entry._replace(topic=self.topic(entry.topic)) for entry in entries)


DEFAULT_NAMING = Naming()
