"""Whether values are possible: each by its row of the parameter table, then the scene as a whole.

Every refusal is one line that names the key, the value and the cure.
"""

import difflib
import math
import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence

from dlo_sim.scene.description import End, Load, Scene, Vector
from dlo_sim.scene.parameter import Parameter, Value, allowed, shown

_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_LOAD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_LONGEST_TEXT = 255
LEAST_STEP = 1e-9  # [s]; 0 is a step that is chosen
_LARGEST_STRETCH = 2.0  # held ends farther apart than this many lengths are surely a mistake

_brief = reprlib.Repr()
_brief.maxstring = _brief.maxother = _brief.maxlong = 60
_brief.maxlist = _brief.maxtuple = 8


class SceneError(ValueError):
    """A scene, or a value for one, that is refused: one line with key, value and cure."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def one_line(message: str) -> str:
    """A message that may quote a file: one line, without escape sequences or endless words."""
    words = [w if len(w) <= 1000 else f"{w[:50]}...{w[-50:]}" for w in message.split()]
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(words))


def brief(value: object) -> str:
    """A value for an error message: short, on one line, whatever it is."""
    return _brief.repr(value)


def _refuse(key: str, value: object, problem: str) -> SceneError:
    shortened = shown(value) if isinstance(value, bool | float | tuple) else brief(value)
    return SceneError(f"{key}: {shortened} {problem}")


def nearest(key: str, known: Iterable[str]) -> str:
    """`; did you mean ...?` with the closest known key, or empty when none is close."""
    found = difflib.get_close_matches(key, list(known), n=1, cutoff=0.6)
    return f"; did you mean {found[0]}?" if found else ""


# ---------------------------------------------------------------------------------------- values


def check_value(row: Parameter, value: object) -> Value:
    """The value as this parameter's type: float, int, bool, str or a tuple of them.

    Integers become floats where a double is meant; NumPy and `array` values are taken as lists.

    Raises:
        SceneError: wrong type, not finite, out of range, wrong number of elements.
    """
    plain = value.tolist() if hasattr(value, "tolist") else value
    if plain is None:
        raise SceneError(f"{row.key}: no value given; give {_wanted(row)} or leave the key out")
    if not row.is_array:
        return _check_element(row, plain, row.key)
    if isinstance(plain, str) or not isinstance(plain, Sequence):
        raise _refuse(row.key, plain, f"is not a list; give {_wanted(row)}")
    if row.length is not None and len(plain) != row.length:
        raise _refuse(
            row.key,
            plain,
            f"has {len(plain)} elements; give {row.length}, like {shown(row.default)}",
        )
    elements = tuple(_check_element(row, item, f"{row.key}[{i}]") for i, item in enumerate(plain))
    return elements  # type: ignore[return-value]


def _wanted(row: Parameter) -> str:
    """What to give for a parameter, for people."""
    if not row.is_array:
        return _wanted_element(row)
    count = "" if row.length is None else f"{row.length} "
    return f"a list of {count}values ({_wanted_element(row)} each), like {shown(row.default)}"


def _wanted_element(row: Parameter) -> str:
    if row.choices:
        return f"one of {allowed(row)}"
    kinds = {"double": "a number", "integer": "a whole number", "bool": "true or false"}
    one = kinds.get(row.element_kind, "a text")
    return f"{one} in {row.unit}" if row.unit else one


def _check_element(row: Parameter, value: object, key: str) -> float | int | bool | str:
    if row.element_kind == "bool":
        if not isinstance(value, bool):
            raise _refuse(key, value, "is not a boolean; give true or false")
        return value
    if row.element_kind == "string":
        return _check_text(row, value, key)
    return _check_number(row, value, key)


def _check_text(row: Parameter, value: object, key: str) -> str:
    if isinstance(value, bool) and {"on", "off"} <= set(row.choices):
        # YAML 1.1 readers, ROS among them, read an unquoted on/off as a boolean.
        value = "on" if value else "off"
    if not isinstance(value, str):
        raise _refuse(key, value, f"is not a text; give {_wanted_element(row)} (in quotes)")
    if row.choices and value not in row.choices:
        hint = nearest(value, [str(choice) for choice in row.choices])
        raise _refuse(key, value, f"is unknown; give {_wanted_element(row)}{hint}")
    if len(value) > _LONGEST_TEXT or not value.isprintable():
        raise _refuse(key, value, f"is not a name; give up to {_LONGEST_TEXT} printable letters")
    return value


def _check_number(row: Parameter, value: object, key: str) -> float | int:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _refuse(key, value, f"is not a number; give {_wanted_element(row)}")
    if row.element_kind == "integer" and not isinstance(value, int):
        raise _refuse(key, value, "is not a whole number; write it without a decimal point")
    if isinstance(value, float) and not math.isfinite(value):
        raise _refuse(key, value, f"is not finite; give {_wanted_element(row)}")
    low = -math.inf if row.low is None else row.low
    high = math.inf if row.high is None else row.high
    if not low <= value <= high:
        unit = f" {row.unit}" if row.unit else ""
        raise _refuse(key, value, f"is out of range; give {allowed(row)}{unit}")
    if row.choices and value not in row.choices:
        raise _refuse(key, value, f"is not possible; give {_wanted_element(row)}")
    return value if row.element_kind == "integer" else float(value)


def check_load_names(names: Sequence[str]) -> None:
    """Refuse load names that cannot be part of a key, and duplicates.

    Raises:
        SceneError: naming the first bad one.
    """
    for name in names:
        if not _LOAD_NAME.fullmatch(name) or name == "names":
            raise _refuse(
                "loads.names", name, "is not a name; use letters, digits and _ (but not 'names')"
            )
        if list(names).count(name) > 1:
            raise _refuse("loads.names", name, "is there twice; name each load once")


# ----------------------------------------------------------------------------------- whole scene


def check_scene(scene: Scene) -> None:
    """Refuse a scene whose values are possible one by one but not together.

    Raises:
        SceneError: naming the key, the value and the cure of the first conflict.
    """
    _check_cable(scene)
    _check_discretization(scene)
    for name, end in scene.ends.items():
        _check_end(scene, name, end)
    _check_placement(scene)
    _check_frames(scene)
    for load in scene.loads:
        _check_load(load)
    _check_topics(scene)
    if 0.0 < scene.integrator.step < LEAST_STEP:
        raise _refuse(
            "integrator.step",
            scene.integrator.step,
            f"s is below {LEAST_STEP:g} s, the resolution of stamps; give 0 to have it chosen",
        )
    if scene.inputs.catch_up < 1.0 / scene.rate:
        raise _refuse(
            "inputs.catch_up",
            scene.inputs.catch_up,
            f"s is shorter than one timer period ({1.0 / scene.rate:g} s at rate {scene.rate:g} "
            f"Hz); give at least {1.0 / scene.rate:g}",
        )


def _norm(vector: Vector) -> float:
    return math.hypot(*vector)


def _check_cable(scene: Scene) -> None:
    axis = scene.cable.rest_curvature_axis
    if not scene.cable.rest_curvature:
        raise _refuse("cable.rest_curvature", (), "is empty; give [0.0] for a straight cable")
    if abs(_norm(axis) - 1.0) > 1e-6:
        size = _norm(axis)
        unit = shown(tuple(round(a / size, 9) for a in axis)) if size > 0.0 else "[0.0, 1.0, 0.0]"
        raise _refuse("cable.rest_curvature_axis", axis, f"is not a unit vector; give {unit}")


def _check_span_stretch(scene: Scene) -> None:
    if scene.discretization.quadrature != "gauss":
        raise _refuse(
            "discretization.stretch",
            "span",
            "needs Gauss points; set discretization.quadrature to gauss, or stretch to sample",
        )
    if scene.discretization.control_points < 5:
        raise _refuse(
            "discretization.stretch",
            "span",
            "leaves a single span ways to stretch that cost no energy; give 5 control points or "
            "more, or set it to sample",
        )


def _check_discretization(scene: Scene) -> None:
    samples = scene.discretization.samples
    if scene.discretization.quadrature == "gauss" and not 2 <= samples <= 10:
        raise _refuse(
            "discretization.samples",
            samples,
            "points per knot span will not do for gauss; give 2 to 10 (a single one leaves ways to "
            "bend that cost no energy), or set discretization.quadrature to uniform",
        )
    if scene.discretization.stretch == "span":
        _check_span_stretch(scene)
    least = 2 * (scene.discretization.control_points - 3)
    if scene.discretization.quadrature == "uniform" and samples < max(least, 4):
        raise _refuse(
            "discretization.samples",
            samples,
            f"samples are too few for uniform quadrature; give {max(least, 4)} or more in all, two "
            "a knot span",
        )


def _check_end(scene: Scene, name: str, end: End) -> None:
    for axis in range(3):
        if end.fixed[axis] and end.spring[axis] > 0.0:
            raise _refuse(
                f"{name}.spring[{axis}]",
                end.spring[axis],
                f"N/m would do nothing, since {name}.fixed[{axis}] is true; set one of them to "
                "zero or false",
            )
    if end.clamped and not all(end.fixed):
        raise _refuse(
            f"{name}.clamped",
            True,
            f"needs {name}.fixed: [true, true, true] (it is {shown(end.fixed)})",
        )
    if end.driven and not end.held:
        raise _refuse(
            f"{name}.pose_topic",
            end.pose_topic,
            f"would move nothing, since this end is free; set {name}.fixed: [true, true, true] or "
            f"remove {name}.pose_topic",
        )


def _check_placement(scene: Scene) -> None:
    """Directions that the initial shape and the clamps need, and ends too far apart."""
    gap = math.dist(scene.start.position, scene.end.position)
    cure = "move it or start.position apart"
    if gap == 0.0:
        for name, end in scene.ends.items():
            if end.clamped and _norm(end.tangent) == 0.0:
                raise _refuse(
                    f"{name}.tangent",
                    end.tangent,
                    "gives no direction, since both ends are at the same place; give a direction",
                )
        both_held = all(all(end.fixed) for end in scene.ends.values())
        if scene.initial.shape == "straight" or not both_held:
            raise _refuse(
                "end.position",
                scene.end.position,
                f"equals start.position, so a straight cable has no direction; {cure}",
            )
    resting = not (scene.start.driven or scene.end.driven)
    held = all(scene.start.fixed) and all(scene.end.fixed)
    if resting and held and gap > _LARGEST_STRETCH * scene.cable.length:
        raise _refuse(
            "end.position",
            scene.end.position,
            f"is {gap:g} m from start.position, but the cable is only {scene.cable.length:g} m "
            "long; move the ends together or lengthen cable.length",
        )


def _check_frames(scene: Scene) -> None:
    """A frame name must say one thing: the world, the start or the end."""
    for name, end in scene.ends.items():
        if end.frame and end.frame == scene.frame_id:
            raise _refuse(
                f"{name}.frame", end.frame, "is also frame_id; give the end-effector's own frame"
            )
    if scene.start.frame and scene.start.frame == scene.end.frame:
        raise _refuse(
            "end.frame", scene.end.frame, "is also start.frame; give each end its own frame"
        )


def _check_load(load: Load) -> None:
    key = f"loads.{load.name}"
    if load.signal != "none" and load.topic:
        raise _refuse(
            f"{key}.topic",
            load.topic,
            f"cannot be used with {key}.signal {load.signal}; remove one of them",
        )
    if load.signal == "none":
        for part, vector in (("force", load.force), ("torque", load.torque)):
            if any(vector):
                raise _refuse(
                    f"{key}.{part}",
                    vector,
                    f"would be ignored; set {key}.signal to constant or sine, or remove it",
                )
    if load.type == "force" and any(load.torque):
        raise _refuse(f"{key}.torque", load.torque, f"would be ignored; set {key}.type to wrench")


def _check_topics(scene: Scene) -> None:
    """Topic names must be well formed, and one topic must have one meaning."""
    inputs = [(f"{n}.pose_topic", e.pose_topic, "pose") for n, e in scene.ends.items()]
    inputs += [(f"loads.{load.name}.topic", load.input_topic, load.type) for load in scene.loads]
    seen: dict[str, tuple[str, str]] = {}
    for key, topic, kind in inputs:
        if not topic:
            continue
        if not _TOPIC.fullmatch(topic):
            raise _refuse(key, topic, "is not a topic name; give one like ~/wrench or /robot/pose")
        other, other_kind = seen.setdefault(topic, (key, kind))
        if other_kind != kind:
            raise _refuse(
                key, topic, f"is read as {kind} here and as {other_kind} by {other}; use two topics"
            )


def unknown_key(key: str, value: object, known: Mapping[str, Parameter]) -> SceneError:
    """The refusal of a key that is in no table: a group, an unnamed load, a misspelling."""
    members = [name for name in known if name.startswith(f"{key}.")]
    if members:
        return _refuse(key, value, f"stands for a group of keys; give {members[0]} and so on")
    parts = key.split(".")
    if len(parts) == 3 and parts[0] == "loads":
        names = [str(name.split(".")[1]) for name in known if name.count(".") == 2]
        if parts[1] not in names:
            return SceneError(
                f"{key}: {brief(value)} belongs to a load that is not in loads.names; "
                f"add '{parts[1]}' to loads.names"
            )
    return SceneError(f"{key}: {brief(value)} is for no known key{nearest(key, known)}")
