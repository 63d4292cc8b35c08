# ruff: noqa: F821
"""The kernel for steps of variable length, which follow from tolerances.

`variable` is a template: the names in capitals stand for values that depend on the method, on the form of the
right-hand side and on the mode. A state has rows of n values also for one degree of freedom: they are registers then.
What is observed in a step is not part of the kernel, see `eig3.kernels.loops.observe`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection
from typing import Any

import numpy as np
from numba.types import UniTuple, int64, none

from ..compile.jit import compile_kernel, element, function_at
from ..protocol import (
    AT_END,
    BEFORE_END,
    ERROR,
    EVALUATIONS,
    FULL,
    GAP,
    GOING,
    LOGGED,
    NOT_A_NUMBER,
    PASSED,
    RECORD_SIZE,
    REJECTED,
    RESET,
    RESTING,
    SCALAR,
    SILENT_END,
    SILENT_STEP,
    SPAN,
    STEP,
    STEP_BEFORE,
    TIME,
    TOO_SMALL,
    U_SIZE,
    V_SIZE,
    Form,
    copy_rows,
    matrix_type,
    pointer_to,
    rows,
    stack_rows,
    vector_type,
)
from .beginning import RESOLUTION, beginning, least_size
from .controller import LEAST_ERROR, exponent, next_step, shrinkage
from .fixed import STACKED_DEGREES, inline_callbacks, pointer_callbacks
from .formulas import variable_formulas
from .observe import (
    OBSERVATION,
    OF_OBSERVING,
    Observation,
    Observed,
    at_each_step,
    calm,
    next_due,
    observation,
    placing,
    write_row,
)
from .pair import A_END, U_END, U_MOST, V_END, V_MOST, A, U, V
from .zeros import LATER

__all__ = ["inline_kernel", "kernel", "least_size", "observing"]

_SILENCE = 0.02  # longest step while nothing acts, relative to the time since the start


def variable(callbacks, state, observation, counters, span, look):
    """Take steps, and return their number, the next row to write, and how it ended."""
    n = N if N > 0 else state.shape[1]  # a constant: with n = 2, a step of RKN12 takes two thirds of the time
    f, p = RHS(callbacks), span.p
    kept, of_span, address = rows(state, ROWS), pointer_to(span), ADDRESS(callbacks)
    if span.first == 0:
        RESTART(kept, n)
    if span.first == 0 or counters[STEP] == 0:
        BEGIN(address, of_span, counters, ORDER, state)
    y = kept
    if N > 0:
        y = stack_rows(N, ROWS)
        copy_rows(y, kept, N)
    u, v = y[U], y[V]
    has_rows, is_observed = len(span.t_rows) > 0, observation.look != 0
    observed = pointer_to(Observed(address, of_span, observation, counters, state))
    due = next_due(counters, observation.at_each)
    share = least_size(span.rtol)
    t, h, was_rejected = counters[TIME], counters[STEP], False
    taken, row, ended = 0, span.row, GOING
    while taken < span.count:
        remaining = span.t_end - t
        if remaining <= 0:
            ended = AT_END
            break
        if (has_rows and row + 2 > len(span.t_rows)) or (is_observed and counters[LOGGED] > observation.most_logged):
            ended = FULL
            break
        is_last = h >= remaining
        if is_last and span.may_shorten == 0:
            ended = BEFORE_END
            break
        step = remaining if is_last else h
        if not (is_last or (step > 0 and step >= RESOLUTION * abs(t + step))):  # also for NaN
            ended = TOO_SMALL
            break
        TRIAL(f, t, step, counters[STEP_BEFORE], p, n, y)
        counters[EVALUATIONS] += COST
        u_least, v_least, v_blur = share * counters[U_SIZE], share * counters[V_SIZE], 0.0
        if span.is_relative == 1 and (u_least == 0 or v_least == 0):
            if N > 0:
                copy_rows(kept, y, N)
            u_least, v_least, v_blur = SIZES_AT_REST(of_span, counters, t + step, state)
        square = SQUARE(step, n, y, span.rtol, span.atol, u_least, v_least)
        if span.points > 0:  # the way of a point counts as an error that is proportional to h^ORDER
            way = 0.0
            for j in range(span.points):
                way = max(way, abs(y[U_END][j] - y[U][j]))
            square = max(square, (way / span.reach) ** (2 * ORDER))
        if not square <= 1.0:
            counters[REJECTED] += 1
            h = step * shrinkage(square, ORDER)
            was_rejected = True
            continue
        t_end, error = span.t_end if is_last else t + step, exponent(square)
        h = next_step(step, counters[STEP_BEFORE], error, counters[ERROR], was_rejected, span.h_max, ORDER)
        if square == 0 and span.reads_time == 1 and is_silent(n, y):
            h = min(h, max(step, _SILENCE * (t_end - span.t0)))
            if step > counters[SILENT_STEP]:
                counters[SILENT_STEP], counters[SILENT_END] = step, t_end
        was_rejected = False
        outcome, s, t_stop = PASSED, 1.0, t_end
        is_written = has_rows and (span.first + taken + 1) % span.every == 0
        if is_observed and (
            observation.at_each == 1
            or span.first + taken + 1 >= due
            or not IS_CALM(observation.look, counters, t_end, y[U_END], y[V_END], p)
        ):
            if N > 0:
                copy_rows(kept, y, N)
            is_written = False
            outcome, row, s, t_stop = OBSERVE(observation.observe)(
                observed, span.first + taken + 1, row, t, step, t_end
            )
            if outcome in (NOT_A_NUMBER, RESTING):
                ended = outcome
                break
            due = next_due(counters, observation.at_each)
        taken += 1
        if outcome == PASSED:
            counters[ERROR], counters[STEP_BEFORE] = max(error, LEAST_ERROR), step
            ADVANCE(y, n)
        else:
            if N > 0:
                copy_rows(y, kept, N)
            RESTART(y, n)
            counters[ERROR], counters[STEP_BEFORE] = 0.0, s * step
            if outcome == RESET:
                h = min(h, LATER * counters[GAP])
        if is_written:
            write_row(span, row, t_stop, step, n, u, v)
            row += 1
        t = t_stop
        if span.is_relative == 1:
            u_size, v_size = counters[U_SIZE], counters[V_SIZE]
            for j in range(n):
                y[U_MOST][j], y[V_MOST][j] = max(y[U_MOST][j], abs(u[j])), max(y[V_MOST][j], abs(v[j]))
                if span.atol[0, j] < math.inf and y[V_MOST][j] > 0:  # no first-order unknown, nor written by events
                    u_size, v_size = max(u_size, y[U_MOST][j]), max(v_size, y[V_MOST][j])
            if v_size > v_blur:
                counters[U_SIZE], counters[V_SIZE] = u_size, v_size
        if outcome > RESET:
            ended = outcome
            break
    counters[TIME], counters[STEP] = t, h
    if N > 0:
        copy_rows(kept, y, N)
    return taken, row, ended


@element
def is_silent(n, y):
    """Return whether no force acts at either end of a step."""
    a_size = 0.0
    for j in range(n):
        a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    return a_size == 0


def kernel(module: str, form: Form, n: int, *, parts: Collection[str] | None) -> Any:
    """Compile the kernel of a method for a right-hand side given as an address, or load it from the disk.

    One degree of freedom in the scalar form and two in the vector form have kernels of their own, and n = 0 stands for
    a kernel that serves every number. The kernel is called as ``kernel((rhs, None), state, Observation(), counters,
    span, look)``. It returns the number of steps that it took, the next row to write, and how it ended.

    `module` names a file of `eig3.kernels.methods` with the formulas `variable`, see `eig3.kernels.loops.pair`. `parts`
    is None if the argument `look` is None, or otherwise what the kernel looks for within steps: see `observation`.
    """
    n = own_degrees(form, n)
    return observing(_kernel(module, form, n), module, form, n, parts)


def own_degrees(form: Form, n: int) -> int:
    """Return n if there is code for this number of degrees of freedom only, or 0."""
    return n if form is SCALAR or n == 2 else 0


@functools.cache
def _kernel(module: str, form: Form, n: int) -> Any:
    callbacks, names = pointer_callbacks(form)
    return _compile(module, form, callbacks, {**names, "N": n}, f"{module}_{form.name}_{n}")


def inline_kernel(module: str, form: Form, n: int, rhs: Any) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as the others are."""
    callbacks, names = inline_callbacks(form, rhs, None)
    names["N"] = n if n <= STACKED_DEGREES else 0
    return _compile(module, form, callbacks, names, "")


