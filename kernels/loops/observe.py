# ruff: noqa: F821
"""What is observed in a step of variable length: events, wanted times, quantities, and the row to write.

One function of each form serves all methods: their kernels call it at its address after each accepted step. Other code
that only some runs need, such as the search for events, is called at its address too, and is compiled for these runs.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection
from typing import Any, NamedTuple

from numba.types import NamedTuple as Record
from numba.types import Tuple, float64, int64, none

from ..compile.jit import address_of_code, bound, called_by_symbol, compile_kernel, element, function_at
from ..protocol import (
    DUE,
    EVALUATIONS,
    LOOK_WITHIN,
    NEXT,
    NOT_A_NUMBER,
    PART,
    PART_END,
    PARTS,
    PASSED,
    RESTING,
    SPACING,
    TERMINAL,
    ZENO,
    Form,
    copy_rows,
    matrix_type,
    record_at,
    rows,
    span_at,
    stack_rows,
    store_record,
    vector_type,
)
from .dense import evaluate
from .extremes_within import OF_FOLLOWING, follow_end, following_within
from .follow import end_part, first_due, functions, save, widen_all
from .formulas import variable_formulas
from .pair import A_END
from .zeros import OF_SEARCH, OF_TIMES, quiet, search_of_step, writing_of_times


class Observation(NamedTuple):
    """What a kernel gets to observe its steps.

    Attributes
    ----------
    look : int
        The address of the `Look`, or 0 if there is none.
    most_logged : int
        The largest number of occurrences in its log before a step.
    at_each : int
        1 if something is done after each step, 0 if only invariants are evaluated, and these sometimes, -1 if nothing.
    observe, dense, follow, search, write : int
        The addresses of `observe`, of the dense output of the method, of `follow_within`, `look_within` and
        `write_time`; 0 for what the run does not need.
    dense_evaluations : int
        Evaluations of the right-hand side in the dense output.
    """

    look: Any = 0
    most_logged: Any = 0
    at_each: Any = 0
    observe: Any = 0
    dense: Any = 0
    follow: Any = 0
    search: Any = 0
    write: Any = 0
    dense_evaluations: Any = 0


class Observed(NamedTuple):
    """What `observe` gets of a run: two addresses, and arrays that the kernel changes."""

    rhs: Any
    span: Any
    observation: Any
    counters: Any
    state: Any


OBSERVATION = Record((int64,) * len(Observation._fields), Observation)
OBSERVED = Record((int64, int64, OBSERVATION, vector_type, matrix_type), Observed)

#: The signatures of `observe` and of a dense output.
OF_OBSERVING = Tuple((int64, int64, float64, float64))(int64, int64, int64, float64, float64, float64)
OF_DENSE = none(int64, float64, float64, vector_type, matrix_type, matrix_type)


def observe(place, i, row, t, step, t_end):
    """Look at the step from t to t_end, after which the step index is i, and write the state if it is due.

    Return the outcome, the next row to write, and the fraction of the step and the time at which it ends. If the
    outcome is not PASSED, the rows U, V and A of the state become those there; a step that is RESTING or NOT_A_NUMBER
    is not taken. The address of an `Observed` is `place`.
    """
    of = OBSERVED_AT(place)
    counters, state, parts, span = of.counters, of.state, of.observation, span_at(of.span)
    look = LOOK_AT(parts.look)
    watch, follow, p, n = look.watch, look.follow, span.p, state.shape[1]
    u, v, a, u_end, v_end, _ = rows(state, LAST_ROW)
    (u_there, v_there), coefficients = rows(watch.work, 2), watch.work[2:]
    PROJECT(follow, t_end, u_end, v_end, p)
    first = first_due(follow, counters, i)
    # within a step, only what was evaluated at its start is followed
    first_within = 0 if counters[SPACING] == 1 else follow.invariants
    follows, follows_within = len(follow.table) > first, len(follow.table) > first_within
    may_cross = len(watch.events) > 0 and not IS_QUIET(watch, counters, t_end, u_end, v_end, p)
    is_known = follows_within or may_cross or is_wanted(watch, counters, t_end)
    outcome, s, t_stop = PASSED, 1.0, t_end
    if is_known:
        DENSE_AT(parts.dense)(of.rhs, t, step, p, state, coefficients)
    if may_cross:
        outcome, s, t_stop = SEARCH_AT(parts.search)(
            parts.look, counters, span.t0, t, step, t_end, n, coefficients, u_end, v_end, u_there, v_there, p
        )
        if outcome in (NOT_A_NUMBER, RESTING):
            return outcome, row, s, t_stop
    while is_wanted(watch, counters, t_stop):
        WRITE_AT(parts.write)(parts.look, counters, t, step, t_end, n, coefficients, u_end, v_end, p)
    if is_known:
        counters[EVALUATIONS] += parts.dense_evaluations
    if outcome != PASSED and s < 1.0:
        evaluate(coefficients, s, n, u_end, v_end)
    part = int64(counters[PART]) % PARTS
    if follows:
        EVALUATE(follow, first, t_stop, u_end, v_end, p)
        if follows_within and t_stop > t:
            FOLLOW_AT(parts.follow)(parts.look, first_within, t_stop, s * step, s, n, p)
    ADVANCE_HISTORY(follow, t_stop, u_end, v_end, p)
    has_rows = len(span.t_rows) > 0
    u_now, v_now = u_end, v_end
    if outcome != PASSED:
        if has_rows and span.every == 1 and s > 0:  # the state at the start is a row already
            write_row(span, row, t_stop, s * step, n, u_end, v_end)
            save(follow, row)
            row += 1
        for j in range(n):
            u[j], v[j] = u_there[j], v_there[j]
        u_now, v_now = u, v
        PROJECT(follow, t_stop, u, v, p)
        RHS(of.rhs)(t_stop, u, v, p, a)
        counters[EVALUATIONS] += 1
        ADVANCE_HISTORY(follow, t_stop, u, v, p)
        first = len(follow.table)
        if outcome <= ZENO:
            first = 0
            EVALUATE(follow, first, t_stop, u, v, p)
            follow_end(follow, look.within)
    widen_all(follow, first, part, t_stop, v_now)
    if outcome != TERMINAL and has_rows and i % span.every == 0:
        write_row(span, row, t_stop, s * step, n, u_now, v_now)
        save(follow, row)
        row += 1
    end_part(follow, counters, i, n, v_now)
    return outcome, row, s, t_stop


@element
def is_wanted(watch, counters, t):
    """Return whether there is a wanted time up to t."""
    k = int64(counters[NEXT])
    return k < len(watch.times) and watch.times[k] <= t


@element
def write_row(span, row, t, h, n, u, v):
    span.t_rows[row], span.h_rows[row] = t, h
    for j in range(n):
        span.u_rows[row, j], span.v_rows[row, j] = u[j], v[j]


@element
def next_due(counters, at_each):
    """Return the step index after which the invariants are due, or a part of the run ends."""
    return min(counters[DUE], counters[PART_END]) if at_each >= 0 else math.inf


def is_calm(look, counters, t, u, v, p):
    """Return whether no time up to t is wanted, and no event has occurred."""
    watch = LOOK_AT(look).watch
    return not is_wanted(watch, counters, t) and IS_QUIET(watch, counters, t, u, v, p)


def dense_output(address, t, h, p, state, coefficients):
    """Write the dense output of the step whose rows are in the state."""
    n, y = N if N > 0 else state.shape[1], rows(state, ROWS)
    if N > 0:
        kept, y = y, stack_rows(N, ROWS)
        copy_rows(y, kept, N)
    DENSE(RHS(address), t, h, p, n, y, coefficients)


def place_look(look, memory):
    """Copy a look to the array `memory` of `RECORD_SIZE` values, and return its address."""
    return store_record(memory, look)


def at_each_step(follow: Any) -> int:
    """Return the entry `at_each` of an `Observation`."""
    count = len(follow.table)
    return 1 if count > follow.invariants or follow.advance or follow.project else 0 if count else -1


@functools.cache
def placing() -> Any:
    """Compile `place_look`, or load it from the disk."""
    return compile_kernel(place_look, {}, int64(LOOK_WITHIN, vector_type), "within")


@functools.cache
def calm(form: Form) -> Any:
    """Return the element `is_calm`."""
    return element(bound(is_calm, {"LOOK_AT": record_at(LOOK_WITHIN), "IS_QUIET": quiet(form)}))


@functools.cache
def observation(pair: str, form: Form, n: int, parts: Collection[str]) -> tuple[int, ...]:
    """Compile what the kernel of a pair for n degrees of freedom needs to observe its steps, or load it from the disk.

    `parts` are those that are needed: "quantities", "events" and "times". Return the last fields of an `Observation`.
    """
    seen, formulas = functions(form), variable_formulas(pair)
    names = {
        "OBSERVED_AT": record_at(OBSERVED),
        "LOOK_AT": record_at(LOOK_WITHIN),
        "LAST_ROW": A_END + 1,
        "RHS": form.at("rhs"),
        "PROJECT": seen.project,
        "ADVANCE_HISTORY": seen.advance,
        "EVALUATE": seen.evaluate,
        "IS_QUIET": quiet(form),
        "DENSE_AT": function_at(OF_DENSE),
        "SEARCH_AT": function_at(OF_SEARCH),
        "WRITE_AT": function_at(OF_TIMES),
        "FOLLOW_AT": function_at(OF_FOLLOWING),
    }
    of_dense = {"RHS": form.at("rhs"), "DENSE": formulas.functions()["dense"], "ROWS": formulas.rows, "N": n}
    optional = {"quantities": following_within, "events": search_of_step, "times": writing_of_times}
    follow, search, write = (address_of_code(made(form)) if x in parts else 0 for x, made in optional.items())
    observe_at = address_of_code(called_by_symbol(observe, names, OF_OBSERVING, form.name))
    dense_at = (
        address_of_code(called_by_symbol(dense_output, of_dense, OF_DENSE, f"{pair}_{form.name}_{n}")) if parts else 0
    )
    return observe_at, dense_at, follow, search, write, formulas.dense_evaluations
