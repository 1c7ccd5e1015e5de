"""Parameters as fields of dataclasses, from which checks, ROS declarations and tables are made.

    @dataclass(frozen=True)
    class Cable:
        '''Material and cross-section.

        Parameters:
            length: Rest length L.
        '''

        length: float = parameter(1.0, "m", (1.0e-4, 1.0e4))

A group of parameters is such a dataclass: the annotation gives the type, `parameter(...)` the
default, unit and bounds, the docstring the description. A key is a path of attributes (`from_` is
`from`). A field that holds a tuple of groups with names (`loads`) has the key `loads.names` and a
block for each name.
`check_value` checks one value; every refusal is one line that names the key, the value and the
cure.
"""

import inspect
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, Literal, TypeVar, get_args

from dlo_sim.scene.refusal import Rules, SceneError, brief, nearest, refusal, shown

Kind = Literal["double", "integer", "bool", "string", "double_array", "bool_array", "string_array"]
Scalar = float | int | bool | str
Value = Scalar | tuple[float, ...] | tuple[bool, ...] | tuple[str, ...]
Fields = TypeVar("Fields")
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Switches = tuple[bool, bool, bool]
Names = tuple[str, ...]
SWITCH = ("auto", "on", "off")
ORIGIN = (0.0, 0.0, 0.0)

_KINDS: dict[Any, Kind] = {float: "double", int: "integer", bool: "bool", str: "string"}
_ARRAYS: dict[Any, Kind] = {float: "double_array", bool: "bool_array"}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_LONGEST_TEXT = 255
IN_TEXT = "base64:"  # begins a text that is data, and may be longer


class Group:
    """A group of parameters whose values may be valid one by one but not together."""

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Names of parameters, each with the problem and its cure, the first refuses the scene.

        Args:
            key: of the group, `grasps.left`. scene: of which it is a part.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Parameter:
    """One parameter of a scene.

    Attributes:
        key: dotted name as in the scene file, such as `cable.length`.
        kind: ROS name of the type; integers are accepted for a double.
        default: value if the file has none; arrays are tuples.
        unit: SI unit, empty for a dimensionless value.
        low, high: bounds (of each element of an array), None = unbounded.
        choices: the values allowed, empty = any value in the range.
        length: number of elements of an array, None = any number.
        auto: number that the word `auto` stands for, outside the range; None = it is not a value.
        description: one sentence, without the unit. read_only: fixed when the node starts.
    """

    key: str
    kind: Kind
    default: Value
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[Scalar, ...] = ()
    length: int | None = None
    description: str = ""
    read_only: bool = False
    auto: float | None = None

    @property
    def is_array(self) -> bool:
        """Whether the value is a list."""
        return self.kind.endswith("_array")

    @property
    def element_kind(self) -> str:
        """Kind of the value itself, or of each element of a list."""
        return self.kind.removesuffix("_array")

    @property
    def allowed(self) -> str:
        """The allowed values as text: `0.0 to 1.0`, `auto, on, off`, or empty."""
        if self.choices:
            return ", ".join(shown(choice) for choice in self.choices)
        if self.low is not None and self.high is not None:
            word = "" if self.auto is None else f"auto ({self.auto:g}), or "
            return f"{word}{self.low:g} to {self.high:g}"
        if self.low is not None:
            return f"{self.low:g} or more"
        return "" if self.high is None else f"{self.high:g} or less"


def parameter(
    default: Any,
    unit: str = "",
    bounds: tuple[float, float] | None = None,
    *,
    choices: tuple[Scalar, ...] = (),
    read_only: bool = False,
    auto: float | None = None,
) -> Any:
    """A dataclass field that is a parameter; its kind follows from the annotation.

    `bounds`: of each element of an array; `auto`: number that the word `auto` stands for.
    """
    low, high = bounds or (None, None)
    limits = {"low": low, "high": high, "choices": choices, "auto": auto}
    return field(default=default, metadata={"unit": unit, "read_only": read_only, **limits})


