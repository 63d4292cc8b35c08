# ruff: noqa: F821
"""The loops over the steps of a fixed-step method, which also write the states to save.

`step` returns the next state and whether it succeeded. For a method whose steps cannot fail, LLVM removes this test.
The time is computed as t0 + i h from the step index i. A sum of steps would accumulate round-off, and would depend on
the division of the run into chunks.

The names in capitals are inserted by `fixed.py`. If LOOKS is 0, the loop belongs to a run that looks for nothing: the
compiler leaves out what depends on it; see `FOLLOWS`. An only quantity that returns its value, such as an energy, has a
separate path, with its extremes in registers: a step with an energy takes half the time.
"""

from __future__ import annotations

import math

import numba
from numba.types import int64

from ..compile.jit import element
from ..protocol import (
    DUE,
    EVALUATIONS,
    FAILED,
    NEXT,
    PART,
    PART_END,
    PARTS,
    SEARCHES,
    SEARCHES_LANES,
    SPACING,
    At,
    row_index,
)
from .follow import acts_at_each, next_due, only_quantity, save, widen_only
from .pair import U_END, V_END, U, V

#: How a march ended, besides FAILED: after its last step, or with a step that must be searched.
THROUGH, FOUND = range(2)

#: Whether to check that a step returns each of its rows once.
CHECKED = bool(numba.config.BOUNDSCHECK)


def march(f, y, c, n, scratch, steps, look, counters, pair, first, last, started, row):
    """Advance the rows `y` from step `first` to `last`, to the end of a part, or until a step must be searched.

    The starter takes the steps before step `started`. A step may return the rows in another order. Return the last `y`,
    the step index that was reached, the next row of `steps.u_rows` to write, and how the march ended. If a step is
    found, u and v before it are in `pair`, and the state after it is not written. In lanes, steps are searched here,
    and FOUND means that the log is full.
    """
    if LOOKS > 0 and len(look.follow.table) > 0 and counters[PART_END] < last:  # `min` would be a further function
        last = int64(counters[PART_END])
    left = steps.every - first % steps.every
    if LOOKS > 0:
        part = int64(counters[PART]) % PARTS
    if LOOKS > 0 and MAY_BE_ONLY > 0:
        is_only, place = only_quantity(look.follow)
        quantity = QUANTITY(look.follow)
        e, low, high, t_low, t_high = math.nan, math.inf, -math.inf, math.nan, math.nan
    if LOOKS > 0:
        due, spacing, follow = counters[DUE], counters[SPACING], look.follow
        looks_at_each = LOOKS >= SEARCHES or acts_at_each(follow)
    if LOOKS == SEARCHES:
        wanted = next_time(look.watch, counters)
    i, t, ended, is_complete = first, steps.t0 + first * steps.h, THROUGH, True
    while i < last:
        if LOOKS >= SEARCHES:
            copy_two(pair[U], pair[V], y[0], y[1], n)
        if START_STEPS > 0 and i < started:
            y_next, success = START_STEP(f, At(i, t, steps.h, steps.p), y, (c, scratch), n)
        else:
            y_next, success = STEP(f, At(i, t, steps.h, steps.p), y, c, n)
        if not success:
            ended = FAILED
            break
        if STACKED == 0:  # a step on the stack returns `y`, but LLVM would take it for one of two addresses
            y = y_next
        i += 1
        t = steps.t0 + i * steps.h
        is_complete = START_STEPS > 0 and i <= started  # the starter gives the velocity
        if LOOKS > 0 and (looks_at_each or i >= due):
            if not is_complete:
                COMPLETE(y, c, steps.h, n)
                is_complete = True
            if STACKED == 0:
                PROJECT_STEP(follow, t, y[0], y[1], steps.p)
            if LOOKS == SEARCHES:
                u, v = y[0], y[1]
                if N > 1 and STACKED > 0:  # rows whose address a function gets cannot be registers
                    u, v = pair[U_END], pair[V_END]
                    copy_two(u, v, y[0], y[1], n)
                if wanted <= t or not IS_QUIET(look.watch, counters, t, u, v, steps.p):
                    ended = FOUND
                    break
            if LOOKS == SEARCHES_LANES:
                SEARCH_LANES(look, i, t, y, steps)
            quantities = follow.invariants
            if i >= due:
                quantities = 0
                if spacing > 1:
                    due = next_due(due, spacing)
            if MAY_BE_ONLY > 0 and is_only:
                if quantities == 0:
                    e = quantity(t, y[0], y[1], steps.p)
                    if e < low:
                        low, t_low = e, t
                    if e > high:
                        high, t_high = e, t
                    if e != e:
                        widen_only(follow, part, e, t)
            else:
                EVALUATE(follow, quantities, t, y[0], y[1], steps.p)
                WIDEN(follow, quantities, part, t, y[1])
            if STACKED == 0:
                ADVANCE_HISTORY(follow, t, y[0], y[1], steps.p)
        left -= 1
        if left == 0:
            if not is_complete:
                COMPLETE(y, c, steps.h, n)
                is_complete = True
            write(y[0], y[1], n, steps, row)
            if LOOKS > 0 and looks_at_each:
                if MAY_BE_ONLY > 0 and is_only:
                    follow.out[place] = e
                save(follow, row)
            row += 1
            left = steps.every
        if LOOKS == SEARCHES_LANES and IS_FULL(look):
            ended = FOUND
            break
    if LOOKS > 0:
        counters[DUE] = due
    if LOOKS > 0 and MAY_BE_ONLY > 0 and is_only:
        follow.out[place] = e
        if low <= high:
            widen_only(follow, part, low, t_low)
            widen_only(follow, part, high, t_high)
    if not is_complete and (LOOKS > 0 or ended == THROUGH):
        COMPLETE(y, c, steps.h, n)
    counters[EVALUATIONS] += COST * (i - first)
    if START_STEPS > 0 and first < started:
        counters[EVALUATIONS] += (START_COST - COST) * ((i if i < started else started) - first)
    return y, i, row, ended


@element
def next_time(watch, counters):
    """Return the next time at which the state is wanted."""
    k = int64(counters[NEXT])
    return watch.times[k] if k < len(watch.times) else math.inf


@element
def write(u, v, n, steps, row):
    for values, rows in ((u, steps.u_rows), (v, steps.v_rows)):  # LLVM does not vectorise one loop for both
        for j in range(n):
            rows[row, j] = values[j]


@element
def copy_two(u, v, u_from, v_from, n):
    for j in range(n):  # LLVM does not vectorise one loop for both
        u[j] = u_from[j]
    for j in range(n):
        v[j] = v_from[j]


@element
def settle(y, state, n):
    """Move the contents of the rows so that row k of the state contains y[k] again."""
    if CHECKED:
        for k in range(len(y)):
            for other in range(k):
                if row_index(y[k], state) == row_index(y[other], state):
                    raise IndexError("a step must return each of its rows once.")
    for k in range(len(y)):
        place = row_index(y[k], state)
        while place < k:  # an earlier exchange moved this content to another row
            place = row_index(y[place], state)
        if place != k:
            for j in range(n):
                state[k, j], state[place, j] = state[place, j], state[k, j]
