"""Checks of the fields of a stored solution: in an untrusted file, a wrong type would fail much later."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..functions.extremes import Extremes
from ..methods import Method
from .columns import ANY, COLUMNS, DEGREES, Column
from .error_estimate import ErrorEstimate
from .labels import Labels
from .occurrences import Occurrences
from .status import Status

Test = Callable[[Any], bool]
_MOST = 2**63 - 1  # the largest count
#: The entries of the state of each run.
_GOES_ON = {"t0", "t_end", "start", "params", "layout", "inline", "has_jacobian", "times", "stepper"}
_GOES_ON_FIXED = _GOES_ON | {"h", "n_steps", "save_every", "growth"}
_GOES_ON_VARIABLE = _GOES_ON | {"tolerances", "every", "rows", "events"}
_DTYPES: dict[type, Any] = {float: np.float64, int: np.int64}  # of arrays; arrays of other kinds are arrays of objects


def check_run(fields: Mapping[str, Any]) -> None:
    """Raise a ValueError if a field of a solution does not have its type and shape."""
    (states, degrees), z = _shapes(fields["u"], 1), _shapes_of_z(fields["z"], 1)
    tests: dict[str, Test] = {
        "events": partial(_are_named, lambda x: isinstance(x, Occurrences) and _are_occurrences(x, degrees, z)),
        "_a": lambda x: x is None or (_is_array(x) and x.shape == states + degrees),
        "_a_jumps": lambda x: x is None or (_is_array(x) and x.ndim == 1 + len(degrees) and x.shape[1:] == degrees),
        "error": lambda x: x is None or (isinstance(x, ErrorEstimate) and _is_estimate(x, fields, states)),
        "_explanation": lambda x: isinstance(x, str),
        "_resume": lambda x: x is None or _is_state(x, fields["steps"] is not None),
    }
    _check(fields, states, degrees, tests)
    if fields["_a"] is not None:
        jumps = sum(len(occurrences.jumps) for occurrences in fields["events"].values())
        if fields["_a_jumps"] is None or len(fields["_a_jumps"]) != 2 * jumps:
            raise ValueError("_a_jumps are not the accelerations before and after the jumps.")


def check_ensemble(fields: Mapping[str, Any], occurrences: Any) -> None:
    """Raise a ValueError if a field of an ensemble is wrong; `occurrences` is the class of event occurrences."""
    (states, degrees), z = _shapes(fields["u"], 2), _shapes_of_z(fields["z"], 2)
    m = states[0]

    def are_of_members(x: Any) -> bool:
        if not isinstance(x, occurrences) or not _are_occurrences(x, degrees, z):
            return False
        has_first = _is_array(x.first) and x.first.shape == (m,)
        has_members = isinstance(x.member, np.ndarray) and x.member.dtype == np.int64 and x.member.shape == x.t.shape
        return has_first and has_members

    tests: dict[str, Test] = {
        "events": partial(_are_named, are_of_members),
        "params": lambda x: _is_array(x) and (x.ndim == 1 or (x.ndim == 2 and len(x) == m)),
        "first": _is_count,
        "_last": lambda x: isinstance(x, dict) and all(_is_count(i) and i < m and isinstance(x[i], dict) for i in x),
    }
    _check(fields, states, degrees, tests)


def _shapes(u: Any, axes: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the shape of u on its first axes, and on the axis of the degrees of freedom."""
    if not (_is_array(u) and u.ndim in (axes, axes + 1)):
        raise ValueError("u does not have the shape of a history.")
    return u.shape[:axes], u.shape[axes:]


