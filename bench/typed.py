"""Check what was read from JSON: types against the annotations of a dataclass, and numbers."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

_LARGEST = 1e100  # of times, steps and counts; ratios of such numbers and their powers stay finite


def checked(record: Any) -> Any:
    """Return an instance of a dataclass.

    Raises
    ------
    TypeError
        If one of its fields does not have the type of its annotation.
    """
    for name, kind in _kinds(record.__class__).items():
        if not fits(getattr(record, name), kind):
            raise TypeError(f"{name} must be {kind}, not {type(getattr(record, name))}")
    return record


@functools.cache
def _kinds(record: type) -> dict[str, Any]:
    return get_type_hints(record)


def fits(value: Any, kind: Any) -> bool:
    """Whether a value, with all that it holds, has the type of an annotation such as ``dict[str, float | None]``."""
    outer, inner = get_origin(kind), get_args(kind)
    if outer in (Union, UnionType):
        return any(fits(value, one) for one in inner)
    if outer is dict:
        return isinstance(value, dict) and all(
            fits(key, inner[0]) and fits(entry, inner[1]) for key, entry in value.items()
        )
    if outer in (list, tuple):
        return isinstance(value, outer) and all(fits(entry, inner[0]) for entry in value)
    if kind is float:
        return isinstance(value, float) or (fits(value, int) and abs(value) <= sys.float_info.max)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return kind is Any or isinstance(value, kind)


def check_positive(numbers: Iterable[float]) -> None:
    """Raise a ValueError if a number is not positive, or so small or large that no computer measured it."""
    if not all(1 / _LARGEST < number < _LARGEST for number in numbers):
        raise ValueError("a number is zero, negative, too small or too large")


def check_known(names: Iterable[str], known: Iterable[str]) -> None:
    """Raise a LookupError if a name is not one of the known ones."""
    unknown = set(names) - set(known)
    if unknown:
        raise LookupError(f"{unknown.pop()!r} is not known")
