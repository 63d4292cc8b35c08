# ruff: noqa: F821
"""Evaluate the quantities of a run, its invariants and outputs, in a state, and keep their extremes.

The names in capitals stand for functions that depend on the form of the right-hand side and on the mode: `functions`
inserts them. A quantity is called at its address, or, in a kernel that inlines it, in the loop itself.
"""

from __future__ import annotations

import functools
import math
from types import SimpleNamespace
from typing import Any

from numba.types import int64

from ..compile.jit import bound, element, outlined
from ..compile.source import define
from ..protocol import (
    ADDRESS,
    COLUMN,
    DUE,
    HIGH,
    LOW,
    OUT,
    PART,
    PART_END,
    PARTS,
    ROWS,
    SPACING,
    T_HIGH,
    T_LOW,
    WIDTH,
    WORK,
    Form,
    store_at,
)


def evaluate_one(follow, k, t, u, v, p):
    """Evaluate the quantity k into `follow.out`."""
    address, width = follow.table[k, ADDRESS], follow.table[k, WIDTH]
    if width == 0:
        returned(follow, k, RETURNED(address), t, u, v, p)
    else:
        written(follow, k, WRITTEN(address), width, t, u, v, p)


def evaluate_all(follow, first, t, u, v, p):
    for k in range(first, len(follow.table)):
        EVALUATE_ONE(follow, k, t, u, v, p)


def advance_history(follow, t, u, v, p):
    """Advance the history in p to a state that is no trial: the end of a step, or the state at an event."""
    if follow.advance != 0:
        RETURNED(follow.advance)(t, u, v, p)


def project_state(follow, t, u, v, p):
    """Move a state that a step or an event has reached to the nearest one which keeps the constraints."""
    if follow.project != 0:
        RETURNED(follow.project)(t, u, v, p)


@element
def no_projection(follow, t, u, v, p):
    """The `project_state` of kernels for states that keep the constraints, or have none."""


@element
def no_history(follow, t, u, v, p):
    """The `advance_history` of kernels for right-hand sides without a history."""


@element
def next_due(due, spacing):
    """Return from which step index on the invariants are evaluated after they were due at `due`.

    The distance grows to `spacing`. This is no integer if it is beyond 1: the invariants of a periodic motion are then
    evaluated in all of its phases.
    """
    return due + max(1.0, min(due / 8, spacing))


@element
def acts_at_each(follow):
    """Return whether something is done after each step, besides invariants."""
    return len(follow.table) > follow.invariants or follow.advance != 0 or follow.project != 0


@element
def first_due(follow, counters, i):
    """Return the first quantity to evaluate after step i: 0, or the number of invariants if these are not due."""
    if i < counters[DUE]:
        return follow.invariants
    if counters[SPACING] > 1:
        counters[DUE] = next_due(counters[DUE], counters[SPACING])
    return 0


@element
def widen_all(follow, first, part, t, v):
    """Widen the extremes by the values in `follow.out`."""
    for k in range(first, len(follow.table)):
        widen_one(follow, k, max(follow.table[k, WIDTH], 1), part, t, v)


@element
def widen_one(follow, k, width, part, t, v):
    place, column, work = follow.table[k, OUT], follow.table[k, COLUMN], follow.table[k, WORK]
    for j in range(width):
        widen_at_end(follow, part, column + j, follow.out[place + j], t)
    if work >= 0:
        follow.most[k] = max(follow.most[k], abs(v[work]))


