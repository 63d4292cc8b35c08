"""What the fields of a stored solution must be: files come from others, and a wrong type would fail much later."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..functions.events import Occurrences
from ..functions.extremes import Extremes
from ..methods import Method
from .labels import Labels
from .solution import TRANSIENT, Status

_MOST = 2**63 - 1  # the largest count
#: What the state of each run has.
_GOES_ON = {"t0", "t_end", "start", "params", "layout", "inline", "has_jacobian", "times", "stepper"}
_GOES_ON_FIXED = _GOES_ON | {"h", "n_steps", "save_every", "growth"}
_GOES_ON_VARIABLE = _GOES_ON | {"tolerances", "every", "rows", "events"}


def check_fields(fields: Mapping[str, Any]) -> None:
    """Raise a ValueError if a field of a solution does not have its type and shape."""
    t, u = fields["t"], fields["u"]
    if not (_is_array(t) and t.ndim == 1 and _is_array(u) and u.ndim in (1, 2) and len(u) == len(t)):
        raise ValueError("t and u do not have the shapes of a history.")
    degrees = u.shape[1:]

    def is_history(x: Any) -> bool:
        return _is_array(x) and x.ndim > 0 and len(x) == len(t)

    def are_occurrences(x: Any) -> bool:
        if not (isinstance(x, Occurrences) and _is_array(x.t) and x.t.ndim == 1):
            return False
        states = x.u, x.v, x.u_after, x.v_after
        return all(_is_array(state) and state.shape == (len(x.t), *degrees) for state in states)

    tests: dict[str, Callable[[Any], bool]] = {
        "v": lambda x: _is_array(x) and x.shape == u.shape,
        "steps": lambda x: x is None or (is_history(x) and x.ndim == 1),
        "_a": lambda x: x is None or (_is_array(x) and x.shape == u.shape),
        "_a_jumps": lambda x: x is None or (_is_array(x) and x.ndim == u.ndim and x.shape[1:] == degrees),
        "status": lambda x: isinstance(x, Status),
        "method": lambda x: isinstance(x, Method) and x.jacobian is None,
        "notes": _are_texts,
        "labels": lambda x: x is None or _are_labels(x),
        "drift": lambda x: _are_named(x, _is_number),
        "extremes": lambda x: _are_named(x, _are_extremes),
        "events": lambda x: _are_named(x, are_occurrences),
        "outputs": lambda x: _are_named(x, lambda values: is_history(values) and values.ndim < 3),
        "integrals": lambda x: _are_named(x, lambda values: is_history(values) and values.ndim == 1),
        "_resume": lambda x: x is None or _is_state(x, fields["steps"] is not None),
    }
    tests |= dict.fromkeys(("h", "kernel_seconds"), _is_number)
    tests |= dict.fromkeys(("n_steps", "n_rhs", "n_iterations", "n_rejected"), _is_count)
    tests |= dict.fromkeys(("message", "_explanation"), lambda x: isinstance(x, str))
    tests |= dict.fromkeys(TRANSIENT, lambda x: x is None)
    for name, value in fields.items():
        if name not in ("t", "u") and not tests[name](value):
            raise ValueError(f"{name} is of a wrong type or shape.")
    if fields.get("_a") is not None:
        jumps = sum(len(occurrences.jumps) for occurrences in fields["events"].values())
        if fields["_a_jumps"] is None or len(fields["_a_jumps"]) != 2 * jumps:
            raise ValueError("_a_jumps are not the accelerations before and after the jumps.")


def check_ensemble_fields(fields: Mapping[str, Any], occurrences: Any) -> None:
    """Raise a ValueError if a field of an ensemble does not have its type and shape.

    `occurrences` is the class of the occurrences of an event in all members.
    """
    t, u = fields["t"], fields["u"]
    if not (_is_array(t) and t.ndim == 2 and _is_array(u) and u.ndim in (2, 3) and t.shape[1] == u.shape[1]):
        raise ValueError("t and u do not have the shapes of histories.")
    m, degrees = len(u), u.shape[2:]

    def has_members(x: Any) -> bool:
        return isinstance(x, np.ndarray) and x.shape == (m,)

    def is_history(x: Any) -> bool:
        return _is_array(x) and x.ndim in (2, 3) and x.shape[:2] == u.shape[:2]

    def are_extremes(x: Any) -> bool:
        return isinstance(x, Extremes) and all(_is_array(row) and row.ndim > 0 and len(row) == m for row in x)

    def are_occurrences(x: Any) -> bool:
        if not (isinstance(x, occurrences) and _is_array(x.first) and x.first.shape == (m,)):
            return False
        if not (isinstance(x.member, np.ndarray) and x.member.dtype == np.int64 and x.member.shape == x.t.shape):
            return False
        return all(
            _is_array(state) and state.shape == (len(x.t), *degrees) for state in (x.u, x.v, x.u_after, x.v_after)
        )

    tests: dict[str, Callable[[Any], bool]] = {
        "t": lambda x: len(x) in (1, m),
        "u": lambda x: True,
        "v": lambda x: _is_array(x) and x.shape == u.shape,
        "h": lambda x: _is_array(x) and has_members(x),
        "status": lambda x: has_members(x) and all(isinstance(status, Status) for status in x),
        "message": lambda x: has_members(x) and all(isinstance(text, str) for text in x),
        "params": lambda x: _is_array(x) and (x.ndim == 1 or (x.ndim == 2 and len(x) == m)),
        "method": lambda x: isinstance(x, Method) and x.jacobian is None,
        "drift": lambda x: _are_named(x, lambda values: _is_array(values) and has_members(values)),
        "extremes": lambda x: _are_named(x, are_extremes),
        "outputs": lambda x: _are_named(x, is_history),
        "integrals": lambda x: _are_named(x, is_history),
        "events": lambda x: _are_named(x, are_occurrences),
        "steps": lambda x: x is None or (is_history(x) and x.ndim == 2),
        "labels": lambda x: x is None or _are_labels(x),
        "notes": _are_texts,
        "first": _is_count,
        "kernel_seconds": _is_number,
        "_last": lambda x: isinstance(x, dict) and all(_is_count(i) and i < m and isinstance(x[i], tuple) for i in x),
    }
    counts = "n_steps", "n_rhs", "n_iterations", "n_rejected"
    tests |= dict.fromkeys(counts, lambda x: has_members(x) and x.dtype == np.int64)
    tests |= dict.fromkeys(("_rhs", "_repeat", "_again"), lambda x: x is None)
    for name, value in fields.items():
        if not tests[name](value):
            raise ValueError(f"{name} is of a wrong type or shape.")


def _is_state(x: Any, has_steps: bool) -> bool:
    """Whether a run may go on from here; what it has of numbers and arrays is checked when it goes on."""
    if not isinstance(x, dict):
        return False
    names = {*x, "layout"}  # which older files do not have
    if not (names == _GOES_ON_FIXED or (has_steps and names == _GOES_ON_VARIABLE)):
        return False
    has_flags = isinstance(x["inline"], bool) and isinstance(x["has_jacobian"], bool)
    return (
        has_flags
        and isinstance(x.get("layout", ""), str)
        and isinstance(x["start"], tuple)
        and len(x["start"]) == 2
        and _is_number(x["t0"])
        and _is_number(x["t_end"])
    )


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


def _are_named(x: Any, is_one: Callable[[Any], bool]) -> bool:
    return isinstance(x, dict) and _are_texts(tuple(x)) and all(is_one(value) for value in x.values())


def _are_labels(x: Any) -> bool:
    return isinstance(x, Labels) and _are_texts(x.names) and (isinstance(x.units, str) or _are_texts(x.units))


def _are_extremes(x: Any) -> bool:
    return isinstance(x, Extremes) and all(_is_number(value) or (_is_array(value) and value.ndim == 1) for value in x)