def parameters_of(group: Any, prefix: str = "") -> Iterator[Parameter]:
    """The parameters of a group and its subgroups, each with its present value as default."""
    texts = descriptions(type(group))  # type: ignore[arg-type]
    for member in fields(group):
        key, value = f"{prefix}{_word(member)}", getattr(group, member.name)
        facts = {"description": texts.get(_word(member), ""), **member.metadata}
        if is_dataclass(value):
            yield from parameters_of(value, f"{key}.")
        elif _holds_groups(member) and member.metadata:
            names = tuple(item.name for item in value)
            yield Parameter(f"{key}.names", "string_array", names, **facts)
            for item in value:
                yield from parameters_of(item, f"{key}.{item.name}.")
        elif member.metadata:
            element, *more = get_args(member.type) or (None,)
            kind = _KINDS[member.type] if element is None else _ARRAYS[element]
            length = None if element is None or more == [...] else 1 + len(more)
            yield Parameter(key, kind, value, length=length, **facts)


def with_parameters(group: Fields, values: Mapping[str, Any], prefix: str = "") -> Fields:
    """A copy of the group with new values for some parameters, given by their keys."""
    changes: dict[str, Any] = {}
    for member in fields(group):  # type: ignore[arg-type]
        key, value = f"{prefix}{_word(member)}", getattr(group, member.name)
        if is_dataclass(value):
            changes[member.name] = with_parameters(value, values, f"{key}.")
        elif _holds_groups(member):
            changes[member.name] = tuple(
                with_parameters(item, values, f"{key}.{item.name}.") for item in value
            )
        elif key in values:
            changes[member.name] = values[key]
    return replace(group, **changes)  # type: ignore[type-var]


def _word(member: Field[Any]) -> str:
    """The name of a field in keys, where it may be a keyword of Python."""
    return member.name.rstrip("_")


@cache
def descriptions(group: type) -> dict[str, str]:
    """Parameter -> description, from the docstrings of a class and of those that it extends."""
    texts: dict[str, str] = {}
    for one in reversed(group.__mro__):
        _, _, listed = inspect.cleandoc(one.__doc__ or "").partition("Parameters:\n")
        for entry in re.split(r"\n(?=    \w)", listed):
            name, _, text = entry.partition(":")
            texts[name.strip()] = " ".join(text.split())
    return texts


def _holds_groups(member: Field[Any]) -> bool:
    element, *_ = get_args(member.type) or (None,)
    return is_dataclass(element)


def check_value(row: Parameter, value: object) -> Value:
    """The value converted to this parameter's type: float, int, bool, str or a tuple of them.

    Integers become floats for a double; NumPy and `array` values count as lists. Raises SceneError
    for a wrong type, number of elements or range, or what is not finite.
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
    if isinstance(value, bool) and "off" in row.choices:
        # YAML 1.1 readers, ROS among them, read an unquoted on/off as a boolean.
        value = "on" if value else "off"
    if not isinstance(value, str):
        raise refusal(key, value, f"is not a text; give {_wanted_element(row)} (in quotes)")
    if row.choices and value not in row.choices:
        hint = nearest(value, [str(choice) for choice in row.choices])
        raise refusal(key, value, f"is unknown; give {_wanted_element(row)}{hint}")
    too_long = len(value) > _LONGEST_TEXT and not value.startswith(IN_TEXT)
    if too_long or not value.isprintable():
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


def off_unit(vector: Vector) -> Vector | None:
    """The unit vector along one that is none (+y for zeros); None for a unit vector."""
    size = math.hypot(*vector)
    if abs(size - 1.0) <= 1e-6:
        return None
    x, y, z = (round(a / size, 9) for a in vector) if size > 0.0 else (0.0, 1.0, 0.0)
    return x, y, z


def check_names(key: str, names: Sequence[str], reserved: Sequence[str] = ()) -> None:
    """Raise SceneError for duplicates and names that cannot be part of a key."""
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
    if len(parts) >= 3 and f"{parts[0]}.names" in known:
        group, name, *_ = parts
        if not any(row.startswith(f"{group}.{name}.") for row in known):
            return SceneError(
                f"{key}: {brief(value)} belongs to a name that is not in {group}.names; "
                f"add '{name}' to {group}.names"
            )
    return SceneError(f"{key}: {brief(value)} is for no known key{nearest(key, known)}")


def markdown_row(row: Parameter) -> str:
    """A row of the parameter table as GitHub markdown."""
    kind = row.kind.replace("_array", "[]")
    if row.length is not None:
        kind = kind.replace("[]", f"[{row.length}]")
    meaning = row.description + (" *Read-only.*" if row.read_only else "")
    cells = (f"`{row.key}`", kind, f"`{shown(row.default)}`", row.unit, row.allowed, meaning)
    return "| " + " | ".join(cells) + " |"