@element
def end_part(follow, counters, i, n, v):
    """End the current part of the run if step `i` is its last, and begin the next one."""
    part, end = int64(counters[PART]), int64(counters[PART_END])
    if i < end or len(follow.table) == 0:
        return
    for j in range(n):
        follow.forward[part % PARTS, j] = 1.0 if v[j] > 0 else 0.0
    part += 1
    counters[PART], counters[PART_END] = part, end + max(1, end // 5)
    lowest, highest = follow.parts[part % PARTS, LOW], follow.parts[part % PARTS, HIGH]
    for j in range(len(lowest)):
        lowest[j], highest[j] = math.inf, -math.inf


@element
def returned(follow, k, function, t, u, v, p):
    follow.out[follow.table[k, OUT]] = function(t, u, v, p)


@element
def written(follow, k, function, width, t, u, v, p):
    place = follow.table[k, OUT]
    values = follow.out[place : place + width]
    for j in range(width):
        values[j] = math.nan  # a value that the function does not write stays NaN
    function(t, u, v, p, values)


@element
def widen_at_end(follow, part, j, e, t):
    """Widen the extremes by a value at the end of a step or at an event: one beyond them is beyond its part's too."""
    ends = follow.parts[part]
    if not ends[LOW, j] <= e <= ends[HIGH, j]:
        widen_range(ends, j, e)
        widen_range(follow.steps, j, e)
        widen(follow.extremes, j, e, t)


@element
def widen_range(ends, j, e):
    """Widen a lowest and a highest value: NaN becomes and stays both of them."""
    low, high = ends[LOW, j], ends[HIGH, j]
    if low == low and not e >= low:
        ends[LOW, j] = e
    if high == high and not e <= high:
        ends[HIGH, j] = e


@element
def widen(extremes, j, e, t):
    """Widen a range, as `widen_range`, and note the time."""
    low, high = extremes[LOW, j], extremes[HIGH, j]
    if low == low and not e >= low:
        extremes[LOW, j], extremes[T_LOW, j] = e, t
    if high == high and not e <= high:
        extremes[HIGH, j], extremes[T_HIGH, j] = e, t


@element
def save(follow, row):
    """Copy the values of the outputs in `follow.out` to the row of a state that is saved."""
    for k in range(follow.invariants, len(follow.table)):
        address, width = follow.table[k, ROWS], max(follow.table[k, WIDTH], 1)
        if address != 0:
            for j in range(width):
                store_at(address, row * width + j, follow.out[follow.table[k, OUT] + j])


@element
def only_quantity(follow):
    """Return whether there is only one quantity, which returns its value, and its place in `out`."""
    if len(follow.table) != 1:
        return False, 0
    return follow.table[0, WIDTH] == 0 and follow.table[0, WORK] < 0, follow.table[0, OUT]


@outlined
def widen_only(follow, part, e, t):
    """Widen the extremes of an only quantity by a value."""
    widen_at_end(follow, part, follow.table[0, COLUMN], e, t)


@functools.cache  # so that kernels share the compiled elements
def functions(form: Form) -> SimpleNamespace:
    """Return the elements `evaluate(follow, first, t, u, v, p)` and `evaluate_one(follow, k, t, u, v, p)` for one form.

    ``first(follow)`` is the function of the first quantity, if it returns its value. ``advance(follow, t, u, v, p)`` is
    `advance_history`, and ``project(follow, t, u, v, p)`` is `project_state`.
    """
    returned_at = form.at("invariant")
    named = {"RETURNED": returned_at, "WRITTEN": form.at("output")}
    first = element(lambda follow: returned_at(follow.table[0, ADDRESS] if len(follow.table) > 0 else 0))
    one = element(bound(evaluate_one, named))
    every = element(bound(evaluate_all, {"EVALUATE_ONE": one}))
    advance = element(bound(advance_history, named))
    project = element(bound(project_state, named))
    return SimpleNamespace(evaluate=every, evaluate_one=one, first=first, advance=advance, project=project)


def inline_functions(form: Form, quantities: tuple) -> tuple[Any, Any]:
    """Return the elements `evaluate` and `widen` for quantities that become a part of the loop.

    `quantities` are pairs of a jitted function and its number of values, or 0, in the order of `Follow.table`.
    """
    names: dict[str, Any] = {"__name__": __name__, "returned": returned, "written": written, "widen_one": widen_one}
    evaluated, widened = ["def evaluate(follow, first, t, u, v, p):"], ["def widen(follow, first, part, t, v):"]
    for k, (function, width) in enumerate(quantities):
        names[f"quantity{k}"] = form.with_rows("output" if width else "invariant", function)
        how = f"written(follow, {k}, quantity{k}, {width}" if width else f"returned(follow, {k}, quantity{k}"
        evaluated.append(f"    if first <= {k}:\n        {how}, t, u, v, p)")
        widened.append(f"    if first <= {k}:\n        widen_one(follow, {k}, {max(width, 1)}, part, t, v)")
    defined = define("\n".join([*evaluated, "    return", "", *widened, "    return", ""]), "quantities", names)
    return element(defined["evaluate"]), element(defined["widen"])
