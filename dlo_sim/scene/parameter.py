"""What one parameter is: key, type, default, unit, range, and how people read its values."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["double", "integer", "bool", "string", "double_array", "bool_array", "string_array"]
Scalar = float | int | bool | str
Value = Scalar | tuple[float, ...] | tuple[bool, ...] | tuple[str, ...]


SWITCH = ("auto", "on", "off")


@dataclass(frozen=True)
class Parameter:
    """One parameter of a scene.

    Attributes:
        key: dotted name as in the scene file, for example `cable.length`.
        kind: type as ROS names it; integers are accepted wherever a double is meant.
        default: value when the file does not say; arrays are tuples.
        unit: SI unit for people, empty when there is none.
        low: smallest value allowed (each element of an array), None = unbounded.
        high: largest value allowed, None = unbounded.
        choices: the values allowed, empty = any value in the range.
        length: number of elements of an array, None = any number.
        description: one sentence for people, without the unit.
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

    @property
    def is_array(self) -> bool:
        """Whether the value is a list."""
        return self.kind.endswith("_array")

    @property
    def element_kind(self) -> str:
        """Kind of the value itself, or of each element of a list."""
        return self.kind.removesuffix("_array")


def number(
    key: str,
    default: float,
    unit: str,
    low: float,
    high: float,
    description: str,
    choices: tuple[float, ...] = (),
) -> Parameter:
    """A double within bounds."""
    return Parameter(key, "double", default, unit, low, high, choices, None, description)


def vector(
    key: str,
    default: tuple[float, float, float],
    unit: str,
    bound: float,
    description: str,
    low: float | None = None,
) -> Parameter:
    """Three doubles."""
    lowest = -bound if low is None else low
    return Parameter(key, "double_array", default, unit, lowest, bound, (), 3, description)


def choice(
    key: str, default: str, choices: tuple[str, ...], description: str, read_only: bool = False
) -> Parameter:
    """A string out of a few."""
    return Parameter(key, "string", default, "", None, None, choices, None, description, read_only)


def text(key: str, default: str, description: str, read_only: bool = False) -> Parameter:
    """Any string."""
    return Parameter(key, "string", default, "", None, None, (), None, description, read_only)


def shown(value: object) -> str:
    """A value as a scene file would hold it: `true`, `[0.0, 1.0]`, `auto`, `''`."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(shown(item) for item in value) + "]"
    if isinstance(value, str):
        return value or "''"
    return repr(value)


def allowed(row: Parameter) -> str:
    """The values that a parameter may take, for people: `0.0 to 1.0`, `auto, on, off`, or empty."""
    if row.choices:
        return ", ".join(shown(choice) for choice in row.choices)
    if row.low is not None and row.high is not None:
        return f"{row.low:g} to {row.high:g}"
    if row.low is not None:
        return f"{row.low:g} or more"
    return "" if row.high is None else f"{row.high:g} or less"
