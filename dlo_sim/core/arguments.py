"""Checks of the public interface's arguments: numbers, arrays, names.

A refusal is one line that names the argument, what it needs and what was given. Strings, bytes,
None and booleans are not numbers here, although NumPy converts some of them to floats.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T")

_LARGEST_COUNT = 2**53  # whole numbers beyond it are not all floats


def given(value: object) -> str:
    """A value for an error message: short, on one line, whatever it is."""
    return " ".join(reprlib.repr(value).split())


def numbers(name: str, value: object, shape: tuple[int | None, ...], meaning: str = "") -> Array:
    """Finite numbers of a shape; None in it stands for any number of them.

    `meaning`: their unit, or what they are, for the refusal. Raises TypeError for other than
    numbers or rows of unequal length, ValueError for another shape or what is not finite.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of unequal length
        array = np.asarray(None)
    fits = array.shape == shape or (
        len(shape) == array.ndim
        and all(wanted in (None, size) for wanted, size in zip(shape, array.shape, strict=True))
    )
    is_number = array.dtype.kind in "iuf"
    if is_number and fits:
        if array.dtype == float:
            array = array.copy()
        else:
            with np.errstate(over="ignore"):  # a long double beyond all doubles is not finite
                array = array.astype(float)
        if np.isfinite(array).all():
            return array
    refusal = ValueError if is_number else TypeError
    wanted = f"{_wanted(shape)} ({meaning})" if meaning else _wanted(shape)
    raise refusal(f"{name}: needs {wanted}, got {given(value)}")


def _wanted(shape: tuple[int | None, ...]) -> str:
    if not shape:
        return "a finite number"
    if shape == (None,):
        return "a list of finite numbers"
    return f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"


def number(name: str, value: object, meaning: str = "") -> float:
    """One finite number; TypeError if it is none, ValueError if not finite, or more than one."""
    if type(value) is float and math.isfinite(value):  # asked for at every step
        return value
    return float(numbers(name, value, (), meaning))


def count(name: str, value: object) -> int:
    """A whole number from 0 to 2^53, also as a float; TypeError for no number, else ValueError."""
    if type(value) is not int or abs(value) > _LARGEST_COUNT:
        value = number(name, value, "a whole number of 0 or more")
    if not 0 <= value <= _LARGEST_COUNT or value != int(value):
        raise ValueError(f"{name}: needs a whole number of 0 to 2^53, got {given(value)}")
    return int(value)


def one_of(name: str, value: object, known: Iterable[str]) -> str:
    """One of the known names; TypeError if it is not a string, ValueError for another one."""
    if isinstance(value, str) and value in known:
        return value
    refusal = ValueError if isinstance(value, str) else TypeError
    there = ", ".join(known)
    cure = f"give one of {there}" if there else "there are none; the scene needs to name one"
    raise refusal(f"{name}: {given(value)} is not known; {cure}")


def instance(name: str, value: object, kind: type[T], source: str) -> T:
    """A value of a class, else TypeError; `source`: where to get one, for the refusal."""
    if not isinstance(value, kind):
        raise TypeError(f"{name}: needs a {kind.__name__} ({source}), got {given(value)}")
    return value
