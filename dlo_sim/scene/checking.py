"""Validation of single values against their parameters, and of names of loads and grasps.

Every refusal is one line that names the key, the value and the cure.
"""

import math
import re
from collections.abc import Mapping, Sequence

from dlo_sim.scene.parameter import Parameter, Value
from dlo_sim.scene.refusal import SceneError, brief, nearest, refusal, shown

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_LONGEST_TEXT = 255


def check_value(row: Parameter, value: object) -> Value:
    """The value converted to this parameter's type: float, int, bool, str or a tuple of them.

    Integers become floats for a double; NumPy and `array` values count as lists.

    Raises:
        SceneError: wrong type, not finite, out of range, wrong number of elements.
    """
    plain = value.tolist() if hasattr(value, "tolist") else value
    if plain is None:
        raise SceneError(f"{row.key}: no value given; give {_wanted(row)} or leave the key out")
    if not row.is_array:
        return _check_element(row, plain, row.key)
    if isinstance(plain, str) or not isinstance(plain, Sequence):
        raise refusal(row.key, plain, f"is not a list; give {_wanted(row)}")
    if row.length is not None and len(plain) != row.length:
        raise refusal(
            row.key,
            plain,
            f"has {len(plain)} elements; give {row.length}, like {shown(row.default)}",
        )
    elements = tuple(_check_element(row, item, f"{row.key}[{i}]") for i, item in enumerate(plain))
    return elements  # type: ignore[return-value]


def _wanted(row: Parameter) -> str:
    """The expected value of a parameter, as text."""
    if not row.is_array:
        return _wanted_element(row)
    count = "" if row.length is None else f"{row.length} "
    return f"a list of {count}values ({_wanted_element(row)} each), like {shown(row.default)}"


def _wanted_element(row: Parameter) -> str:
    if row.choices:
        return f"one of {row.allowed}"
    kinds = {"double": "a number", "integer": "a whole number", "bool": "true or false"}
    one = kinds.get(row.element_kind, "a text")
    return f"{one} in {row.unit}" if row.unit else one


def _check_element(row: Parameter, value: object, key: str) -> float | int | bool | str:
    if row.element_kind == "bool":
        if not isinstance(value, bool):
            raise refusal(key, value, "is not a boolean; give true or false")
        return value
    if row.element_kind == "string":
        return _check_text(row, value, key)
    return _check_number(row, value, key)


def _check_text(row: Parameter, value: object, key: str) -> str:
    if isinstance(value, bool) and {"on", "off"} <= set(row.choices):
        # YAML 1.1 readers, ROS among them, read an unquoted on/off as a boolean.
        value = "on" if value else "off"
    if not isinstance(value, str):
        raise refusal(key, value, f"is not a text; give {_wanted_element(row)} (in quotes)")
    if row.choices and value not in row.choices:
        hint = nearest(value, [str(choice) for choice in row.choices])
        raise refusal(key, value, f"is unknown; give {_wanted_element(row)}{hint}")
    if len(value) > _LONGEST_TEXT or not value.isprintable():
        raise refusal(key, value, f"is not a name; give up to {_LONGEST_TEXT} printable letters")
    return value


def _check_number(row: Parameter, value: object, key: str) -> float | int:
    if value == "auto" and row.auto is not None:
        return row.auto
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise refusal(key, value, f"is not a number; give {_wanted_element(row)}")
    if row.element_kind == "integer" and not isinstance(value, int):
        raise refusal(key, value, "is not a whole number; write it without a decimal point")
    if isinstance(value, float) and not math.isfinite(value):
        raise refusal(key, value, f"is not finite; give {_wanted_element(row)}")
    low = -math.inf if row.low is None else row.low
    high = math.inf if row.high is None else row.high
    if not low <= value <= high and value != row.auto:
        unit = f" {row.unit}" if row.unit else ""
        raise refusal(key, value, f"is out of range; give {row.allowed}{unit}")
    if row.choices and value not in row.choices:
        raise refusal(key, value, f"is not possible; give {_wanted_element(row)}")
    return value if row.element_kind == "integer" else float(value)


def check_names(key: str, names: Sequence[str], reserved: Sequence[str] = ()) -> None:
    """Refuse duplicates and names that cannot be part of a key.

    Raises:
        SceneError: naming the first invalid one.
    """
    for name in names:
        taken = ("names", *reserved)
        if not _NAME.fullmatch(name) or name in taken:
            raise refusal(
                key,
                name,
                f"is not a name; use letters, digits and _ (but not {', '.join(map(repr, taken))})",
            )
        if list(names).count(name) > 1:
            raise refusal(key, name, "is there twice; give each its own name")


def unknown_key(key: str, value: object, known: Mapping[str, Parameter]) -> SceneError:
    """The refusal of a key that is not a parameter: a group, an unnamed load, a misspelling."""
    members = [name for name in known if name.startswith(f"{key}.")]
    if members:
        return refusal(key, value, f"stands for a group of keys; give {members[0]} and so on")
    parts = key.split(".")
    if len(parts) == 3 and f"{parts[0]}.names" in known:
        group, name, _ = parts
        if not any(row.startswith(f"{group}.{name}.") for row in known):
            return SceneError(
                f"{key}: {brief(value)} belongs to a name that is not in {group}.names; "
                f"add '{name}' to {group}.names"
            )
    return SceneError(f"{key}: {brief(value)} is for no known key{nearest(key, known)}")