def observing(compiled: Any, module: str, form: Form, n: int, parts: Collection[str] | None) -> Any:
    """Return a function that calls a compiled kernel with what it needs to observe its steps."""
    if parts is None:
        return compiled
    addresses, place = observation(module, form, own_degrees(form, n), frozenset(parts)), placing()

    def call(callbacks: tuple, state: Any, settings: Any, counters: Any, span: Any, look: Any) -> Any:
        memory, watch = np.empty(RECORD_SIZE), look.watch
        most_logged = len(watch.log) - len(watch.events)
        mine = Observation(place(look, memory), most_logged, at_each_step(look.follow), *addresses)
        return compiled(callbacks, state, mine, counters, span, None)

    call.compiled = compiled  # type: ignore[attr-defined]
    return call


def _compile(module: str, form: Form, callbacks: Any, names: dict[str, Any], label: str) -> Any:
    formulas = variable_formulas(module)
    theirs = formulas.functions()
    begin, sizes_at_rest = beginning(form)
    names = {
        "ROWS": formulas.rows,
        "ORDER": formulas.order,
        "COST": formulas.evaluations,
        "TRIAL": theirs["trial"],
        "SQUARE": theirs["square"],
        "BEGIN": begin,
        "SIZES_AT_REST": sizes_at_rest,
        "ADVANCE": theirs["advance"],
        "RESTART": theirs.get("restart", nothing_past),
        "IS_CALM": calm(form),
        "OBSERVE": function_at(OF_OBSERVING),
        **names,
    }
    signature = UniTuple(int64, 3)(callbacks, matrix_type, OBSERVATION, vector_type, SPAN, none)
    return compile_kernel(variable, names, signature, label)


@element
def nothing_past(y, n):
    pass
