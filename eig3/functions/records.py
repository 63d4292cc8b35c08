"""Records of loads in the parameters of a right-hand side, and the longest step that jumps over none of their loads."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .layout import bound_layout
from .named import Parameters

EVER = -math.inf, math.inf
_ROUND_OFF = 1e-9  # of the times of a record, relative to the duration of a load


class Records(NamedTuple):
    """What a right-hand side with records of loads knows of its parameters.

    Attributes
    ----------
    names : tuple of str
        The parameters with the records.
    check : callable
        ``check(params, n)`` raises an error if the parameters of n degrees of freedom do not belong together.
    shortest : callable
        ``shortest(values, t_span)`` returns the durations of the shortest loads that act in a span, shape (m,). They
        are infinite without a load. `values` are the parameters by name, with a first axis of m members.
    """

    names: tuple[str, ...]
    check: Callable[[Any, int], None]
    shortest: Callable[[dict[str, np.ndarray], tuple[float, float]], np.ndarray]


def records_of(rhs: Any) -> Records | None:
    """Return the records of a right-hand side, or None. They are pickled with the Python function."""
    function = getattr(rhs, "py_func", None)
    while hasattr(function, "inner"):
        function = function.inner.py_func
    return getattr(function, "records", None)


def longest_step(records: Records | None, params: Any, n: int) -> float:
    """Return the longest step that jumps over no load, after the check that named parameters belong together.

    It is infinite without records, and half as long as the shortest load otherwise. The parameters remember it.
    """
    if records is None or not isinstance(params, Parameters):
        return math.inf
    if params._known[:2] != (records, n):
        records.check(params, n)
        values = {name: np.asarray(x)[None] for name, x in params._asdict().items() if name in records.names}
        object.__setattr__(params, "_known", (records, n, float(records.shortest(values, EVER)[0]) / 2))
    return params._known[2]


def check_together(rhs: Any, params: np.ndarray, own: Sequence[str], n: int) -> None:
    """Check the parameters of the first member, or of all members if they have different whole numbers.

    The arguments are as for `shortest_loads`, and n is the number of degrees of freedom.
    """
    records, layout = records_of(rhs), bound_layout(rhs)
    if records and layout:
        is_whole = any(layout.kinds[layout.names.index(name)].is_whole for name in own)
        for p in np.atleast_2d(params)[: None if is_whole else 1]:
            records.check(layout.read(p), n)


def shortest_loads(
    rhs: Any, params: np.ndarray, own: Sequence[str] = (), t_span: tuple[float, float] = EVER
) -> np.ndarray:
    """Return the durations of the shortest loads that act in a span; infinite without records.

    Parameters
    ----------
    rhs : jitted function
    params : ndarray, shape (k,) or (m, k)
        As kernels get them.
    own : sequence of str
        The parameters with a value for each of the m members; empty if they are not known.

    Returns
    -------
    ndarray, shape (m,) or (1,)
    """
    records, layout = records_of(rhs), bound_layout(rhs)
    if records is None or layout is None:
        return np.array([math.inf])
    rows = np.atleast_2d(params)
    rows = rows[:1] if own and not {*own} & {*records.names} else rows
    first = layout.read(rows[0])._asdict()
    places, shapes = layout.places(first), {name: np.shape(first[name]) for name in records.names if name in first}
    return records.shortest({name: rows[:, places[name]].reshape(-1, *shape) for name, shape in shapes.items()}, t_span)


def jumps(h: float, load: float) -> bool:
    """Return whether a fixed step may jump over a load of some duration."""
    return h > load / 2 * (1 + _ROUND_OFF)


def jump_note(h: float, load: float, whose: str = "") -> str:
    """Return the note about a step that may jump over a load of some duration."""
    return (
        f"h = {h:.4g}{whose} is longer than half of the shortest load of a record, which acts for {load:.4g}: a step "
        f"may jump over it. Take h up to {load / 2:.4g}, or rtol."
    )
