"""Parameters as fields of dataclasses: each field carries its description, unit and bounds.

    length: float = parameter(1.0, "Rest length L.", "m", (1.0e-4, 1.0e4))

A group of parameters is a dataclass of such fields; a key is a path of attributes. A field that
holds a tuple of groups with names (`loads`) has the key `loads.names` and a block for each name.
"""

from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, TypeVar, get_args

from dlo_sim.scene.refusal import shown

Kind = Literal["double", "integer", "bool", "string", "double_array", "bool_array", "string_array"]
Scalar = float | int | bool | str
Value = Scalar | tuple[float, ...] | tuple[bool, ...] | tuple[str, ...]
Group = TypeVar("Group")

_KINDS: dict[Any, Kind] = {float: "double", int: "integer", bool: "bool", str: "string"}
_ARRAYS: dict[Any, Kind] = {float: "double_array", bool: "bool_array"}


@dataclass(frozen=True)
class Parameter:
    """One parameter of a scene.

    Attributes:
        key: dotted name as in the scene file, for example `cable.length`.
        kind: ROS name of the type; integers are accepted for a double.
        default: value if the file has none; arrays are tuples.
        unit: SI unit, empty for a dimensionless value.
        low: smallest value allowed (each element of an array), None = unbounded.
        high: largest value allowed, None = unbounded.
        choices: the values allowed, empty = any value in the range.
        length: number of elements of an array, None = any number.
        auto: number that the word `auto` stands for, outside the range; None = it is not a value.
        description: one sentence, without the unit.
        read_only: fixed when the node starts.
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
    description: str,
    unit: str = "",
    bounds: tuple[float, float] | None = None,
    *,
    choices: tuple[Scalar, ...] = (),
    read_only: bool = False,
    auto: float | None = None,
) -> Any:
    """A dataclass field that is a parameter; its kind follows from the annotation.

    Args:
        bounds: smallest and largest value, for each element of an array.
        auto: number that the word `auto` stands for.
    """
    low, high = bounds or (None, None)
    words = {"description": description, "unit": unit, "read_only": read_only, "auto": auto}
    limits = {"low": low, "high": high, "choices": choices}
    return field(default=default, metadata={**words, **limits})


def parameters_of(group: Any, prefix: str = "") -> Iterator[Parameter]:
    """The parameters of a group and its subgroups, each with its present value as default."""
    for member in fields(group):
        key, value = f"{prefix}{member.name}", getattr(group, member.name)
        if is_dataclass(value):
            yield from parameters_of(value, f"{key}.")
        elif _holds_groups(member):
            names = tuple(item.name for item in value)
            yield Parameter(f"{key}.names", "string_array", names, **member.metadata)
            for item in value:
                yield from parameters_of(item, f"{key}.{item.name}.")
        elif member.metadata:
            element, *more = get_args(member.type) or (None,)
            kind = _KINDS[member.type] if element is None else _ARRAYS[element]
            length = None if element is None or more == [...] else 1 + len(more)
            yield Parameter(key, kind, value, length=length, **member.metadata)


def with_parameters(group: Group, values: Mapping[str, Any], prefix: str = "") -> Group:
    """A copy of the group with new values for some parameters, given by their keys."""
    changes: dict[str, Any] = {}
    for member in fields(group):  # type: ignore[arg-type]
        key, value = f"{prefix}{member.name}", getattr(group, member.name)
        if is_dataclass(value):
            changes[member.name] = with_parameters(value, values, f"{key}.")
        elif _holds_groups(member):
            changes[member.name] = tuple(
                with_parameters(item, values, f"{key}.{item.name}.") for item in value
            )
        elif key in values:
            changes[member.name] = values[key]
    return replace(group, **changes)  # type: ignore[type-var]


def _holds_groups(member: Field[Any]) -> bool:
    element, *_ = get_args(member.type) or (None,)
    return is_dataclass(element)
