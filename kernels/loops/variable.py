# ruff: noqa: F821
"""The kernel for steps of variable length, which follow from tolerances.

`variable` is a template: the names in capitals stand for values that depend on the method, on the form of the
right-hand side and on the mode. LOOKS says for what the kernel looks, see `FOLLOWS`: the compiler leaves out the rest.
A state has rows of n values also for one degree of freedom: they are registers then.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from numba.types import UniTuple, int64, none

from ..compile.jit import compile_kernel, element
from ..protocol import (
    AT_END,
    BEFORE_END,
    ERROR,
    EVALUATIONS,
    FULL,
    GAP,
    GOING,
    LOGGED,
    LOOK_WITHIN,
    NEXT,
    NOT_A_NUMBER,
    PART,
    PARTS,
    PASSED,
    REJECTED,
    RESET,
    RESTING,
    SEARCHES,
    SILENT_END,
    SILENT_STEP,
    SPACING,
    SPAN,
    STEP,
    STEP_BEFORE,
    TERMINAL,
    TIME,
    TOO_SMALL,
    U_SIZE,
    V_SIZE,
    ZENO,
    Form,
    address_of,
    copy_rows,
    matrix_type,
    rows,
    stack_rows,
    vector_type,
)
from .beginning import RESOLUTION, beginning, least_size
from .controller import LEAST_ERROR, exponent, next_step, shrinkage
from .dense import evaluate
from .extremes_within import within_functions
from .fixed import STACKED_DEGREES, inline_callbacks, pointer_callbacks
from .follow import end_part, first_due, inline_functions, save, widen_all
from .follow import functions as following
from .formulas import variable_formulas
from .pair import A_END, U_END, U_MOST, V_END, V_MOST, A, U, V
from .zeros import LATER, quiet, searching

__all__ = ["inline_kernel", "kernel", "least_size"]

_SILENCE = 0.02  # longest step while nothing acts, relative to the time since the start


def variable(callbacks, state, settings, counters, span, look):
    """Take steps, and return their number, the next row to write, and how it ended."""
    n = N if N > 0 else state.shape[1]  # a constant: with n = 2, a step of RKN12 takes two thirds of the time
    f, p = RHS(callbacks), span.p
    kept, of_span = rows(state, ROWS), address_of(span)
    if span.first == 0:
        RESTART(kept, n)
    if span.first == 0 or counters[STEP] == 0:
        BEGIN(ADDRESS(callbacks), of_span, counters, ORDER, state)
    y = kept
    if N > 0:
        y = stack_rows(N, ROWS)
        copy_rows(y, kept, N)
    u, v, u_end, v_end = y[U], y[V], y[U_END], y[V_END]
    has_rows = len(span.t_rows) > 0
    if LOOKS > 0:
        place, watch, follow = address_of(look), look.watch, look.follow
        (u_there, v_there), coefficients = rows(watch.work, 2), watch.work[2:]
        has_events, has_times = len(watch.events) > 0, len(watch.times) > 0
    share = least_size(span.rtol)
    t, h, was_rejected = counters[TIME], counters[STEP], False
    taken, row, ended = 0, span.row, GOING
    while taken < span.count:
        remaining = span.t_end - t
        if remaining <= 0:
            ended = AT_END
            break
        if has_rows and row + 2 > len(span.t_rows):
            ended = FULL
            break
        if LOOKS == SEARCHES and int(counters[LOGGED]) + len(watch.events) > len(watch.log):
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
        if not square <= 1.0:
            counters[REJECTED] += 1
            h = step * shrinkage(square, ORDER)
            was_rejected = True
            continue
        taken += 1
        t_end, error = span.t_end if is_last else t + step, exponent(square)
        h = next_step(step, counters[STEP_BEFORE], error, counters[ERROR], was_rejected, span.h_max, ORDER)
        if square == 0 and span.reads_time == 1 and is_silent(n, y):
            h = min(h, max(step, _SILENCE * (t_end - span.t0)))
            if step > counters[SILENT_STEP]:
                counters[SILENT_STEP], counters[SILENT_END] = step, t_end
        was_rejected = False
        outcome, s, t_stop = PASSED, 1.0, t_end
        if LOOKS > 0 and N == 0:
            PROJECT(look.follow, t_end, u_end, v_end, p)
        if LOOKS > 0:
            first = first_due(follow, counters, span.first + taken)
            # within a step, only what was evaluated at its start is followed
            first_within = 0 if counters[SPACING] == 1 else follow.invariants
            follows, follows_within = len(follow.table) > first, len(follow.table) > first_within
            is_known = follows_within
            if LOOKS == SEARCHES:
                may_cross = has_events and not IS_QUIET(watch, counters, t_end, u_end, v_end, p)
                is_wanted = (
                    has_times and counters[NEXT] < len(watch.times) and watch.times[int(counters[NEXT])] <= t_end
                )
                is_known = follows_within or may_cross or is_wanted
            if is_known:
                DENSE(f, t, step, p, n, y, coefficients)
        if LOOKS == SEARCHES and may_cross:
            outcome, s, t_stop = SEARCH(
                place, counters, span.t0, t, step, t_end, n, coefficients, u_end, v_end, u_there, v_there, p
            )
            if outcome in (NOT_A_NUMBER, RESTING):
                taken, ended = taken - 1, outcome
                break
        counters[ERROR], counters[STEP_BEFORE] = max(error, LEAST_ERROR), step
        if LOOKS > 0:
            if LOOKS == SEARCHES and is_wanted:
                while int(counters[NEXT]) < len(watch.times) and watch.times[int(counters[NEXT])] <= t_stop:
                    WRITE_TIME(place, counters, t, step, t_end, n, coefficients, u_end, v_end, p)
            if is_known:
                counters[EVALUATIONS] += DENSE_COST
            if outcome != PASSED and s < 1.0:
                evaluate(coefficients, s, n, u_end, v_end)
            if follows:
                part = int(counters[PART]) % PARTS
                EVALUATE(follow, first, t_stop, u_end, v_end, p)
                if follows_within and t_stop > t:
                    FOLLOW_WITHIN(place, first_within, t_stop, s * step, s, n, p)
            if N == 0:
                ADVANCE_HISTORY(follow, t_stop, u_end, v_end, p)
        if LOOKS == SEARCHES and outcome != PASSED:
            if has_rows and span.every == 1 and s > 0:  # the state at the start is a row already
                write_row(span, row, t_stop, s * step, n, u_end, v_end)
                save(follow, row)
                row += 1
            for j in range(n):
                u[j], v[j] = u_there[j], v_there[j]
            if N == 0:
                PROJECT(follow, t_stop, u, v, p)
            f(t_stop, u, v, p, y[A])
            RESTART(y, n)
            counters[EVALUATIONS] += 1
            counters[STEP_BEFORE], counters[ERROR] = s * step, 0.0
            if outcome == RESET:
                h = min(h, LATER * counters[GAP])
            if N == 0:
                ADVANCE_HISTORY(follow, t_stop, u, v, p)
            if outcome <= ZENO:
                EVALUATE(follow, 0, t_stop, u, v, p)
                WIDEN(follow, 0, int(counters[PART]) % PARTS, t_stop, v)
                FOLLOW_END(follow, look.within)
        else:
            if LOOKS > 0 and follows:
                WIDEN(follow, first, part, t_end, v_end)
            ADVANCE(y, n)
        if outcome != TERMINAL and has_rows and (span.first + taken) % span.every == 0:
            write_row(span, row, t_stop, s * step, n, u, v)
            if LOOKS > 0:
                save(follow, row)
            row += 1
        if LOOKS > 0:
            end_part(follow, counters, span.first + taken, n, v)
        t = t_stop
        if span.is_relative == 1:
            u_size, v_size = counters[U_SIZE], counters[V_SIZE]
            for j in range(n):
                if span.atol[0, j] < math.inf:
                    y[U_MOST][j], y[V_MOST][j] = max(y[U_MOST][j], abs(u[j])), max(y[V_MOST][j], abs(v[j]))
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
def write_row(span, row, t, h, n, u, v):
    span.t_rows[row], span.h_rows[row] = t, h
    for j in range(n):
        span.u_rows[row, j], span.v_rows[row, j] = u[j], v[j]


@element
def is_silent(n, y):
    """Return whether no force acts at either end of a step."""
    a_size = 0.0
    for j in range(n):
        a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    return a_size == 0


def kernel(module: str, form: Form, n: int, *, looks: int) -> Any:
    """Compile the kernel of a method for a right-hand side given as an address, or load it from the disk.

    One and two degrees of freedom have kernels of their own. The kernel is called as ``kernel((rhs, None), state,
    settings, counters, span, look)``, where `settings` is not used. It returns the number of steps that it took, the
    next row to write, and how it ended.

    Parameters
    ----------
    module : str
        The name of a file of `eig3.kernels.methods` with the formulas `variable`, which is described in
        `eig3.kernels.loops.pair`.
    form : Form
    n : int
        Number of degrees of freedom; 0 for a kernel that serves every number.
    looks : int
        0 if the argument `look` is None, or one of `FOLLOWS` and `SEARCHES`, which say for what the kernel uses it.
    """
    return _kernel(module, form, n if n <= 2 else 0, looks)


@functools.cache
def _kernel(module: str, form: Form, n: int, looks: int) -> Any:
    callbacks, names = pointer_callbacks(form)
    return _compile(module, form, callbacks, {**names, "N": n}, looks, f"{module}_{form.name}_{n}_look{looks}")


def inline_kernel(module: str, form: Form, n: int, rhs: Any, *, looks: int, quantities: tuple = ()) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as ``kernel((), state, ...)``.

    The quantities are inlined at the ends of steps; see `eig3.kernels.loops.fixed.inline_kernel`.
    """
    callbacks, names = inline_callbacks(form, rhs, None)
    names["N"] = n if n <= STACKED_DEGREES else 0
    if quantities:
        names["EVALUATE"], names["WIDEN"] = inline_functions(form, quantities)
    return _compile(module, form, callbacks, names, looks, "")


