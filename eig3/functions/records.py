"""Records of loads in the parameters of a right-hand side, and the steps that jump over a load or skip much of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from .companions import mark
from .layout import bound_layout
from .named import Parameters

EVER = -math.inf, math.inf
_SKIPPED = 0.2  # with less of noise as a ground motion, the largest displacement had an error below 5 %
_HALVINGS = 30  # of a step, to find one that does not skip a record


#: The times, shape (m, s), and the values, shape (m, s) or (m, s, k), of a record in m members. One may have m = 1.
Table = tuple[np.ndarray, np.ndarray]


class Records(NamedTuple):
    """What a right-hand side with records of loads knows of its parameters.

    Attributes
    ----------
    tables : callable
        ``tables(rows, layout)`` returns the records in parameters of m members, shape (m, k), as `Table`. A load acts
        where a value is not zero.
    names : tuple of str
        The names of the parameters with the records, if parameters have names.
    check : callable, optional
        ``check(params, n)`` raises an error if the parameters of n degrees of freedom do not belong together.
    computed : mapping of str to sequence of str
        Parameters that are computed from others, whose values `check` must see in each member.
    lasts : bool
        Whether the last value of a record acts after its end.
    check_members : callable, optional
        ``check_members(rows, layout, own)`` raises an error if one of the members, which have own values of some
        parameters, cannot be computed.
    """

    tables: Callable[[np.ndarray, Any], list[Table]]
    names: tuple[str, ...] = ()
    check: Callable[[Any, int], None] | None = None
    computed: Mapping[str, Sequence[str]] = MappingProxyType({})
    lasts: bool = False
    check_members: Callable[[np.ndarray, Any, Sequence[str]], None] | None = None


def records_of(rhs: Any) -> Records | None:
    """Return the records of a right-hand side, or None. They are pickled with the Python function."""
    return mark(rhs, "records")


def left_out_of(rhs: Any) -> np.ndarray | None:
    """Return the places of parameters that the code of a scene leaves out because they were 0; None without a scene."""
    return mark(rhs, "left_out")


def check_size(rhs: Any, params: Any, size: int) -> None:
    """Refuse parameters, of one run or of each member, that are not as many as in a scene."""
    if left_out_of(rhs) is None:
        return
    are_rows = isinstance(params, list | tuple) and len(params) > 0 and np.ndim(params[0]) > 0
    for k in {np.size(row) for row in params} if are_rows else np.shape(params)[-1:]:
        if k != size:
            raise ValueError(
                f"params must have {size} values, as in the scene of this problem, not {k}. An array with the same "
                "value for all points is kept as one value: build the problem with values that differ."
            )


def check_left_out(left_out: np.ndarray | None, params: np.ndarray) -> None:
    """Refuse parameters, shape (k,) or (m, k), that the code leaves out and that are not 0."""
    if left_out is None or not left_out.size or params.shape[-1] <= left_out[-1] or not params[..., left_out].any():
        return
    place = left_out[params[..., left_out].reshape(-1, left_out.size).any(axis=0)][0]
    raise ValueError(
        f"params must be 0 at [..., {place}]: a component of a vector or of a place was 0 when the scene was built, "
        "and its code leaves it out. Build the problem with another value there."
    )


def longest_step(records: Records | None, params: Any, n: int) -> float:
    """Return the longest step that jumps over no load, after the check that named parameters belong together.

    It is infinite without records, and half as long as the shortest load otherwise. The parameters remember it.
    """
    if records is None:
        return math.inf
    if not isinstance(params, Parameters):
        return math.inf if records.names else float(_shortest(records.tables(np.atleast_2d(params), None), EVER)[0]) / 2
    if params._known[:2] != (records, n):
        if records.check:
            records.check(params, n)
        tables = records.tables(np.asarray(params)[None], params.layout)
        object.__setattr__(params, "_known", (records, n, float(_shortest(tables, EVER)[0]) / 2))
    return params._known[2]


def check_together(rhs: Any, params: np.ndarray, own: Sequence[str], n: int) -> None:
    """Check the parameters of the first member, or of all members if they have different whole numbers or modes.

    The arguments are as for `shortest_loads`, and n is the number of degrees of freedom.
    """
    records, layout = records_of(rhs), bound_layout(rhs)
    if records and records.check and layout:
        is_whole = any(layout.kinds[layout.names.index(name)].is_whole for name in own)
        computed = any(name in layout.names and {*own} & {*given} for name, given in records.computed.items())
        for p in np.atleast_2d(params)[: None if is_whole or computed else 1]:
            records.check(layout.read(p), n)
        if records.check_members:
            records.check_members(np.atleast_2d(params), layout, own)


def shortest_loads(
    rhs: Any, params: np.ndarray, own: Sequence[str] = (), t_span: tuple[float, float] = EVER
) -> np.ndarray:
    """Return the durations, shape (m,) or (1,), of the shortest loads that act in a span; infinite without records.

    `params` are as kernels get them, of shape (k,) or (m, k). The parameters `own` have a value for each of the m
    members; it is empty if they are not known.
    """
    records, layout = records_of(rhs), bound_layout(rhs)
    if records is None or (records.names and layout is None):
        return np.array([math.inf])
    rows = np.atleast_2d(params)
    return _shortest(records.tables(rows[:1] if own and not {*own} & {*records.names} else rows, layout), t_span)


def _shortest(tables: list[Table], t_span: tuple[float, float]) -> np.ndarray:
    """Return the durations of the shortest parts of records that are not zero and act in a span."""
    shortest = np.full(1, math.inf)
    for t, x in tables:
        count, acts = x.shape[1], np.zeros((max(len(t), len(x)), x.shape[1] + 2), dtype=bool)
        acts[:, 1:-1] = np.any(x.reshape(len(x), count, -1), axis=2)
        changes = np.flatnonzero(acts[:, 1:] != acts[:, :-1])  # in each row a load begins and ends in turn
        rows, first = np.divmod(changes[::2], count + 1)
        first, last = np.maximum(first - 1, 0), np.minimum(changes[1::2] % (count + 1), count - 1)
        begin, end = (t[rows if len(t) > 1 else 0, at] for at in (first, last))
        acting = (begin < t_span[1]) & (end > t_span[0])
        each = np.full(len(acts), math.inf)
        np.minimum.at(each, rows[acting], (end - begin)[acting])
        shortest = np.minimum(shortest, each)
    return shortest


def skips(
    rhs: Any, params: np.ndarray, t_span: tuple[float, float], h: float, evaluations: int | None, whose: str = ""
) -> str:
    """Return the note about a fixed step that skips much of a record; empty if it does not.

    `params` are of one run, and `evaluations` the number of them in a step, None for an implicit method.
    """
    records, layout = records_of(rhs), bound_layout(rhs)
    if records is None or (records.names and layout is None):
        return ""
    tables = [(t[0], x[0].reshape(len(x[0]), -1).T) for t, x in records.tables(np.atleast_2d(params), layout)]
    # A method with more evaluations resolves half a step. RK4 weighs its middle by four times its ends.
    parts = 2 if (evaluations or 1) > 4 else 1

    def skipped(step: float) -> float:
        return max((_skipped(t, x, records.lasts, t_span, step / parts) for t, x in tables), default=0.0)

    if (part := skipped(h)) <= _SKIPPED:
        return ""
    spacings = (k * float(of(np.diff(t))) for t, _ in tables for of in (np.median, np.min) for k in (1, parts))
    shorter = sorted({step for step in (*spacings, *(h / 2**k for k in range(1, _HALVINGS + 1))) if step < h})
    enough = next((step for step in reversed(shorter) if skipped(step) <= _SKIPPED), shorter[0])
    return (
        f"h = {h:.4g}{whose} skips much of a record of loads: straight lines between the times that the method "
        f"resolves differ from it by {100 * part:.0f} % of its root mean square. Take h = {enough:.4g}, or rtol."
    )


def _skipped(t: np.ndarray, x: np.ndarray, lasts: bool, t_span: tuple[float, float], h: float) -> float:
    """Return the root mean square of what a record, shape (k, s), loses if only its values at steps h are known.

    It is relative to the root mean square of the record, in the span or, if the span is shorter than the record, in all
    of the record if this is larger: a run may end where the record has hardly begun. Steps without a sample lose
    nothing.
    """
    samples = np.clip(t, *t_span)
    steps = np.unique(np.floor((samples - t_span[0]) / h)[:, None] + np.arange(-1, 3))  # round-off moves a sample
    at = t_span[0] + h * steps
    edges = np.unique(np.clip(np.concatenate([at, samples]), *t_span))
    half, lost, whole, in_all = np.diff(edges) / 2, 0.0, 0.0, 0.0
    points = edges[:-1] + half * (1 + np.array([[-1.0], [1.0]]) / math.sqrt(3))  # the squares are integrated exactly
    for values in x[x.any(axis=1)]:
        record = partial(np.interp, xp=t, fp=values, left=0.0, right=values[-1] if lasts else 0.0)
        true = record(points)
        lost += float(np.sum(half * (true - np.interp(points, at, record(at))) ** 2))
        whole += float(np.sum(half * true**2))
        a, b = values[:-1], values[1:]
        in_all += float(np.sum(np.diff(t) * (a * a + a * b + b * b))) / 3
    span, duration = t_span[1] - t_span[0], t[-1] - t[0]
    largest = max(whole, in_all * span / duration if span < duration else 0.0)
    return math.sqrt(lost / largest) if largest else 0.0