def _shapes_of_z(z: Any, axes: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each first-order unknown in a state; the fields are checked later."""
    return {name: np.shape(x)[axes:] for name, x in z.items()} if isinstance(z, dict) else {}


def _check(
    fields: Mapping[str, Any], states: tuple[int, ...], degrees: tuple[int, ...], tests: Mapping[str, Test]
) -> None:
    """Check the columns, the other fields of every solution, and the fields with special tests."""
    tests = {
        **{column.name: partial(_is_column, column, states, degrees) for column in COLUMNS},
        "method": lambda x: isinstance(x, Method) and x.jacobian is None,
        "labels": lambda x: x is None or _are_labels(x),
        "notes": _are_texts,
        "kernel_seconds": _is_number,
        **tests,
    }
    if fields.keys() != tests.keys():
        raise ValueError("these are not the fields of a solution.")
    for name, is_sound in tests.items():
        if not is_sound(fields[name]):
            raise ValueError(f"{name} is of a wrong type or shape.")


def _is_column(column: Column, states: tuple[int, ...], degrees: tuple[int, ...], x: Any) -> bool:
    first = states if column.of_states else states[:-1]  # in an ensemble, the first axis has the members
    shape = degrees if column.shape is DEGREES else ()

    def is_value(x: Any, kind: type = column.kind) -> bool:
        if kind is Extremes:
            return isinstance(x, Extremes) and all(is_value(part, float) for part in x)
        if not isinstance(x, np.ndarray):
            return not first and _IS_ONE[kind](x)
        has_kind = x.dtype == _DTYPES.get(kind, object) and (kind in _DTYPES or all(map(_IS_ONE[kind], x.flat)))
        rest = x.shape[len(first) :]
        has_shape = len(rest) < 2 if column.shape is ANY else rest == shape
        return has_kind and x.ndim > 0 and x.shape[: len(first)] == first and has_shape

    if column.by_name:
        return _are_named(is_value, x)
    return is_value(x) or (column.name == "steps" and x is None)


def _are_occurrences(x: Any, degrees: tuple[int, ...], z: Mapping[str, tuple[int, ...]]) -> bool:
    """Whether the times and states of events match."""
    if not (_is_array(x.t) and x.t.ndim == 1):
        return False
    states = x.u, x.v, x.u_after, x.v_after
    for values in (x.z, x.z_after):
        if not isinstance(values, dict) or values.keys() != z.keys():
            return False
        if not all(_is_array(y) and y.shape == (len(x.t), *z[name]) for name, y in values.items()):
            return False
    return all(_is_array(state) and state.shape == (len(x.t), *degrees) for state in states)


def _is_estimate(x: Any, fields: Mapping[str, Any], states: tuple[int, ...]) -> bool:
    """Whether the errors have the shapes of the values of the run."""
    if not (_is_array(x.t) and x.t.shape == states and isinstance(x.by, str) and _are_texts(x.notes)):
        return False
    if not all(value is None or _is_number(value) for value in (x.order, x.reliable_until, x.coarser)):
        return False
    pairs = [(x.u, fields["u"]), (x.v, fields["v"])]
    for name in ("outputs", "z"):
        values = getattr(x, name)
        if not isinstance(values, dict) or not values.keys() <= fields[name].keys():
            return False
        pairs += [(value, fields[name][key]) for key, value in values.items()]
    if not all(_is_array(value) and value.shape == np.shape(own) for value, own in pairs):
        return False
    of_names = {
        "drift": _is_number,
        "extremes": lambda value: isinstance(value, Extremes) and all(_is_number(x) or _is_array(x) for x in value),
        "events": lambda value: _is_array(value) and value.ndim == 1,
    }
    return all(_are_named(test, getattr(x, name)) for name, test in of_names.items())


def _is_state(x: Any, has_steps: bool) -> bool:
    """Whether a run can continue from this state; its numbers and arrays are checked when it continues."""
    if not isinstance(x, dict) or not (x.keys() == _GOES_ON_FIXED or (has_steps and x.keys() == _GOES_ON_VARIABLE)):
        return False
    has_flags = isinstance(x["inline"], bool) and isinstance(x["has_jacobian"], bool)
    has_start = isinstance(x["start"], tuple) and len(x["start"]) == 2
    return has_flags and has_start and isinstance(x["layout"], str) and _is_number(x["t0"]) and _is_number(x["t_end"])


def _is_array(x: Any) -> bool:
    return isinstance(x, np.ndarray) and x.dtype == np.float64


def _is_number(x: Any) -> bool:
    return isinstance(x, float) or (_is_whole(x) and abs(x) <= _MOST)


def _is_count(x: Any) -> bool:
    return _is_whole(x) and 0 <= x <= _MOST


def _is_whole(x: Any) -> bool:
    return isinstance(x, int) and not isinstance(x, bool)


def _are_texts(x: Any) -> bool:
    return isinstance(x, tuple) and all(isinstance(text, str) for text in x)


def _are_named(is_one: Test, x: Any) -> bool:
    return isinstance(x, dict) and _are_texts(tuple(x)) and all(is_one(value) for value in x.values())


def _are_labels(x: Any) -> bool:
    if not isinstance(x, Labels) or not (
        _are_texts((*x.names, x.time)) and (isinstance(x.units, str) or _are_texts(x.units))
    ):
        return False
    named = *x.columns, *((name, (unit,) if isinstance(unit, str) else unit) for name, unit in x.output_units)
    return all(isinstance(name, str) and _are_texts(texts) for name, texts in named)


_IS_ONE: dict[type, Test] = {
    float: _is_number,
    int: _is_count,
    str: lambda x: isinstance(x, str),
    Status: lambda x: isinstance(x, Status),
}