def _compile(module: str, form: Form, callbacks: Any, names: dict[str, Any], looks: int, label: str) -> Any:
    formulas = variable_formulas(module)
    theirs = formulas.functions()
    begin, sizes_at_rest = beginning(form)
    names = {
        "LOOKS": looks,
        "ROWS": formulas.rows,
        "ORDER": formulas.order,
        "COST": formulas.evaluations,
        "DENSE_COST": formulas.dense_evaluations,
        "TRIAL": theirs["trial"],
        "SQUARE": theirs["square"],
        "DENSE": theirs["dense" if names["N"] else "dense_called"],
        "BEGIN": begin,
        "SIZES_AT_REST": sizes_at_rest,
        "ADVANCE": theirs["advance"],
        "RESTART": theirs.get("restart", nothing_past),
        "IS_QUIET": quiet(form),
        "EVALUATE": following(form).evaluate,
        "ADVANCE_HISTORY": following(form).advance,
        "PROJECT": following(form).project,
        "WIDEN": widen_all,
        **names,
    }
    if looks == SEARCHES:
        names["SEARCH"], names["WRITE_TIME"] = searching(form)
    if looks:
        names["FOLLOW_WITHIN"], names["FOLLOW_END"] = within_functions(form)
    records = SPAN, LOOK_WITHIN if looks else none
    signature = UniTuple(int64, 3)(callbacks, matrix_type, vector_type, vector_type, *records)
    return compile_kernel(variable, names, signature, label)


@element
def nothing_past(y, n):
    pass
